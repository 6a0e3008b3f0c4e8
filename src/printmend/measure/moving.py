"""How far a moving head strays across its line, from the lines at speed of a scanned probe.

A line of plastic has two edges. The head moves both alike, their own wobble moves each by itself: half their sum strays
by motion and wobble, half their difference by wobble alone. The difference of the two mean squares is the motion's.
"""

import itertools
from collections.abc import Sequence

import cv2
import numpy as np

from printmend.measure.scan import Reading, image_px
from printmend.path import Motion
from printmend.units import SIGMA_PER_MEDIAN

LEAST_LEG_MM, END_MM = 6.0, 0.8  # legs that are measured; what is left out at either end, where the bead is round
WINDOW_MM, STEP_MM, ALONG_MM = 1.35, 0.03, 0.1  # across a leg, and the places on it
BIN = 3  # places that are averaged: less than a bead's width
WIDTH_MM = (0.25, 1.3)  # of a bead; what is wider or narrower is something else
EDGE_MM = 0.35  # beyond the middle of an edge, where its blur has ended
NEAR_MARKS = 6  # dots beside a leg that say where it may lie
ODD_SIGMAS = 4.0  # beyond which a place shows dust
LEAST_BINS, LEAST_LEGS = 10, 8
ALIKE_SHARE = 0.2  # by which the wobble of half the sum and of half the difference may differ
HIDDEN_SHARE = 0.15  # of the motion's own square: what blur and averaging over a bead's width may hide


def motion_of(reading: Reading) -> Motion | None:
    """Return how far the head strays, None where the plan has no lines at speed or the scan shows too few of them."""
    plan = reading.plan
    if not plan.moving:
        return None
    corners, colour = plan.waypoints_mm[plan.moving :], _colour(reading)
    found = []
    for start, end in itertools.pairwise(corners):
        if np.hypot(*(end - start)) >= LEAST_LEG_MM and (leg := _leg(reading, start, end, colour)) is not None:
            found.append(leg)
    if len(found) < LEAST_LEGS:
        return None
    together, apart = np.array(found).T
    square = together - apart
    mean = float(square.mean())
    doubts = (np.std(square, ddof=1) / np.sqrt(len(square)), ALIKE_SHARE * apart.mean(), HIDDEN_SHARE * mean)
    return Motion(mean, float(np.linalg.norm(doubts)))


def mean_motion(found: Sequence[Motion | None]) -> Motion | None:
    """Return what several scans of one print say together: the print's own wobble is the same in all of them."""
    known = [each for each in found if each is not None]
    if not known:
        return None
    return Motion(float(np.mean([each.square_mm2 for each in known])), float(np.mean([each.sd_mm2 for each in known])))


def _colour(reading: Reading) -> np.ndarray:
    """Return the direction [3] along which plastic differs from the plate, by the dots: 0 on the plate, 1 on them."""
    dots = reading.dots
    angles = np.linspace(0, 2 * np.pi, 8, endpoint=False)
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    around = dots.centre_px[:, None] + dots.diameter_px[:, None, None] * ring
    inside, outside = (np.median(_pixels(reading.image, at).reshape(-1, 3), axis=0) for at in (dots.centre_px, around))
    step = inside - outside
    return np.asarray(step / max(float(step @ step), 1e-6))


def _pixels(image: np.ndarray, at_px: np.ndarray) -> np.ndarray:
    """Return the image's colours [..., 3] at places [..., 2] px."""
    flat = at_px.reshape(-1, at_px.shape[-2] if at_px.ndim > 2 else 1, 2).astype(np.float32)
    seen = cv2.remap(
        image, np.ascontiguousarray(flat[..., 0]), np.ascontiguousarray(flat[..., 1]), cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )  # fmt: skip
    return seen.reshape(*at_px.shape[:-1], 3).astype(np.float32)


