"""The paper's figures and its Table I, made anew from a data set: SVG for print, Markdown and LaTeX for the table."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from scipy.optimize import minimize

from printmend.corruption import read_corruption
from printmend.draw import comparison, draw_above, new_figure
from printmend.draw.body import above_view
from printmend.draw.document import svg
from printmend.draw.figure import INK, PALETTE, fit_view, plain
from printmend.files import replacing
from printmend.metrics import rmse
from printmend.printer import Printer, read_printer
from printmend.twin import Twin
from printmend_lab.bench.case import Case, Result, row
from printmend_lab.bench.report import markdown_table
from printmend_lab.bench.table1 import HEADER, Part, cells, figure6, parts
from printmend_lab.dataset.bodies import thinned
from printmend_lab.dataset.parquet import body_file, corruption_file, read_body
from printmend_lab.draw import draw_solid, printed_layer, project, solid_view
from printmend_lab.published import layer_trace
from printmend_lab.shape import symmetric_difference_area

SHOWN_LAYERS = 60  # of a body: more cannot be told apart on paper
OURS = "greybox+optimal"
DPI = 200  # of what would be too many lines for a vector graphic
# The paper's Table I, in full steps over 1000 bodies, to be set beside ours.
PAPER_STEPS = {"naive": 27.6, "lightgbm": 11.9, "lightgbm-axis": 4.0, "oracle": 0.6}


@dataclass(frozen=True, eq=False)
class Shown:
    """A body of the data set, as wanted, printed as it is on its broken printer, and planned with what was learned."""

    name: str
    printer: Printer
    bodies: dict[str, list]
    rmse_mm: tuple[float, float]


def shown_case(cases: Sequence[Case], results: Sequence[Result]) -> Case:
    """Return the case whose naive error is the median: neither the worst damage nor the least."""
    naive = {item.case: item.values["rmse_mm"] for item in results if item.row == "naive" and item.error is None}
    return sorted(naive, key=lambda case: naive[case])[len(naive) // 2] if naive else cases[0]


def show(case: Case) -> Shown:
    """Print the case's body for Fig. 1 and 5."""
    root, printer, chosen = Path(case.reference or ""), read_printer(case.printer), row(OURS)
    body = read_body(body_file(root, case.source))
    training = body.training_layer
    twin = Twin.of(read_corruption(corruption_file(root, case.sample)), printer)
    trace = layer_trace(training, twin.run(training.controls, training.start_steps), printer)
    model = chosen.model(trace, printer, twin, case.rng(0))
    layers = thinned(body, SHOWN_LAYERS).layers
    naive = [twin.run(layer.controls, layer.start_steps) for layer in layers]
    planned = [
        twin.run(chosen.controller.plan(model, layer.nominal_steps[1:], layer.start_steps).controls, layer.start_steps)
        for layer in layers
    ]
    ideal = [layer.nominal_steps.astype(float) for layer in layers]
    pitch_mm = np.array(printer.mm_per_step)
    errors = [
        rmse(np.concatenate(ideal) * pitch_mm, np.concatenate(printed) * pitch_mm) for printed in (naive, planned)
    ]
    prints = {"ideal": ideal, f"corrupted: {errors[0]:.2f} mm": naive, f"corrected: {errors[1]:.2f} mm": planned}
    bodies = {
        title: [printed_layer(layer, steps, printer) for layer, steps in zip(layers, printed, strict=True)]
        for title, printed in prints.items()
    }
    return Shown(body.name, printer, bodies, (errors[0], errors[1]))


def body_figure(shown: Shown, *, solid: bool) -> Figure:
    """Draw Fig. 1 (a solid seen from the side) or Fig. 5 (from above): ideal, corrupted, corrected."""
    draw, view = (draw_solid, solid_view) if solid else (draw_above, above_view)
    ideal, corrupted, corrected = shown.bodies.values()
    worst = np.concatenate([layer.error_mm for layer in corrupted])
    colours = Normalize(0, max(float(np.percentile(worst, 98)), shown.printer.x.mm_per_step))
    box = view([*ideal, *corrupted, *corrected])
    pictures = [partial(_raster, draw, layers=one, colours=colours, view_mm=box) for one in shown.bodies.values()]
    return comparison(
        list(shown.bodies), pictures, title=f"{shown.name}: RMSE of the whole body as printed", colours=colours
    )


def _raster(draw: Callable[..., Axes], axes: Axes, **more: object) -> Axes:
    """Draw with many lines as an image, not as vectors."""
    draw(axes, **more)
    for part in axes.collections:
        part.set_rasterized(True)
    return axes


