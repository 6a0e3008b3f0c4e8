"""Read one image of a printed probe: find its dots and scale, identify the marks, and measure the error of the moving
head."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from printmend.errors import ScanError
from printmend.measure.dots import Dots, find_dots
from printmend.measure.fiducials import (
    LEAST_TAGS,
    PAPER,
    Lens,
    Tags,
    find_sheet,
    find_tags,
    fit_affine,
    fit_lens,
    is_flat,
    rectify,
    tag_corners_mm,
    tagged_mm,
)
from printmend.measure.identity import lattice_pitch
from printmend.measure.image import COMMON_DPI, read_image
from printmend.measure.marks import Marks, narrowing, read_marks
from printmend.measure.page import (
    PHOTO,
    SHEET,
    check_sheet,
    exposure,
    inside_mm,
    is_bare_scan,
    refuse_bare_photo,
    resolution,
    sheet_said,
    tags_said,
)
from printmend.measure.plan import ProbePlan
from printmend.measure.ruler import Ruler, find_rulers
from printmend.messages import say
from printmend.path import RESIZED, Instrument, Motion
from printmend.units import MM_PER_INCH, SIGMA_PER_MEDIAN

MOST_SCALE_FACTOR = (
    1.22  # where spacing and size of the dots are both off by more, the resolution is wrong, not the printer
)
LEAST_TAG_SPREAD_MM = 60.0  # tags that span less than this along either axis give a common scale only


@dataclass(frozen=True, eq=False)
class Reading:
    """The result of reading one scan.

    ``image`` [H, W, 3] is the scan, or the rectified photo; ``dots`` are all its dots, ``dots_mm`` [N, 2] their places
    (y down). ``sheet`` is the number of the sheet shown, ``plan`` that sheet's plan with its M marks; ``marks`` matches
    dots to marks; ``sigma_mm`` [M] are their standard deviations. ``scale`` says in words where the scale came from,
    and ``instrument`` how uncertain the scale and the axes are; ``mm_per_px`` is the size of a pixel; ``rulers`` lay
    beside the print on a flatbed.
    """

    path: str
    image: np.ndarray
    dots: Dots
    dots_mm: np.ndarray
    sheet: int
    plan: ProbePlan
    marks: Marks
    sigma_mm: np.ndarray
    scale: str
    instrument: Instrument
    mm_per_px: float
    rulers: tuple[Ruler, ...] = ()

    @property
    def image_mm(self) -> np.ndarray:
        """The marks in the image's frame [M, 2] mm, NaN where missing."""
        places = np.full((len(self.marks.match.dot), 2), np.nan)
        found = self.marks.found
        places[found] = self.dots_mm[self.marks.match.dot[found]]
        return places

    @property
    def middle_mm(self) -> np.ndarray:
        """The middle of the image [2] mm."""
        height, width = self.image.shape[:2]
        return np.array([width / 2, height / 2, 1.0]) @ affine_of(self.dots.centre_px, self.dots_mm)


def read_scan(path: str | Path, plan: ProbePlan, *, dpi: float | None = None) -> Reading:
    """Read the marks of ``plan``, or of the one of its sheets that is shown, from an image file.

    ``dpi`` overrides the file's resolution, and says that it is no photo; without either it is 600. Marks that are not
    found stay missing. Raises `ScanError` for a file that is no image, a page without dots, another plate, a plate with
    too few marks left, a wrong resolution (which the message names) and a photo without tags.
    """
    image, stated = read_image(path)
    tags = find_tags(image)
    if len(tags) >= LEAST_TAGS:
        lens, error_mm = fit_lens(tags, image.shape)
        if not is_flat(tags, error_mm):
            return _read_photo(path, image, lens, tagged_mm(), PHOTO, tags_said(tags, error_mm), plan)
    camera = dpi is None and len(tags) < LEAST_TAGS and exposure(path)[0]
    if dpi is None and (camera or stated is None) and (paper := find_sheet(image)) is not None:
        shown = inside_mm(paper)
        return _read_photo(path, image, paper.lens, shown, PAPER, sheet_said(paper), plan)
    refuse_bare_photo(path, tags, camera=camera)
    given, (dpi, said, scanned) = dpi, resolution(image, dpi, stated)
    dots = find_dots(image, dpi / MM_PER_INCH, plan, subject=str(path))
    dots_mm, scale, instrument = _scaled(dots, tags, dpi, said, scanned)
    sheet, marks = _shown(dots_mm, dots.diameter_px * MM_PER_INCH / dpi, plan)
    if marks is None or _scale_ratio(dots, marks, dpi, plan.sheets[sheet]) is not None:
        raise _resolution_error(path, image, dots, dpi, plan)
    if instrument is SHEET:
        check_sheet(path, _scales(dots_mm, marks, plan.sheets[sheet]))
    elif given is None and (share := narrowing(marks.measured_mm, plan.sheets[sheet])):
        raise ScanError(
            path, wanted=say("flat-scan"), came=say("picture-narrows-one-side-photo-does", f"{share:.1%}"),
            todo=say("photo-or-say-dpi"),
        )  # fmt: skip
    return _reading(path, image, dots, dots_mm, sheet, plan, marks, MM_PER_INCH / dpi, scale, instrument)


