"""Images from files, looked at before they are unpacked."""

import warnings
from pathlib import Path

import numpy as np
from PIL import Image

from printmend.errors import ScanError

MOST_PIXELS = 150_000_000  # A4 at 1200 dpi has 139 million
LEAST_SIDE_PX = 300
TRUSTED_DPI = 140.0  # editors and phones write 72 or 96 into any file


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
    except (Image.DecompressionBombError, MemoryError):
        raise _too_large(path, "an image that would fill the memory") from None
    except FileNotFoundError:
        raise ScanError(path, wanted="a scan", came="no such file", todo="check the path") from None
    except (OSError, SyntaxError, ValueError, EOFError, IndexError, TypeError) as error:
        came = "a damaged image" if "truncated" in str(error).lower() else "no image that can be read"
        raise ScanError(path, wanted="a PNG, TIFF or JPEG scan", came=came, todo="scan it again") from None
    return pixels, _dpi(stated)


def _check_size(path: str | Path, size: tuple[int, int]) -> None:
    if size[0] * size[1] > MOST_PIXELS:
        raise _too_large(path, f"{size[0]} × {size[1]} pixels")
    if min(size) < LEAST_SIDE_PX:
        raise ScanError(
            path,
            wanted=f"a scan of at least {LEAST_SIDE_PX} pixels a side",
            came=f"{size[0]} × {size[1]}",
            todo="scan at 600 dpi",
        )


def _too_large(path: str | Path, came: str) -> ScanError:
    return ScanError(
        path, wanted=f"at most {MOST_PIXELS // 10**6} million pixels", came=came, todo="scan at 600 dpi, cropped"
    )


def _pixels(image: Image.Image) -> np.ndarray:
    if image.mode.startswith("I"):  # 16 bit grey
        deep = np.asarray(image)
        grey = (deep >> 8).astype(np.uint8) if deep.max(initial=0) > 255 else deep.astype(np.uint8)
        return np.repeat(grey[:, :, None], 3, axis=2)
    return np.ascontiguousarray(np.asarray(image.convert("RGB"))[:, :, ::-1])


def _dpi(stated: object) -> float | None:
    try:
        x, y = (float(value) for value in stated)  # type: ignore[attr-defined]
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    return x if x >= TRUSTED_DPI and abs(x - y) < 0.01 * x else None
