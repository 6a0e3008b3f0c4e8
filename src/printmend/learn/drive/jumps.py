"""Teeth skipped and steps missed within a trace: models that jumps hardly bend, and what each makes of the jumps.

A skipped tooth moves the belt by 10 full steps from then on, a missed electrical turn the motor by 4 (physics.md
eq. 11). They say nothing of the next print, but would bend every part of a model that is fitted across them. The
increments from one measured row to the next feel a jump once only: fitted to them, robustly, a model is hardly bent.
From there the jumps follow (`ladder`), from them a better model, and so on.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from printmend.learn.drive.design import Contacts, Design, Rows, contacts
from printmend.learn.drive.fit import Prior, variances
from printmend.learn.drive.ladder import MISSED_STEPS, TOOTH_STEPS, Jump, climbed, jumped, lasting
from printmend.learn.drive.select import COARSE_HARMONICS, WARPS_MM, Choice, Structure, search
from printmend.printer import Axis

STARTS_MM = (0.0, 0.5, 2.0)
PASSES, FEW_PASSES = 10, 3
SUSPECTS = 10
MOST_STEPS = 10
LOCAL_ROOM = 4.0  # a step that the columns can hardly tell from themselves
MORE_JUMPS_MM = 0.2  # by so much another jump at one place must come nearer to its size
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
BETTER_WHITE = 0.9  # where they explain all but noise
MOST = 64
ROUNDS = 4
MOST_SEARCHES = 8  # of models in all: where there are jumps, the first few show them
MOST_FITTED = 600_000  # rows in all, for increments: the same
SPARSE = 25  # measured rows for each jump: more frequent ones imitate something else
WHITE = 0.4  # a larger share of independent residuals leaves no room for jumps
SOFT_MM = 0.05  # a finer sieve would throw out what the contacts, not yet known, still put in the wrong place
CALM_MM = 0.02  # without jumps, or with so small ones that they do no harm
WORTH_MORE_MM = 0.05  # less is not worth the slower beliefs

Believed = tuple[tuple[Jump, ...], Choice]


@dataclass
class Effort:
    """What may still be spent on one motor's jumps: whatever was measured, the search ends, always the same."""

    searches: int = MOST_SEARCHES
    rows: int = MOST_FITTED

    @property
    def is_spent(self) -> bool:
        return self.searches <= 0 or self.rows <= 0

    def search(self, rows: Rows) -> Choice:
        """Return the best model of rows."""
        self.searches -= 1
        return search(rows)


def find_jumps(rows: Rows, found: Choice, axis: Axis) -> Believed:
    """Return the jumps of one motor's rows and the search's fit without them; none where they explain too little."""
    calm = found.fit.loss_mm < CALM_MM or found.fit.share > WHITE
    if calm or int((rows.weight > 0).sum()) < 4 * COARSE_HARMONICS:
        return (), found
    best: Believed = (), found
    effort = Effort()
    for belief in _beliefs(rows, found, axis, effort):
        best = _climbed(rows, belief, best, axis, effort)
        if effort.is_spent or best[1].fit.loss_mm < WORTH_MORE_MM or (best[0] and best[1].fit.share > WHITE):
            break
    least = BETTER_WHITE if best[1].fit.share > WHITE else BETTER
    return best if best[1].fit.loss_mm < least * found.fit.loss_mm else ((), found)


def _beliefs(rows: Rows, found: Choice, axis: Axis, effort: Effort) -> Iterator[Believed]:
    """Return jumps and models to start from, the likeliest first: a few steps taken out, fitted to increments, healthy,
    jumps taken out one by one, uneven."""
    least_mm = WILD * MISSED_STEPS * axis.mm_per_step
    plain, uneven = Structure(play="free"), Structure(play="free", warp_mm=WARPS_MM[1])
    design = plain.design(COARSE_HARMONICS, ())
    if jumps := _stepped(rows, design, axis):
        yield jumps, effort.search(jumped(rows, jumps))
    # Many jumps show in increments, whatever else a model lacks.
    if np.abs(np.diff(found.fit.touch.residual_mm[rows.weight > 0])).max(initial=0.0) < least_mm:
        return
    calm = _calm(rows, design, least_mm, effort)
    if np.abs(calm.left_mm).max(initial=0.0) < least_mm:
        return
    yield (), _believed(found, plain, design, calm.values)
    yield (), _believed(found, plain, design, np.zeros(design.size))
    if jumps := _calmed(rows, design, calm, axis, effort):
        yield jumps, effort.search(jumped(rows, jumps))
    design = uneven.design(COARSE_HARMONICS, (), rows.reach_mm)
    yield (), _believed(found, uneven, design, _calm(rows, design, least_mm, effort).values)


