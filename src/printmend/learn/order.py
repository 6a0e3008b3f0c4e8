"""Find rows of a table that were reversed, shuffled or shifted, and put them in order.

Dynamic programming finds the cheapest history of shifts under a rough map of the bed; an order is found by the map
under which positions and commands agree. In a reversed table, layers go down. A correction is accepted only if the
drives fit the corrected rows far better than the original ones, because play in a fine path also looks like a shift.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from printmend.effects import scene_of
from printmend.effects.effect import SCALE_MM
from printmend.effects.prior import size_mm
from printmend.errors import TraceError
from printmend.infer.fit import Fit, fitted
from printmend.learn.walls import with_walls
from printmend.measure.checks import AXES_TODO, FARTHEST_MM, counted_once, is_at_home, wrong_axes
from printmend.messages import say, together
from printmend.metrics.robust import ridge, scale_of
from printmend.model.model import NOTE, WARNING, Misfit
from printmend.path import Trace
from printmend.printer import Printer

LEAST_ORDERED_ROWS = 24  # with fewer measured rows nothing is looked for
LEAST_SPREAD_MM = 20.0  # spread of the places below which nothing is looked for
MOST_SHIFT_ROWS = 12  # largest shift that is tried, either way
MOST_ROWS_FOLLOWED = 3000  # most measured rows whose shifts are followed; of more, every n-th
MOST_ROWS_MAPPED = 20_000  # measured rows that a rough map looks at
LEAST_SCALE_MM = 0.05  # smallest standard deviation that is assumed of what a rough map leaves
MOST_NATS_A_PLACE = 12.0  # one place costs no more, however far it is off: an outlier decides nothing
CHANGE_NATS = 30.0  # nats for each change of the shift
MOST_CHANGES = 12  # of the shift in one table: cells slip a few times, a machine's error along a fine path everywhere
LEAST_NATS_SAVED = 2 * CHANGE_NATS  # that a history of shifts must save beyond its changes
HISTORY_ROUNDS = 3  # rounds of finding shifts: the first under a rough map, the others under the drives learned then
BETTER_SHARE = 0.5  # rows put right must leave less than this share of what the rows as they came leave
CLOSE_SHARE = 0.2  # shuffled places are told apart where they are missed by less than this share of their distance
LEAST_MATCHED_SHARE = 0.98  # share of shuffled rows that must find one place of their own
LEAN_SD = 0.05  # prior deviation of a rough map's leans [rad], as of damaged printers
SETTLING_ROUNDS, NEAR_SHARE = 8, 0.8  # of mapping shuffled places to the nearest commands, by the nearest of them
TOLD_SHIFTS = 3  # of one table
# Effects of a machine that is roughly learned: those that most damaged printers have
ROUGH = (
    "place", "scale", "bend", "pulley", "breathing", "play", "friction", "skew", "aspect", "bent", "origin", "shift",
    "turn", "stretch", "paper",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class InOrder:
    """A trace with its rows put right, and what was found."""

    trace: Trace
    found: tuple[Misfit, ...] = ()


def once_in_order(trace: Trace, printer: Printer) -> InOrder:
    """Return a trace without copied rows, its walls completed to places, with every place in its own row, and all that
    was found. Raises `TraceError` as `in_order` does."""
    once, copies = counted_once(trace)
    ordered = in_order(with_walls(once, printer), printer)
    return replace(ordered, found=(*passed_over(once, copies), *ordered.found))


def passed_over(trace: Trace, copies: int) -> tuple[Misfit, ...]:
    """Return what is to be said of so many ``copies`` of a trace's rows, and of blank ones, that were left out."""
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
    """Return the trace with every measured place in its own row, where that is certain.

    Raises `TraceError` where the rows are certainly in no order that can be put right, or the axes are not the bed's.
    """
    if (wrong := wrong_axes(trace.commanded_mm, trace.measured_mm)) is not None:
        raise TraceError(say("trace"), wanted=say("measured-positions-along-printer-own"), came=wrong, todo=AXES_TODO)
    seen = np.flatnonzero(trace.measured_rows)
    if len(seen) < LEAST_ORDERED_ROWS or not np.isfinite(trace.commanded_mm).all():
        return InOrder(trace)
    commanded, measured = trace.commanded_mm[seen], np.clip(trace.measured_mm[seen], -FARTHEST_MM, FARTHEST_MM)
    if np.ptp(np.quantile(commanded, (0.1, 0.9), axis=0), axis=0).max() < LEAST_SPREAD_MM:
        return InOrder(trace)
    if _may_go_backwards(trace, printer):
        again = _turned_round(trace, printer)
        if _left_mm(again, printer) < BETTER_SHARE * (left_mm := _left_mm(trace, printer)):
            return _put_right(again, say("rows-reversed-order"), left_mm, kind="rows-reversed")
    plain = _map(commanded, measured)
    plain_mm = _missed_mm(plain, commanded, measured)
    backwards = _map(commanded, measured[::-1])
    if _missed_mm(backwards, commanded, measured[::-1]) < BETTER_SHARE * plain_mm:
        again = _with(trace, seen, measured[::-1])
        if _left_mm(again, printer) < BETTER_SHARE * _left_mm(trace, printer):
            return _put_right(again, say("measured-rows-reversed-order"), plain_mm, kind="rows-reversed")
    shifted = _shifted(trace, seen, printer, _mapped(plain, trace.commanded_mm))
    if shifted is not None:
        return _put_right(*shifted, plain_mm)
    if plain_mm < LEAST_SPREAD_MM / 4 or len(seen) > MOST_ROWS_MAPPED:
        return InOrder(trace)
    return _unshuffled(trace, seen, plain_mm)


