"""Write the page of instructions beside every test print: its picture, the home position, how to scan it."""

import shlex
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from printmend.files import replacing
from printmend.gcode.read import Program, straightened
from printmend.measure.plan import ProbePlan
from printmend.messages import ENGLISH, say, say_count, tell_in, together
from printmend.pdf import BLACK, BLUE, GREY, PALE, RED, PdfPage
from printmend.printer import Printer
from printmend.printer.printer import PAUSE
from printmend.probe.gcode import cost
from printmend.probe.layout import strokes_of
from printmend.probe.paper import Paper, first_touch_mm
from printmend.probe.pen import LAY_S
from printmend.probe.probe import gcode_of
from printmend.units import A4_MM

if TYPE_CHECKING:
    from printmend.measure.walls import Walls

LEFT_MM, TOP_MM = 20.0, 22.0  # margins; everything lies above 260 mm, so that letter paper shows it, too
BED_MM, GLASS_MM = 88.0, 62.0  # the longer side of the drawn bed, and of the drawn glass
PICTURES_MM = 42.0  # from the upper edge of the page to the pictures
STEPS_MM = 152.0  # from the upper edge of the page to the steps
CHORD_MM = 0.3  # how far an arc's chords may lie from it
WHITE, GREEN = (1.0, 1.0, 1.0), (0.1, 0.5, 0.2)
SHEET_COLOURS = (BLUE, RED, GREEN)
PLATE_COLOURS, PAPER_COLOURS = "colours-on-plate", "colours-on-paper"  # messages
Step = tuple[str, str]  # an instruction, and the command that does it (empty if there is none)


def leaflet_of(gcode: Path) -> Path:
    """Return the path of a test print's page, beside its G-code."""
    return gcode.with_name(f"{gcode.stem}-how-to.pdf")


def pen_and_paper(plan: ProbePlan) -> str:
    """Return words for the pen and paper that a drawing needs."""
    return say_count("pen-and-paper", len(plan.sheets))


def weight(grams: float) -> str:
    """Return a mass in grams with enough digits for a small test print."""
    return f"{grams:.{1 if grams >= 0.1 else 2}f} g"


def write_leaflet(
    gcode: Path, plan: ProbePlan, printer: Printer, named: str, *, papers: Sequence[Paper] = (),
    language: str = ENGLISH,
) -> Path:  # fmt: skip
    """Write the page of a probe for a printer that its owner calls ``named``; return its path.

    ``papers`` are the sheets to print on, none for the plate.
    """
    minutes, grams = cost(plan)
    several = len(plan.sheets) > 1
    used = pen_and_paper(plan) if plan.pen else say("grams-of-filament", weight(grams))
    files = ", ".join(one.name for one in gcode_of(gcode, plan))
    title = say("leaflet-pen" if plan.pen else "leaflet-paper" if papers else "leaflet-plate")
    if several:
        title = together(", ", [title, say_count("leaflet-sheets", len(plan.sheets))])
    elif plan.net:
        title = together(", ", [title, say("leaflet-net")])
    page = PdfPage(tell=tell_in(language))
    _title(page, title, say("leaflet-files", files, len(plan), f"{minutes:.0f}", used))
    net = [plan.waypoints_mm[first : last + 1] for first, last in strokes_of(plan)]
    lines = [*net, *(sheet.waypoints_mm[1:3] for sheet in plan.sheets if not plan.pen)]
    lines += [plan.waypoints_mm[plan.moving :]] if plan.moving else []
    bed = _bed(page, printer, lines, plan.marks_mm, papers, dot_mm=1.2 if not plan.net else plan.big_dot_mm)
    if plan.pen:
        for sheet in plan.sheets:
            _cross(page, bed(sheet.waypoints_mm[2]))
    if papers:
        _glass(page, say("glass-sheet"), _sheet_shape(papers[0]))
    elif plan.net:
        _glass(page, say("glass-net"), (np.ptp(net[0], axis=0), [stroke - net[0].min(axis=0) for stroke in net]))
    else:
        size = np.array([printer.x.length_mm, printer.y.length_mm])
        _glass(page, say("glass-plate"), (size, []))
    trace, seen = gcode.with_suffix(".csv").name, f"{gcode.stem}-seen.png"
    scans = " ".join(f"scan-{number}.png" for number in range(1, len(plan.sheets) + 1)) if several else "scan.png"
    measure = f"printmend measure {scans} --probe {gcode.with_suffix('.json').name} -o {trace} --overlay {seen}"
    scanning = [_scanned(plan, papers), say("step-scan-turns"), *([] if papers else [say("step-scan-parts")])]
    steps = [
        *_before(plan, papers, printer), *_comes(plan, files), (together(" ", scanning), ""),
        *_after(measure, trace, named),
    ]  # fmt: skip
    return _written(gcode, page, steps)


