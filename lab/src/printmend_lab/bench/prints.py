"""`printmend bench prints`: which test print to make, and at how many points to measure it.

Rows: test prints. Columns: measured points and the noise of their measurement. A cell is the mean RMSE in full steps of
bodies printed with what the grey box learned, over random damaged faults, and its ratio to the optimum.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from printmend.errors import InputError
from printmend.gcode.read import Program, read_gcode
from printmend.path import Trace
from printmend.printer import Printer, read_printer
from printmend.probe import design_probe
from printmend.twin import Twin
from printmend.units import TURN_RAD
from printmend_lab.bench.case import OPTIMUM, Case, LayerStand, Result, Row, drawn_body, read_noise, row, run
from printmend_lab.bench.families import body_of, corruption_of, drawn_case
from printmend_lab.bench.report import grouped, summary
from printmend_lab.executor import HERE, Executor
from printmend_lab.path import Body, Layer
from printmend_lab.sampling import families as known_families

# Test prints to compare: the designs of `printmend probe`, and the shapes of physics.md §5.
#
# A test print is a path in mm from home and the rows of it that are measured. The designs are measured at their marks,
# a shape at points evenly along its path.

TURNS_MM = 100.0  # 2.5 turns of a pulley with 40 mm
HALF_TURN_MM, CIRCLE_RADIUS_MM = 20.0, 20.0
REVERSALS_MM = tuple(0.2 * steps for steps in (40, 30, 22, 16, 12, 9, 7, 5, 4, 3, 2))  # at each end of the zigzag
WALK_SD_MM, WALK_STEPS = 2.0, 400  # of the random walk: a step along an axis, and how many


@dataclass(frozen=True, eq=False)
class MeasuredPath:
    """Way-points [N, 2] mm, the first the home position, and which rows [K] are measured."""

    waypoints_mm: np.ndarray
    rows: np.ndarray


def path_print(printer: Printer, path_mm: np.ndarray, points: int) -> MeasuredPath:
    """Return the print of a path [N, 2] that is measured at ``points`` points, evenly along it."""
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path_mm, axis=0).T))])
    measured = np.linspace(0.0, length[-1], points)
    # corners stay: the nozzle must go where the path does
    at = np.union1d(length, measured)
    way = np.stack([np.interp(at, length, path_mm[:, axis]) for axis in range(2)], axis=1)
    return MeasuredPath(np.vstack([printer.home_mm, way]), 1 + np.searchsorted(at, measured))


def designed(design: str, printer: Printer, part: Program | None, points: int) -> MeasuredPath:
    """Return a design of `printmend probe` with that many marks."""
    plan = design_probe(printer, design=design, part=part, marks=points)
    return MeasuredPath(plan.waypoints_mm, plan.rows)


def layer_mm(layer: Layer, printer: Printer) -> np.ndarray:
    """Return the way-points [N, 2] of a layer: where its controls change."""
    nominal = layer.nominal_steps * np.array(printer.mm_per_step) + [printer.x.min_mm, printer.y.min_mm]
    turns = np.concatenate([[True], (np.diff(layer.controls, axis=0) != 0).any(axis=1), [True]])
    return nominal[turns]


def body_program(body: Body, printer: Printer) -> Program:
    """Return a drawn body as the G-code that a slicer would write for it."""
    lines = ["G28", "G90", "M83"]
    for layer in body.layers:
        first, *rest = layer_mm(layer, printer).tolist()
        lines += [f"G1 Z{layer.z_mm:g} F600", f"G0 X{first[0]:g} Y{first[1]:g} F6000"]
        lines += [f"G1 X{x:g} Y{y:g} E0.02" for x, y in rest]
    return read_gcode("\n".join(lines).encode(), printer=printer)


def _diagonal(span_mm: float, *, back: bool) -> Callable[[Printer, np.random.Generator], np.ndarray]:
    """Return the path along a diagonal of that span about the middle, and ``back``."""

    def path(printer: Printer, rng: np.random.Generator) -> np.ndarray:
        ends = np.array([[-0.5, -0.5], [0.5, 0.5]] + [[-0.5, -0.5]] * back)
        return np.array(printer.middle_mm) + span_mm * ends

    return path


def _zigzag(printer: Printer, rng: np.random.Generator) -> np.ndarray:
    """Both diagonals there and back, a staircase of shrinking reversals at each end."""
    points = []
    for side in (1.0, -1.0):
        along = np.array([1.0, side])
        for end in (-0.5, 0.5, -0.5):
            here = end * TURNS_MM * along
            inwards = -np.sign(end) * along
            points.append(here)
            for reversal in REVERSALS_MM:
                points += [here + reversal * inwards, here]
    return np.array(printer.middle_mm) + np.array(points)


def _curve(x_waves: int, y_waves: int, radius_mm: float, shift: float) -> Callable:
    """Return a Lissajous figure: how often it goes to and fro along each axis, its reach, and its shift in x."""

    def path(printer: Printer, rng: np.random.Generator) -> np.ndarray:
        angle = np.linspace(0.0, TURN_RAD, 721)
        return np.array(printer.middle_mm) + radius_mm * np.stack(
            [np.sin(x_waves * angle + shift), np.sin(y_waves * angle)], 1
        )

    return path


def _random_walk(printer: Printer, rng: np.random.Generator) -> np.ndarray:
    """Return a random walk about the middle."""
    return np.array(printer.middle_mm) + np.cumsum(rng.normal(0.0, WALK_SD_MM, (WALK_STEPS, 2)), axis=0).clip(
        -TURNS_MM, TURNS_MM
    )


SHAPES: dict[str, Callable[[Printer, np.random.Generator], np.ndarray]] = {
    "diagonal-and-back": _diagonal(TURNS_MM, back=True),
    "zigzag": _zigzag,
    "lissajous": _curve(2, 3, TURNS_MM / 2, TURN_RAD / 4),
    "circle": _curve(1, 1, CIRCLE_RADIUS_MM, TURN_RAD / 4),
    "diagonal": _diagonal(TURNS_MM, back=False),
    "half-turn": _diagonal(HALF_TURN_MM, back=True),
    "random-walk": _random_walk,
}

TABLE, MARKDOWN = "prints", "prints.md"
POINTS = (60, 250, 1000)  # measured of a test print
FAMILIES = ("pulley-play", "pulley-loose", "elastic", "frame")
LEAST_TURNS, MOST_TURNS = 0.75, 2.0  # how far the bodies are across
PRINTS = (
    "fixed", "layer", "optimal", "active", "diagonal-and-back", "zigzag", "lissajous", "circle", "diagonal",
    "small-layer", "half-turn", "random-walk",
)  # fmt: skip
SMALL_LAYER_MM = 24.0  # across
LEARNED_BY = "greybox+optimal"
_WALK, _NOISE, _LEARN, _SMALL = 5, 6, 7, 8  # purposes of a case's generators


def draw_print_cases(families: Sequence[str], *, samples: int, seed: int) -> list[Case]:
    """Return a damaged fault of each family and sample, with a body of its own size.

    Raises `InputError` for a family that does not exist or that the twin cannot print from home.
    """
    for name in families:
        if name not in known_families() or name == "gain-table":
            raise InputError(
                "--families", wanted=f"names such as {', '.join(FAMILIES)}", came=repr(name), todo="correct it"
            )
    cases = []
    for name in families:
        for sample in range(samples):
            turns = np.random.default_rng([seed, sample]).uniform(LEAST_TURNS, MOST_TURNS)
            cases.append(drawn_case(TABLE, name, "damaged", round(float(turns), 2), sample, seed))
    return cases


def read_row(name: str) -> Row:
    """Read PRINT@POINTS@SIGMA, or the optimum. Raise `InputError` for a print that does not exist."""
    if name == OPTIMUM:
        return row(OPTIMUM)
    label, _, rest = name.partition("@")
    points, _, noise = rest.partition("@")
    if label not in PRINTS:
        raise InputError("--prints", wanted=f"names out of {', '.join(PRINTS)}", came=repr(label), todo="correct it")
    return replace(row(LEARNED_BY), test_print=label, points=int(points), noise_mm=read_noise(noise))


@dataclass(frozen=True, eq=False)
class PrintStand:
    """A body on a broken printer, and what was measured of each test print."""

    case: Case
    body: Body
    layers: LayerStand
    measured: dict[Any, int] = field(default_factory=dict)

    def measure(self, row: Row) -> Trace:
        if not row.test_print:  # the optimum is shown the machine itself
            return Trace(np.zeros((1, 2)), np.zeros((1, 2)))
        trace = measured_print(self.case, row, self.layers.printer, self.layers.twin, self.body)
        self.measured[row.lesson] = int(trace.measured_rows.sum())
        return trace

    def fit(self, measured: Trace, row: Row) -> Any:
        return self.layers.fit(measured, row)

    def judge(self, model: Any, row: Row) -> dict[str, Any]:
        return {**self.layers.judge(model, row), "measured": self.measured.get(row.lesson, 0)}


def set_up(case: Case) -> PrintStand:
    """Break the case's printer and draw its body."""
    printer = read_printer(case.printer)
    twin, body = Twin.of(corruption_of(case), printer), body_of(case, printer)
    nothing = Trace(np.zeros((1, 2)), np.zeros((1, 2)))
    return PrintStand(case, body, LayerStand(printer, twin, lambda row: nothing, body.layers, lambda: case.rng(_LEARN)))


