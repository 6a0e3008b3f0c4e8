"""Read one picture, flat and to scale: a scan as it is, or a photo rectified by the sheet of tags.

A part has a height: the camera is nearer to its upper side than to the paper, and sees it larger. A point at the height
h above the place p of the sheet appears at p + (p − C)·h/(C_z − h), with C the camera's place over the sheet. C follows
from the homography and the focal length, which a photo's file states.
"""

import struct
import warnings
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from PIL import Image

from printmend.errors import ScanError
from printmend.measure.distance import source_of
from printmend.measure.fiducials import (
    BORDER_MM,
    FILM_DIAGONAL_MM,
    LEAST_TAGS,
    PAPER,
    TAG_MM,
    USUAL_FOCAL_MM,
    WINDOW_EDGE_MM,
    Lens,
    Sheet,
    Tags,
    find_sheet,
    find_tags,
    fit_lens,
    is_flat,
    rectify,
    window_mm,
)
from printmend.measure.image import read_image
from printmend.measure.resampled import is_resampled
from printmend.messages import is_one_of, say
from printmend.path import FLATBED, RESIZED, Instrument
from printmend.units import MM_PER_INCH

USUAL_DPI = 600.0  # default resolution, if neither the owner nor the file states one
# The uncertainty of a sheet of tags: its printer may have fitted it to a page; a photo of it shows its own lens.
SHEET = replace(RESIZED, axes_sd=0.0007, lean_sd=0.0003)
PHOTO = replace(RESIZED, wave_mm=0.005, carriage_mm=0.0, lens_mm=0.0)
# Standard deviations (shares) of a focal length: of one that the file states, and of a telephone's usual one.
STATED_FOCAL_SD, USUAL_FOCAL_SD = 0.04, 0.15
PAPER_RIM_MM = 3.0  # width of the paper's rim that is ignored: the shadow of its edge is no plastic
WINDOW_RIM_MM = 1.0  # width of the window's rim that is ignored: the line along which it is cut
MOST_SHEET_SCALE = 0.012  # the sheet was printed to another scale if a print on it is off by more than this share …
AXES_AGREE_SHARE = 0.004  # … and x and y agree to this share
_ASSUMED = "scale-from-assumed-dpi"  # the message of a scale that nobody stated
_EXIF, _EXPOSURE, _FOCAL, _FOCAL_FILM = 0x8769, 0x829A, 0x920A, 0xA405


@dataclass(frozen=True, eq=False)
class Page:
    """A picture to scale: ``image`` [H, W, 3] at ``px_per_mm``, the uncertainty of its scale and axes, and in words
    where the scale came from. ``eye_mm`` [3] is where a photo's camera was, in the picture's own mm, the height above
    the sheet last; None for a flatbed."""

    image: np.ndarray
    px_per_mm: float
    instrument: Instrument
    scale: str
    eye_mm: np.ndarray | None = None

    @property
    def dpi(self) -> float:
        return self.px_per_mm * MM_PER_INCH

    @property
    def tagged(self) -> bool:
        """True if the scale comes from a sheet of tags."""
        return source_of(self.scale) == "sheet"

    @property
    def unsure(self) -> bool:
        """True if neither the owner nor the file stated a resolution."""
        return is_one_of(self.scale, (_ASSUMED,))


def photo_todo() -> str:
    """Return what to do for a photo whose scale is known."""
    return say("print-sheet-tags-printmend-probe-sheet")


def resolution(image: np.ndarray, given: float | None, stated: float | None) -> tuple[float, str, Instrument]:
    """Return the resolution [dpi] of a scan, words for it, and its uncertainty. The resolution is what the owner has
    ``given``, what the picture's file ``stated``, or the usual one. The uncertainty is a `FLATBED`'s if the file stated
    the resolution (a PNG rounds it) and the picture was not resized; otherwise, it is that of a `RESIZED` one."""
    dpi = given or stated or USUAL_DPI
    agree = stated is not None and abs(dpi / stated - 1) < FLATBED.scale_sd
    if agree and is_resampled(image):
        return dpi, say("scale-from-dpi-resized", f"{dpi:g}"), RESIZED
    return dpi, say("scale-from-dpi" if given or stated else _ASSUMED, f"{dpi:g}"), FLATBED if agree else RESIZED


def is_bare_scan(instrument: Instrument) -> bool:
    """Return whether this is a scan without the sheet of tags."""
    return instrument in (FLATBED, RESIZED)


def read_page(path: str | Path, *, dpi: float | None = None, tall_mm: float = 0.0) -> Page:
    """Read an image of something ``tall_mm`` high: a scan, or a photo or scan of it on the sheet of tags.

    A whole sheet of white paper around it on a darker ground serves instead of the tags. ``dpi`` overrides what the
    file says. Raises `ScanError` for a file that is no image, and for a photo without tags or paper.
    """
    image, stated = read_image(path)
    tags = find_tags(image)
    camera, focal_mm = exposure(path)
    if len(tags) < LEAST_TAGS:
        if dpi is None and (camera or stated is None) and (sheet := find_sheet(image)) is not None:
            return _photographed(image, sheet.lens, inside_mm(sheet), PAPER, sheet_said(sheet), focal_mm, tall_mm)
        refuse_bare_photo(path, tags, camera=camera and dpi is None)
        taken, said, instrument = resolution(image, dpi, stated)
        return Page(image, taken / MM_PER_INCH, instrument, said)
    lens, error_mm = fit_lens(tags, image.shape)
    if is_flat(tags, error_mm):
        flat, _, px_per_mm = rectify(image, lens, *_window())
        return Page(flat, px_per_mm, SHEET, say("scale-axes-from-tags", len(tags)))
    return _photographed(image, lens, _window(), PHOTO, tags_said(tags, error_mm), focal_mm, tall_mm)


