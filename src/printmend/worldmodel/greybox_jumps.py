"""Teeth skipped and steps missed within a trace: models that jumps hardly bend, and what each makes of the jumps.

A skipped tooth moves the belt by 10 full steps from then on, a missed electrical turn the motor by 4 (physics.md
eq. 11). They say nothing of the next print, but would bend every part of a model that is fitted across them. The
increments from one measured row to the next feel a jump once only: fitted to them, robustly, a model is hardly bent.
From there the jumps follow (`greybox_ladder`), from them a better model, and so on.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from printmend.printer import Axis
from printmend.worldmodel.greybox_design import Design, Rows, contacts
from printmend.worldmodel.greybox_fit import Prior, variances
from printmend.worldmodel.greybox_ladder import MISSED_STEPS, TOOTH_STEPS, Jump, climbed, jumped
from printmend.worldmodel.greybox_select import COARSE_HARMONICS, WARPS_MM, Choice, Structure, search

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
ROUNDS = 4
SPARSE = 25  # measured rows for each jump: more frequent ones imitate something else
WHITE = 0.4  # a larger share of independent residuals leaves no room for jumps
SOFT_MM = 0.05  # a finer sieve would throw out what the contacts, not yet known, still put in the wrong place
WORTH_A_LOOK_MM = 0.05


def find_jumps(rows: Rows, found: Choice, axis: Axis) -> tuple[tuple[Jump, ...], Choice]:
    """Return the jumps of one motor's rows and the search's fit without them; none where they explain too little."""
    calm = found.fit.loss_mm < WORTH_A_LOOK_MM or found.fit.share > WHITE
    if calm or int((rows.weight > 0).sum()) < 4 * COARSE_HARMONICS:
        return (), found
    best: tuple[tuple[Jump, ...], Choice] = (), found
    for model in _beliefs(rows, found, axis):
        best = _climbed(rows, model, best, axis)
        if best[1].fit.loss_mm < WORTH_A_LOOK_MM or (best[0] and best[1].fit.share > WHITE):
            break
    return best if best[1].fit.loss_mm < BETTER * found.fit.loss_mm else ((), found)


def _beliefs(rows: Rows, found: Choice, axis: Axis) -> Iterator[Choice]:
    """Return models to start from, the likeliest first: fitted to increments, healthy, with jumps taken out one by
    one, uneven."""
    least_mm = WILD * MISSED_STEPS * axis.mm_per_step
    plain, uneven = Structure(play="free"), Structure(play="free", warp_mm=WARPS_MM[1])
    design = plain.design(COARSE_HARMONICS, ())
    calm = _calm(rows, design, least_mm)
    if np.abs(calm.left_mm).max(initial=0.0) < least_mm:  # a jump shows in an increment, whatever else a model lacks
        return
    yield _believed(found, plain, design, calm.values)
    yield _believed(found, plain, design, np.zeros(design.size))
    if jumps := _calmed(rows, design, calm, axis):
        yield search(jumped(rows, jumps))
    design = uneven.design(COARSE_HARMONICS, (), rows.reach_mm)
    yield _believed(found, uneven, design, _calm(rows, design, least_mm).values)


def _believed(found: Choice, structure: Structure, design: Design, values: np.ndarray) -> Choice:
    """Return a model of given parameters [P]."""
    posterior = replace(found.fit.posterior, values=values)
    return Choice(structure, design, replace(found.fit, posterior=posterior))


def _climbed(
    rows: Rows, model: Choice, best: tuple[tuple[Jump, ...], Choice], axis: Axis
) -> tuple[tuple[Jump, ...], Choice]:
    """Find the jumps under a model, then the model without them, and so on while it fits better; return the best."""
    taken: tuple[Jump, ...] = ()
    for _ in range(ROUNDS):
        more = climbed(rows, model, axis)
        if not more or more == taken or len(more) * SPARSE > int((rows.weight > 0).sum()):
            break
        taken, model = more, search(jumped(rows, more))
        if model.fit.loss_mm >= best[1].fit.loss_mm:
            break
        best = taken, model
    return best


def _calm(rows: Rows, design: Design, least_mm: float) -> "Increments":
    starts = [_increments(rows, design, _started(design, play_mm), least_mm, PASSES) for play_mm in STARTS_MM]
    return min(starts, key=lambda fit: fit.loss_mm)


def _calmed(rows: Rows, design: Design, best: "Increments", axis: Axis) -> tuple[Jump, ...]:
    """Return the jumps that calm the increments most, taken out one at a time: a loss of steps turns the pulley for
    all that follows, so what comes later is seen clearly only once it is taken out."""
    least_mm = WILD * MISSED_STEPS * axis.mm_per_step
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
    return tuple(sorted(jumps, key=lambda jump: jump.row))


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