def _shown(dots_mm: np.ndarray, diameters_mm: np.ndarray, plan: ProbePlan) -> tuple[int, Marks | None]:
    """Return the number of the sheet that dots [N, 2] show, and its marks, None if they match no sheet."""
    read = [read_marks(dots_mm, diameters_mm, sheet) for sheet in plan.sheets]
    best = max(range(len(read)), key=lambda number: -1 if (one := read[number]) is None else int(one.found.sum()))
    return best, read[best]


# Ten parameters, because it fills the ten fields of a value.
def _reading(
    path: str | Path, image: np.ndarray, dots: Dots, dots_mm: np.ndarray, sheet: int, plan: ProbePlan, marks: Marks,
    mm_per_px: float, scale: str, instrument: Instrument,
) -> Reading:  # fmt: skip
    sigma = np.full(len(marks.found), np.nan)
    sigma[marks.found] = dots.sigma_px[marks.match.dot[marks.found]] * mm_per_px
    shown = plan.sheets[sheet]
    rulers = find_rulers(image, 1 / mm_per_px, subject=str(path)) if is_bare_scan(instrument) else ()
    return Reading(str(path), image, dots, dots_mm, sheet, shown, marks, sigma, scale, instrument, mm_per_px, rulers)


def _read_photo(
    path: str | Path, image: np.ndarray, lens: Lens, shown_mm: tuple[np.ndarray, np.ndarray], instrument: Instrument,
    scale: str, plan: ProbePlan,
) -> Reading:  # fmt: skip
    flat, corner_mm, px_per_mm = rectify(image, lens, *shown_mm)
    dots = find_dots(flat, px_per_mm, plan, subject=str(path))
    dots_mm = corner_mm + (dots.centre_px + 0.5) / px_per_mm
    sheet, marks = _shown(dots_mm, dots.diameter_px / px_per_mm, plan)
    if marks is None:
        raise _unknown_dots(path, dots, plan)
    if instrument is PHOTO:
        check_sheet(path, _scales(dots_mm, marks, plan.sheets[sheet]))
    return _reading(path, flat, dots, dots_mm, sheet, plan, marks, 1 / px_per_mm, scale, instrument)


def _scales(dots_mm: np.ndarray, marks: Marks, plan: ProbePlan) -> tuple[float, float]:
    """Return the ratio of the marks' measured to commanded spacing, along the two axes of the bed."""
    places, wanted = dots_mm[marks.match.dot[marks.found]], plan.marks_mm[marks.found]
    fit, *_ = np.linalg.lstsq(wanted - wanted.mean(axis=0), places - places.mean(axis=0), rcond=None)
    x, y = np.hypot(*fit.T)
    return float(x), float(y)


def _scaled(dots: Dots, tags: Tags, dpi: float, said: str, scanned: Instrument) -> tuple[np.ndarray, str, Instrument]:
    """Return the dots [N, 2] in mm, by the reference sheet if the scan shows it, else by the resolution, with what is
    ``said`` of that and how sure it is; the source of the scale; and its uncertainty."""
    if len(tags) < LEAST_TAGS:
        return dots.centre_px * (MM_PER_INCH / dpi), said, scanned
    fit, _ = fit_affine(tags)
    if np.ptp(tag_corners_mm()[tags.ids].reshape(-1, 2), axis=0).min() >= LEAST_TAG_SPREAD_MM:
        placed = np.hstack([dots.centre_px, np.ones((len(dots), 1))]) @ fit
        return placed, say("scale-axes-from-tags", len(tags)), SHEET
    told = say("scale-from-tags", len(tags))
    return dots.centre_px * np.sqrt(abs(np.linalg.det(fit[:2]))), told, RESIZED


def _scale_ratio(dots: Dots, marks: Marks, dpi: float, plan: ProbePlan) -> float | None:
    """Return the ratio of measured to planned spacing if spacing and dots are both too large, or both too small.

    Otherwise return None: a damaged printer stretches the spacing, but not the dots.
    """
    spacing = marks.match.pitch / plan.pitch_mm
    size = float(np.median(dots.diameter_px[marks.match.dot[marks.found]] / plan.diameter_mm[marks.found]))
    size *= MM_PER_INCH / dpi
    if min(spacing, size) > MOST_SCALE_FACTOR or max(spacing, size) < 1 / MOST_SCALE_FACTOR:
        return spacing
    return None


