"""World models of motors that remember more than a play does: several operators, a differential equation, a network.

They have no tables that a planner could read: planners ask `MemoryModel.advance`.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from threadpoolctl import threadpool_limits

from printmend.errors import TraceError
from printmend.learn.mechanism_model import MechanismModel
from printmend.machine import Frame, Mechanism, Transmission, healthy_transmission
from printmend.path import Trace
from printmend.printer import Printer
from printmend.protocols import State
from printmend_lab.peers.rows import MotorRows, chosen, least_squares, motor_rows, ways

# From what a peer found of each motor to a world model: two branches of play, and a frame that may be skewed.

Drive = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""The errors [N] mm of the branches at motor positions [N] mm: pushed forwards, then pushed back."""


def branch_model(trace: Trace, printer: Printer, fit: Callable[[MotorRows], Drive]) -> MechanismModel:
    """Learn each motor by itself with ``fit``, after the skew. Raise `TraceError` where nothing was measured.

    A motor that was hardly measured is taken as designed.
    """
    with threadpool_limits(1, user_api="blas"):  # small systems: a second thread only waits
        rows, skew = deskewed(trace, printer)
        drives = [
            healthy_transmission(printer, motor) if row.is_sparse else transmission(printer, motor, fit(row))
            for motor, row in enumerate(rows)
        ]
    return MechanismModel(Mechanism(printer, (drives[0], drives[1]), skewed_frame(skew)))


def transmission(printer: Printer, motor: int, drive: Drive) -> Transmission:
    """Tabulate a drive: branches that cross meet in their mean, and neither ever falls."""
    healthy = healthy_transmission(printer, motor)
    forwards, back = (healthy.motor_mm + error for error in drive(healthy.motor_mm))
    middle = (forwards + back) / 2
    lower, upper = np.minimum(forwards, middle), np.maximum(back, middle)
    lower, upper = np.maximum.accumulate(lower), np.maximum.accumulate(upper)
    return Transmission(healthy.first_mm, healthy.pitch_mm, lower, upper)


def followed_drive(drive: Drive, rows: MotorRows) -> np.ndarray:
    """Return the error [N] mm of a carriage that the branches of a drive move along the rows' path."""
    lower, upper = (rows.motor_mm + error for error in drive(rows.motor_mm))
    upper = np.maximum(lower, upper)
    out = np.empty(len(lower))
    for path in rows.paths():
        low, high = lower[path].tolist(), upper[path].tolist()
        engaged = 0 if path.start else rows.engaged
        at = ((1 + engaged) * low[0] + (1 - engaged) * high[0]) / 2
        places = []
        for a, b in zip(low, high, strict=True):
            if at < a:  # `min` and `max` take three times as long
                at = a
            elif at > b:
                at = b
            places.append(at)
        out[path] = places
    return np.asarray(out - rows.motor_mm)


def skewed_frame(skew: float) -> Frame:
    """Return the frame x' = x + skew·y."""
    coefficients = np.zeros((2, 10))
    coefficients[0, Frame.exponents.index((0, 1))] = skew * Frame().scale_mm
    return Frame(coefficients)


def deskewed(trace: Trace, printer: Printer) -> tuple[tuple[MotorRows, MotorRows], float]:
    """Return both motors' rows with the skew taken off x, and the skew: the tangent of the angle that is not right.

    All peers share this: owners set the skew apart from everything else (Marlin's M852, Klipper's SET_SKEW). It is
    believed only where it predicts held-out blocks better. A CoreXY's motors both move x and y: its skew is left alone,
    as the scales of its two belts look like one.
    """
    a, b = motor_rows(trace, printer)
    if printer.kinematics != "cartesian" or a.is_sparse or b.is_sparse:
        return (a, b), 0.0

    way, _ = ways(a)  # play would look like skew where a print goes forwards and back at different heights

    def columns(across: bool) -> np.ndarray:
        return np.stack([a.motor_mm, way, *([b.motor_mm] if across else [])], axis=1)

    def fit(rows: MotorRows, across: bool) -> np.ndarray:
        return np.asarray(columns(across) @ least_squares(rows, columns(across)))

    if not chosen(a, (False, True), fit):
        return (a, b), 0.0
    skew = float(least_squares(a, columns(True))[-1])
    stretch = 1 + float(least_squares(b, b.motor_mm[:, None])[0])  # the frame shears by where y is, not by its motor
    return (replace(a, error_mm=a.error_mm - skew * b.motor_mm), b), skew / stretch


