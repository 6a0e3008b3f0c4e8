"""Dots in an image of a printed plate: found coarsely, then each centred to a hundredth of a pixel.

The coarse search works on a reduced picture along the one colour direction in which plastic and plate differ.
Each dot is then sampled at full resolution along rays from its centre; the radius of its edge along every ray is
fitted with r(θ) = R + a cos θ + b sin θ + second harmonic, by reweighted least squares. (a, b) is the error of the
centre. Strings, tails, dust and highlights spoil some rays only, and these lose their weight.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from printmend.errors import ScanError
from printmend.measure.plan import ProbePlan
from printmend.messages import say
from printmend.path import frozen
from printmend.units import SIGMA_PER_MEDIAN

COARSE_MM = 0.085  # side of a pixel of the reduced picture
STRING_MM = 0.5  # plastic thinner than this is no dot
NET_SHARE = 0.7  # plastic thinner than this share of a small dot is a thread of the net that the dots hang in
BACKGROUND_MM = 5.0  # side of the window whose median is the plate's own colour
RAYS, RADII = 72, 40  # rays from the centre of a dot, and places along each
REACH_RADII = 1.9  # how far a ray goes, in radii of the dot
CUT_RADII = 1.3  # the image's edge may cut a dot whose centre is nearer than this many radii
MOST_DOTS = 6000  # most dots of an image to look at: those nearest to the intended diameter
LEAST_CONTRAST = 6.0  # grey levels between plastic and plate
SIGMA_FLOOR_MM = 0.005  # standard deviation of a dot itself about the nozzle that made it


@dataclass(frozen=True, eq=False)
class Dots:
    """``centre_px`` [N, 2], ``diameter_px`` [N] and ``sigma_px`` [N], the standard deviation of each coordinate."""

    centre_px: np.ndarray
    diameter_px: np.ndarray
    sigma_px: np.ndarray

    def __post_init__(self) -> None:
        for name in ("centre_px", "diameter_px", "sigma_px"):
            object.__setattr__(self, name, frozen(np.asarray(getattr(self, name), float)))

    def __len__(self) -> int:
        return len(self.centre_px)


def find_dots(image: np.ndarray, px_per_mm: float, plan: ProbePlan, *, subject: str) -> Dots:
    """Find dots of about the two sizes of ``plan`` in ``image`` [H, W, 3] uint8.

    Raises `ScanError` for a page without any contrast; a page with few dots returns few.
    """
    colour, seeds, diameters = _coarse(image, px_per_mm, plan, subject)
    if not len(seeds):
        return Dots(np.empty((0, 2)), np.empty(0), np.empty(0))
    return _whole(_centred(image, colour, seeds, diameters, px_per_mm), image)


def _whole(dots: Dots, image: np.ndarray) -> Dots:
    """Leave out dots that the image's edge may have cut: the centre of a cut dot is wrong."""
    room_px = np.minimum(dots.centre_px, np.array(image.shape[1::-1]) - 1 - dots.centre_px).min(axis=1)
    kept = room_px > CUT_RADII * dots.diameter_px / 2
    return Dots(dots.centre_px[kept], dots.diameter_px[kept], dots.sigma_px[kept])


