"""How long a motor's turn is: what its printer says, unless the measurement clearly repeats at another length.

A pulley of 16 teeth where the preset has 20 turns every 32 mm, not every 40; an idler or the belt itself has a period
of its own. For each length P on a grid, the error along the belt is fitted with a line, play, both bent along the axis,
and harmonics of P; the likelihood of Gaussian residuals of unknown size, (n/2) log(RSS₀/RSS), is what P gains over the
printer's own turn (the periodogram of least squares: Lomb 1976, Scargle 1982, with more harmonics).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from printmend.effects.teeth import TOOTH_MM
from printmend.infer.scatter import independent_share
from printmend.model import SCALE_MM
from printmend.path import last_way
from printmend.units import SIGMA_PER_MEDIAN, TURN_RAD
from printmend_lab.greybox.drive.design import Rows, cross_columns
from printmend_lab.greybox.drive.fit import robust_sigma_mm
from printmend_lab.greybox.drive.kernels import lengths_left
from printmend_lab.greybox.drive.select import PART_NATS, Choice, coarsely_fitted, fitted, likelier, main_parts

# A second period beside the motor's turn: an idler off its centre, whose length need not divide the turn.
#
# What a fit leaves, and every length that is tried, are freed of what the fit's own parts can follow; the length that
# then explains most is offered (the periodogram of least squares: Lomb 1976, Scargle 1982), made finer, and kept where
# its evidence is strong. The part that repeats nothing can imitate an idler where the print went, but not go on beyond:
# so an idler is looked for in place of it, too. To first order, an idler that turns nearly as often as the pulley does
# what an elastic belt does to an eccentric one: where such a belt was chosen, the best such idler is compared with it.

SECOND_PERIODS_MM = np.geomspace(
    12.0, 150.0, 160
)  # lengths that are tried: no idler is smaller, no bed shows larger ones
OWN_PERIOD = 0.02  # a second period is at least so far from the turn's own harmonics, as a share
OWN_TURN = 0.04  # and so far from the turn itself: the steps of a millimetre may have been calibrated
NEAR_TURN = np.linspace(0.01, 0.05, 15)  # shares of a turn by which an idler differs that an elastic belt hides
LEAST_SECOND_TURNS = 2.5  # of a second period in what was measured: fewer are a bend of the axis
LEAST_SECOND_ROWS = 120  # measured rows below which none is looked for
MOST_SECOND_ROWS = 1500  # rows that are looked at: more take time and say the same
SURE_NATS = 20.0  # log likelihood that a second period must gain, beyond the logarithm of how many are tried
LEAST_SIZE_MM = 0.01  # smallest amplitude that is worth a second period
CLIP_SIGMAS = 4.0  # standard deviations beyond which a residual is an outlier
LEAST_OWN_SHARE = 0.3  # share of a wave that the fit's own parts must leave
CONTACT_PASSES = 6  # rounds of contacts and least squares


def with_second(rows: Rows, found: Choice, ripple: tuple[int, ...]) -> Choice:
    """Return the fit with a second period where the evidence switches one on, else the same fit."""
    if int((rows.weight > 0).sum()) < LEAST_SECOND_ROWS:
        return found
    beside = _beside(rows, found, ripple)
    if not found.structure.elastic:
        return beside
    near = with_near_second(rows, found, ripple)
    return near if likelier(near, beside) > 0 else beside


def _beside(rows: Rows, found: Choice, ripple: tuple[int, ...]) -> Choice:
    """Return the fit with a second period that is no turn's, where the evidence switches one on, else the same fit."""
    plain = found
    if found.structure.warp_mm:
        pulley = "all" if found.structure.pulley == "none" else found.structure.pulley  # it may stand for both
        plain = fitted(rows, replace(found.structure, warp_mm=0.0, pulley=pulley), ripple, found, passes=CONTACT_PASSES)
    if (length_mm := likeliest_second_mm(rows, plain)) is None:
        return found
    structure = replace(plain.structure, second_mm=length_mm, offset=True)
    tried = fitted(rows, structure, ripple, plain, passes=CONTACT_PASSES)
    design, values = tried.design, tried.fit.posterior.values
    sizes = np.hypot(*(values[design.parts[name]] for name in ("second_cos", "second_sin")))
    # the simpler of the two, where the other is the part that repeats nothing
    least = -PART_NATS if found.structure.warp_mm else PART_NATS
    return tried if sizes.max() >= LEAST_SIZE_MM and likelier(tried, found) > least else found


