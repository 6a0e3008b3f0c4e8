"""World models of three axes: any planar model, and what is known of the Z screw.

The screw does not feel the belts, and its push depends on where it stands, not on how it came there. So a model of
three axes is a planar model and a `ScrewDrive`, and each is learned by itself once the other's share of the measurement
is subtracted.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from printmend.effects import scene_of
from printmend.effects.sized import Sized, pushed_mm, scene_of_printer
from printmend.errors import TraceError
from printmend.infer.fit import FEW, fitted
from printmend.infer.screw import Height, fit_height
from printmend.learn.registry import ORACLE, fit
from printmend.machine import GainMechanism, Mechanism, PlayTables, ScrewDrive, run_motors, z_grid_mm
from printmend.model.branches import ScrewSeries
from printmend.path import Trace
from printmend.printer import Printer
from printmend.protocols import WorldModel
from printmend_lab.protocols import SpaceModel

_MOST_ROUNDS = 3  # how often the planar model and the push are learned in turn, unless the push settles before
_SETTLED_PUSH_MM = 0.003  # a push that changes by less has settled


def fit_space(
    name: str,
    trace: Trace,
    printer: Printer,
    *,
    rng: np.random.Generator,
    truth: Mechanism | GainMechanism | None = None,
) -> SpaceModel:
    """Learn a model of three axes from a print on the lattice, one row a tick, with ``z_mm`` and ``z_measured_mm``.

    ``name`` is a learner's, or ``oracle`` with the truth. Raises `TraceError` where heights are missing; what does not
    tabulate as play (the published trees) learns no screw.
    """
    if name == ORACLE:
        return SpaceModel(fit(name, trace, printer, rng=rng, truth=truth), getattr(truth, "screw", None))
    if trace.z_mm is None or trace.z_measured_mm is None:
        raise TraceError("trace", wanted="commanded and measured heights", came="a trace of two axes", todo="use `fit`")
    if name == "naive":
        return SpaceModel(fit(name, trace, printer, rng=rng))
    taken_mm, pushes = _pushed(trace, _pushes(trace, printer, FEW), printer), None
    for _ in range(_MOST_ROUNDS):
        planar = fit(name, _without_push(trace, taken_mm), printer, rng=rng)
        printed_mm = _planar_mm(planar, trace)
        if printed_mm is None:
            return SpaceModel(planar)
        left = replace(trace, measured_mm=trace.measured_mm - printed_mm + trace.commanded_mm)
        pushes = _pushes(left, printer, ("wobble", "place"))
        before_mm, taken_mm = taken_mm, _pushed(trace, pushes, printer)
        change_mm = taken_mm - before_mm
        if np.abs(change_mm - change_mm.mean(axis=0)).max() < _SETTLED_PUSH_MM:
            break
    assert pushes is not None
    height = fit_height(trace.z_mm, trace.z_measured_mm, printer)
    return SpaceModel(planar, _screw(height, pushes, printer))


def _pushes(trace: Trace, printer: Printer, effects: tuple[str, ...]) -> list[Sized]:
    """Return the screw's push as a trace shows it, beside some effects."""
    scene = scene_of(replace(trace, homed=False), printer)
    fit = fitted(trace, scene, names=effects, quick=True)
    return [part for part in fit.parts() if part.effect == "wobble"]


def _pushed(trace: Trace, pushes: Sequence[Sized], printer: Printer) -> np.ndarray:
    assert trace.z_mm is not None
    return pushed_mm(scene_of_printer(printer), pushes, trace.z_mm)


def _screw(height: Height, pushes: Sequence[Sized], printer: Printer) -> ScrewDrive:
    """Return what was learned as tables; homing or the start of a layer decides where their origin lies."""
    lifts = ScrewSeries(
        printer.z.mm_per_turn, float(height.terms[0]), height.backlash_mm, height.terms[1:], np.zeros((4, 2))
    )
    grid, _, _ = z_grid_mm(printer)
    wobble_mm = pushed_mm(scene_of_printer(printer), pushes, grid)
    return replace(lifts.tables(printer), rest_share=height.rest_share, wobble_mm=wobble_mm)


def _without_push(trace: Trace, push_mm: np.ndarray) -> Trace:
    """Return the planar trace as it would be without the screw's push."""
    return replace(trace, measured_mm=trace.measured_mm - push_mm, z_mm=None, z_measured_mm=None)


def _planar_mm(model: WorldModel, trace: Trace) -> np.ndarray | None:
    """Return where a planar model puts the commanded path [N, 2] mm, from where it starts; None without play tables."""
    printer = model.printer
    low_mm, pitch_mm = np.array([printer.x.min_mm, printer.y.min_mm]), np.array(printer.mm_per_step)
    nominal = np.rint((trace.commanded_mm - low_mm) / pitch_mm).astype(np.int64)
    tables = model.tabulate(nominal[0])
    if not isinstance(tables, PlayTables):
        return None
    moves = np.diff(printer.to_motor(nominal), axis=0)
    return low_mm + tables.bed.printed(run_motors(tables.motors, moves)) * pitch_mm


def space_trace(nominal_steps: np.ndarray, printed_steps: np.ndarray, printer: Printer) -> Trace:
    """Return the trace of a print of three axes on the lattice: nominal and printed [T + 1, 3] full steps."""
    axes = (printer.x, printer.y, printer.z)
    low_mm, pitch_mm = np.array([axis.min_mm for axis in axes]), np.array([axis.mm_per_step for axis in axes])
    commanded_mm, measured_mm = low_mm + nominal_steps * pitch_mm, low_mm + np.asarray(printed_steps) * pitch_mm
    return Trace(commanded_mm[:, :2], measured_mm[:, :2], z_mm=commanded_mm[:, 2], z_measured_mm=measured_mm[:, 2])
