"""The paper's Table I and Fig. 6: bodies in files, a random fault each; what is learned from their largest layer."""

import hashlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal, cast

import numpy as np

from printmend.corruption import read_corruption
from printmend.errors import InputError
from printmend.path import Trace
from printmend.printer import Printer, check_preset, read_printer
from printmend.protocols import Learner
from printmend.twin import Twin
from printmend_lab.bench.case import (
    OPTIMUM,
    PRINTER,
    Case,
    LayerStand,
    Result,
    Row,
    check_rows,
    covering_layer,
    evaluate_rows,
    row,
    run,
)
from printmend_lab.bench.report import Summary, failure_texts, grouped, summary, text_table
from printmend_lab.body import load_body
from printmend_lab.body.layers import is_mesh
from printmend_lab.control.registry import controller as controller_of
from printmend_lab.dataset.bodies import body_files, body_rng, digest
from printmend_lab.dataset.build import changed_corruptions, read_recipe
from printmend_lab.dataset.parquet import BODIES, RECIPE, body_file, corruption_file, read_body, read_lines
from printmend_lab.dataset.reference import read_reference
from printmend_lab.executor import HERE, Executor
from printmend_lab.path import Body, Layer
from printmend_lab.published import layer_trace
from printmend_lab.sampling import Severity, check_family, fault

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Protocol = Literal["paper", "heldout", "covered"]
TABLE = "table1"
WITH_PLAY = ("play", "loose", "set-screw", "everything")  # parts of the names of families with play

# The purposes for which a body's generator is seeded; part of the meaning of a seed.
_FAMILY, CORRUPTION, _LAYERS, _LEARNER, _NOISE = 1, 2, 3, 4, 5


def draw_cases(
    files: Iterable[Path],
    *,
    protocol: Protocol,
    families: tuple[str, ...],
    severity: Severity,
    seed: int,
    limit: int | None = None,
    sliced: Path | None = None,
    printer: str = PRINTER,
) -> list[Case]:
    """Draw ``limit`` bodies of ``files``, and a family for each, from the seed; all on one preset of a ``printer``.

    Files of equal content count once. What is drawn for a body does not depend on the other bodies.
    """
    check_preset(printer)
    for family in families:
        check_family(family)
    identities: dict[str, Path] = {}
    for path in files:
        identities.setdefault(digest(path), path)
    order = sorted(identities)
    np.random.default_rng(seed).shuffle(order)
    cases = []
    for identity in order[:limit]:
        path = identities[identity]
        family = str(body_rng(seed, identity, _FAMILY).choice(families))
        cases.append(
            Case(
                TABLE, path.stem, identity, family, severity, protocol, seed, printer, source=str(path.absolute()),
                sliced=None if sliced is None else str(sliced.absolute()),
            )
        )  # fmt: skip
    return cases


def reference_cases(root: Path, *, protocol: Protocol, seed: int, limit: int | None = None) -> list[Case]:
    """Return the bodies of a data set in the published layout; their corruptions are in it."""
    reference = read_reference(root)
    matrix = digest(Path(root) / "simulation" / "add_dudw_data.mat")
    cases = []
    for name in reference.names[:limit]:
        path = reference.path(name)
        identity = hashlib.sha256((digest(path) + matrix).encode()).hexdigest()[:16]
        cases.append(
            Case(
                TABLE, name, identity, "gain-table", "damaged", protocol, seed, source=str(path.absolute()),
                reference=str(Path(root).absolute()),
            )
        )  # fmt: skip
    return cases


def dataset_cases(
    root: Path, *, protocol: Protocol, seed: int, limit: int | None = None, every_printer: bool = False
) -> list[Case]:
    """Return the bodies of a data set in Parquet, each on a broken printer that the seed draws, or on every one."""
    root, recipe = Path(root).absolute(), read_recipe(root)
    if wrong := changed_corruptions(root):
        raise InputError(root, wanted="a whole data set", came="; ".join(wrong[:3]), todo="fetch or build it again")
    prints = [digest(corruption_file(root, number)) for number in range(recipe.corruptions)]
    cases = []
    for line in read_lines(root / BODIES)[:limit]:
        drawn = int(body_rng(seed, line["identity"], _FAMILY).integers(recipe.corruptions))
        for number in range(recipe.corruptions) if every_printer else (drawn,):
            identity = hashlib.sha256((line["identity"] + prints[number]).encode()).hexdigest()[:16]
            cases.append(
                Case(
                    TABLE, line["body"], identity, recipe.families[number % len(recipe.families)], recipe.severity,
                    protocol, seed, recipe.printer, sample=number, source=line["body"], reference=str(root),
                )
            )  # fmt: skip
    return cases


