"""Machines that homed again, or whose belts were put back: all that repeats with their motors' turns sits elsewhere."""

from dataclasses import replace

import numpy as np

from printmend.effects.teeth import TOOTH_MM
from printmend.machine import Mechanism, Transmission
from printmend.printer import Printer

STEPS_A_TURN = 4  # full steps of an electrical turn


def homed_again(mechanism: Mechanism, by_mm: np.ndarray) -> Mechanism:
    """Return a machine whose motors [2] homed ``by_mm`` of belt further on than before."""

    def moved(table: Transmission, by: float) -> Transmission:
        lower, upper = table.branches_mm(table.motor_mm + by)
        return replace(table, lower_mm=lower, upper_mm=upper)

    a, b = (moved(table, float(by)) for table, by in zip(mechanism.transmissions, by_mm, strict=True))
    return replace(mechanism, transmissions=(a, b))


def drawn_shift_mm(
    printer: Printer, rng: np.random.Generator, *, scatter_mm: float = 0.1, wake_ups: float = 0.0
) -> np.ndarray:
    """Draw the shift of both motors [2] by one homing.

    End stops scatter by ``scatter_mm``; in the share ``wake_ups`` of homings a motor stands an electrical turn aside.
    """
    turns = rng.choice((-1.0, 1.0), 2) * (rng.uniform(size=2) < wake_ups)
    turn_mm = STEPS_A_TURN * np.array(printer.mm_per_step)
    return np.asarray(printer.to_motor(scatter_mm * rng.standard_normal(2)) + turn_mm * turns)


def refitted_mm(printer: Printer, rng: np.random.Generator) -> np.ndarray:
    """Draw the shift of both motors [2] by belts that were taken off and put back on any tooth."""
    return np.array([TOOTH_MM * rng.integers(round(axis.mm_per_turn / TOOTH_MM)) for axis in printer.axes[:2]])