def machine_figure(printer: Printer) -> Figure:
    """Draw Fig. 2: the machine, its gantry and bed, and one drive's motor, pulley and belt."""
    figure, (axes,) = new_figure(width_in=4.4, height_in=4.4)
    x, y, z = (axis.length_mm for axis in printer.axes)
    frame = np.array([-40.0, -40.0, -40.0]), np.array([x + 40, y + 40, z + 60])

    def line(points: Sequence[tuple[float, float, float]], colour: str, width: float) -> None:
        path = np.concatenate([project(np.array([point[:2]]), point[2]) for point in points])
        axes.plot(*path.T, color=colour, linewidth=width, solid_capstyle="round")

    corners = [(a, b) for a in (frame[0][0], frame[1][0]) for b in (frame[0][1], frame[1][1])]
    for level in (frame[0][2], frame[1][2]):
        ring = [corners[0], corners[1], corners[3], corners[2], corners[0]]
        line([(*one, level) for one in ring], PALETTE[5], 3)
    for one in corners:
        line([(*one, frame[0][2]), (*one, frame[1][2])], PALETTE[5], 3)
    bed = project(np.array([(0, 0), (x, 0), (x, y), (0, y)], float), 0.0)
    axes.fill(*bed.T, facecolor="#dee2e6", edgecolor=INK, linewidth=0.8)
    top, at = z + 40.0, (0.55 * x, 0.45 * y)
    for side in (-20.0, x + 20):
        line([(side, -20, top), (side, y + 20, top)], INK, 2)
        line([(side, -20, top + 8), (side, y + 20, top + 8)], PALETTE[1], 1.2)
    line([(-20, at[1], top), (x + 20, at[1], top)], INK, 2)
    line([(-20, at[1], top + 8), (x + 20, at[1], top + 8)], PALETTE[0], 1.2)
    line([(*at, top), (*at, top - 35)], INK, 5)
    # A CoreXY's motors stand still in two corners; otherwise that of x rides on the gantry.
    motors = ((x + 20, -20.0) if printer.kinematics == "corexy" else (x + 20, at[1])), (x + 20, y + 20)
    for place in motors:
        axes.plot(*project(np.array([place]), top + 8)[0], "o", color=INK, markersize=9)
    for place, level, name, offset in (
        (motors[0], top + 8, "motor x", (58, -12)),
        (motors[1], top + 8, "motor y", (24, 10)),
        (at, top - 35, "nozzle", (-44, -34)),
        ((-20.0, y * 0.3), top + 8, "belt", (-34, 14)),
    ):
        axes.annotate(
            name, project(np.array([place]), level)[0], xytext=offset, textcoords="offset points", fontsize=8,
            ha="left" if offset[0] > 0 else "right", va="center", annotation_clip=False,
            arrowprops={"arrowstyle": "-", "color": PALETTE[5], "linewidth": 0.8, "shrinkA": 1, "shrinkB": 3},
        )  # fmt: skip
    middle = project(np.array([(x / 2, y / 2)]), 0.0)[0]
    axes.annotate(f"bed\n{x:g} × {y:g} mm", middle, ha="center", va="center", fontsize=8)
    every = np.concatenate([project(np.array(corners), level) for level in (frame[0][2], frame[1][2])])
    fit_view(plain(axes), every.min(axis=0), every.max(axis=0))
    axes.set_title(printer.name, color=INK, fontsize=11)
    return figure


def trajectory_figure(twin: Twin) -> Figure:
    """Draw Fig. 3: a closed way of seven points, as wanted and as the broken machine goes."""
    printer = twin.printer
    middle = np.array(printer.middle_mm)
    shape = np.array([(-1, -1), (0.6, -1), (1, -0.2), (0.3, 0.2), (0.6, 1), (-1, 0.7), (-1, -1)])
    wanted = middle + 30 * shape
    printed = twin.follow(np.vstack([printer.home_mm, wanted]))[1:, :2]
    printed = printed - printed[0] + wanted[0]
    figure, axes = new_figure(2, width_in=3.6, height_in=3.8)
    low, high = np.minimum(wanted, printed).min(axis=0), np.maximum(wanted, printed).max(axis=0)
    for place, way, name, colour in (
        (axes[0], wanted, "ideal", PALETTE[0]),
        (axes[1], printed, "corrupted", PALETTE[1]),
    ):
        place.plot(*way.T, "o-", color=colour, markersize=4)
        if place is axes[1]:
            place.plot(*wanted.T, ":", color=PALETTE[5], linewidth=1)
        for number, point in enumerate(way[:-1]):
            place.annotate(
                f"{number}" if number else f"0, {len(way) - 1}",
                point,
                xytext=(4, 4),
                textcoords="offset points",
                fontsize=8,
            )
        fit_view(plain(place), low, high, margin=0.12)
        place.set_title(name, color=INK, fontsize=11)
    return figure


def similarity_figure() -> Figure:
    """Draw Fig. 4: the same two outlines laid over each other by area, and by their points."""
    one = np.array([(0, 0), (30, 0), (30, 8), (8, 8), (8, 24), (0, 24)], float)
    other = np.array([(0, 0), (24, 0), (24, 14), (10, 10), (8, 30), (0, 26)], float)
    figure, axes = new_figure(2, width_in=3.6, height_in=3.6)
    for place, measure, name in (
        (axes[0], _area_between, "laid over each other by area"),
        (axes[1], _point_distance, "by their nearest points"),
    ):
        start = np.append(one.mean(axis=0) - other.mean(axis=0), 0.0)
        best = minimize(lambda move, by=measure: by(one, _moved(other, move)), start, method="Nelder-Mead")
        laid = _moved(other, best.x)
        for outline, colour in ((one, PALETTE[0]), (laid, PALETTE[1])):
            place.fill(*outline.T, facecolor=colour, alpha=0.35, edgecolor=colour, linewidth=1.5)
        area, distance = _area_between(one, laid), _point_distance(one, laid)
        what = f"{name}\n{area:.0f} mm² of one alone\n{distance:.1f} mm between points"
        place.set_title(what, color=INK, fontsize=9)
        both = np.vstack([one, laid])
        fit_view(plain(place), both.min(axis=0), both.max(axis=0))
    figure.subplots_adjust(top=0.8)
    return figure


