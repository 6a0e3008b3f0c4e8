"""Images from files, looked at before they are unpacked."""

import re
import struct
import unicodedata
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from printmend.errors import ScanError
from printmend.files import replacing
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
from printmend.messages import Tell, say
from printmend.path import FLATBED, RESIZED, Instrument
from printmend.units import MM_PER_INCH

MOST_PIXELS = 150_000_000  # A4 at 1200 dpi has 139 million
LEAST_SIDE_PX = 300  # shorter side of an image; a smaller one shows nothing
_SAVE: dict[str, dict[str, Any]] = {
    "PNG": {"compress_level": 1}, "JPEG": {"quality": 95}, "TIFF": {"compression": "tiff_lzw"},
}  # fmt: skip
# resolutions that scanners offer: a picture that is off by a whole factor was scanned at another of them
COMMON_DPI = (75, 100, 150, 200, 240, 300, 400, 600, 720, 800, 1200, 1600, 2400)
DIAERESIS = "\u0308"  # the dots of an umlaut, as Unicode writes them after the letter
Colour = tuple[int, int, int]  # blue, green, red
TRUSTED_DPI = 140.0  # least resolution that is believed: editors and phones write 72 or 96 into any file


def read_image(path: str | Path) -> tuple[np.ndarray, float | None]:
    """Return an image as [H, W, 3] uint8, blue first, and the resolution [dpi] that the file states, if it does.

    Raises `ScanError` for anything that is no image, too small, or so large that it would fill the memory.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # our own limit is below the one that Pillow warns of
            with Image.open(path) as image:
                _check_size(path, image.size)
                stated = image.info.get("dpi")
                pixels = _pixels(image)
    except (Image.DecompressionBombError, MemoryError) as error:
        said = re.search(r"\((\d+) pixels\)", str(error))
        came = say("million", int(said[1]) // 10**6) if said else say("image-fills-memory")
        raise _too_large(path, came) from None
    except FileNotFoundError:
        raise ScanError(path, wanted=say("scan"), came=say("no-such-file"), todo=say("check-path")) from None
    except IsADirectoryError:
        raise ScanError(path, wanted=say("scan"), came=say("folder"), todo=say("name-image")) from None
    except (OSError, SyntaxError, ValueError, EOFError, IndexError, TypeError) as error:
        came = say("damaged-image") if "truncated" in str(error).lower() else say("no-image")
        raise ScanError(path, wanted=say("png-tiff-jpeg-scan"), came=came, todo=say("scan-again")) from None
    return pixels, _dpi(stated)


def write_image(path: str | Path, image: np.ndarray, *, dpi: float) -> None:
    """Write an image [H, W, 3] uint8, blue first, in the format of the file's name, with its resolution."""
    picture = Image.fromarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB))
    kind = Image.registered_extensions().get(Path(path).suffix.lower())
    if kind not in _SAVE:
        raise ScanError(path, wanted=say("name-ending-png-jpg-tif"), came=say("another"), todo=say("rename"))
    with replacing(Path(path), "wb") as file:
        picture.save(file, kind, dpi=(dpi, dpi), **_SAVE[kind])


def with_legend(picture: np.ndarray, items: Sequence[tuple[str, Colour]], tell: Tell = str) -> np.ndarray:
    """Return a picture over a white strip that says what each colour means: a line for each item.

    ``tell`` puts the messages into a language. Letters grow with the picture, to be read on a telephone.
    """
    width = picture.shape[1]
    line = round(width / 26)
    strip = np.full((line * len(items) + line // 2, width, 3), 255, np.uint8)
    for number, (words, colour) in enumerate(items):
        middle = round(line * (number + 0.75))
        cv2.circle(strip, (line, middle), round(0.28 * line), colour, -1, cv2.LINE_AA)
        write_words(strip, tell(words), (2 * line, middle + round(0.25 * line)), 0.8 * line, (60, 50, 40))
    return np.vstack([picture, strip])


def write_words(picture: np.ndarray, words: str, at: tuple[int, int], size_px: float, colour: Colour) -> None:
    """Write one line into a picture [H, W, 3], its left end on the base line at a pixel.

    Pillow's own font has no letter beyond ASCII: an umlaut gets its two dots here, and ß is written ss.
    """
    image, font = Image.fromarray(picture), ImageFont.load_default(size_px)
    pen = ImageDraw.Draw(image)
    parts = unicodedata.normalize("NFD", words.replace("ß", "ss")).split(DIAERESIS)
    pen.text(at, "".join(parts), fill=colour, font=font, anchor="ls")
    for number in range(1, len(parts)):
        before = "".join(parts[:number])
        left, right = (at[0] + font.getlength(text) for text in (before[:-1], before))
        top = at[1] + font.getbbox(before[-1], anchor="ls")[1] - 0.13 * size_px
        for share in (0.3, 0.7):
            pen.circle((left + share * (right - left), top), 0.065 * size_px, fill=colour)
    picture[:] = np.asarray(image)


def _check_size(path: str | Path, size: tuple[int, int]) -> None:
    if size[0] * size[1] > MOST_PIXELS:
        raise _too_large(path, say("pixels", size[0], size[1]))
    if min(size) < LEAST_SIDE_PX:
        raise ScanError(
            path,
            wanted=say("scan-least-pixels-side", LEAST_SIDE_PX),
            came=say("two-sizes", size[0], size[1]),
            todo=say("scan-600-dpi"),
        )


def _too_large(path: str | Path, came: str) -> ScanError:
    return ScanError(
        path, wanted=say("most-million-pixels", MOST_PIXELS // 10**6), came=came, todo=say("scan-600-dpi-cropped")
    )


def _pixels(image: Image.Image) -> np.ndarray:
    if image.mode.startswith("I"):  # 16 bit grey
        deep = np.asarray(image)
        grey = (deep >> 8).astype(np.uint8) if deep.max(initial=0) > 255 else deep.astype(np.uint8)
        return np.repeat(grey[:, :, None], 3, axis=2)
    if image.mode == "F":  # from 0 to 1, or as deep as a 16 bit scan
        deep = np.nan_to_num(np.asarray(image))
        grey = np.clip(deep * (255 / max(1.0, float(deep.max(initial=0)))), 0, 255).astype(np.uint8)
        return np.repeat(grey[:, :, None], 3, axis=2)
    return cv2.cvtColor(np.asarray(image if image.mode == "RGB" else image.convert("RGB")), cv2.COLOR_RGB2BGR)


def _dpi(stated: object) -> float | None:
    try:
        x, y = (float(value) for value in stated)  # type: ignore[attr-defined]
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    # PNG stores whole pixels per metre: 600 dpi comes back as 599.999
    return float(round(x)) if x >= TRUSTED_DPI and abs(x - y) < 0.01 * x else None


# One picture, flat and to scale: a scan as it is, or what lies on the sheet of tags as a scanner would have seen it.
#
# A part has a height. Of one that lies on the sheet, the camera sees the upper side nearer, and so larger, than the
# paper: a point at the height h above the place p of the sheet appears at p + (p − C)·h/(C_z − h), C the camera's place
# over the sheet. C follows from the homography once the focal length is known, which a photo's file states.

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
