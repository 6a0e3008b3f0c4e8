"""The twin: exact against the slow versions, laws of the machine."""

import itertools

import numpy as np
import pytest

from printmend.corruption import HEALTHY, Corruption, Drive, EccentricBore, GainTable, LooseBelt, Play
from printmend.errors import InputError
from printmend.machine import lattice_tables
from printmend.printer import Printer
from printmend.twin import Twin
from printmend_lab.sampling import sample
from tests import naive_twin


def middle(printer: Printer) -> np.ndarray:
    return np.array(printer.bed_steps) // 2


def test_a_healthy_printer_prints_the_nominal_path_exactly(printer: Printer, rng: np.random.Generator) -> None:
    controls = rng.integers(-1, 2, (20_000, 2))
    printed = Twin.of(HEALTHY, printer).run(controls, middle(printer))
    assert np.array_equal(printed[1:], middle(printer) + np.cumsum(controls, axis=0))
    waypoints = np.vstack([[printer.home_mm], rng.integers(0, 1600, (500, 2)) * 0.1])
    np.testing.assert_allclose(Twin.of(HEALTHY, printer).follow(waypoints), waypoints, atol=1e-9)


@pytest.mark.parametrize("family", ["pulley", "play", "pulley-loose", "set-screw", "friction", "ripple"])
def test_play_world_equals_the_slow_version(family: str, printer: Printer, rng: np.random.Generator) -> None:
    twin = Twin.of(sample(family, rng), printer)
    controls = rng.integers(-3, 4, (3000, 2))
    start = middle(printer)
    tables = lattice_tables(twin.mechanism, start)
    moves = printer.to_motor(controls)
    slow = [
        naive_twin.play(motor.start + np.cumsum(moves[:, m]), motor.origin_steps, motor.lower_steps, motor.upper_steps)
        for m, motor in enumerate(tables.motors)
    ]
    assert np.array_equal(twin.run(controls, start), printer.from_motor(np.array(slow).T))


def test_gain_world_equals_the_slow_version(ender5: Printer, rng: np.random.Generator) -> None:
    corruption = sample("gain-table", rng)
    controls = rng.integers(-3, 4, (3000, 2))
    printed = Twin.of(corruption, ender5).run(controls, np.array([3, 1090]))
    for axis, start in enumerate((3, 1090)):
        gains = np.array(corruption.drives[axis].gain_table.gains)
        assert np.array_equal(printed[:, axis], naive_twin.gain_run(controls[:, axis], start, gains, 1100))


def test_gain_world_is_not_conservative(ender5: Printer) -> None:
    gains = tuple(1 + 0.3 * np.cos(np.arange(1100) / 10))
    corruption = Corruption((Drive(gain_table=GainTable(gains)), Drive(gain_table=GainTable(gains))))
    there_and_back = np.repeat([[1, 0], [-1, 0]], 40, axis=0)
    printed = Twin.of(corruption, ender5).run(there_and_back, np.array([500, 500]))
    assert abs(printed[-1, 0] - 500) > 1e-3


@pytest.mark.parametrize("family", ["eccentric", "polygon", "published", "elastic"])
def test_taut_machines_come_back(family: str, printer: Printer, rng: np.random.Generator) -> None:
    """Position maps are conservative: a closed path of a taut machine ends where it began."""
    out = rng.integers(-1, 2, (2000, 2))
    printed = Twin.of(sample(family, rng), printer).run(np.vstack([out, -out[::-1]]), middle(printer))
    np.testing.assert_allclose(printed[-1], middle(printer), atol=1e-9)


def test_play_has_history(ender5: Printer) -> None:
    twin = Twin.of(Corruption((Drive(belt=Play(1.0)), Drive())), ender5)  # 1 mm is 5 steps
    steps = np.repeat([[1, 0], [-1, 0], [1, 0]], (10, 10, 3), axis=0)
    x = twin.run(steps, np.array([500, 500]))[:, 0] - 500
    # Half the play to push, then all of it at the reversal.
    np.testing.assert_allclose(x[[0, 2, 3, 10, 15, 16, 20, 23]], [0, 0, 0.5, 7.5, 7.5, 6.5, 2.5, 2.5])


def test_micro_steps_are_the_resolution_of_way_points(ender5: Printer) -> None:
    twin = Twin.of(HEALTHY, ender5)
    printed = twin.follow(np.array([[220.0, 220.0], [100.003, 50.0101]]))
    np.testing.assert_allclose(printed[1], [100.0, 50.0125], atol=1e-9)


def test_homing_engages_the_home_side(ender5: Printer) -> None:
    """Homed towards the maximum, the belt pushes forwards: the first move back takes up the whole play."""
    twin = Twin.of(Corruption((Drive(belt=Play(0.5)), Drive())), ender5)
    printed = twin.follow(np.array([[220.0, 220.0], [219.75, 220.0], [210.0, 220.0]]))
    np.testing.assert_allclose(printed[:, 0], [220.0, 220.0, 210.5], atol=1e-9)


def test_way_points_agree_with_a_fine_walk(printer: Printer, rng: np.random.Generator) -> None:
    """Straight moves are monotone for each motor, so that way-points alone carry the history."""
    drive = Drive(pulley=EccentricBore(1.0, 1.0), belt=LooseBelt(1.5, 1.5))
    twin = Twin.of(Corruption((drive, drive)), printer)
    waypoints = np.vstack([[printer.home_mm], np.rint(rng.uniform(10, 200, (40, 2)) / 0.0125) * 0.0125])
    fine = np.vstack([waypoints[:1], *(np.linspace(a, b, 200)[1:] for a, b in itertools.pairwise(waypoints))])
    coarse = twin.follow(waypoints)
    np.testing.assert_allclose(twin.follow(fine)[::199][: len(coarse)], coarse, atol=1e-6)


@pytest.mark.parametrize(
    ("controls", "start"),
    [(np.zeros((3, 3)), np.zeros(2)), (np.zeros(3), np.zeros(2)), (np.full((5000, 2), 3), np.zeros(2))],
)
def test_impossible_controls_are_refused(controls: np.ndarray, start: np.ndarray, ender5: Printer) -> None:
    with pytest.raises(InputError, match="expected"):
        Twin.of(HEALTHY, ender5).run(controls, start)


def test_homing_one_axis_is_a_way_point() -> None:
    """The head comes back from its switch, so the next move pushes the other way than the file's places say."""
    from printmend.gcode.read import read_gcode
    from printmend.printer import read_printer
    from printmend.twin.gcode import print_gcode

    printer = read_printer("ender3")
    twin = Twin.of(Corruption((Drive(belt=Play(0.4)), Drive())), printer)
    program = read_gcode(b"G90\nG28\nG1 X80 Y50 F3000\nG28 X\nG1 X60\n", printer=printer)
    trace = print_gcode(program, twin, noise_mm=0.0, rng=np.random.default_rng(1))
    assert trace.commanded_mm.tolist() == [[0, 0], [80, 50], [0, 50], [60, 50]]
    assert trace.measured_mm[:, 0] == pytest.approx([0, 79.6, 0, 59.6])
