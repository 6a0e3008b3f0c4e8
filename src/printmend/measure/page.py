"""One picture, flat and to scale: a scan as it is, or what lies on the sheet of tags as a scanner would have seen it.

A part has a height. Of one that lies on the sheet, the camera sees the upper side nearer, and so larger, than the
paper: a point at the height h above the place p of the sheet appears at p + (p − C)·h/(C_z − h), C the camera's place
over the sheet. C follows from the homography once the focal length is known, which a photo's file states.
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
from printmend.messages import say
from printmend.path import FLATBED, RESIZED, Instrument
from printmend.units import MM_PER_INCH

USUAL_DPI = 600.0  # resolution that is taken where neither the owner nor the file states it
# What a sheet of tags leaves open: the printer that made it and may have fitted it to a page, and in a photo the lens.
SHEET = replace(RESIZED, axes_sd=0.0007, lean_sd=0.0003)
PHOTO = replace(RESIZED, wave_mm=0.005, carriage_mm=0.0)
# Standard deviations (shares) of a focal length that the file states, and of the usual one of a telephone.
STATED_FOCAL_SD, USUAL_FOCAL_SD = 0.04, 0.15
PAPER_RIM_MM = 3.0  # rim of a sheet of paper that is left out: its edge's shadow is no plastic
WINDOW_RIM_MM = 1.0  # rim of the window that is left out: the line along which it is cut
MOST_SHEET_SCALE = 0.012  # share by which a print on the sheet may be too large or too small …
AXES_AGREE_SHARE = 0.004  # … where x and y agree to this share: beyond, the sheet was printed to another scale
_EXIF, _EXPOSURE, _FOCAL, _FOCAL_FILM = 0x8769, 0x829A, 0x920A, 0xA405


@dataclass(frozen=True, eq=False)
class Page:
    """A picture to scale: ``image`` [H, W, 3] at ``px_per_mm``, how far its scale and axes are to be trusted, and in
    words where the scale came from. ``eye_mm`` [3] is where a photo's camera was, in the picture's own mm, the height
    above the sheet last; None for a flatbed. ``unsure`` marks a picture of which nobody stated the resolution."""

    image: np.ndarray
    px_per_mm: float
    instrument: Instrument
    scale: str
    eye_mm: np.ndarray | None = None
    unsure: bool = False

    @property
    def dpi(self) -> float:
        return self.px_per_mm * MM_PER_INCH

    @property
    def tagged(self) -> bool:
        """True where the scale is that of a sheet of tags."""
        return source_of(self.scale) == "sheet"


def photo_todo() -> str:
    """Return what to do for a photo whose scale is known."""
    return say("print-sheet-tags-printmend-probe-sheet")


def scanned_at(dpi: float, stated: float | None) -> Instrument:
    """Return a flatbed at a resolution, which the picture's file ``stated``: a PNG in whole pixels a metre."""
    agree = stated is not None and abs(dpi / stated - 1) < FLATBED.scale_sd
    return FLATBED if agree else RESIZED


def is_bare_scan(instrument: Instrument) -> bool:
    """Tell a scan without the sheet of tags."""
    return instrument in (FLATBED, RESIZED)


def read_page(path: str | Path, *, dpi: float | None = None, tall_mm: float = 0.0) -> Page:
    """Read an image of something ``tall_mm`` high: a scan, or a photo or scan of it on the sheet of tags.

    A whole sheet of white paper around it on a darker ground serves instead of the tags. ``dpi`` overrides what the
    file says. Raises `ScanError` for what is no image, and for a photo without tags or paper.
    """
    image, stated = read_image(path)
    tags = find_tags(image)
    camera, focal_mm = exposure(path)
    if len(tags) < LEAST_TAGS:
        if dpi is None and (camera or stated is None) and (sheet := find_sheet(image)) is not None:
            return _photographed(image, sheet.lens, inside_mm(sheet), PAPER, sheet_said(sheet), focal_mm, tall_mm)
        refuse_bare_photo(path, tags, camera=camera and dpi is None)
        scale = dpi or stated or USUAL_DPI
        instrument, unsure = scanned_at(scale, stated), dpi is None and stated is None
        return Page(image, scale / MM_PER_INCH, instrument, f"{scale:g} dpi", unsure=unsure)
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
            path, wanted=say("sheet-tags-printed-100"), came=say("one-seems-printed", f"{100 / common:.0f}"),
            todo=say("print-again-without-fit-page-until"),
        )  # fmt: skip


def exposure(path: str | Path) -> tuple[bool, float | None]:
    """Say whether a camera took an image, and with which focal length [mm of a film of 36 × 24 mm], None if unsaid."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Image.open(path) as image:
                noted = image.getexif().get_ifd(_EXIF)
    except (SyntaxError, OSError, ValueError, TypeError, KeyError, struct.error):
        return False, None  # damaged: the picture itself has been read
    try:
        focal = float(noted.get(_FOCAL_FILM) or 0.0)
    except (TypeError, ValueError, ZeroDivisionError):
        focal = 0.0
    return _EXPOSURE in noted or _FOCAL in noted, focal if 5.0 < focal < 500.0 else None


def _window() -> tuple[np.ndarray, np.ndarray]:
    """Return the corners of what the sheet's window shows."""
    low = np.full(2, BORDER_MM + TAG_MM / 2 + WINDOW_EDGE_MM)
    return low + WINDOW_RIM_MM, low + window_mm() - WINDOW_RIM_MM


def _eye_mm(lens: Lens, focal_px: float) -> np.ndarray:
    """Return where the camera was [3] mm: above the sheet's (x, y), at the height z."""
    columns = lens.sheet_axes(focal_px)
    columns /= (np.linalg.norm(columns[:, 0]) + np.linalg.norm(columns[:, 1])) / 2
    rotation = np.stack([columns[:, 0], columns[:, 1], np.cross(columns[:, 0], columns[:, 1])], axis=1)
    place = -np.linalg.solve(rotation, columns[:, 2])
    return np.array([place[0], place[1], abs(place[2])])


def _raised(
    lens: Lens, eye_mm: np.ndarray, nearer: float, shown_mm: tuple[np.ndarray, np.ndarray]
) -> tuple[Lens, np.ndarray, np.ndarray]:
    """Return the lens for the plane that is ``nearer`` the camera by this share, and the corners shown there."""
    shrunk = np.diag([1 - nearer, 1 - nearer, 1.0])
    shrunk[:2, 2] = nearer * eye_mm[:2]
    low, high = (eye_mm[:2] + (corner - eye_mm[:2]) * (1 - nearer) for corner in shown_mm)
    return replace(lens, homography=shrunk @ lens.homography), low, high
