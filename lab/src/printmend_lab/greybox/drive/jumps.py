"""Find the teeth that were skipped and the steps that were missed within a trace.

A skipped tooth moves the belt by 10 full steps from then on, a missed electrical turn the motor by 4 (physics.md eq.
11). Jumps say nothing about the next print, but would bend every part of a model that is fitted across them. So the
search starts from models that jumps hardly bend, such as one that is fitted robustly to the increments from one
measured row to the next: of these a jump disturbs only one. Such a model shows where the jumps are (`ladder`); without
them a better model can be fitted, and so on.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from printmend.path import last_way
from printmend.printer import Axis
from printmend.units import SIGMA_PER_MEDIAN
from printmend_lab.greybox.drive import kernels
from printmend_lab.greybox.drive.design import Contacts, Design, Rows, contacts
from printmend_lab.greybox.drive.fit import Prior, variances
from printmend_lab.greybox.drive.select import COARSE_HARMONICS, WARPS_MM, Choice, Structure, main_parts

# Find all jumps of a trace at once: the cheapest history of skipped teeth and missed steps under a model.
#
# With a model at hand, the offset of the belt can only be a whole number of teeth, and that of the motor a whole number
# of electrical turns: a ladder in two dimensions. Every measured point costs the square of its residual at the level
# where it is thought to be, and every rung that is climbed costs a price; dynamic programming gives the cheapest
# history. Two errors of the model would look like jumps. A smooth one would be imitated by small ones, so each jump
# must also show as a sudden change of the residual. A step of the table, as of a spliced belt, would be climbed and
# descended whenever it is passed; so what comes again at the same place, and is undone on the way back, counts as part
# of the machine.

TOOTH_STEPS, MISSED_STEPS = 10, 4  # sizes of a skipped tooth and of a missed electrical turn (physics.md eq. 11)
MOST_TEETH, MOST_MISSED = 5, 8  # rungs of the ladder either way
RUNG_NATS = 14.0  # price of a rung
MOST_POINT_NATS = 12.0  # most that one point may cost: less than two rungs, so that a stray point is no pair of jumps
LADDER_SIGMA_MM = 0.03  # smallest noise that is assumed: while there are jumps in the rows no model is exact
NEIGHBOURS = 4  # points on each side of a jump that must show it
SIZE_TOLERANCE = 0.4  # how far from its true size a jump may look, as a share of it
SAME_PLACE_MM = 1.5  # jumps this near to each other may be one step of the table: noise and play move where it shows
SAME_RISE_SHARE = 0.4  # such jumps differ by at most this share of their size
MACHINE_PASSES_SHARE = 0.2  # what jumps at more of the passes of a place is the machine's (one may be chance)
CANCELLED_MM = 0.1  # two jumps at one row cancel if their sum is smaller than the smaller of them by this much


@dataclass(frozen=True)
class Jump:
    """From ``row`` on the belt (``belt``: a skipped tooth), or else the motor (missed steps), is off by ``size_mm``."""

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


def climbed(rows: Rows, choice: Choice, axis: Axis) -> tuple[Jump, ...]:
    """Return the cheapest jumps of one motor's rows under a model."""
    measured = np.flatnonzero(rows.weight > 0)
    tooth_mm, step_mm = TOOTH_STEPS * axis.mm_per_step, MISSED_STEPS * axis.mm_per_step
    values = choice.fit.posterior.values
    residual = np.stack([
        contacts(choice.design, values, replace(rows, motor_mm=rows.motor_mm + b * step_mm)).residual_mm[measured]
        for b in range(-MOST_MISSED, MOST_MISSED + 1)
    ], axis=1)  # fmt: skip
    sigma = max(
        SIGMA_PER_MEDIAN * float(np.median(np.abs(np.diff(residual[:, MOST_MISSED])))) / np.sqrt(2), LADDER_SIGMA_MM
    )
    sigma_mm = sigma / np.sqrt(rows.weight[measured])
    levels_mm = residual[:, None, :] - tooth_mm * np.arange(-MOST_TEETH, MOST_TEETH + 1)[:, None]
    cost = np.minimum(np.square(levels_mm / sigma_mm[:, None, None]) / 2, MOST_POINT_NATS)
    path = np.empty((len(measured), 2), np.int64)
    kernels.cheapest_levels(cost, RUNG_NATS, path)
    at = np.flatnonzero((np.diff(path, axis=0) != 0).any(axis=1))
    jumps: list[Jump] = []
    left = levels_mm[np.arange(len(path)), path[:, 0], path[:, 1]]
    for i, before, after in zip(at, np.append(-1, at), np.append(at[1:], len(path) - 1), strict=False):
        teeth, missed = (int(n) for n in path[i + 1] - path[i])
        first = slice(max(i + 1 - NEIGHBOURS, before + 1), i + 1)
        last = slice(i + 1, min(i + 1 + NEIGHBOURS, after + 1))
        # where the points after the jump would be without it
        still = levels_mm[last, path[i, 0], path[i, 1]]
        seen = float(np.median(still) - np.median(left[first]))
        size = float(np.median(still) - np.median(left[last]))
        if abs(seen - size) > SIZE_TOLERANCE * abs(size):
            continue
        row = int(measured[i]) + 1
        jumps += [Jump(row, True, teeth * tooth_mm)] * (teeth != 0)
        jumps += [Jump(row, False, missed * step_mm)] * (missed != 0)
    return lasting(rows, jumps)


