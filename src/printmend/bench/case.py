"""One body on one broken printer under one protocol: what a worker is given, and what it gives back."""

import hashlib
import json
import time
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from printmend.dataset.bodies import body_rng, digest
from printmend.errors import InputError, PrintmendError
from printmend.extras import missing_extra
from printmend.path import Layer, Trace
from printmend.plugins import CONTROLLERS, CORRUPTIONS, LEARNERS, code_digest
from printmend.printer import Printer

if TYPE_CHECKING:  # the twin needs numba, which workers import only after they are told to use one thread
    from printmend.bench.rows import OwnRow, Row
    from printmend.twin import Twin

Protocol = Literal["paper", "heldout"]
PROTOCOLS: tuple[Protocol, ...] = ("paper", "heldout")
LAYERS = 3  # the published evaluation draws at most so many layers a body
PRINTER = "ender5"
RULES = 1  # part of every key: raise it when the way a case is evaluated changes

# The purposes for which a body's generator is seeded; part of the meaning of a seed.
_FAMILY, _CORRUPTION, _LAYERS, _LEARNER = 1, 2, 3, 4


@dataclass(frozen=True)
class Case:
    """A body, its corruption and the protocol.

    ``source`` is the body's file, or its CSV where ``reference`` names a data set in the published layout.
    ``identity`` is the digest of the content, so that a file may be moved or renamed. ``family`` is the family drawn
    for this body; the corruption itself follows from seed, identity and severity. ``sliced`` is a folder that keeps
    the G-code of meshes, so that a body is sliced once for all protocols and runs.
    """

    source: str
    identity: str
    protocol: Protocol
    family: str
    severity: Literal["damaged", "realistic"]
    seed: int
    reference: str | None = None
    sliced: str | None = None

    def key(self, row: str) -> str:
        """Return the key of this case's result for a row: 16 hex digits over everything that decides it."""
        content = {name: value for name, value in asdict(self).items() if name not in ("source", "reference", "sliced")}
        if code := code_digest((LEARNERS, CONTROLLERS, CORRUPTIONS), (*row.split("+"), self.family)):
            content["code"] = code
        text = json.dumps({**content, "row": row, "rules": RULES, "layers": LAYERS, "printer": PRINTER}, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]


@dataclass(frozen=True)
class Result:
    """A row's result on a case, one line of the results file; on failure ``error`` says why, the numbers are None."""

    key: str
    body: str
    source: str
    protocol: str
    family: str
    severity: str
    seed: int
    row: str
    rmse_steps: float | None = None
    rmse_mm: float | None = None
    training_layer: int | None = None
    layers: tuple[int, ...] = ()
    targets: int = 0
    learn_s: float | None = None
    plan_s: float | None = None
    error: str | None = None


def draw_cases(
    files: Iterable[Path],
    *,
    protocol: Protocol,
    families: tuple[str, ...],
    severity: Literal["damaged", "realistic"],
    seed: int,
    limit: int | None = None,
    sliced: Path | None = None,
) -> list[Case]:
    """Draw ``limit`` bodies of ``files``, and a family for each, from the seed.

    Files of equal content count once. What is drawn for a body does not depend on the other bodies.
    """
    from printmend.corruption.sample import check_family

    for family in families:
        check_family(family)
    identities: dict[str, Path] = {}
    for path in files:
        identities.setdefault(digest(path), path)
    order = sorted(identities)
    np.random.default_rng(seed).shuffle(order)
    cache = None if sliced is None else str(sliced)
    return [
        Case(
            str(identities[identity]), identity, protocol, _family(families, seed, identity), severity, seed,
            sliced=cache,
        )
        for identity in order[:limit]
    ]  # fmt: skip


def reference_cases(root: Path, *, protocol: Protocol, seed: int, limit: int | None = None) -> list[Case]:
    """Return the bodies of a data set in the published layout; their corruptions are in it."""
    from printmend.dataset.reference import read_reference

    reference = read_reference(root)
    matrix = digest(Path(root) / "simulation" / "add_dudw_data.mat")
    cases = []
    for name in reference.names[:limit]:
        path = reference.path(name)
        identity = hashlib.sha256((digest(path) + matrix).encode()).hexdigest()[:16]
        cases.append(Case(str(path), identity, protocol, "gain-table", "damaged", seed, str(root)))
    return cases


def evaluate(case: Case, rows: tuple[str, ...]) -> list[Result]:
    """Print, learn, plan and print again, for each row. What fails is a result that says why, not an exception."""
    from printmend.bench.rows import row

    return evaluate_rows(case, {name: row(name) for name in rows})


