"""How is a table to be read? Its rows reversed, shifted or shuffled, or as they came: the likeliest reading stands.

Each reading has prior odds (`effects/priors.toml`). Those that a rough map of the bed makes likely are learned from
roughly, and held against the rows as they came by what either leaves. How far rows slipped is the likeliest history
under that map, in which a slip costs its odds (Viterbi 1967).
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from printmend.effects import scene_of
from printmend.effects.effect import FAR_MM, SCALE_MM
from printmend.effects.prior import rows_share, size_mm
from printmend.errors import TraceError
from printmend.infer.first import among
from printmend.infer.fit import Fit, fitted
from printmend.infer.search import LEAST_SIGMA_MM
from printmend.machine import healthy_mechanism
from printmend.measure.axes import AXES_TODO, wrong_axes
from printmend.measure.follows import FARTHEST_MM
from printmend.measure.table import AT_HOME_MM
from printmend.messages import say, together
from printmend.metrics.robust import log_likelihood, own_share, ridge, scale_of
from printmend.metrics.shape import nearest, spacing
from printmend.model.misfit import NOTE, WARNING, Misfit
from printmend.path import Trace
from printmend.printer import Printer

LEAST_ROWS = 24  # with fewer measured rows nothing is looked for
LEAST_SPREAD_MM = 20.0  # spread of the places below which nothing is looked for
MOST_SHIFT_ROWS = 12  # largest shift that is tried, either way
MOST_ROWS_FOLLOWED = 3000  # most measured rows whose shifts are followed; of more, every n-th
MOST_ROWS_MAPPED = 20_000  # measured rows that a rough map looks at
LEAST_SCALE_MM = 0.05  # smallest standard deviation assumed for the residuals of a rough map
ROUNDS = 3  # of finding slips, the first under a rough map, the others under the drives learned then
MAP_ROUNDS = 8  # of mapping places that are in no order
LEAST_MATCHED_SHARE = 0.98  # share of shuffled rows that must find one place of their own
# Effects of a machine that is roughly learned: those that most damaged printers have
ROUGH = (
    "place", "scale", "bend", "pulley", "breathing", "play", "friction", "skew", "aspect", "bent", "origin", "shift",
    "turn", "stretch",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class InOrder:
    """A trace with its rows put right, and what was found."""

    trace: Trace
    found: tuple[Misfit, ...] = ()


@dataclass(frozen=True, eq=False)
class Reading:
    """A way to read a table: its rows put so, the logarithm of its odds against the rows as they came, its words."""

    trace: Trace
    log_odds: float
    kind: str
    words: str
    is_certain: bool = True  # which row each place belongs to


def passed_over(trace: Trace, copies: int) -> tuple[Misfit, ...]:
    """Return notes about ``copies`` of a trace's rows and blank ones that were left out."""
    found = []
    if copies:
        every = copies + int(trace.measured_rows.sum() + trace.wall_rows.sum())
        words = say("measured-rows-copies-others-last-digit", copies, every)
        found.append(Misfit("rows-repeated", NOTE, 0.0, 0.0, words))
    if trace.blank_rows:
        words = say("blank-rows-inside-table-passed-over", trace.blank_rows)
        found.append(Misfit("rows-blank", NOTE, 0.0, 0.0, words))
    return tuple(found)


def in_order(trace: Trace, printer: Printer) -> InOrder:
    """Return the trace as it is to be read.

    Raises `TraceError` where the rows are certainly in no order that can be put right, or the axes are not the bed's.
    """
    if (wrong := wrong_axes(trace.commanded_mm, trace.measured_mm)) is not None:
        raise TraceError(say("trace"), wanted=say("measured-positions-along-printer-own"), came=wrong, todo=AXES_TODO)
    seen = np.flatnonzero(trace.measured_rows)
    if len(seen) < LEAST_ROWS or not np.isfinite(trace.commanded_mm).all():
        return InOrder(trace)
    commanded, measured = _seen(trace, seen)
    if np.ptp(np.quantile(commanded, (0.1, 0.9), axis=0), axis=0).max() < LEAST_SPREAD_MM:
        return InOrder(trace)
    plain = _map(commanded, measured)
    size_mm, places_mm = _missed_mm(plain, commanded, measured), _mapped(plain, trace.commanded_mm)
    best, gain, came = None, 0.0, None
    for _ in range(ROUNDS):
        newer = None
        for reading in _readings(trace, seen, places_mm, printer, is_first=came is None):
            came = came or roughly(trace, printer)
            fit = roughly(reading.trace, printer)
            nats = likelier_nats(fit, reading.trace, came, trace) + reading.log_odds
            if nats > (gain if best is None or best.is_certain else 0.0):
                best, gain, newer = reading, nats, fit
        if newer is None:
            break
        places_mm = newer.places_mm()
    if best is None:
        return InOrder(trace)
    if not best.is_certain:
        raise TraceError(
            say("trace"), wanted=say("each-measured-point-row-own-command"),
            came=say("same-points-another-order"),
            todo=say("measure-again-order-rows-let-printmend"),
        )  # fmt: skip
    return InOrder(best.trace, (Misfit(best.kind, WARNING, size_mm, gain, say("rows-put-right", best.words)),))


