"""A printer that prints its own pulley: the printed hull, its law for small faults, the part's G-code, the command."""

from pathlib import Path

import numpy as np
import pytest
import shapely
from click.testing import CliRunner

from printmend.cli.main import group
from printmend.corruption import HEALTHY, Corruption, Drive, EccentricBore
from printmend.gcode.read import read_gcode
from printmend.printer import read_printer
from printmend.twin import Twin
from printmend_lab.demo import selfrepair
from printmend_lab.demo import selfrepair as pulley_part
from printmend_lab.demo.selfrepair import RADIUS_MM, printed_pulley, pulley_gcode

PRINTER = read_printer("ender5")


@pytest.fixture(scope="module")
def part(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("pulley") / "pulley.gcode"
    path.write_text(pulley_gcode(PRINTER))
    return path


@pytest.fixture
def exact(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(selfrepair, "SHRINKAGE", 0.0)
    monkeypatch.setattr(selfrepair, "ROUGH_MM", 0.0)


def test_the_part_is_a_pulley_with_bore_hub_and_set_screw(part: Path) -> None:
    program = read_gcode(part, printer=PRINTER)
    moves = program.moves
    drawn = moves.extruding & moves.known.all(axis=1)
    strokes = [
        shapely.MultiLineString(list(np.stack([moves.start_mm[at, :2], moves.end_mm[at, :2]], axis=1))).buffer(0.2)
        for layer in (18, pulley_part.TOOTHED_LAYER)
        for at in [np.flatnonzero(drawn & (moves.layer == layer))]
    ]
    hub, teeth = strokes
    middle = shapely.Point(110, 110)
    assert not teeth.intersects(middle.buffer(2.4)), "the bore is open"
    assert teeth.intersection(middle.buffer(5.2).difference(middle.buffer(2.6))).area > 0.97 * np.pi * (5.2**2 - 2.6**2)
    assert shapely.hausdorff_distance(teeth.convex_hull.exterior, middle.buffer(pulley_part.TIP_MM).exterior) < 0.1
    grooves = teeth.convex_hull.difference(teeth).difference(middle.buffer(4))
    assert len([one for one in grooves.geoms if one.area > 0.3]) == pulley_part.TEETH
    assert not hub.intersects(shapely.LineString([(110, 110), (119.2, 110)])), "the set screw meets the shaft"
    assert hub.intersects(shapely.LineString([(110, 110), (100, 110)]))


@pytest.mark.usefixtures("exact")
def test_a_good_printer_prints_a_good_pulley(part: Path) -> None:
    printed = printed_pulley(part, Twin.of(HEALTHY, PRINTER), np.random.default_rng(0))
    assert printed.rms_mm < 0.03, "the teeth's corners"
    assert abs(printed.size_mm) < 0.02


@pytest.mark.usefixtures("exact")
def test_a_small_fault_comes_back_as_the_integral_over_the_part(part: Path) -> None:
    """δh(φ) = cos φ ∫ δh dθ over the angles that x passes from the bore to the point: first order in the fault."""
    off_mm = 0.3
    twin = Twin.of(Corruption((Drive(pulley=EccentricBore(off_mm)), Drive())), PRINTER)
    printed = printed_pulley(part, twin, np.random.default_rng(0))
    good = printed_pulley(part, Twin.of(HEALTHY, PRINTER), np.random.default_rng(0))
    phi = np.arange(selfrepair.ANGLES) * 2 * np.pi / selfrepair.ANGLES
    middle = 110.0 / RADIUS_MM
    # x of the rim is displaced by e·(sin of the motor's angle there − sin at the middle)
    moved = off_mm * (np.sin(middle + np.cos(phi) * pulley_part.TIP_MM / RADIUS_MM) - np.sin(middle))
    expected = np.cos(phi) * moved
    found = printed.support_mm - good.support_mm
    bore = 2.5 / RADIUS_MM  # the shaft sits in the middle of a bore that is displaced as well
    around = off_mm * (np.sin(middle + bore * np.cos(phi)) - np.sin(middle))
    expected -= np.cos(phi) * np.mean(around * np.cos(phi) ** 2) * 2
    assert np.abs(found - expected).max() < 0.03
    assert np.abs(expected).max() > 0.1


@pytest.mark.parametrize("more", [["--hull", "round"], ["--hull", "egg", "--corruption", "x.toml"]])
def test_the_command_refuses_what_it_does_not_know(tmp_path: Path, more: list[str]) -> None:
    done = CliRunner().invoke(group, ["selfrepair", *more, "-o", str(tmp_path / "new")])
    assert done.exit_code != 0
    assert "round" in str(done.exception) or "give one" in done.output
    assert not (tmp_path / "new").exists()