def _leg(reading: Reading, start: np.ndarray, end: np.ndarray, colour: np.ndarray) -> tuple[float, float] | None:
    """Return the mean squares of half the sum and of half the difference of a leg's edges [mm²], None where it does
    not lie clean in the image."""
    length = float(np.hypot(*(end - start)))
    along = (end - start) / length
    across = np.array([-along[1], along[0]])
    place = np.arange(END_MM, length - END_MM, ALONG_MM)
    points = start + place[:, None] * along + _shift(reading, (start + end) / 2)
    offset = np.arange(-WINDOW_MM, WINDOW_MM + STEP_MM / 2, STEP_MM)
    share = _shares(reading, points, across, offset, colour)
    if share is None:
        return None
    inside = share > 0.5
    width = inside.sum(axis=1) * STEP_MM
    clean = (width > WIDTH_MM[0]) & (width < WIDTH_MM[1])
    if clean.sum() < LEAST_BINS * BIN:
        return None
    middle = (inside * offset).sum(axis=1)[clean] / inside.sum(axis=1)[clean]
    slope, shift = np.polyfit(place[clean], middle, 1)
    half = float(np.median(width[clean])) / 2
    near = np.arange(STEP_MM / 2, half + EDGE_MM, STEP_MM)
    straight = points + (shift + slope * place)[:, None] * across
    both = _shares(reading, straight, across, np.concatenate([-near[::-1], near]), colour)
    if both is None:
        return None
    left, right = both[:, : len(near)].sum(axis=1) * STEP_MM, both[:, len(near) :].sum(axis=1) * STEP_MM
    bins = len(place) // BIN
    rows = [each[: bins * BIN].reshape(bins, BIN).mean(axis=1) for each in ((right - left) / 2, (right + left) / 2)]
    at = np.arange(bins) - (bins - 1) / 2
    left_over = np.stack([row - np.polyval(np.polyfit(at, row, 1), at) for row in rows])
    usual = np.maximum(SIGMA_PER_MEDIAN * np.median(np.abs(left_over), axis=1), 1e-4)
    kept = (np.abs(left_over) < ODD_SIGMAS * usual[:, None]).all(axis=0)
    if kept.sum() < LEAST_BINS:
        return None
    together, apart = np.square(left_over[:, kept]).sum(axis=1) / (kept.sum() - 2)
    return float(together), float(apart)


def _shift(reading: Reading, at_mm: np.ndarray) -> np.ndarray:
    """Return by how much the dots nearest to a place lie off [2] mm: a line beside them does as they do."""
    plan, found = reading.plan, np.flatnonzero(reading.marks.found)
    near = found[np.argsort(np.hypot(*(plan.marks_mm[found] - at_mm).T))[:NEAR_MARKS]]
    return np.asarray(np.median(reading.marks.measured_mm[near] - plan.marks_mm[near], axis=0))


def _shares(
    reading: Reading, points_mm: np.ndarray, across: np.ndarray, offset_mm: np.ndarray, colour: np.ndarray
) -> np.ndarray | None:
    """Return the share of plastic [N, K] across a line at points [N, 2], None where the image ends or shows none."""
    at_px = image_px(reading, (points_mm[:, None] + offset_mm[None, :, None] * across).reshape(-1, 2))
    height, width = reading.image.shape[:2]
    if at_px.min() < 0 or at_px[:, 0].max() > width - 1 or at_px[:, 1].max() > height - 1:
        return None
    signal = _pixels(reading.image, at_px.reshape(len(points_mm), len(offset_mm), 2)) @ colour
    edge = max(len(offset_mm) // 8, 1)
    plate = float(np.median(np.hstack([signal[:, :edge], signal[:, -edge:]])))
    plastic = float(np.quantile(signal, 0.95))
    if plastic - plate < 0.5:  # half as much as a dot stands out
        return None
    return np.asarray(np.clip((signal - plate) / (plastic - plate), 0.0, 1.0))
