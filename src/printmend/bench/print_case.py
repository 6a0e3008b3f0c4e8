"""One random fault, one body, many test prints: how well the body prints after learning from each.

A row is PRINT@POINTS@SIGMA: `optimal@250@0.05`; `optimum` is the best plan on the true machine.
"""

import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from printmend.bench.family_case import FamilyCase, body_of, corruption_of
from printmend.errors import InputError, PrintmendError
from printmend.path import Body, Trace
from printmend.printer import Printer
from printmend.protocols import WorldModel

if TYPE_CHECKING:  # the twin needs numba, which workers import only after they are told to use one thread
    from printmend.twin import Twin

OPTIMUM = "optimum"
PRINTS = (
    "fixed", "layer", "optimal", "active", "diagonal-and-back", "zigzag", "lissajous", "circle", "diagonal",
    "small-layer", "half-turn", "random-walk",
)  # fmt: skip
SMALL_LAYER_MM = 24.0
LEARNER, CONTROLLER = "greybox", "optimal"
_WALK, _NOISE, _LEARN, _SMALL = 5, 6, 7, 8  # purposes of a case's generators


@dataclass(frozen=True)
class PrintResult:
    """A row's result on a case; where it failed, ``error`` says why and the numbers are None."""

    key: str
    family: str
    coverage: float
    sample: int
    seed: int
    test_print: str
    points: int
    noise_mm: float
    rmse_steps: float | None = None
    measured: int = 0
    learn_s: float | None = None
    error: str | None = None


def print_row(name: str) -> tuple[str, int, float]:
    """Split PRINT@POINTS@SIGMA. Raise `InputError` for a print that does not exist."""
    label, _, rest = name.partition("@")
    points, _, noise = rest.partition("@")
    if label not in (*PRINTS, OPTIMUM):
        raise InputError("--prints", wanted=f"names out of {', '.join(PRINTS)}", came=repr(label), todo="correct it")
    return label, int(points or 0), float(noise or 0.0)


def failed_print(case: FamilyCase, name: str, reason: str) -> PrintResult:
    """Return the result of a case that could not be evaluated."""
    return replace(_blank(case, name), error=reason)


def evaluate_prints(case: FamilyCase, rows: tuple[str, ...]) -> list[PrintResult]:
    """Print each test print on the case's printer, learn, plan and print the body's layers."""
    from printmend.printer import read_printer
    from printmend.twin import Twin

    try:
        printer = read_printer(case.printer)
        twin = Twin.of(corruption_of(case), printer)
        body = body_of(case, printer)
    except PrintmendError as error:
        return [failed_print(case, name, str(error)) for name in rows]
    return [_row(case, name, printer, twin, body) for name in rows]


def _row(case: FamilyCase, name: str, printer: Printer, twin: "Twin", body: Body) -> PrintResult:
    from printmend.control.registry import controller
    from printmend.learn.registry import fit
    from printmend.metrics import rmse

    label, points, noise_mm = print_row(name)
    planner = controller(CONTROLLER)
    try:
        begun, measured = time.perf_counter(), 0
        if label == OPTIMUM:
            model: WorldModel = fit("oracle", _nothing(), printer, rng=case.rng(_LEARN), truth=twin.mechanism)
        else:
            trace = measured_print(case, label, points, noise_mm, printer, twin, body)
            begun, measured = time.perf_counter(), int(trace.measured_rows.sum())
            model = fit(LEARNER, trace, printer, rng=case.rng(_LEARN), truth=twin.mechanism)
        learn_s = time.perf_counter() - begun
        prints = [
            twin.run(planner.plan(model, layer.nominal_steps[1:], layer.start_steps).controls, layer.start_steps)
            for layer in body.layers
        ]
    except (PrintmendError, ArithmeticError, ValueError, np.linalg.LinAlgError) as error:
        return failed_print(case, name, f"{type(error).__name__}: {error}")
    targets = np.concatenate([layer.nominal_steps for layer in body.layers])
    return replace(
        _blank(case, name), rmse_steps=rmse(targets, np.concatenate(prints)), measured=measured, learn_s=learn_s
    )


def measured_print(
    case: FamilyCase, label: str, points: int, noise_mm: float, printer: Printer, twin: "Twin", body: Body
) -> Trace:
    """Return the trace of a test print on the case's printer, measured with noise at about ``points`` places."""
    from printmend.bench.drawn_body import drawn_body
    from printmend.bench.print_shapes import (
        SHAPES,
        MeasuredPath,
        body_program,
        designed,
        layer_mm,
        path_print,
    )
    from printmend.probe import design_probe

    noise = case.rng(_NOISE, noise_mm)

    def trace_of(chosen: MeasuredPath) -> Trace:
        printed = twin.follow(chosen.waypoints_mm)
        measured = np.full_like(printed, np.nan)
        measured[chosen.rows] = printed[chosen.rows] + noise.normal(0.0, 1.0, (len(chosen.rows), 2)) * noise_mm
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


def _nothing() -> Trace:
    return Trace(np.zeros((1, 2)), np.zeros((1, 2)))


def _blank(case: FamilyCase, name: str) -> PrintResult:
    label, points, noise_mm = print_row(name)
    return PrintResult(
        key=case.key(name), family=case.family, coverage=case.coverage, sample=case.sample, seed=case.seed,
        test_print=label, points=points, noise_mm=noise_mm,
    )  # fmt: skip
