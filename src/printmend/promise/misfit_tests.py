"""Tests of whether a model fits: causes that show in its residuals, points that it leaves out, places never measured.

The residuals of each motor, and every column that is looked for, are freed of what the model's own parts can follow.
The column that then explains most is believed where it does so by more than chance, allowing for how many were tried
and for how few of the rows are independent, and moves a print by more than nothing: a score test (Rao 1948), repeated.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from printmend.identify.drive.design import Rows
from printmend.identify.drive.fit import independent_share, robust_sigma_mm
from printmend.identify.drive.period import NEAR_SHARE, TOOTH_MM
from printmend.identify.drive.second import columns_of, own_columns
from printmend.learn.greybox.model import GreyboxModel, LearnedDrive
from printmend.learn.greybox.rows import motor_rows
from printmend.measure.once import RANDOM_SDS, in_no_order
from printmend.path import Trace
from printmend.promise.apply import observed_stretch
from printmend.promise.effects import (
    BEGUN,
    EARLY,
    EARLY_DONE,
    ENDED,
    LEARNED,
    SHIFTS,
    SPEED,
    STAYS,
    VARIES,
    Effect,
    absorbing,
)
from printmend.promise.laws import LawRows, warmed, widest_mm
from printmend.promise.misfit import NOTE, REFUSAL, SEVERITIES, WARNING, Misfit
from printmend.promise.misfit_columns import HALVES, Candidate, candidates, finer_breaks, in_time, law_rows, wavy_axes
from printmend.promise.walk import BESIDE_NATS, MOVED_SHARE, walk_of
from printmend.promise.walk import SURE_NATS as SURE_WALK_NATS

MOST_ROWS = 1500  # most rows of a motor that are tested: more take time and say the same
LEAST_ROWS = 60  # with fewer rows nothing is tested
# Growth is tested only where each of so many parts of the print has at least so many rows, spread over at least this
# share of the motor's span.
QUARTERS, LEAST_ROWS_A_QUARTER, LEAST_SPREAD_SHARE = 4, 40, 0.3
MOST_CAUSES = 3  # most causes that are named for one motor
LEAST_NATS = 9.0  # log likelihood that a cause must gain, beyond the logarithm of how many are tried: noise gains six
SURE_NATS = 14.0  # the same where more than what is told hangs on it
LEAST_COST_MM = 0.018  # least RMS error on a print that a cause must make to be named: an owner does not see less
WARNED_MM = 0.03  # a cause of that size or more is a warning, a smaller one a note
NOISE_SHARE = 0.3  # a cause must have this share of the noise at least: a smaller one is of no use to know
LEAST_OWN_SHARE = 0.05  # share of a column that the model's own parts must leave, for it to be told from them
LEAST_OWN_SHARE_OF_SPEED = 0.02  # the same for the law of speed, whose column hardly varies: a probe's moves are alike
ONE_SIGMA_SHARE = 0.6827  # share of Gaussian residuals within one standard deviation
LEAST_SPREAD_MM = 1e-6  # smallest standard deviation of residuals: it is divided by
CLIP_SIGMAS = 4.0  # standard deviations beyond which a residual is an outlier
LOST_SIGMAS, LOST_MM = 6.0, 0.05  # a point whose residual exceeds both limits was measured wrongly
# Shares of such points from which on they are a note, a warning, a refusal.
FEW_LOST, MANY_LOST, MOST_LOST = 0.005, 0.08, 0.3
SINGLE = 0.03  # share of outliers up to which they are single rows, not a pattern
UNFIT_SHARE, UNFIT_MM = 0.4, 0.3  # a model that leaves this share of the error, and as many mm, does not fit
MOST_JUMPS = 4  # skipped teeth and lost steps in a print, beyond which its end is no better known than its beginning
ONE_WAVE_SHARE = 0.15  # waves of one rail whose lengths differ by less are one, which both motors show
# A plate lay turned where both axes lean by so many degrees in the same sense, the smaller by at least this share of
# the larger. A CoreXY's bad pulley leans both axes towards each other: there the share is smaller if the plate lay
# shifted as well, and larger where nobody knows, because a skewed frame and such a pulley may lean both in one sense.
TURNED_DEG, ALIKE_SHARE, ALIKE_SHARE_COREXY, ALIKE_SHARE_COREXY_ANYWHERE = 0.1, 0.6, 0.25, 0.75
TILTED_SHARE = 2.0  # the head tilts where its error across the axis that moved is so many times the error along it
MOVED_MM = 0.3  # a plate lay shifted by this much at least
HOME_SD_MM = 0.05  # … where the error at home is known to this standard deviation
MOST_LEFT_SHARE = 0.35  # share of an uneven belt's squares that one period may leave
SAME_TIME = 0.1  # two motors shifted at the same time where their laws' times differ by no more of the print
ONE_AXIS_SHARE = 0.2  # a shift along the other axis that is a smaller share is none
COUNTING_SHARE = 0.1  # share of the largest wave of a turn that another one must have to say how long the turn is
TWO_VALUED = 1.65  # kurtosis below which residuals take one of two values: even chances of a range give 1.8
NOISE_KURTOSIS = 3.0  # kurtosis of Gaussian noise
LEAST_TWO_MM, LEAST_SCATTER_MM = 0.03, 0.1  # root mean square of two values, and of other residuals, worth a word
COVERED_SHARE = 0.6  # share of an axis of the bed that the print must span
CARRIED = "The model carries it"
LEAST_TOLD_MM = 0.005  # a smaller step would be told as 0.00 or 0.01 mm
UNSEEN = "unseen"  # the kind of the note about the rest


_OF_WHEN = {
    ENDED: ". The model is of the end of the print",
    BEGUN: ". The model is of the first tenth of the print, as for parts of usual size: the next one is homed anew",
    EARLY: ". The model is of a printer that has warmed up by a third, as for parts of usual size",
}

_GIVES_WAY = ": something gives way, as a set screw does, or the machine warms up and is cold again when a print begins"
_WARMS_UP = " while the print went on, as a machine that warms up does"
_STICKS = (
    ": no printing makes play smaller, so it goes with the moves, as where an axis sticks and slips. "
    "The model has the mean"
)
_WHY = (_GIVES_WAY, _WARMS_UP, _STICKS)  # said once for both motors

_OF_HALVES = ". Two sheets measured as one show that, or a guide in two pieces: the model is without it"

# What becomes in the next print of causes that come with time, and the time of which the model is, as a share of the
# print: play that grew stays so, a shift is gone with the next homing, and a printer that warmed up is cold again.
_STATES = {"wear": ENDED, "thermal": EARLY, **dict.fromkeys(SHIFTS, BEGUN)}
_DONE = {ENDED: 1.0, BEGUN: EARLY_DONE, EARLY: EARLY_DONE}
IN_TIME = tuple(_STATES)


@dataclass(frozen=True, eq=False)
class Cause:
    """Something that the residuals of a motor hold: its candidate, weights [Q], effect and evidence."""

    motor: int
    candidate: Candidate
    weights: np.ndarray
    size_mm: float
    nats: float


def causes_of(box: GreyboxModel, trace: Trace, *, guides: bool = False) -> tuple[Cause, ...]:
    """Return what the residuals of a grey box hold beyond noise; with ``guides`` a wave of any printer's guide counts,
    else a CoreXY's alone: what is left of one half of the bed being off beside a bent frame looks like one."""
    found: list[Cause] = []
    for motor, rows, one, used, near in _looked_at(box, trace):
        drive = box.drives[motor]
        corexy = box.printer.kinematics == "corexy"
        wavy = wavy_axes(motor, trace, corexy=corexy) if guides or corexy else ()
        offered = list(candidates(one, wavy, corexy=corexy))
        if not _shows_growth(one.at(near)):
            offered = [each for each in offered if each.kind != "thermal"]
        basis = own_columns(drive.choice, rows, used[near])
        found += _explained(motor, offered, one.at(near), drive.choice.fit.touch.residual_mm[used][near], basis)
        if drive.structure.warp_mm:
            found += _repeated(motor, offered, one, drive, rows, used)
    return _worn_or_sticking(found)


