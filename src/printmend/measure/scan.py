"""One image of a printed probe: dots found, scale known, marks identified, or one line that says why not."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from printmend.errors import ScanError
from printmend.measure.dots import Dots, find_dots
from printmend.measure.fiducials import (
    LEAST_TAGS,
    Lens,
    Tags,
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
from printmend.measure.marks import Marks, read_marks
from printmend.measure.page import (
    PHOTO,
    SHEET,
    USUAL_DPI,
    check_sheet,
    exposure,
    inside_mm,
    is_bare_scan,
    refuse_bare_photo,
    scanned_at,
    sheet_said,
    tags_said,
)
from printmend.measure.paper import PAPER, find_sheet
from printmend.measure.plan import ProbePlan
from printmend.measure.register import narrowing
from printmend.measure.ruler import Ruler, find_rulers
from printmend.messages import say
from printmend.path import Instrument
from printmend.units import MM_PER_INCH

MOST_SCALE_FACTOR = (
    1.22  # where spacing and size of the dots are both off by more, the resolution is wrong, not the printer
)
LEAST_TAG_SPREAD_MM = 60.0  # tags that spread less than this along either axis give a scale, but no axes


@dataclass(frozen=True, eq=False)
class Reading:
    """What one scan says.

    ``image`` [H, W, 3] is the scan, or a photo rectified; ``dots`` are all its dots, ``dots_mm`` [N, 2] their places
    (y down); ``sheet`` is the number of the sheet that it shows, ``plan`` that sheet's own with its M marks; ``marks``
    says which is which; ``sigma_mm`` [M]; ``scale`` says in words where the scale came from, and
    ``instrument`` how far it and the axes of the image are to be trusted; ``mm_per_px`` is the size of a pixel;
    ``rulers`` lay beside the print on a flatbed.
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


def read_scan(path: str | Path, plan: ProbePlan, *, dpi: float | None = None) -> Reading:
    """Read the marks of ``plan``, or of the one of its sheets that is shown, from an image file.

    ``dpi`` overrides what the file says, and that it may be a photo; without either it is 600. Marks that are not
    there are missing; the others count. Raises `ScanError` for an image that is none, a page without dots, another
    plate or one of which too little is left to tell, a wrong resolution (which is named) and a photo without tags.
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
    said_dpi, dpi = dpi, dpi or stated or USUAL_DPI
    dots = find_dots(image, dpi / MM_PER_INCH, plan, subject=str(path))
    dots_mm, scale, instrument = _scaled(dots, tags, dpi, stated)
    sheet, marks = _shown(dots_mm, dots.diameter_px * MM_PER_INCH / dpi, plan)
    if marks is None or _scale_ratio(dots, marks, dpi, plan.sheets[sheet]) is not None:
        raise _resolution_error(path, image, dots, dpi, plan)
    if instrument is SHEET:
        check_sheet(path, _scales(dots_mm, marks, plan.sheets[sheet]))
    elif said_dpi is None and (share := narrowing(marks.measured_mm, plan.sheets[sheet])):
        raise ScanError(
            path, wanted=say("flat-scan"), came=say("picture-narrows-one-side-photo-does", f"{share:.1%}"),
            todo=say("photo-or-say-dpi"),
        )  # fmt: skip
    return _reading(path, image, dots, dots_mm, sheet, plan, marks, MM_PER_INCH / dpi, scale, instrument)


def _shown(dots_mm: np.ndarray, diameters_mm: np.ndarray, plan: ProbePlan) -> tuple[int, Marks | None]:
    """Return the number of the sheet that dots [N, 2] show, and its marks; None where they are no sheet's."""
    read = [read_marks(dots_mm, diameters_mm, sheet) for sheet in plan.sheets]
    best = max(range(len(read)), key=lambda number: -1 if (one := read[number]) is None else int(one.found.sum()))
    return best, read[best]


# Ten, because it makes the value of ten fields.
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
    """Return how much larger than commanded the marks lie, along two axes of the bed."""
    places, wanted = dots_mm[marks.match.dot[marks.found]], plan.marks_mm[marks.found]
    fit, *_ = np.linalg.lstsq(wanted - wanted.mean(axis=0), places - places.mean(axis=0), rcond=None)
    x, y = np.hypot(*fit.T)
    return float(x), float(y)


def _scaled(dots: Dots, tags: Tags, dpi: float, stated: float | None) -> tuple[np.ndarray, str, Instrument]:
    """Return the dots [N, 2] in mm by the reference sheet where it is in the scan, else by the resolution; how far
    that is to be trusted."""
    plain = dots.centre_px * (MM_PER_INCH / dpi)
    if len(tags) < LEAST_TAGS:
        return plain, say("scale-from-dpi", f"{dpi:g}"), scanned_at(dpi, stated)
    fit, _ = fit_affine(tags)
    if np.ptp(tag_corners_mm()[tags.ids].reshape(-1, 2), axis=0).min() >= LEAST_TAG_SPREAD_MM:
        placed = np.hstack([dots.centre_px, np.ones((len(dots), 1))]) @ fit
        return placed, say("scale-axes-from-tags", len(tags)), SHEET
    told = say("scale-from-tags", len(tags))
    return dots.centre_px * np.sqrt(abs(np.linalg.det(fit[:2]))), told, scanned_at(dpi, None)


def _scale_ratio(dots: Dots, marks: Marks, dpi: float, plan: ProbePlan) -> float | None:
    """Return by how much dots and their spacing are too large or too small, where both are, else None.

    A damaged printer stretches the spacing, but not the dots.
    """
    spacing = marks.match.pitch / plan.pitch_mm
    size = float(np.median(dots.diameter_px[marks.match.dot[marks.found]] / plan.diameter_mm[marks.found]))
    size *= MM_PER_INCH / dpi
    if min(spacing, size) > MOST_SCALE_FACTOR or max(spacing, size) < 1 / MOST_SCALE_FACTOR:
        return spacing
    return None


def _resolution_error(path: str | Path, image: np.ndarray, dots: Dots, dpi: float, plan: ProbePlan) -> ScanError:
    """Return the error that names the resolution at which the dots are the plan's marks, if there is one."""
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
    """Return where in its image a reading shows places of the bed [N, 2]: pixels [N, 2], counted from their centres."""
    pose = reading.marks.pose
    image_mm = (bed_mm - pose.shift_mm) @ np.linalg.inv(pose.matrix)
    affine = affine_of(reading.dots_mm, reading.dots.centre_px)
    return np.hstack([image_mm, np.ones((len(image_mm), 1))]) @ affine


def affine_of(source: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Return the affine map [3, 2] from ``source`` [N, 2] to ``target``."""
    fit, *_ = np.linalg.lstsq(np.hstack([source, np.ones((len(source), 1))]), target, rcond=None)
    return fit
