"""Continue learned tables beyond the stretch that the print showed.

A weak pulley, which moves the carriage by 0.6 mm a commanded millimetre, must turn farther than any print has turned
it. So the error that was learned within the stretch is split into a slope, what repeats every turn, and the rest:

    e(m) = c m + Σ_k a_k cos kφ + b_k sin kφ + r(m)

Beyond the stretch slope and harmonics go on, and r stays as it was at the edge. r is thought to change by small steps
and rarely by a large one (a spliced belt, a dent): its increments have Student's distribution. A smooth r hardly
disturbs the fit of the rest, because every angle was seen at several places.
"""

import numpy as np

from printmend.machine import Transmission
from printmend.model.branches import SCALE_MM, rising
from printmend.units import TURN_RAD
from printmend_lab.greybox.drive.fit import HARMONIC_SD_MM, POWER_SD_MM

LEAST_TURNS = 1.25  # a shorter stretch shows too little twice to tell what repeats
SAMPLE_MM = 0.5  # places at which the error is sampled
HARMONICS = 32  # as many as the grey box has
STUDENT_FREEDOM = 4.0  # degrees of freedom of Student's distribution, the usual choice for robust fits
LEAST_INCREMENT_MM = 1e-3  # smallest scale of an increment
REWEIGHTINGS = 30  # rounds of reweighted least squares; the terms hardly change after ten


def continued(table: Transmission, reach_mm: tuple[float, float], turn_mm: float) -> Transmission:
    """Return a drive's tables, unchanged within ``reach_mm`` and continued beyond it."""
    low, high = reach_mm
    if high - low < LEAST_TURNS * turn_mm:
        return table
    motor = table.motor_mm
    mean = motor + _continued_mm(motor, (table.lower_mm + table.upper_mm) / 2 - motor, reach_mm, turn_mm, sloped=True)
    play = np.maximum(_continued_mm(motor, table.upper_mm - table.lower_mm, reach_mm, turn_mm, sloped=False), 0.0)
    inside, first = (motor >= low) & (motor <= high), int(np.searchsorted(motor, (low + high) / 2))
    lower = rising(np.where(inside, table.lower_mm, mean - play / 2), first)
    upper = rising(np.where(inside, table.upper_mm, mean + play / 2), first)
    return Transmission(table.first_mm, table.pitch_mm, lower, np.maximum(upper, lower))


def _continued_mm(
    motor_mm: np.ndarray, error_mm: np.ndarray, reach_mm: tuple[float, float], turn_mm: float, *, sloped: bool
) -> np.ndarray:
    """Return errors [N], unchanged within the reach; beyond it their slope (if ``sloped``) and harmonics go on."""
    inside = np.arange(reach_mm[0], reach_mm[1] + SAMPLE_MM / 2, SAMPLE_MM)
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
    """Return slope and harmonics [N] at motor positions [N], by Horner's rule: one cosine and one sine a place."""
    slope, a, b = terms[0] if sloped else 0.0, terms[-2 * HARMONICS : -HARMONICS], terms[-HARMONICS:]
    angle = np.mod(motor_mm, turn_mm) * (TURN_RAD / turn_mm)
    turn = np.exp(1j * angle)
    total = np.zeros(len(motor_mm), complex)
    for coefficient in (a - 1j * b)[::-1]:
        total = (total + coefficient) * turn
    return np.asarray(slope * motor_mm / SCALE_MM + total.real)


def repeating(motor_mm: np.ndarray, error_mm: np.ndarray, turn_mm: float, *, sloped: bool) -> np.ndarray:
    """Return the terms (c if ``sloped``, a_1 … a_K, b_1 … b_K) that fit errors [N] at motor positions [N]."""
    design, change = np.diff(_columns(motor_mm, turn_mm, sloped), axis=0), np.diff(error_mm)
    k = np.arange(1, HARMONICS + 1)
    variance = np.tile((HARMONIC_SD_MM * k**-2.5) ** 2, 2)
    if sloped:
        variance = np.concatenate([[POWER_SD_MM["mean"][1] ** 2], variance])
    square = max(float(np.median(np.abs(change))), LEAST_INCREMENT_MM) ** 2
    terms: np.ndarray = np.zeros(len(variance))
    weight = np.ones(len(change))
    for _ in range(REWEIGHTINGS):
        scaled = design.T * (weight / square)
        terms = np.linalg.solve(scaled @ design + np.diag(1 / variance), scaled @ change)
        left = np.square(change - design @ terms)
        weight = (STUDENT_FREEDOM + 1) / (STUDENT_FREEDOM + left / square)
        square = max(float(weight @ left) / len(left), LEAST_INCREMENT_MM**2)
    return terms


def _columns(motor_mm: np.ndarray, turn_mm: float, sloped: bool) -> np.ndarray:
    angle = np.outer(np.mod(motor_mm, turn_mm), np.arange(1, HARMONICS + 1)) * (TURN_RAD / turn_mm)
    waves = np.concatenate([np.cos(angle), np.sin(angle)], axis=1)
    return np.concatenate([motor_mm[:, None] / SCALE_MM, waves], axis=1) if sloped else waves
