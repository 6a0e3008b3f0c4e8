"""The paper's own protocol as a demonstration: print one layer of a part, scan it, learn, print the part right."""

import contextlib
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize

from printmend.corruption import Corruption, Drive, EccentricBore, Ellipse, Play
from printmend.demo import contour
from printmend.draw import PrintedLayer, comparison, draw_alike, save
from printmend.draw.figure import INK, PALETTE, quiet
from printmend.errors import RefusedError
from printmend.files import replacing
from printmend.gcode.read import read_gcode
from printmend.learn.learned import learn_model
from printmend.measure.image import read_image, write_image
from printmend.measure.table import write_trace
from printmend.mend import mend_gcode
from printmend.mend.part import PartMeasurement, measure_part
from printmend.messages import Tell, say
from printmend.metrics.shape import ContourError, stroke_distances
from printmend.model import SavedModel, write_model
from printmend.printer import Printer
from printmend.twin import Twin
from printmend.twin.scanner import DEFAULT, render_layer

BEAD_MM, HEIGHT_MM, FILAMENT_MM = 0.45, 0.2, 1.75  # of a bead, and the filament's diameter
SIZE_MM, HOLE_MM, STEPS = 36.0, 9.0, 240  # of the cam: its mean radius, its hole's, straight moves in a ring
SWELL_MM = 0.12  # how much wider the scanned beads are than the file says
DAMAGE = Corruption(
    (Drive(pulley=EccentricBore(0.45, 0.4), belt=Play(0.5)), Drive(pulley=Ellipse(6.9, 5.95), belt=Play(0.35)))
)


@dataclass(frozen=True, eq=False)
class PartDemo:
    """What came of it: the measurement, the model, and the part's contour errors as it is and mended."""

    measured: PartMeasurement
    model: SavedModel
    before: ContourError
    after: ContourError
    shifts_mm: tuple[np.ndarray, np.ndarray]
    ideal: contour.Way
    mended: contour.Way
    reach_mm: tuple[np.ndarray, np.ndarray]


def cam_gcode(printer: Printer) -> bytes:
    """Return a cam in rings of beads, one layer, in the middle of the bed: curves everywhere, no symmetry."""
    middle = np.array(printer.middle_mm) - [0.0, 8.0]
    angle = np.linspace(0.0, 2 * np.pi, STEPS + 1)
    outer = SIZE_MM * (1 + 0.1 * np.cos(3 * angle + 0.5) + 0.14 * np.cos(angle) + 0.05 * np.sin(5 * angle))
    rings = round((float(outer.min()) - HOLE_MM) / BEAD_MM)
    lines = ["G21", "G90", "M83", "G28", f"G1 Z{HEIGHT_MM} F600", ";LAYER_CHANGE", ";TYPE:External perimeter"]
    area = HEIGHT_MM * (BEAD_MM - HEIGHT_MM * (1 - math.pi / 4))
    for ring in range(rings + 1):
        radius = outer + ring / rings * (HOLE_MM - outer)
        points = middle + radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        lines.append(f"G0 X{points[0, 0]:.3f} Y{points[0, 1]:.3f} F6000")
        filament = np.hypot(*np.diff(points, axis=0).T) * area / (math.pi * FILAMENT_MM**2 / 4)
        lines += [f"G1 X{x:.3f} Y{y:.3f} E{e:.5f} F1800" for (x, y), e in zip(points[1:], filament, strict=True)]
    return ("\n".join(lines) + "\n").encode()


