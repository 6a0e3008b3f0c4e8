"""The slicer's comments and settings about the printer that a file is for: its name and its bed."""

import re
from dataclasses import dataclass

# Each expression is asked only where one of its words stands: a MiB that names no printer is passed over quickly.
_NAMES, _BEDS = (b"printer_model", b"printer_settings_id", b"TARGET_MACHINE.NAME"), (b"bed_shape", b"printable_area")
_ENDS = (b"MINX:", b"MINY:", b"MAXX:", b"MAXY:")
_NAMED = re.compile(
    rb'^[;\s"]*(?:printer_model|printer_settings_id|TARGET_MACHINE\.NAME)"?[ \t]*[:=][ \t]*"?([^\r\n"]*)', re.MULTILINE
)
_BED = re.compile(rb'^[;\s"]*(?:bed_shape|printable_area)"?[ \t]*[:=][ \t]*([^\r\n]*)', re.MULTILINE)
_BOUND = re.compile(rb"^;\s*(MIN|MAX)([XY]):\s*(-?\d+(?:\.\d+)?)\s*$", re.MULTILINE)
_KIRI_BED = b"; Bed left:"
_NUMBER = rb"(-?\d+(?:\.\d+)?)"
_KIRI = re.compile(
    rb"^; Bed left:%b right:%b top:%b bottom:%b\s*$[\s\S]*?^; Target: ([^\r\n]*)" % ((_NUMBER,) * 4), re.MULTILINE
)
_CORNER = re.compile(rb"(-?\d+(?:\.\d+)?)x(-?\d+(?:\.\d+)?)")


Corners = tuple[tuple[float, float], tuple[float, float]]


@dataclass(frozen=True)
class Described:
    """The printer that a file is for: its ``names`` as slicers write them, its bed's corners, the lowest and highest X
    and Y of what is printed; None where not said."""

    names: tuple[str, ...]
    bed_mm: Corners | None
    print_mm: Corners | None = None


def described(*texts: bytes) -> Described:
    """Read pieces of a file (`Part.hints`): PrusaSlicer's, Orca's, Bambu's settings, Cura's and Kiri:Moto's headers."""
    naming = [text for text in texts if any(word in text for word in _NAMES)]
    names = [name.strip().decode("utf-8", "replace") for text in naming for name in _NAMED.findall(text)]
    corners: list[tuple[float, float]] = []
    for text in texts:
        if not corners and any(word in text for word in _BEDS) and (found := _BED.search(text)) is not None:
            corners = [(float(x), float(y)) for x, y in _CORNER.findall(found[1])]
    for text in texts:
        if not corners and _KIRI_BED in text and (found := _KIRI.search(text)) is not None:
            left, right, top, bottom = (float(found[at]) for at in (1, 2, 3, 4))
            corners = [(left, bottom), (right, bottom), (right, top), (left, top)]
            names.append(found[5].strip().decode("utf-8", "replace"))
    known = tuple(dict.fromkeys(name for name in names if name))
    bed = None
    if len(corners) >= 3:
        xs, ys = zip(*corners, strict=True)
        bed = ((min(xs), min(ys)), (max(xs), max(ys)))
    return Described(known, bed, _bounds(texts))


def _bounds(texts: tuple[bytes, ...]) -> Corners | None:
    """Return Cura's bounds of a print; None where they are missing, or not filled in (the lowest above the highest)."""
    bounded = [text for text in texts if any(word in text for word in _ENDS)]
    at = {(end, axis): float(value) for text in bounded for end, axis, value in _BOUND.findall(text)}
    if len(at) < 4:
        return None
    low, high = ((at[end, b"X"], at[end, b"Y"]) for end in (b"MIN", b"MAX"))
    return (low, high) if low[0] < high[0] and low[1] < high[1] else None
