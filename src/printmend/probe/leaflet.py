"""One page in an owner's words beside every test print: what comes out, where home is, how to lay it on the scanner."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from printmend.files import replacing
from printmend.gcode.arcs import straightened
from printmend.gcode.read import Program
from printmend.measure.plan import ProbePlan
from printmend.pdf import BLUE, GREY, PALE, RED, Page
from printmend.printer import Printer
from printmend.probe.gcode import cost, covered_mm
from printmend.probe.net import strokes_of
from printmend.probe.probe import gcode_of

LEFT_MM, TOP_MM = 20.0, 22.0  # of the page; all above 260 mm, so that letter paper shows it, too
BED_MM, GLASS_MM = 88.0, 62.0  # the longer side of the drawn bed, and of the drawn glass
PICTURES_MM = 42.0  # from the upper edge of the page to the pictures
STEPS_MM = 152.0
CHORD_MM = 0.3
WHITE, GREEN = (1.0, 1.0, 1.0), (0.1, 0.5, 0.2)
SHEET_COLOURS = (BLUE, RED, GREEN)
PLATE_COLOURS = (
    "Colours: the dots must stand out from the plate. Dark filament (black, blue, red, green) on a light or golden "
    "plate; white, yellow or grey on a black one. Clear and silk filament glitter: take another."
)
PAPER_COLOURS = "Colours: white paper, and any filament that is neither white nor clear. Black is best."


def leaflet_of(gcode: Path) -> Path:
    """Return where the page of a test print lies: beside it."""
    return gcode.with_name(f"{gcode.stem}-how-to.pdf")


def pen_and_paper(plan: ProbePlan) -> str:
    """Say what a drawing uses."""
    return "a pen and " + ("a sheet of paper" if len(plan.sheets) == 1 else f"{len(plan.sheets)} sheets of paper")


def write_leaflet(gcode: Path, plan: ProbePlan, printer: Printer, named: str, *, on_paper: bool) -> Path:
    """Write the page of a probe for a printer that its owner calls ``named``; return its path."""
    minutes, grams = cost(plan)
    sheet = plan.pen or on_paper
    kind = "with a pen on paper" if plan.pen else "on paper" if on_paper else "on the plate"
    several = len(plan.sheets) > 1
    used = pen_and_paper(plan) if plan.pen else f"{grams:.1f} g of filament"
    files = ", ".join(one.name for one in gcode_of(gcode, plan))
    kind += f", {len(plan.sheets)} sheets" if several else ", joined by a net" if plan.net else ""
    page = Page()
    _title(page, f"Your test print, {kind}", f"{files}: {len(plan)} dots, about {minutes:.0f} min, {used}")
    frames = [covered_mm(one) for one in plan.sheets] if several else []
    strokes = [plan.waypoints_mm[first : last + 1] for first, last in strokes_of(plan)]
    _bed(page, printer, strokes, plan.marks_mm, frames, dot_mm=1.2 if not plan.net else plan.big_dot_mm)
    _glass(page, "The sheet, printed side down" if sheet else "The plate, dots down")
    trace, seen = gcode.with_suffix(".csv").name, f"{gcode.stem}-seen.png"
    scan = "Scan the sheet" if sheet else "Scan the plate, dots down, with the lid or dark paper behind it,"
    if several:
        scan = "Scan each sheet"
    line = "." if plan.pen else ", and a line along the front edge at the start."
    joined = (
        "A plate or a pattern larger than the glass: scan it in two or three parts that overlap by a third, and name "
        "all of them."
    )
    scans = " ".join(f"scan-{number}.png" for number in range(1, len(plan.sheets) + 1)) if several else "scan.png"
    comes = f"What comes out is one layer of dots{line}"
    if several:
        comes = (
            f"Print {files}, each onto a sheet of its own, and number the sheets. Where they overlap the same dots "
            "come again: by them the sheets are joined."
        )
    elif plan.net:
        comes += " A thin net joins the dots: when the plate is cold, lift the frame, and all comes off as one sheet."
    steps = [
        *_before(plan, on_paper),
        f"Print the file as it is: do not slice, scale or turn it. {comes}",
        f"{scan} at 600 dpi, as PNG or as JPEG of the best quality. Any turn is read. A second scan, turned by a "
        f"quarter, takes the scanner's own error off: name both. {'' if sheet else joined}",
        f"Measure:  printmend measure {scans} --probe {gcode.with_suffix('.json').name} -o {trace} --overlay {seen}",
        f"Learn:  printmend learn {trace} --printer {named}",
        "Mend:  printmend mend part.gcode -m printer.mend.json",
    ]
    return _written(gcode, page, steps)


def write_layer_leaflet(gcode: Path, part: Program, printer: Printer | None, named: str) -> Path:
    """Write the page of a part's first layer; return its path. Without a printer only the part is drawn."""
    moves = straightened(part.moves, CHORD_MM)
    drawn = np.flatnonzero(moves.extruding & (moves.layer >= 0) & moves.known[:, :2].all(axis=1))
    drawn = drawn[moves.layer[drawn] == moves.layer[drawn].min()]
    breaks = np.flatnonzero((moves.start_mm[drawn[1:], :2] != moves.end_mm[drawn[:-1], :2]).any(axis=1)) + 1
    strokes = [
        np.vstack([moves.start_mm[run[:1], :2], moves.end_mm[run, :2]]) for run in np.split(drawn, breaks)
    ]  # fmt: skip
    page = Page()
    _title(page, "Your test print, the first layer of a part", f"{gcode.name}: made from {Path(part.name).name}")
    _bed(page, printer, strokes, np.empty((0, 2)))
    _glass(page, "The layer, the side that lay on the bed down")
    trace = gcode.with_suffix(".csv").name
    steps = [
        "Print the file as it is: do not slice, scale or turn it. One layer of the part comes out; the heaters go off "
        "by themselves.",
        "Take it off when it is cold, as flat as you can. Leave a brim or skirt on the plate.",
        "Scan the side that lay on the bed at 600 dpi, with paper of another colour behind it and a free margin all "
        "around. The front edge of a part that looks the same from several sides goes to the lower edge of the glass. "
        "No scanner? Lay it on the sheet of tags (printmend probe --sheet sheet.pdf), that side up, and take a photo "
        "from above.",
        f"Measure:  printmend measure scan.png --gcode {gcode.name} --printer {named} -o {trace}",
        f"Learn:  printmend learn {trace} --printer {named}",
        "Mend:  printmend mend part.gcode -m printer.mend.json",
    ]
    return _written(gcode, page, steps)


