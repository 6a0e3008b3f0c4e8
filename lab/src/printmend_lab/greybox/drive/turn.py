"""How long a motor's turn is, and the main parts of its drive with it.

What `period` says of it knows no contacts, so that wide play and a pulley with corners may look like another length, or
hide one. Here the main parts are fitted with their contacts: a length that is no better then is not believed, and where
a pattern is left along the belt, every whole number of teeth near the printer's is tried. Last, where the scale is off
its cause may be a pulley of another size, which still turns as the printer says, or wrong steps a millimetre: then a
turn is the printer's over the scale.
"""

from dataclasses import replace

import numpy as np

from printmend.infer.scatter import independent_share
from printmend.model import SCALE_MM
from printmend_lab.greybox.drive.design import Rows
from printmend_lab.greybox.drive.fit import robust_sigma_mm
from printmend_lab.greybox.drive.period import (
    AS_GOOD_NATS,
    LEAST_NATS,
    LEAST_ROWS,
    LEAST_TURNS,
    NEAR_SHARE,
    TOOTH_MM,
    likeliest_period_mm,
    sharpened,
)
from printmend_lab.greybox.drive.second import with_second
from printmend_lab.greybox.drive.select import PART_NATS, Choice, coarsely_fitted, likelier, main_parts

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
