"""A printer's bed, height, extruder and start code from a slicer's printer profile; its mechanics come from a preset.

PrusaSlicer, SuperSlicer (INI) and OrcaSlicer, Bambu Studio (JSON) know neither motors nor end stops.
"""

import json
import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from printmend.errors import ConfigError
from printmend.printer.printer import Axis, Extruder, Printer

# A slicer that draws the filament back by less than this has its motor on the tool head, mm. Bowden profiles of
# PrusaSlicer begin at 2 mm (Voron.ini), direct ones end at 1.9 mm (Artillery.ini).
_SHORTEST_BOWDEN_MM = 1.95
# What the placeholders of start code stand for in a test print of PLA, °C; `probe` says where to change them.
_PLA = {"first_layer_temperature": "205", "temperature": "205", "nozzle_temperature_initial_layer": "205",
        "first_layer_bed_temperature": "60", "bed_temperature": "60", "bed_temperature_initial_layer_single": "60",
        "bed_temperature_initial_layer": "60", "initial_extruder": "0", "initial_tool": "0",
        "current_extruder": "0", "initial_no_support_extruder": "0"}  # fmt: skip
_PLACEHOLDER = re.compile(r"[{\[]\s*(\w+)\s*(?:\[\s*(?:\d+|\w+)\s*\])?\s*[}\]]")
_TODO = "export the printer's profile from the slicer, or start from a preset"


def is_slicer_profile(text: str) -> bool:
    """Say whether a text looks like a printer profile of a slicer."""
    return "bed_shape" in text or "printable_area" in text


def parse_slicer(text: str, *, like: Printer, name: str, subject: str) -> tuple[Printer, tuple[str, ...]]:
    """Return the printer of a profile with the motors and end stops of ``like``, and what could not be taken over.

    An end stop at an edge of the old bed moves to that edge of the new one. Raises `ConfigError` for a profile without
    a rectangular bed.
    """
    values = _values(text, subject)
    low_mm, high_mm = _bed_mm(values, subject)
    height_mm = _number(values, ("max_print_height", "printable_height"), like.z.max_mm, subject)
    retraction_mm = _number(values, ("retract_length", "retraction_length"), 0.0, subject)
    extruder: Extruder = "bowden" if retraction_mm >= _SHORTEST_BOWDEN_MM else "direct"
    start, left = _start_gcode(_first(values, ("start_gcode", "machine_start_gcode")) or "")
    said = _first(values, ("printer_model", "printer_settings_id", "name")) or name
    axes = [_resized(axis, low_mm[i], high_mm[i]) for i, axis in enumerate((like.x, like.y))]
    kinematics = "corexy" if _first(values, ("printer_structure",)) == "corexy" else like.kinematics
    if kinematics != like.kinematics:
        raise ConfigError(
            subject, wanted=f"a {like.kinematics} printer, as --like", came="a CoreXY", todo="name a CoreXY preset"
        )
    z = replace(like.z, max_mm=height_mm)
    return Printer(said, like.kinematics, axes[0], axes[1], z, extruder, start), left


def _values(text: str, subject: str) -> Mapping[str, Any]:
    """Return the keys of an INI profile or a JSON one."""
    if text.lstrip().startswith("{"):
        try:
            values = json.loads(text)
        except (ValueError, RecursionError):
            raise ConfigError(subject, wanted="a profile in JSON", came="broken JSON", todo=_TODO) from None
        return values if isinstance(values, dict) else {}
    pairs = (line.partition("=") for line in text.splitlines() if not line.lstrip().startswith(("#", ";", "[")))
    return {key.strip(): value.strip() for key, _, value in pairs if value}


def _first(values: Mapping[str, Any], names: tuple[str, ...]) -> str | None:
    """Return the first of some keys that has a text; lists count by their first entry."""
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
            subject, wanted=f"a number for {names[0]}", came=value[:40] if value else "", todo=_TODO
        ) from None


def _bed_mm(values: Mapping[str, Any], subject: str) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the corners of a rectangular bed."""
    shape = values.get("bed_shape", values.get("printable_area", ""))
    corners = shape if isinstance(shape, list) else str(shape).split(",")
    try:
        points = [tuple(float(part) for part in str(corner).lower().split("x")) for corner in corners]
        xs, ys = {point[0] for point in points}, {point[1] for point in points}
    except (ValueError, IndexError):
        raise ConfigError(subject, wanted="a bed shape as 0x0,220x0,…", came=str(shape)[:40], todo=_TODO) from None
    if len(points) != 4 or len(xs) != 2 or len(ys) != 2:
        todo = "round beds belong to machines that cannot be learned yet"
        raise ConfigError(subject, wanted="a rectangular bed", came=f"{len(points)} corners", todo=todo)
    return (min(xs), min(ys)), (max(xs), max(ys))


def _resized(axis: Axis, low_mm: float, high_mm: float) -> Axis:
    """Return an axis with another bed; the end stop keeps its distance from the edge that it is at."""
    edge_mm, new_edge_mm = (axis.min_mm, low_mm) if axis.home_side == "min" else (axis.max_mm, high_mm)
    return replace(axis, min_mm=low_mm, max_mm=high_mm, home_mm=axis.home_mm + new_edge_mm - edge_mm)


def _start_gcode(text: str) -> tuple[str, tuple[str, ...]]:
    """Return start code with its placeholders filled in for PLA, or none where one of them is unknown, and why."""
    lines = text.replace("\\n", "\n")
    filled = _PLACEHOLDER.sub(lambda found: _PLA.get(found[1], found[0]), lines)
    if unknown := re.search(r"[{\[][^}\]]*[}\]]", filled):
        why = f"start code: {unknown[0][:40]} is filled in by the slicer alone"
        return "", (f"{why}; `printmend probe --start-from PART.gcode` copies the start of a sliced file instead",)
    return filled.strip() + "\n" if filled.strip() else "", ()
