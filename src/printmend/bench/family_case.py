"""One random fault of a family, one body: what a learner makes of a test print with noise, and how well it prints then.

A row is LEARNER+CONTROLLER@SIGMA, SIGMA being the noise of the measurement in mm: `greybox+optimal@0.05`.
"""

import hashlib
import json
import time
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from printmend.bench.case import reason
from printmend.errors import InputError
from printmend.path import Body
from printmend.plugins import CONTROLLERS, CORRUPTIONS, LEARNERS, code_digest
from printmend.printer import Printer
from printmend.protocols import SpaceModel, WorldModel

if TYPE_CHECKING:  # the twin needs numba, which workers import only after they are told to use one thread
    from printmend.bench.space_case import SpacePrints
    from printmend.twin import Twin

RULES = 2  # part of every key: raise it when the way a case is evaluated changes
TURN_MM = 40.0

# The purposes for which a case's generator is seeded; part of the meaning of a seed.
_CORRUPTION, _BODY, _NOISE, _LEARNER = 1, 2, 3, 4
_SCREW = "screw"


@dataclass(frozen=True)
class FamilyCase:
    """The ``sample``-th fault of a family on a preset, and a body ``coverage`` turns of a motor across.

    The fault does not depend on the coverage, nor the body on the family.
    """

    family: str
    severity: Literal["damaged", "realistic"]
    printer: str
    coverage: float
    sample: int
    seed: int

    @property
    def source(self) -> str:
        """What a progress bar shows."""
        return f"{self.family} {self.severity} {self.printer} {self.coverage:g} #{self.sample}"

    def key(self, row: str) -> str:
        """Return the key of this case's result for a row: 16 hex digits over everything that decides it."""
        code = code_digest((LEARNERS, CONTROLLERS, CORRUPTIONS), (*row.partition("@")[0].split("+"), self.family))
        content = {**asdict(self), "row": row, "rules": RULES, **({"code": code} if code else {})}
        text = json.dumps(content, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def rng(self, purpose: int, *more: object) -> np.random.Generator:
        """Return a generator of its own for a purpose, whatever else is drawn."""
        words = json.dumps([self.seed, self.sample, purpose, *more])
        return np.random.default_rng(int.from_bytes(hashlib.sha256(words.encode()).digest()[:8], "big"))


@dataclass(frozen=True)
class FamilyResult:
    """A row's result on a case; where it failed, ``error`` says why and the numbers are None."""

    key: str
    family: str
    severity: str
    printer: str
    coverage: float
    sample: int
    seed: int
    row: str
    noise_mm: float
    rmse_steps: float | None = None
    targets: int = 0
    learn_s: float | None = None
    plan_s: float | None = None
    error: str | None = None


def evaluate_family(case: FamilyCase, rows: tuple[str, ...]) -> list[FamilyResult]:
    """Print the first layer, learn from its noisy measurement, plan and print the other layers, for each row.

    With a Z screw these are two towers (`space_case`). Jumps spoil the test print only: nobody can foresee them in the
    next.
    """
    from printmend.printer import read_printer
    from printmend.twin import Twin

    try:
        printer = read_printer(case.printer)
        twin = Twin.of(corruption_of(case), printer)
        if has_screw(case.family):
            return _evaluate_space(twin, case, rows)
        body = body_of(case, printer)
        layer = body.layers[0]
        printed = twin.run(layer.controls, layer.start_steps)
    except Exception as error:  # a fault of another package may raise anything
        return [failed_family(case, name, reason(error)) for name in rows]
    prepared = _Prepared(printer, Twin(twin.mechanism), body, printed, {})
    return [_row(prepared, case, name) for name in rows]


def has_screw(family: str) -> bool:
    """Tell whether a family is one of three axes: ``screw``, or FAMILY+screw."""
    return family == _SCREW or family.endswith("+" + _SCREW)


def corruption_of(case: FamilyCase) -> Any:
    """Draw the case's fault; FAMILY+screw has the faults of both."""
    from printmend.corruption import fault

    drawn: list[Any] = [
        fault(name, case.rng(_CORRUPTION, name, case.severity), case.severity) for name in case.family.split("+")
    ]
    return drawn[0] if len(drawn) == 1 else replace(drawn[0], screw=drawn[1].screw)


def body_of(case: FamilyCase, printer: Printer) -> Body:
    """Draw the case's body."""
    from printmend.bench.drawn_body import drawn_body

    return drawn_body(case.rng(_BODY, case.coverage), printer, size_mm=case.coverage * TURN_MM)


def failed_family(case: FamilyCase, row: str, reason: str) -> FamilyResult:
    """Return the result of a case that could not be evaluated."""
    return replace(_blank(case, row), error=reason)


def row_parts(name: str) -> tuple[str, float]:
    """Split LEARNER+CONTROLLER@SIGMA. Raise `InputError` for a noise that is no length."""
    row, _, noise = name.partition("@")
    try:
        noise_mm = float(noise or 0.0)
    except ValueError:
        noise_mm = -1.0
    if not 0.0 <= noise_mm <= 10.0:
        raise InputError("noise", wanted="0 to 10 mm", came=repr(noise), todo="correct it")
    return row, noise_mm


@dataclass(frozen=True, eq=False)
class _Prepared:
    printer: Printer
    twin: "Twin"
    body: Body
    printed: np.ndarray
    learned: dict[tuple[str, float], tuple[WorldModel, float]]

    def model(self, label: str, noise_mm: float, case: FamilyCase) -> tuple[WorldModel, float]:
        """Return the model of a row and the seconds it took to learn; rows of one learner share it."""
        from printmend.bench.rows import row
        from printmend.learn.published.transitions import layer_trace

        chosen = row(label)
        if (chosen.learner, noise_mm) not in self.learned:
            trace = layer_trace(self.body.layers[0], self.printed, self.printer)
            noise = case.rng(_NOISE, noise_mm).normal(0.0, 1.0, trace.measured_mm.shape) * noise_mm
            trace = replace(trace, measured_mm=trace.measured_mm + noise)
            begun = time.perf_counter()
            model = chosen.model(trace, self.printer, self.twin, case.rng(_LEARNER))
            self.learned[chosen.learner, noise_mm] = model, time.perf_counter() - begun
        return self.learned[chosen.learner, noise_mm]


def _row(prepared: _Prepared, case: FamilyCase, name: str) -> FamilyResult:
    from printmend.bench.rows import row
    from printmend.metrics import rmse

    label, noise_mm = row_parts(name)
    controller, layers = row(label).controller, prepared.body.layers[1:]
    try:
        model, learn_s = prepared.model(label, noise_mm, case)
        begun = time.perf_counter()
        plans = [controller.plan(model, layer.nominal_steps[1:], layer.start_steps) for layer in layers]
        plan_s = time.perf_counter() - begun
        prints = [
            prepared.twin.run(plan.controls, layer.start_steps) for plan, layer in zip(plans, layers, strict=True)
        ]
    except Exception as error:  # one learner's trouble with one fault must not end the run
        return failed_family(case, name, reason(error))
    targets = np.concatenate([layer.nominal_steps for layer in layers])
    return replace(
        _blank(case, name),
        rmse_steps=rmse(targets, np.concatenate(prints)),
        targets=sum(layer.transitions for layer in layers),
        learn_s=learn_s,
        plan_s=plan_s,
    )


def _evaluate_space(twin: "Twin", case: FamilyCase, rows: tuple[str, ...]) -> list[FamilyResult]:
    from printmend.bench.space_case import space_prints

    towers = [case.rng(_BODY, case.coverage, place) for place in range(2)]
    prints = space_prints(twin, case.coverage, TURN_MM, towers)
    models: dict[tuple[str, float], tuple[SpaceModel, float]] = {}
    return [_space_row(prints, models, case, name) for name in rows]


def _space_row(
    prints: "SpacePrints", models: dict[tuple[str, float], tuple[SpaceModel, float]], case: FamilyCase, name: str
) -> FamilyResult:
    from printmend.bench.rows import row
    from printmend.bench.space_case import learned, space_rmse_steps
    from printmend.control.space import plan_space

    label, noise_mm = row_parts(name)
    chosen, second = row(label), prints.second
    key = chosen.learner, noise_mm
    try:
        if key not in models:
            noise = case.rng(_NOISE, noise_mm).normal(0.0, 1.0, prints.printed.shape)
            models[key] = learned(prints, chosen.learner, noise, noise_mm, case.rng(_LEARNER))
        model, learn_s = models[key]
        begun = time.perf_counter()
        plan = plan_space(chosen.controller, model, second.nominal_steps[1:], second.start_steps)
        plan_s = time.perf_counter() - begun
        printed = prints.twin.run(plan.controls, second.start_steps)
    except Exception as error:  # one learner's trouble with one fault must not end the run
        return failed_family(case, name, reason(error))
    return replace(
        _blank(case, name),
        rmse_steps=space_rmse_steps(prints, printed),
        targets=len(second.controls),
        learn_s=learn_s,
        plan_s=plan_s,
    )


def _blank(case: FamilyCase, row: str) -> FamilyResult:
    return FamilyResult(
        key=case.key(row), family=case.family, severity=case.severity, printer=case.printer, coverage=case.coverage,
        sample=case.sample, seed=case.seed, row=row_parts(row)[0], noise_mm=row_parts(row)[1],
    )  # fmt: skip