def lasting(rows: Rows, jumps: Sequence[Jump]) -> tuple[Jump, ...]:
    """Return the jumps without two kinds: those that cancel each other at one row, and those that belong to a place.

    At a place of the machine they come at many passes, up one way and down the other way.
    """
    at = np.unique([jump.row for jump in jumps]).astype(np.int64)
    sizes_mm = [[jump.size_mm for jump in jumps if jump.row == row] for row in at]
    size_mm, least_mm = np.array([sum(each) for each in sizes_mm]), [min(map(abs, each)) for each in sizes_mm]
    place_mm, rise_mm = rows.motor_mm[at], size_mm * last_way(rows.motor_mm)[at]
    kept = set()
    for i in range(len(at)):
        alike = np.abs(rise_mm - rise_mm[i]) <= SAME_RISE_SHARE * abs(rise_mm[i])
        alike &= np.abs(place_mm - place_mm[i]) <= SAME_PLACE_MM
        count = int(alike.sum())
        undone = abs(np.sign(size_mm[alike]).sum()) <= count / 2
        often = count - 1 > MACHINE_PASSES_SHARE * _passes(rows.motor_mm, place_mm[i])
        if abs(size_mm[i]) > least_mm[i] - CANCELLED_MM and not (undone and often):
            kept.add(int(at[i]))
    return tuple(jump for jump in jumps if jump.row in kept)


def _passes(motor_mm: np.ndarray, place_mm: float) -> int:
    """Return how often a motor passed a place, from `SAME_PLACE_MM` on one side of it to as far on the other."""
    away = motor_mm - place_mm
    sides = np.sign(away[np.abs(away) > SAME_PLACE_MM])
    return int((np.diff(sides) != 0).sum())