def _moved(outline: np.ndarray, move: np.ndarray) -> np.ndarray:
    """Return an outline turned and shifted: ``move`` is x, y [mm] and an angle [rad]."""
    c, s = np.cos(move[2]), np.sin(move[2])
    return np.asarray(outline @ np.array([[c, s], [-s, c]]) + move[:2])


def _area_between(one: np.ndarray, other: np.ndarray) -> float:
    return symmetric_difference_area([one], [other])


def _point_distance(one: np.ndarray, other: np.ndarray) -> float:
    """Return the mean distance of the three points that lie nearest to theirs, as the paper's figure has it."""
    return float(np.sort(np.hypot(*(one - other).T))[:3].mean())


def table_lines(part: Part) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return the header and the texts of a part of Table I, the paper's own figure in the last column.

    Nothing of the paper's stands beside families with play: it has none.
    """
    if part.play:
        return HEADER, [cells(line) for line in part.lines]
    lines = part.lines
    paper = [f"{PAPER_STEPS[line.row]:.1f}" if line.row in PAPER_STEPS else "–" for line in lines]
    return (*HEADER, "paper"), [(*cells(line), said) for line, said in zip(lines, paper, strict=True)]


def latex_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table for a paper that has the package booktabs."""
    replaced = {"÷": r"$\div$", "–": "--", "_": r"\_", "%": r"\%", "&": r"\&"}

    def clean(text: str) -> str:
        for mark, said in replaced.items():
            text = text.replace(mark, said)
        return text

    body = "\n".join(" & ".join(map(clean, row)) + r" \\" for row in rows)
    head = " & ".join(map(clean, header)) + r" \\"
    columns = "l" + "r" * (len(header) - 1)
    return f"\\begin{{tabular}}{{{columns}}}\n\\toprule\n{head}\n\\midrule\n{body}\n\\bottomrule\n\\end{{tabular}}\n"


def table_figure(header: Sequence[str], rows: Sequence[Sequence[str]]) -> Figure:
    """Draw Table I as a picture."""
    figure, (axes,) = new_figure(width_in=1.0 * len(header), height_in=0.3 * (len(rows) + 2))
    table = axes.table([list(row) for row in rows], colLabels=list(header), loc="center")
    for (line, column), cell in table.get_celld().items():
        cell.visible_edges = {0: "BT", len(rows): "B"}.get(line, "open")  # as a table of a journal
        if column == 0:
            cell.get_text().set_horizontalalignment("left")
    table.auto_set_font_size(False)
    table.set_fontsize(8)
    table.auto_set_column_width(list(range(len(header))))
    axes.axis("off")
    return figure


def write_figures(
    root: Path, cases: Sequence[Case], rows: Sequence[str], results: Sequence[Result], out: Path,
    *, tick: Callable[[str], None] = lambda what: None,
) -> list[Path]:  # fmt: skip
    """Write figure1.svg to figure6.svg and table1.md, .tex and .svg; return their paths.

    Families with play have a table of their own, table1-play, where there are others, too.
    There is no figure6.svg where every row failed on every body.
    """
    out.mkdir(parents=True, exist_ok=True)
    found = parts(results, rows)
    tables = {"table1" + "-play" * (part.play and len(found) > 1): table_lines(part) for part in found}
    case = shown_case(cases, results)
    printer = read_printer(case.printer)
    twin = Twin.of(read_corruption(corruption_file(root, case.sample)), printer)
    shown = show(case)
    drawings: dict[str, Callable[[], Figure | None]] = {
        "figure1": lambda: body_figure(shown, solid=True),
        "figure2": lambda: machine_figure(printer),
        "figure3": lambda: trajectory_figure(twin),
        "figure4": similarity_figure,
        "figure5": lambda: body_figure(shown, solid=False),
        "figure6": lambda: figure6(results, rows),
        **{name: partial(table_figure, *table) for name, table in tables.items()},
    }
    written = []
    for name, draw in drawings.items():
        if (figure := draw()) is not None:
            written.append(_write(out / f"{name}.svg", svg(figure, dpi=DPI)))
        tick(name)
    for name, table in tables.items():
        written.append(_write(out / f"{name}.md", markdown_table(*table)))
        written.append(_write(out / f"{name}.tex", latex_table(*table)))
    return written


def _write(path: Path, text: str) -> Path:
    with replacing(path) as file:
        file.write(text)
    return path
