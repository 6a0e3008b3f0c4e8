"""The filament sections of a model file: measured scales, and the shrinkage of parts in each filament."""

from typing import Any

import numpy as np

from printmend.effects.effect import SCALE_MM
from printmend.filament import Entry, material_of
from printmend.infer.machine import DRAWS, Part
from printmend.messages import say
from printmend.model import SavedModel
from printmend.model.branches import number, numbers, refuse, section_of

FILAMENTS = "filaments"  # the model file's key
UNTOLD = ("whose-scale-not-settled", "whose-scale-untold")  # findings: the scale is the machine's or the filament's
MOST = 200  # entries, and filaments, of a file
_SUBJECT = "the model [filaments]"


def parse_entries(model: SavedModel) -> tuple[Entry, ...] | None:
    """Return the scales that a model was told of, None for one that knows no filament. Raises `ModelError` for a
    section that is none of ours."""
    section = model.document.get(FILAMENTS)
    if section is None:
        return None
    if not isinstance(section, dict):
        refuse(_SUBJECT, say("section-3"), say("something-else"))
    rows = section_of(section, "measured", list, _SUBJECT)
    if len(rows) > MOST:
        refuse(_SUBJECT, say("most-measured-scales", MOST), str(len(rows)))
    return tuple(_entry(row) for row in rows)


def entry_section(entry: Entry) -> dict[str, Any]:
    """Return a measured scale as plain values."""
    axes = {
        name: {"scale": round(scale, 8), "sd": round(sd, 8)}
        for name, scale, sd in zip("xy", entry.scale, entry.sd, strict=True)
        if np.isfinite(scale)
    }
    return {"kind": entry.kind, **({} if entry.filament is None else {"filament": entry.filament}), **axes}


def _entry(row: Any) -> Entry:
    if not isinstance(row, dict) or row.get("kind") not in ("print", "rule"):
        refuse(_SUBJECT, say("measured-scales-print-rule"), say("something-else"))
    filament = row.get("filament")
    if filament is not None:
        _check_name(filament)
    scale, sd = [np.nan, np.nan], [1.0, 1.0]
    for axis, name in enumerate("xy"):
        if name in row:
            one = section_of(row, name, dict, _SUBJECT)
            scale[axis], sd[axis] = number(one, "scale", _SUBJECT, 10.0), abs(number(one, "sd", _SUBJECT, 10.0))
    return Entry(filament, (scale[0], scale[1]), (sd[0], sd[1]), row["kind"])


def _check_name(name: Any) -> None:
    try:
        material_of(name if isinstance(name, str) else "")
    except Exception:
        refuse(_SUBJECT, say("names-filaments"), repr(name)[:40])


def known_filaments(model: SavedModel) -> dict[str, tuple[Part, Part]]:
    """Return by how much parts shrink along X and Y in each filament that a model knows."""
    section = model.document.get(FILAMENTS)
    if section is None:
        return {}
    known = section_of(section if isinstance(section, dict) else {}, "known", dict, _SUBJECT)
    if len(known) > MOST:
        refuse(_SUBJECT, say("most-filaments", MOST), str(len(known)))
    return {str(name): _parts(name, each) for name, each in known.items()}


def _parts(name: Any, section: Any) -> tuple[Part, Part]:
    _check_name(name)
    found = []
    for axis in "xy":
        one = section_of(section if isinstance(section, dict) else {}, axis, dict, _SUBJECT)
        draws = numbers(one, "draws", _SUBJECT, DRAWS)
        acts = number(one, "acts", _SUBJECT, SCALE_MM)
        if len(draws) != DRAWS:
            refuse(_SUBJECT, say("draws", DRAWS), str(len(draws)))
        found.append(Part("shrinkage", "xy".index(axis), (), np.array([acts]), draws[None]))
    return found[0], found[1]


def filament_section(parts: tuple[Part, Part]) -> dict[str, Any]:
    """Return the shrinkage in one filament as plain values, in mm per 100 mm."""
    return {
        axis: {"acts": float(f"{part.acts_mm[0]:.6g}"), "draws": [float(f"{each:.5g}") for each in part.draws_mm[0]]}
        for axis, part in zip("xy", parts, strict=True)
    }
