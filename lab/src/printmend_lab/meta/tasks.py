"""Simulated lessons: a broken drive, a random way along it, what would be measured, and what is true.

Half of the drives are those of `sampling.sample`; half are smooth maps with smooth play that are in no family.
"""

from dataclasses import dataclass

import numpy as np

from printmend.corruption import HEALTHY, Corruption
from printmend.machine import Mechanism
from printmend.printer import Printer
from printmend_lab.meta import kernels
from printmend_lab.meta.bayes import Evidence
from printmend_lab.meta.columns import CROSS, GROUPS, columns, groups
from printmend_lab.sampling import sample

FAMILIES = (
    "radius", "eccentric", "ellipse", "polygon", "flat", "fourier", "tabulated", "published", "play", "loose",
    "set-screw", "elastic", "friction", "pulley-play", "pulley-loose", "pulley-set-screw", "everything",
)  # fmt: skip
OUTSIDE = 0.5  # share of drives that are in no family
PLACES_ASKED = 64  # places at which a lesson's answer is compared
PITCH_MM = 0.2  # of the tables of a simulated drive


@dataclass(frozen=True, eq=False)
class DrawnDrive:
    """A drive's branches [M] mm less the motor's place, at even places from ``first_mm`` about the bed's middle."""

    first_mm: float
    lower_mm: np.ndarray
    upper_mm: np.ndarray


@dataclass(frozen=True, eq=False)
class Lesson:
    """What was measured, as evidence, and the truth: ``asked`` [A, C] columns and ``true_mm`` [A]."""

    evidence: Evidence
    asked: np.ndarray
    true_mm: np.ndarray


def reach_of(printer: Printer, motor: int) -> tuple[float, float]:
    """Return how far a motor goes about the bed's middle [mm]."""
    low, high = printer.motor_range_mm(motor)
    return (low - high) / 2, (high - low) / 2


