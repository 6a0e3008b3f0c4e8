"""From G-code to layers: what is in a layer, where it lies, and what is refused."""

from pathlib import Path

import numpy as np
import pytest

from printmend.errors import GcodeError
from printmend.gcode.read import read_gcode
from printmend.printer import Printer
from printmend_lab.body import MIN_POINTS, body_of, demo_body_gcode, load_body
from printmend_lab.body.layers import layers_of, strokes_of, to_steps
from printmend_lab.path import Body
from tests.naive_body import distance_to_segment

SQUARES = b"""G90
M83
G28
G1 X5 Y5 F3000
G1 Z0.2
G1 X100 Y100
G1 X140 Y100 E1
G1 X140 Y140 E1
G1 E-2
G1 Z0.6
G1 X100 Y140
G1 Z0.2
G1 E2
G1 X100 Y100 E1
G1 X0 Y0
G1 Z0.4
G1 X110.1 Y110.1
G1 X120.1 Y110.1 E1
G1 X120.1 Y120.1 E1
G1 X220 Y220
"""


def body(text: bytes, printer: Printer) -> Body:
    return Body("test", layers_of(strokes_of(read_gcode(text, printer=printer)), printer))


def test_a_layer_runs_from_its_first_extrusion_to_its_last(ender5: Printer) -> None:
    first, second = body(SQUARES, ender5).layers
    assert first.start_steps.tolist() == [500, 500]
    assert first.nominal_steps[-1].tolist() == [500, 500]
    assert first.transitions == 800, "the travel between the sides is in it, the one to the corner is not"
    assert first.extruding.tolist() == [True] * 400 + [False] * 200 + [True] * 200
    assert (first.z_mm, second.z_mm) == (0.2, 0.4)
    assert second.transitions == 99, "between four nodes the last way-point adds none"
    assert second.extruding.all()


def test_layers_keep_to_the_lattice_law_on_a_real_body(ender5: Printer) -> None:
    """Every node of the shipped body lies within half a step of the sliced path of its layer."""
    strokes = strokes_of(read_gcode(demo_body_gcode(), printer=ender5))
    for stroke in strokes[::9]:
        (layer,) = layers_of((stroke,), ender5)
        assert np.abs(layer.controls).max(axis=1).min() == 1
        points = to_steps(stroke.points_mm, ender5)
        nodes = layer.nominal_steps
        assert np.linalg.norm(nodes[0] - points[0]) <= 1
        assert np.linalg.norm(nodes[-1] - points[-1]) <= 1
        k = 0
        for node in nodes[::7]:
            while distance_to_segment(node, points[k], points[k + 1]) > 0.5 + 1e-3:
                k += 1  # runs off the end, and fails, where no later segment is near
    assert len(strokes) == 37


def test_demo_body_covers_a_whole_turn_of_both_pulleys(ender5: Printer) -> None:
    demo = body_of(demo_body_gcode(), ender5, name="timing_pulley")
    turn_steps = round(ender5.x.mm_per_turn / ender5.x.mm_per_step)
    assert (np.ptp(demo.training_layer.nominal_steps, axis=0) >= turn_steps).all()
    # So does a layer without the skirt, to within the bore of the teeth.
    assert (np.ptp(demo.layers[20].nominal_steps, axis=0) >= 0.9 * turn_steps).all()
    assert len(demo.layers) == 37
    assert demo.transitions > 100_000


def test_the_shipped_body_stays_small() -> None:
    assert len(demo_body_gcode()) < 1_500_000


def test_arcs_are_followed(ender5: Printer) -> None:
    circle = b"G90\nM83\nG1 X130 Y110 Z0.2\nG3 X130 Y110 I-20 J0 E5\n"
    (layer,) = body(circle, ender5).layers
    radius = np.linalg.norm(layer.nominal_steps - [550, 550], axis=1)
    assert np.abs(radius - 100).max() <= 0.5 + 0.02
    assert layer.transitions == pytest.approx(8 * 100 / np.sqrt(2), rel=0.01), "8-connected: 4√2·r nodes a turn"