STARTS_PLAY_MM = (0.0, 0.5, 2.0)  # first guesses of the play
MOST_PASSES, FEW_PASSES = 10, 3  # of contacts and least squares: from a first guess, and from a fit that is near
MOST_SUSPECTS = 10  # increments, the largest first, that are tried as a jump
MOST_STEPS = 10  # steps of any size that are added to a model
LEAST_ROOM = 4.0  # least squared norm of a step beside the columns: with less, the columns can imitate the step
JUMP_PRICE_MM = 0.2  # how much nearer to a step's size one more jump at its place must come
JUMP_SHOWS_SHARE = 0.35  # share of the smallest jump's size from which an increment may be a jump
JUMP_SHOWS_SIGMAS = 5.0  # … and how many standard deviations of the other increments it must have
LEAST_GAIN_SHARE = 0.4  # share of one such increment by which a jump must lower the sum of all
# Teeth and missed turns between two measured rows, the fewest first.
COMBINATIONS = sorted(
    ((a, b) for a in range(-2, 3) for b in range(-2, 3) if 0 < abs(a) + abs(b) < 4),
    key=lambda ab: abs(ab[0]) + abs(ab[1]),
)
# How far from its size an increment may be, in sizes of a missed turn: for any jump, and for each missed turn in it.
TOOTH_TOLERANCE, STEP_TOLERANCE = 0.2, 0.35
PATTERNED_LOSS_SHARE = 0.6  # jumps are believed where they lower the mean residual to less than this share
WHITE_LOSS_SHARE = 0.9  # … or than this one, where nothing but noise remains
MOST_JUMPS = 64  # jumps of one motor that are taken out one by one
CLIMBS = 4  # rounds of jumps and model
MOST_SEARCHES, FEWEST_SEARCHES = 8, 4  # for the jumps of one motor: where there are any, the first few find them
MOST_SEARCHED = 20_000  # measured rows that all these searches together look at, but for the fewest
MOST_FITTED = 600_000  # rows whose increments are fitted for one motor, in all fits together
ROWS_PER_JUMP = 25  # measured rows for each jump: more frequent jumps imitate something else
WHITE_SHARE = 0.4  # with a larger share of independent residuals there are no jumps
LEAST_SIGMA_MM = 0.05  # smallest noise of an increment: less would leave out rows whose contacts are not yet right
HARMLESS_LOSS_MM = 0.02  # with a smaller mean residual there are no jumps, or none that harm
GOOD_LOSS_MM = 0.05  # with a smaller mean residual the slower beliefs are not tried

Belief = tuple[tuple[Jump, ...], Choice]


