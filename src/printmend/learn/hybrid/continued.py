"""Where the motor goes beyond what the print showed: what repeats goes on, what does not stays as it was at the edge.

A pulley that moves the carriage 0.6 mm a millimetre must turn farther than any commanded print has turned it. What was
learned within the stretch is therefore taken apart into what repeats every turn, with its slope, and the rest:

    e(m) = c m + Σ_k a_k cos kφ + b_k sin kφ + r(m)

r is thought to change by small steps and now and then by a large one (a spliced belt, a dent): its increments have
Student's distribution. A smooth r hardly disturbs the rest either, as every angle was seen at several places.
"""

import numpy as np

from printmend.learn.drive.fit import HARMONIC_SD_MM, POWER_SD_MM
from printmend.machine.mechanism import Transmission
from printmend.saved.branches import SCALE_MM, rising
from printmend.units import TURN_RAD

LEAST_TURNS = 1.25  # in less, nothing was seen twice
PITCH_MM = 0.5
HARMONICS = 32
FREEDOM = 4.0
FLOOR_MM = 1e-3  # of an increment
ROUNDS = 30


def continued(table: Transmission, reach_mm: tuple[float, float], turn_mm: float) -> Transmission:
    """Return a drive's tables as they are within ``reach_mm``, and continued beyond it from what they are there."""
    low, high = reach_mm
    if high - low < LEAST_TURNS * turn_mm:
        return table
    motor = table.motor_mm
    mean = motor + _goes_on(motor, (table.lower_mm + table.upper_mm) / 2 - motor, reach_mm, turn_mm, sloped=True)
    play = np.maximum(_goes_on(motor, table.upper_mm - table.lower_mm, reach_mm, turn_mm, sloped=False), 0.0)
    inside, first = (motor >= low) & (motor <= high), int(np.searchsorted(motor, (low + high) / 2))
    lower = rising(np.where(inside, table.lower_mm, mean - play / 2), first)
    upper = rising(np.where(inside, table.upper_mm, mean + play / 2), first)
    return Transmission(table.first_mm, table.pitch_mm, lower, np.maximum(upper, lower))


def _goes_on(
    motor_mm: np.ndarray, error_mm: np.ndarray, reach_mm: tuple[float, float], turn_mm: float, *, sloped: bool
) -> np.ndarray:
    """Return errors [N] as they are within the reach, and beyond it with what repeats of them."""
    inside = np.arange(reach_mm[0], reach_mm[1] + PITCH_MM / 2, PITCH_MM)
    terms = repeating(inside, np.interp(inside, motor_mm, error_mm), turn_mm, sloped=sloped)
    edge = np.clip(motor_mm, *reach_mm)
    errors = np.asarray(np.interp(edge, motor_mm, error_mm))
    beyond = edge != motor_mm
    for edge_mm in reach_mm:
        past = beyond & (edge == edge_mm)
        errors[past] += _evaluated(terms, motor_mm[past], turn_mm, sloped)
        errors[past] -= _evaluated(terms, np.array([edge_mm]), turn_mm, sloped)
    return errors


def _evaluated(terms: np.ndarray, motor_mm: np.ndarray, turn_mm: float, sloped: bool) -> np.ndarray:
    """Return what repeats [N] at motor positions [N], by Horner's rule: one cosine and one sine a place."""
    slope, a, b = terms[0] if sloped else 0.0, terms[-2 * HARMONICS : -HARMONICS], terms[-HARMONICS:]
    angle = np.mod(motor_mm, turn_mm) * (TURN_RAD / turn_mm)
    turn = np.exp(1j * angle)
    total = np.zeros(len(motor_mm), complex)
    for coefficient in (a - 1j * b)[::-1]:
        total = (total + coefficient) * turn
    return np.asarray(slope * motor_mm / SCALE_MM + total.real)


def repeating(motor_mm: np.ndarray, error_mm: np.ndarray, turn_mm: float, *, sloped: bool) -> np.ndarray:
    """Return the terms (c if ``sloped``, a_1 … a_K, b_1 … b_K) of errors [N] at motor positions [N]."""
    design, change = np.diff(_columns(motor_mm, turn_mm, sloped), axis=0), np.diff(error_mm)
    k = np.arange(1, HARMONICS + 1)
    variance = np.tile((HARMONIC_SD_MM * k**-2.5) ** 2, 2)
    if sloped:
        variance = np.concatenate([[POWER_SD_MM["mean"][1] ** 2], variance])
    square = max(float(np.median(np.abs(change))), FLOOR_MM) ** 2
    terms: np.ndarray = np.zeros(len(variance))
    weight = np.ones(len(change))
    for _ in range(ROUNDS):
        scaled = design.T * (weight / square)
        terms = np.linalg.solve(scaled @ design + np.diag(1 / variance), scaled @ change)
        left = np.square(change - design @ terms)
        weight = (FREEDOM + 1) / (FREEDOM + left / square)
        square = max(float(weight @ left) / len(left), FLOOR_MM**2)
    return terms


def _columns(motor_mm: np.ndarray, turn_mm: float, sloped: bool) -> np.ndarray:
    angle = np.outer(np.mod(motor_mm, turn_mm), np.arange(1, HARMONICS + 1)) * (TURN_RAD / turn_mm)
    waves = np.concatenate([np.cos(angle), np.sin(angle)], axis=1)
    return np.concatenate([motor_mm[:, None] / SCALE_MM, waves], axis=1) if sloped else waves
