"""The owner's way as a demonstration: probe → broken twin → measure → learn → mend → the twin again.

The measurement is two scans of the plate or, without the extra `scan`, noisy positions of the dots.
"""

import contextlib
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from printmend.corruption import Corruption, corruption_toml
from printmend.demo import contour
from printmend.demo.contour import demo_body_gcode
from printmend.errors import RefusedError
from printmend.files import replacing
from printmend.gcode.read import read_gcode
from printmend.learn.learned import learn_model
from printmend.measure.plan import ProbePlan
from printmend.measure.table import write_trace
from printmend.mend import mend_gcode
from printmend.messages import Tell, say
from printmend.metrics.pointwise import aligned_rmse
from printmend.metrics.shape import ContourError, stroke_distances
from printmend.model import SavedModel, write_model
from printmend.path import Trace
from printmend.printer import Printer
from printmend.probe import design_probe, write_probe
from printmend.twin import Twin
from printmend.twin.gcode import print_gcode

if TYPE_CHECKING:
    from printmend.measure.measurement import Measurement

SCANS = {"scan.png": 0, "turned.png": 1}  # quarter turns of the plate on the glass
TICKS, TICKS_TYPED = 9, 7  # steps of the progress that it reports, with scans and without
TYPED_MM = 0.05  # noise of dots that nobody scanned


@dataclass(frozen=True, eq=False)
class ScanDemo:
    """The result: how well the marks were read, what was learned, and the part's contour error on the twin.

    ``mark_mm`` is the RMS distance of the measured marks from where the twin put them, the plate's own place and turn
    taken off, and the scanner's scale, which is ``scale_percent`` wrong.

    ``before`` and ``after`` are the part's contour errors, its place on the bed taken off (``shift_mm`` [2]
    after mending): a scan does not show where on the bed the plate lay.
    """

    corruption: Corruption
    scans: int
    marks: int
    missing: int
    mark_mm: float
    scale_percent: float
    notes: tuple[str, ...]
    model: SavedModel
    before: ContourError
    after: ContourError
    shift_before_mm: np.ndarray
    shift_mm: np.ndarray
    refused: bool
    ideal: contour.Way
    mended: contour.Way


# Long because it is the chain itself: each step is one call, told before it begins.
def run_chain(
    printer: Printer,
    corruption: Corruption,
    folder: Path,
    *,
    seed: int,
    scanned: bool = True,
    dirt: str = "default",
    part: bytes | None = None,
    overlay: bool = True,
    tick: Callable[[str], None] = lambda what: None,
) -> ScanDemo:
    """Run the whole chain through files in ``folder``, as an owner would; ``part`` is G-code that nobody learns from.

    The plate is scanned twice, the second time turned by a quarter, so that the scanner's own axes drop out.
    """
    folder.mkdir(parents=True, exist_ok=True)
    twin, plan = Twin.of(corruption, printer), design_probe(printer)
    write_probe(folder / "probe.gcode", plan)
    printed = twin.follow(plan.waypoints_mm)
    tick(say("demo-tick-printed"))
    scale, mark_mm, missing = 1.0, TYPED_MM * math.sqrt(2), 0
    notes: tuple[str, ...] = ()
    if scanned:
        measurement = _measured(Trace(plan.waypoints_mm, printed), plan, folder, seed, dirt, overlay, tick)
        trace, missing, notes = measurement.trace, len(measurement.missing), measurement.notes
        found = np.isfinite(measurement.measured_mm).all(axis=1)
        scale, mark_mm = _mark_errors(printed[plan.rows][found], measurement.measured_mm[found])
    else:
        trace = print_gcode(folder / "probe.gcode", twin, noise_mm=TYPED_MM, rng=np.random.default_rng(seed))
    write_trace(folder / "trace.csv", trace)
    tick(say("demo-tick-measured"))
    model = learn_model(trace, printer, rng=np.random.default_rng(seed))
    write_model(folder / "printer.mend.json", model)
    tick(say("demo-tick-fault"))
    source, target = folder / "part.gcode", folder / "part.mended.gcode"
    text = demo_body_gcode() if part is None else part
    with replacing(source, "wb") as file:
        file.write(text)
    target.unlink(missing_ok=True)
    with contextlib.suppress(RefusedError):  # a machine that is right already: the file is printed as it is
        mend_gcode(source, model, target)
    refused = not target.exists()
    tick(say("demo-tick-part"))
    ideal = contour.run(read_gcode(source, printer=printer), twin)
    mended = ideal if refused else contour.run(read_gcode(target, printer=printer), twin)
    tick(say("demo-tick-both"))
    (before, shift_before_mm), (after, shift_mm) = (
        contour.contour_error(ideal, ideal),
        contour.contour_error(ideal, mended),
    )
    with replacing(folder / "corruption.toml") as toml:
        toml.write(corruption_toml(corruption))
    tick(say("demo-tick-judged"))
    return ScanDemo(
        corruption, len(SCANS) if scanned else 0, len(plan), missing, mark_mm, 100 * (scale - 1), notes, model,
        before, after, shift_before_mm, shift_mm, refused, ideal, mended,
    )  # fmt: skip