def _before(plan: ProbePlan, on_paper: bool) -> list[str]:
    """Return what must be done before the print begins."""
    if plan.pen:
        return [
            _taped(plan, "cold bed"),
            "The file pauses twice: put a felt pen of 0.8 mm into its clip, loosely, tip up; then lower it until it "
            "touches the paper, and fasten it. How far it sits from the nozzle does not matter.",
        ]
    heat = "Change the temperatures at the top of the file for another material than PLA."
    if on_paper:
        return [
            _taped(plan, "bed"),
            heat,
            PAPER_COLOURS,
        ]
    return [f"Clean the bed. {heat}", PLATE_COLOURS]


def _taped(plan: ProbePlan, bed: str) -> str:
    """Say where a sheet, or each of several, is taped."""
    if len(plan.sheets) == 1:
        return f"Tape a sheet of paper flat onto the middle of the {bed}, its edges outside the dots."
    said = []
    for number, one in enumerate(plan.sheets, start=1):
        (x0, y0), (x1, y1) = covered_mm(one)
        said.append(f"sheet {number} over X {x0:.0f} to {x1:.0f}, Y {y0:.0f} to {y1:.0f}")
    return (
        f"One sheet at a time: tape it flat onto the {bed}, print its file, take it off. The picture shows where each "
        f"goes: {'; '.join(said)} (mm)."
    )


def _title(page: Page, title: str, below: str) -> None:
    page.words((LEFT_MM, TOP_MM), title, 18.0, font="bold")
    page.words((LEFT_MM, TOP_MM + 8.0), below, 10.5, colour=GREY)


