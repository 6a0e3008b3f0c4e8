"""What a file says of the printer that it is for, and of the settings that it was sliced with."""

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field

# Each expression is asked only where one of its words stands: a MiB that names no printer is passed over quickly.
_NAMES, _BEDS = (b"printer_model", b"printer_settings_id", b"TARGET_MACHINE.NAME"), (b"bed_shape", b"printable_area")
_ENDS = (b"MINX:", b"MINY:", b"MAXX:", b"MAXY:")
_NAMED = re.compile(
    rb'^[;\s"]*(?:printer_model|printer_settings_id|TARGET_MACHINE\.NAME)"?[ \t]*[:=][ \t]*"?([^\r\n"]*)', re.MULTILINE
)
_BED = re.compile(rb'^[;\s"]*(?:bed_shape|printable_area)"?[ \t]*[:=][ \t]*([^\r\n]*)', re.MULTILINE)
_BOUND = re.compile(rb"^;\s*(MIN|MAX)([XY]):\s*(-?\d+(?:\.\d+)?)\s*$", re.MULTILINE)
_KIRI_BED = b"; Bed left:"
_FIGURE = rb"(-?\d+(?:\.\d+)?)"
_KIRI = re.compile(
    rb"^; Bed left:%b right:%b top:%b bottom:%b\s*$[\s\S]*?^; Target: ([^\r\n]*)" % ((_FIGURE,) * 4), re.MULTILINE
)
_CORNER = re.compile(rb"(-?\d+(?:\.\d+)?)x(-?\d+(?:\.\d+)?)")


Corners = tuple[tuple[float, float], tuple[float, float]]


@dataclass(frozen=True)
class Described:
    """The printer that a file is for: its ``names`` as slicers write them, the corners of its bed, and the lowest and
    highest X and Y of the print; None for what is not said."""

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


_SETTING = re.compile(rb"^; ([a-z][a-z0-9_]*) = ([^\r\n]*)$", re.MULTILINE)
_CURA_LINE = re.compile(rb"^;SETTING_3 ([^\r\n]*)", re.MULTILINE)
_CURA_VALUE = re.compile(r"^([a-z][a-z0-9_]*) = ([^\r\n]*)$", re.MULTILINE)
_NUMBER = re.compile(r"-?\d+(?:\.\d+)?")
MAKERS = {
    "superslicer": (b"SuperSlicer",),
    "prusaslicer": (b"PrusaSlicer",),
    "bambustudio": (b"BambuStudio",),
    "orcaslicer": (b"OrcaSlicer",),
    "cura": (b"Cura_SteamEngine", b";SETTING_3"),
}


@dataclass(frozen=True)
class Sliced:
    """The slicer of a file ("" if unknown) and its settings.

    ``outline_mm`` is how far its corrections already push the outline of upper layers outwards, ``hole_mm`` how far
    they push the walls of holes into the hole. The first layer's outline is pushed ``foot_mm`` less. ``shrinkage`` is
    the share by which the part is enlarged against shrinking, ``flow`` the multiplier of the flow. ``containers`` are
    Cura's: its profile of the machine, then of each extruder.
    """

    maker: str = ""
    settings: Mapping[str, str] = field(default_factory=dict)
    outline_mm: float = 0.0
    hole_mm: float = 0.0
    foot_mm: float = 0.0
    shrinkage: float = 0.0
    flow: float = 1.0
    containers: tuple[str, ...] = ()

    def outward_mm(self, *, hole: bool, layer: int) -> float:
        """Return how far the corrections move the walls of a layer out of the plastic."""
        return (self.hole_mm if hole else self.outline_mm) - (self.foot_mm if layer == 1 else 0.0)


def sliced(*hints: bytes) -> Sliced:
    """Return what pieces of a file (`gcode.container.Part.hints`) say of its slicer and settings."""
    maker = next((name for name, words in MAKERS.items() if any(word in text for text in hints for word in words)), "")
    settings = _settings(hints)

    def number(key: str, without: float = 0.0) -> float:
        found = _NUMBER.search(settings.get(key, ""))
        return without if found is None else float(found[0])

    flow = number("extrusion_multiplier", 1.0)
    if maker in ("orcaslicer", "bambustudio"):
        return Sliced(
            maker, settings, number("xy_contour_compensation"), -number("xy_hole_compensation"),
            number("elefant_foot_compensation"), _shrunk(1 - number("filament_shrink", 100.0) / 100),
            number("filament_flow_ratio", 1.0),
        )  # fmt: skip
    if maker == "superslicer":
        holes = number("xy_inner_size_compensation") + number("hole_size_compensation")
        foot = -number("first_layer_size_compensation")
        shrinkage = _shrunk(1 - number("filament_shrink", 100.0) / 100)
        return Sliced(maker, settings, number("xy_size_compensation"), holes, foot, shrinkage, flow)
    if maker == "cura":
        out = number("xy_offset")
        first = number("xy_offset_layer_0", out)
        enlarged = number("material_shrinkage_percentage_xy", number("material_shrinkage_percentage", 100.0)) / 100
        return Sliced(
            maker, settings, out, out - number("hole_xy_offset"), out - first,
            _shrunk(1 - 1 / enlarged if enlarged > 0 else 0.0), number("material_flow", 100.0) / 100,
            _containers(hints),
        )  # fmt: skip
    out, shrinkage = number("xy_size_compensation"), number("filament_shrinkage_compensation_xy") / 100
    return Sliced(maker, settings, out, out, number("elefant_foot_compensation"), _shrunk(shrinkage), flow)


def _shrunk(share: float) -> float:
    return share if abs(share) < 0.1 else 0.0  # nothing shrinks by a tenth, so that this is another setting


def _settings(hints: tuple[bytes, ...]) -> dict[str, str]:
    found: dict[str, str] = {}
    for text in hints:
        for key, value in _SETTING.findall(text):
            found[key.decode("ascii")] = value.decode("utf-8", "replace").strip()
        if text.lstrip()[:1] == b"{":  # the settings of a project
            found |= _project(text)
    for container in _containers(hints):
        found |= dict(_CURA_VALUE.findall(container))
    return found


def _containers(hints: tuple[bytes, ...]) -> tuple[str, ...]:
    """Return the profiles that Cura writes at the end of a file, none where they cannot be read."""
    text = b"".join(line for hint in hints for line in _CURA_LINE.findall(hint)).decode("utf-8", "replace")
    try:
        document = json.loads(text)
        containers = [document["global_quality"], *document.get("extruder_quality", [])]
    except (KeyError, TypeError, ValueError, RecursionError):
        return ()
    plain = [each.replace("\\n", "\n") for each in containers if isinstance(each, str)]
    return tuple(each for each in plain if each.lstrip().startswith("[general]"))


def _project(text: bytes) -> dict[str, str]:
    try:
        document = json.loads(text)
    except (ValueError, RecursionError):
        return {}
    plain = {key: value[0] if isinstance(value, list) and value else value for key, value in document.items()}
    return {key: value for key, value in plain.items() if isinstance(key, str) and isinstance(value, str)}
