"""What every family of corruptions must keep, on every printer, damaged or realistic."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from printmend.corruption import Corruption, corruption_toml, parse_corruption
from printmend.machine import Mechanism
from printmend.machine.kernels.play import RESOLUTION
from printmend.printer import Printer
from printmend.twin import Twin
from printmend_lab.conformance.families import CHECKS, FamilyCandidate, middle, walk
from printmend_lab.sampling import families, sample
from tests import naive_twin
from tests.conformance import broken_by

# The slow versions know no resolution, and sum polynomials in another order.
EXACT_BUT_FRAMES = 2e-10
TO_THE_RESOLUTION = 2 / RESOLUTION  # full steps: the lattice's tables and the anchor are rounded to it once each


@pytest.fixture(params=families())
def family(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture(params=["damaged ender3", "damaged corexy", "realistic ender5"])
def twin(request: pytest.FixtureRequest, family: str) -> Twin:
    """A twin of every family on every preset, damaged or realistic."""
    severity, preset = request.param.split()
    return FamilyCandidate(family).twin(severity, preset)  # type: ignore[arg-type]


def drawn(family: str, severity: Any, seed: int = 5) -> Corruption:
    return sample(family, np.random.default_rng(seed), severity)


def test_keeps_what_a_family_must(family: str) -> None:
    assert broken_by(FamilyCandidate(family), CHECKS) == {}


def test_toml_reads_back_equal(family: str) -> None:
    for severity in ("damaged", "realistic"):
        corruption = drawn(family, severity)
        assert parse_corruption(corruption_toml(corruption), subject=family) == corruption
        assert hash(corruption) == hash(drawn(family, severity))


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


def test_twin_equals_the_slow_version(family: str, twin: Twin) -> None:
    """Lattice controls of two axes and of three, and way-points of two and of three."""
    rng = np.random.default_rng(3)
    controls, start = walk(rng, 300, 3), middle(twin.printer)
    flat, slow = twin.run(controls[:, :2], start[:2]), naive_twin.run(twin, controls[:, :2], start[:2])
    if not isinstance(twin.mechanism, Mechanism):
        assert np.array_equal(flat, slow)
        return
    framed = not twin.mechanism.frame.is_identity
    np.testing.assert_allclose(flat, slow, rtol=0, atol=EXACT_BUT_FRAMES if framed else TO_THE_RESOLUTION)
    solid, slow = twin.run(controls, start), naive_twin.run(twin, controls, start)
    np.testing.assert_allclose(solid, slow, rtol=0, atol=EXACT_BUT_FRAMES if framed else TO_THE_RESOLUTION)
    printer = twin.printer
    waypoints = rng.uniform(0.1, 0.9, (50, 3)) * [printer.x.max_mm, printer.y.max_mm, 20.0]
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