def _after(measure: str, trace: str, named: str) -> list[Step]:
    """Return the steps that use the scan."""
    return [
        (say("step-measure"), measure), (say("terminal-step-settle"), ""),
        (say("step-learn"), f"printmend learn {trace} --printer {shlex.quote(named)}"),
        (say("step-mend"), "printmend mend part.gcode -m printer.mend.json"),
    ]  # fmt: skip


def _comes(plan: ProbePlan, files: str) -> list[Step]:
    """Return the steps of printing, and what the printer produces; `_with_a_pen` has the steps for a pen."""
    told = [] if plan.pen else [say("step-as-it-is")]
    if len(plan.sheets) > 1:
        told.append(say("step-sheets", files))
    elif plan.net:
        told.append(say("step-net"))
    elif not plan.pen:
        told.append(say("step-dots"))
    if plan.moving:
        told.append(say("step-moving"))
    return [(together(" ", told), "")] if told else []


def _scanned(plan: ProbePlan, papers: Sequence[Paper]) -> str:
    if papers:
        return say_count("step-scan-sheets", len(papers))
    return say("step-scan-net" if plan.net else "step-scan-plate")


def write_layer_leaflet(
    gcode: Path, part: Program, printer: Printer | None, named: str | None, walls: "Walls | None", *,
    language: str = ENGLISH,
) -> Path:  # fmt: skip
    """Write the page of a part's first layer; return its path. Without a printer only the part is drawn.

    Lines that lie on none of the layer's ``walls`` (a skirt, a purge line) are drawn paler. ``walls`` is None if
    OpenCV, which finds them, is not installed.
    """
    moves = straightened(part.moves, CHORD_MM)
    drawn = np.flatnonzero(moves.extruding & (moves.layer >= 0) & moves.known[:, :2].all(axis=1))
    drawn = drawn[moves.layer[drawn] == moves.layer[drawn].min()]
    breaks = np.flatnonzero((moves.start_mm[drawn[1:], :2] != moves.end_mm[drawn[:-1], :2]).any(axis=1)) + 1
    strokes = [
        np.vstack([moves.start_mm[run[:1], :2], moves.end_mm[run, :2]]) for run in np.split(drawn, breaks)
    ]  # fmt: skip
    is_part = [walls is None or _on_part(stroke, walls) for stroke in strokes]
    own = [stroke for stroke, part_of in zip(strokes, is_part, strict=True) if part_of]
    others = [stroke for stroke, part_of in zip(strokes, is_part, strict=True) if not part_of]
    page = PdfPage(tell=tell_in(language))
    _title(page, say("leaflet-first-layer"), say("leaflet-made-from", gcode.name, Path(part.name).name))
    _bed(page, printer, own, np.empty((0, 2)), others_mm=others)
    every = np.vstack(own or strokes)
    low = every.min(axis=0)
    _glass(page, say("glass-layer"), (np.ptp(every, axis=0), [one - low for one in own]))
    trace, whose = gcode.with_suffix(".csv").name, named or "YOURS"
    told = [
        "step-layer-print",
        "step-layer-take-off",
        "terminal-step-layer-scan",
        *([] if named else ["terminal-step-yours"]),
    ]
    measure = f"printmend measure scan.png --gcode {gcode.name} --printer {shlex.quote(whose)} -o {trace}"
    return _written(gcode, page, [*((say(each), "") for each in told), *_after(measure, trace, whose)])


def _on_part(stroke_mm: np.ndarray, walls: "Walls") -> bool:
    """Return whether a stroke [N, 2] lies on the plastic of the part."""
    from printmend.measure.walls import RASTER_MM

    middle = (stroke_mm[1:] + stroke_mm[:-1]) / 2
    pixel = np.rint((middle - walls.corner_mm) / RASTER_MM).astype(int)
    pixel = np.clip(pixel, 0, np.array(walls.plastic.shape[::-1]) - 1)
    return bool(walls.plastic[pixel[:, 1], pixel[:, 0]].mean() > 0.5)


