"""Scans laid onto each other: of one print turned on the glass, of its parts, or of sheets that show the same marks."""

from collections.abc import Sequence

import numpy as np

from printmend.errors import ScanError
from printmend.measure.plan import LEAST_SHARED, ProbePlan
from printmend.measure.register import find_pose, turn_onto
from printmend.measure.scan import Reading
from printmend.messages import say

LEAST_TURN_SINE = 0.35  # |sin| of the turn between two scans below which they do not tell the scanner's axes apart
LEAST_SPREAD_SHARE = 0.25  # share of the pattern over which the marks that join two scans must spread
TURN_ROUNDS = 12  # how often every scan is turned onto the mean of all


def shared_number(plan: ProbePlan) -> np.ndarray:
    """Return a number [M] for each mark that those of other sheets at the same place share."""
    if len(plan.sheets) == 1:
        return np.arange(len(plan))
    return np.unique(plan.site, axis=0, return_inverse=True)[1].ravel()


def check_sheets(readings: Sequence[Reading], plan: ProbePlan) -> None:
    """Raise `ScanError` where a sheet is missing."""
    shown = {reading.sheet + 1 for reading in readings}
    missing = sorted(set(range(1, len(plan.sheets) + 1)) - shown)
    if missing:
        raise ScanError(
            readings[0].path, wanted=say("scans-all-sheets-print", len(plan.sheets)),
            came=say("none-sheet", " and ".join(map(str, missing))), todo=say("name-scans-all-them"),
        )  # fmt: skip


def scanner_axes(places_mm: Sequence[np.ndarray]) -> tuple[np.ndarray, str, bool]:
    """Return the scanner's own linear map [2, 2] relative to a scanner with equal, square axes, a note, and whether the
    scans could tell.

    Two scans of one plate are linked by A = S·R·S⁻¹ with a rotation R. For S = 1 + E, E symmetric and without
    trace, A·Rᵀ − 1 ≈ E − R·E·Rᵀ, which gives E unless R is a half turn.
    """
    rows, wanted, sines = [], [], []
    for other in places_mm[1:]:
        both = _shared(places_mm[0], other)
        if both.sum() < LEAST_SHARED:
            continue
        first, second = places_mm[0][both], other[both]
        link, *_ = np.linalg.lstsq(first - first.mean(axis=0), second - second.mean(axis=0), rcond=None)
        link = link.T
        angle = np.arctan2(link[1, 0] - link[0, 1], link[0, 0] + link[1, 1])
        c, s = np.cos(angle), np.sin(angle)
        rest = link @ np.array([[c, s], [-s, c]])
        wanted += [(rest[0, 0] - rest[1, 1]) / 2, (rest[0, 1] + rest[1, 0]) / 2]
        double = np.array([[np.cos(2 * angle), -np.sin(2 * angle)], [np.sin(2 * angle), np.cos(2 * angle)]])
        rows.append(np.eye(2) - double)
        sines.append(abs(s))
    if max(sines, default=0.0) < LEAST_TURN_SINE:
        return np.eye(2), say("scans-not-turned-quarter-scanner-s"), False
    (even, skew), *_ = np.linalg.lstsq(np.vstack(rows), np.array(wanted), rcond=None)
    stretch = np.eye(2) + np.array([[even, skew], [skew, -even]])
    return (
        stretch,
        say("scanner-s-axes-differ-lean-removed", f"{200 * even:+.2f}", f"{np.degrees(2 * skew):+.3f}"),
        True,
    )


def aligned(place: np.ndarray, first: np.ndarray, reading: Reading) -> np.ndarray:
    """Turn and shift the marks of a further scan [M, 2] onto those of the first: their common marks fix that best."""
    upright = place * np.array([-1.0 if reading.marks.match.mirrored else 1.0, -1.0])
    both = np.isfinite(upright).all(axis=1) & np.isfinite(first).all(axis=1)
    turned = upright @ turn_onto(upright[both], first[both])
    return turned + np.median((first - turned)[both], axis=0)


def joined(places: Sequence[np.ndarray], readings: Sequence[Reading], plan: ProbePlan) -> tuple[list[np.ndarray], str]:
    """Return scans that show parts of one print, [K × [S, 2]] on the bed, and how well what they share agrees.

    Every scan is turned and shifted onto the mean of all, again and again: least squares over all of them at once.
    Raises `ScanError` for one that shares too few marks with the others.
    """
    upright = [
        place * np.array([-1.0 if reading.marks.match.mirrored else 1.0, -1.0])
        for place, reading in zip(places, readings, strict=True)
    ]
    order = [int(np.argmax([np.isfinite(one[:, 0]).sum() for one in upright]))]
    laid: dict[int, np.ndarray] = {order[0]: upright[order[0]]}
    while len(laid) < len(upright):
        mean = mean_of(np.stack(list(laid.values())))
        left = [k for k in range(len(upright)) if k not in laid]
        best = max(left, key=lambda k: _shared(upright[k], mean).sum())
        _check_shared(_shared(upright[best], mean), readings[best], plan)
        laid[best] = _onto(upright[best], mean)
    for _ in range(TURN_ROUNDS):
        mean = mean_of(np.stack(list(laid.values())))
        laid = {k: _onto(one, mean) for k, one in laid.items()}
    stack = np.stack([laid[k] for k in range(len(upright))])
    mean = mean_of(stack)
    pose = find_pose(mean[shared_number(plan)] * np.array([1.0, -1.0]), plan, mirrored=False)
    both = np.isfinite(stack[..., 0]).sum(axis=0) > 1
    off = (stack - mean)[:, both]
    apart = float(np.sqrt(np.nanmean(np.sum(off**2, axis=2))))
    counts = (len(stack), len(plan.sheets)) if len(plan.sheets) > 1 else (len(stack),)
    message = "scans-sheets-joined-marks-they-share" if len(plan.sheets) > 1 else "scans-joined-marks-they-share-these"
    note = say(message, *counts, int(both.sum()), f"{apart:.3f}")
    return [pose.apply(one * np.array([1.0, -1.0])) for one in stack], note


def mean_of(stack: np.ndarray) -> np.ndarray:
    """Return the mean over the first axis of what is there, NaN where nothing is."""
    known = np.isfinite(stack)
    count = known.sum(axis=0)
    return np.where(count > 0, np.where(known, stack, 0.0).sum(axis=0) / np.maximum(count, 1), np.nan)


def _shared(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    return np.asarray(np.isfinite(one).all(axis=1) & np.isfinite(other).all(axis=1))


def _onto(one: np.ndarray, mean: np.ndarray) -> np.ndarray:
    """Turn and shift places [M, 2] onto others, robustly."""
    both = _shared(one, mean)
    turned = one @ turn_onto(one[both], mean[both])
    return turned + np.median((mean - turned)[both], axis=0)


def _check_shared(both: np.ndarray, reading: Reading, plan: ProbePlan) -> None:
    marks = plan.marks_mm[both[shared_number(plan)]]
    spread = np.ptp(marks, axis=0).max() if len(marks) else 0.0
    if both.sum() < LEAST_SHARED or spread < LEAST_SPREAD_SHARE * np.ptp(plan.marks_mm, axis=0).max():
        raise ScanError(
            reading.path, wanted=say("least-marks-another-scan-shows-too", LEAST_SHARED),
            came=f"{int(both.sum())}", todo=say("let-neighbouring-scans-overlap-third"),
        )  # fmt: skip