def run_part(
    printer: Printer, folder: Path, *, seed: int, corruption: Corruption = DAMAGE, tell: Tell = str
) -> PartDemo:
    """Run the chain through files in ``folder``, as an owner would."""
    folder.mkdir(parents=True, exist_ok=True)
    twin, source, target = Twin.of(corruption, printer), folder / "part.gcode", folder / "part.mended.gcode"
    with replacing(source, "wb") as file:
        file.write(cam_gcode(printer))
    ideal = contour.run(read_gcode(source, printer=printer), twin)
    cuts = np.flatnonzero(np.diff(np.concatenate([[False], ideal.extruding, [False]]).astype(int)))
    strokes = [ideal.printed_mm[first : last + 1] for first, last in zip(cuts[::2], cuts[1::2], strict=True)]
    scan = render_layer(strokes, bead_mm=BEAD_MM + 2 * SWELL_MM, rng=np.random.default_rng(seed), degradations=DEFAULT)
    write_image(folder / "scan.png", scan, dpi=600.0)
    measured = measure_part(folder / "scan.png", source, printer, overlay=folder / "seen.png", tell=tell)
    write_trace(folder / "trace.csv", measured.trace)
    model = learn_model(measured.trace, printer, rng=np.random.default_rng(seed))
    write_model(folder / "printer.mend.json", model)
    target.unlink(missing_ok=True)
    with contextlib.suppress(RefusedError):
        mend_gcode(source, model, target)
    mended = contour.run(read_gcode(target, printer=printer), twin) if target.exists() else ideal
    (before, shift), (after, shift_after) = (contour.contour_error(ideal, one) for one in (ideal, mended))
    walls = measured.trace.commanded_mm[measured.trace.wall_rows]
    return PartDemo(
        measured, model, before, after, (shift, shift_after), ideal, mended, (walls.min(axis=0), walls.max(axis=0))
    )


def lines(done: PartDemo) -> list[str]:
    """Say what came of it."""
    return [
        say("demo-walls", done.measured.found),
        say("demo-learned", done.model.findings[0]),
        say("demo-part", f"{done.before.rms:.3f}", f"{done.after.rms:.3f}"),
    ]


def write_figure(done: PartDemo, folder: Path, tell: Tell = str) -> Path:
    """Draw scan, learned fault, and the part as it is and mended."""
    shown, _ = read_image(folder / "seen.png")
    drawn = []
    layer = done.ideal.layers[len(done.ideal.layers) // 2]
    strokes = done.ideal.strokes_mm(layer)
    for way, shift in zip((done.ideal, done.mended), done.shifts_mm, strict=True):
        at = np.flatnonzero((way.layer == layer) & way.extruding)
        rows = slice(int(at[0]), int(at[-1]) + 2)
        error = stroke_distances(strokes, way.printed_mm[rows] + shift)[0]
        drawn.append(PrintedLayer(0.0, way.printed_mm[rows] + shift, way.extruding[rows.start : rows.stop - 1], error))
    colours = Normalize(0, max(float(np.percentile(drawn[0].error_mm[1:][drawn[0].extruding], 98)), 0.05))

    def scan(axes: Axes) -> Axes:
        axes.imshow(shown[:, :, ::-1])
        axes.axis("off")
        return axes

    def fault(axes: Axes) -> Axes:
        for motor, name in enumerate(("X", "Y")):
            table = done.model.mechanism.transmissions[motor]
            at = np.linspace(done.reach_mm[0][motor], done.reach_mm[1][motor], 400)
            low, high = table.branches_mm(at)
            centre = float(np.mean(low - at + high - at) / 2)
            for branch, style in ((low, "-"), (high, "--")):
                axes.plot(at, branch - at - centre, style, color=PALETTE[motor], linewidth=1.6)
            axes.plot([], [], color=PALETTE[motor], label=name)
        axes.plot([], [], "-", color=INK, label=tell(say("moving-forwards")))
        axes.plot([], [], "--", color=INK, label=tell(say("moving-backwards")))
        axes.set_xlabel(tell(say("demo-position")), fontsize=9)
        axes.set_ylabel(tell(say("draw-printed-commanded")), fontsize=9)
        low_mm, high_mm = axes.get_ylim()
        axes.set_ylim(low_mm - 0.25 * (high_mm - low_mm), high_mm)  # room for the legend
        axes.legend(loc="lower center", fontsize=8, frameon=False, ncols=2)
        quiet(axes, tell)
        box = axes.get_position()
        axes.set_position((box.x0 + 0.035, box.y0 + 0.07, box.width - 0.05, box.height - 0.07))
        return axes

    titles = [
        say("demo-first-layer"), say("demo-fault"), say("demo-third", f"{done.before.rms:.2f}"),
        say("demo-fourth", f"{done.after.rms:.3f}"),
    ]  # fmt: skip
    figure = comparison(
        titles,
        [scan, fault, *draw_alike(drawn, colours=colours)],
        title=say("demo-part-title"), colours=colours, first=2, tell=tell,
    )  # fmt: skip
    return save(figure, folder / "first-layer.png")
