"""Read printers from TOML: presets and users' own files, through the same code."""

import difflib
import os
import re
import tomllib
from dataclasses import asdict, replace
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

from printmend.errors import ConfigError, InputError
from printmend.files import read_text
from printmend.messages import say
from printmend.printer.klipper import is_klipper
from printmend.printer.printer import (
    KLIPPER_PAUSE,
    PAUSE,
    SWITCHES,
    Axis,
    Homing,
    MotionLimits,
    Printer,
    bare_name,
    printers_named,
)
from printmend.printer.slicer import is_slicer_profile

_NUMBERS = ("min_mm", "max_mm", "mm_per_turn", "home_mm")
_COUNTS = ("steps_per_turn", "microsteps")
_AXIS_KEYS = {*_NUMBERS, *_COUNTS, "home_side"}
_KEYS = {"name", "kinematics", "x", "y", "z", "extruder", "start_gcode", "pause_gcode", "homing", "limits"}
_LIMITS = {"speed_mm_s": (1.0, 1e4), "accel_mm_s2": (10.0, 1e6), "crossing_mm_s2": (10.0, 1e6)}
_EXTRUDERS = ("bowden", "direct")
_COMMAND = re.compile(r"[A-Za-z][\x20-\x7e]{0,79}")  # one line, as a firmware reads it
_MOST_START_GCODE = 20_000  # characters; a longer text is no start code
_FAR_MM, _FAREST_MM = 1000.0, 1e5
_MOST_SCATTER_MM = 5.0  # largest scatter of an end stop
_LEAST_TURN_MM = 0.01  # least belt that a motor's turn moves
_MOST_PLACES = 5_000_000  # a machine is tabulated at its micro-steps; 300 mm at 256 a step are 400 000
_TODO = say("compare-printmend-printer-ender3-prints-preset")


def preset_names() -> tuple[str, ...]:
    """Return the names of the printers that ship with the program."""
    folder = resources.files("printmend.printer") / "presets"
    return tuple(sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir()))


def check_preset(name: str) -> None:
    """Raise `InputError` for a name that is not in `preset_names`."""
    if name not in preset_names():
        raise InputError(
            say("subject-printer"), wanted=say("one", ", ".join(preset_names())), came=repr(name), todo=say("correct")
        )


def preset_of(name: str) -> str | None:
    """Return the preset with this name, whose capitals, spaces and hyphens do not matter; None for another name."""
    return _presets().get(bare_name(name))


@cache
def _presets() -> dict[str, str]:
    """Return the presets by their bare names."""
    return {bare_name(preset): preset for preset in preset_names()}


@cache
def printers_like(printer: Printer) -> frozenset[str]:
    """Return the printers that one with a name of its own may be: those of the presets that have its numbers."""
    presets = (parse_printer(preset_text(name), subject=name) for name in preset_names())
    alike = (preset.name for preset in presets if replace(preset, name=printer.name) == printer)
    return frozenset[str]().union(*map(printers_named, alike))


def preset_text(name: str) -> str:
    """Return a preset's TOML text, as a start for a user's own printer."""
    return (resources.files("printmend.printer") / "presets" / f"{name}.toml").read_text(encoding="utf-8")


def _meant(name: str) -> str | None:
    """Return the preset that a name most likely means, despite a maker's name before it or a typing error."""
    presets, given = _presets(), bare_name(name)
    ends = [each for each in presets if given.endswith(each)]
    alike = [max(ends, key=len)] if ends else difflib.get_close_matches(given, presets, 1)
    return presets[alike[0]] if alike else None


def read_printer(source: str | Path) -> Printer:
    """Return the preset with this name, or the printer in this TOML file."""
    if (preset := preset_of(str(source))) is not None:
        return parse_printer(preset_text(preset), subject=str(source))
    if not os.path.isfile(source):
        meant = None if Path(source).suffix else _meant(str(source))
        todo = say("check-name-write-toml-file-compare")
        raise ConfigError(
            source,
            wanted=say("printer-preset-toml-file"),
            came=say("no-such-file") if Path(source).suffix else say("neither"),
            todo=todo if meant is None else say("did-you-mean-else", meant, todo),
        )
    return parse_printer(
        read_text(source, wanted=say("printer-toml"), todo=_TODO, error=ConfigError), subject=str(source)
    )


