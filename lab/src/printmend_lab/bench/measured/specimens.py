"""Flatbed scans of printed tensile specimens, measured: length, width of the ends, width of the neck.

Baumann, Eichhoff and Roller (University of Stuttgart) scanned dog-bones after EN ISO 527-2 in yellow and purple plastic
on white paper. A folder has the scans and a `nominal.csv` of file,dpi,length_mm,width_mm,neck_mm, one line a scan.
Plastic is what has a colour. A specimen lies in any direction: its own axes are those of its pixels' moments.
"""

from pathlib import Path

import numpy as np

from printmend.errors import TraceError, reason
from printmend.units import MM_PER_INCH

COLUMNS = ("file", "dpi", "length_mm", "width_mm", "neck_mm")
_COLOURED = 0.25  # of a pixel's value, by which its channels differ at least where there is plastic
_END_SHARE, _NECK_SHARE = 0.06, 0.2  # of the length: how much of either end, and of the middle, is looked at
_FEWEST_PIXELS = 2000
_EDGE_SHARE = 0.002  # of the pixels that may stand out at either side: hairs and dust


def measured_specimen(path: Path, dpi: float) -> dict[str, float]:
    """Return length, width of the ends and width of the neck [mm] of the largest piece of plastic in a scan.

    Raises `TraceError` for a file that is no picture, or has no plastic in it.
    """
    from PIL import Image, UnidentifiedImageError
    from scipy.ndimage import label

    try:
        with Image.open(path) as image:
            pixels = np.asarray(image.convert("RGB"), float)
    except (OSError, ValueError, UnidentifiedImageError, Image.DecompressionBombError) as error:
        raise TraceError(path, wanted="a scan as PNG", came=reason(error), todo="fetch it again") from None
    brightest = pixels.max(axis=2)
    pieces, count = label(brightest - pixels.min(axis=2) > _COLOURED * np.maximum(brightest, 1.0))
    sizes = np.bincount(pieces.ravel())[1:]
    if not count or sizes.max() < _FEWEST_PIXELS:
        raise TraceError(path, wanted="a coloured specimen on white paper", came="none", todo="leave this scan out")
    rows, columns = np.nonzero(pieces == 1 + int(np.argmax(sizes)))
    places = np.stack([columns, rows], axis=1) * (MM_PER_INCH / dpi)
    along = _turned(places)
    pixel_mm = MM_PER_INCH / dpi
    length = _extent(along[:, 0], pixel_mm)
    far = np.abs(along[:, 0]) / length  # 0 in the middle, ½ at either end
    ends = [
        along[(along[:, 0] * side > 0) & (far > 0.5 - 2 * _END_SHARE) & (far < 0.5 - _END_SHARE)] for side in (-1, 1)
    ]
    neck = along[far < _NECK_SHARE / 2]
    return {
        "length_mm": length,
        "width_mm": float(np.mean([_extent(end[:, 1], pixel_mm) for end in ends])),
        "neck_mm": _extent(neck[:, 1], pixel_mm),
    }


def _turned(places_mm: np.ndarray) -> np.ndarray:
    """Return places [N, 2] along and across the axis of their largest moment, from the middle of their extent."""
    about = places_mm - places_mm.mean(axis=0)
    _, axes = np.linalg.eigh(about.T @ about)
    turned = about @ axes[:, ::-1]
    return np.asarray(
        turned - (np.quantile(turned, _EDGE_SHARE, axis=0) + np.quantile(turned, 1 - _EDGE_SHARE, axis=0)) / 2
    )


def _extent(values_mm: np.ndarray, pixel_mm: float) -> float:
    """Return how far values [N] reach: rows of pixels that are full enough, so that a hair is none."""
    cells = np.floor((values_mm - values_mm.min()) / pixel_mm).astype(int)
    full = np.flatnonzero(np.bincount(cells) > 0.3 * np.median(np.bincount(cells)))
    return float((full[-1] - full[0] + 1) * pixel_mm)
