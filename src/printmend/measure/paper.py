"""A sheet of paper as the frame of a photo: its four edges give perspective and lens, its size the scale.

Paper is cut to a few tenths of a millimetre, so that its scale is known to one or two parts in a thousand, as that of a
flatbed; `ruler` or callipers settle it. On a flatbed the edges tell nothing that its resolution does not.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.optimize import least_squares

from printmend.measure.fiducials import Lens, PictureFrame
from printmend.path import Instrument
from printmend.units import A4_MM, LETTER_MM

SHEETS_MM = {"A4": A4_MM, "letter": LETTER_MM}
PAPER = Instrument(scale_sd=0.0015, axes_sd=0.0012, lean_sd=0.0008, wave_mm=0.008)
SEARCH_PX = 1000  # longer side of the picture in which the sheet is looked for
LEAST_SHEET_SHARE = 0.15  # share of the picture that a sheet fills; a smaller one is not what was photographed
FULL_SHARE = 0.93  # share of its four-cornered outline that is bright; with less it is no sheet
PLACES = 80  # on each edge
REACH_SHARE = 0.012  # how far about an edge is looked, as a share of the picture
MOST_OFF_MM = 0.4  # RMS distance of the edges from straight lines; no sheet has more
KEPT_MM, LEAST_KEPT_SHARE = 0.1, 0.7  # places nearer to an edge always count; the share of all that must count
MOST_UNEVEN_SHARE = 0.035  # by which the sides may differ from those of a sheet
FILM_DIAGONAL_MM = 43.27  # of a film of 36 × 24 mm, for which focal lengths are stated
USUAL_FOCAL_MM = 27.0  # of a telephone's lens, on such a film


@dataclass(frozen=True, eq=False)
class Sheet:
    """A sheet in a photo: the ``lens`` that maps the picture to it, ``size_mm`` [2] as it lies, its name, and the RMS
    error of its edges [mm]."""

    lens: Lens
    size_mm: np.ndarray
    name: str
    error_mm: float


def find_sheet(image: np.ndarray) -> Sheet | None:
    """Find a bright sheet of A4 or letter paper on a darker ground in an image [H, W, 3]; None without one."""
    corners = _corners(image)
    if corners is None:
        return None
    edges = _edges(image, corners)
    if edges is None:
        return None
    found = []
    for name, size in SHEETS_MM.items():
        for lies in (size, size[::-1]):
            sheet = _fitted(edges, corners, np.array(lies), name, image.shape)
            uneven = _uneven(sheet.lens)
            if sheet.error_mm < MOST_OFF_MM and uneven < MOST_UNEVEN_SHARE:
                found.append((uneven, sheet))
    return min(found, key=lambda one: one[0])[1] if found else None


def _corners(image: np.ndarray) -> np.ndarray | None:
    """Return the corners [4, 2] px of the largest bright four-cornered area, clockwise from the upper left."""
    factor = min(1.0, SEARCH_PX / max(image.shape[:2]))
    size = (round(image.shape[1] * factor), round(image.shape[0] * factor))
    small = cv2.GaussianBlur(cv2.resize(image, size, interpolation=cv2.INTER_AREA), (0, 0), 1.5)
    darkest = small.min(axis=2)  # white is bright in all colours
    level, _ = cv2.threshold(darkest, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    bright = cv2.morphologyEx((darkest > level).astype(np.uint8), cv2.MORPH_CLOSE, np.ones((9, 9), np.uint8))
    outlines, _ = cv2.findContours(bright, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    if not outlines:
        return None
    outline = max(outlines, key=cv2.contourArea)
    hull = cv2.convexHull(outline)
    square = cv2.approxPolyDP(hull, 0.03 * cv2.arcLength(hull, True), True)[:, 0].astype(float)
    if len(square) != 4 or cv2.contourArea(outline) < LEAST_SHEET_SHARE * bright.size:
        return None
    low, high = square.min(axis=0), square.max(axis=0)
    if cv2.contourArea(outline) < FULL_SHARE * cv2.contourArea(square.astype(np.float32)):
        return None
    if low.min() < 2 or (high > np.array(size) - 3).any():  # cut off by the picture
        return None
    around = square - square.mean(axis=0)
    square = square[np.argsort(np.arctan2(around[:, 1], around[:, 0]))]  # y points down: clockwise
    first = int(np.argmin(square.sum(axis=1)))
    return (np.roll(square, -first, axis=0) + 0.5) / factor - 0.5


def _edges(image: np.ndarray, corners: np.ndarray) -> list[np.ndarray] | None:
    """Return places [N, 2] px on each of the four edges, where the picture's brightness is half way."""
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    reach = max(8, round(REACH_SHARE * max(grey.shape)))
    along = np.linspace(0.04, 0.96, PLACES)[:, None]
    across = np.arange(-reach, reach + 1)
    middle, edges = corners.mean(axis=0), []
    for begin, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        places = begin + along * (end - begin)
        unit = (end - begin) / np.hypot(*(end - begin))
        out = np.array([unit[1], -unit[0]])
        out *= np.sign(out @ ((begin + end) / 2 - middle))
        at = (places[:, None] + across[None, :, None] * out).astype(np.float32)
        seen = cv2.remap(grey, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(float)
        paper, ground = np.median(seen[:, : reach // 2], axis=1), np.median(seen[:, -(reach // 2) :], axis=1)
        share = np.clip((seen - ground[:, None]) / np.maximum(paper - ground, 1.0)[:, None], 0.0, 1.0)
        edge = share.sum(axis=1) - 0.5 + across[0]
        kept = paper - ground > 25
        if kept.sum() < PLACES // 2:
            return None
        edges.append(places[kept] + edge[kept, None] * out)
    return edges


def _fitted(
    edges: list[np.ndarray], corners: np.ndarray, size_mm: np.ndarray, name: str, shape: tuple[int, ...]
) -> Sheet:
    """Fit perspective and one coefficient of distortion so that the edges come to lie on those of a sheet."""
    frame = PictureFrame.of(shape)
    wanted = np.array([(0, 0), (size_mm[0], 0), size_mm, (0, size_mm[1])], float)
    start = frame.first_homography(corners, wanted)

    def lens(values: np.ndarray) -> Lens:
        return frame.lens(values[:8], float(values[8]), 0.0)

    def errors(values: np.ndarray) -> np.ndarray:
        upper, right, lower, left = (lens(values).to_mm(edge) for edge in edges)
        off = (upper[:, 1], right[:, 0] - size_mm[0], lower[:, 1] - size_mm[1], left[:, 0])
        return np.concatenate([*off, [0.5 * values[8]]])

    # Levenberg–Marquardt: the default method stops early in this narrow valley
    rough = least_squares(errors, np.append(start, 0.0), method="lm", x_scale="jac").x
    off = np.abs(errors(rough))
    kept = off < np.maximum(4 * np.median(off[:-1]), KEPT_MM)  # not what lies across an edge
    kept[-1] = True
    fit = least_squares(lambda values: errors(values) * kept, rough, method="lm", x_scale="jac").x
    rest = errors(fit)[:-1][kept[:-1]]
    error_mm = float(np.sqrt(np.square(rest).mean())) if kept.mean() > LEAST_KEPT_SHARE else np.inf
    return Sheet(lens(fit), size_mm, name, error_mm)


def _uneven(lens: Lens) -> float:
    """Return by which share a millimetre of the sheet's two sides is unequal, were it what it is taken for."""
    columns = lens.sheet_axes(2 * lens.radius_px * (USUAL_FOCAL_MM / FILM_DIAGONAL_MM))
    return abs(float(np.log(np.linalg.norm(columns[:, 0]) / np.linalg.norm(columns[:, 1]))))
