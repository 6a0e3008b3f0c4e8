"""Read what a file's comments say: its printer, its slicer's settings, and printmend's own marks."""

import json
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

import printmend
from printmend.errors import GcodeError
from printmend.messages import say
from printmend.provenance import FORGED, MARK, MENDED, SEALED, TEST_PRINT, TEST_PRINT_MARK, claimed_test_print

# printmend's own comments mark a file as mended, so that it is not mended twice, or as a test print.

# Headers that must stay on top; the mark follows their last line.
_HEADERS = (
    (b"; HEADER_BLOCK_START", b"; HEADER_BLOCK_END"),  # Bambu, Orca
    (b";START_OF_HEADER", b";END_OF_HEADER"),  # UltiMaker
    (b";Header Start", b";Header End"),  # Snapmaker
)
_FAR_BYTES = 1 << 19  # a header that does not end within so many bytes is taken to be endless


def find_mark(*texts: bytes) -> str | None:
    """Return the model hash of the mark in pieces of a file (`Part.hints`), or None."""
    for text in texts:
        if found := _mark(text):
            return found[2].decode("ascii", "replace")
    return None


def find_e_rule(text: bytes) -> tuple[int, int] | None:
    """Return how E was read in a mended file (C_RULE, C_M83), if its mark says so."""
    found = _mark(text)
    return None if found is None or found[3] is None else (int(found[3]), int(found[4]))


def _mark(text: bytes) -> re.Match[bytes] | None:
    """Return the mark in a text. The expression is slow, so it runs only if the text contains the words."""
    return MARK.search(text) if MENDED in text else None


def find_test_print(*texts: bytes) -> str | None:
    """Return the kind of printmend's test print that pieces of a file belong to: "probe" or "first layer".

    None for any other file, and for a mended test print: that is a check print for `printmend verify`.
    """
    if find_mark(*texts) is not None:
        return None
    return next((found[1].decode() for text in texts if (found := TEST_PRINT_MARK.search(text))), None)


def lost_mark(*texts: bytes) -> bool:
    """Return whether a file lost its mark of mending: it has no mark, but the seal at its end is still there."""
    return any(SEALED in text for text in texts) and find_test_print(*texts) is None


def is_test_print(path: Path) -> bool:
    """Return whether a file is an unmended test print of printmend's. Programs that mend every file must leave it
    unchanged, because it must show the printer without mending. Raises `GcodeError` if it was changed since."""
    claim = claimed_test_print(str(path))
    if claim == FORGED:
        raise GcodeError(
            path, wanted=say("terminal-test-print-printmend-probe-wrote"), came=say("was-changed-since"),
            todo=say("write-again-take-out-comment-says"),
        )  # fmt: skip
    return claim == TEST_PRINT


def with_comment(text: bytes, comment: bytes) -> bytes:
    """Insert a comment line into G-code: after its header, after its first comment, or on top."""
    at, line = _inserted(text, comment)
    return text[:at] + line + text[at:]


def _inserted(text: bytes, comment: bytes) -> tuple[int, bytes]:
    """Return the offset at which to insert a comment, and its line with the line ends needed there."""
    at, line_end = _place(text), _line_end(text)
    before = text[:at]
    missing = line_end if before and not before.endswith((b"\n", b"\r", b"\xef\xbb\xbf")) else b""
    closing = line_end if at < len(text) or not missing else b""
    return at, missing + comment + closing


def marked(
    chunks: Iterable[np.ndarray], model_hash: str, e_rule: tuple[int, int] | None = None
) -> Iterator[np.ndarray]:
    """Yield the chunks with the mark in the first, where `with_comment` puts it.

    ``e_rule`` is how E was read if that had to be guessed; the mended file must be read in the same way.
    """
    guessed = "" if e_rule is None else f" e={e_rule[0]}{e_rule[1]}"
    mark = MENDED + f"{printmend.__version__} model={model_hash}{guessed}".encode()
    first = True
    for chunk in chunks:
        if first:
            at, line = _inserted(chunk.tobytes(), mark)
            chunk = np.concatenate((chunk[:at], np.frombuffer(line, np.uint8), chunk[at:]))
            chunk.setflags(write=False)  # like all chunks: the kernels are compiled for read-only arrays
            first = False
        yield chunk


def _line_end(text: bytes) -> bytes:
    newline = text.find(b"\n")
    if newline < 0 and b"\r" in text:
        return b"\r"
    return b"\r\n" if newline > 0 and text[newline - 1 : newline] == b"\r" else b"\n"


def _place(text: bytes) -> int:
    start = 3 if text.startswith(b"\xef\xbb\xbf") else 0
    for opening, ending in _HEADERS:
        # In an endless header the mark goes above its end, because `find_mark` searches only the first MiB.
        if text.startswith(opening, start) and (end := text.find(ending, start, _FAR_BYTES)) >= 0:
            return _next_line(text, end)
    line = text[start : _next_line(text, start)].strip()
    plain_comment = line.startswith(b";") and not line.lstrip(b"; ").startswith(b"thumbnail")
    return _next_line(text, start) if plain_comment or line == b"%" else start


def _next_line(text: bytes, position: int) -> int:
    newline = text.find(_line_end(text)[-1:], position)
    return len(text) if newline < 0 else newline + 1


# Run each expression only if one of its words occurs: a MiB that names no printer is then skipped quickly.
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
    highest X and Y of the print; None if the file does not say."""

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
    """Return Cura's bounds of a print; None if they are missing, or not filled in (the lowest above the highest)."""
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
    the share by which the part is enlarged to compensate for shrinkage, ``flow`` the flow multiplier. ``containers``
    are Cura's profiles: the machine's, then each extruder's.
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
    """Read the slicer and its settings from pieces of a file (`gcode.container.Part.hints`)."""
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
    return share if abs(share) < 0.1 else 0.0  # nothing shrinks by a tenth: this is another setting


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
    """Return the profiles that Cura writes at the end of a file, none if they cannot be read."""
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