def _training(body: Body, printer: Printer, protocol: str) -> Layer:
    return covering_layer(body, printer) if protocol == "covered" else body.training_layer


def set_up(case: Case) -> LayerStand:
    """Print the layer that is learned from, and draw the layers that are judged.

    It is the longest, as in the paper; with the protocol ``covered`` the one that shows most of both motors' turns,
    where bodies are not those of the published data.
    """
    if case.reference is not None and (Path(case.reference) / RECIPE).exists():
        printer, body = read_printer(case.printer), read_body(body_file(Path(case.reference), case.source))
        twin = Twin.of(read_corruption(corruption_file(Path(case.reference), case.sample)), printer)
        training = _training(body, printer, case.protocol)
        printed = twin.run(training.controls, training.start_steps)  # as in the set, but not rounded
    elif case.reference is not None:
        reference = read_reference(Path(case.reference))
        item = reference.body(Path(case.source).stem)
        printer, body = reference.printer, item.body
        twin = Twin(reference.mechanism(item.corruption_ids))
        training = body.training_layer
        printed = item.printed_steps[body.layers.index(training)]
    else:
        printer = read_printer(case.printer)
        body = load_body(_gcode(case, printer), printer)
        twin = Twin.of(fault(case.family, case.rng(CORRUPTION), cast(Severity, case.severity)), printer)
        training = _training(body, printer, case.protocol)
        printed = twin.run(training.controls, training.start_steps)
    layers = drawn_layers(body.layers, training, case.protocol, case.layers, case.rng(_LAYERS), subject=body.name)
    measured = layer_trace(training, printed, printer)

    def trace(row: Row) -> Trace:
        if row.noise_mm == 0.0:
            return measured
        return replace(measured, measured_mm=case.noisy(measured, _NOISE, row.noise_mm))

    facts = {"training_layer": training.index, "judged": [layer.index for layer in layers]}
    return LayerStand(printer, twin, trace, layers, lambda: case.rng(_LEARNER), facts=facts)


read_row = row


def drawn_layers(
    layers: Sequence[Layer], training: Layer, protocol: str, count: int, rng: np.random.Generator, *, subject: str
) -> tuple[Layer, ...]:
    """Draw at most ``count`` layers: of all (protocol paper), or of those that were not learned from.

    Raises `InputError` where none is left.
    """
    candidates = [layer for layer in layers if protocol == "paper" or layer is not training]
    if not candidates:
        raise InputError(
            subject, wanted="a layer besides the training layer", came="one layer", todo="use --protocol paper"
        )
    drawn = rng.choice(len(candidates), min(count, len(candidates)), replace=False)
    return tuple(candidates[i] for i in sorted(drawn))


def _gcode(case: Case, printer: Printer) -> Path:
    """Return the case's G-code: the source itself, or what it was sliced into."""
    path = Path(case.source)
    if case.sliced is None or not is_mesh(path):
        return path
    from printmend_lab.body.mesh import read_solid  # meshes need an extra
    from printmend_lab.body.slicer import slice_to

    return slice_to(read_solid(path), printer, Path(case.sliced))


@dataclass(frozen=True)
class Line:
    """One row of Table I over its bodies. Errors in full steps unless named; None where nothing succeeded."""

    row: str
    bodies: int
    failures: int
    abrmse_steps: float | None
    abrmse_mm: float | None
    median_steps: float | None
    p95_steps: float | None
    ratio_to_oracle: float | None
    learn_s: float | None
    targets_s: float | None


