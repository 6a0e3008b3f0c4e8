"""How long a motor's turn is: what its printer says, unless the measurement clearly repeats at another length.

A pulley of 16 teeth where the preset has 20 turns every 32 mm, not every 40; an idler or the belt itself has a period
of its own. For each length P on a grid, the error along the belt is fitted with a line, play, both bent along the axis,
and harmonics of P; the likelihood of Gaussian residuals of unknown size, (n/2) log(RSS₀/RSS), is what P gains over the
printer's own turn (the periodogram of least squares: Lomb 1976, Scargle 1982, with more harmonics).
"""

from collections.abc import Callable
from functools import partial

import numpy as np

from printmend.effects.teeth import TOOTH_MM
from printmend.model import SCALE_MM
from printmend.path import last_way
from printmend.units import SIGMA_PER_MEDIAN, TURN_RAD
from printmend_lab.greybox.drive.design import Rows
from printmend_lab.greybox.drive.kernels.periodogram import lengths_left

PERIODS_MM = (12.0, 84.0)  # shortest and longest turn that is tried: 6 and 42 teeth, and no printer's pulley is beyond
HARMONICS, PLAY_HARMONICS = 5, 2  # harmonics of a tried turn, and of how the play changes over it
GRID_TURNS = 0.08  # two lengths that are tried one after the other differ by this share of a turn over the whole span
LEAST_TURNS = 3.0  # turns of a length that the measured span must hold; with fewer nothing is seen to repeat
LEAST_ROWS = 80  # measured rows that are needed to ask; with fewer the printer's own turn stands
MOST_ROWS = 1500  # measured rows that are used at most; more take time and say the same
WEIGHING_ROUNDS = 3  # how often rows far from the fit of the printer's own turn are given less weight
FAR_SIGMAS = 3.0  # a row that many standard deviations from the fit, or more, lies far from it
NO_ERROR_MM = 1e-9  # a row that is off by less fits exactly: traces of exact machines have no other
LEAST_NATS = 30.0  # log likelihood that another length must gain, beyond the logarithm of the number of lengths tried
EDGE_SHARE = 0.93  # a best length above this share of the longest one tried is no turn but a slow bend of the axis
OWN_SHARE = 0.2  # to be given up, the printer's turn explains less than this share of what the other one explains
LEAST_GAIN_MM = 0.015  # root mean square that another length must explain beyond what the printer's turn explains
ALIKE_SHARE = 0.02  # a length within this share of a whole part, or a multiple, of the printer's turn counts as such
NEAR_SHARE = 0.04  # most by which calibrated steps a millimetre make a turn differ from the printer's, as a share
MOST_PARTS = 5  # the turn may be up to this whole part of the best length, of which it then is a harmonic
GUIDES = 2  # waves of guides that are tried in place of a turn: one along either axis
GUIDE_PERIODS_MM = np.geomspace(40.0, 400.0, 120)  # of a guide's wave; a shorter one is no bend, a longer one a frame's
AS_GOOD_NATS = 10.0  # log likelihood that a toothed pulley's turn, or a part of the best length, may lose against it


Lefts = Callable[[np.ndarray], np.ndarray]  # lengths [L] mm → the weighed sums of squares [L] mm² that they leave