def with_near_second(rows: Rows, found: Choice, ripple: tuple[int, ...]) -> Choice:
    """Return the fit with the best idler of nearly the turn's length in place of what does not repeat every turn."""
    freed = _freed(rows, found, found.design.mask("elastic") | found.design.mask("warp"))
    lengths = rows.period_mm * np.concatenate([1 - NEAR_TURN, 1 + NEAR_TURN])
    best = min(lengths, key=freed.left_by)
    best = float(sharpened(best, (NEAR_TURN[1] - NEAR_TURN[0]) / best, freed.left_by))
    structure = replace(found.structure, elastic=False, warp_mm=0.0, second_mm=best, pulley="all", offset=True)
    return fitted(rows, structure, ripple, found, passes=CONTACT_PASSES)


@dataclass(frozen=True, eq=False)
class Freed:
    """What a fit leaves of its rows [M] at motor places, without what its own parts, ``basis`` [M, B], can follow."""

    motor_mm: np.ndarray
    left_mm: np.ndarray
    basis: np.ndarray
    sigma_mm: float

    def left_by(self, period_mm: float, *, least_share: float = 0.0) -> float:
        """Return the sum of squares [mm²] that waves of a length leave; all, where less than a share of them is new."""
        angle = self.motor_mm * (TURN_RAD / period_mm)
        waves = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        freed = waves - self.basis @ (self.basis.T @ waves)
        if float(np.square(freed).sum()) < least_share * float(np.square(waves).sum()):
            return float(self.left_mm @ self.left_mm)
        rest = self.left_mm - freed @ np.linalg.lstsq(freed, self.left_mm, rcond=None)[0]
        return float(rest @ rest)