def _bed(
    page: Page, printer: Printer | None, strokes_mm: Sequence[np.ndarray], marks_mm: np.ndarray,
    frames_mm: Sequence[tuple[np.ndarray, np.ndarray]] = (), *, dot_mm: float = 1.2,
) -> None:  # fmt: skip
    """Draw the bed from above, its front edge below, what is printed on it, where each sheet is taped, and home."""
    if printer is None:
        every = np.vstack(strokes_mm)
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
    for stroke in strokes_mm:
        page.line(placed(stroke), width_mm=0.45 * scale)
    page.dots(placed(marks_mm), max(dot_mm * scale, 0.4))
    for number, (sheet_low, sheet_high) in enumerate(frames_mm):
        ends = placed(np.clip(np.array([sheet_low, sheet_high]), low, high))
        inset, colour = 0.7 * number, SHEET_COLOURS[number]
        upper, size = np.array([ends[0, 0], ends[1, 1]]) + inset, np.abs(ends[1] - ends[0]) - 2 * inset
        page.frame(upper, size, colour, 0.6)
        page.rectangle(upper + size * (0.06 + 0.38 * number, 0.06), (12.5, 4.6), WHITE)
        page.words(upper + size * (0.06 + 0.38 * number, 0.06) + (0.8, 3.5), f"sheet {number + 1}", 9.0, colour=colour)
    front, x0 = PICTURES_MM + height, corner[0]
    _arrow(page, (x0, front + 4.0), (x0 + 25.0, front + 4.0))
    page.words((x0 + 27.0, front + 5.2), "X: the front edge", 9.0, colour=BLUE)
    _arrow(page, (x0 - 4.0, front), (x0 - 4.0, front - 25.0))
    page.words((x0 - 5.2, front - 27.0), "Y", 9.0, colour=BLUE)
    words = "The bed from above"
    if printer is not None:
        home = placed(np.clip(np.array(printer.home_mm), low, high))
        page.dots(home[None], 3.0, RED)
        words += ". Red: home, where the nozzle goes first"
    page.words((x0, front + 11.0), words, 9.0, colour=GREY)


def _glass(page: Page, words: str) -> None:
    """Draw a scanner's open glass with a sheet on it, its print down."""
    x, y = 128.0, PICTURES_MM
    size = np.array([GLASS_MM * 210 / 297, GLASS_MM])
    page.frame((x, y), size + 8.0, GREY, 0.8)
    page.rectangle((x + 4.0, y + 4.0), size, PALE)
    print_low, print_size = np.array([x + 9.0, y + 12.0]), np.array([size[0] - 10.0, size[0] - 10.0])
    page.frame(print_low, print_size, BLUE, 0.4)
    page.words((print_low[0] + 3.0, print_low[1] + 15.0), "face down,", 9.0, colour=BLUE)
    page.words((print_low[0] + 3.0, print_low[1] + 20.0), "free margin", 9.0, colour=BLUE)
    page.words((x, y + GLASS_MM + 14.0), "On the scanner's glass:", 9.0, colour=GREY)
    page.words((x, y + GLASS_MM + 18.5), words, 9.0, colour=GREY)


def _arrow(page: Page, start_mm: Sequence[float], end_mm: Sequence[float]) -> None:
    a, b = np.array(start_mm), np.array(end_mm)
    along = (b - a) / np.hypot(*(b - a))
    side = np.array([-along[1], along[0]])
    page.line(np.array([a, b]), BLUE, 0.5)
    page.line(np.array([b - 2.5 * along + 1.3 * side, b, b - 2.5 * along - 1.3 * side]), BLUE, 0.5)


def _written(gcode: Path, page: Page, steps: Sequence[str]) -> Path:
    y = STEPS_MM
    for number, step in enumerate(steps, start=1):
        words, _, command = step.partition(":  ")
        page.words((LEFT_MM, y), f"{number}.", 10.5, font="bold")
        y = page.paragraph((LEFT_MM + 8.0, y), words + (":" if command else ""), 10.5, letters=92)
        if command:
            y = page.paragraph((LEFT_MM + 8.0, y), command, 9.0, letters=86, font="typed")
        y += 1.6
    path = leaflet_of(gcode)
    with replacing(path, "wb") as file:
        file.write(page.bytes())
    return path