def _believed(found: Choice, structure: Structure, design: Design, values: np.ndarray) -> Choice:
    """Return a model of given parameters [P]."""
    posterior = replace(found.fit.posterior, values=values)
    return Choice(structure, design, replace(found.fit, posterior=posterior))


def _climbed(rows: Rows, belief: Believed, best: Believed, axis: Axis, effort: Effort) -> Believed:
    """Find the jumps under a model, then the model without them, and so on while it fits better; return the best."""
    taken, model = belief
    if taken and model.fit.loss_mm < best[1].fit.loss_mm:
        best = belief
    for _ in range(ROUNDS):
        more = climbed(rows, model, axis)
        much = len(more) * SPARSE > int((rows.weight > 0).sum())
        if not more or more == taken or much or effort.is_spent:
            break
        taken, model = more, effort.search(jumped(rows, more))
        if model.fit.loss_mm >= best[1].fit.loss_mm:
            break
        best = taken, model
    return best


def _calm(rows: Rows, design: Design, least_mm: float, effort: Effort) -> "Increments":
    starts = [_increments(rows, design, _started(design, play_mm), least_mm, PASSES, effort) for play_mm in STARTS_MM]
    return min(starts, key=lambda fit: fit.loss_mm)


def _calmed(rows: Rows, design: Design, best: "Increments", axis: Axis, effort: Effort) -> tuple[Jump, ...]:
    """Return the jumps that calm the increments most, taken out one at a time: a loss of steps turns the pulley for
    all that follows, so what comes later is seen clearly only once it is taken out."""
    least_mm = WILD * MISSED_STEPS * axis.mm_per_step
    jumps: tuple[Jump, ...] = ()
    while len(jumps) < MOST and not effort.is_spent:
        more_jumps = [(*jumps, *more) for more in _suspects(rows, best, axis)]
        tried = [
            (more, _increments(jumped(rows, more), design, best.values, least_mm, FEW_PASSES, effort))
            for more in more_jumps
        ]
        if not tried:
            break
        more, fit = min(tried, key=lambda pair: pair[1].loss_mm)
        if fit.loss_mm > best.loss_mm - CALMER * least_mm / len(best.left_mm):
            break
        jumps, best = more, fit
    return lasting(rows, sorted(jumps, key=lambda jump: jump.row))


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


def _stepped(rows: Rows, design: Design, axis: Axis) -> tuple[Jump, ...]:
    """Return the jumps nearest to the steps that, with a model, explain the measured places best.

    Where a gain changes abruptly, as on a pulley with corners, one increment says little of a jump; all places after it
    do. Steps of any size are added one at a time, those that remain small are dropped, the others snapped.
    """
    found = [_steps(rows, design, _started(design, play_mm), axis) for play_mm in STARTS_MM[1:]]
    at, sizes_mm, gain, _ = min(found, key=lambda each: each[-1])
    step, tooth = MISSED_STEPS * axis.mm_per_step, TOOTH_STEPS * axis.mm_per_step
    jumps: list[Jump] = []
    for row, size_mm in sorted(zip(at, sizes_mm, strict=True)):
        away = [abs(size_mm - a * tooth - b * step * gain) + MORE_JUMPS_MM * (abs(a) + abs(b)) for a, b in COMBINATIONS]
        teeth, missed = COMBINATIONS[int(np.argmin(away))]
        jumps += [Jump(row, True, teeth * tooth)] * (teeth != 0)
        jumps += [Jump(row, False, missed * step)] * (missed != 0)
    return lasting(rows, jumps)