def by_family(
    results: Sequence[Result], rows: Sequence[str]
) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:  # fmt: skip
    """Return a table with a line for each family of faults and a column for each row: mean RMSE [steps] over the
    family's bodies, and its ratio to the optimum's; a star where some failed."""
    found = grouped(results, lambda item: (item.case.family, item.row))
    lines = []
    for family in dict.fromkeys(item.case.family for item in results):
        best, texts = found.get((family, OPTIMUM), []), []
        for name in rows:
            one = summary(found[family, name], best)
            ratio = "" if one.ratio is None else f" ({one.ratio:.2f})"
            texts.append("–" if one.mean is None else f"{one.mean:.3f}{ratio}" + "*" * bool(one.failures))
        lines.append((family, str(len(found[family, rows[0]])), *texts))
    return ("family", "bodies", *rows), lines


HEADER = ("model", "bodies", "ABRMSE steps", "mm", "median", "p95", "÷ oracle", "learn s", "targets/s")


def table1(
    cases: Sequence[Case],
    rows: Sequence[str],
    out: Path,
    *,
    executor: Executor = HERE,
    tick: Callable[[str], None] = lambda body: None,
) -> tuple[list[Line], list[Result]]:
    """Evaluate the cases for the rows; keep results in ``out``/table1.jsonl and draw Fig. 6 beside them.

    Raises `InputError`, before anything is written, for a row that does not exist.
    """
    rows = tuple(dict.fromkeys(rows))
    check_rows(rows)
    if not cases:
        raise InputError("bodies", wanted="at least one", came="none", todo="check --bodies, --reference and --limit")
    results = run(cases, rows, out, executor, tick=tick)
    drawn = sorted({case.family for case in cases})
    world = drawn[0] if len(drawn) == 1 else "mixed"
    if (figure := figure6(results, rows)) is not None:
        from printmend.draw import save

        save(figure, Path(out) / f"figure6-{world}-{cases[0].protocol}.png", dpi=110)
    return lines(results, rows), results


def lines(results: Sequence[Result], rows: Sequence[str]) -> list[Line]:
    """Return one line a row: ABRMSE is the mean over bodies, the ratio to the oracle is over the bodies that both have.

    ``learn s`` and ``targets/s`` are medians over bodies, so that compiling in a worker's first body does not show.
    """
    of_row = {name: [result for result in results if result.row == name] for name in rows}
    oracle = [result for result in results if result.row == "oracle"]
    return [_line(name, items, summary(items, oracle)) for name, items in of_row.items()]


def _line(row: str, results: list[Result], found: Summary) -> Line:
    good = [result for result in results if result.error is None]
    if not good:
        return Line(row, 0, found.failures, None, None, None, None, None, None, None)
    speeds = [result.values["targets"] / result.values["plan_s"] for result in good if result.values["plan_s"]]
    return Line(
        row=row,
        bodies=len(good),
        failures=found.failures,
        abrmse_steps=found.mean,
        abrmse_mm=float(np.mean([result.values["rmse_mm"] for result in good])),
        median_steps=found.median,
        p95_steps=found.p95,
        ratio_to_oracle=found.ratio,
        learn_s=float(np.median([result.values["learn_s"] for result in good])),
        targets_s=float(np.median(speeds)) if speeds else None,
    )


def has_play(family: str) -> bool:
    """Say whether a family has play, in which the paper's Algorithm 1 stands still: the paper's Table I has none."""
    return any(each in family for each in WITH_PLAY)


@dataclass(frozen=True)
class Part:
    """Table I over the bodies of families without play, or of those with it."""

    play: bool
    lines: tuple[Line, ...]

    @property
    def title(self) -> str:
        return "with play" if self.play else "without play"


def parts(results: Sequence[Result], rows: Sequence[str]) -> tuple[Part, ...]:
    """Return Table I over the families without play and over those with it, as far as there are any.

    Together they would set the Oracle that stands still in play beside the paper's, which met none.
    """
    found = []
    for play in (False, True):
        some = [item for item in results if has_play(item.case.family) == play]
        if some:
            found.append(Part(play, tuple(lines(some, rows))))
    return tuple(found)


def stands_still(results: Sequence[Result], rows: Sequence[str]) -> tuple[str, ...]:
    """Return the learners planned by the paper's Algorithm 1 that do worse than naive on the bodies of families with
    play, over those that both have; none where naive is no row."""
    loose = [item for item in results if has_play(item.case.family)]
    naive = [item for item in loose if item.row == "naive"]
    found = []
    for name in rows:
        mine = [item for item in loose if item.row == name]
        ratio = summary(mine, naive).ratio
        if "+" not in name and name not in ("naive", OPTIMUM) and ratio is not None and ratio > 1:
            found.append(name)
    return tuple(found)