class Element(Protocol):
    """One motor with memory. K machines at a time, mm; every row of a batch is what it would be alone."""

    def start(self, motor_mm: float) -> np.ndarray:
        """Return the memory [S] at rest at a place."""
        ...

    def step(self, memory: np.ndarray, from_mm: np.ndarray, to_mm: np.ndarray) -> np.ndarray:
        """Return the memory [K, S] after straight moves [K]; no move changes nothing."""
        ...

    def error_mm(self, memory: np.ndarray, motor_mm: np.ndarray) -> np.ndarray:
        """Return how far the carriage is ahead of its motor [K] mm, but for a constant."""
        ...


@dataclass(frozen=True)
class AsDesigned:
    """A motor without error."""

    def start(self, motor_mm: float) -> np.ndarray:
        return np.zeros(0)

    def step(self, memory: np.ndarray, from_mm: np.ndarray, to_mm: np.ndarray) -> np.ndarray:
        return memory

    def error_mm(self, memory: np.ndarray, motor_mm: np.ndarray) -> np.ndarray:
        return np.zeros(len(motor_mm))


@dataclass(frozen=True, eq=False)
class MemoryModel:
    """Two motors with memory, and the skew between x and y.

    A state's memory is that of either motor, then the layer's start [2] steps and either motor's error there [2] mm.
    """

    printer: Printer
    elements: tuple[Element, Element]
    skew: float = 0.0

    def start(self, start_steps: np.ndarray) -> State:
        """Return the state [1] of a layer that starts at the lattice point ``start_steps`` [2]."""
        start = np.asarray(start_steps, np.int64)
        motors = self._motors_mm(start[None])
        own = [element.start(float(motors[0, k])) for k, element in enumerate(self.elements)]
        errors = [e.error_mm(own[k][None], motors[:, k])[0] for k, e in enumerate(self.elements)]
        memory = np.concatenate([*own, start.astype(float), errors])
        return State(start[None], start[None].astype(float), memory[None])

    def advance(self, state: State, controls: np.ndarray) -> State:
        """Return the states [K] after the controls [K, 2], each a straight move."""
        nominal = state.nominal_steps + np.asarray(controls, np.int64)
        before, after = self._motors_mm(np.broadcast_to(state.nominal_steps, nominal.shape)), self._motors_mm(nominal)
        assert state.memory is not None
        memory = np.broadcast_to(state.memory, (len(nominal), state.memory.shape[1]))
        first = len(self.elements[0].start(0.0))
        own = [memory[:, :first], memory[:, first:-4]]
        own = [e.step(own[k], before[:, k], after[:, k]) for k, e in enumerate(self.elements)]
        errors = [e.error_mm(own[k], after[:, k]) for k, e in enumerate(self.elements)]
        off_mm = self.printer.from_motor(np.stack(errors, axis=1) - memory[:, -2:])
        position = nominal + off_mm / np.array(self.printer.mm_per_step)
        if self.skew:
            along = (position[:, 1] - memory[:, -3]) * (self.printer.mm_per_step[1] / self.printer.mm_per_step[0])
            position[:, 0] += self.skew * along
        return State(nominal, position, np.concatenate([*own, memory[:, -4:]], axis=1))

    def tabulate(self, start_steps: np.ndarray, *, c_max: int = 3) -> None:
        """Return nothing: what these motors remember is no play."""
        return None

    def _motors_mm(self, nominal_steps: np.ndarray) -> np.ndarray:
        printer = self.printer
        corner = np.array([printer.x.min_mm, printer.y.min_mm])
        return np.asarray(printer.to_motor(corner + nominal_steps * np.array(printer.mm_per_step)))


class FitElement(Protocol):
    """Learn one motor from its rows."""

    def __call__(self, rows: MotorRows) -> Element: ...


def memory_model(trace: Trace, printer: Printer, fit: FitElement) -> MemoryModel:
    """Learn each motor by itself with ``fit``, after the skew. Raise `TraceError` where nothing was measured."""
    with threadpool_limits(1, user_api="blas"):  # small systems: a second thread only waits
        rows, skew = deskewed(trace, printer)
        a, b = (AsDesigned() if row.is_sparse else fit(row) for row in rows)
    return MemoryModel(printer, (a, b), skew)


def followed(element: Element, rows: MotorRows) -> np.ndarray:
    """Return the error [N] mm that an element predicts along the rows' path. Raise `TraceError` where it diverges."""
    out = np.empty(len(rows.layer))
    for path in rows.paths():
        motor = rows.motor_mm[path]
        memory = element.start(float(motor[0]))[None]
        out[path.start] = element.error_mm(memory, motor[:1])[0]
        for n in range(1, len(motor)):
            memory = element.step(memory, motor[n - 1 : n], motor[n : n + 1])
            out[path.start + n] = element.error_mm(memory, motor[n : n + 1])[0]
    if not np.isfinite(out).all():
        raise TraceError("trace", wanted="rows that a model can follow", came="one that diverges", todo="measure more")
    return out