def _measured(
    printed: Trace, plan: ProbePlan, folder: Path, seed: int, dirt: str, overlay: bool, tick: Callable[[str], None]
) -> "Measurement":
    """Scan the plate into ``folder`` and read the scans. What reads images is imported here: the rest needs none."""
    from printmend.measure.image import write_image
    from printmend.measure.measurement import measure_scans
    from printmend.twin.scanner import DEGRADATIONS, scan_trace

    for name, quarters in SCANS.items():
        # equal generators: the same dots on the same scanner
        scan = scan_trace(
            printed, plan, dpi=600.0, degradations=DEGRADATIONS[dirt], rng=np.random.default_rng(seed),
            quarter_turns=quarters,
        )  # fmt: skip
        write_image(folder / name, scan.image, dpi=600.0)
        tick(name)
    return measure_scans([folder / name for name in SCANS], plan, overlay=folder / "overlay.png" if overlay else None)


def _mark_errors(printed_mm: np.ndarray, measured_mm: np.ndarray) -> tuple[float, float]:
    """Return the scale of measured marks [M, 2] against the printed ones, and their RMS distance without it [mm]."""
    middle = measured_mm.mean(axis=0)
    scale = float(np.linalg.norm(measured_mm - middle) / np.linalg.norm(printed_mm - printed_mm.mean(axis=0)))
    return scale, aligned_rmse(printed_mm, middle + (measured_mm - middle) / scale)


def figures(done: ScanDemo) -> dict[str, Any]:
    """Return the figures as plain values."""
    return {
        "marks": done.marks, "missing": done.missing, "mark_mm": done.mark_mm, "scale_percent": done.scale_percent,
        "findings": done.model.findings,
        "before": asdict(done.before), "after": asdict(done.after), "shift_mm": done.shift_mm.tolist(),
        "refused": done.refused,
    }  # fmt: skip


def lines(done: ScanDemo, written: list[Path]) -> list[str]:
    """Say what came of it."""
    measured = say("demo-measured", done.marks, f"{TYPED_MM:g}")
    if done.scans:
        found, um = done.marks - done.missing, f"{1000 * done.mark_mm:.0f}"
        measured = say("demo-scanned", found, done.marks, um, f"{done.scale_percent:+.2f}")
    shifts = (f"{np.hypot(*shift):.2f}" for shift in (done.shift_before_mm, done.shift_mm))
    rows: list[str] = [
        measured, say("demo-learned", done.model.findings[0]), say("demo-other-part", *shifts), say("demo-columns"),
    ]  # fmt: skip
    for name, error in (("as-it-is", done.before), ("mended", done.after)):
        rows.append(say(f"demo-{name}", f"{error.rms:5.3f}  {error.p95:11.3f}  {error.max:7.3f}"))
    if done.refused:
        rows.append(say("demo-healthy"))
    return [*rows, *(say("written", path) for path in written)]


def written(folder: Path) -> list[Path]:
    """Return what the chain left in its folder."""
    names = ("probe.gcode", *SCANS, "overlay.png", "trace.csv", "printer.mend.json", "part.gcode", "part.mended.gcode")
    return [folder / name for name in names if (folder / name).exists()]


def write_picture(done: ScanDemo, folder: Path, tell: Tell = str) -> Path:
    """Draw the part's layer before and after; return the picture's path."""
    from matplotlib.colors import Normalize

    from printmend.draw import PrintedLayer, comparison, draw_alike, save

    layer = done.ideal.layers[len(done.ideal.layers) // 2]
    strokes = done.ideal.strokes_mm(layer)
    pictures = []
    wanted = replace(done.ideal, printed_mm=done.ideal.wanted_mm)
    for way, shift in ((wanted, 0.0), (done.ideal, done.shift_before_mm), (done.mended, done.shift_mm)):
        at = np.flatnonzero(way.layer == layer)
        rows = slice(at[0], at[-1] + 2)
        error = stroke_distances(strokes, way.printed_mm[rows] + shift)[0]
        pictures.append(
            PrintedLayer(0.0, way.printed_mm[rows] + shift, way.extruding[rows.start : rows.stop - 1], error)
        )
    worst = pictures[1].error_mm[1:][pictures[1].extruding]
    colours = Normalize(0, max(float(np.percentile(worst, 98)), 0.05))
    titles = [
        say("demo-wanted"), say("demo-title-as-it-is", f"{done.before.rms:.2f}"),
        say("demo-title-mended", f"{done.after.rms:.3f}"),
    ]  # fmt: skip
    drawn = draw_alike(pictures, colours=colours)
    figure = comparison(titles, drawn, title=say("demo-title"), colours=colours, tell=tell)
    return save(figure, folder / "before-after.png")
