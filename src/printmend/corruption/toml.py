"""Corruptions ↔ TOML.

    [x.pulley]
    kind = "eccentric"
    eccentricity_mm = 0.5

    [y.belt]
    kind = "play"
    play_mm = 0.4

    [[effect]]
    name = "racking"
    on = "x"
    size_mm = 0.3

A motor's sections are pulley, belt, friction, warp, shaft, ripple, skips, missed and gain_table. The motors are x and
y, or a and b on a CoreXY. [frame] and [z.screw] belong to the machine; each [[effect]] names an effect. Parts that are
left out are healthy. An unknown key raises an error that names it.
"""

import dataclasses
import tomllib
from collections.abc import Sequence
from os.path import isfile
from pathlib import Path
from typing import Any

import tomli_w

from printmend.corruption.cause import Cause, cause_from, cause_of
from printmend.corruption.corruption import Corruption, Drive
from printmend.corruption.frame import CrookedFrame, Screw
from printmend.corruption.transmission import (
    BELTS,
    PULLEYS,
    Friction,
    GainTable,
    MissedSteps,
    Ripple,
    SetScrew,
    ToothSkips,
    Warp,
)
from printmend.errors import ConfigError
from printmend.files import read_text
from printmend.messages import say, together
from printmend.printer.toml import refuse_unknown

SECTIONS: dict[str, tuple[type, ...]] = {
    "pulley": PULLEYS,
    "belt": BELTS,
    "friction": (Friction,),
    "warp": (Warp,),
    "shaft": (SetScrew,),
    "ripple": (Ripple,),
    "skips": (ToothSkips,),
    "missed": (MissedSteps,),
    "gain_table": (GainTable,),
}
_MOTORS = {"x": 0, "y": 1, "a": 0, "b": 1}
_TODO = say("see-docs-corruptions-md-every-section")


def read_corruption(path: str | Path) -> Corruption:
    """Read a corruption from a TOML file."""
    text = read_text(path, wanted=say("corruption-toml"), todo=_TODO, error=ConfigError)
    return parse_corruption(text, subject=str(path))


def corruption_of(texts: Sequence[str], *, seed: int = 0) -> Corruption:
    """Return the corruption that command-line words name: at most one TOML file, and effects by name (`cause_of`).

    ``seed`` draws the numbers that an effect leaves out.
    """
    files = [text for text in texts if text.endswith(".toml") or "/" in text or isfile(text)]
    if len(files) > 1:
        raise ConfigError(files[1], wanted=say("toml-file-corruption"), came=say("second"), todo=say("put-both-file"))
    whole = read_corruption(files[0]) if files else Corruption()
    named = tuple(cause_of(text, seed=seed) for text in texts if text not in files)
    return dataclasses.replace(whole, causes=whole.causes + named)


def parse_corruption(text: str, *, subject: str) -> Corruption:
    """Build a corruption from TOML text; ``subject`` names the source in errors."""
    try:
        table = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise ConfigError(subject, wanted=say("corruption-toml"), came=say("broken-toml", error), todo=_TODO) from None
    refuse_unknown(table, {*_MOTORS, "frame", "z", "effect"}, subject, "the top level")
    drives = [Drive(), Drive()]
    for name in table.keys() & _MOTORS.keys():
        if drives[_MOTORS[name]] != Drive():
            raise ConfigError(
                subject, wanted=say("x-y-b-2"), came=say("both-namings"), todo=say("name-each-motor-once")
            )
        drives[_MOTORS[name]] = _drive(table[name], name, subject)
    frame = table.get("frame")
    crooked = None if frame is None else _value(frame, (CrookedFrame,), "[frame]", subject)
    screw = None
    if "z" in table:
        if not isinstance(table["z"], dict):
            raise ConfigError(subject, wanted=say("section-z-screw"), came=repr(table["z"]), todo=_TODO)
        refuse_unknown(table["z"], {"screw"}, subject, "[z]")
        if "screw" in table["z"]:
            screw = _value(table["z"]["screw"], (Screw,), "[z.screw]", subject)
    return Corruption((drives[0], drives[1]), crooked, screw, _causes(table.get("effect", []), subject))


