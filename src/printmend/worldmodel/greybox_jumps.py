"""Teeth skipped and steps missed within a trace: found as wild increments, snapped, taken out.

A skipped tooth moves the belt by 10 full steps from then on, a missed electrical turn the motor by 4 (physics.md
eq. 11). They say nothing of the next print, but would bend every part of a model that is fitted across them. The
increments from one measured row to the next feel a jump once only: fitted to them, robustly, a model is hardly bent.
"""

from dataclasses import dataclass, replace

import numpy as np

from printmend.printer import Axis
from printmend.worldmodel.greybox_design import Design, Rows, contacts
from printmend.worldmodel.greybox_fit import Prior, variances
from printmend.worldmodel.greybox_select import COARSE_HARMONICS, Choice, Structure, search

TOOTH_STEPS, MISSED_STEPS = 10, 4
STARTS_MM = (0.0, 0.5, 2.0)
PASSES, FEW_PASSES = 10, 3
SUSPECTS = 10
CALMER = 0.4  # one jump must calm at least this share of one wild increment
WILD = 0.35  # of the smallest jump
CALM = 5.0  # standard deviations of the other increments
# Teeth and missed turns between two measured rows, the fewest first.
COMBINATIONS = sorted(
    ((a, b) for a in range(-2, 3) for b in range(-2, 3) if 0 < abs(a) + abs(b) < 4),
    key=lambda ab: abs(ab[0]) + abs(ab[1]),
)
NEAR_TOOTH, NEAR_STEP = 0.2, 0.35  # how far from its size a jump may seem, of a missed turn
BETTER = 0.6  # the whole trace must fit that much better without the jumps
MOST = 64
SOFT_MM = 0.05  # a finer sieve would throw out what the contacts, not yet known, still put in the wrong place
WORTH_A_LOOK_MM = 0.05


@dataclass(frozen=True)
class Jump:
    """From ``row`` on, the ``belt`` (a skipped tooth) or the motor (missed steps) is off by ``size_mm``."""

    row: int
    belt: bool
    size_mm: float


def jumped(rows: Rows, jumps: tuple[Jump, ...]) -> Rows:
    """Return the rows as they would be without the jumps."""
    motor, measured = rows.motor_mm.copy(), rows.measured_mm.copy()
    for jump in jumps:
        if jump.belt:
            measured[jump.row :] -= jump.size_mm
        else:
            motor[jump.row :] += jump.size_mm
    return replace(rows, motor_mm=motor, measured_mm=measured) if jumps else rows


def find_jumps(rows: Rows, found: Choice, axis: Axis) -> tuple[tuple[Jump, ...], Choice]:
    """Return the jumps of one motor's rows and the search's fit without them; none where they explain too little.

    One at a time, the one that calms the increments most: a loss of steps turns the pulley for all that follows, so
    what comes later is seen clearly only once it is taken out.
    """
    if found.fit.loss_mm < WORTH_A_LOOK_MM or int((rows.weight > 0).sum()) < 4 * COARSE_HARMONICS:
        return (), found
    design = Structure(play="free").design(COARSE_HARMONICS, ())
    least_mm = WILD * MISSED_STEPS * axis.mm_per_step
    starts = [_increments(rows, design, _started(design, play_mm), least_mm, PASSES) for play_mm in STARTS_MM]
    best = min(starts, key=lambda fit: fit.loss_mm)
    jumps: tuple[Jump, ...] = ()
    while len(jumps) < MOST:
        tried = [
            ((*jumps, *more), _increments(jumped(rows, (*jumps, *more)), design, best.values, least_mm, FEW_PASSES))
            for more in _suspects(rows, best, axis)
        ]
        if not tried:
            break
        more, fit = min(tried, key=lambda pair: pair[1].loss_mm)
        if fit.loss_mm > best.loss_mm - CALMER * least_mm / len(best.left_mm):
            break
        jumps, best = more, fit
    if not jumps:
        return (), found
    jumps = tuple(sorted(jumps, key=lambda jump: jump.row))
    again = search(jumped(rows, jumps))
    return (jumps, again) if again.fit.loss_mm < BETTER * found.fit.loss_mm else ((), found)


@dataclass(frozen=True, eq=False)
class Increments:
    """A robust fit of the increments: its parameters [P], what it leaves of them [M − 1], and the mean of that, each
    cut at the least that a jump shows."""

    values: np.ndarray
    left_mm: np.ndarray
    loss_mm: float
    gain: float


def _suspects(rows: Rows, fit: Increments, axis: Axis) -> list[tuple[Jump, ...]]:
    """Return what may have happened at the wildest increments, each the simplest jumps of its size."""
    measured = np.flatnonzero(rows.weight > 0)
    step, tooth = MISSED_STEPS * axis.mm_per_step, TOOTH_STEPS * axis.mm_per_step
    size = np.abs(fit.left_mm)
    wild = np.flatnonzero(size > max(WILD * step, CALM * 1.4826 * float(np.median(size))))
    wild = wild[np.argsort(-size[wild], kind="stable")][:SUSPECTS]
    suspects = []
    for i in wild:
        row, options = int(measured[i]) + 1, 0
        for teeth, missed in COMBINATIONS:
            away = abs(fit.left_mm[i] - teeth * tooth - missed * step * fit.gain)
            # pulleys turn the same loss of angle into more or less than the mean
            if away < (NEAR_TOOTH + NEAR_STEP * fit.gain * abs(missed)) * step and options < 2:
                options += 1
                belt, motor = Jump(row, True, teeth * tooth), Jump(row, False, missed * step)
                suspects.append((belt,) * (teeth != 0) + (motor,) * (missed != 0))
    return suspects


def _started(design: Design, play_mm: float) -> np.ndarray:
    values = np.zeros(design.size)
    values[design.parts["play_powers"]] = play_mm
    return values


def _increments(rows: Rows, design: Design, values: np.ndarray, least_mm: float, passes: int) -> Increments:
    """Fit the measured increments robustly, from parameters [P]."""
    measured = np.flatnonzero(rows.weight > 0)
    precision = np.diag(1.0 / variances(design, Prior()))
    left = np.zeros(len(measured) - 1)
    for _ in range(passes):
        touch = contacts(design, values, rows)
        at, side = touch.at[measured], touch.side[measured]
        mean, play = design.columns(rows.motor_mm[np.maximum(at, 0)], rows.period_mm, rows.origin_mm)
        columns = (mean + side[:, None] / 2 * play) * (at >= 0)[:, None]
        columns[:, design.parts["cross"]] = rows.other_mm[measured, None] / 100.0
        columns[:, design.parts["start"]] = (at < 0)[:, None]
        steps = np.diff(columns, axis=0)
        wanted = np.diff(touch.residual_mm[measured]) + steps @ values
        for _ in range(3):
            left = wanted - steps @ values
            sigma = max(1.4826 * float(np.median(np.abs(left))), SOFT_MM)
            weight = 1.0 / (1.0 + np.square(left / (2 * sigma)))  # Cauchy: a jump counts for next to nothing
            matrix = (steps * weight[:, None]).T @ steps / sigma**2
            values = np.linalg.solve(matrix + precision, (steps.T @ (weight * wanted)) / sigma**2)
        left = wanted - steps @ values
    loss = float(np.minimum(np.abs(left), least_mm).mean())
    return Increments(values, left, loss, 1.0 + float(values[design.parts["mean_powers"]][1]) / 100.0)
