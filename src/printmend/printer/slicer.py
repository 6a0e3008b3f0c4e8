"""Read a printer's bed, height, extruder and start code from a slicer's profile; a preset gives its mechanics.

Profiles of PrusaSlicer and SuperSlicer (INI) or OrcaSlicer and Bambu Studio (JSON) contain no motors and end stops.
"""

import json
import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from printmend.errors import ConfigError
from printmend.messages import say, together
from printmend.printer.printer import KLIPPER_PAUSE, PAUSE, RRF_PAUSE, Axis, Extruder, Printer

# A shorter retraction [mm] means a direct extruder, with its motor on the tool head. In PrusaSlicer, Bowden profiles
# begin at 2 mm (Voron.ini), and direct ones end at 1.9 mm (Artillery.ini).
_SHORTEST_BOWDEN_MM = 1.95
_PAUSES = {"klipper": KLIPPER_PAUSE, "reprapfirmware": RRF_PAUSE, "rapid": RRF_PAUSE}  # by gcode_flavor
# Values of the placeholders in start code for a test print of PLA [°C]; `probe` says where to change them.
_PLA = {"first_layer_temperature": "205", "temperature": "205", "nozzle_temperature_initial_layer": "205",
        "first_layer_bed_temperature": "60", "bed_temperature": "60", "bed_temperature_initial_layer_single": "60",
        "bed_temperature_initial_layer": "60", "initial_extruder": "0", "initial_tool": "0",
        "current_extruder": "0", "initial_no_support_extruder": "0"}  # fmt: skip
_PLACEHOLDER = re.compile(r"[{\[]\s*(\w+)\s*(?:\[\s*(?:\d+|\w+)\s*\])?\s*[}\]]")


Values = Mapping[str, Any]
_SECTION = re.compile(r"^\s*\[([^\]]+)\]\s*$")
_NOZZLE = re.compile(r"\s{0,9}\(?\b\d{1,2}\.\d{1,3} ?(?:mm|nozzle).*$", re.IGNORECASE)  # text after a model's name
_DEEPEST = 20  # longest chain of sections that inherit from each other
_WIDEST_MARGIN_MM = 10.0  # widest margin of the bed that a profile leaves out: more means another origin


def is_slicer_profile(text: str) -> bool:
    """Return whether a text looks like a slicer's printer profile, or a bundle of them: by its keys, or as JSON."""
    keys = "bed_shape", "printable_area", "printer_technology", "[printer:"
    return any(key in text for key in keys) or text.lstrip().startswith("{")


def profile_of(text: str, *, model: str | None, subject: str, todo: str = "") -> Values:
    """Return the keys of a printer's profile, INI or JSON; from a bundle with several, the keys of ``model``.

    ``todo`` is further advice for an error that asks for a model. Raises `ConfigError` for a bundle of several printers
    without a known ``model``, and for a resin printer.
    """
    values = _json(text, subject) if text.lstrip().startswith("{") else _ini(text, model, subject, todo)
    technology = _first(values, ("printer_technology",)) or "FFF"
    if technology.upper() != "FFF":
        raise ConfigError(
            subject, wanted=say("printer-lays-lines-plastic"), came=say("resin-printer", technology),
            todo=say("name-another-nothing-one-moves-x"),
        )  # fmt: skip
    return values