def _causes(tables: Any, subject: str) -> tuple[Cause, ...]:
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        raise ConfigError(subject, wanted=say("sections-effect"), came=repr(tables)[:60], todo=_TODO)
    causes = []
    for table in tables:
        name = table.get("name")
        if not isinstance(name, str):
            raise ConfigError(subject, wanted=say("name-effect-2"), came=repr(name), todo=_TODO)
        try:
            causes.append(cause_from(name, {key: value for key, value in table.items() if key != "name"}))
        except ConfigError as error:
            raise ConfigError(
                together(", ", [subject, error.subject]), wanted=error.wanted, came=error.came, todo=error.todo
            ) from None
    return tuple(causes)


def _drive(table: Any, name: str, subject: str) -> Drive:
    if not isinstance(table, dict):
        raise ConfigError(subject, wanted=say("sections-like-pulley", name), came=repr(table), todo=_TODO)
    refuse_unknown(table, set(SECTIONS), subject, f"[{name}]")
    return Drive(**{key: _value(part, SECTIONS[key], f"[{name}.{key}]", subject) for key, part in table.items()})


def _value(table: Any, types: tuple[type, ...], section: str, subject: str) -> Any:
    if not isinstance(table, dict):
        raise ConfigError(subject, wanted=say("section-2", section), came=repr(table), todo=_TODO)
    kinds = {kind.kind: kind for kind in types}  # type: ignore[attr-defined]
    kind = table.get("kind", next(iter(kinds)) if len(kinds) == 1 else None)
    if kind not in kinds:
        raise ConfigError(subject, wanted=say("kind-out", section, ", ".join(kinds)), came=repr(kind), todo=_TODO)
    fields = {item.name: item for item in dataclasses.fields(kinds[kind])}
    refuse_unknown(table, {*fields, "kind"}, subject, section)
    required = [name for name, item in fields.items() if item.default is dataclasses.MISSING]
    if missing := [name for name in required if name not in table]:
        raise ConfigError(subject, wanted=say("key-in-section", missing[0], section), came=say("such-key"), todo=_TODO)
    for name, value in table.items():
        if fields.get(name) is not None and isinstance(value, list) != ("tuple" in str(fields[name].type)):
            raise ConfigError(
                subject, wanted=say("as", section, name, fields[name].type), came=repr(value)[:60], todo=_TODO
            )
    try:
        return kinds[kind](**{name: value for name, value in table.items() if name != "kind"})
    except ConfigError as error:
        raise ConfigError(
            together(" ", [subject, section]), wanted=error.wanted, came=error.came, todo=error.todo
        ) from None


def corruption_toml(corruption: Corruption) -> str:
    """Return TOML text that `parse_corruption` reads back to an equal value."""
    table: dict[str, Any] = {}
    for name, drive in zip(("x", "y"), corruption.drives, strict=True):
        parts = {item.name: getattr(drive, item.name) for item in dataclasses.fields(drive)}
        sections = {key: _plain(part) for key, part in parts.items() if part is not None}
        if sections:
            table[name] = sections
    if corruption.frame is not None:
        table["frame"] = _plain(corruption.frame)
    if corruption.screw is not None:
        table["z"] = {"screw": _plain(corruption.screw)}
    if corruption.causes:
        table["effect"] = [cause.table() for cause in corruption.causes]
    return tomli_w.dumps(table)


def _plain(value: Any) -> dict[str, Any]:
    items = {item.name: getattr(value, item.name) for item in dataclasses.fields(value)}
    plain = {name: list(item) if isinstance(item, tuple) else item for name, item in items.items() if item is not None}
    return {"kind": value.kind, **plain}
