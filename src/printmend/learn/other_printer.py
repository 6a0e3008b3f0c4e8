"""Whose print is it? A table that a printer of the other kinematics explains far better than the printer it is said
to be of.

Pulleys and play of a printer with a motor for each axis go with x and y, those of a CoreXY with x + y and x − y: each
leaves much of what the other one does. So drives of the other kinematics, roughly learned, are held against the model
with all its effects. A healthy printer's table could be either's, and so could
that of a CoreXY whose guides have play: this lags along x and y, as a belt's does that moves one of them alone.
"""

from dataclasses import replace

import numpy as np

from printmend.infer.scatter import independent_share, robust_sigma_mm
from printmend.learn.order import learned_roughly
from printmend.learn.rows import LEAST_ROWS
from printmend.machine import Transmission, healthy_mechanism, print_path
from printmend.measure.table import AT_HOME_MM
from printmend.messages import say
from printmend.model.notes import NOTE, WARNING, Misfit
from printmend.path import Trace
from printmend.printer import Printer, preset_names, read_printer

CLIP_SIGMAS = 4.0  # standard deviations beyond which a residual is an outlier
ONE_SIGMA_SHARE = 0.6827  # share of Gaussian residuals within one standard deviation
LEAST_SPREAD_MM = 1e-6  # smallest standard deviation of residuals: it is divided by
LEAST_MM2 = 1e-12  # added to mean squares: those of an exact trace are 0
LEAST_NATS = 100.0  # log likelihood that the other kinematics must gain
# They must leave less than this share of what the model leaves: less beside a CoreXY's, whose rails may have play.
BETTER_SHARE = {"cartesian": 0.7, "corexy": 0.5}
MOST_GUIDE_PLAY_MM = 0.6  # guides have no more play: a head that can be shaken farther is not overlooked
GUIDE_ROUNDS = 2  # rounds of learning the drives beside the guides' play, and the play beside the drives
PUSHED_SHARE = 0.98  # share of half its play from which on the head is behind as far as its guide lets it


def another_printers(left_mm: np.ndarray, trace: Trace, printer: Printer) -> tuple[Misfit, ...]:
    """Return a warning where a printer of the other kinematics explains the trace far better than a model that leaves
    ``left_mm`` [N, 2] of it."""
    if trace.wall_rows.any():
        return ()
    is_corexy = printer.kinematics == "corexy"
    other = replace(printer, kinematics="cartesian" if is_corexy else "corexy")
    rough = learned_roughly(trace, other)
    theirs_mm = trace.measured_mm - rough.places_mm
    known = np.isfinite(left_mm).all(axis=1) & np.isfinite(theirs_mm).all(axis=1)
    if known.sum() < LEAST_ROWS:
        return ()
    our, their = _squares(left_mm[known]), _squares(theirs_mm[known])
    share = min(independent_share(each, robust_sigma_mm(each)) for each in theirs_mm[known].T)
    nats = share * float(known.sum()) / 2 * float(np.log(np.linalg.det(our) / np.linalg.det(their)))
    ours_mm, their_mm = (float(np.sqrt(np.trace(each))) for each in (our, their))
    if nats < LEAST_NATS or their_mm > BETTER_SHARE[printer.kinematics] * ours_mm:
        return ()
    if is_corexy and rough.play_mm.max() < MOST_GUIDE_PLAY_MM:
        guided_mm = _left_beside_guides_mm(printer, trace, rough.play_mm)
        ours_mm = min(ours_mm, float(np.sqrt(np.trace(_squares(guided_mm[known])))))
        if their_mm > BETTER_SHARE[printer.kinematics] * ours_mm:
            return ()
    if is_corexy:
        words = say("table-looks-printer-motor-each-axis", f"{their_mm:.2f}", f"{ours_mm:.2f}")
    else:
        words = say("table-looks-corexy-made-printer-motor", f"{their_mm:.2f}", f"{ours_mm:.2f}")
    return (Misfit("printer", WARNING, ours_mm, nats, words),)


def another_home(trace: Trace, printer: Printer) -> tuple[Misfit, ...]:
    """Return a note where a table begins, unmeasured, where other printers that come with the program home."""
    first = trace.commanded_mm[0]
    if trace.measured_rows[0] or _is_at(first, printer):
        return ()
    if not any(_is_at(first, read_printer(name)) for name in preset_names()):
        return ()
    words = say(
        "table-begins-where-other-printers-home",
        f"{first[0]:g}",
        f"{first[1]:g}",
        f"{printer.home_mm[0]:g}",
        f"{printer.home_mm[1]:g}",
    )
    return (Misfit("home", NOTE, 0.0, 0.0, words),)


def _left_beside_guides_mm(printer: Printer, trace: Trace, play_mm: np.ndarray) -> np.ndarray:
    """Return what is left of a trace [N, 2] beside a CoreXY's drives and guides that have about that play [2]."""
    for _ in range(GUIDE_ROUNDS):
        lag_mm = _guides_lag_mm(printer, trace.commanded_mm, play_mm)
        freed = replace(trace, measured_mm=trace.measured_mm - lag_mm)
        left_mm = freed.measured_mm - learned_roughly(freed, printer).places_mm
        pushed = np.abs(lag_mm) > PUSHED_SHARE * play_mm / 2  # the rows in which a guide pushes the head
        further_mm = np.where(pushed, np.sign(lag_mm) * left_mm, np.nan)[trace.measured_rows]
        play_mm = play_mm + [2 * np.nanmedian(each) if np.isfinite(each).any() else 0.0 for each in further_mm.T]
    return left_mm


def _guides_lag_mm(printer: Printer, places_mm: np.ndarray, play_mm: np.ndarray) -> np.ndarray:
    """Return how far [N, 2] play of the guides [2] leaves the head behind places [N, 2] that the belts reach.

    Sound drives of a printer with a motor for each axis do the same with that play.
    """
    sound = healthy_mechanism(replace(printer, kinematics="cartesian"))
    x, y = (
        Transmission(each.first_mm, each.pitch_mm, each.lower_mm - play / 2, each.upper_mm + play / 2)
        for each, play in zip(sound.transmissions, play_mm.clip(min=0.0), strict=True)
    )
    return print_path(replace(sound, transmissions=(x, y)), places_mm, places_mm[0]) - places_mm


def _is_at(place_mm: np.ndarray, printer: Printer) -> bool:
    return bool(np.abs(place_mm - np.array(printer.home_mm)).max() <= AT_HOME_MM)


def _squares(residual_mm: np.ndarray) -> np.ndarray:
    """Return the mean squares and products [2, 2] mm² of residuals [M, 2], outliers counting as less."""
    most_mm = CLIP_SIGMAS * np.array([spread_mm(each) for each in residual_mm.T])
    clipped = np.clip(residual_mm, -most_mm, most_mm)
    return np.asarray(clipped.T @ clipped / len(clipped) + LEAST_MM2 * np.eye(2))


def spread_mm(residual_mm: np.ndarray) -> float:
    """Return a standard deviation by quantile: 68 % of the residuals are not larger."""
    return max(float(np.quantile(np.abs(residual_mm), ONE_SIGMA_SHARE)), LEAST_SPREAD_MM)