@dataclass
class Effort:
    """What may still be spent on one motor's jumps, counted and not timed: a search always ends at the same place."""

    searches: int
    rows: int = MOST_FITTED

    @classmethod
    def on(cls, rows: Rows) -> "Effort":
        """Return what may be spent on so many rows."""
        measured = max(int((rows.weight > 0).sum()), 1)
        return cls(int(np.clip(MOST_SEARCHED // measured, FEWEST_SEARCHES, MOST_SEARCHES)))

    @property
    def is_spent(self) -> bool:
        return self.searches <= 0 or self.rows <= 0

    def searched(self, rows: Rows) -> Choice:
        """Return the best model of rows with a drive's main parts."""
        self.searches -= 1
        return main_parts(rows)


def find_jumps(rows: Rows, found: Choice, axis: Axis) -> Belief:
    """Return the jumps of one motor's rows and the fit without them; no jumps where they explain too little.

    ``found`` is the fit of the rows as they are.
    """
    is_explained = found.fit.loss_mm < HARMLESS_LOSS_MM or found.fit.share > WHITE_SHARE
    if is_explained or int((rows.weight > 0).sum()) < 4 * COARSE_HARMONICS:
        return (), found
    best: Belief = (), found
    effort = Effort.on(rows)
    for belief in _beliefs(rows, found, axis, effort):
        best = _climbed(rows, belief, best, axis, effort)
        if effort.is_spent or best[1].fit.loss_mm < GOOD_LOSS_MM or (best[0] and best[1].fit.share > WHITE_SHARE):
            break
    least = WHITE_LOSS_SHARE if best[1].fit.share > WHITE_SHARE else PATTERNED_LOSS_SHARE
    return best if best[1].fit.loss_mm < least * found.fit.loss_mm else ((), found)


def _beliefs(rows: Rows, found: Choice, axis: Axis, effort: Effort) -> Iterator[Belief]:
    """Yield pairs of jumps and model to start from, the likeliest first.

    They are the model without a few steps, the model of the increments, the healthy machine, the model without jumps
    that were taken out one by one, and the model of the increments with a part that repeats nothing.
    """
    least_mm = JUMP_SHOWS_SHARE * MISSED_STEPS * axis.mm_per_step
    plain, uneven = Structure(play="free"), Structure(play="free", warp_mm=WARPS_MM[1])
    design = plain.design(COARSE_HARMONICS, ())
    if jumps := _jumps_of_steps(rows, design, axis):
        yield jumps, effort.searched(jumped(rows, jumps))
    # Many jumps show in increments, whatever else a model lacks.
    if np.abs(np.diff(found.fit.touch.residual_mm[rows.weight > 0])).max(initial=0.0) < least_mm:
        return
    between = _fitted_increments(rows, design, least_mm, effort)
    if np.abs(between.left_mm).max(initial=0.0) < least_mm:
        return
    yield (), _model_of(found, plain, design, between.values)
    yield (), _model_of(found, plain, design, np.zeros(design.size))
    if jumps := _taken_out(rows, design, between, axis, effort):
        yield jumps, effort.searched(jumped(rows, jumps))
    design = uneven.design(COARSE_HARMONICS, (), rows.reach_mm)
    yield (), _model_of(found, uneven, design, _fitted_increments(rows, design, least_mm, effort).values)


def _model_of(found: Choice, structure: Structure, design: Design, values: np.ndarray) -> Choice:
    """Return a fit with other parts and with the parameters ``values`` [P]."""
    posterior = replace(found.fit.posterior, values=values)
    return Choice(structure, design, replace(found.fit, posterior=posterior))


def _climbed(rows: Rows, belief: Belief, best: Belief, axis: Axis, effort: Effort) -> Belief:
    """Find jumps under a model, then a model without them, and so on while the fit gets better; return the best."""
    taken, model = belief
    if taken and model.fit.loss_mm < best[1].fit.loss_mm:
        best = belief
    for _ in range(CLIMBS):
        more = climbed(rows, model, axis)
        much = len(more) * ROWS_PER_JUMP > int((rows.weight > 0).sum())
        if not more or more == taken or much or effort.is_spent:
            break
        taken, model = more, effort.searched(jumped(rows, more))
        if model.fit.loss_mm >= best[1].fit.loss_mm:
            break
        best = taken, model
    return best


def _fitted_increments(rows: Rows, design: Design, least_mm: float, effort: Effort) -> "Increments":
    """Return the best fit of the increments from several first guesses of the play."""
    starts = [
        _increments(rows, design, _started(design, play_mm), least_mm, MOST_PASSES, effort)
        for play_mm in STARTS_PLAY_MM
    ]
    return min(starts, key=lambda fit: fit.loss_mm)


def _taken_out(rows: Rows, design: Design, best: "Increments", axis: Axis, effort: Effort) -> tuple[Jump, ...]:
    """Return the jumps without which the increments are smallest, found one at a time.

    A loss of steps turns the pulley for all rows that follow, so a later jump shows clearly only when the earlier ones
    are taken out.
    """
    least_mm = JUMP_SHOWS_SHARE * MISSED_STEPS * axis.mm_per_step
    jumps: tuple[Jump, ...] = ()
    while len(jumps) < MOST_JUMPS and not effort.is_spent:
        more_jumps = [(*jumps, *more) for more in _suspects(rows, best, axis)]
        tried = [
            (more, _increments(jumped(rows, more), design, best.values, least_mm, FEW_PASSES, effort))
            for more in more_jumps
        ]
        if not tried:
            break
        more, fit = min(tried, key=lambda pair: pair[1].loss_mm)
        if fit.loss_mm > best.loss_mm - LEAST_GAIN_SHARE * least_mm / len(best.left_mm):
            break
        jumps, best = more, fit
    return lasting(rows, sorted(jumps, key=lambda jump: jump.row))


@dataclass(frozen=True, eq=False)
class Increments:
    """A robust fit of the increments between the M measured rows.

    ``values`` [P] are its parameters and ``left_mm`` [M − 1] the residual increments; ``loss_mm`` is the mean of their
    absolute values, each at most what a jump shows at least. ``gain`` is the carriage's mean way for a commanded one.
    """

    values: np.ndarray
    left_mm: np.ndarray
    loss_mm: float
    gain: float


def _suspects(rows: Rows, fit: Increments, axis: Axis) -> list[tuple[Jump, ...]]:
    """Return the jumps that may explain the largest increments, for each at most two of the simplest of its size."""
    measured = np.flatnonzero(rows.weight > 0)
    step, tooth = MISSED_STEPS * axis.mm_per_step, TOOTH_STEPS * axis.mm_per_step
    size = np.abs(fit.left_mm)
    large = np.flatnonzero(
        size > max(JUMP_SHOWS_SHARE * step, JUMP_SHOWS_SIGMAS * SIGMA_PER_MEDIAN * float(np.median(size)))
    )
    large = large[np.argsort(-size[large], kind="stable")][:MOST_SUSPECTS]
    suspects = []
    for i in large:
        row, options = int(measured[i]) + 1, 0
        for teeth, missed in COMBINATIONS:
            away = abs(fit.left_mm[i] - teeth * tooth - missed * step * fit.gain)
            # A pulley turns the same loss of angle into more or less than its mean gain does.
            if away < (TOOTH_TOLERANCE + STEP_TOLERANCE * fit.gain * abs(missed)) * step and options < 2:
                options += 1
                belt, motor = Jump(row, True, teeth * tooth), Jump(row, False, missed * step)
                suspects.append((belt,) * (teeth != 0) + (motor,) * (missed != 0))
    return suspects


def _jumps_of_steps(rows: Rows, design: Design, axis: Axis) -> tuple[Jump, ...]:
    """Return the jumps nearest to the steps that, together with a model, explain the measured places best.

    Where a gain changes abruptly, as on a pulley with corners, one increment says little about a jump, but all places
    after it do. Steps of any size are added one at a time. Those that stay small are dropped, the others are rounded to
    the sizes of jumps.
    """
    found = [_steps(rows, design, _started(design, play_mm), axis) for play_mm in STARTS_PLAY_MM[1:]]
    at, sizes_mm, gain, _ = min(found, key=lambda each: each[-1])
    step, tooth = MISSED_STEPS * axis.mm_per_step, TOOTH_STEPS * axis.mm_per_step
    jumps: list[Jump] = []
    for row, size_mm in sorted(zip(at, sizes_mm, strict=True)):
        away = [abs(size_mm - a * tooth - b * step * gain) + JUMP_PRICE_MM * (abs(a) + abs(b)) for a, b in COMBINATIONS]
        teeth, missed = COMBINATIONS[int(np.argmin(away))]
        jumps += [Jump(row, True, teeth * tooth)] * (teeth != 0)
        jumps += [Jump(row, False, missed * step)] * (missed != 0)
    return lasting(rows, jumps)


def _steps(rows: Rows, design: Design, values: np.ndarray, axis: Axis) -> tuple[list[int], list[float], float, float]:
    """Return the rows of the steps, their sizes [mm], the gain and the mean residual, starting from parameters [P]."""
    measured = np.flatnonzero(rows.weight > 0)
    count, least_mm = len(measured), JUMP_SHOWS_SHARE * MISSED_STEPS * axis.mm_per_step
    ridge = np.diag(LEAST_SIGMA_MM / np.sqrt(variances(design, Prior())))
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
        while small:  # small steps are dropped, and the others fitted again
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
    gain = 1.0 + float(values[design.scale_at]) / 100.0
    return (
        [int(measured[k]) for k in at],
        list(map(float, sizes)),
        gain,
        float(np.minimum(np.abs(left), least_mm).mean()),
    )


def _breaks(base: np.ndarray, target: np.ndarray, count: int) -> list[int]:
    """Return where steps within the first ``count`` entries of ``target`` help most beside the columns ``base``."""
    q = np.linalg.qr(base)[0]
    left = target - q @ (q.T @ target)
    room = np.arange(count, 0, -1.0) - np.square(np.cumsum(q[:count][::-1], axis=0)[::-1]).sum(axis=1)
    at: list[int] = []
    for _ in range(MOST_STEPS):
        score = np.square(np.cumsum(left[:count][::-1])[::-1]) / np.maximum(room, LEAST_ROOM)
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
    """Return the parameters [P] of a healthy drive but for its play."""
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
            sigma = max(SIGMA_PER_MEDIAN * float(np.median(np.abs(left))), LEAST_SIGMA_MM)
            weight = 1.0 / (1.0 + np.square(left / (2 * sigma)))  # Cauchy: a jump counts for next to nothing
            matrix = (steps * weight[:, None]).T @ steps / sigma**2
            values = np.linalg.solve(matrix + precision, (steps.T @ (weight * wanted)) / sigma**2)
        left = wanted - steps @ values
    loss = float(np.minimum(np.abs(left), least_mm).mean())
    return Increments(values, left, loss, 1.0 + float(values[design.scale_at]) / 100.0)
