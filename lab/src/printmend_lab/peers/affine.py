"""Skew and scale: what Klipper and Marlin can be told of a crooked machine.

The steps a millimetre of each axis (Marlin M92, Klipper rotation_distance) and one angle between x and y (Marlin M852,
Klipper skew_correction: https://www.klipper3d.org/Skew_Correction.html), here by least squares over all points instead
of three lengths with callipers.
"""

from dataclasses import dataclass

import numpy as np

from printmend.learn.mechanism_model import MechanismModel
from printmend.path import Trace
from printmend.printer import Printer
from printmend_lab.peers.branches import Drive, branch_model
from printmend_lab.peers.rows import MotorRows, least_squares


def scale_drive(rows: MotorRows) -> Drive:
    """Return the drive of one scale error: u = (1 + e)·m."""
    error = float(least_squares(rows, rows.motor_mm[:, None])[0])
    error = max(error, -0.9)  # nothing drives backwards
    return lambda motor_mm: (error * motor_mm, error * motor_mm)


@dataclass(frozen=True)
class Affine:
    """Scale each axis and the angle between them; no play, nothing that repeats."""

    name: str = "affine"

    def fit(self, trace: Trace, printer: Printer, *, rng: np.random.Generator) -> MechanismModel:
        """Learn from a trace. Raise `TraceError` where nothing that moved was measured."""
        return branch_model(trace, printer, scale_drive)


LEARNERS = {"affine": Affine()}