def roughly(trace: Trace, printer: Printer) -> Fit:
    """Return the main parts of the drives from some rows; the trace's home is still unknown."""
    scene = scene_of(replace(trace, homed=False), printer, (printer.x.mm_per_turn, printer.y.mm_per_turn))
    with threadpool_limits(1, user_api="blas"):
        return fitted(trace, scene, healthy_mechanism(printer), kept=among(ROUGH), quick=True)


def likelier_nats(rival: Fit, of: Trace, than: Fit, came: Trace) -> float:
    """Return by how much a rival, a fit ``of`` a trace, is likelier than a fit of the trace as it ``came``.

    Where what the rival leaves is alike from mark to mark, so many of them tell the same.
    """
    theirs_mm, ours_mm = rival.left_by_mark_mm(of), than.left_by_mark_mm(came)
    known, other = (np.isfinite(each).all(axis=1) for each in (theirs_mm, ours_mm))
    if of is came:
        known = other = known & other
    theirs_mm, ours_mm = theirs_mm[known].ravel("F"), ours_mm[other].ravel("F")
    count = ours_mm.size * own_share(theirs_mm, scale_of(theirs_mm, LEAST_SIGMA_MM))
    their, our = (log_likelihood(each, LEAST_SIGMA_MM) / each.size for each in (theirs_mm, ours_mm))
    return count * (their - our) + _of_set(rival) - _of_set(than)


def _of_set(fit: Fit) -> float:
    """Return the logarithm of the odds of a fit's effects, less what their freedom costs."""
    gram, state = fit.search.gram, fit.state
    left = gram.square - gram.slope[state.columns] @ state.mean_mm
    return state.score + 0.5 * (gram.count * math.log(state.sigma_mm**2) + float(left) / state.sigma_mm**2)


def _readings(
    trace: Trace, seen: np.ndarray, places_mm: np.ndarray, printer: Printer, *, is_first: bool
) -> Iterator[Reading]:
    """Yield how else a table may be read, where its places [N, 2] are about known."""
    reversed_ = math.log(rows_share("reversed"))
    if is_first and _goes_backwards(trace, printer):
        yield Reading(_turned_round(trace, printer), reversed_, "rows-reversed", say("rows-reversed-order"))
    commanded, measured = _seen(trace, seen)
    if is_first and reversed_ + _best_nats(commanded, measured[::-1]) > _best_nats(commanded, measured):
        words = say("measured-rows-reversed-order")
        yield Reading(_with(trace, seen, trace.measured_mm[seen[::-1]]), reversed_, "rows-reversed", words)
    yield from _slipped(trace, seen, places_mm)
    yield from _unshuffled(trace, seen, None if is_first else places_mm[seen])


def _goes_backwards(trace: Trace, printer: Printer) -> bool:
    """Say whether layers or heights only go down, or the way ends at home and begins elsewhere."""
    for heights in (trace.layer, trace.z_mm):
        if heights is not None and heights[0] > heights[-1] and (np.diff(heights) <= 0).all():
            return True
    away_mm = np.abs(trace.commanded_mm[[0, -1]] - np.array(printer.home_mm)).max(axis=1)
    return bool(away_mm[1] <= AT_HOME_MM < away_mm[0])


def _turned_round(trace: Trace, printer: Printer) -> Trace:
    rows = {
        name: value[::-1]
        for name in ("commanded_mm", "measured_mm", "sigma_mm", "z_mm", "layer", "z_measured_mm", "normal", "offset_mm")
        if (value := getattr(trace, name)) is not None
    }
    at_home = np.abs(trace.commanded_mm[-1] - np.array(printer.home_mm)).max() <= AT_HOME_MM
    return replace(trace, homed=bool(at_home), **rows)


