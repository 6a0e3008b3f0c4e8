"""The grey box identifies machines of a simulator that shares no code with it."""

import dataclasses

import numpy as np
import pytest

from printmend.corruption import HEALTHY, Corruption, Drive, PublishedHull
from printmend.errors import TraceError
from printmend.machine import Mechanism
from printmend.path import Trace
from printmend.printer import Printer, read_printer
from printmend.probe import design_probe
from printmend.twin import Twin
from printmend_lab.greybox import Greybox, GreyboxModel
from printmend_lab.greybox.drive import NOTHING
from printmend_lab.published import layer_trace
from printmend_lab.sampling import sample
from tests.naive_machine import NaiveDrive, circle, corners, loose, walk
from tests.shapes import ring_layer

ENDER3 = read_printer("ender3")
HOME = (0.0, 0.0)


def learn(trace: Trace, printer: Printer = ENDER3, seed: int = 0) -> GreyboxModel:
    return Greybox().fit(trace, printer, rng=np.random.default_rng(seed))


def stairs(points: int, low: float = 6.0, high: float = 214.0) -> np.ndarray:
    """Way-points on both diagonals, there and back, and a staircase of reversals that shrink."""
    ends = [(low, low), (high, high), (low, low), (low, high), (high, low)]
    share, reach = 0.0, 0.3
    while share < 1.0 and reach > 0.01:
        ends += [
            (high - (high - low) * s, low + (high - low) * s) for s in (min(share + reach, 1.0), share + 0.4 * reach)
        ]
        share, reach = share + 0.4 * reach, 0.85 * reach
    corner = np.array([HOME, *ends])
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corner, axis=0), axis=1))])
    wanted = np.union1d(along, np.linspace(0.0, along[-1], max(points - len(along), 2)))
    return np.stack([np.interp(wanted, along, corner[:, i]) for i in range(2)], axis=1)


def naive_trace(drives, points: int, noise_mm: float, rng: np.random.Generator, *, place: float = 1.0) -> Trace:
    way = stairs(points)
    printed = walk(drives, way, home=HOME, place=place)
    return Trace(way, printed + rng.normal(0, noise_mm, printed.shape), homed=True)


def branch_error_mm(model: GreyboxModel, drives) -> float:
    """Return the RMS error of both branches of both motors over what lies on the bed."""
    errors = []
    for drive, table in zip(drives, model.mechanism.transmissions, strict=True):
        motor = np.linspace(0.0, 220.0, 397)
        truth = np.array([drive.branches(m) for m in motor])
        on_bed = (truth > 0).all(axis=1) & (truth < 220).all(axis=1)
        errors.append((np.stack(table.branches_mm(motor), axis=1) - truth)[on_bed].ravel())
    return float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))


LUMPY = corners([6.9, 6.2, 7.1, 6.5, 6.8])
MACHINES = {
    "eccentric + play": (circle(centre=(0.7, 0.4)), circle(), {"play": 0.6}, {"play": 0.25}),
    "polygons": (LUMPY, corners([6.6, 7.0, 6.4], 1.0), {}, {}),
    "loose, eccentric": (circle(centre=(0.3, -0.5)), circle(5.4), {"slack": 0.4}, {"slack": 1.2}),
    "polygon, loose": (LUMPY, circle(7.3, centre=(0.2, 0.0)), {"slack": 0.7}, {"play": 1.8}),
}


def machine(name: str) -> tuple[NaiveDrive, NaiveDrive]:
    one, two, first, second = MACHINES[name]
    return tuple(  # type: ignore[return-value]
        NaiveDrive(points, slack=loose(points, fault["slack"])) if "slack" in fault else NaiveDrive(points, **fault)
        for points, fault in ((one, first), (two, second))
    )


@pytest.mark.parametrize(
    ("name", "noise_mm", "points", "limit_mm"),
    [
        ("eccentric + play", 0.05, 900, 0.02),
        ("polygons", 0.0, 400, 0.005),
        ("polygon, loose", 0.05, 900, 0.02),
        ("polygon, loose", 0.0, 80, 0.05),
    ],
)
def test_learns_machines_of_another_simulator(name: str, noise_mm: float, points: int, limit_mm: float) -> None:
    rng = np.random.default_rng(7)
    drives = machine(name)
    model = learn(naive_trace(drives, points, noise_mm, rng))
    assert branch_error_mm(model, drives) < limit_mm


@pytest.mark.parametrize("place", [0.0, 0.4])  # 1.0 is where the other tests begin
def test_homing_may_leave_the_belt_anywhere_in_its_play(place: float) -> None:
    drives = machine("polygon, loose")
    model = learn(naive_trace(drives, 400, 0.0, np.random.default_rng(1), place=place))
    assert branch_error_mm(model, drives) < 0.005


def test_gross_outliers_and_gaps_do_little(rng: np.random.Generator) -> None:
    drives = machine("eccentric + play")
    trace = naive_trace(drives, 600, 0.05, rng)
    measured = trace.measured_mm.copy()
    wild = rng.random(measured.shape) < 0.05
    measured[wild] += rng.normal(0, 5.0, wild.sum())
    measured[rng.random(measured.shape) < 0.3] = np.nan
    assert branch_error_mm(learn(dataclasses.replace(trace, measured_mm=measured)), drives) < 0.03


