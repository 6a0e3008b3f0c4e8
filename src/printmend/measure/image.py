"""Read images from files; their size is checked before they are decoded."""

import re
import unicodedata
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from printmend.errors import ScanError
from printmend.files import replacing
from printmend.messages import Tell, say

MOST_PIXELS = 150_000_000  # A4 at 1200 dpi has 139 million
LEAST_SIDE_PX = 300  # shorter side of an image; a smaller one shows nothing
_SAVE: dict[str, dict[str, Any]] = {
    "PNG": {"compress_level": 1}, "JPEG": {"quality": 95}, "TIFF": {"compression": "tiff_lzw"},
}  # fmt: skip
# resolutions that scanners offer: a picture at a badly wrong scale was scanned at another of them
COMMON_DPI = (75, 100, 150, 200, 240, 300, 400, 600, 720, 800, 1200, 1600, 2400)
DIAERESIS = "\u0308"  # the dots of an umlaut, as Unicode writes them after the letter
Colour = tuple[int, int, int]  # blue, green, red
TRUSTED_DPI = 140.0  # lower stated resolutions are ignored: editors and phones write 72 or 96 into any file


def read_image(path: str | Path) -> tuple[np.ndarray, float | None]:
    """Return an image as [H, W, 3] uint8, blue first, and the resolution [dpi] that the file states, if it does.

    Raises `ScanError` for a file that is no image, too small, or so large that it would fill the memory.
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
    """Return a picture above a white strip that explains each colour, one line for each item.

    ``tell`` translates the messages. Letters grow with the picture, so that a telephone shows them legibly.
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