def _with(trace: Trace, rows: np.ndarray, measured_mm: np.ndarray) -> Trace:
    """Return the trace with these places [M, 2] in these rows [M] and no others."""
    moved = np.full(trace.measured_mm.shape, np.nan)
    moved[rows] = measured_mm
    return replace(trace, measured_mm=moved)


def _seen(trace: Trace, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return where some rows were commanded and measured [M, 2], a wild cell no farther than it can be."""
    return trace.commanded_mm[rows], np.clip(trace.measured_mm[rows], -FARTHEST_MM, FARTHEST_MM)


def _map(commanded: np.ndarray, measured: np.ndarray) -> np.ndarray:
    """Return a robust affine map [3, 2] from commands to places, thought to be next to a plain shift."""
    every = max(1, len(commanded) // MOST_ROWS_MAPPED)
    commanded, measured = commanded[::every], measured[::every]
    middle = np.median(commanded, axis=0)
    columns = np.column_stack([np.ones(len(commanded)), commanded - middle])
    shift, fit = np.median(measured - commanded, axis=0), np.zeros((3, 2))
    for axis in range(2):
        slopes = np.where(np.arange(2) == axis, size_mm("scale"), size_mm("skew")) / SCALE_MM
        off = measured[:, axis] - commanded[:, axis] - shift[axis]
        first_mm = scale_of(off, LEAST_SCALE_MM)
        sds = np.array([FARTHEST_MM, *slopes])
        fit[:, axis], _, _ = ridge(columns, off, sds, first_mm=first_mm, least_mm=LEAST_SCALE_MM)
        fit[[0, 1 + axis], axis] += shift[axis] + middle[axis], 1.0
    return np.vstack([fit[0] - middle @ fit[1:], fit[1:]])


def _mapped(fit: np.ndarray, commanded: np.ndarray) -> np.ndarray:
    return np.asarray(fit[0] + commanded @ fit[1:])


def _missed_mm(fit: np.ndarray, commanded: np.ndarray, measured: np.ndarray) -> float:
    """Return the median distance of places from where a map has them."""
    return float(np.median(np.hypot(*(measured - _mapped(fit, commanded)).T)))


def _best_nats(commanded: np.ndarray, measured: np.ndarray) -> float:
    """Return the log likelihood of places under the map that fits them."""
    return _nats_of(measured - _mapped(_map(commanded, measured), commanded))


def _nats_of(left_mm: np.ndarray) -> float:
    """Return the log likelihood of what a map leaves [M, 2]."""
    return sum(log_likelihood(axis, LEAST_SCALE_MM) for axis in left_mm.T)


def _slipped(trace: Trace, seen: np.ndarray, places_mm: np.ndarray) -> Iterator[Reading]:
    """Yield what the trace would be without the likeliest history of slips, and without its commonest shift.

    Cells move by rows of the table, or by measured places where others are empty.
    """
    found = []
    everywhere = np.arange(len(trace))
    for places in (everywhere, seen) if len(seen) < len(trace) else (everywhere,):
        at = np.searchsorted(places, seen)  # the number of each measured row among the places
        history, saved = _history(places_mm[places], at, _seen(trace, seen)[1])
        if saved > 0 and history.any():
            found.append((saved, places, at, history))
    if not found:
        return
    _, places, at, history = max(found, key=lambda each: each[0])
    commonest = np.full(len(history), np.bincount(history + MOST_SHIFT_ROWS).argmax() - MOST_SHIFT_ROWS)
    for shifts in (history, commonest) if (commonest != history).any() and commonest.any() else (history,):
        to = at - shifts
        kept = (to >= 0) & (to < len(places)) & (np.diff(to, prepend=-1) > 0)
        log_odds = -_slip_nats(len(seen)) * np.count_nonzero(np.diff(shifts, prepend=0))
        again = _with(trace, places[to[kept]], trace.measured_mm[seen[kept]])
        yield Reading(again, log_odds, "rows-shifted", _history_words(seen, shifts))


def _slip_nats(rows: int) -> float:
    """Return what a slip costs: it may come at any row, and be of any size."""
    return -math.log(rows_share("slips") / (2 * MOST_SHIFT_ROWS * rows))


def _history(places_mm: np.ndarray, at: np.ndarray, measured: np.ndarray) -> tuple[np.ndarray, float]:
    """Return by how many places each measured row is shifted [M], and by how many nats that is likelier than none.

    ``places_mm`` [P, 2] is where a rough map has every place, ``at`` [M] the place whose row a measurement is in.
    """
    every = max(1, len(at) // MOST_ROWS_FOLLOWED)
    looked = np.arange(0, len(at), every)
    shifts = np.arange(-MOST_SHIFT_ROWS, MOST_SHIFT_ROWS + 1)
    to = np.clip(at[looked, None] - shifts, 0, len(places_mm) - 1)
    away = np.square(measured[looked, None] - places_mm[to]).sum(axis=2)
    # the scale is that of the best shift at each row: what a shift cannot explain is the machine's
    scale2 = max(float(np.median(away.min(axis=1))), LEAST_SCALE_MM**2)
    lost = rows_share("lost")  # and lies anywhere
    cost = -np.log((1 - lost) * np.exp(-away / (2 * scale2)) + lost * 2 * np.pi * scale2 / (2 * FAR_MM) ** 2)
    slip = _slip_nats(len(looked))
    stay = np.arange(len(shifts))
    total, back = cost[0] + slip * (shifts != 0), np.zeros(cost.shape, np.int64)
    for row in range(1, len(cost)):
        cheapest = int(np.argmin(total))
        changed = total[cheapest] + slip < total
        back[row] = np.where(changed, cheapest, stay)
        total = np.where(changed, total[cheapest] + slip, total) + cost[row]
    state = int(np.argmin(total))
    saved = float(cost[:, MOST_SHIFT_ROWS].sum() - total[state])
    states = np.empty(len(cost), np.int64)
    for row in range(len(cost) - 1, -1, -1):
        states[row] = state
        state = int(back[row, state])
    return shifts[states][np.minimum(np.arange(len(at)) // every, len(states) - 1)], saved


def _history_words(seen: np.ndarray, history: np.ndarray) -> str:
    starts = np.flatnonzero(np.diff(history, prepend=0))
    parts = []
    for start in starts[:3]:
        shift = int(history[start])
        low, high = ("row-too-low", "row-too-high") if abs(shift) == 1 else ("rows-too-low", "rows-too-high")
        way = say(low if shift > 0 else high, abs(shift)) if shift else say("right-again")
        parts.append(say("from-row-on", seen[start] + 1, way))
    return say("measured-cells-stood", together(", ", [*parts, *(["…"] if len(starts) > 3 else [])]))


def _unshuffled(trace: Trace, seen: np.ndarray, expected: np.ndarray | None) -> Iterator[Reading]:
    """Yield the trace with shuffled places put back, where the rows ``expected`` them [M, 2], or where a map does."""
    commanded, measured = _seen(trace, seen)
    log_odds = math.log(rows_share("shuffled")) - math.lgamma(len(seen) + 1)  # any order is as likely as another
    came, least = _best_nats(commanded, measured), -measured.size * math.log(LEAST_SCALE_MM)  # no map leaves less
    if len(seen) > MOST_ROWS_MAPPED or least + log_odds < came:
        return
    expected = _matched(trace, commanded, measured) if expected is None else expected
    away_mm, to = nearest(expected, measured)
    single = np.bincount(to, minlength=len(seen))[to] == 1
    left_mm = measured - expected[to]
    if single.sum() < LEAST_ROWS or _nats_of(left_mm) + log_odds < came:
        return  # no order of these rows makes them a measurement of this print
    next_mm = np.maximum(spacing(expected)[to] - away_mm, 0.0)  # another row is no nearer
    others = np.exp((away_mm**2 - next_mm**2) / (2 * scale_of(left_mm, LEAST_SCALE_MM) ** 2))  # … and has these odds
    sure = single / (1 + others)
    words = say("measured-rows-shuffled-certain", int(single.sum()), len(seen))
    again = _with(trace, seen[to[single]], trace.measured_mm[seen[single]])
    log_odds += float(np.log(sure[single]).sum())
    yield Reading(again, log_odds, "rows-shuffled", words, is_certain=bool(sure.mean() > LEAST_MATCHED_SHARE))


def _matched(trace: Trace, commanded: np.ndarray, measured: np.ndarray) -> np.ndarray:
    """Return where the map has commands [M, 2] under which they and places in no order agree."""
    fit = np.vstack([np.zeros(2), np.eye(2)])
    if not trace.placed:
        fit[0] = np.median(measured, axis=0) - np.median(commanded, axis=0)
    for _ in range(MAP_ROUNDS):
        _, to = nearest(_mapped(fit, commanded), measured)
        fit = _map(commanded[to], measured)
    return _mapped(fit, commanded)