def cells(line: Line) -> tuple[str, ...]:
    """Return a line as the table's texts, in the order of `HEADER`; where bodies failed, of how many it tells."""
    numbers = (line.abrmse_steps, line.abrmse_mm, line.median_steps, line.p95_steps, line.ratio_to_oracle)
    texts = ["–" if number is None else f"{number:.3f}" for number in numbers]
    learn = "–" if line.learn_s is None else f"{line.learn_s:.3f}"
    speed = "–" if line.targets_s is None else f"{line.targets_s:,.0f}".replace(",", " ")
    bodies = f"{line.bodies} of {line.bodies + line.failures}" if line.failures else str(line.bodies)
    return (line.row, bodies, *texts, learn, speed)


def figure6(results: Sequence[Result], rows: Sequence[str]) -> "Figure | None":
    """Draw the paper's Fig. 6 (one model's errors, clipped at 100 steps) beside every model's over a logarithmic axis.

    None where no row succeeded on any body.
    """
    values = {
        name: np.array([item.values["rmse_steps"] for item in results if item.row == name and item.error is None])
        for name in rows
    }
    values = {name: errors for name, errors in values.items() if len(errors)}
    if not values:
        return None
    from printmend.draw import new_figure
    from printmend_lab.draw import draw_histogram, draw_log_histogram

    shown = next((name for name in ("lightgbm", *rows) if name in values), rows[0])
    figure, axes = new_figure(2, width_in=6.0, height_in=4.2)
    draw_histogram(axes[0], values[shown], name=f"{shown}: {len(values[shown])} bodies")
    draw_log_histogram(axes[1], values)
    figure.subplots_adjust(left=0.06, right=0.95, top=0.92, bottom=0.13, wspace=0.27)
    return figure


# Judge learners on bodies from Python: the paper's Table I in one call, a learner of one's own beside the others.


@dataclass(frozen=True)
class Evaluation:
    """A line for each learner over the bodies, and each learner's result on each body; printed, it is the table."""

    lines: tuple[Line, ...]
    results: tuple[Result, ...]

    def __str__(self) -> str:
        table = text_table(HEADER, [cells(line) for line in self.lines])
        return "\n".join([table, *(f"failed: {text}" for text in failure_texts(self.results))])


def evaluate(
    learners: Sequence[str | Learner],
    bodies: Iterable[str | Path],
    *,
    controller: str = "optimal",
    families: Sequence[str] = ("pulley",),
    severity: Severity = "damaged",
    protocol: Literal["paper", "heldout", "covered"] = "heldout",
    seed: int = 0,
    limit: int | None = None,
) -> Evaluation:
    """Print each body on a broken printer, let each learner learn from its largest layer, plan others, print again.

    ``learners`` are names (`naive`, `greybox`, `oracle`, or with a controller of their own: `greybox+greedy` is the
    paper's) or learners themselves, which plan with ``controller``. ``bodies`` are meshes, G-code files and folders of
    them; what is broken is drawn from ``families`` and the ``seed``, the same for every learner. Up to three layers are
    judged, with `heldout` never the one that was learned from, with `paper` any. With `covered` the
    one that is learned from shows the most of both motors' turns, and is not judged. Nothing is kept; `printmend bench
    table1` also keeps results, goes on after an interruption and uses several processes. Raises `InputError` for an
    unknown name and where there is no body; a learner that fails on a body has a result that says why.
    """
    rows = dict(_row(item, controller) for item in learners)
    cases = draw_cases(
        body_files(bodies), protocol=protocol, families=tuple(families), severity=severity, seed=seed, limit=limit
    )
    results = [result for case in cases for result in evaluate_rows(case, rows)]
    return Evaluation(tuple(lines(results, tuple(rows))), tuple(results))


def _row(item: str | Learner, controller: str) -> tuple[str, Row]:
    if not isinstance(item, str):
        return item.name, Row(item.name, controller_of(controller), own=item)
    return item, row(item if item == OPTIMUM or "+" in item else f"{item}+{controller}")