def _worn_or_sticking(found: list[Cause]) -> tuple[Cause, ...]:
    """Return the causes; play that changes in time is no wear where that of either motor shrinks."""
    if not any(cause.candidate.kind == "wear" and cause.weights[0] < 0 for cause in found):
        return tuple(found)
    return tuple(
        replace(cause, candidate=replace(cause.candidate, kind="sticking")) if cause.candidate.kind == "wear" else cause
        for cause in found
    )


def _looked_at(box: GreyboxModel, trace: Trace) -> Iterator[tuple[int, Rows, LawRows, np.ndarray, np.ndarray]]:
    """Yield for each motor that has rows enough: its rows, the used ones for the laws, their numbers, and which of them
    are no outliers."""
    rows = motor_rows(trace, box.printer, box.periods_mm)
    for motor, drive in enumerate(box.drives):
        touch = drive.choice.fit.touch
        if len(touch.at) != len(trace):
            continue
        used = _used(rows[motor], touch.at)
        if len(used) < LEAST_ROWS:
            continue
        one = law_rows(rows, motor, trace.commanded_mm, touch.side).at(used)
        yield motor, rows[motor], one, used, _near(touch.residual_mm[used])


def _used(rows: Rows, at: np.ndarray) -> np.ndarray:
    """Return the rows to test: measured, with a contact (``at`` [N]: its row or −1), at most some `MOST_ROWS`."""
    used = np.flatnonzero((rows.weight > 0) & (at >= 0))
    return used[:: max(1, len(used) // MOST_ROWS)]


def unrest_mm(box: GreyboxModel, trace: Trace) -> float:
    """Return the RMS size [mm] of a small drift during the print; 0 where none is certain.

    It is for drifts that are too small for the model to be made for one time of the print, its beginning or its end.
    """
    sizes = [0.0]
    for motor, rows, one, used, near in _looked_at(box, trace):
        choice, seen = box.drives[motor].choice, one.at(near)
        basis = own_columns(choice, rows, used[near])
        left, spare = _left(choice.fit.touch.residual_mm[used][near], basis)
        tried = [_tried(motor, each, seen, left, basis, spare, LEAST_NATS) for each in in_time()]
        sizes += [max(((c.nats, c.size_mm) for c in tried if c is not None and c.size_mm < LEAST_COST_MM),
                      default=(0.0, 0.0))[1]]  # fmt: skip
    return max(sizes)


def _near(residual_mm: np.ndarray) -> np.ndarray:
    """Tell which rows [M] are tested: all, unless outliers are so many that together they would look like a pattern, or
    so few that they are single rows: where some of a table were deleted, the nozzle came to the next ones from
    elsewhere, and after a long move."""
    outlier = np.abs(residual_mm) > CLIP_SIGMAS * spread_mm(residual_mm)
    return np.arange(len(residual_mm)) if SINGLE < outlier.mean() <= MANY_LOST else np.flatnonzero(~outlier)


def spread_mm(residual_mm: np.ndarray) -> float:
    """Return a standard deviation by quantile: 68 % of the residuals are not larger.

    Unlike one by the median, it includes a pattern in half of the rows, as of play that wears on one side; a third of
    outliers hardly changes it.
    """
    return max(float(np.quantile(np.abs(residual_mm), ONE_SIGMA_SHARE)), LEAST_SPREAD_MM)


def _shows_growth(one: LawRows) -> bool:
    """Say whether the rows can show growth in time: each quarter of the print covers much of the motor's way.

    A few walls that were each printed once show that they are wrong, but not that this came with time.
    """
    for quarter in range(QUARTERS):
        own = one.own[np.floor(np.minimum(one.done, 1 - 1e-9) * QUARTERS) == quarter]
        if len(own) < LEAST_ROWS_A_QUARTER:
            return False
        low, high = np.quantile(own, (0.1, 0.9))
        if high - low < LEAST_SPREAD_SHARE * np.ptp(one.own):
            return False
    return True


def _repeated(
    motor: int, offered: list[Candidate], one: LawRows, drive: LearnedDrive, rows: Rows, used: np.ndarray
) -> list[Cause]:
    """Return the period of what was learned as an error that repeats nothing, where it does repeat."""
    design, values = drive.choice.design, drive.choice.fit.posterior.values
    mean, _ = design.columns(rows.motor_mm[drive.choice.fit.touch.at[used]], rows.period_mm, rows.origin_mm)
    part = design.parts["warp"]
    uneven = mean[:, part] @ values[part]
    basis = own_columns(drive.choice, rows, used, design.mask("warp"))
    left = uneven - basis @ (basis.T @ uneven)
    periods = [each for each in offered if each.kind == "second-period"]
    tried = [_tried(motor, each, one, left, basis, len(left), -np.inf) for each in periods]
    best = max((cause for cause in tried if cause is not None), key=lambda cause: cause.nats, default=None)
    if best is None or best.size_mm < LEAST_COST_MM:
        return []
    columns = best.candidate.columns(one)
    after = left - (columns - basis @ (basis.T @ columns)) @ best.weights
    return [best] if float(after @ after) < MOST_LEFT_SHARE * float(left @ left) else []


def _explained(
    motor: int, offered: list[Candidate], one: LawRows, residual_mm: np.ndarray, basis: np.ndarray
) -> list[Cause]:
    """Return the causes that residuals hold, without those in time where an instrument that wanders is likelier."""
    found = _likeliest(motor, offered, one, residual_mm, basis)
    timed, others = ([each for each in found if (each.candidate.kind in IN_TIME) == is_in] for is_in in (True, False))
    if not timed:
        return found
    beside = np.column_stack([basis, *(each.candidate.columns(one) for each in others)])
    columns = [each.candidate.columns(one) for each in timed]
    left, _ = _left(residual_mm, basis)
    gained = walk_of(left, np.column_stack([beside, *columns])).log_likelihood - walk_of(left, beside).log_likelihood
    price = sum(np.log(each.candidate.tried) + each.weights.size + BESIDE_NATS for each in timed)
    if gained > price:
        return found
    return _likeliest(motor, [each for each in offered if each.kind not in IN_TIME], one, residual_mm, basis)


def _likeliest(
    motor: int, offered: list[Candidate], one: LawRows, residual_mm: np.ndarray, basis: np.ndarray
) -> list[Cause]:
    sigma, (left, spare) = spread_mm(residual_mm), _left(residual_mm, basis)
    found: list[Cause] = []
    while len(found) < MOST_CAUSES:
        least_nats = SURE_NATS if found else LEAST_NATS  # what is left beside a cause may be its own
        tried = [_tried(motor, each, one, left, basis, spare, least_nats) for each in offered]
        sure = [
            cause
            for cause in tried
            if cause is not None and cause.size_mm > max(LEAST_COST_MM, NOISE_SHARE * sigma / 2)
        ]
        if not sure:
            break
        best = max(sure, key=lambda cause: cause.nats)
        if best.candidate.kind == "step":  # a break that is off leaves what looks like an instrument that wanders
            finer = (_tried(motor, each, one, left, basis, spare, least_nats) for each in finer_breaks(best.candidate))
            best = max((best, *(each for each in finer if each is not None)), key=lambda cause: cause.nats)
        columns = best.candidate.columns(one)
        freed = columns - basis @ (basis.T @ columns)
        found.append(best)
        more = np.linalg.qr(freed)[0]
        basis = np.column_stack([basis, more])
        left = left - more @ (more.T @ left)
    return found


def wandering(
    box: GreyboxModel, trace: Trace, effects: tuple[Effect, ...], left_mm: np.ndarray | None = None
) -> tuple[float, tuple[Misfit, ...]]:
    """Return the size [mm] of an even drift that moves as much as the measurement of either motor wanders, root mean
    square, and what is to be said of it.

    A motor whose residuals hold ``effects`` is not looked at. ``left_mm`` [N, 2] is what a remainder leaves that was
    learned beside the box: an error that goes with place does not wander.
    """
    others = {effect.motor for effect in effects}
    walks = []
    for motor, rows, _, used, near in _looked_at(box, trace):
        choice = box.drives[motor].choice
        basis = own_columns(choice, rows, used[near])
        residual_mm = choice.fit.touch.residual_mm if left_mm is None else left_mm[:, motor]
        left, _ = _left(residual_mm[used][near], basis)
        if motor not in others and (walk := walk_of(left, basis)).nats > SURE_WALK_NATS:
            walks.append((box.printer.motors[motor].upper(), walk))
    told = [(name, walk) for name, walk in walks if walk.size_mm > LEAST_COST_MM]
    size_mm = MOVED_SHARE * max((walk.size_mm for _, walk in walks), default=0.0)
    if not told:
        return size_mm, ()
    most_mm = max(walk.size_mm for _, walk in told)
    words = wander_words([name for name, _ in told], most_mm, is_still=trace.instrument_doubt.is_exact)
    severity = WARNING if most_mm >= WARNED_MM else NOTE
    return size_mm, (Misfit("walk", severity, most_mm, sum(walk.nats for _, walk in told), words),)


def wander_words(names: list[str], size_mm: float, *, is_still: bool) -> str:
    """Say that the measurement of motors wanders, and with ``is_still`` what does not act for it."""
    still = ": place and scale that are no more than that may be the instrument's and are left as they are"
    return (
        f"the measurement of {' and '.join(names)} wanders, by {size_mm:.2f} mm{still if is_still else ''}. "
        "Fix what measures, let it warm up, and measure again"
    )


def _left(residual_mm: np.ndarray, basis: np.ndarray) -> tuple[np.ndarray, int]:
    """Return clipped residuals [M] less their projection on a fit's own parts, and the degrees of freedom left.

    ``basis`` [M, Q] is an orthonormal basis of the parts' columns.
    """
    most_mm = CLIP_SIGMAS * spread_mm(residual_mm)
    left = np.clip(residual_mm, -most_mm, most_mm)
    return left - basis @ (basis.T @ left), max(len(left) - basis.shape[1], 1)


def _tried(
    motor: int, candidate: Candidate, one: LawRows, left: np.ndarray, basis: np.ndarray, spare: int, least_nats: float
) -> Cause | None:
    """Return the cause that a candidate makes of the residuals ``left``.

    None where the fit's own parts could explain it as well, and where it gains no more than ``least_nats``.
    """
    columns = candidate.columns(one)
    whole = float(np.square(columns - columns.mean(axis=0)).sum())
    freed = columns - basis @ (basis.T @ columns)
    least = LEAST_OWN_SHARE_OF_SPEED if candidate.kind == "speed" else LEAST_OWN_SHARE
    if float(np.square(freed).sum()) < least * whole or whole == 0:
        return None
    weights = np.linalg.lstsq(freed, left, rcond=None)[0]
    after = left - freed @ weights
    before2, after2 = (max(float(each @ each), 1e-18) for each in (left, after))
    most, price = spare / 2 * np.log(before2 / after2), np.log(candidate.tried) + columns.shape[1]
    if most - price <= least_nats:  # though all rows were independent
        return None
    nats = independent_share(after, robust_sigma_mm(after)) * most - price
    if nats <= least_nats:
        return None
    return Cause(motor, candidate, weights, float(np.std(columns @ weights)), float(nats))


def of_one_time(box: GreyboxModel, trace: Trace, causes: tuple[Cause, ...]) -> Trace | None:
    """Return the trace as if nothing had changed while it was printed (`_DONE`); None where nothing did."""
    timed = [cause for cause in causes if cause.candidate.kind in IN_TIME and cause.size_mm > LEAST_COST_MM]
    if not timed or sum(len(jumps) for jumps in box.jumps) > MOST_JUMPS:
        return None
    rows = motor_rows(trace, box.printer, box.periods_mm)
    moved = np.zeros(trace.measured_mm.shape)
    for cause in timed:
        touch = box.drives[cause.motor].choice.fit.touch
        one = law_rows(rows, cause.motor, trace.commanded_mm, touch.side)
        law, done = cause.candidate.columns, _DONE[_STATES[cause.candidate.kind]]
        moved[:, cause.motor] += (law(one.all_at(done)) - law(one)) @ cause.weights
    return replace(trace, measured_mm=trace.measured_mm + np.asarray(box.printer.from_motor(moved)))


def effects_of(
    box: GreyboxModel, trace: Trace, causes: tuple[Cause, ...], *, of_one_time: bool = False
) -> tuple[tuple[Effect, ...], np.ndarray]:
    """Return the effects that causes may have on a new print, and their errors in this one's rows, by motor [N, 2] mm.

    ``of_one_time``: the model was learned from what the function of this name returned.
    """
    rows = motor_rows(trace, box.printer, box.periods_mm)
    effects, explained = [], np.zeros((len(trace), 2))
    for cause in causes:
        drive, kind = box.drives[cause.motor], cause.candidate.kind
        one = law_rows(rows, cause.motor, trace.commanded_mm, drive.choice.fit.touch.side)
        used = _used(rows[cause.motor], drive.choice.fit.touch.at)
        done = cause.candidate.columns(one) @ cause.weights
        basis = own_columns(drive.choice, rows[cause.motor], used)
        taken = basis @ (basis.T @ done[used])
        absorbed = np.linalg.lstsq(absorbing(one.at(used)), taken, rcond=None)[0]
        learned = kind == "second-period" and bool(drive.structure.warp_mm)
        if kind in IN_TIME:
            mine = _STATES[kind] if of_one_time else VARIES
        else:
            mine = LEARNED if learned else SPEED if kind == "speed" else STAYS
        if mine in (STAYS, SPEED, VARIES):
            explained[:, cause.motor] += done - absorbing(one) @ absorbed
        effects.append(effect_of(cause, rows, trace, mine, absorbed))
    return tuple(effects), explained


def effect_of(cause: Cause, rows: list[Rows], trace: Trace, state: str, absorbed: np.ndarray) -> Effect:
    """Return a cause as the effect that it has on new prints, in the measures of this one."""
    spans = [
        [float(each.min()), float(each.max())] for each in (*(row.motor_mm for row in rows), *trace.commanded_mm.T)
    ]
    way_mm = round(float(np.hypot(*np.diff(trace.commanded_mm, axis=0).T).sum()), 1)
    ends = spans if cause.motor == 0 else [spans[1], spans[0], *spans[2:]]
    one = cause.candidate
    return Effect(
        one.kind, cause.motor, cause.weights, float(one.detail), one.place, state, absorbed, np.array(ends),
        rows[cause.motor].period_mm, way_mm,
    )  # fmt: skip


def found_in(
    box: GreyboxModel,
    trace: Trace,
    causes: tuple[Cause, ...],
    carried: tuple[Cause, ...] = (),
    *,
    of_one_time: bool = False,
) -> tuple[Misfit, ...]:
    """Return causes, points left out and places never seen as findings; ``of_one_time`` is as in `effects_of`,
    ``carried`` are those that the model knows."""
    motors = box.printer.motors
    found = [
        Misfit(cause.candidate.kind, NOTE, cause.size_mm, cause.nats, f"{_words(cause, motors)}. {CARRIED}")
        for cause in _once(carried)
        if cause.candidate.kind != "halves"
    ]
    found += [replace(each, severity=NOTE, words=f"{each.words}. {CARRIED}") for each in _halves(carried, box, trace)]
    tilts = {kind: _tilts(causes, kind) for kind in ("rail-play", "rail-racking")}
    lags = []
    told, axes = _along_axes(_one_creep(_one_border(causes)), box)
    found += [Misfit(c.candidate.kind, _severity(c), c.size_mm, c.nats, _words(c, ("x", "y"))) for c in axes]
    for cause in _once(told):
        kind = cause.candidate.kind
        if kind in tilts and (axis := int(cause.candidate.detail)) in tilts[kind]:
            found.append(_tilted(cause, axis, tilts[kind][axis]))
        elif kind == "rail-play":
            lags.append(cause)
        elif kind != "halves":
            found.append(Misfit(kind, _severity(cause), cause.size_mm, cause.nats, _words(cause, motors)))
    found += [*_lagging(lags), *_halves(_one_border(causes), box, trace)]
    joined = [
        replace(each, words=each.words + _OF_WHEN[_STATES[each.kind]])
        if of_one_time and each.kind in IN_TIME
        else replace(each, words=each.words + _OF_HALVES)
        if each.kind == "halves" and not each.words.endswith(CARRIED)
        else each
        for each in _one_of_each(found)
    ]
    return (
        *joined,
        *_jumped(box),
        *_unfit(box, trace),
        *_random_order(box, trace),
        *_other_turns(box),
        *_left_out(box, trace),
        *_unseen(box, trace),
    )


def _once(causes: tuple[Cause, ...]) -> list[Cause]:
    """Return the causes; of two that both motors show of the same rail the larger alone."""
    found: list[Cause] = []
    for cause in causes:
        at = next((at for at, other in enumerate(found) if _is_one_rails(cause.candidate, other.candidate)), None)
        if at is None:
            found.append(cause)
        elif cause.size_mm > found[at].size_mm:
            found[at] = cause
    return found


def _one_border(causes: tuple[Cause, ...]) -> tuple[Cause, ...]:
    """Return the causes without the smaller of two neighbouring borders of one motor's halves: the first one that was
    tried lay beside the true border, and the second makes up for that."""

    def is_less(one: Cause, other: Cause) -> bool:
        mine, its = one.candidate, other.candidate
        return (
            mine.kind in ("halves", "halves-play")
            and (mine.kind, mine.detail, one.motor) == (its.kind, its.detail, other.motor)
            and abs(mine.place - its.place) < 1.5 * (HALVES[1] - HALVES[0])
            and one.size_mm < other.size_mm
        )

    return tuple(one for one in causes if not any(is_less(one, other) for other in causes))


def _is_one_rails(one: Candidate, other: Candidate) -> bool:
    """Say whether two candidates are the same of one of a CoreXY's rails."""
    if one.kind != other.kind or one.place != other.place or one.kind not in ("rail-wave", "rail-racking"):
        return False
    return abs(one.detail - other.detail) < (ONE_WAVE_SHARE * one.detail if one.kind == "rail-wave" else 1.0)


def _tilts(causes: tuple[Cause, ...], kind: str) -> dict[int, float]:
    """Return by axis of a CoreXY's bed by how much [mm] the head is off across it after that axis turned round.

    Listed are the axes with mostly such errors, which come of a tilting head; an axis with play of its own would lag
    along itself. ``kind`` is "rail-play" for errors that are the same everywhere, "rail-racking" for those that grow
    towards the ends.
    """
    found = {}
    for axis in range(2):
        lag = [0.0, 0.0]
        for cause in causes:
            if cause.candidate.kind == kind and int(cause.candidate.detail) == axis:
                lag[cause.motor] = float(cause.weights.sum())
        x_mm, y_mm = (lag[0] + lag[1]) / 2, (lag[0] - lag[1]) / 2
        own, other = (x_mm, y_mm) if axis == 0 else (y_mm, x_mm)
        if abs(other) > TILTED_SHARE * abs(own):
            found[axis] = other
    return found


def _tilted(cause: Cause, axis: int, off_mm: float) -> Misfit:
    lies, way_mm = f"where {'YX'[axis]} comes to lie depends on which way {'XY'[axis]} moved before", 2 * abs(off_mm)
    if cause.candidate.kind == "rail-racking":
        words = f"{lies}, the more the nearer to its ends, by up to {way_mm:.2f} mm: the gantry racks"
        return Misfit("racking-across", _severity(cause), cause.size_mm, cause.nats, words)
    words = f"{lies}, by {way_mm:.2f} mm: the head or the gantry tilts: tighten its wheels"
    return Misfit("direction", _severity(cause), cause.size_mm, cause.nats, words)


def _one_creep(causes: tuple[Cause, ...]) -> tuple[Cause, ...]:
    """Return the causes with all that one motor crept as one: what creeps at no one pace is told as two."""
    found: dict[object, Cause] = {}
    for cause in causes:
        key = (cause.motor, "creep") if cause.candidate.kind == "creep" else cause
        if (old := found.get(key)) is not None:
            slow, fast = sorted((old, cause), key=lambda each: -each.size_mm)
            gone = float(_crept_mm(fast) / warmed(np.ones(1), slow.candidate.detail)[0])
            cause = replace(slow, weights=slow.weights + gone, nats=old.nats + cause.nats)
        found[key] = cause
    return tuple(found.values())


def _along_axes(causes: tuple[Cause, ...], box: GreyboxModel) -> tuple[tuple[Cause, ...], list[Cause]]:
    """Return the causes without shifts in time that both motors of a CoreXY show alike, and these as causes of the
    bed's axes: no belt of its own makes them, but what carries an axis, or the plate."""
    if box.printer.kinematics != "corexy":
        return causes, []
    axes: list[Cause] = []
    for kind in SHIFTS:
        both = sorted((cause for cause in causes if cause.candidate.kind == kind), key=lambda cause: cause.motor)
        if [cause.motor for cause in both] != [0, 1] or abs(np.diff([c.candidate.detail for c in both])[0]) > SAME_TIME:
            continue
        causes = tuple(cause for cause in causes if cause.candidate.kind != kind)
        by_axis = np.asarray(box.printer.from_motor(np.array([float(cause.weights[0]) for cause in both])))
        least_mm = ONE_AXIS_SHARE * np.abs(by_axis).max()
        size_mm = float(np.linalg.norm([cause.size_mm for cause in both])) / np.abs(by_axis).sum()
        axes += [
            Cause(axis, both[0].candidate, np.array([by_mm]), size_mm * abs(by_mm), sum(cause.nats for cause in both))
            for axis, by_mm in enumerate(by_axis)
            if abs(by_mm) > least_mm
        ]
    return causes, axes


def _crept_mm(cause: Cause) -> float:
    """Return how far something that creeps had come when the print ended: what is slow is not at its end yet."""
    return float(cause.weights[0] * warmed(np.ones(1), cause.candidate.detail)[0])


def _halves(causes: tuple[Cause, ...], box: GreyboxModel, trace: Trace) -> list[Misfit]:
    """Say by how much one half of the bed is off, along the bed's axes: a step of a CoreXY shows in both motors."""
    found = []
    borders = dict.fromkeys((c.candidate.detail, c.candidate.place) for c in causes if c.candidate.kind == "halves")
    for axis, place in borders:
        shares = [c for c in causes if c.candidate.kind == "halves" and c.candidate.detail == axis
                  and c.candidate.place == place]  # fmt: skip
        by_motor = np.zeros(2)
        for cause in shares:
            by_motor[cause.motor] += cause.weights[0]
        off_mm = np.asarray(box.printer.from_motor(by_motor))
        off = [f"{name} by {by:+.2f} mm" for name, by in zip("XY", off_mm, strict=True) if abs(by) >= LEAST_TOLD_MM]
        low, high = np.min(trace.commanded_mm[:, int(axis)]), np.max(trace.commanded_mm[:, int(axis)])
        where = f"in the upper part of {'XY'[int(axis)]}, from {low + (high - low) * (place + 1) / 2:.0f} mm on"
        words = f"{' and '.join(off).replace(' by ', ' is off by ', 1)} {where}"
        found.append(_of_all("halves", shares, words))
    return found


def _lagging(lags: list[Cause]) -> list[Misfit]:
    """Say by how much a head lags along the axes of a CoreXY, as its motors show it on the average."""
    if not lags:
        return []
    along = []
    for axis, name in enumerate("XY"):
        shown = [2 * abs(float(cause.weights.sum())) for cause in lags if int(cause.candidate.detail) == axis]
        along += [f"along {name} by {np.mean(shown):.2f} mm"] if shown else []
    words = (
        f"the head lags {' and '.join(along)}, whichever motor turns: a rail or the head has play, not a belt: look "
        "there first"
    )
    return [_of_all("rail-play", lags, words)]


def _of_all(kind: str, causes: list[Cause], words: str) -> Misfit:
    """Return the shares of one misfit in the motors as one finding."""
    severity = max((_severity(cause) for cause in causes), key=SEVERITIES.index)
    size_mm = float(np.linalg.norm([cause.size_mm for cause in causes]))
    return Misfit(kind, severity, size_mm, sum(cause.nats for cause in causes), words)


def _severity(cause: Cause) -> str:
    return WARNING if cause.size_mm >= WARNED_MM else NOTE


def _one_of_each(found: list[Misfit]) -> list[Misfit]:
    """Return one finding for each kind: those of both motors are joined."""
    joined: dict[str, Misfit] = {}
    for each in found:
        if (old := joined.get(each.kind)) is not None:
            each = replace(
                old, size_mm=float(np.hypot(old.size_mm, each.size_mm)), evidence=old.evidence + each.evidence,
                words=old.words if old.words == each.words else _both(old.words, each.words),
                severity=max(old.severity, each.severity, key=SEVERITIES.index),
            )  # fmt: skip
        joined[each.kind] = each
    return list(joined.values())


def _both(words: str, more: str) -> str:
    """Return what is said of two motors, what it comes from only once."""
    for why in _WHY:
        if words.endswith(why) and more.endswith(why):
            words = words.removesuffix(why)
    return f"{words}; {more}"


def _warmed(weights: np.ndarray) -> str:
    """Say by how much an axis grew from end to end, or moved where that is more."""
    grown, moved = 2 * float(weights[0]), float(weights[-1])
    return f"moved by {moved:+.2f} mm" if abs(moved) > abs(grown) else f"grew by {grown:+.2f} mm from end to end"


def _words(cause: Cause, motors: tuple[str, ...]) -> str:
    name = motors[cause.motor].upper()
    weight, detail = float(cause.weights[0]), cause.candidate.detail
    other = next((each.upper() for each in motors if each.upper() != name), "")
    is_wave = cause.candidate.kind == "rail-wave"
    axis = int(cause.candidate.place if is_wave else min(detail, 1.0))
    half = "XY"[axis] if cause.candidate.kind.startswith(("halves", "rail")) else ""
    grown = float(warmed(np.ones(1), detail)[0])
    differ_mm = 2 * widest_mm(cause.weights) if cause.candidate.kind == "two-motors" else 0.0
    swing = f"{float(np.linalg.norm(cause.weights)):.3f} mm to either side"  # a wave's amplitude
    return {
        "linear": f"{name} drifted evenly during the print, by {weight:+.2f} mm from the first point to the last",
        "step": f"{name} was suddenly off by {weight:+.2f} mm after {100 * detail:.0f} % of the print",
        "creep": f"{name} crept by {_crept_mm(cause):+.2f} mm, most of it in the first {100 * detail:.0f} % of the "
        f"print{_GIVES_WAY}",
        "wear": f"the play of {name} changed by {2 * weight:+.2f} mm while the print went on: something comes loose",
        "sticking": f"the play of {name} changed by {2 * weight:+.2f} mm while the print went on{_STICKS}",
        "thermal": f"{name} {_warmed(cause.weights * grown)}{_WARMS_UP}",
        "direction": f"where {name} comes to lie depends on which way {other} moved before, by "
        f"{2 * abs(weight):.2f} mm: the head or the gantry tilts: tighten its wheels",
        "racking-across": f"where {name} comes to lie depends on which way {other} moved before, the more the nearer "
        f"to its ends, by up to {2 * abs(weight):.2f} mm: the gantry racks",
        "speed": f"{name} lies {abs(weight):.2f} mm further {'back' if weight > 0 else 'on'} after long, fast "
        "moves than after short ones: slower travels make it less",
        "halves-play": f"{name} has {2 * weight:+.2f} mm more play in the upper part of {half}: the model has "
        "the mean of both",
        "racking": f"the play of {name} changes by {4 * weight:+.2f} mm from one end of {other} to the other: the "
        "gantry racks, or one of two motors is loose",
        "two-motors": f"the turn of {name} looks different at the two ends of {other}: two motors of one axis, with "
        f"pulleys that differ by up to {differ_mm:.2f} mm",
        "rail-racking": f"{name} shows a head that lags along {half} at one end of {'XY'[1 - axis]} and runs ahead at "
        f"the other, by {2 * abs(weight):.2f} mm there and back: the gantry racks",
        "rail-wave": f"{name} is off by a wave of {swing} that repeats every {detail:.1f} mm along "
        f"{half}: a guide that is not straight"
        if name == "XY"[1 - axis]
        else f"an error repeats every {detail:.1f} mm along {half}, {swing}, "
        "whichever motor turns: a rail, or an idler on the gantry",
        "second-period": f"{name} has an error that repeats every {detail:.1f} mm, {swing}: an idler or "
        "the belt, not the motor's pulley",
    }[cause.candidate.kind]


def _jumped(box: GreyboxModel) -> Iterator[Misfit]:
    """Name motors that lost their place: the model is without that, and a part may meet it anywhere."""
    for drive, jumps in zip(box.drives, box.jumps, strict=True):
        if jumps:
            words = (
                f"{drive.name.upper()} skipped during the test print. A part may be off by as much from any place on, "
                "and no file can mend that: tighten the belt, print slower or give the motor more current, then print "
                "a new test print"
            )
            yield Misfit("jump", WARNING, max(abs(jump.size_mm) for jump in jumps), 0.0, words)


def _unfit(box: GreyboxModel, trace: Trace) -> list[Misfit]:
    """Return a refusal where a model leaves too much of its own measurement's errors."""
    left, whole = box.residual_after_mm, box.residual_before_mm
    if left < max(UNFIT_MM, UNFIT_SHARE * whole):
        return []
    if (few := _without_lost(box, trace)) is not None and few[0] < max(UNFIT_MM, UNFIT_SHARE * few[1]):
        return []
    words = (
        f"the model leaves {left:.2f} mm of {whole:.2f} mm: this measurement is not of a printer that repeats itself, "
        "or its rows are not those of the print"
    )
    return [Misfit("unfit", REFUSAL, left, SURE_NATS, words)]


def _random_order(box: GreyboxModel, trace: Trace) -> list[Misfit]:
    """Say where rows that are in no order leave what play leaves where its direction is not known: one of two values.

    Errors that last from row to row, as lost steps do, say that the order is the print's all the same.
    """
    residual, known, lost = _lost(box)
    kept = residual[known & ~lost]
    if len(kept) < LEAST_ROWS or not in_no_order(trace.commanded_mm):
        return []
    freed = kept - kept.mean(axis=0)
    lasting = (freed[1:] * freed[:-1]).sum(axis=0) / np.maximum(np.square(freed).sum(axis=0), 1e-18)
    if lasting.max() > RANDOM_SDS / np.sqrt(len(kept)):
        return []
    left = float(np.sqrt(np.mean(np.square(box.printer.from_motor(kept)).sum(axis=1))))
    size_mm = np.sqrt(np.mean(np.square(kept), axis=0))
    kurtosis = np.mean(kept**4, axis=0) / np.maximum(size_mm**4, 1e-18)
    if ((kurtosis < TWO_VALUED) & (size_mm > LEAST_TWO_MM)).any():
        words = (
            f"the rows are in a random order, and {left:.2f} mm of the error go one way or the other, as play does: "
            "without the order of the print its play cannot be learned. Put the rows in the order of the print"
        )
        return [Misfit("rows-random", REFUSAL, left, SURE_NATS, words)]
    as_noise = (kurtosis > NOISE_KURTOSIS - RANDOM_SDS * np.sqrt(24 / len(kept))).all()  # 24/n: its variance by chance
    if left < LEAST_SCATTER_MM or (as_noise and left <= UNFIT_MM):
        return []
    words = (
        f"the rows are in a random order, and {left:.2f} mm stay unexplained: if the printer did not go to these "
        "places in this order, put the rows in the order of the print"
    )
    return [Misfit("rows-random", REFUSAL if left > UNFIT_MM else WARNING, left, SURE_NATS, words)]


def _other_turns(box: GreyboxModel) -> list[Misfit]:
    """Say where an error repeats at another length than the printer's turn."""
    found = []
    for motor, drive in enumerate(box.drives):
        period, usual = drive.branches.period_mm, box.printer.axes[motor].mm_per_turn
        turns = drive.structure.pulley != "none" or drive.structure.play in ("loose", "free")
        if period == usual or not turns:
            continue
        if (times := _times_a_turn(drive)) > 1:  # a wave that comes so many times in it is all that repeats
            period /= times
        teeth = round(period / TOOTH_MM)
        is_toothed = times == 1 and abs(period - teeth * TOOTH_MM) < 1e-9
        cause = (
            f"a pulley of {teeth} teeth, or an idler's" if is_toothed else "an idler's or the belt's own, or a pulley's"
        )
        if abs(period / usual - 1) < NEAR_SHARE:
            cause = "its steps a millimetre were calibrated, or it is another pulley"
        words = (
            f"the error of {drive.name.upper()} repeats every {period:.1f} mm, not every {usual:g} as the printer's "
            f"pulley would: {cause}. The model turns by that"
        )
        found.append(Misfit("turn", NOTE, 0.0, SURE_NATS, words))
    return found


def _times_a_turn(drive: LearnedDrive) -> int:
    """Return how often the learned turn repeats itself: the greatest divisor of its waves' orders that count."""
    wave = drive.branches.mean
    sizes = np.hypot(wave.cos_mm, wave.sin_mm)
    return math.gcd(*(int(k) for k in wave.harmonics[sizes > COUNTING_SHARE * sizes.max(initial=0.0)])) or 1


def _lost(box: GreyboxModel) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return what the model leaves of the points [N, 2], which were measured [N], and which it leaves out [N]."""
    residual = np.stack([drive.choice.fit.touch.residual_mm for drive in box.drives], axis=1)
    sigma = [robust_sigma_mm(each[np.isfinite(each)]) for each in residual.T]
    known = np.isfinite(residual).all(axis=1)
    with np.errstate(invalid="ignore"):
        lost = known & ((np.abs(residual) > LOST_SIGMAS * np.array(sigma)) & (np.abs(residual) > LOST_MM)).any(axis=1)
    return residual, known, lost


def _without_lost(box: GreyboxModel, trace: Trace) -> tuple[float, float] | None:
    """Return the RMS errors [mm] that the model leaves and that there were, without the points that it leaves out; None
    where these are so many that the others may be the wrong ones."""
    residual, known, lost = _lost(box)
    kept = known & ~lost
    if lost.sum() > MOST_LOST * known.sum() or not kept.any() or len(residual) != len(trace):
        return None
    both = box.printer.from_motor(residual[kept]), (trace.measured_mm - trace.commanded_mm)[kept]
    left, whole = (float(np.sqrt(np.mean(np.square(each).sum(axis=1)))) for each in both)
    return left, whole


def told_lost(box: GreyboxModel) -> np.ndarray:
    """Return the points [N] that the model leaves out, none where these are too few to be told of."""
    _, known, lost = _lost(box)
    count = int(lost.sum())
    return lost if count >= 2 and count >= FEW_LOST * known.sum() else np.zeros_like(lost)


def _left_out(box: GreyboxModel, trace: Trace) -> list[Misfit]:
    """Count the points that the model leaves out."""
    residual, known, _ = _lost(box)
    lost = told_lost(box)
    count, share = int(lost.sum()), float(lost.sum() / max(known.sum(), 1))
    if not count:
        return []
    size = float(np.sqrt(np.mean(np.square(box.printer.from_motor(residual[lost])).sum(axis=1))))
    severity = REFUSAL if share > MOST_LOST else WARNING if share > MANY_LOST else NOTE
    advice = "many wrong points may be one wrong row: check the table" if share > MANY_LOST else "dirt, or wrong cells"
    words = (
        f"{count} of {int(known.sum())} points ({100 * share:.1f} %) lie {size:.2f} mm off and are left out: {advice}"
    )
    return [Misfit("left-out", severity, size, float(count), words)]


def as_printed(box: GreyboxModel, trace: Trace) -> tuple[Trace, tuple[Misfit, ...]]:
    """Return the trace without a turn and a shift of its plate, where they are certain, and what was taken out.

    No printer turns both of its axes alike, or misses its own home: then where the plate lay is not known, and home
    says where the bed is.
    """
    if not trace.placed or trace.wall_rows.any():
        return trace, ()
    off_mm = _off_home_mm(box, trace)
    moved = _moved(off_mm)
    turned_deg = _turn_deg(box, trace, _alike_share(box, off_mm))
    found = (*_turned(box, turned_deg), *moved)
    if not found:
        return trace, ()
    instrument = trace.instrument_doubt
    if not (turn := -np.radians(turned_deg)):
        return replace(trace, placed=False, instrument=instrument), found
    middle = np.nanmean(trace.measured_mm, axis=0)
    back = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    measured = (trace.measured_mm - middle) @ back + middle
    return replace(trace, measured_mm=measured, placed=False, instrument=instrument), found


def _alike_share(box: GreyboxModel, off_mm: np.ndarray | None) -> float:
    """Return which share of the larger lean of both axes the smaller one must be at least for a plate that lay turned;
    ``off_mm`` is where everything lies from home, None where that is not known."""
    if box.printer.kinematics != "corexy":
        return ALIKE_SHARE
    if off_mm is None:
        return ALIKE_SHARE_COREXY_ANYWHERE
    return ALIKE_SHARE_COREXY if _moved(off_mm) else 1.0  # none: no plate turns about the place of home


def _turn_deg(box: GreyboxModel, trace: Trace, share: float) -> float:
    """Return by how much both axes are turned alike [°], 0 where they are not, or only at one place of a bent frame."""
    everywhere = _alike_deg(_mean_slopes(box, trace), box, share)
    return _alike_deg(observed_stretch(box).matrix, box, share) if everywhere else 0.0


def _mean_slopes(box: GreyboxModel, trace: Trace) -> np.ndarray:
    """Return the linear error [2, 2] that is nearest to a frame and its motors' scales over what was measured."""
    rows = motor_rows(trace, box.printer, box.periods_mm)
    touched = [drive.choice.fit.touch.at >= 0 for drive in box.drives]
    used = np.flatnonzero(trace.measured_rows & touched[0] & touched[1])
    off = np.zeros((len(used), 2))
    for motor, drive in enumerate(box.drives):
        smooth = drive.choice.design.mask("mean_powers", "cross")
        off[:, motor] = (
            columns_of(drive.choice, rows[motor], used)[:, smooth] @ drive.choice.fit.posterior.values[smooth]
        )
    columns = np.column_stack([trace.commanded_mm[used], np.ones(len(used))])
    return np.asarray(np.linalg.lstsq(columns, np.asarray(box.printer.from_motor(off)), rcond=None)[0][:2].T)


def _alike_deg(matrix: np.ndarray, box: GreyboxModel, share: float) -> float:
    """Return by how much a linear error [2, 2] turns both axes alike [°], the one by this ``share`` of the other at
    least, 0 where it does not."""
    turns = np.degrees([np.arctan(matrix[1, 0]), np.arctan(-matrix[0, 1])])
    corexy = box.printer.kinematics == "corexy"
    least, most = np.abs(turns).min(), np.abs(turns).max()
    alike = least > max(TURNED_DEG, share * most) and turns[0] * turns[1] > 0
    return float(np.sign(turns[0]) * ((least + most) / 2 if corexy else least)) if alike else 0.0


def _turned(box: GreyboxModel, both: float) -> list[Misfit]:
    if not both:
        return []
    size = float(np.radians(abs(both)) * np.hypot(box.printer.x.length_mm, box.printer.y.length_mm) / 4)
    cause = "no printer does: the plate, or the camera, lay turned"
    if box.printer.kinematics == "corexy":
        cause = (
            "a printer does only if its frame is skewed and its pulleys differ in size as well: more likely the plate, "
            "or the camera, lay turned"
        )
    words = f"everything is turned by {both:+.2f}°, which {cause}. That is taken out"
    return [Misfit("turned", NOTE, size, SURE_NATS, words)]


def _off_home_mm(box: GreyboxModel, trace: Trace) -> np.ndarray | None:
    """Return how far from where home says everything lies [2] mm, None where the trace does not tell."""
    home = box.printer.to_motor(np.array(box.printer.home_mm))
    sds = [float(np.max(drive.sd_mm(home[[motor]]))) for motor, drive in enumerate(box.drives)]
    if not trace.homed or max(sds) > HOME_SD_MM:
        return None
    belts = box.printer.to_motor(box.mechanism.frame.invert(np.array(box.printer.home_mm)[None]))[0]
    off = np.zeros(2)
    for motor, table in enumerate(box.mechanism.transmissions):
        low, high = (float(each[0]) for each in table.branches_mm(home[[motor]]))
        off[motor] = max(low - belts[motor], 0.0) - max(belts[motor] - high, 0.0)
    return np.asarray(box.printer.from_motor(off))


def _moved(off_mm: np.ndarray | None) -> list[Misfit]:
    """Say that a plate lay shifted where everything lies far from home."""
    if off_mm is None or (size := float(np.hypot(*off_mm))) <= MOVED_MM:
        return []
    words = (
        f"everything lies ({off_mm[0]:+.2f}, {off_mm[1]:+.2f}) mm from where home says: the plate was shifted "
        "or turned, or the nozzle has an offset. That is taken out"
    )
    return [Misfit("moved", NOTE, size, SURE_NATS, words)]


def _unseen(box: GreyboxModel, trace: Trace) -> list[Misfit]:
    """Say which part of the bed was never measured; home, where every print begins, shows nothing of the way there."""
    known = trace.measured_rows & ((np.arange(len(trace)) > 0) | (not trace.homed))
    parts = []
    for axis, name, places in zip((box.printer.x, box.printer.y), "XY", trace.commanded_mm[known].T, strict=True):
        low, high = float(places.min()), float(places.max())
        if high - low < COVERED_SHARE * (axis.max_mm - axis.min_mm):
            parts.append(f"{name} from {low:.0f} to {high:.0f} mm of {axis.min_mm:.0f} to {axis.max_mm:.0f}")
    if not parts:
        return []
    words = f"only {' and '.join(parts)} was measured: elsewhere the printer is thought to go on as it does there"
    return [Misfit(UNSEEN, NOTE, 0.0, 0.0, words)]
