"""Learn how a Z screw lifts from measured heights (physics.md eq. 15).

    z = z0 + (1 + ε) m + Σ_k (a_k sin kθ + b_k cos kθ) ± backlash/2        θ = 2πm/lead

This is linear once it is known which flank of the thread carries the nut, and where it last moved it (physics.md
eq. 17): so the fit follows the play with the current estimate, solves by ridge least squares, and repeats.
"""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from printmend.errors import TraceError
from printmend.machine.kernels import run
from printmend.messages import say
from printmend.model.series import HARMONICS, waves_of
from printmend.printer import Printer

# Prior standard deviations: of the lead's relative error, of a harmonic's amplitude and of the backlash, mm.
_LEAD_SD, _AMPLITUDE_SD_MM, _BACKLASH_SD_MM = 0.1, 0.5, 1.0
_STARTS_BACKLASH_MM = (0.0, 0.1, 0.4)  # first guesses
# Where in its play the nut may rest at row 0: in the middle, unless the heights speak against it, or on a flank.
_REST_SHARES = (0.5, 0.0, 1.0)
_MOST_PASSES = 12  # of contacts and least squares
_LEAST_SIGMA_MM = 1e-4  # smallest noise of a height that is assumed
# A backlash below so many standard deviations of its estimate is none.
_SEEN_SIGMAS = 3.0
# How much the sum of squares [σ²] must fall for a nut that rests elsewhere, or for wider play.
_OTHER_REST_PRICE = 8.0
_MOST_SQUARE = 9.0  # most that one height may cost in it [σ²]: an outlier says nothing
_LEAST_REST_SIGMA_MM = 5e-3  # smallest noise that it assumes
# Widths of the play that are tried, as shares of what was met.
_WIDER_SHARES = np.linspace(1.02, 3.0, 100)


@dataclass(frozen=True, eq=False)
class Height:
    """How the screw lifts the nozzle: ``terms`` are (ε, a_1, b_1, a_2, …), with standard deviations ``sds``.

    ``sigma_mm`` is the noise of the measured heights; ``rest_share`` says where in its play the nut rested at row 0.
    """

    terms: np.ndarray
    backlash_mm: float
    sigma_mm: float
    sds: np.ndarray
    backlash_sd_mm: float
    rest_share: float = 0.5


def fit_height(
    commanded_mm: np.ndarray, measured_mm: np.ndarray, printer: Printer, *, active: np.ndarray | None = None
) -> Height:
    """Learn z from commanded and measured heights [N] mm, NaN where nothing was measured, with the ``active`` terms.

    The nut may rest anywhere in its play at first. A screw that never turns back shows no backlash. Raises `TraceError`
    where fewer than three heights were measured.
    """
    seen = np.isfinite(measured_mm)
    if seen.sum() < 3:
        raise TraceError(
            say("trace"), wanted=say("three-measured-heights"), came=f"{int(seen.sum())}", todo=say("measure-more")
        )
    columns = np.column_stack([commanded_mm, waves_of(commanded_mm, printer.z.mm_per_turn, HARMONICS)])
    if active is not None:
        columns = columns * active
    prior = np.array([_LEAD_SD, *[_AMPLITUDE_SD_MM] * (2 * HARMONICS), _BACKLASH_SD_MM])
    best: tuple[Height, bool] | None = None
    count = columns.shape[1]
    for share, guess_mm in product(_REST_SHARES, _STARTS_BACKLASH_MM):
        terms, backlash_mm, sigma_mm = np.zeros(count), guess_mm, 0.1
        for _ in range(_MOST_PASSES):
            centre = commanded_mm + columns @ terms
            at, side = _touched(centre, backlash_mm, share)
            # Until it first touches a flank the nut is where it was: a place of its own.
            free = side == 0.0
            rest = np.column_stack([~free, free])[seen]
            rest = rest[:, rest.any(axis=0)].astype(float)
            design = np.column_stack([columns[at][seen], side[seen] / 2, rest])
            wanted = (measured_mm - commanded_mm[at])[seen]
            solved, spread = _ridge(design, wanted, prior, sigma_mm)
            terms, found_mm = solved[:count], float(solved[count])
            sigma_mm = max(float(np.std(wanted - design @ solved)), _LEAST_SIGMA_MM)
            moved = abs(max(found_mm, 0.0) - backlash_mm)
            backlash_mm = max(found_mm, 0.0)
            if moved < 1e-6:
                break
        met = bool((side[seen] > 0).any())
        if not met:  # the backlash is at least as wide as Z went back without taking the nut along
            backlash_mm = float((centre[at] - centre)[side < 0].max(initial=0.0))
        elif backlash_mm < _SEEN_SIGMAS * spread[count]:
            backlash_mm = 0.0
        height = Height(terms, backlash_mm, sigma_mm, spread[:count], float(spread[count]), share)
        if best is None or _closer(height, best[0], int(seen.sum())):
            best = height, met
    assert best is not None
    height, met = best
    if height.rest_share != _REST_SHARES[0]:
        return height
    return _rested(height, commanded_mm + columns @ height.terms, measured_mm, met=met)