def _freed(rows: Rows, found: Choice, without: np.ndarray) -> Freed:
    """Return what a fit leaves when its parameters that ``without`` [P] marks are taken from it."""
    touch = found.fit.touch
    used = np.flatnonzero((rows.weight > 0) & (touch.at >= 0))
    used = used[:: max(1, -(-len(used) // MOST_SECOND_ROWS))]
    residual = touch.residual_mm[used]
    sigma = robust_sigma_mm(residual)
    basis = own_columns(found, rows, used, without)
    left = np.clip(residual, -CLIP_SIGMAS * sigma, CLIP_SIGMAS * sigma)
    left += columns_of(found, rows, used)[:, without] @ found.fit.posterior.values[without]
    return Freed(rows.motor_mm[touch.at[used]], left - basis @ (basis.T @ left), basis, sigma)


def likeliest_second_mm(rows: Rows, found: Choice) -> float | None:
    """Return the length with which the residuals of a fit surely repeat; None for none."""
    if np.count_nonzero((rows.weight > 0) & (found.fit.touch.at >= 0)) < LEAST_SECOND_ROWS:
        return None
    freed = _freed(rows, found, np.zeros(found.design.size, bool))
    periods = other_periods_mm(rows.period_mm, float(np.ptp(freed.motor_mm)) / LEAST_SECOND_TURNS)
    periods = periods[np.abs(periods / rows.period_mm - 1) > OWN_TURN]
    before = float(freed.left_mm @ freed.left_mm)
    if not len(periods) or before <= 0:
        return None
    after = partial(freed.left_by, least_share=LEAST_OWN_SHARE)
    best = min(periods, key=after)
    best = float(sharpened(best, (SECOND_PERIODS_MM[1] / SECOND_PERIODS_MM[0] - 1) / best, after))
    share = independent_share(freed.left_mm, freed.sigma_mm)
    rest = len(freed.left_mm) - freed.basis.shape[1]
    nats = share * rest / 2 * np.log(before / max(after(best), 1e-18)) - np.log(len(periods))
    return best if nats > SURE_NATS else None


def other_periods_mm(turn_mm: float, longest_mm: float) -> np.ndarray:
    """Return the lengths that are tried beside a turn and its harmonics."""
    turns = turn_mm / SECOND_PERIODS_MM
    apart = np.abs(turns / np.maximum(np.rint(turns), 1.0) - 1.0) > OWN_PERIOD
    return np.asarray(SECOND_PERIODS_MM[apart & (longest_mm > SECOND_PERIODS_MM)])


def columns_of(choice: Choice, rows: Rows, used: np.ndarray) -> np.ndarray:
    """Return what each parameter of a fit does to the rows ``used`` [M], as columns [M, P]."""
    design, touch = choice.design, choice.fit.touch
    mean, play = design.columns(rows.motor_mm[touch.at[used]], rows.period_mm, rows.origin_mm)
    columns = mean + touch.side[used, None] / 2 * play
    columns[:, design.parts["cross"]] = cross_columns(design, rows, used)
    return columns


def own_columns(choice: Choice, rows: Rows, used: np.ndarray, without: np.ndarray | None = None) -> np.ndarray:
    """Return an orthonormal basis [M, B] of what a fit's own parts can follow at the rows ``used`` [M]; parameters that
    ``without`` [P] marks are none of them."""
    active = choice.fit.posterior.active if without is None else choice.fit.posterior.active & ~without
    columns = np.column_stack([np.ones(len(used)), columns_of(choice, rows, used)[:, active]])
    basis, sizes, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(basis[:, sizes > 1e-5 * sizes[0]])


# How long a motor's turn is, and the main parts of its drive with it.
#
# What `period` says of it knows no contacts, so that wide play and a pulley with corners may look like another length,
# or hide one. Here the main parts are fitted with their contacts: a length that is no better then is not believed, and
# where a pattern is left along the belt, every whole number of teeth near the printer's is tried. Last, where the scale
# is off its cause may be a pulley of another size, which still turns as the printer says, or wrong steps a millimetre:
# then a turn is the printer's over the scale.

NEAR_TURNS = (0.65, 1.5)  # shares of the printer's turn between which whole numbers of teeth are tried
LEAST_LEFT_MM = 0.01  # mean residual below which no other turn is looked for: corners between harmonics leave as much
NO_PATTERN_SHARE = 0.9  # share of independent residuals above which no other turn is looked for
CALIBRATED_SHARE = 0.01  # first step, as a share of a turn, in which calibrated steps a millimetre are looked for
LEAST_SCALE_SHARE = 0.001  # a scale that is off by less moves no turn by as much as is seen
MOST_CROSS = 3  # highest order of a frame's terms: a bowed guide is no other turn
STEPS_NATS = 3.0  # log likelihood by which the turn of wrong steps a millimetre is believed before the printer's


def turned(rows: Rows, some: Rows, *, absolute: bool) -> tuple[float, Choice]:
    """Return how long the motor's turn is [mm], and the main parts of ``some`` of its ``rows``.

    ``absolute`` says that they were measured by an instrument which knows its scale.
    """
    span_mm = float(np.ptp(rows.motor_mm[rows.weight > 0])) if rows.weight.any() else 0.0
    is_seen = bool(span_mm > LEAST_TURNS * rows.period_mm and np.count_nonzero(some.weight) > LEAST_ROWS)
    period_mm, found = _freely_turned(rows, some, is_seen=is_seen)
    off = float(found.fit.posterior.values[found.design.parts["mean_powers"]][1]) / SCALE_MM
    if not (absolute and is_seen and LEAST_SCALE_SHARE < abs(off) < NEAR_SHARE):
        return period_mm, found
    stepped_mm = rows.period_mm / (1 + off)
    structure = replace(found.structure, pulley="all", cross=MOST_CROSS if found.structure.cross else 0)
    either = [replace(some, period_mm=length_mm) for length_mm in (stepped_mm, period_mm)]
    same, free = (coarsely_fitted(each, structure, found) for each in either)
    if likelier(same, free) < STEPS_NATS:
        return period_mm, found
    stepped = main_parts(either[0])
    is_all = _share(some, stepped) > NO_PATTERN_SHARE
    return (stepped_mm, stepped) if is_all and likelier(stepped, found) > 0 else (period_mm, found)


def _freely_turned(rows: Rows, some: Rows, *, is_seen: bool) -> tuple[float, Choice]:
    """Return what `turned` does, whatever the scale is."""
    period_mm, found = roughly_turned(rows, some)
    if is_seen and found.fit.loss_mm > LEAST_LEFT_MM and _share(some, found) < NO_PATTERN_SHARE:
        toothed_mm = _toothed(some, period_mm, found)
        toothed = main_parts(replace(some, period_mm=toothed_mm))
        if _share(some, toothed) * _nats(some, found, toothed) > LEAST_NATS:
            period_mm, found = toothed_mm, toothed
    if period_mm == rows.period_mm:
        return period_mm, found
    own = main_parts(some)
    beside = with_second(some, _whole(some, own), ())  # the printer's own turn, and an idler
    return (rows.period_mm, own) if likelier(beside, found) > PART_NATS else (period_mm, found)


def roughly_turned(rows: Rows, some: Rows) -> tuple[float, Choice]:
    """Return what `turned` does, without the search among whole numbers of teeth."""
    found = main_parts(some)
    if (period_mm := likeliest_period_mm(rows)) == rows.period_mm:
        return period_mm, found
    other = main_parts(replace(some, period_mm=period_mm))
    return (period_mm, other) if _nats(some, found, other) > AS_GOOD_NATS else (rows.period_mm, found)


def _toothed(rows: Rows, period_mm: float, found: Choice) -> float:
    """Return the best turn among ``period_mm``, with which ``found`` was fitted, the whole numbers of teeth near the
    printer's, and lengths near the best of these."""

    def with_turn(length_mm: float) -> Choice:
        return _whole(replace(rows, period_mm=length_mm), found)

    def left_mm(length_mm: float) -> float:
        return with_turn(length_mm).fit.loss_mm

    shortest, longest = (share * rows.period_mm / TOOTH_MM for share in NEAR_TURNS)
    longest = min(longest, float(np.ptp(rows.motor_mm[rows.weight > 0])) / LEAST_TURNS / TOOTH_MM)
    best_mm = min([period_mm, *(TOOTH_MM * np.arange(np.ceil(shortest), longest))], key=left_mm)
    sharper_mm = sharpened(best_mm, CALIBRATED_SHARE / best_mm, left_mm)
    gained = _nats(rows, with_turn(best_mm), with_turn(sharper_mm))
    return float(sharper_mm if gained > AS_GOOD_NATS else best_mm)


def _whole(rows: Rows, found: Choice) -> Choice:
    """Fit all harmonics of the rows' turn in place of what ``found`` has of a pulley and of what repeats nothing."""
    return coarsely_fitted(rows, replace(found.structure, pulley="all", offset=True, warp_mm=0.0), found)


def _nats(rows: Rows, one: Choice, other: Choice) -> float:
    """Return by how much another fit's residuals, of Laplace's distribution, are likelier."""
    return float(np.count_nonzero(rows.weight) * np.log(one.fit.loss_mm / max(other.fit.loss_mm, 1e-12)))


def _share(rows: Rows, choice: Choice) -> float:
    """Return the share of residuals that are independent along the belt, either way by itself: 1 without a pattern."""
    touch = choice.fit.touch
    used = np.flatnonzero((rows.weight > 0) & (touch.at >= 0))
    if not len(used):
        return 1.0
    along = used[np.lexsort((rows.motor_mm[touch.at[used]], touch.side[used]))]
    return independent_share(touch.residual_mm[along], robust_sigma_mm(touch.residual_mm[along]))


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