def _resolution_error(path: str | Path, image: np.ndarray, dots: Dots, dpi: float, plan: ProbePlan) -> ScanError:
    """Return an error that names the resolution at which the dots would match the plan's marks, if there is one."""
    for other in sorted(COMMON_DPI, key=lambda value: abs(np.log(value / dpi))):
        if abs(np.log(other / dpi)) < 0.1:
            continue
        try:
            retry = find_dots(image, other / MM_PER_INCH, plan, subject=str(path))
        except ScanError:
            continue
        retry_mm = retry.centre_px * (MM_PER_INCH / other)
        sheet, found = _shown(retry_mm, retry.diameter_px * (MM_PER_INCH / other), plan)
        if found is not None and _scale_ratio(retry, found, other, plan.sheets[sheet]) is None:
            spacing = found.match.pitch * other / dpi
            return ScanError(
                path,
                wanted=say("marks-mm-apart", f"{plan.pitch_mm:.1f}"),
                came=say("marks-mm-apart-dpi", f"{spacing:.1f}", f"{dpi:g}"),
                todo=say("scan-seems-have-dpi-say-dpi", f"{other:g}", f"{other:g}"),
            )
    return _unknown_dots(path, dots, plan)


def _unknown_dots(path: str | Path, dots: Dots, plan: ProbePlan) -> ScanError:
    came = say("dots-not-they", len(dots))
    if len(dots) > 4:
        came = say("dots-about-px-apart-they", len(dots), f"{lattice_pitch(dots.centre_px):.0f}")
    return ScanError(
        path,
        wanted=say("marks-probe-json", len(plan)),
        came=came,
        todo=say("give-print-s-own-probe-json"),
    )


def image_px(reading: Reading, bed_mm: np.ndarray) -> np.ndarray:
    """Return the pixels [N, 2] of a reading's image that show bed places [N, 2]; whole numbers are pixel centres."""
    pose = reading.marks.pose
    image_mm = (bed_mm - pose.shift_mm) @ np.linalg.inv(pose.matrix)
    affine = affine_of(reading.dots_mm, reading.dots.centre_px)
    return np.hstack([image_mm, np.ones((len(image_mm), 1))]) @ affine


def affine_of(source: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Return the affine map [3, 2] from ``source`` [N, 2] to ``target``."""
    fit, *_ = np.linalg.lstsq(np.hstack([source, np.ones((len(source), 1))]), target, rcond=None)
    return fit


# How far a moving head strays across its line, from the lines at speed of a scanned probe.
#
# A line of plastic has two edges. The head's motion shifts both alike; each edge also wobbles by itself. Half their sum
# contains motion and wobble, half their difference only wobble. The difference of the two mean squares is the mean
# square of the motion.

LEAST_LEG_MM, END_MM = 6.0, 0.8  # shortest leg that is measured; length left out at either end, where the bead is round
WINDOW_MM, STEP_MM, ALONG_MM = 1.35, 0.03, 0.1  # half the window across a leg, its step, and the step along the leg
BIN = 3  # places that are averaged: less than a bead's width
WIDTH_MM = (0.25, 1.3)  # range of a bead's width; anything else is no bead
EDGE_MM = 0.35  # distance from the middle of an edge at which its blur has ended
NEAR_MARKS = 6  # dots beside a leg that say where it may lie
ODD_SIGMAS = 4.0  # a place farther off than this shows dust
LEAST_BINS, LEAST_LEGS = 10, 8
ALIKE_SHARE = 0.2  # share by which the wobble in half the sum may differ from that in half the difference
HIDDEN_SHARE = 0.15  # share of the motion's mean square that blur and averaging over a bead's width may hide


def motion_of(reading: Reading) -> Motion | None:
    """Return the error of the moving head, or None if the plan has no lines at speed or the scan shows too few of
    them."""
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
    """Average the motion in several scans of one print; its sd too, since all scans share the print's own wobble."""
    known = [each for each in found if each is not None]
    if not known:
        return None
    return Motion(float(np.mean([each.square_mm2 for each in known])), float(np.mean([each.sd_mm2 for each in known])))


def _colour(reading: Reading) -> np.ndarray:
    """Return the colour direction [3], estimated at the dots, whose signal is 0 on the plate and 1 on plastic."""
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
    """Return the mean squares of half the sum and of half the difference of a leg's edges [mm²], or None if the image
    shows it unclean."""
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
    """Return the error [2] mm of the dots nearest to a place: a line beside them has the same."""
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