def evaluate_rows(case: Case, rows: Mapping[str, "Row | OwnRow"]) -> list[Result]:
    """Do so for rows that need not be registered, by name."""
    try:
        prepared = _prepare(case)
    except Exception as error:  # a fault of another package may raise anything
        return [failed(case, name, reason(error)) for name in rows]
    return [_evaluate_row(prepared, name, chosen, case) for name, chosen in rows.items()]


def failed(case: Case, row: str, reason: str) -> Result:
    """Return the result of a case that could not be evaluated."""
    return replace(_blank(case, row), error=reason)


def reason(error: Exception) -> str:
    """Return what a result says of an error."""
    if isinstance(error, ImportError):
        error = missing_extra(error) or error
    return str(error) if isinstance(error, PrintmendError) else f"{type(error).__name__}: {error}"


def _blank(case: Case, row: str) -> Result:
    return Result(
        key=case.key(row), body=Path(case.source).stem, source=case.source, protocol=case.protocol,
        family=case.family, severity=case.severity, seed=case.seed, row=row,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Prepared:
    printer: Printer
    twin: "Twin"
    trace: Trace
    training_layer: int
    layers: tuple[Layer, ...]


def _prepare(case: Case) -> _Prepared:
    from printmend.body import load_body
    from printmend.corruption import fault
    from printmend.dataset.reference import read_reference
    from printmend.learn.published.transitions import layer_trace
    from printmend.printer import read_printer
    from printmend.twin import Twin

    if case.reference is not None:
        reference = read_reference(Path(case.reference))
        item = reference.body(Path(case.source).stem)
        printer, body = reference.printer, item.body
        twin = Twin(reference.mechanism(item.corruption_ids))
        training = body.training_layer
        printed = item.printed_steps[body.layers.index(training)]
    else:
        printer = read_printer(PRINTER)
        body = load_body(_gcode(case, printer), printer)
        corruption = fault(case.family, body_rng(case.seed, case.identity, _CORRUPTION), case.severity)
        twin = Twin.of(corruption, printer)
        training = body.training_layer
        printed = twin.run(training.controls, training.start_steps)
    candidates = [layer for layer in body.layers if case.protocol == "paper" or layer is not training]
    if not candidates:
        raise InputError(
            body.name, wanted="a layer besides the training layer", came="one layer", todo="use --protocol paper"
        )
    rng = body_rng(case.seed, case.identity, _LAYERS)
    drawn = rng.choice(len(candidates), min(LAYERS, len(candidates)), replace=False)
    layers = tuple(candidates[i] for i in sorted(drawn))
    return _Prepared(printer, twin, layer_trace(training, printed, printer), training.index, layers)


def _evaluate_row(prepared: _Prepared, name: str, chosen: "Row | OwnRow", case: Case) -> Result:
    from printmend.metrics import rmse

    layers = prepared.layers
    try:
        begun = time.perf_counter()
        model = chosen.model(
            prepared.trace, prepared.printer, prepared.twin, body_rng(case.seed, case.identity, _LEARNER)
        )
        learned = time.perf_counter()
        plans = [chosen.controller.plan(model, layer.nominal_steps[1:], layer.start_steps) for layer in layers]
        planned = time.perf_counter()
        prints = [
            prepared.twin.run(plan.controls, layer.start_steps) for plan, layer in zip(plans, layers, strict=True)
        ]
    except Exception as error:
        # One learner's trouble with one body must not end a run of days; the reason goes into the results.
        return failed(case, name, reason(error))
    targets, printed = np.concatenate([layer.nominal_steps for layer in layers]), np.concatenate(prints)
    pitch_mm = np.array(prepared.printer.mm_per_step)
    return replace(
        _blank(case, name),
        rmse_steps=rmse(targets, printed),
        rmse_mm=rmse(targets * pitch_mm, printed * pitch_mm),
        training_layer=prepared.training_layer,
        layers=tuple(layer.index for layer in layers),
        targets=sum(layer.transitions for layer in layers),
        learn_s=learned - begun,
        plan_s=planned - learned,
    )


def _gcode(case: Case, printer: Printer) -> Path:
    """Return the case's G-code: the source itself, or what it was sliced into."""
    from printmend.body.load import is_mesh

    path = Path(case.source)
    if case.sliced is None or not is_mesh(path):
        return path
    from printmend.body.mesh import read_solid
    from printmend.body.slicer import slice_to

    return slice_to(read_solid(path), printer, Path(case.sliced))


def _family(families: tuple[str, ...], seed: int, identity: str) -> str:
    return str(body_rng(seed, identity, _FAMILY).choice(families))