def _photographed(
    image: np.ndarray, lens: Lens, shown_mm: tuple[np.ndarray, np.ndarray], instrument: Instrument, said: str,
    focal_mm: float | None, tall_mm: float,
) -> Page:  # fmt: skip
    """Return what lies between two corners ``shown_mm`` of a sheet, ``tall_mm`` high, as a scanner would see it."""
    doubt = USUAL_FOCAL_SD if focal_mm is None else STATED_FOCAL_SD
    eye = _eye_mm(lens, 2 * lens.radius_px * (focal_mm or USUAL_FOCAL_MM) / FILM_DIAGONAL_MM)
    nearer = min(tall_mm / eye[2], 0.5)
    lens, low, high = _raised(lens, eye, nearer, shown_mm)
    flat, corner, px_per_mm = rectify(image, lens, low, high)
    instrument = replace(instrument, scale_sd=float(np.hypot(instrument.scale_sd, doubt * nearer)))
    return Page(flat, px_per_mm, instrument, said, eye - np.array([*corner, 0.0]))


def inside_mm(sheet: Sheet) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners [2] of a sheet of paper without its rim."""
    return np.full(2, PAPER_RIM_MM), sheet.size_mm - PAPER_RIM_MM


def sheet_said(sheet: Sheet) -> str:
    """Say what a photo of a sheet of paper says of its scale."""
    return say("perspective-scale-from-edges-paper-straight", sheet.name, f"{sheet.error_mm:.2f}")


def tags_said(tags: Tags, error_mm: float) -> str:
    """Say where a photo's scale came from."""
    return say("perspective-lens-from-tags-fit-mm", len(tags), f"{error_mm:.2f}")


def refuse_bare_photo(path: str | Path, tags: Tags, *, camera: bool) -> None:
    """Raise `ScanError` for a photo, taken by a ``camera``, that shows too few tags."""
    if camera:
        came = say("photo-shows", len(tags)) if len(tags) else say("photo-without-any")
        raise ScanError(
            path,
            wanted=say("least-tags-reference-sheet", LEAST_TAGS),
            came=came,
            todo=photo_todo(),
        )


def check_sheet(path: str | Path, scales: tuple[float, float]) -> None:
    """Raise `ScanError` where tags make a print too large or too small by one share in x and y: their sheet was scaled.

    A printer whose belts are both wrong by the same share is rarer than a sheet printed to fit a page.
    """
    common = sum(scales) / 2
    if abs(common - 1) > MOST_SHEET_SCALE and abs(scales[0] - scales[1]) < AXES_AGREE_SHARE:
        raise ScanError(
            path, wanted=say("sheet-tags-printed-100"), came=say("one-seems-printed", f"{100 / common:.1f}"),
            todo=say("print-again-without-fit-page-until"),
        )  # fmt: skip


def exposure(path: str | Path) -> tuple[bool, float | None]:
    """Return whether a camera took an image, and its focal length [mm] in terms of 36 × 24 mm film, None if unknown."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Image.open(path) as image:
                noted = image.getexif().get_ifd(_EXIF)
    except (SyntaxError, OSError, ValueError, TypeError, KeyError, struct.error):
        return False, None  # damaged metadata; the picture itself has been read
    try:
        focal = float(noted.get(_FOCAL_FILM) or 0.0)
    except (TypeError, ValueError, ZeroDivisionError):
        focal = 0.0
    return _EXPOSURE in noted or _FOCAL in noted, focal if 5.0 < focal < 500.0 else None


def _window() -> tuple[np.ndarray, np.ndarray]:
    """Return the lower and upper corner [2] mm of the sheet's window, without its rim."""
    low = np.full(2, BORDER_MM + TAG_MM / 2 + WINDOW_EDGE_MM)
    return low + WINDOW_RIM_MM, low + window_mm() - WINDOW_RIM_MM


def _eye_mm(lens: Lens, focal_px: float) -> np.ndarray:
    """Return the camera's place [3] mm: x and y on the sheet, and the height z above it."""
    columns = lens.sheet_axes(focal_px)
    columns /= (np.linalg.norm(columns[:, 0]) + np.linalg.norm(columns[:, 1])) / 2
    rotation = np.stack([columns[:, 0], columns[:, 1], np.cross(columns[:, 0], columns[:, 1])], axis=1)
    place = -np.linalg.solve(rotation, columns[:, 2])
    return np.array([place[0], place[1], abs(place[2])])


def _raised(
    lens: Lens, eye_mm: np.ndarray, nearer: float, shown_mm: tuple[np.ndarray, np.ndarray]
) -> tuple[Lens, np.ndarray, np.ndarray]:
    """Return the lens for a plane that is closer to the camera by the share ``nearer``, and the corners shown there."""
    shrunk = np.diag([1 - nearer, 1 - nearer, 1.0])
    shrunk[:2, 2] = nearer * eye_mm[:2]
    low, high = (eye_mm[:2] + (corner - eye_mm[:2]) * (1 - nearer) for corner in shown_mm)
    return replace(lens, homography=shrunk @ lens.homography), low, high