def _closer(height: Height, than: Height, points: int) -> bool:
    """Tell whether a fit is closer to the heights; one that needs a nut on a flank must be so by a margin."""
    if height.rest_share == than.rest_share:
        return height.sigma_mm < than.sigma_mm * (1 - 1e-6)
    here, there = (max(each.sigma_mm, _LEAST_REST_SIGMA_MM) for each in (height, than))
    return bool(2 * points * np.log(there / here) > _OTHER_REST_PRICE)


def _touched(centre_mm: np.ndarray, backlash_mm: float, share: float) -> tuple[np.ndarray, np.ndarray]:
    """Return for each row [N] the row where the nut last touched a flank and which, −1 pushed up, +1 let down.

    ``centre_mm`` [N] is the height in the middle of the play. Until it first touches one, the nut is where row 0 put
    it, at ``share`` of its play: row 0 and side 0.
    """
    lower_mm, upper_mm = centre_mm - backlash_mm / 2, centre_mm + backlash_mm / 2
    at, side, place_mm = np.empty(len(centre_mm), np.int64), np.empty(len(centre_mm)), np.empty(len(centre_mm))
    start_mm = float(np.clip(centre_mm[0] + (share - 0.5) * backlash_mm, lower_mm[0], upper_mm[0]))
    run.contacts(start_mm, lower_mm, upper_mm, at, side, place_mm)
    return np.maximum(at, 0), side


def _rested(height: Height, centre_mm: np.ndarray, measured_mm: np.ndarray, *, met: bool) -> Height:
    """Say where in its play the nut rested at row 0, where the fit alone does not: in the middle unless the heights
    speak against it.

    ``centre_mm`` [N] is the middle of the play, but for a constant. Where Z never went back far enough to meet the
    other flank (``met`` False), the play is only known to be larger than that; that the nut rested in its middle then
    tells its width.
    """
    here = np.cumsum(np.abs(np.diff(centre_mm, prepend=centre_mm[0]))) == 0.0  # not moved yet
    seen = np.isfinite(measured_mm)
    if height.backlash_mm == 0.0 or not (here & seen).any():
        return height
    start_mm, sigma_mm = float(measured_mm[here & seen].mean()), max(height.sigma_mm, _LEAST_REST_SIGMA_MM)
    place_mm = np.empty(len(centre_mm))

    def squares(share: float, backlash_mm: float) -> float:
        lower_mm = centre_mm - centre_mm[0] + start_mm - share * backlash_mm
        run.follow(start_mm, lower_mm, lower_mm + backlash_mm, place_mm)
        return float(np.minimum(((measured_mm - place_mm)[seen] / sigma_mm) ** 2, _MOST_SQUARE).sum())

    centred, backlash_mm = squares(0.5, height.backlash_mm), height.backlash_mm
    if not met:
        wide, wider_mm = min((squares(0.5, float(width)), float(width)) for width in height.backlash_mm * _WIDER_SHARES)
        if wide + _OTHER_REST_PRICE < centred:
            centred, backlash_mm = wide, wider_mm
    aside, share = min((squares(share, height.backlash_mm), share) for share in (0.0, 1.0))
    if aside + _OTHER_REST_PRICE < centred:
        return replace(height, rest_share=share)
    return replace(height, backlash_mm=backlash_mm)


def _ridge(design: np.ndarray, wanted: np.ndarray, prior: np.ndarray, sigma_mm: float) -> tuple[np.ndarray, np.ndarray]:
    """Solve least squares with normal priors on the first columns; return the solution and its standard deviations.

    Neighbouring ticks of a print share their errors, so the standard deviations are lower bounds.
    """
    weight = np.zeros(design.shape[1])
    weight[: len(prior)] = (sigma_mm / prior) ** 2
    normal = design.T @ design + np.diag(weight + 1e-9)
    return np.linalg.solve(normal, design.T @ wanted), sigma_mm * np.sqrt(np.diag(np.linalg.inv(normal)))