def test_known_uncertainties_are_used() -> None:
    rng = np.random.default_rng(3)
    drives = machine("eccentric + play")
    trace = naive_trace(drives, 600, 0.0, rng)
    sigma = np.where(rng.random(len(trace)) < 0.5, 0.5, 0.01)
    noisy = dataclasses.replace(
        trace, measured_mm=trace.measured_mm + sigma[:, None] * rng.normal(size=(len(trace), 2))
    )
    told = branch_error_mm(learn(dataclasses.replace(noisy, sigma_mm=sigma)), drives)
    assert told < 0.01
    assert told < branch_error_mm(learn(noisy), drives)


def test_healthy_machines_stay_healthy(printer: Printer) -> None:
    plan, twin = design_probe(printer, marks=300), Twin.of(HEALTHY, printer)
    marks = twin.follow(plan.waypoints_mm)[plan.rows]
    exact = learn(plan.trace(marks), printer)
    assert exact.is_healthy
    assert [drive.structure for drive in exact.drives] == [NOTHING, NOTHING]
    noise = np.random.default_rng(0).normal(0, 0.05, marks.shape)
    model = learn(plan.trace(marks + noise), printer)
    for table in model.mechanism.transmissions:
        inside = np.linspace(*printer.motor_range_mm(0), 500)
        assert np.abs(np.stack(table.branches_mm(inside)) - inside).max() < 0.02


@pytest.mark.parametrize(
    ("family", "preset"),
    [
        *((family, "ender5") for family in ("pulley-loose", "pulley-set-screw", "elastic", "friction", "smooth")),
        *(("frame", preset) for preset in ("ender5", "corexy")),
        ("pulley-play", "corexy"),
    ],
)
def test_learns_every_family_from_the_probe(family: str, preset: str) -> None:
    """Both machines, the true and the learned, go the same way over the bed; no jumps are seen where there are none."""
    printer = read_printer(preset)
    rng = np.random.default_rng(11)
    plan, twin = design_probe(printer), Twin.of(sample(family, rng), printer)
    marks = twin.follow(plan.waypoints_mm)[plan.rows]
    model = learn(plan.trace(marks + rng.normal(0, 0.05, marks.shape)), printer)
    low, high = np.array([printer.x.min_mm, printer.y.min_mm]), np.array([printer.x.max_mm, printer.y.max_mm])
    way = np.concatenate([[printer.home_mm], low + (high - low) * rng.random((800, 2))])
    difference = follow(model.mechanism, way) - twin.follow(way)
    squares_mm2 = np.sum(difference[50:] ** 2, axis=1)
    marked = plan.waypoints_mm[plan.rows]
    inside = ((way[50:] > marked.min(axis=0)) & (way[50:] < marked.max(axis=0))).all(axis=1)
    assert np.sqrt(np.mean(squares_mm2[inside])) < 0.025
    # how what repeats nothing goes on beyond the marks, they do not show
    assert np.sqrt(np.mean(squares_mm2)) < (0.04 if family == "smooth" else 0.03)
    assert model.jumps == ((), ())


def follow(mechanism: Mechanism, way: np.ndarray) -> np.ndarray:
    """Send a learned, absolute machine along way-points."""
    motors = mechanism.printer.to_motor(way)
    belts = np.empty_like(motors)
    for i, table in enumerate(mechanism.transmissions):
        lower, upper = table.branches_mm(motors[:, i])
        place = lower[0]
        for t in range(len(way)):
            place = belts[t, i] = min(max(place, lower[t]), upper[t])
    return mechanism.frame.apply(mechanism.printer.from_motor(belts))


def test_the_standard_deviations_are_true() -> None:
    """The error of the learned branches is about as large as the model says, over several noises."""
    drives = machine("eccentric + play")
    trace = naive_trace(drives, 300, 0.0, np.random.default_rng(0))
    motor = np.linspace(10, 210, 41)
    truth = np.array([drives[0].branches(m) for m in motor])[:, 0]
    ratios = []
    for seed in range(3):
        noise = np.random.default_rng(seed).normal(0, 0.05, trace.measured_mm.shape)
        model = learn(dataclasses.replace(trace, measured_mm=trace.measured_mm + noise))
        error = model.mechanism.transmissions[0].branches_mm(motor)[0] - truth
        ratios.append(error / model.drives[0].sd_mm(motor)[0])
    assert 0.4 < np.sqrt(np.mean(np.square(ratios))) < 2.0


def test_layers_of_the_lattice(ender5: Printer) -> None:
    """physics.md §4: from a 44 mm layer, another layer is predicted to a few hundredths of a step."""
    training, other = ring_layer((520.0, 540.0), 112.0), ring_layer((530.0, 530.0), 80.0, turn=0.7, index=1)
    twin = Twin.of(sample("pulley-play", np.random.default_rng(0)), ender5)
    model = learn(layer_trace(training, twin.run(training.controls, training.start_steps), ender5), ender5)
    want = twin.run(other.controls, other.start_steps)
    imagined = Twin(model.mechanism).run(other.controls, other.start_steps)
    assert np.sqrt(np.mean(np.sum((imagined - want) ** 2, axis=1))) < 0.05


