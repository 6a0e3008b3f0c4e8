"""The variance of what the residuals of a fit hold beyond white noise: a pattern that no part of the model follows.

White noise averages out over a block of L rows, a pattern longer than that does not: with c₀ = mean r² and block means
r̄, s² = (L mean r̄² − c₀)/(L − 1) estimates the variance of the pattern, and has the standard deviation
c₀ √(2 L/N)/(L − 1) where there is none. A pattern may follow time, the place, the motor's angle or the other axis,
and differ with the side of the belt that is touched: rows are put in each of these orders. What a machine draws anew
at each mark is white as measuring is: only an instrument that says how far it scatters itself tells the two apart, and
then dots whose plastic ran unevenly scatter, too, though the machine stood right.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from printmend.identify.drive import Rows
from printmend.identify.drive.fit import robust_sigma_mm

BLOCK_ROWS = (2, 4, 8, 16, 32)  # tried block lengths L [rows]
USUAL_BLOCK_ROWS = 24  # assumed length [rows] of a pattern that is too small to be seen
LEAST_BLOCKS = 6  # an estimate needs so many blocks of rows at least
# By how many standard deviations an estimate must exceed 0: many, for the largest of some thirty estimates is taken.
SURE_SIGMAS = 4.5
OUTLIER_SIGMAS = 4.0  # residuals beyond so many standard deviations are outliers
# Factor by which the scatter may exceed what the instrument states before the excess is the printer's own. The coarsest
# scans come to 1.5.
DOUBTED_SCATTER = 2.0


@dataclass(frozen=True)
class Unexplained:
    """A pattern's variance [mm²] along one motor, and the standard deviation of that estimate."""

    variance_mm2: float
    sd_mm2: float


def unexplained(rows: Rows, residual_mm: np.ndarray, side: np.ndarray, scatter_mm: float | None = None) -> Unexplained:
    """Return the largest pattern in residuals [N] mm, NaN where nothing was measured.

    ``side`` [N] is the side of the belt that is touched. ``scatter_mm`` is the standard deviation along the motor that
    the instrument states, None where it states none; where the residuals scatter far more, a share of that counts.
    """
    known = np.flatnonzero((rows.weight > 0) & np.isfinite(residual_mm))
    residual = residual_mm[known]
    if len(residual) < 2 * LEAST_BLOCKS:
        return Unexplained(0.0, float(np.mean(residual**2)) if len(residual) else 0.0)
    most = OUTLIER_SIGMAS * robust_sigma_mm(residual)
    residual = np.clip(residual, -most, most)
    whole = float(np.mean(residual**2))
    least = Unexplained(0.0, _sd(whole, USUAL_BLOCK_ROWS, len(residual)))
    found = [least]
    if scatter_mm is not None:
        beyond, sd = whole - (DOUBTED_SCATTER * scatter_mm) ** 2, whole * float(np.sqrt(2 / len(residual)))
        # at even odds all of it is the dots' own, or any share of it is the printer's
        found += [Unexplained(beyond / 4, beyond * (5 / 48) ** 0.5)] if beyond > SURE_SIGMAS * sd else []
    for order in _orders(rows, side, known):
        ordered = residual[order]
        for length in BLOCK_ROWS:
            count = len(ordered) // length
            if count < LEAST_BLOCKS:
                break
            means = ordered[: count * length].reshape(count, length).mean(axis=1)
            variance = (length * float(np.mean(means**2)) - whole) / (length - 1)
            sd = _sd(whole, length, len(ordered))
            if variance > SURE_SIGMAS * sd:
                found.append(Unexplained(min(variance, whole), sd))
    return max(found, key=lambda each: each.variance_mm2)


def _sd(whole_mm2: float, length: int, count: int) -> float:
    return whole_mm2 * float(np.sqrt(2 * length / count)) / (length - 1)


def _orders(rows: Rows, side: np.ndarray, known: np.ndarray) -> Iterator[np.ndarray]:
    """Yield the orders of the rows in which a pattern may show."""
    yield np.arange(len(known))
    touched, motor = side[known], rows.motor_mm[known]
    own, other = rows.own_mm[known], rows.other_mm[known]
    # of a CoreXY, sum and difference of both belts are the bed's axes
    keys = (np.arange(len(known)), motor, np.mod(motor, rows.period_mm), other, own + other, own - other)
    for key in keys:
        yield np.lexsort((key, touched))