def printer_of(printer: Printer | str | Path) -> Printer:
    """Return a printer as it is, or read the one that a name or a path means."""
    return printer if isinstance(printer, Printer) else read_printer(printer)


def printer_section(printer: Printer) -> dict[str, Any]:
    """Return a printer's mechanics as the plain table that `parse_printer` reads, without default values."""
    axes = {axis.name: {key: value for key, value in asdict(axis).items() if key != "name"} for axis in printer.axes}
    table: dict[str, Any] = {"name": printer.name, "kinematics": printer.kinematics, **axes}
    for name, value, usual in (("homing", printer.homing, Homing()), ("limits", printer.limits, MotionLimits())):
        if known := {key: each for key, each in asdict(value).items() if each != getattr(usual, key)}:
            table[name] = known
    return table


def check_name(name: object, *, subject: str) -> str:
    """Return a printer's name; raise `ConfigError` for one that cannot stand in a comment of G-code."""
    if not isinstance(name, str) or name.splitlines() not in ([], [name]):
        raise ConfigError(subject, wanted=say("name-text-line"), came=repr(name)[:40], todo=_TODO)
    return name


def parse_printer(text: str, *, subject: str) -> Printer:
    """Build a printer from TOML text; ``subject`` names the source in errors."""
    try:
        table = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        other = is_klipper(text) or is_slicer_profile(text)
        todo = say("reads-as-other-programs", subject) if other else _TODO
        raise ConfigError(subject, wanted=say("printer-toml"), came=say("broken-toml", error), todo=todo) from None
    refuse_unknown(table, _KEYS, subject, "the top level")
    name, kinematics = check_name(table.get("name", subject), subject=subject), table.get("kinematics")
    if kinematics not in ("cartesian", "corexy"):
        raise ConfigError(subject, wanted=say("kinematics-cartesian-corexy-2"), came=repr(kinematics), todo=_TODO)
    extruder, start_gcode = table.get("extruder", "bowden"), table.get("start_gcode", "")
    if extruder not in _EXTRUDERS:
        raise ConfigError(subject, wanted=say("extruder-bowden-direct"), came=repr(extruder), todo=_TODO)
    if not isinstance(start_gcode, str) or len(start_gcode) > _MOST_START_GCODE:
        wanted = say("start-gcode-text-most-characters", _MOST_START_GCODE)
        raise ConfigError(subject, wanted=wanted, came=repr(start_gcode)[:40], todo=_TODO)
    pause_gcode = table.get("pause_gcode", PAUSE)
    if not isinstance(pause_gcode, str) or _COMMAND.fullmatch(pause_gcode) is None:
        wanted = say("pause-gcode-another-command-line", PAUSE, KLIPPER_PAUSE)
        raise ConfigError(subject, wanted=wanted, came=repr(pause_gcode)[:40], todo=_TODO)
    x, y, z = (_axis(table.get(axis), axis, subject) for axis in "xyz")
    if kinematics == "corexy" and (x.mm_per_step, x.microsteps) != (y.mm_per_step, y.microsteps):
        raise ConfigError(
            subject,
            wanted=say("equal-motors-corexy"),
            came=say("different-steps"),
            todo=say("make-them-equal"),
        )
    homing = _homing(table.get("homing", {}), subject)
    limits = _limits(table.get("limits", {}), subject)
    return Printer(name, kinematics, x, y, z, extruder, start_gcode, pause_gcode, homing, limits)