def _before(plan: ProbePlan, papers: Sequence[Paper], printer: Printer) -> list[Step]:
    """Return the steps before the print begins."""
    if plan.pen:
        return [(_taped(plan, papers), ""), *_with_a_pen(plan, papers, printer)]
    if papers:
        told = together(" ", [say("step-cold"), say("step-temperatures")])
        return [(_taped(plan, papers), ""), (told, ""), (say(PAPER_COLOURS), "")]
    return [(together(" ", [say("step-clean"), say("step-temperatures")]), ""), (say(PLATE_COLOURS), "")]


def _with_a_pen(plan: ProbePlan, papers: Sequence[Paper], printer: Printer) -> list[Step]:
    """Return the steps that mount the pen, lay the paper, and set the pen's height by the first dot."""
    stands = say("pen-waits") if printer.pause_gcode == PAUSE else say("pen-stays", LAY_S // 60)
    touches = [first_touch_mm(sheet, paper) for sheet, paper in zip(plan.sheets, papers, strict=True)]
    where = dict.fromkeys((f"{left:.0f}", f"{front:.0f}") for left, front in touches)
    at = together("; ", [say("pen-touches", *each) for each in where])
    put_in = say("step-pen-in", printer.pause_gcode, stands, at)
    return [
        (together(" ", [say("step-as-it-is"), put_in]), ""),
        (say("step-pen-height"), ""),
        (say("terminal-step-pen-far"), ""),
    ]


def _taped(plan: ProbePlan, papers: Sequence[Paper]) -> str:
    """Say where to tape a sheet, or each of several."""
    cold = "-cold" if plan.pen else ""
    if len(papers) == 1:
        return say(f"step-tape{cold}", papers[0].name, papers[0].place)
    places = [say("sheet-at", number, paper.place) for number, paper in enumerate(papers, start=1)]
    return say(f"step-tape-each{cold}", papers[0].name, together("; ", places))


def _title(page: PdfPage, title: str, below: str) -> None:
    page.words((LEFT_MM, TOP_MM), title, 18.0, font="bold")
    page.words((LEFT_MM, TOP_MM + 8.0), below, 10.5, colour=GREY)


def _bed(
    page: PdfPage, printer: Printer | None, strokes_mm: Sequence[np.ndarray], marks_mm: np.ndarray,
    papers: Sequence[Paper] = (), *, dot_mm: float = 1.2, others_mm: Sequence[np.ndarray] = (),
) -> Callable[[np.ndarray], np.ndarray]:  # fmt: skip
    """Draw the bed from above, with its front edge at the bottom: the strokes and marks, each taped sheet, and home.

    Return the map from a place [2] of the bed to the page.
    """
    if printer is None:
        every = np.vstack([*strokes_mm, *others_mm])
        low, high = every.min(axis=0) - 10.0, every.max(axis=0) + 10.0
    else:
        low = np.array([printer.x.min_mm, printer.y.min_mm])
        high = np.array([printer.x.max_mm, printer.y.max_mm])
    scale = BED_MM / (high - low).max()
    width, height = (high - low) * scale
    corner = np.array([LEFT_MM + 6.0, PICTURES_MM])

    def placed(points: np.ndarray) -> np.ndarray:
        return corner + np.stack([points[..., 0] - low[0], high[1] - points[..., 1]], axis=-1) * scale

    page.rectangle(corner, (width, height), PALE)
    for paper in papers:
        ends = placed(np.clip(np.array([paper.low_mm, paper.high_mm]), low, high))
        page.rectangle((ends[0, 0], ends[1, 1]), np.abs(ends[1] - ends[0]), WHITE)
    for strokes, colour in ((others_mm, GREY), (strokes_mm, BLACK)):
        for stroke in strokes:
            page.line(placed(stroke), colour, width_mm=0.45 * scale)
    page.dots(placed(marks_mm), max(dot_mm * scale, 0.4))
    labels = []
    for number, paper in enumerate(papers):
        ends = placed(np.clip(np.array([paper.low_mm, paper.high_mm]), low, high))
        inset, colour = 0.7 * number, SHEET_COLOURS[number]
        upper, size = np.array([ends[0, 0], ends[1, 1]]) + inset, np.abs(ends[1] - ends[0]) - 2 * inset
        page.frame(upper, size, colour, 0.6)
        labels.append((upper, size, colour))
    for number, (paper, (upper, size, colour)) in enumerate(zip(papers, labels, strict=True)):  # over all frames
        words = say("sheet", number + 1) if len(papers) > 1 else say("sheet-only")
        at = upper + size * (0.06 + 0.38 * number, 0.06)
        page.rectangle(at, (14.5, 4.6), WHITE)
        page.words((at[0] + 0.8, at[1] + 3.5), words, 9.0, colour=colour)
        if len(papers) == 1:
            at = np.array([upper[0] + 1.0, upper[1] + size[1] - 5.6])
            page.rectangle(at, (18.0, 4.6), WHITE)
            page.words(
                (at[0] + 0.8, at[1] + 3.5), f"X {paper.low_mm[0]:.0f}, Y {paper.low_mm[1]:.0f}", 9.0, colour=colour
            )
    front, x0 = PICTURES_MM + height, corner[0]
    _arrow(page, (x0, front + 4.0), (x0 + 25.0, front + 4.0))
    page.words((x0 + 27.0, front + 5.2), say("bed-front-edge"), 9.0, colour=BLUE)
    _arrow(page, (x0 - 4.0, front), (x0 - 4.0, front - 25.0))
    page.words((x0 - 5.2, front - 27.0), "Y", 9.0, colour=BLUE)
    words = say("bed-from-above" if printer is not None else "part-from-above")
    if printer is not None:
        home = placed(np.clip(np.array(printer.home_mm), low, high))
        page.dots(home[None], 3.0, RED)
        words = together(". ", [words, say("bed-home")])
    page.words((x0, front + 11.0), words, 9.0, colour=GREY)
    return placed


def _cross(page: PdfPage, at_mm: np.ndarray) -> None:
    """Draw a cross where a pen touches first."""
    page.rectangle(at_mm - 2.2, (4.4, 4.4), WHITE)
    for way in ([2.0, 2.0], [2.0, -2.0]):
        page.line(np.array([at_mm - way, at_mm + way]), GREEN, 0.8)


Shape = tuple[np.ndarray, Sequence[np.ndarray]]  # size [2] mm, and strokes [N, 2] mm from its left front corner


def _sheet_shape(paper: Paper) -> Shape:
    """Return a sheet as it lies on the glass, its long side along the glass' long side."""
    return np.sort(np.array(paper.size_mm)), []


def _glass(page: PdfPage, words: str, shape: Shape) -> None:
    """Draw a scanner's open A4 glass from above, with the ``shape`` on it to scale."""
    x, y = 128.0, PICTURES_MM
    (wide, high), strokes = shape
    scale = min(GLASS_MM / A4_MM[1], 68.0 / max(wide, high))
    size = np.array(A4_MM) * scale
    page.frame((x, y), size + 8.0, GREY, 0.8)
    page.rectangle((x + 4.0, y + 4.0), size, PALE)
    middle = np.array([x + 4.0, y + 4.0]) + size / 2
    low = middle - np.array([wide, high]) * scale / 2
    if strokes:
        for stroke in strokes:
            page.line(
                low + np.stack([stroke[:, 0], high - stroke[:, 1]], axis=1) * scale, width_mm=max(0.45 * scale, 0.1)
            )
    else:
        page.rectangle(low, np.array([wide, high]) * scale, WHITE)
        page.frame(low, np.array([wide, high]) * scale, BLUE, 0.4)
        page.words((middle[0] - 9.0, middle[1]), say("sheet-back"), 9.0, colour=BLUE)
        page.words((middle[0] - 9.0, middle[1] + 5.0), say("sheet-face-down"), 9.0, colour=BLUE)
    page.words((x, y + GLASS_MM + 14.0), say("glass-true-to-scale"), 9.0, colour=GREY)
    page.words((x, y + GLASS_MM + 18.5), words, 9.0, colour=GREY)


def _arrow(page: PdfPage, start_mm: Sequence[float], end_mm: Sequence[float]) -> None:
    a, b = np.array(start_mm), np.array(end_mm)
    along = (b - a) / np.hypot(*(b - a))
    side = np.array([-along[1], along[0]])
    page.line(np.array([a, b]), BLUE, 0.5)
    page.line(np.array([b - 2.5 * along + 1.3 * side, b, b - 2.5 * along - 1.3 * side]), BLUE, 0.5)


def _written(gcode: Path, page: PdfPage, steps: Sequence[Step]) -> Path:
    y = STEPS_MM
    for number, (words, command) in enumerate(steps, start=1):
        page.words((LEFT_MM, y), f"{number}.", 10.5, font="bold")
        y = page.paragraph((LEFT_MM + 8.0, y), words, 10.5, letters=92)
        if command:
            y = page.paragraph((LEFT_MM + 8.0, y), command, 9.0, letters=86, font="typed")
        y += 1.6
    path = leaflet_of(gcode)
    with replacing(path, "wb") as file:
        file.write(page.bytes())
    return path