def likeliest_period_mm(rows: Rows) -> float:
    """Return the length of a turn [mm]: that of the rows, unless another is far likelier."""
    known = np.flatnonzero(rows.weight > 0)
    known = known[:: max(1, len(known) // MOST_ROWS)]
    if len(known) < LEAST_ROWS:
        return rows.period_mm
    motor, side = rows.motor_mm[known], last_way(rows.motor_mm)[known]
    span_mm = float(np.ptp(motor))  # of what was measured: the way from home shows nothing
    longest = min(span_mm / LEAST_TURNS, PERIODS_MM[1])
    if longest < rows.period_mm:
        return rows.period_mm
    error = rows.measured_mm[known] - motor
    ways = np.stack([last_way(rows.motor_mm + sign * rows.other_mm)[known] for sign in (1, -1)])
    plain = _plain(motor, side, rows.other_mm[known], ways)
    own = np.concatenate([plain, _waves(motor, side, rows.period_mm)])
    weight = _weights(own, error)
    step = GRID_TURNS / span_mm
    tried = 1 / np.arange(1 / longest, 1 / PERIODS_MM[0], step)
    teeth = TOOTH_MM * np.arange(np.ceil(PERIODS_MM[0] / TOOTH_MM), longest / TOOTH_MM)
    tried = np.concatenate([tried, teeth])
    tried = tried[~_divides(tried, rows.period_mm)]
    if not len(tried):  # a screw's turn is a whole part of any length that is tried, or what was measured is too short
        return rows.period_mm

    def lefts(columns: np.ndarray, *, fading: bool = True) -> Lefts:
        fixed, along = np.ascontiguousarray(columns.T), plain[1]

        def left(lengths_mm: np.ndarray) -> np.ndarray:
            out = np.empty(len(lengths_mm))
            lengths_left(lengths_mm, motor, side, along, fixed, error, weight, HARMONICS, PLAY_HARMONICS, fading, out)
            return out

        return left

    left = lefts(plain)
    count, before = float((weight > 0.5).sum()), _of_one(left, rows.period_mm)
    if near := _calibrated(rows.period_mm, step, lefts(plain, fading=False), count, before, weight.sum()):
        return near
    one_left = partial(_of_one, left)
    found = _simplest(sharpened(tried[np.argmin(left(tried))], step, one_left), count, one_left)
    if _divides(np.array([found]), rows.period_mm)[0]:  # the printer's turn has it as a harmonic
        return rows.period_mm
    after = one_left(found)
    both = _of_one(lefts(own), found)
    if after - both > OWN_SHARE * (before - both):  # the printer's own turn is there, and something else beside it
        return rows.period_mm
    if found > EDGE_SHARE * longest:  # the longest is the best where nothing repeats
        return rows.period_mm
    if (
        count / 2 * np.log(_guides_left(motor, rows.other_mm[known], side, plain, error, weight) / max(after, 1e-12))
        < AS_GOOD_NATS
    ):
        return rows.period_mm
    nats = count / 2 * np.log(before / max(after, 1e-12)) - np.log(len(tried))
    explained_mm = np.sqrt(max(before - after, 0.0) / weight.sum())
    return float(found) if nats > LEAST_NATS and explained_mm > LEAST_GAIN_MM else rows.period_mm


def _guides_left(
    motor: np.ndarray, other: np.ndarray, side: np.ndarray, plain: np.ndarray, error: np.ndarray, weight: np.ndarray
) -> float:
    """Return what the best waves of guides leave, which push one axis along the other, on a CoreXY both motors.

    On a lattice of dots a guide's wave looks like a short turn of the motors, because a motor's place tells the column.
    """
    fixed = plain
    for _ in range(GUIDES):
        tried = []
        for place in (other, (motor + other) / 2, (motor - other) / 2):
            out = np.empty(len(GUIDE_PERIODS_MM))
            lengths_left(
                GUIDE_PERIODS_MM, np.ascontiguousarray(place), side, plain[1], np.ascontiguousarray(fixed.T), error,
                weight, 1, 0, False, out,
            )  # fmt: skip
            best = int(np.argmin(out))
            tried.append((float(out[best]), place * (TURN_RAD / GUIDE_PERIODS_MM[best])))
        left, angle = min(tried, key=lambda each: each[0])
        fixed = np.concatenate([fixed, [np.cos(angle), np.sin(angle)]])
    return left


def _divides(lengths_mm: np.ndarray, period_mm: float) -> np.ndarray:
    """Say which lengths [L] are a whole part of a turn, or a multiple of it."""
    ratio = np.maximum(lengths_mm, period_mm) / np.minimum(lengths_mm, period_mm)
    return np.asarray(np.abs(ratio / np.rint(ratio) - 1) <= ALIKE_SHARE)


def _calibrated(
    period_mm: float, step: float, left_still: Lefts, count: float, before: float, weight: float
) -> float | None:
    """Return a turn that differs little from the printer's, where it alone explains what else a wave that fades would.

    ``left_still`` is what the waves of a length leave that do not fade along the belt, ``before`` what those of the
    printer's turn leave that do: to first order, a wave of another length is one that fades.
    """
    tried = 1 / np.arange(1 / (period_mm * (1 + NEAR_SHARE)), 1 / (period_mm * (1 - NEAR_SHARE)), step / 4)
    at = int(np.argmin(left_still(tried)))
    if at in (0, len(tried) - 1):  # the best may be beyond: another pulley, not other steps a millimetre
        return None
    found = sharpened(tried[at], step / 4, partial(_of_one, left_still))
    plain, after = left_still(np.array([period_mm, found])).tolist()
    nats = count / 2 * np.log(plain / after) - np.log(len(tried))
    gained_mm = np.sqrt(max(plain - after, 0.0) / weight)
    as_good = count / 2 * np.log(after / before) < AS_GOOD_NATS
    return float(found) if nats > LEAST_NATS and gained_mm > LEAST_GAIN_MM and as_good else None


def _simplest(period_mm: float, count: float, left: Callable[[float], float]) -> float:
    """Return the shortest whole part of a length, and of these a whole number of teeth, that is as good."""
    best = left(period_mm)
    for part in range(MOST_PARTS, 0, -1):
        length = period_mm / part
        toothed = TOOTH_MM * round(length / TOOTH_MM)
        for one in (toothed, length):
            if one >= PERIODS_MM[0] and count / 2 * np.log(left(one) / best) < AS_GOOD_NATS:
                return float(one)
    return period_mm


def _plain(motor: np.ndarray, side: np.ndarray, other: np.ndarray, ways: np.ndarray) -> np.ndarray:
    """Return columns as rows [12, N] of what repeats nothing: offset, scale, bend, play, play that grows, skew, and the
    play and racking of a CoreXY's rails; ``ways`` [2, N] is which way both motors' sum and difference last went."""
    x, y = (motor - motor.mean()) / SCALE_MM, other / SCALE_MM
    racked = (*ways, ways[0] * (x - y), ways[1] * (x + y))
    return np.stack([np.ones(len(x)), x, x**2, x**3, side, side * x, y, x * y, *racked])


def _waves(motor: np.ndarray, side: np.ndarray, period_mm: float) -> np.ndarray:
    """Return the harmonics of a turn, of its play, and the first one as it fades along an elastic belt [Q, N]."""
    turn = np.exp(motor * (1j * TURN_RAD / period_mm))
    waves = np.cumprod(np.broadcast_to(turn, (HARMONICS, len(turn))), axis=0)
    parts = [waves, waves[:PLAY_HARMONICS] * side, waves[:1] * ((motor - motor.mean()) / SCALE_MM)]
    return np.concatenate([*(part.real for part in parts), *(part.imag for part in parts)])


def _weights(columns: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Return 1 for rows [N] near the fit of the printer's own turn, less for those that lie far off.

    ``columns`` are [P, N].
    """
    weight = np.ones(len(error))
    for _ in range(WEIGHING_ROUNDS):
        root = np.sqrt(weight)
        fit = np.linalg.lstsq((columns * root).T, error * root, rcond=None)[0] @ columns
        away = np.abs(error - fit)
        far = max(FAR_SIGMAS * SIGMA_PER_MEDIAN * float(np.median(away)), NO_ERROR_MM)
        weight = np.minimum(1.0, far / np.maximum(away, NO_ERROR_MM)) ** 2
    return weight


def _of_one(left: Lefts, period_mm: float) -> float:
    return float(left(np.array([period_mm]))[0])


def sharpened(period_mm: float, step: float, left: Callable[[float], float]) -> float:
    """Return the best length near one of the grid, by ever finer steps of its inverse."""
    best = 1 / period_mm
    for _ in range(6):
        step /= 3
        best = min((best + shift * step for shift in (-2, -1, 0, 1, 2)), key=lambda inverse: left(1 / inverse))
    return 1 / best