def _homing(table: Any, subject: str) -> Homing:
    if not isinstance(table, dict):
        raise ConfigError(subject, wanted=say("homing-section-homing"), came=repr(table)[:40], todo=_TODO)
    refuse_unknown(table, {"switch", "scatter_mm"}, subject, "[homing]")
    switch, scatter = table.get("switch", "unknown"), table.get("scatter_mm")
    if switch not in SWITCHES:
        raise ConfigError(
            subject,
            wanted=say("homing-switch", ", ".join(SWITCHES)),
            came=repr(switch)[:40],
            todo=say("correct"),
        )
    if scatter is None:
        return Homing(switch)
    if isinstance(scatter, bool) or not isinstance(scatter, int | float) or not 0 <= scatter <= _MOST_SCATTER_MM:
        wanted = say("homing-scatter-mm", f"{_MOST_SCATTER_MM:g}")
        raise ConfigError(subject, wanted=wanted, came=repr(scatter)[:40], todo=say("give-standard-deviation-mm"))
    return Homing(switch, float(scatter))


def _limits(table: Any, subject: str) -> MotionLimits:
    if not isinstance(table, dict):
        raise ConfigError(subject, wanted=say("section-limits"), came=repr(table)[:40], todo=_TODO)
    refuse_unknown(table, set(_LIMITS), subject, "[limits]")
    for key, value in table.items():
        low, high = _LIMITS[key]
        if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
            wanted = say("number-limits", f"{low:g}", f"{high:g}", key)
            raise ConfigError(subject, wanted=wanted, came=repr(value)[:40], todo=say("give-what-your-firmware-set"))
    return MotionLimits(**{key: float(value) for key, value in table.items()})


def _axis(table: Any, name: str, subject: str) -> Axis:
    if not isinstance(table, dict):
        raise ConfigError(subject, wanted=say("section", name), came=say("none"), todo=_TODO)
    section = f"[{name}]"
    refuse_unknown(table, _AXIS_KEYS, subject, section)
    if missing := sorted(_AXIS_KEYS - set(table)):
        raise ConfigError(subject, wanted=say("key-in-section", missing[0], section), came=say("such-key"), todo=_TODO)
    for key in _NUMBERS:
        value = table[key]
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= _FAREST_MM:
            wanted = say("number-up", f"{_FAREST_MM:g}", section, key)
            raise ConfigError(subject, wanted=wanted, came=repr(value), todo=_TODO)
    for key in _COUNTS:
        value = table[key]
        if isinstance(value, bool) or not isinstance(value, int) or not 0 < value <= 100_000:
            raise ConfigError(subject, wanted=say("positive-whole", section, key), came=repr(value), todo=_TODO)
    if table["home_side"] not in ("min", "max"):
        raise ConfigError(subject, wanted=say("home-side-min-max", section), came=repr(table["home_side"]), todo=_TODO)
    if table["max_mm"] <= table["min_mm"] or table["max_mm"] - table["min_mm"] > 10_000:
        raise ConfigError(
            subject,
            wanted=say("max-mm-above-min-mm-10", section),
            came=say("to", table["min_mm"], table["max_mm"]),
            todo=say("give-bed-mm"),
        )
    if not _LEAST_TURN_MM <= table["mm_per_turn"] <= 1000:
        wanted = say("mm-per-turn-1000", section, f"{_LEAST_TURN_MM:g}")
        raise ConfigError(subject, wanted=wanted, came=repr(table["mm_per_turn"]), todo=_TODO)
    if not table["min_mm"] - _FAR_MM <= table["home_mm"] <= table["max_mm"] + _FAR_MM:
        came = f"{table['home_mm']:g}"
        raise ConfigError(subject, wanted=say("home-mm-within-metre-axis", section), came=came, todo=_TODO)
    places = (table["max_mm"] - table["min_mm"]) * table["steps_per_turn"] * table["microsteps"] / table["mm_per_turn"]
    if name != "z" and places > _MOST_PLACES:
        raise ConfigError(
            subject,
            wanted=say("most-micro-steps-long", section, _MOST_PLACES),
            came=f"{places:.3g}",
            todo=say("check-mm-per-turn-steps-per"),
        )
    return Axis(name=name, **table)


def refuse_unknown(table: dict, known: set[str], subject: str, section: str) -> None:
    """Raise `ConfigError` for a key of a table that is not ``known``."""
    if unknown := sorted(set(table) - known):
        raise ConfigError(
            subject,
            wanted=say("only-2", ", ".join(sorted(known)), section),
            came=say("unknown-key", repr(unknown[0])),
            todo=say("remove-correct"),
        )
