"""What every family of corruptions must keep, on every printer, damaged or realistic."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from printmend.corruption import HEALTHY, Corruption, corruption_toml, families, parse_corruption, sample
from printmend.machine.mechanism import Mechanism
from printmend.printer import Printer, read_printer
from printmend.twin import Twin
from tests import naive_twin

# The slow versions agree to the last bit but where a polynomial is summed in another order.
EXACT_BUT_FRAMES = 2e-10


@pytest.fixture(params=families())
def family(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture(params=["damaged", "realistic"])
def severity(request: pytest.FixtureRequest) -> Any:
    return request.param


@pytest.fixture(params=["damaged ender5", "damaged ender3", "damaged corexy", "realistic ender5"])
def twin(request: pytest.FixtureRequest, family: str) -> Twin:
    """A twin of every family on every preset."""
    severity, preset = request.param.split()
    return Twin.of(drawn(family, severity), read_printer(preset))


def drawn(family: str, severity: Any, seed: int = 5) -> Corruption:
    return sample(family, np.random.default_rng(seed), severity)


def walk(rng: np.random.Generator, ticks: int, axes: int) -> np.ndarray:
    """Controls that keep a direction for a while, as prints do, and reverse often."""
    turns = rng.integers(-3, 4, (ticks // 10 + 1, axes))
    return np.repeat(turns, 10, axis=0)[:ticks]


def middle(printer: Printer) -> np.ndarray:
    return np.array([*(np.array(printer.bed_steps) // 2), 200])


def test_toml_reads_back_equal(family: str, severity: Any) -> None:
    corruption = drawn(family, severity)
    assert parse_corruption(corruption_toml(corruption), subject=family) == corruption
    assert hash(corruption) == hash(drawn(family, severity))


def test_seeds_repeat_and_differ(family: str, severity: Any) -> None:
    assert drawn(family, severity) == drawn(family, severity)
    assert drawn(family, severity, 5) != drawn(family, severity, 6)


def test_values_are_frozen(family: str) -> None:
    corruption = drawn(family, "damaged")
    parts = [*(getattr(drive, name) for drive in corruption.drives for name in drive.__dataclass_fields__)]
    parts += [corruption.frame, corruption.screw]
    present = [part for part in parts if part is not None]
    assert present
    for part in present:
        name = next(iter(part.__dataclass_fields__))
        with pytest.raises(AttributeError):
            setattr(part, name, 1.0)


def test_tables_rise_and_are_ordered(twin: Twin) -> None:
    mechanism = twin.mechanism
    if not isinstance(mechanism, Mechanism):
        return
    for table in [*mechanism.transmissions] + ([mechanism.screw.transmission] if mechanism.screw else []):
        assert np.isfinite(table.lower_mm).all()
        assert np.isfinite(table.upper_mm).all()
        assert (np.diff(table.lower_mm) >= 0).all()
        assert (np.diff(table.upper_mm) >= 0).all()
        assert (table.lower_mm <= table.upper_mm).all()
        assert not table.lower_mm.flags.writeable


def test_it_prints_another_path(family: str, twin: Twin) -> None:
    """A healthy machine prints the nominal path exactly; no drawn corruption does."""
    ticks = np.arange(300_000)
    shuttle = [np.where(ticks // period % 2 == 0, 1, -1) for period in (260, 341)]
    lift = np.where(ticks % 2000 < 1000, 1, -1) * (ticks % 10 == 0)
    controls, start = np.column_stack([*shuttle, lift]), middle(twin.printer)
    nominal = start + np.concatenate([np.zeros((1, 3)), np.cumsum(controls, axis=0)])
    assert np.array_equal(Twin.of(HEALTHY, twin.printer).run(controls, start), nominal)
    printed = twin.run(controls, start)
    assert np.isfinite(printed).all()
    assert np.abs(printed - nominal).max() > (1e-3 if family in ("ripple", "friction") else 0.01)


def test_twin_equals_the_slow_version(family: str, twin: Twin) -> None:
    """Lattice controls of two axes and of three, and way-points of two and of three."""
    rng = np.random.default_rng(3)
    controls, start = walk(rng, 500, 3), middle(twin.printer)
    flat, slow = twin.run(controls[:, :2], start[:2]), naive_twin.run(twin, controls[:, :2], start[:2])
    if not isinstance(twin.mechanism, Mechanism):
        assert np.array_equal(flat, slow)
        return
    framed = not twin.mechanism.frame.is_identity
    np.testing.assert_allclose(flat, slow, rtol=0, atol=EXACT_BUT_FRAMES if framed else 0)
    solid, slow = twin.run(controls, start), naive_twin.run(twin, controls, start)
    np.testing.assert_allclose(solid, slow, rtol=0, atol=EXACT_BUT_FRAMES if framed else 0)
    printer = twin.printer
    waypoints = rng.uniform(0.1, 0.9, (80, 3)) * [printer.x.max_mm, printer.y.max_mm, 20.0]
    waypoints[0] = (*printer.home_mm, printer.z.home_mm)
    followed = twin.follow(waypoints)
    assert np.array_equal(followed, naive_twin.follow(twin, waypoints))
    np.testing.assert_allclose(followed[0], waypoints[0], rtol=0, atol=1e-9)  # homed: at home at home
    if twin.mechanism.screw is None:
        assert np.array_equal(twin.follow(waypoints[:, :2]), followed[:, :2])
        assert np.array_equal(flat, solid[:, :2])


def test_one_turn_is_one_circumference(family: str, twin: Twin) -> None:
    """A turn further on, every fault of a pulley or a shaft repeats."""
    if not isinstance(twin.mechanism, Mechanism) or family in ("elastic", "friction", "smooth", "everything"):
        return  # their faults depend on the place too
    for motor, table in enumerate(twin.mechanism.transmissions):
        mm_per_turn = twin.printer.axes[motor].mm_per_turn
        turn = round(mm_per_turn / table.pitch_mm)
        for branch in (table.lower_mm, table.upper_mm):
            advance = (branch[turn:] - branch[:-turn])[turn:-turn]  # slack at the tables' ends looks beyond them
            np.testing.assert_allclose(advance, advance[0], rtol=0, atol=1e-6)
            assert advance[0] == pytest.approx(mm_per_turn, rel=0.65)


def test_closed_paths_of_taut_machines_close(family: str, twin: Twin) -> None:
    """What has no play, no jumps and no gain table is a map: a path there and back ends where it began."""
    taut = isinstance(twin.mechanism, Mechanism) and all(table.is_taut for table in twin.mechanism.transmissions)
    if not taut or family == "jumps":
        return
    out, start = walk(np.random.default_rng(8), 500, 2), middle(twin.printer)[:2]
    printed = twin.run(np.vstack([out, -out[::-1]]), start)
    np.testing.assert_allclose(printed[-1], start, rtol=0, atol=1e-9)


def test_corruptions_compose(printer: Printer) -> None:
    """The faults of different parts go into one machine: pulley, belt, shaft, friction, ripple, warp, jumps, Z."""
    parts = {
        name: drawn(name, "damaged") for name in ("pulley-play", "set-screw", "friction", "ripple", "smooth", "jumps")
    }
    drives = []
    for motor in range(2):
        drive = parts["pulley-play"].drives[motor]
        for other in ("set-screw", "friction", "ripple", "smooth", "jumps"):
            found = parts[other].drives[motor]
            present = {n: v for n in found.__dataclass_fields__ if (v := getattr(found, n)) is not None}
            drive = replace(drive, **present)
        drives.append(drive)
    whole = Corruption((drives[0], drives[1]), drawn("frame", "damaged").frame, drawn("screw", "damaged").screw)
    assert parse_corruption(corruption_toml(whole), subject="whole") == whole
    twin = Twin.of(whole, printer)
    controls, start = walk(np.random.default_rng(9), 500, 3), middle(printer)
    np.testing.assert_allclose(
        twin.run(controls, start), naive_twin.run(twin, controls, start), rtol=0, atol=EXACT_BUT_FRAMES
    )
