"""From a trace to what the published learners read: one row a transition, in full steps."""

from dataclasses import dataclass

import numpy as np

from printmend.errors import TraceError
from printmend.path import Layer, Trace
from printmend.printer import Printer

# A way-point this close to the lattice (in steps) is on it: far below a micro-step, far above rounding.
_ON_LATTICE = 1e-6


@dataclass(frozen=True, eq=False)
class Transitions:
    """N measured straight moves.

    ``nominal_steps`` [N, 2]: where the commanded move was when it began a step, on average; for a move of one step
    this is its start, as published. ``controls_steps`` [N, 2]: the commanded displacement of the whole move.
    ``displacement_steps`` [N, 2]: the measured one.
    """

    nominal_steps: np.ndarray
    controls_steps: np.ndarray
    displacement_steps: np.ndarray

    def __len__(self) -> int:
        return len(self.nominal_steps)

    @property
    def signs(self) -> np.ndarray:
        """The direction of each axis [N, 2] in {−1, 0, 1}."""
        return np.sign(self.controls_steps)

    @property
    def unit_displacement_steps(self) -> np.ndarray:
        """The measured displacement [N, 2] of one step of the move; of the whole move where the axis rested."""
        return self.displacement_steps / np.maximum(np.abs(self.controls_steps), 1.0)


def transitions(trace: Trace, printer: Printer) -> Transitions:
    """Return the moves of a trace whose two ends were measured, in the order of motion.

    Rows of different layers are not joined: each layer is a print of its own (paper §III). Moves that command
    nothing are left out. Raise `TraceError` where no move remains.
    """
    low_mm, pitch_mm = np.array([printer.x.min_mm, printer.y.min_mm]), np.array(printer.mm_per_step)
    commanded = (trace.commanded_mm - low_mm) / pitch_mm
    lattice = np.rint(commanded)
    commanded = np.where(np.abs(commanded - lattice) < _ON_LATTICE, lattice, commanded)
    controls = np.diff(commanded, axis=0)
    usable = trace.measured_rows[:-1] & trace.measured_rows[1:] & controls.any(axis=1)
    if trace.layer is not None:
        usable &= trace.layer[:-1] == trace.layer[1:]
    if not usable.any():
        raise TraceError(
            "trace",
            wanted="at least one commanded move with both ends measured",
            came=f"{int(trace.measured_rows.sum())} measured rows of {len(trace)}, none of them neighbours that move",
            todo="measure neighbouring way-points",
        )
    controls = controls[usable]
    # The steps of a move from n start at n, n + s, …, n + s(|c| − 1): their mean is n + s(|c| − 1)/2.
    half = np.sign(controls) * np.maximum(np.abs(controls) - 1.0, 0.0) / 2
    displacement = np.diff(trace.measured_mm, axis=0)[usable] / pitch_mm
    return Transitions(commanded[:-1][usable] + half, controls, displacement)


def layer_trace(layer: Layer, printed_steps: np.ndarray, printer: Printer) -> Trace:
    """Return the trace of a layer printed by its own controls: one row a tick, ``printed_steps`` [T + 1, 2]."""
    low_mm, pitch_mm = np.array([printer.x.min_mm, printer.y.min_mm]), np.array(printer.mm_per_step)
    return Trace(low_mm + layer.nominal_steps * pitch_mm, low_mm + np.asarray(printed_steps) * pitch_mm)
