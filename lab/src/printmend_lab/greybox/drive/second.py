"""A second period beside the motor's turn: an idler off its centre, whose length need not divide the turn.

What a fit leaves, and every length that is tried, are freed of what the fit's own parts can follow; the length that
then explains most is offered (the periodogram of least squares: Lomb 1976, Scargle 1982), made finer, and kept where
its evidence is strong. The part that repeats nothing can imitate an idler where the print went, but not go on beyond:
so an idler is looked for in place of it, too. To first order, an idler that turns nearly as often as the pulley does
what an elastic belt does to an eccentric one: where such a belt was chosen, the best such idler is compared with it.
"""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from printmend.infer.scatter import independent_share
from printmend.units import TURN_RAD
from printmend_lab.greybox.drive.design import Rows, cross_columns
from printmend_lab.greybox.drive.fit import robust_sigma_mm
from printmend_lab.greybox.drive.period import sharpened
from printmend_lab.greybox.drive.select import PART_NATS, Choice, fitted, likelier

PERIODS_MM = np.geomspace(12.0, 150.0, 160)  # lengths that are tried: no idler is smaller, no bed shows larger ones
OWN_PERIOD = 0.02  # a second period is at least so far from the turn's own harmonics, as a share
OWN_TURN = 0.04  # and so far from the turn itself: the steps of a millimetre may have been calibrated
NEAR_TURN = np.linspace(0.01, 0.05, 15)  # shares of a turn by which an idler differs that an elastic belt hides
LEAST_TURNS = 2.5  # of a second period in what was measured: fewer are a bend of the axis
LEAST_ROWS = 120  # measured rows below which none is looked for
MOST_ROWS = 1500  # rows that are looked at: more take time and say the same
SURE_NATS = 20.0  # log likelihood that a second period must gain, beyond the logarithm of how many are tried
LEAST_SIZE_MM = 0.01  # smallest amplitude that is worth a second period
CLIP_SIGMAS = 4.0  # standard deviations beyond which a residual is an outlier
LEAST_OWN_SHARE = 0.3  # share of a wave that the fit's own parts must leave
CONTACT_PASSES = 6  # rounds of contacts and least squares


def with_second(rows: Rows, found: Choice, ripple: tuple[int, ...]) -> Choice:
    """Return the fit with a second period where the evidence switches one on, else the same fit."""
    if int((rows.weight > 0).sum()) < LEAST_ROWS:
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
    used = used[:: max(1, -(-len(used) // MOST_ROWS))]
    residual = touch.residual_mm[used]
    sigma = robust_sigma_mm(residual)
    basis = own_columns(found, rows, used, without)
    left = np.clip(residual, -CLIP_SIGMAS * sigma, CLIP_SIGMAS * sigma)
    left += columns_of(found, rows, used)[:, without] @ found.fit.posterior.values[without]
    return Freed(rows.motor_mm[touch.at[used]], left - basis @ (basis.T @ left), basis, sigma)


def likeliest_second_mm(rows: Rows, found: Choice) -> float | None:
    """Return the length with which the residuals of a fit surely repeat; None for none."""
    if np.count_nonzero((rows.weight > 0) & (found.fit.touch.at >= 0)) < LEAST_ROWS:
        return None
    freed = _freed(rows, found, np.zeros(found.design.size, bool))
    periods = other_periods_mm(rows.period_mm, float(np.ptp(freed.motor_mm)) / LEAST_TURNS)
    periods = periods[np.abs(periods / rows.period_mm - 1) > OWN_TURN]
    before = float(freed.left_mm @ freed.left_mm)
    if not len(periods) or before <= 0:
        return None
    after = partial(freed.left_by, least_share=LEAST_OWN_SHARE)
    best = min(periods, key=after)
    best = float(sharpened(best, (PERIODS_MM[1] / PERIODS_MM[0] - 1) / best, after))
    share = independent_share(freed.left_mm, freed.sigma_mm)
    rest = len(freed.left_mm) - freed.basis.shape[1]
    nats = share * rest / 2 * np.log(before / max(after(best), 1e-18)) - np.log(len(periods))
    return best if nats > SURE_NATS else None


def other_periods_mm(turn_mm: float, longest_mm: float) -> np.ndarray:
    """Return the lengths that are tried beside a turn and its harmonics."""
    turns = turn_mm / PERIODS_MM
    apart = np.abs(turns / np.maximum(np.rint(turns), 1.0) - 1.0) > OWN_PERIOD
    return np.asarray(PERIODS_MM[apart & (longest_mm > PERIODS_MM)])


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