def draw_drive(rng: np.random.Generator, printer: Printer, *, outside: float = OUTSIDE) -> DrawnDrive:
    """Draw a drive of a family, or, as often as ``outside`` says, one of none."""
    low, high = printer.motor_range_mm(0)
    middle = (low + high) / 2
    at = np.arange(low, high + PITCH_MM / 2, PITCH_MM)
    if rng.random() < outside:
        lower, upper = _smooth(rng, at - middle)
    else:
        severity = "damaged" if rng.random() < 0.6 else "realistic"
        broken = HEALTHY if rng.random() < 0.05 else sample(str(rng.choice(FAMILIES)), rng, severity)  # type: ignore[arg-type]
        mechanism = Corruption(broken.drives).lower(printer)  # the frame is drawn with the way
        if not isinstance(mechanism, Mechanism):
            raise TypeError("a gain table is no drive")
        lower, upper = mechanism.transmissions[0].branches_mm(at)
        lower, upper = lower - at, upper - at
    centre = (lower[len(at) // 2] + upper[len(at) // 2]) / 2
    return DrawnDrive(float(at[0] - middle), lower - centre, upper - centre)


def _smooth(rng: np.random.Generator, at_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Draw a smooth map of no family: a slope, two random fields, a wave of any period; and a smooth play."""
    size = 10 ** rng.uniform(-2, 0.2)
    error = rng.normal(0, 0.1 * min(size, 1.0)) * at_mm
    for length_mm in 10 ** rng.uniform(0.8, 2.0, 2):
        error = error + size * rng.uniform(0, 1) * _field(rng, at_mm, length_mm)
    if rng.random() < 0.5:
        period_mm = rng.uniform(15, 90)
        error = error + size * rng.uniform(0, 1) * np.sin(2 * np.pi * at_mm / period_mm + rng.uniform(0, 2 * np.pi))
    play = np.zeros(len(at_mm))
    if rng.random() < 0.7:
        play = 10 ** rng.uniform(-2, 0.3) * np.exp(rng.uniform(0, 0.5) * _field(rng, at_mm, 10 ** rng.uniform(1.2, 2)))
    lower = np.maximum.accumulate(at_mm + error - play / 2) - at_mm
    upper = np.maximum(np.maximum.accumulate(at_mm + error + play / 2) - at_mm, lower)
    return lower, upper


def _field(rng: np.random.Generator, at_mm: np.ndarray, length_mm: float) -> np.ndarray:
    """Draw a smooth random field of unit variance with that correlation length."""
    waves = rng.normal(0, 1 / length_mm, 24)
    return np.asarray(np.sqrt(2 / 24) * np.cos(np.outer(at_mm, waves) + rng.uniform(0, 2 * np.pi, 24)).sum(axis=1))


def draw_lesson(rng: np.random.Generator, drive: DrawnDrive, printer: Printer, *, points: int | None = None) -> Lesson:
    """Print a random way on the drive, measure it, and ask for the branches anywhere that the way went or may go."""
    reach, turn_mm = reach_of(printer, 0), printer.x.mm_per_turn
    motor, other = _way(rng, reach, points or round(10 ** rng.uniform(1.2, 2.8)))
    at, side = np.empty(len(motor), np.int64), np.empty(len(motor), np.int8)
    grid = drive.first_mm + PITCH_MM * np.arange(len(drive.lower_mm))
    lower, upper = grid + drive.lower_mm, grid + drive.upper_mm
    kernels.touches(motor, drive.first_mm, 1 / PITCH_MM, lower, upper, float(motor[0]), at, side)
    known = at >= 0
    if known.sum() < 5:
        return draw_lesson(rng, drive, printer, points=points)
    touched = motor[at[known]]
    branch = np.where(
        side[known] < 0, np.interp(touched, grid, drive.lower_mm), np.interp(touched, grid, drive.upper_mm)
    )
    noise_mm = 0.0 if rng.random() < 0.3 else 10 ** rng.uniform(-2.3, -0.8)
    frame = rng.normal(0, 1, CROSS) * 10 ** rng.uniform(-2, 0.5) if rng.random() < 0.4 else np.zeros(CROSS)
    phi = columns(touched, side[known].astype(float), other[known], turn_mm, reach)
    crossed = groups(reach) == GROUPS.index("cross")
    measured = branch + phi[:, crossed] @ frame + rng.normal(0, noise_mm, len(touched))
    low, high = motor.min(), motor.max()
    if rng.random() < 0.5:  # where the way went, or anywhere
        low, high = max(reach[0], low - 20), min(reach[1], high + 20)
    place = rng.uniform(low, high, PLACES_ASKED)
    sides = rng.choice([-1.0, 1.0], PLACES_ASKED)
    true = np.where(sides < 0, np.interp(place, grid, drive.lower_mm), np.interp(place, grid, drive.upper_mm))
    asked = columns(place, sides, rng.uniform(other.min(), other.max() + 1e-9, PLACES_ASKED), turn_mm, reach)
    return Lesson(
        evidence(phi, measured, np.ones(len(measured)), touched, turn_mm), asked, true + asked[:, crossed] @ frame
    )


def evidence(
    phi: np.ndarray, residual_mm: np.ndarray, weight: np.ndarray, touched_mm: np.ndarray, turn_mm: float
) -> Evidence:
    """Return what is kept of rows: their sums of products, and the share of 64 parts of a turn that they meet."""
    root = np.sqrt(weight)
    heavy = phi * root[:, None]
    parts = np.floor(touched_mm[weight > 0] / turn_mm * 64).astype(np.int64) % 64
    return Evidence(
        heavy.T @ heavy, heavy.T @ (root * residual_mm), float(weight @ residual_mm**2), float(weight.sum()) + 1e-9,
        np.count_nonzero(np.bincount(parts, minlength=64)) / 64,
    )  # fmt: skip


def _way(rng: np.random.Generator, reach_mm: tuple[float, float], points: int) -> tuple[np.ndarray, np.ndarray]:
    """Draw a way of that many measured points, there and back over a span; and the other motor's."""
    span = min(10 ** rng.uniform(0.9, 2.4), reach_mm[1] - reach_mm[0])
    low = rng.uniform(reach_mm[0], reach_mm[1] - span)
    turns = max(2, min(points // 2, round(10 ** rng.uniform(0.3, 1.8))))
    ends: np.ndarray = low + span * rng.random(turns + 1)
    ends[:3] = low, low + span, low
    if rng.random() < 0.4:  # all the way each time
        ends = low + span * (np.arange(turns + 1) % 2)
    if rng.random() < 0.15:  # one way only
        ends = np.sort(ends)
    length = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(ends)) + 1e-9)])
    at = np.union1d(np.linspace(0, length[-1], points), length)
    motor = np.asarray(np.interp(at, length, ends))
    if rng.random() < 0.5:
        motor = np.asarray(np.rint(motor / PITCH_MM) * PITCH_MM)
    other: np.ndarray
    if rng.random() < 0.5:
        other = rng.choice([-1.0, 1.0]) * (motor - low - span / 2) + rng.uniform(-30, 30)
    else:
        other = rng.uniform(-60, 60) + rng.uniform(5, 50) * np.sin(at / rng.uniform(5, 60))
    return motor, other
