"""What slicers write of the printer that a file is for: its name and its bed, in comments or settings."""

import re
from dataclasses import dataclass

_NAMED = re.compile(
    rb'^[;\s"]*(?:printer_model|printer_settings_id|TARGET_MACHINE\.NAME)"?\s*[:=]\s*"?([^\r\n"]*)', re.MULTILINE
)
_BED = re.compile(rb'^[;\s"]*(?:bed_shape|printable_area)"?\s*[:=]\s*([^\r\n]*)', re.MULTILINE)
_CORNER = re.compile(rb"(-?\d+(?:\.\d+)?)x(-?\d+(?:\.\d+)?)")


@dataclass(frozen=True)
class Described:
    """The printer that a file is for: its ``names`` as slicers write them, its bed's corners, None where not said."""

    names: tuple[str, ...]
    bed_mm: tuple[tuple[float, float], tuple[float, float]] | None


def described(*texts: bytes) -> Described:
    """Read pieces of a file (`Part.hints`): PrusaSlicer's, Orca's and Bambu's settings, Cura's header."""
    names = [name.strip().decode("utf-8", "replace") for text in texts for name in _NAMED.findall(text)]
    corners: list[tuple[float, float]] = []
    for text in texts:
        if not corners and (found := _BED.search(text)) is not None:
            corners = [(float(x), float(y)) for x, y in _CORNER.findall(found[1])]
    known = tuple(dict.fromkeys(name for name in names if name))
    if len(corners) < 3:
        return Described(known, None)
    xs, ys = zip(*corners, strict=True)
    return Described(known, ((min(xs), min(ys)), (max(xs), max(ys))))