@pytest.mark.parametrize("name", ["polygons", "polygon, loose"])
def test_half_a_turn_does_not_explode(name: str) -> None:
    """Much of the pulleys was never seen: the model stays of the size of a fault, and is right where it saw."""
    drives = machine(name)
    t = np.linspace(0, 6 * np.pi, 500)
    way = np.concatenate([[HOME], np.stack([110 + 11 * np.cos(t), 108 + 9 * np.sin(t)], axis=1)])
    printed = walk(drives, way, home=HOME)
    printed[0] = np.nan
    model = learn(Trace(way, printed, homed=True))
    for i, (drive, table) in enumerate(zip(drives, model.mechanism.transmissions, strict=True)):
        error = [np.array(table.branches_mm(m)) - drive.branches(m) for m in np.linspace(60.0, 160.0, 101)]
        assert np.sqrt(np.mean(np.square(error))) < 10.0
        seen = [table.branches_mm(m)[0] - drive.branches(m)[0] for m in np.linspace(112.0, 116.0, 9)]
        assert np.abs(seen).max() < 0.05
        assert model.drives[i].seen < 0.95


def test_nine_tenths_of_a_turn_show_a_triangle_whole() -> None:
    """What a weak pulley needs beyond the turn that it was seen in follows from its symmetry."""
    turn = 40.0
    broken = Corruption((Drive(pulley=PublishedHull("triangle", 0.13)), Drive(pulley=PublishedHull("triangle", 5.4))))
    mechanism = broken.lower(ENDER3)
    way = np.array([100.0, 100.0]) + 0.905 * turn / 2 * (1 + np.outer(np.cos(np.linspace(0, 6 * np.pi, 900)), [1, 1]))
    way[:, 1] += np.linspace(0, 0.02, 900)
    trace = Trace(way, Twin(mechanism).follow(way) + np.random.default_rng(5).normal(0, 0.05, way.shape))
    model = learn(trace)
    for true, found, drive in zip(mechanism.transmissions, model.mechanism.transmissions, model.drives, strict=True):
        assert drive.seen == pytest.approx(0.905, abs=0.01)
        beyond = np.linspace(100.0, 100.0 + turn, 81)
        error = found.branches_mm(beyond)[0] - true.branches_mm(beyond)[0]
        assert np.ptp(error) < 0.1


def test_jumps_within_the_print_are_taken_out() -> None:
    """A skipped tooth and a loss of steps in the middle of the print are no part of the machine."""
    rng = np.random.default_rng(4)
    drives = machine("eccentric + play")
    way = stairs(800)
    path = way.copy()
    path[500:, 1] += 0.8  # the motor ran ahead by four full steps
    printed = walk(drives, path, home=HOME)
    printed[300:, 0] -= 2.0  # the belt skipped a tooth
    model = learn(Trace(way, printed + rng.normal(0, 0.05, printed.shape), homed=True))
    assert [(jump.belt, jump.size_mm) for jump in model.jumps[0]] == [(True, -2.0)]
    assert [(jump.belt, jump.size_mm) for jump in model.jumps[1]] == [(False, 0.8)]
    assert abs(model.jumps[0][0].row - 300) <= 3
    assert abs(model.jumps[1][0].row - 500) <= 15  # a loss of steps shows when the play is taken up
    assert branch_error_mm(model, drives) < 0.03


def test_equal_seeds_give_equal_models() -> None:
    trace = naive_trace(machine("eccentric + play"), 600, 0.05, np.random.default_rng(0))
    one, two = learn(trace, seed=5), learn(trace, seed=5)
    for a, b in zip(one.mechanism.transmissions, two.mechanism.transmissions, strict=True):
        np.testing.assert_array_equal(a.lower_mm, b.lower_mm)


@pytest.mark.parametrize("rows", [0, 1, 9])
def test_too_few_points_are_refused(rows: int) -> None:
    with pytest.raises(TraceError, match="10 measured points"):
        learn(Trace(np.zeros((rows, 2)), np.zeros((rows, 2))))


def test_a_commanded_position_must_be_known() -> None:
    way = stairs(40)
    broken = way.copy()
    broken[7, 1] = np.nan
    with pytest.raises(TraceError, match="NaN"):
        learn(Trace(broken, way))


@pytest.mark.parametrize("way", ["still", "one axis", "two places"])
def test_poor_traces_give_a_tame_model(way: str, rng: np.random.Generator) -> None:
    """Traces that teach next to nothing end in next to no correction, not in an error or an explosion."""
    points = np.zeros((40, 2)) + 50.0
    if way == "one axis":
        points[:, 0] = np.linspace(20, 200, 40)
    if way == "two places":
        points[::2] = 100.0
    model = learn(Trace(points, points + rng.normal(0, 0.02, points.shape)))
    for table in model.mechanism.transmissions:
        assert np.abs(table.lower_mm - table.motor_mm).max() < 0.1