def measured_print(case: Case, row: Row, printer: Printer, twin: Twin, body: Body) -> Trace:
    """Return the trace of a test print on the case's printer, measured with noise at about ``row.points`` places."""
    noise, label, points = case.rng(_NOISE, row.noise_mm), row.test_print, row.points

    def trace_of(chosen: MeasuredPath) -> Trace:
        printed = twin.follow(chosen.waypoints_mm)
        measured = np.full_like(printed, np.nan)
        measured[chosen.rows] = printed[chosen.rows] + noise.normal(0.0, 1.0, (len(chosen.rows), 2)) * row.noise_mm
        return Trace(chosen.waypoints_mm, measured, homed=True)

    if label == "layer":
        return trace_of(path_print(printer, layer_mm(body.training_layer, printer), points))
    if label == "small-layer":
        small = drawn_body(case.rng(_SMALL), printer, size_mm=SMALL_LAYER_MM, layers=1)
        return trace_of(path_print(printer, layer_mm(small.layers[0], printer), points))
    if label in SHAPES:
        return trace_of(path_print(printer, SHAPES[label](printer, case.rng(_WALK)), points))
    if label == "fixed":
        return trace_of(designed("fixed", printer, None, points))
    program = body_program(body, printer)
    if label == "optimal":
        return trace_of(designed("optimal", printer, program, points))
    # active: half of the marks from the prior, the others from what these told; both in one go
    first = designed("active", printer, None, points // 2)
    second = design_probe(printer, design="active", part=program, after=trace_of(first), marks=points - points // 2)
    both = np.concatenate([first.waypoints_mm, second.waypoints_mm])
    return trace_of(MeasuredPath(both, np.concatenate([first.rows, len(first.waypoints_mm) + second.rows])))


def prints_table(
    cases: Sequence[Case],
    prints: Sequence[str],
    points: Sequence[int],
    noises_mm: Sequence[float],
    out: Path,
    *,
    executor: Executor = HERE,
    tick: Callable[[str], None] = lambda case: None,
) -> list[Result]:
    """Evaluate every test print with every number of points and noise; keep results in ``out``/prints.jsonl.

    A run that was interrupted continues where it left off.
    """
    rows = [OPTIMUM, *(f"{label}@{count}@{noise:g}" for label in prints for count in points for noise in noises_mm)]
    for name in rows:
        read_row(name)
    return run(cases, rows, out, executor, tick=tick)


def print_lines(
    results: Sequence[Result], points: Sequence[int], noises_mm: Sequence[float]
) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return the table's header and lines.

    A cell reads "mean RMSE (its ratio to the optimum's mean)", with a star where some cases failed.
    """
    header = ("test print", *(f"{count} pts σ {noise:g}" for count in points for noise in noises_mm))
    groups = grouped(results, lambda item: item.row)
    optimum = groups.pop(OPTIMUM, [])
    lines = []
    for label in dict.fromkeys(name.partition("@")[0] for name in groups):
        texts = [
            _text(groups.get(f"{label}@{count}@{noise:g}", []), optimum) for count in points for noise in noises_mm
        ]
        lines.append((label, *texts))
    return header, lines


def _text(results: Sequence[Result], optimum: Sequence[Result]) -> str:
    """Return a cell as text: mean RMSE and ratio, with a star where some cases failed."""
    found = summary(results, optimum)
    if found.mean is None or found.ratio is None:
        return "–"
    return f"{found.mean:.2f} ({found.ratio:.2f})" + ("*" if found.failures else "")