def _may_go_backwards(trace: Trace, printer: Printer) -> bool:
    """Return whether layers or heights only go down, or the way does not begin at home."""
    for heights in (trace.layer, trace.z_mm):
        if heights is not None and heights[0] > heights[-1] and (np.diff(heights) <= 0).all():
            return True
    return not is_at_home(trace.commanded_mm[0], printer)


def _turned_round(trace: Trace, printer: Printer) -> Trace:
    rows = {
        name: value[::-1]
        for name in ("commanded_mm", "measured_mm", "sigma_mm", "z_mm", "layer", "z_measured_mm", "normal", "offset_mm")
        if (value := getattr(trace, name)) is not None
    }
    return replace(trace, homed=is_at_home(trace.commanded_mm[-1], printer), **rows)


def _put_right(trace: Trace, words: str, size_mm: float, *, kind: str = "rows-shifted") -> InOrder:
    found = Misfit(kind, WARNING, size_mm, LEAST_NATS_SAVED, say("rows-put-right", words))
    return InOrder(trace, (found,))


def _with(trace: Trace, rows: np.ndarray, measured_mm: np.ndarray) -> Trace:
    """Return the trace with these places [M, 2] in these rows [M] and no others."""
    moved = np.full(trace.measured_mm.shape, np.nan)
    moved[rows] = measured_mm
    return replace(trace, measured_mm=moved)


