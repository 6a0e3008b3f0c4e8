"""From what a peer found of each motor to a world model: two branches of play, and a frame that may be skewed."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from printmend.learn.mechanism_model import MechanismModel
from printmend.machine import Frame, Mechanism, Transmission, healthy_transmission
from printmend.path import Trace
from printmend.printer import Printer
from printmend_lab.peers.rows import MotorRows, chosen, least_squares, motor_rows, ways

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


def followed(drive: Drive, rows: MotorRows) -> np.ndarray:
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