def _coarse(
    image: np.ndarray, px_per_mm: float, plan: ProbePlan, subject: str
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the colour direction [3], centres [N, 2] px and diameters [N] px of everything that may be a dot."""
    factor = min(1.0, 1.0 / (COARSE_MM * px_per_mm))
    size = (max(1, round(image.shape[1] * factor)), max(1, round(image.shape[0] * factor)))
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    scale = np.array([image.shape[1] / size[0], image.shape[0] / size[1]])
    coarse_mm = float(scale.mean()) / px_per_mm
    excess = small.astype(np.float32) - _background(small, coarse_mm)
    colour = _colour_direction(excess)
    signal = cv2.GaussianBlur(excess @ colour, (0, 0), max(0.6, 0.06 / coarse_mm))
    least, most = 0.45 * plan.dot_mm, 1.7 * plan.big_dot_mm
    opening = max(1, round((NET_SHARE * plan.dot_mm if plan.net else STRING_MM) / coarse_mm))
    noise = SIGMA_PER_MEDIAN * float(np.median(np.abs(signal[::3, ::3])))
    level = max(5.0 * noise, LEAST_CONTRAST / 2)
    labels, _, areas = _components(signal > level, opening if plan.net else 1)
    diameters = np.sqrt(4 * areas / np.pi) * coarse_mm
    fitting = np.flatnonzero((diameters > least) & (diameters < most))
    if not len(fitting):
        raise ScanError(
            subject, wanted=say("dots-plastic"), came=say("page-without-any"), todo=say("scan-printed-side")
        )
    peaks = np.zeros(len(areas) + 1, np.float32)
    np.maximum.at(peaks, labels[labels > 0], signal[labels > 0])
    contrast = float(np.median(peaks[fitting + 1]))
    _, centres, areas = _components(signal > max(0.45 * contrast, level), opening)
    diameters = np.sqrt(4 * areas / np.pi) * coarse_mm
    keep = np.flatnonzero((diameters > least) & (diameters < most))
    # A page of text or noise has far more specks than a probe has dots: the likeliest are enough to see that.
    keep = keep[np.argsort(np.abs(np.log(diameters[keep] / plan.dot_mm)), kind="stable")[:MOST_DOTS]]
    return colour, (centres[keep] + 0.5) * scale - 0.5, diameters[keep] * px_per_mm


def _background(small: np.ndarray, coarse_mm: float) -> np.ndarray:
    """Return the plate's own colour at every pixel: the median over a window much larger than a dot."""
    step = 8
    size = (max(1, small.shape[1] // step), max(1, small.shape[0] // step))
    window = max(3, round(BACKGROUND_MM / (coarse_mm * step)) | 1)
    tiny = cv2.medianBlur(cv2.resize(small, size, interpolation=cv2.INTER_AREA), window)
    return cv2.resize(tiny, (small.shape[1], small.shape[0]), interpolation=cv2.INTER_LINEAR).astype(np.float32)


def _colour_direction(excess: np.ndarray) -> np.ndarray:
    """Return the unit vector [3] along which plastic stands out best against the plate's grain (Fisher).

    Grain, noise and highlights change all channels alike; coloured plastic also changes them unequally.
    """
    pixels = excess[::2, ::2].reshape(-1, 3)
    strength = np.abs(pixels).sum(axis=1)
    outstanding = strength > max(np.quantile(strength, 0.98) * 0.5, 3.0)
    if outstanding.sum() < 10 or outstanding.all():
        return np.full(3, 1 / np.sqrt(3), np.float32)
    plastic, plate = pixels[outstanding], pixels[~outstanding]
    _, vectors = np.linalg.eigh(plastic.T @ plastic)
    towards = vectors[:, -1]
    towards = towards * np.sign(((plastic @ towards) ** 3).sum() or 1.0)
    grain = plate.T @ plate / len(plate) + np.eye(3)  # one grey level of rounding
    direction = np.linalg.solve(grain, towards)
    return (direction / np.linalg.norm(direction)).astype(np.float32)


def _components(mask: np.ndarray, opening: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return labels, centres [N, 2] and areas [N] of the connected parts, after an opening."""
    mask = mask.astype(np.uint8)
    if opening > 1:
        mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (opening, opening)))
    _, labels, stats, centres = cv2.connectedComponentsWithStats(mask, connectivity=8)
    return labels, centres[1:], stats[1:, cv2.CC_STAT_AREA].astype(float)


def _centred(image: np.ndarray, colour: np.ndarray, seeds: np.ndarray, diameters: np.ndarray, px_per_mm: float) -> Dots:
    """Centre every seed [N, 2] px on its dot."""
    centres, radii = seeds.copy(), diameters / 2
    angles = np.arange(RAYS) * (2 * np.pi / RAYS)
    waves = np.stack([np.ones(RAYS), np.cos(angles), np.sin(angles), np.cos(2 * angles), np.sin(2 * angles)], axis=1)
    for _ in range(3):
        edge = _edges(image, colour, centres, radii, angles)
        fit, scale, weight = _robust_harmonics(edge, waves)
        moved = np.clip(fit[:, 1:3], -0.5 * radii[:, None], 0.5 * radii[:, None])
        centres, radii = centres + moved, np.clip(fit[:, 0], 0.6 * radii, 1.5 * radii)
    # Neighbouring rays share the wobble of the outline and the grain: about every twelfth is independent.
    spread = scale * np.sqrt(2 * 12 / np.maximum(weight, 1.0))
    sigma = np.hypot(spread, SIGMA_FLOOR_MM * px_per_mm)
    return Dots(centres, 2 * radii, sigma)


def _edges(
    image: np.ndarray, colour: np.ndarray, centres: np.ndarray, radii: np.ndarray, angles: np.ndarray
) -> np.ndarray:
    """Return the radius of the edge [N, RAYS] px along each ray.

    The edge is where the plastic would end if it ended at once: ∫ share dr, share = 1 on the dot's colour and 0 on
    the plate's around it. Noise and blur leave this integral alone.
    """
    shares = np.linspace(0.0, REACH_RADII, RADII + 1)[1:] - REACH_RADII / 2 / RADII
    reach = shares[None, None, :] * radii[:, None, None]
    x = centres[:, 0, None, None] + reach * np.cos(angles)[None, :, None]
    y = centres[:, 1, None, None] + reach * np.sin(angles)[None, :, None]
    flat = (len(centres), RAYS * RADII)
    values = np.empty((*flat, 3), np.uint8)
    for first in range(0, len(centres), 1024):
        block = slice(first, first + 1024)
        values[block] = cv2.remap(
            image,
            x.reshape(flat)[block].astype(np.float32),
            y.reshape(flat)[block].astype(np.float32),
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        )
    signal = (values.astype(np.float32) @ colour).reshape(len(centres), RAYS, RADII)
    inside = np.median(signal[:, :, shares < 0.5], axis=(1, 2))
    outside = np.median(signal[:, :, shares > 1.5], axis=(1, 2))
    contrast = np.maximum(inside - outside, LEAST_CONTRAST / 2)
    share = np.clip((signal - outside[:, None, None]) / contrast[:, None, None], 0.0, 1.0)
    share[:, :, shares < 0.7] = 1.0
    share[:, :, shares > 1.35] = 0.0
    return share.sum(axis=2) * (REACH_RADII / RADII) * radii[:, None]


def _robust_harmonics(edge: np.ndarray, waves: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Fit ``edge`` [N, RAYS] by ``waves`` [RAYS, 5] with Tukey weights; return fit, residual scale, sum of weights."""
    fit = edge @ (waves / (waves**2).sum(axis=0))
    fit[:, 3:] = 0.0
    fit[:, 0] = np.median(edge, axis=1)
    scale = np.ones(len(edge))
    weight = np.ones(edge.shape)
    for _ in range(6):
        residual = edge - fit @ waves.T
        scale = np.maximum(SIGMA_PER_MEDIAN * np.median(np.abs(residual), axis=1), 0.02)
        weight = np.clip(1 - (residual / (4.0 * scale[:, None])) ** 2, 0.0, None) ** 2
        normal = np.einsum("nr,ri,rj->nij", weight, waves, waves) + 1e-6 * np.eye(waves.shape[1])
        fit = np.linalg.solve(normal, np.einsum("nr,nr,ri->ni", weight, edge, waves)[:, :, None])[:, :, 0]
    return fit, scale, weight.sum(axis=1)
