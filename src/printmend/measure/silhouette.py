"""Find the outline of a printed part in an image: which pixels are plastic, and where along a ray it ends."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from printmend.errors import ScanError
from printmend.messages import say

COARSE_MM = 0.17  # side of a pixel of the reduced picture
SPECK_MM, GAP_MM = 0.35, 0.5  # plastic thinner than this is dirt; gaps narrower than this close
LEAST_PIECE_MM2 = 20.0  # a piece with a smaller area is dirt …
LEAST_PIECE_SHARE = 0.03  # … and so is one with a smaller share of the area of the largest
LEAST_CONTRAST = 10.0  # grey levels between plastic and plate
MARGIN_MM = 4.0  # margin around the part within which its edges are looked for
REACH_MM = 0.45  # half the window about an edge whose integral places it
INNER_MM, OUTER_MM = (-0.34, -0.12), (0.14, 0.45)  # distances from the edge at which plastic and plate are read
BESIDE_MM = (0.1, 0.22)  # distances from an upper layer's edge at which the deeper layer may show
BETWEEN = 0.25  # an upper layer's edge lies at half its step, plus this share of the signal read beside it
STEEP_SHARE = 0.4  # share of the step, about its middle, that places an upper layer's edge
RAY_STEP_MM = 0.025  # distance between the places of a ray across an edge
ACROSS_MM = (-0.36, -0.24, -0.12, 0.0, 0.12, 0.24, 0.36)  # offsets of the parallel rays that are averaged
CHUNK = 400  # rays followed at once


@dataclass(frozen=True, eq=False)
class Silhouette:
    """The plastic of an image.

    ``image`` [H, W, 3] is cut to the plastic and its margin. ``colour`` [3] is the direction in which plastic differs
    from the plate, ``plate`` [h, w] the plate's own signal along it at ``COARSE_MM`` a pixel, and ``level`` how far
    above it plastic is taken to begin. ``mask`` [h, w] bool is the plastic at ``COARSE_MM`` a pixel, ``pieces`` how
    many large pieces it has, ``px_per_mm`` the image's own resolution.
    """

    image: np.ndarray
    colour: np.ndarray
    plate: np.ndarray
    level: float
    mask: np.ndarray
    pieces: int
    px_per_mm: float
    corner_mm: np.ndarray


def find_silhouette(
    image: np.ndarray, px_per_mm: float, *, subject: str, beside_mm: Sequence[np.ndarray] = ()
) -> Silhouette:
    """Find the plastic in an image [H, W, 3] uint8; pieces that reach into an area with the corners ``beside_mm``
    [4, 2] are rulers.

    Raises `ScanError` if nothing stands out against the background, or if the image's edge cuts off what does.
    """
    factor = min(1.0, 1.0 / (COARSE_MM * px_per_mm))
    size = (max(1, round(image.shape[1] * factor)), max(1, round(image.shape[0] * factor)))
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    plate = _plate(small)
    excess = small - plate
    colour, level = _plastic_colour(excess)
    if level is None:
        raise ScanError(
            subject, wanted=say("plastic-stands-out-against-background"), came=say("page-without-any"),
            todo=say("lay-paper-another-colour-behind-part"),
        )  # fmt: skip
    mask = (excess @ colour > level).astype(np.uint8)
    for way, width in ((cv2.MORPH_OPEN, SPECK_MM), (cv2.MORPH_CLOSE, GAP_MM)):
        mask = cv2.morphologyEx(
            mask, way, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (round(width / COARSE_MM) | 1,) * 2)
        )
    _count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    areas = stats[:, cv2.CC_STAT_AREA] * COARSE_MM**2
    areas[0] = 0.0
    for corners_mm in beside_mm:
        ruler = np.zeros(labels.shape, np.uint8)
        cv2.fillConvexPoly(ruler, np.rint(corners_mm / COARSE_MM).astype(np.int32), 1)
        areas[np.unique(labels[ruler > 0])] = 0.0
    keep = (areas >= LEAST_PIECE_MM2) & (areas >= LEAST_PIECE_SHARE * areas.max())
    if not keep.any():
        raise ScanError(subject, wanted=say("printed-part"), came=say("page-without"), todo=say("scan-printed-side"))
    kept = keep[labels]
    if kept[0].any() or kept[-1].any() or kept[:, 0].any() or kept[:, -1].any():
        raise ScanError(
            subject, wanted=say("whole-part-free-margin-around"),
            came=say("plastic-image-edge-cuts-off"),
            todo=say("move-part-away-edge-glass-scan"),
        )  # fmt: skip
    cells = round(MARGIN_MM / COARSE_MM)
    y, x = (np.flatnonzero(kept.any(axis=axis)) for axis in (1, 0))
    low = np.array([max(x[0] - cells, 0), max(y[0] - cells, 0)])
    high = np.array([min(x[-1] + cells, size[0] - 1), min(y[-1] + cells, size[1] - 1)]) + 1
    scale = np.array([image.shape[1] / size[0], image.shape[0] / size[1]])
    first, last = np.floor(low * scale).astype(int), np.ceil(high * scale).astype(int)
    cut = np.ascontiguousarray(image[first[1] : last[1], first[0] : last[0]])
    # reduce the part's cut-out again, so that its pixels have exactly their nominal size
    shape = (round(cut.shape[1] / px_per_mm / COARSE_MM), round(cut.shape[0] / px_per_mm / COARSE_MM))
    inside = kept[low[1] : high[1], low[0] : high[0]].astype(np.uint8)
    mask = cv2.resize(inside, shape, interpolation=cv2.INTER_NEAREST).astype(bool)
    own = cv2.resize((plate @ colour)[low[1] : high[1], low[0] : high[0]], shape, interpolation=cv2.INTER_LINEAR)
    return Silhouette(cut, colour, own, float(level), mask, int(keep.sum()), px_per_mm, first / px_per_mm)


def _plate(small: np.ndarray) -> np.ndarray:
    """Return the plate's colour at every pixel: a quadratic surface fitted to pixels that look like the rim."""
    height, width = small.shape[:2]
    y, x = np.meshgrid(
        np.linspace(-1, 1, height, dtype=np.float32), np.linspace(-1, 1, width, dtype=np.float32), indexing="ij"
    )
    terms = np.stack([np.ones_like(x), x, y, x * y, x * x, y * y], axis=-1)
    edge = max(2, min(height, width) // 40)
    rim = np.ones((height, width), bool)
    rim[edge:-edge, edge:-edge] = False
    level = np.median(small[rim], axis=0)
    plate = np.broadcast_to(level, small.shape)
    every = np.s_[:: max(1, height // 250), :: max(1, width // 250)]
    columns, values = terms[every].reshape(-1, 6), small[every].reshape(-1, 3)
    for _ in range(5):
        off = np.abs(values - plate[every].reshape(-1, 3)).max(axis=1)
        near = off < max(3 * float(np.median(off[rim[every].ravel()])), LEAST_CONTRAST)
        if near.sum() < 50:
            break
        fit = np.linalg.lstsq(columns[near], values[near], rcond=None)[0]
        plate = terms @ fit.astype(np.float32)
    return plate


def _plastic_colour(excess: np.ndarray) -> tuple[np.ndarray, float | None]:
    """Return the direction [3] along which plastic stands out best against the plate's grain (Fisher), and half its
    signal; None if nothing stands out."""
    pixels = excess[::2, ::2].reshape(-1, 3)
    strength = np.abs(pixels).max(axis=1)
    out = strength > max(0.5 * float(np.quantile(strength, 0.995)), LEAST_CONTRAST)
    if out.sum() < 20 or out.all():
        return np.full(3, 1 / np.sqrt(3), np.float32), None
    plastic, plate = pixels[out], pixels[~out]
    mean = np.median(plastic, axis=0)
    grain = plate.T @ plate / len(plate) + np.cov(plastic.T) + 4.0 * np.eye(3)
    direction = np.linalg.solve(grain, mean)
    direction /= np.linalg.norm(direction)
    return direction.astype(np.float32), float(np.median(plastic @ direction)) / 2


def find_edges(
    silhouette: Silhouette, at_px: np.ndarray, out_px: np.ndarray, capture_mm: float, *, foot: bool = False
) -> np.ndarray:
    """Return how far [S] mm from ``at_px`` [S, 2] the plastic ends along ``out_px`` [S, 2] (unit vectors, out of the
    plastic), NaN if it does not within ``capture_mm``.

    The edge is where plastic with a sharp end would end: at the integral of its share, which blur does not change.
    With ``foot``, a deeper layer may show beside the edge, dark and out of focus, and spoil the integral. The middle
    of the steep part then places the edge. Its level is half the step above the plate if the edge hides the deeper
    layer, and half the step above that layer if both show; a level between the two has the least error.
    """
    found = np.full(len(at_px), np.nan)
    for first in range(0, len(at_px), CHUNK):
        part = slice(first, first + CHUNK)
        found[part] = _edges_at_once(silhouette, at_px[part], out_px[part], capture_mm, foot)
    return found


def _edges_at_once(
    silhouette: Silhouette, at_px: np.ndarray, out_px: np.ndarray, capture_mm: float, foot: bool
) -> np.ndarray:
    """Do the work of `find_edges` for few enough rays that their pixels fit in memory."""
    scale = silhouette.px_per_mm
    reach = capture_mm + REACH_MM
    along = np.arange(-reach, reach + RAY_STEP_MM / 2, RAY_STEP_MM)
    side = np.stack([-out_px[:, 1], out_px[:, 0]], axis=1)
    places = (
        at_px[:, None, None, :]
        + (along * scale)[None, None, :, None] * out_px[:, None, None, :]
        + (np.array(ACROSS_MM) * scale)[None, :, None, None] * side[:, None, None, :]
    ).astype(np.float32)
    shape = places.shape[:3]
    flat = places.reshape(shape[0] * shape[1], shape[2], 2)
    pixels = cv2.remap(
        silhouette.image, np.ascontiguousarray(flat[..., 0]), np.ascontiguousarray(flat[..., 1]), cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )  # fmt: skip
    signal = (pixels.astype(np.float32) @ silhouette.colour).reshape(shape).mean(axis=1)
    coarse = ((at_px + 0.5) / (scale * COARSE_MM) - 0.5).astype(np.float32)
    plate = cv2.remap(
        silhouette.plate, coarse[:, [0]], coarse[:, [1]], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    signal -= plate
    smooth = cv2.blur(signal, (5, 1), borderType=cv2.BORDER_REPLICATE)
    inside = smooth > silhouette.level
    margin = round(REACH_MM / RAY_STEP_MM)
    ends = inside[:, :-1] & ~inside[:, 1:]
    ends[:, :margin] = ends[:, -margin:] = False
    distance = np.where(ends, np.abs(along[:-1])[None, :], np.inf)
    nearest = np.argmin(distance, axis=1)
    known = np.isfinite(distance[np.arange(len(nearest)), nearest])
    window = np.clip(nearest[:, None] + np.arange(-margin, margin + 1)[None, :], 0, signal.shape[1] - 1)
    values, offset = np.take_along_axis(signal, window, axis=1), np.arange(-margin, margin + 1) * RAY_STEP_MM
    high = np.median(values[:, (offset > INNER_MM[0]) & (offset < INNER_MM[1])], axis=1)
    low = np.median(values[:, (offset > OUTER_MM[0]) & (offset < OUTER_MM[1])], axis=1)
    step = high - low
    if foot:
        beside = np.median(values[:, (offset > BESIDE_MM[0]) & (offset < BESIDE_MM[1])], axis=1)
        level = high / 2 + BETWEEN * beside
        share = np.clip((values - level[:, None]) / (STEEP_SHARE * np.maximum(high, 1e-6))[:, None] + 0.5, 0.0, 1.0)
    else:
        share = np.clip((values - low[:, None]) / np.maximum(step, 1e-6)[:, None], 0.0, 1.0)
    share[:, offset < INNER_MM[0]] = 1.0
    share[:, offset > OUTER_MM[1] - 0.05] = 0.0
    edge = along[nearest] + (share.sum(axis=1) - margin - 0.5) * RAY_STEP_MM
    known &= step > silhouette.level
    return np.where(known, edge, np.nan)