def parse_slicer(values: Values, *, like: Printer, name: str, subject: str) -> tuple[Printer, tuple[str, ...]]:
    """Return the printer of a profile (`profile_of`) with the motors and end stops of ``like``, and words about
    settings that could not be converted.

    An end stop at an edge of the old bed moves to that edge of the new one. Raises `ConfigError` for a profile without
    a rectangular bed.
    """
    (low_mm, high_mm), margin = _without_margin(*_bed_mm(values, subject))
    height_mm = _number(values, ("max_print_height", "printable_height"), like.z.max_mm, subject)
    retraction_mm = _number(values, ("retract_length", "retraction_length"), 0.0, subject)
    extruder: Extruder = "bowden" if retraction_mm >= _SHORTEST_BOWDEN_MM else "direct"
    start, left = _start_gcode(_first(values, ("start_gcode", "machine_start_gcode")) or "")
    said = _first(values, ("printer_model", "printer_settings_id", "name")) or name
    axes = [_resized(axis, low_mm[i], high_mm[i]) for i, axis in enumerate((like.x, like.y))]
    kinematics = "corexy" if _first(values, ("printer_structure",)) == "corexy" else like.kinematics
    if kinematics != like.kinematics:
        raise ConfigError(
            subject, wanted=say("printer-like", like.kinematics), came=say("corexy"), todo=say("name-corexy-preset")
        )
    z = replace(like.z, max_mm=height_mm)
    pause = _PAUSES.get(_first(values, ("gcode_flavor",)) or "", PAUSE)
    return Printer(said, like.kinematics, axes[0], axes[1], z, extruder, start, pause), (*margin, *left)


def _json(text: str, subject: str) -> Values:
    """Return the keys of a profile in JSON."""
    try:
        values = json.loads(text)
    except (ValueError, RecursionError):
        raise ConfigError(
            subject,
            wanted=say("slicer-s-profile-json"),
            came=say("broken-json"),
            todo=say("export-printer-s-profile-from-slicer"),
        ) from None
    if not isinstance(values, dict) or "printable_area" not in values:
        base = values.get("inherits") if isinstance(values, dict) else None
        came = say("none-stands-one-inherits", repr(base)) if base else say("none")
        raise ConfigError(
            subject,
            wanted=say("printer-s-profile-printable-area"),
            came=came,
            todo=say("export-printer-s-profile-from-slicer"),
        )
    return values


def _ini(text: str, model: str | None, subject: str, todo: str) -> Values:
    """Return the keys of a profile in INI; from a bundle, the chosen printer's keys with those that it inherits."""
    sections: dict[str, dict[str, str]] = {"": {}}
    section = sections[""]
    for line in text.splitlines():
        if found := _SECTION.match(line):
            section = sections.setdefault(found[1].strip(), {})
        elif not line.lstrip().startswith(("#", ";")) and "=" in line:
            key, _, value = line.partition("=")
            section[key.strip()] = value.strip()
    bundle = {name.removeprefix("printer:"): own for name, own in sections.items() if name.startswith("printer:")}
    if not bundle:
        return sections[""]
    return _inherited(bundle, _chosen(list(bundle), model, subject, todo))


def _chosen(sections: list[str], model: str | None, subject: str, todo: str) -> str:
    """Return the chosen printer of a bundle: the only one, or the one named ``model``, with its usual nozzle."""
    names = [name for name in sections if not name.startswith("*")]
    wanted = (model or "").strip().lower()
    exact = [name for name in names if wanted in (name.lower(), _NOZZLE.sub("", name).lower())]
    fitting = exact or [name for name in names if wanted in name.lower()]
    if len({_NOZZLE.sub("", name) for name in fitting}) == 1:
        return next((name for name in fitting if "0.4" in name), fitting[0])
    models = list(dict.fromkeys(_NOZZLE.sub("", name) for name in fitting or names))
    if not models:
        raise ConfigError(
            subject, wanted=say("bundle-printer"), came=say("none"), todo=say("export-printer-s-profile-from-slicer")
        )
    advice = together("; ", filter(None, (todo, say("part-name-enough", ", ".join(models)))))
    raise ConfigError(
        subject, wanted=say("one-printer-named-model") if not wanted else say("printer-bundle", repr(model)),
        came=f"{len(models)}" if fitting else say("none"), todo=advice,
    )  # fmt: skip


def _inherited(bundle: Mapping[str, Mapping[str, str]], name: str) -> dict[str, str]:
    """Return the keys of a bundle's section, which override those of the sections that it inherits."""
    known: dict[str, dict[str, str]] = {}

    def keys_of(one: str, depth: int) -> dict[str, str]:
        if one not in known:  # resolve each section once, however many inherit it
            known[one] = {}  # stops at a section that inherits itself
            values: dict[str, str] = {}
            for base in bundle[one].get("inherits", "").split(";") if depth < _DEEPEST else ():
                if base.strip() in bundle:
                    values |= keys_of(base.strip(), depth + 1)
            known[one] = values | dict(bundle[one])
        return known[one]

    return keys_of(name, 0)