def _map(commanded: np.ndarray, measured: np.ndarray) -> np.ndarray:
    """Return a robust affine map [3, 2] from commands to places, assumed to be close to a plain shift."""
    every = max(1, len(commanded) // MOST_ROWS_MAPPED)
    commanded, measured = commanded[::every], measured[::every]
    middle = np.median(commanded, axis=0)
    columns = np.column_stack([np.ones(len(commanded)), commanded - middle])
    shift, fit = np.median(measured - commanded, axis=0), np.zeros((3, 2))
    for axis in range(2):
        sds = np.array([FARTHEST_MM, *np.where(np.arange(2) == axis, size_mm("scale") / SCALE_MM, LEAN_SD)])
        off = measured[:, axis] - commanded[:, axis] - shift[axis]
        first_mm = scale_of(off, LEAST_SCALE_MM)
        fit[:, axis], _, _ = ridge(columns, off, sds, first_mm=first_mm, least_mm=LEAST_SCALE_MM)
        fit[[0, 1 + axis], axis] += shift[axis] + middle[axis], 1.0
    return np.vstack([fit[0] - middle @ fit[1:], fit[1:]])


def _mapped(fit: np.ndarray, commanded: np.ndarray) -> np.ndarray:
    return np.asarray(fit[0] + commanded @ fit[1:])


def _missed_mm(fit: np.ndarray, commanded: np.ndarray, measured: np.ndarray) -> float:
    """Return the median distance of places from where a map has them."""
    return float(np.median(np.hypot(*(measured - _mapped(fit, commanded)).T)))


def _shifted(trace: Trace, seen: np.ndarray, printer: Printer, places_mm: np.ndarray) -> tuple[Trace, str] | None:
    """Return the trace with shifts of its rows undone, and what they were; None without any.

    ``places_mm`` [N, 2] is where a rough map has every row; later rounds ask the drives that were learned from the
    rows put right. Cells move by rows of the table, or by measured places where others are empty.
    """
    best: tuple[Trace, str] | None = None
    least_mm = np.inf
    for _ in range(HISTORY_ROUNDS):
        learned = None
        for again, words in _undone(trace, seen, places_mm):
            if not np.isfinite(least_mm):
                least_mm = BETTER_SHARE * _left_mm(trace, printer)
            one, left_mm = _left_by(again, printer)
            if left_mm < least_mm:
                best, least_mm, learned = (again, words), left_mm, one
        if learned is None:
            break
        places_mm = learned.places_mm()
    return best


def _undone(trace: Trace, seen: np.ndarray, places_mm: np.ndarray) -> Iterator[tuple[Trace, str]]:
    """Yield what the trace would be without the likeliest history of shifts, and without its commonest shift."""
    found = []
    everywhere = np.arange(len(trace))
    for places in (everywhere, seen) if len(seen) < len(trace) else (everywhere,):
        at = np.searchsorted(places, seen)  # the number of each measured row among the places
        measured = np.clip(trace.measured_mm[seen], -FARTHEST_MM, FARTHEST_MM)
        history, saved = _history(places_mm[places], at, measured)
        if saved > LEAST_NATS_SAVED and history.any() and np.count_nonzero(np.diff(history)) <= MOST_CHANGES:
            found.append((saved, places, at, history))
    if not found:
        return
    _, places, at, history = max(found, key=lambda each: each[0])
    commonest = np.full(len(history), np.bincount(history + MOST_SHIFT_ROWS).argmax() - MOST_SHIFT_ROWS)
    for shifts in (history, commonest) if (commonest != history).any() and commonest.any() else (history,):
        to = at - shifts
        kept = (to >= 0) & (to < len(places)) & (np.diff(to, prepend=-1) > 0)
        yield _with(trace, places[to[kept]], trace.measured_mm[seen[kept]]), _history_words(seen, shifts)


def _history(places_mm: np.ndarray, at: np.ndarray, measured: np.ndarray) -> tuple[np.ndarray, float]:
    """Return by how many places each measured row is shifted [M], and by how many nats that is cheaper than not at all.

    ``places_mm`` [P, 2] is where a rough map has every place, ``at`` [M] the place whose row a measurement is in.
    """
    every = max(1, len(at) // MOST_ROWS_FOLLOWED)
    looked = np.arange(0, len(at), every)
    shifts = np.arange(-MOST_SHIFT_ROWS, MOST_SHIFT_ROWS + 1)
    to = np.clip(at[looked, None] - shifts, 0, len(places_mm) - 1)
    away = np.square(measured[looked, None] - places_mm[to]).sum(axis=2)
    # the scale is that of the best shift at each row: what a shift cannot explain is the machine's
    # and no less than a tenth of what all places miss in their own rows
    best, own = np.median(away.min(axis=1)), np.median(away[:, MOST_SHIFT_ROWS])
    cost = np.minimum(away / (2 * max(best, own / 10**2, LEAST_SCALE_MM**2)), MOST_NATS_A_PLACE)
    total, back = cost[0].copy(), np.zeros(cost.shape, np.int64)
    stay = np.arange(len(shifts))
    for row in range(1, len(cost)):
        cheapest = int(np.argmin(total))
        changed = total[cheapest] + CHANGE_NATS < total
        back[row] = np.where(changed, cheapest, stay)
        total = np.where(changed, total[cheapest] + CHANGE_NATS, total) + cost[row]
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
    for start in starts[:TOLD_SHIFTS]:
        shift = int(history[start])
        low, high = ("row-too-low", "row-too-high") if abs(shift) == 1 else ("rows-too-low", "rows-too-high")
        way = say(low if shift > 0 else high, abs(shift)) if shift else say("right-again")
        parts.append(say("from-row-on", seen[start] + 1, way))
    return say("measured-cells-stood", together(", ", [*parts, *(["…"] if len(starts) > TOLD_SHIFTS else [])]))


def roughly(trace: Trace, printer: Printer) -> Fit:
    """Return the drives' main parts alone, as some rows show them."""
    scene = scene_of(trace, printer)
    with threadpool_limits(1, user_api="blas"):
        return fitted(trace, scene, names=ROUGH, quick=True)


def _left_by(trace: Trace, printer: Printer) -> tuple[Fit, float]:
    """Return the drives as roughly learned from a trace, whose home is not settled yet, and the mean distance of its
    places from where these drives put them."""
    fit = roughly(replace(trace, homed=False), printer)
    return fit, float(np.nanmean(np.abs(fit.left_by_mark_mm(trace))) * 2)


def _left_mm(trace: Trace, printer: Printer) -> float:
    """Return the mean distance of places from where their roughly learned drives have them."""
    return _left_by(trace, printer)[1]


def _unshuffled(trace: Trace, seen: np.ndarray, plain_mm: float) -> InOrder:
    """Return the trace with shuffled places put back, where each has but one row that it can belong to."""
    from printmend.metrics.shape import nearest, spacing  # with shapely, for shuffled rows alone

    commanded, measured = trace.commanded_mm[seen], trace.measured_mm[seen]
    fit = np.vstack([np.zeros(2), np.eye(2)])
    if not trace.placed:
        fit[0] = np.median(measured, axis=0) - np.median(commanded, axis=0)
    for _ in range(SETTLING_ROUNDS):
        away, to = nearest(_mapped(fit, commanded), measured)
        near = away <= np.quantile(away, NEAR_SHARE)
        fit = _map(commanded[to[near]], measured[near])
    expected = _mapped(fit, commanded)
    apart = float(np.median(spacing(expected)))
    away, to = nearest(expected, measured)
    if np.median(away) > min(plain_mm * BETTER_SHARE, LEAST_SPREAD_MM / 4):
        return InOrder(trace)  # no order of these rows makes them a measurement of this print
    counts = np.bincount(to, minlength=len(seen))
    single = counts[to] == 1
    if np.quantile(away, LEAST_MATCHED_SHARE) > CLOSE_SHARE * apart or single.mean() < LEAST_MATCHED_SHARE:
        raise TraceError(
            say("trace"), wanted=say("each-measured-point-row-own-command"),
            came=say("same-points-another-order"),
            todo=say("measure-again-order-rows-let-printmend"),
        )  # fmt: skip
    again = _with(trace, seen[to[single]], measured[single])
    words = say("measured-rows-shuffled-certain", int(single.sum()), len(seen))
    return _put_right(again, words, plain_mm, kind="rows-shuffled")
