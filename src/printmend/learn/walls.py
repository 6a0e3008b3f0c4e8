"""Walls show one direction only: turn them into rows for learners that need both coordinates.

A wall is a row along its normal, and the bead width is an effect like any other, so the usual search reads walls. Here
it is limited to effects without a position or a length of their own: fast, and accurate enough for the next look at the
image.
"""

from dataclasses import dataclass, replace

import numpy as np

from printmend.effects import scene_of
from printmend.effects.effect import SCALE_MM
from printmend.errors import TraceError
from printmend.infer.fit import fitted
from printmend.machine import contacts_of
from printmend.messages import say
from printmend.path import Instrument, Trace
from printmend.printer import Printer
from printmend.units import SIGMA_PER_MEDIAN

LOST_SIGMAS = 5.0  # standard deviations, beyond which a place does not count
LEAST_SIGMA_MM = 0.004  # smallest standard deviation of a wall's place: no scan is read better
LEAST_ALONG_SHARE = 0.25  # of a wall's normal along a motor, below which the wall says nothing about that motor
LEAST_WALLS = 40  # measured places of walls; from fewer nothing is learned


@dataclass(frozen=True, eq=False)
class WallFit:
    """The result of the walls.

    ``printed_mm`` [N, 2] is where every way-point was printed on the bed, with the part's turn subtracted; ``swell_mm``
    is how far all walls are too far out, ``turn`` [rad] the part's remaining turn, counter-clockwise, and
    ``residual_mm`` [W] the remaining error of each wall, NaN where one was left out; ``sigma_mm`` their standard
    deviation.
    """

    printed_mm: np.ndarray
    swell_mm: float
    turn: float
    residual_mm: np.ndarray
    sigma_mm: float


def fit_walls(trace: Trace, printer: Printer) -> WallFit:
    """Fit the walls of a trace. Raises `TraceError` for fewer than forty."""
    walls = np.flatnonzero(trace.wall_rows)
    if len(walls) < LEAST_WALLS or trace.normal is None or trace.offset_mm is None:
        raise TraceError(
            say("trace"), wanted=say("least-places-of-walls", LEAST_WALLS), came=f"{len(walls)}",
            todo=say("measure-more-of-part"),
        )  # fmt: skip
    whole = replace(trace, instrument=Instrument())  # where walls lie in the picture, its own stretch included
    scene = scene_of(whole, printer)
    fit = fitted(trace, scene, kept=lambda term: not term.shape)
    belt_mm = contacts_of(fit.mechanism, printer.to_motor(trace.commanded_mm)).belt_mm
    sizes = {part.effect: part.sizes_mm for part in fit.parts()}
    left = np.full(len(trace), np.nan)
    left[fit.rows.mark] = fit.left_mm()
    left = left[walls]
    sigma = max(SIGMA_PER_MEDIAN * float(np.nanmedian(np.abs(left))), LEAST_SIGMA_MM)
    printed = np.asarray(fit.mechanism.bed.printed(belt_mm)) + sizes.get("origin", np.zeros(2))
    return WallFit(
        printed, float(sizes.get("bead", np.zeros(1))[0]), float(sizes.get("turn", np.zeros(1))[0] / SCALE_MM),
        np.where(np.abs(left) < LOST_SIGMAS * sigma, left, np.nan), sigma,
    )  # fmt: skip


def wall_shares(trace: Trace, printer: Printer) -> np.ndarray:
    """Return the share [N, 2] of each row's information that goes to either motor: 1, except for walls, which show only
    one direction.

    A wall goes to one motor only; otherwise its noise would be explained twice. Floyd and Steinberg's rule gives it
    more often to the motor along which its normal points. A wall nearly parallel to a motor's direction tells nothing
    about that motor.
    """
    shares = np.ones((len(trace), 2))
    walls = np.flatnonzero(trace.wall_rows)
    if not len(walls) or trace.normal is None:
        return shares
    square = np.square(printer.to_motor(trace.normal[walls]))
    square /= square.sum(axis=1, keepdims=True)
    carried = 0.0
    first = np.zeros(len(walls), bool)
    for place, share in enumerate(square[:, 0]):
        wanted = carried + share
        first[place] = share > 1 - LEAST_ALONG_SHARE**2 or (share > LEAST_ALONG_SHARE**2 and wanted >= 0.5)
        carried = float(np.clip(wanted - first[place], -1.0, 1.0))
    shares[walls] = np.where(np.stack([first, ~first], axis=1), square, 0.0)
    return shares


def completed(trace: Trace, printer: Printer, printed_mm: np.ndarray, residual_mm: np.ndarray) -> Trace:
    """Return the trace with both coordinates of every wall, for learners that see each motor by itself.

    The wall's residual [W] is added to the position in the fit ``printed_mm`` [N, 2], as if its motor (`wall_shares`)
    had to explain all of it.
    """
    walls = np.flatnonzero(trace.wall_rows)
    assert trace.normal is not None
    share = printer.to_motor(trace.normal[walls]) / (2.0 if printer.kinematics == "corexy" else 1.0)
    belt = np.array(printer.to_motor(printed_mm[walls]), float)
    full = wall_shares(trace, printer)[walls] > 0
    step = np.where(full, residual_mm[:, None] / np.where(full, share, 1.0), 0.0)
    measured = np.array(trace.measured_mm)
    measured[walls] = printer.from_motor(belt + step)
    return replace(trace, measured_mm=measured)


def with_walls(trace: Trace, printer: Printer) -> Trace:
    """Return a trace that every learner can read, its walls completed to places; one without walls as it is."""
    if not trace.wall_rows.any():
        return trace
    fit = fit_walls(trace, printer)
    return completed(trace, printer, fit.printed_mm, fit.residual_mm)
