"""From a trace to what the published learners read: one row a tick, in full steps."""

from dataclasses import dataclass

import numpy as np

from printmend.errors import TraceError
from printmend.path import Trace
from printmend.printer import Printer
from printmend_lab.path import Layer

# A way-point this close to the lattice (in steps) is on it: far below a micro-step, far above rounding.
_ON_LATTICE = 1e-6


# A move shorter than this (in steps) says nothing of one step's displacement, only of the measurement's noise.
_SHORTEST = 0.5


@dataclass(frozen=True, eq=False)
class Transitions:
    """N ticks: ``nominal_steps`` [N, 2] before, ``controls`` [N, 2] in {−1, 0, 1}, ``displacement_steps`` [N, 2]."""

    nominal_steps: np.ndarray
    controls: np.ndarray
    displacement_steps: np.ndarray

    def __len__(self) -> int:
        return len(self.nominal_steps)


def transitions_of(trace: Trace, printer: Printer) -> Transitions:
    """Return the ticks of the moves whose two ends were measured, in the order of motion.

    A layer's trace gives back its controls. A longer move is walked on the lattice: its ticks share its measured
    displacement, in proportion. Rows of different layers are not joined: each layer is a print of its own
    (paper §III). Raise `TraceError` where no tick remains.
    """
    low_mm, pitch_mm = np.array([printer.x.min_mm, printer.y.min_mm]), np.array(printer.mm_per_step)
    commanded = (trace.commanded_mm - low_mm) / pitch_mm
    lattice = np.rint(commanded)
    commanded = np.where(np.abs(commanded - lattice) < _ON_LATTICE, lattice, commanded)
    usable = trace.measured_rows[:-1] & trace.measured_rows[1:]
    if trace.layer is not None:
        usable &= trace.layer[:-1] == trace.layer[1:]
    start, moved = commanded[:-1][usable], np.diff(commanded, axis=0)[usable]
    measured = np.diff(trace.measured_mm, axis=0)[usable] / pitch_mm

    ticks = np.maximum(np.ceil(np.abs(moved).max(axis=1, initial=0.0)), 1.0).astype(np.int64)
    move = np.repeat(np.arange(len(ticks)), ticks)
    tick = np.arange(len(move)) - np.repeat(np.cumsum(ticks) - ticks, ticks)
    share = np.stack([tick, tick + 1], axis=1) / ticks[move, None]
    # Halves always up: rounding them to even could skip a lattice point.
    before, after = (np.floor(start[move] + moved[move] * share[:, end, None] + 0.5) for end in range(2))
    controls = after - before
    long = np.abs(moved) >= _SHORTEST
    gain = measured / np.where(long, moved, 1.0)
    rest = np.where(moved == 0.0, measured / ticks[:, None], 0.0)
    displacement = np.where(controls != 0, controls * gain[move], rest[move])
    kept = controls.any(axis=1) & (long[move] | (controls == 0)).all(axis=1)
    if not kept.any():
        raise TraceError(
            "trace",
            wanted="at least one commanded move with both ends measured",
            came=f"{int(trace.measured_rows.sum())} measured rows of {len(trace)}, no two neighbours that move",
            todo="measure neighbouring way-points",
        )
    return Transitions(before[kept], controls[kept], displacement[kept])


def layer_trace(layer: Layer, printed_steps: np.ndarray, printer: Printer) -> Trace:
    """Return the trace of a layer printed by its own controls: one row a tick, ``printed_steps`` [T + 1, 2]."""
    low_mm, pitch_mm = np.array([printer.x.min_mm, printer.y.min_mm]), np.array(printer.mm_per_step)
    return Trace(low_mm + layer.nominal_steps * pitch_mm, low_mm + np.asarray(printed_steps) * pitch_mm)