def test_a_program_that_never_extrudes_is_one_layer(ender5: Printer) -> None:
    (layer,) = body(b"G90\nG0 X10 Y10\nG1 X30 Y10 Z-1\nG1 X30 Y40 Z-2\n", ender5).layers
    assert layer.transitions == 50 + 100 + 150
    assert layer.extruding.all()


def test_a_jump_is_a_travel(ender5: Printer) -> None:
    text = b"G90\nM83\nG28\nG1 X100 Y100 Z0.2\nG1 X110 Y100 E1\nG28 X\nG1 X200 Y100 E1\n"
    (layer,) = body(text, ender5).layers
    assert layer.extruding.tolist() == [True] * 50 + [False] * 550 + [True] * 100


def shifted(by_mm: float, size_mm: float = 60.0) -> bytes:
    corners = [(0, 0), (1, 0), (1, 1), (0, 1), (0, 0)]
    lines = [f"G1 X{x * size_mm + by_mm:.3f} Y{y * size_mm + by_mm:.3f} E1" for x, y in corners]
    return ("G90\nM83\n" + lines[0].replace(" E1", " Z.2") + "\n" + "\n".join(lines[1:])).encode()


def test_a_file_off_the_bed_is_moved_by_whole_steps_and_says_so(ender5: Printer) -> None:
    notes: list[str] = []
    placed = body_of(shifted(-30.05), ender5, name="delta", note=notes.append)
    nodes = placed.layers[0].nominal_steps
    assert nodes.min() == 400
    assert nodes.max() == 700
    assert notes == ["moved by +110, +110 mm onto the bed: the file spans [-30.0, -30.0] to [30.0, 30.0] mm"]


def test_a_file_on_the_bed_stays(printer: Printer) -> None:
    notes: list[str] = []
    placed = body_of(shifted(20), printer, name="on", note=notes.append)
    step = printer.x.mm_per_step
    assert placed.layers[0].start_steps.tolist() == [round((20 - printer.x.min_mm) / step)] * 2
    assert notes == []


def test_a_file_larger_than_the_bed_is_refused(ender5: Printer) -> None:
    with pytest.raises(GcodeError, match=r"220 × 220 mm.*found 230\.0 × 230\.0 mm"):
        body_of(shifted(0, 230), ender5, name="big")


def test_less_than_a_thousand_points_are_refused(ender5: Printer) -> None:
    with pytest.raises(GcodeError, match=f"at least {MIN_POINTS} points.*found 160"):
        body_of(shifted(50, 8), ender5, name="small")


@pytest.mark.parametrize("text", [b"G28\nG1 Z5\nG1 E3\n", b"M104 S200\n", b""])
def test_no_motion_is_refused(ender5: Printer, text: bytes) -> None:
    with pytest.raises(GcodeError, match="motion"):
        body_of(text, ender5, name="still")


def test_every_gcode_file_of_the_corpus_with_motion_becomes_layers(corpus: Path, ender5: Printer) -> None:
    """Layers and controls need no bed; a body on an Ender-5 does."""
    unreadable = {"vars_present.gcode": "motion", "test_bad_crc_gcode.bgcode": "wrong CRC"}
    paths = sorted((corpus / "gcode").glob("*/*"))
    moving = 0
    for path in paths:
        if path.name in unreadable:
            with pytest.raises(GcodeError, match=unreadable[path.name]):
                read_gcode(path)
            continue
        try:
            body = load_body(path, ender5)
            layers = body.layers
            assert body.transitions >= MIN_POINTS
        except GcodeError:  # too small or too large for a body: one line each in docs/corpus.md
            layers = layers_of(strokes_of(read_gcode(path)), ender5)
        assert all(np.abs(layer.controls).max(axis=1).min() == 1 for layer in layers)
        moving += bool(layers)
    assert moving == len(paths) - len(unreadable)


def test_endless_arcs_are_refused(ender5: Printer) -> None:
    circles = b"G90\nM83\nG1 X100 Y100 Z0.2 E1\n" + 450 * b"G2 X100 Y100 I1000000 J0 E1\n"
    with pytest.raises(GcodeError, match="chords"):
        body_of(circles, ender5, name="endless")