def _steps(rows: Rows, design: Design, values: np.ndarray, axis: Axis) -> tuple[list[int], list[float], float, float]:
    """Return the rows of the steps, their sizes [mm], the gain, and the mean of what is left, from parameters [P]."""
    measured = np.flatnonzero(rows.weight > 0)
    count, least_mm = len(measured), WILD * MISSED_STEPS * axis.mm_per_step
    ridge = np.diag(SOFT_MM / np.sqrt(variances(design, Prior())))
    offset = np.zeros(len(rows))
    at: list[int] = []
    sizes, left = np.zeros(0), np.zeros(count)
    for _ in range(FEW_PASSES):
        touch = contacts(design, values, replace(rows, measured_mm=rows.measured_mm - offset))
        columns = _columns(rows, design, touch, measured)
        wanted = touch.residual_mm[measured] + columns @ values + offset[measured]
        base, target = np.vstack([columns, ridge]), np.concatenate([wanted, np.zeros(design.size)])
        at = _breaks(base, target, count)
        small = True
        while small:  # what is small is dropped, the rest fitted again
            after = (np.arange(len(target))[:, None] >= np.array(at, int)) & (np.arange(len(target)) < count)[:, None]
            both = np.column_stack([base, after])
            solved = np.linalg.lstsq(both, target, rcond=None)[0]
            values, sizes = solved[: design.size], solved[design.size :]
            left = (target - both @ solved)[:count]
            small = bool((np.abs(sizes) < least_mm).any())
            at = [k for k, size in zip(at, sizes, strict=True) if abs(size) >= least_mm]
        offset = np.zeros(len(rows))
        for k, size in zip(at, sizes, strict=True):
            offset[measured[k] :] += size
    gain = 1.0 + float(values[design.parts["mean_powers"]][1]) / 100.0
    return (
        [int(measured[k]) for k in at],
        list(map(float, sizes)),
        gain,
        float(np.minimum(np.abs(left), least_mm).mean()),
    )


def _breaks(base: np.ndarray, target: np.ndarray, count: int) -> list[int]:
    """Return after which of the first ``count`` entries of ``target`` steps help most beside the columns ``base``."""
    q = np.linalg.qr(base)[0]
    left = target - q @ (q.T @ target)
    room = np.arange(count, 0, -1.0) - np.square(np.cumsum(q[:count][::-1], axis=0)[::-1]).sum(axis=1)
    at: list[int] = []
    for _ in range(MOST_STEPS):
        score = np.square(np.cumsum(left[:count][::-1])[::-1]) / np.maximum(room, LOCAL_ROOM)
        k = int(np.argmax(score))
        step = np.zeros(len(target))
        step[k:count] = 1.0
        step -= q @ (q.T @ step)
        size = float(np.linalg.norm(step))
        if size < 1.0 or k in at:
            break
        at.append(k)
        step /= size
        q = np.column_stack([q, step])
        left = left - step * float(step @ left)
        room -= np.square(np.cumsum(step[:count][::-1])[::-1])
    return at


def _columns(rows: Rows, design: Design, touch: Contacts, measured: np.ndarray) -> np.ndarray:
    """Return the columns [M, P] of the measured rows at their contacts."""
    at, side = touch.at[measured], touch.side[measured]
    mean, play = design.columns(rows.motor_mm[np.maximum(at, 0)], rows.period_mm, rows.origin_mm)
    columns = (mean + side[:, None] / 2 * play) * (at >= 0)[:, None]
    columns[:, design.parts["cross"]] = rows.other_mm[measured, None] / 100.0
    columns[:, design.parts["start"]] = (at < 0)[:, None]
    return columns


def _started(design: Design, play_mm: float) -> np.ndarray:
    values = np.zeros(design.size)
    values[design.parts["play_powers"]] = play_mm
    return values


def _increments(
    rows: Rows, design: Design, values: np.ndarray, least_mm: float, passes: int, effort: Effort
) -> Increments:
    """Fit the measured increments robustly, from parameters [P]."""
    measured = np.flatnonzero(rows.weight > 0)
    effort.rows -= passes * len(measured)
    precision = np.diag(1.0 / variances(design, Prior()))
    left = np.zeros(len(measured) - 1)
    for _ in range(passes):
        touch = contacts(design, values, rows)
        steps = np.diff(_columns(rows, design, touch, measured), axis=0)
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
