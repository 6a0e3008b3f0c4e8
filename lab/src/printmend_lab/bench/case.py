"""What every table is made of: cases, rows, their trial, and runs that resume where they were interrupted."""

import hashlib
import importlib
import json
import math
import re
import sys
import time
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from printmend.errors import InputError, PrintmendError
from printmend.extras import missing_extra, require
from printmend.learn.registry import check_model_name, fit, fitted
from printmend.metrics import rmse
from printmend.path import Trace
from printmend.plugins import CONTROLLERS, CORRUPTIONS, LEARNERS, imported, is_plugin, place_of
from printmend.printer import Printer
from printmend.protocols import Learner, WorldModel
from printmend.twin import Twin
from printmend.units import TURN_RAD
from printmend_lab.body.layers import follow_polyline, to_steps
from printmend_lab.control.registry import controller
from printmend_lab.dataset.bodies import body_rng
from printmend_lab.executor import Executor, WorkerDied, program_version
from printmend_lab.path import Body, Layer
from printmend_lab.protocols import Controller

PRINTER = "ender5"
RULES = 4  # part of every key: raise it when the way a case is evaluated changes
# Where a case's files lie and what they are called: they may be moved, so this is no part of what a case is.
_PLACES = ("body", "source", "reference", "sliced")


@dataclass(frozen=True)
class Case:
    """What is broken, what is printed and what of it is learned from and judged, drawn from a seed.

    ``table`` names the table that asks (`trial.TABLES`), ``body`` is what a reader calls the body and ``identity``
    what decides it: the digest of a file's content; nothing where the body is drawn from the seed, ``coverage`` turns
    of a motor across. ``family`` and ``severity`` say what is broken; the fault itself follows from the seed and from
    the identity or the ``sample``. ``protocol`` says which layers are learned from and judged, at most ``layers`` of
    them. ``source`` is the body's file, ``reference`` the folder of a data set in the published layout that holds it,
    ``sliced`` a folder that keeps the G-code of meshes, so that each is sliced once.
    """

    table: str
    body: str = field(compare=False)
    identity: str
    family: str
    severity: str
    protocol: str
    seed: int
    printer: str = PRINTER
    coverage: float | None = None
    sample: int = 0
    layers: int = 3
    source: str = field(default="", compare=False)
    reference: str | None = field(default=None, compare=False)
    sliced: str | None = field(default=None, compare=False)

    def key(self, row: str) -> str:
        """Return the key of this case's result for a row: 16 hex digits over everything that decides it."""
        content = {name: value for name, value in asdict(self).items() if name not in _PLACES}
        names = (*re.split("[+@]", row), *self.family.split("+"))
        if code := code_digest(
            (LEARNERS, CONTROLLERS, CORRUPTIONS), names, ours="printmend_lab"
        ):  # of what is not ours
            content["code"] = code
        text = json.dumps({**content, "row": row, "rules": RULES}, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def rng(self, purpose: int, *more: object) -> np.random.Generator:
        """Return a generator for one purpose: what else is drawn, and for which other cases, does not change it."""
        if self.identity:
            return body_rng(self.seed, self.identity, purpose)
        words = json.dumps([self.seed, self.sample, purpose, *more])
        return np.random.default_rng(int.from_bytes(hashlib.sha256(words.encode()).digest()[:8], "big"))

    def noisy(self, trace: Trace, purpose: int, noise_mm: float) -> np.ndarray:
        """Return a trace's measured positions [N, 2] with normal noise of ``noise_mm`` a coordinate."""
        noise = self.rng(purpose, noise_mm).normal(0.0, 1.0, trace.measured_mm.shape)
        return np.asarray(trace.measured_mm + noise * noise_mm)

    def __str__(self) -> str:
        """What a progress bar shows."""
        what = self.body if self.coverage is None else f"{self.coverage:g} #{self.sample}"
        return " ".join(word for word in (self.family, self.severity, self.printer, what) if word)


_CASE = tuple(item.name for item in fields(Case))


@dataclass(frozen=True)
class Result:
    """A row's result on a case: its ``values``, or why it failed; ``code`` is the version that made it.

    ``kept`` is the key under which a results file has it: of the rules and the plug-in of that time, not of now.
    """

    case: Case
    row: str
    values: Mapping[str, Any] = field(default_factory=dict)
    error: str | None = None
    code: str = ""
    kept: str = ""

    @property
    def key(self) -> str:
        return self.kept or self.case.key(self.row)

    def value(self, name: str) -> float | None:
        """Return one of the numbers, None where it is not there."""
        return self.values.get(name)

    def flat(self) -> dict[str, Any]:
        """Return everything as one record, as it stands in a results file."""
        head = {"key": self.key, "code": self.code, **asdict(self.case), "row": self.row}
        return {**head, **self.values, "error": self.error}

    @classmethod
    def of(cls, record: dict[str, Any]) -> "Result":
        """Read what `flat` wrote. Raise TypeError or KeyError for a record that is something else."""
        rest = dict(record)
        kept = rest.pop("key")
        case = Case(**{name: rest.pop(name) for name in _CASE})
        row, error, code = rest.pop("row"), rest.pop("error"), rest.pop("code")
        return cls(case, row, rest, error, code, kept)


def code_digest(groups: tuple[str, ...], names: tuple[str, ...], *, ours: str) -> str | None:
    """Return a digest of the code behind the plug-ins among ``names``, None where there are none.

    Results that are kept are those of this code. It is all of a plug-in's package, or its module where it is in none.
    The package ``ours`` counts as none: its results say its version.
    """
    digest, found = hashlib.sha256(), False
    for name in names:
        for group in groups:
            if not is_plugin(group, name):
                continue
            place = place_of(group, name)
            if place.startswith(f"{ours}."):
                break
            module = imported(place.partition(":")[0], name)
            top = sys.modules[module.__name__.partition(".")[0]]
            folders = [Path(folder) for folder in getattr(top, "__path__", ())]
            files = sorted(file for folder in folders for file in folder.rglob("*.py")) or [Path(str(module.__file__))]
            for file in files:
                digest.update(file.read_bytes())
            found = True
            break
    return digest.hexdigest()[:16] if found else None


# Bodies made up for benchmarks: random outlines with infill, of a size that is chosen.

_BEAD_MM = 0.8  # between a layer's perimeters
_LAYER_MM = 0.2  # a layer's height
_LINES = 24  # of infill in a layer


def drawn_body(rng: np.random.Generator, printer: Printer, *, size_mm: float, layers: int = 3) -> Body:
    """Draw a body about ``size_mm`` across, anywhere in the bed's middle: two perimeters and zigzag infill a layer.

    The outline is a smooth star shape. The infill runs at 45° and 135° by turns, as slicers do, 24 lines a layer; so
    each layer goes both ways along both axes over the whole size, and small bodies have few points.
    """
    centre, outline = _outline(rng, printer, size_mm)
    drawn = []
    for index in range(layers):
        inner = outline * (1 - 2 * _BEAD_MM / size_mm)
        infill = _zigzag(outline * (1 - 4 * _BEAD_MM / size_mm), 1 if index % 2 == 0 else -1)
        points = centre + np.concatenate([outline, inner, infill])
        steps = to_steps(points, printer)
        start, controls, extruding = follow_polyline(steps, np.ones(len(steps) - 1, bool))
        drawn.append(Layer(index, _LAYER_MM * (index + 1), start, controls, extruding))
    return Body(f"drawn {size_mm:g} mm", tuple(drawn))


def drawn_tower(rng: np.random.Generator, printer: Printer, *, size_mm: float, height_mm: float) -> Body:
    """Draw a body about ``size_mm`` across and ``height_mm`` high, for prints of three axes: an outline a layer.

    The outlines are those of `drawn_body`, each begun elsewhere and gone round the other way than the one before.
    """
    centre, outline = _outline(rng, printer, size_mm)
    steps = np.rint(to_steps(centre + outline, printer))
    start, controls, _ = follow_polyline(steps, np.ones(len(steps) - 1, bool))
    loop = start + np.cumsum(controls, axis=0, dtype=np.int64)
    drawn = []
    for index in range(max(round(height_mm / _LAYER_MM), 2)):
        begun = np.roll(loop, int(rng.integers(len(loop))), axis=0)[:: 1 if index % 2 == 0 else -1]
        moves = np.diff(begun, axis=0)
        drawn.append(Layer(index, _LAYER_MM * (index + 1), begun[0], moves, np.ones(len(moves), bool)))
    return Body(f"drawn tower {size_mm:g} mm", tuple(drawn))


def _outline(rng: np.random.Generator, printer: Printer, size_mm: float) -> tuple[np.ndarray, np.ndarray]:
    """Draw where a body stands [2] and its closed outline about that [N, 2], mm."""
    centre = np.array(printer.middle_mm)
    room = [axis.length_mm / 2 - 0.7 * size_mm for axis in (printer.x, printer.y)]
    centre = centre + np.array([rng.uniform(-1, 1) * max(0.0, min(0.25 * size_mm + 20.0, free)) for free in room])
    waves = np.arange(2, 6)
    amplitude, phase = rng.uniform(-0.1, 0.1, 4) / waves * 2, rng.uniform(0, TURN_RAD, 4)
    angle = np.linspace(0.0, TURN_RAD, 181)
    shape = 1 + np.cos(np.outer(angle, waves) + phase) @ amplitude
    outline = shape[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    outline *= size_mm / np.ptp(outline, axis=0).max()
    return centre, outline


def _zigzag(outline: np.ndarray, side: int) -> np.ndarray:
    """Return way-points [2·lines, 2] across a closed outline [N, 2] about the origin, lines at 45° or 135°."""
    along = np.array([1.0, side]) / np.sqrt(2)
    across = np.array([-along[1], along[0]])
    u, v = outline @ along, outline @ across
    points = []
    for k, level in enumerate(np.linspace(v.min(), v.max(), _LINES + 2)[1:-1]):
        cut = np.flatnonzero((v[:-1] - level) * (v[1:] - level) <= 0)
        share = (level - v[cut]) / np.where(v[cut + 1] == v[cut], 1.0, v[cut + 1] - v[cut])
        crossings = u[cut] + share * (u[cut + 1] - u[cut])
        ends = [crossings.min(), crossings.max()]
        points += [along * end + across * level for end in (ends if k % 2 == 0 else ends[::-1])]
    return np.array(points)


# The rows of a table: how each makes its world model, and which controller plans with it.
#
# A row is named LEARNER, LEARNER+CONTROLLER or LEARNER+CONTROLLER@SIGMA: `lightgbm`, `greybox+lookahead`,
# `my_module:MINE+optimal@0.05`; SIGMA is the noise of the measurement in mm. The learner `oracle` is given the true
# mechanism. Without a controller it is the paper's greedy Algorithm 1. `optimum` is `oracle+optimal`: the lower bound.

OPTIMUM = "optimum"
PAPER_ROWS = ("naive", "lightgbm", "lightgbm-axis", "forest", "forest-axis", "greybox", "oracle", OPTIMUM)
_LIBRARIES = {"lightgbm": "lightgbm", "forest": "sklearn", "knn": "sklearn", "linear": "sklearn"}  # by learner's name
MAX_NOISE_MM = 10.0  # of a coordinate, standard deviation


@dataclass(frozen=True)
class Row:
    """One row of a table: a learner's name, the controller, the noise of the measurement, and, where test prints are
    compared, which is printed and at how many points it is measured. ``own`` is a learner that has no name here."""

    learner: str
    controller: Controller
    own: Learner | None = None
    noise_mm: float = 0.0
    test_print: str = ""
    points: int = 0

    @property
    def lesson(self) -> Hashable:
        """What decides the model: rows that share it learn once."""
        return self.learner, self.test_print, self.points, self.noise_mm

    def model(self, trace: Trace, printer: Printer, twin: Twin, rng: np.random.Generator) -> WorldModel:
        """Learn from the trace; the oracle looks at the twin instead."""
        if self.own is not None:
            return fitted(self.own, trace, printer, rng=rng)
        return fit(self.learner, trace, printer, rng=rng, truth=twin.mechanism)


def row(name: str) -> Row:
    """Return the row of that name. Raise `ConfigError` or `InputError` where a part of it does not exist."""
    label, noise_mm = row_parts(name)
    model, _, planner = ("oracle+optimal" if label == OPTIMUM else label).partition("+")
    check_model_name(model)
    return Row(model, controller(planner or "greedy"), noise_mm=noise_mm)


def libraries(names: Iterable[str]) -> tuple[str, ...]:
    """Return the libraries of extras that these rows learn with. Raise `InputError` for a row that does not exist."""
    learners = {row(name).learner.partition("-")[0] for name in names}
    return tuple(sorted({library for name, library in _LIBRARIES.items() if name in learners}))


def check_rows(names: Iterable[str]) -> None:
    """Raise `InputError` for a row that does not exist, `MissingToolError` where its library is missing."""
    require("the rows of this table", *libraries(names))


def row_parts(name: str) -> tuple[str, float]:
    """Split ROW@SIGMA. Raise `InputError` for a noise that is no length."""
    label, _, noise = name.partition("@")
    return label, read_noise(noise)


def read_noise(text: str) -> float:
    """Read a noise in mm, none where nothing is said. Raise `InputError` for one that is no length."""
    try:
        noise_mm = float(text or 0.0)
    except ValueError:
        noise_mm = -1.0
    if not 0.0 <= noise_mm <= MAX_NOISE_MM:
        raise InputError("noise", wanted=f"0 to {MAX_NOISE_MM:g} mm", came=repr(text), todo="correct it")
    return noise_mm


def planned_for(name: str, objective: str) -> str:
    """Return the name of a row that plans as well as possible for ``objective``: rmse or area.

    The naive row, which shows what was broken, and the optimum of the RMSE stay as they are.
    """
    if name in ("naive", OPTIMUM):
        return name
    return name.partition("+")[0] + "+optimal" + ("" if objective == "rmse" else f"-{objective}")


# A planar machine, what is learned from, and the layers that are planned, printed and judged.

Figures = Callable[[Sequence[Layer], Sequence[np.ndarray], Printer], dict[str, Any]]


def errors(layers: Sequence[Layer], prints: Sequence[np.ndarray], printer: Printer) -> dict[str, Any]:
    """Return the RMSE over all targets of all layers, in full steps and mm, and the number of targets."""
    targets, printed = np.concatenate([layer.nominal_steps for layer in layers]), np.concatenate(prints)
    pitch_mm = np.array(printer.mm_per_step)
    return {
        "rmse_steps": rmse(targets, printed),
        "rmse_mm": rmse(targets * pitch_mm, printed * pitch_mm),
        "targets": sum(layer.transitions for layer in layers),
    }


def covering_layer(body: Body, printer: Printer) -> Layer:
    """Return the layer that shows the most of a turn of the motor of which it shows less; of equals the longest.

    The paper learns from the longest (`Body.training_layer`), which may be a long infill on a short span.
    """

    def shown(layer: Layer) -> tuple[float, int]:
        spans = np.ptp(printer.to_motor(layer.nominal_steps), axis=0)
        turns = [min(span / printer.axes[k].steps_per_turn, 1.0) for k, span in enumerate(spans)]
        return min(turns), layer.transitions

    return max(body.layers, key=shown)


@dataclass(frozen=True, eq=False)
class LayerStand:
    """A case of planar layers: ``trace`` makes what a row's learner is shown, ``layers`` are planned and printed.

    ``rng`` makes a learner's generator, ``figures`` judge the prints, ``facts`` are said of every result.
    """

    printer: Printer
    twin: Twin
    trace: Callable[[Row], Trace]
    layers: tuple[Layer, ...]
    rng: Callable[[], np.random.Generator]
    figures: Figures = errors
    facts: Mapping[str, Any] = field(default_factory=dict)

    def measure(self, row: Row) -> Trace:
        return self.trace(row)

    def fit(self, measured: Trace, row: Row) -> WorldModel:
        return row.model(measured, self.printer, self.twin, self.rng())

    def judge(self, model: WorldModel, row: Row) -> dict[str, Any]:
        begun = time.perf_counter()
        plans = [row.controller.plan(model, layer.nominal_steps[1:], layer.start_steps) for layer in self.layers]
        plan_s = time.perf_counter() - begun
        prints = [
            self.twin.run(plan.controls, layer.start_steps) for plan, layer in zip(plans, self.layers, strict=True)
        ]
        left_to = {"left_to": plans[0].planner} if plans and plans[0].planner else {}
        return {**self.facts, **self.figures(self.layers, prints, self.printer), "plan_s": plan_s, **left_to}


# Try the rows of a table on one case: set it up, then measure, learn, plan, print and judge. The tables share this.

# The module of each table has ``set_up(case) -> Stand`` and ``read_row(name)``; both may raise `PrintmendError`.
TABLES = {
    "table1": "printmend_lab.bench.table1",
    "families": "printmend_lab.bench.families",
    "prints": "printmend_lab.bench.prints",
    "objectives": "printmend_lab.bench.objectives",
    "real": "printmend_lab.bench.real",
    "measured": "printmend_lab.bench.measured",
}


class TableRow(Protocol):
    """What a row's name says; rows of one ``lesson`` share what was learned."""

    @property
    def lesson(self) -> Hashable: ...


class Stand(Protocol):
    """A case that is set up for trial."""

    def measure(self, row: Any) -> Any:
        """Return what the row's learner is shown."""
        ...

    def fit(self, measured: Any, row: Any) -> Any:
        """Return the model that the row's learner makes of it; this is timed."""
        ...

    def judge(self, model: Any, row: Any) -> dict[str, Any]:
        """Print with the model and return the figures."""
        ...


def evaluate(case: Case, rows: tuple[str, ...]) -> list[Result]:
    """Return a result for each row. What fails is a result that says why, not an exception."""
    read_row = importlib.import_module(TABLES[case.table]).read_row
    return evaluate_rows(case, {name: read_row(name) for name in rows})


def evaluate_rows(case: Case, rows: Mapping[str, TableRow]) -> list[Result]:
    """Do so for rows that need not be registered, by name."""
    try:
        stand: Stand = importlib.import_module(TABLES[case.table]).set_up(case)
    except Exception as error:  # a fault of another package may raise anything
        return [failed(case, name, _reason(error)) for name in rows]
    learned: dict[Hashable, tuple[Any, float]] = {}
    return [_evaluate_row(stand, case, name, row, learned) for name, row in rows.items()]


def failed(case: Case, row: str, reason: str) -> Result:
    """Return the result of what could not be evaluated."""
    return Result(case, row, error=reason, code=program_version())


def _reason(error: Exception) -> str:
    """Return in one line why a row failed."""
    if isinstance(error, ImportError):
        error = missing_extra(error) or error
    said = str(error) if isinstance(error, PrintmendError) else f"{type(error).__name__}: {error}"
    return " ".join(said.split())  # one line, whatever a plug-in says


def _evaluate_row(
    stand: Stand, case: Case, name: str, row: TableRow, learned: dict[Hashable, tuple[Any, float]]
) -> Result:
    try:
        if row.lesson not in learned:
            measured = stand.measure(row)
            begun = time.perf_counter()
            learned[row.lesson] = stand.fit(measured, row), time.perf_counter() - begun
        model, learn_s = learned[row.lesson]
        values = {**stand.judge(model, row), "learn_s": learn_s}
    except Exception as error:  # one learner's trouble with one body must not end a run of days
        return failed(case, name, _reason(error))
    wrong = [what for what, value in values.items() if isinstance(value, float) and not math.isfinite(value)]
    if wrong:
        return failed(case, name, f"{wrong[0]} is not finite")
    return Result(case, name, values, code=program_version())


# Run cases, keep their results, resume where a run was interrupted.

Evaluate = Callable[[Case, tuple[str, ...]], list[Result]]


@dataclass(frozen=True)
class _Task:
    case: Case
    rows: tuple[str, ...]
    evaluate: Evaluate


def results_folder(out: Path) -> Path:
    """Return the folder for results, made where it was absent. Raise `InputError` where it cannot be."""
    out = Path(out)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(out, wanted="a folder for the results", came=f"{error}", todo="name another --out") from None
    return out


def run(
    cases: Sequence[Case],
    rows: Sequence[str],
    out: Path,
    executor: Executor,
    *,
    tick: Callable[[str], None] = lambda case: None,
    evaluate: Evaluate = evaluate,
) -> list[Result]:
    """Evaluate every case, all of one table, for every row that is not in ``out``/TABLE.jsonl yet.

    Each result is appended as it comes: one JSON object a line, which says the version of the code that made it. The
    file may hold other runs' results; those of these cases and rows are returned, in their order. A line that an
    interruption cut short is dropped.
    """
    if not cases:
        raise InputError("the table", wanted="at least one case", came="none", todo="ask for more")
    path = results_folder(out) / f"{cases[0].table}.jsonl"
    known = {result.key: result for result in read_results(path)}
    keys = {(case, row): case.key(row) for case in cases for row in rows}  # a plug-in may be edited meanwhile
    tasks = []
    for case in cases:
        missing = tuple(row for row in rows if keys[case, row] not in known)
        if missing:
            tasks.append(_Task(case, missing, evaluate))
        else:
            tick(str(case))
    with path.open("a", encoding="utf-8") as file:
        for task, outcome in executor.map(_work, tasks):
            if isinstance(outcome, WorkerDied):
                results = [failed(task.case, row, outcome.reason) for row in task.rows]
            else:
                results = outcome
            for made in results:
                result = replace(made, kept=keys[made.case, made.row])
                known[result.key] = result
                file.write(json.dumps(result.flat()) + "\n")
            file.flush()
            tick(str(task.case))
    return [known[keys[case, row]] for case in cases for row in rows]


def read_results(path: Path) -> list[Result]:
    """Read a results file; nothing where it does not exist. A cut last line is removed from the file.

    Raises `InputError` for a file that is something else.
    """
    if not path.exists():
        return []
    data = path.read_bytes()
    whole, cut = data.rpartition(b"\n")[0], data.rpartition(b"\n")[2]
    results = list(_parse(whole.decode("utf-8", "replace"), path))
    if cut:  # only now that the file is known to be ours
        path.write_bytes(whole + b"\n" if whole else b"")
    return results


def _parse(text: str, path: Path) -> Iterator[Result]:
    """Yield the results that the lines of a file hold."""
    for number, line in enumerate(text.splitlines(), start=1):
        try:
            yield Result.of(json.loads(line))
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
            came = f"line {number}: {type(error).__name__} {error}"
            raise InputError(path, wanted="results of an earlier run", came=came, todo="name another --out") from None


def _work(task: _Task) -> list[Result]:
    """Evaluate a task: what a worker is sent."""
    return task.evaluate(task.case, task.rows)