def _first(values: Mapping[str, Any], names: tuple[str, ...]) -> str | None:
    """Return the value of the first key that has one; a list counts by its first entry."""
    for name in names:
        value = values.get(name)
        value = value[0] if isinstance(value, list) and value else value
        if isinstance(value, str | int | float) and str(value):
            return str(value)
    return None


def _number(values: Mapping[str, Any], names: tuple[str, ...], otherwise: float, subject: str) -> float:
    value = _first(values, names)
    try:
        return otherwise if value is None else float(value.split(",")[0])
    except ValueError:
        raise ConfigError(
            subject,
            wanted=say("number", names[0]),
            came=value[:40] if value else "",
            todo=say("export-printer-s-profile-from-slicer"),
        ) from None


def _bed_mm(values: Mapping[str, Any], subject: str) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the corners of a rectangular bed."""
    shape = values.get("bed_shape", values.get("printable_area", ""))
    corners = shape if isinstance(shape, list) else str(shape).split(",")
    try:
        points = [tuple(float(part) for part in str(corner).lower().split("x")) for corner in corners]
        xs, ys = {point[0] for point in points}, {point[1] for point in points}
    except (ValueError, IndexError):
        raise ConfigError(
            subject,
            wanted=say("bed-shape-0x0-220x0"),
            came=str(shape)[:40],
            todo=say("export-printer-s-profile-from-slicer"),
        ) from None
    if len(points) != 4 or len(xs) != 2 or len(ys) != 2:
        todo = say("round-beds-not-yet")
        raise ConfigError(subject, wanted=say("rectangular-bed"), came=say("corners", len(points)), todo=todo)
    return (min(xs), min(ys)), (max(xs), max(ys))


def _without_margin(
    low_mm: tuple[float, float], high_mm: tuple[float, float]
) -> tuple[tuple[tuple[float, float], tuple[float, float]], tuple[str, ...]]:
    """Return the corners of the axes' reach, and words about the assumption.

    Some profiles leave out a margin of the bed, such as 5x5,295x5,…: the head still homes at 0, and the same margin
    lies at the far edge.
    """
    margin = [low if 0 < low <= _WIDEST_MARGIN_MM else 0.0 for low in low_mm]
    if not any(margin):
        return (low_mm, high_mm), ()
    low = (low_mm[0] - margin[0], low_mm[1] - margin[1])
    high = (high_mm[0] + margin[0], high_mm[1] + margin[1])
    names = [name for name, wide in zip("XY", margin, strict=True) if wide]
    said = say(
        "margin-mm-slicer-keeps-free-bed",
        f"{max(margin):g}",
        together(", ", names),
        f"{low[0]:g}",
        f"{low[1]:g}",
        f"{high[0]:g}",
        f"{high[1]:g}",
    )
    return (low, high), (said,)


def _resized(axis: Axis, low_mm: float, high_mm: float) -> Axis:
    """Return an axis with another bed; the end stop keeps its distance from its edge."""
    edge_mm, new_edge_mm = (axis.min_mm, low_mm) if axis.home_side == "min" else (axis.max_mm, high_mm)
    return replace(axis, min_mm=low_mm, max_mm=high_mm, home_mm=axis.home_mm + new_edge_mm - edge_mm)


def _start_gcode(text: str) -> tuple[str, tuple[str, ...]]:
    """Return start code with its placeholders filled in for PLA, or none and the reason if one of them is unknown."""
    lines = text.removeprefix('"').removesuffix('"').replace("\\n", "\n")
    filled = _PLACEHOLDER.sub(lambda found: _PLA.get(found[1], found[0]), lines)
    if unknown := re.search(r"[{\[][^}\]]*[}\]]", filled):
        return "", (say("start-code-of-slicer", unknown[0][:40]),)
    return filled.strip() + "\n" if filled.strip() else "", ()
