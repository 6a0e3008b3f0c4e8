"""Find the settings of each slicer that make a part right, as numbers to type and as profiles to import.

Signs differ: PrusaSlicer's XY size compensation moves all walls out of the plastic, OrcaSlicer's hole compensation
makes holes larger, SuperSlicer's inner one smaller. Here all corrections point out of the plastic; each slicer's
function converts them.
"""

import configparser
import io
import json
import math
import re
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from printmend.files import replacing
from printmend.fit.estimate import RANGE, Estimate, Side
from printmend.gcode.sliced import Sliced
from printmend.messages import say

STEP_MM = 0.01  # resolution of a typed length
LEAST_MM, LEAST_SHARE = 0.01, 0.0003  # smaller corrections are not worth typing
LEAST_FLOW, MOST_FLOW = 0.01, 0.15  # shares: a flow error is only assumed between these
Where = Literal["print", "filament"]


@dataclass(frozen=True)
class Wanted:
    """Corrections that make a part right: how far the outline and holes of upper layers must move out of the plastic,
    how much less the first layer must, and the share by which the part will shrink."""

    outline_mm: float
    hole_mm: float
    foot_mm: float
    shrinkage: float


@dataclass(frozen=True)
class Setting:
    """One setting: its ``key`` in files, its ``name`` on the slicer's page, the ``value`` to type, and whether this
    differs from the file's value."""

    where: Where
    key: str
    name: str
    value: str
    is_new: bool


@dataclass(frozen=True)
class Slicer:
    """A slicer: its name, how it writes corrections, and which of them it can ``hold``."""

    name: str
    title: str
    written: Callable[[Wanted, Sliced], tuple[tuple[Where, str, str, str], ...]]
    holds: Callable[[Wanted], Wanted]


def wanted(estimate: Estimate, file: Sliced) -> Wanted:
    """Return the corrections that an estimate calls for; a value that is not surely wrong stays as in the file.

    An estimate is relative to the file's paths, which the file's own corrections have already moved.
    """
    first, upper = estimate.first, estimate.upper
    outline, hole, foot = file.outline_mm, file.hole_mm, file.foot_mm
    if upper is not None:
        outline -= _sure(_outline_off_mm(upper, file), upper.outline_sd_mm)
        if upper.hole_mm is not None:
            hole -= _sure(_hole_off_mm(upper, file), upper.hole_sd_mm)
        if first is not None and estimate.foot_mm is not None:
            foot_mm, sd_mm = estimate.foot_mm
            foot = max(foot + _sure(foot_mm - file.foot_mm, sd_mm), 0.0)
    elif first is not None:  # an outline that stands out counts as the foot; one that falls short does not
        off = _sure(_outline_off_mm(first, file), first.outline_sd_mm)
        foot = max(foot + off, 0.0)
        outline -= off - (foot - file.foot_mm)
        if first.hole_mm is not None:
            beyond = _sure(_hole_off_mm(first, file) - _outline_off_mm(first, file), first.extra_sd_mm)
            hole -= beyond + (file.outline_mm - outline)
    shares = [-scale for scale in estimate.scale]
    both = (shares[0] + shares[1]) / 2
    sd = sum(estimate.scale_sd) / 2  # the scan's scale is in both
    is_sure = abs(both - file.shrinkage) > max(RANGE * sd, LEAST_SHARE)
    shrinkage = both if is_sure and abs(both) > LEAST_SHARE else file.shrinkage
    return Wanted(_step(outline), _step(hole), _step(foot), round(shrinkage, 4) + 0.0)


def _outline_off_mm(side: Side, file: Sliced) -> float:
    """Return how far outlines stand out beyond the drawn part."""
    return file.outward_mm(hole=False, layer=side.layer) + side.outline_mm


def _hole_off_mm(side: Side, file: Sliced) -> float:
    """Return how far walls stand into holes beyond the drawn part."""
    return file.outward_mm(hole=True, layer=side.layer) + (side.hole_mm or 0.0)


def _step(value_mm: float) -> float:
    return round(value_mm / STEP_MM) * STEP_MM + 0.0


def _sure(value_mm: float, sd_mm: float) -> float:
    return value_mm if abs(value_mm) > max(RANGE * sd_mm, LEAST_MM) else 0.0


def settings_for(slicer: Slicer, corrections: Wanted, file: Sliced) -> tuple[Setting, ...]:
    """Return the slicer's settings that contain the corrections."""
    now = Wanted(file.outline_mm, file.hole_mm, file.foot_mm, file.shrinkage)
    before = {key: value for _, key, _, value in slicer.written(now, file)}
    return tuple(
        Setting(where, key, name, value, before.get(key) != value)
        for where, key, name, value in slicer.written(corrections, file)
    )


def _mm(value: float) -> str:
    return f"{value + 0.0:.2f}".rstrip("0").rstrip(".") if abs(value) >= STEP_MM / 2 else "0"


def _percent(value: float) -> str:
    return f"{100 * value + 0.0:.2f}".rstrip("0").rstrip(".") + "%"


def _prusa(w: Wanted, file: Sliced) -> tuple[tuple[Where, str, str, str], ...]:
    return (
        ("print", "xy_size_compensation", "XY Size Compensation", _mm(w.outline_mm)),
        ("print", "elefant_foot_compensation", "Elephant foot compensation", _mm(w.foot_mm)),
        ("filament", "filament_shrinkage_compensation_xy", "Shrinkage compensation XY", _percent(w.shrinkage)),
    )


def _super(w: Wanted, file: Sliced) -> tuple[tuple[Where, str, str, str], ...]:
    convex = float(file.settings.get("hole_size_compensation", "0") or 0) if file.maker == "superslicer" else 0.0
    return (
        ("print", "xy_size_compensation", "XY outer size compensation", _mm(w.outline_mm)),
        ("print", "xy_inner_size_compensation", "XY inner size compensation", _mm(w.hole_mm - convex)),
        ("print", "first_layer_size_compensation", "XY first layer compensation", _mm(-w.foot_mm)),
        ("filament", "filament_shrink", "Shrinkage", _percent(1 - w.shrinkage)),
    )


def _orca(w: Wanted, file: Sliced) -> tuple[tuple[Where, str, str, str], ...]:
    return (
        ("print", "xy_contour_compensation", "X-Y contour compensation", _mm(w.outline_mm)),
        ("print", "xy_hole_compensation", "X-Y hole compensation", _mm(-w.hole_mm)),
        ("print", "elefant_foot_compensation", "Elephant foot compensation", _mm(w.foot_mm)),
        ("filament", "filament_shrink", "Shrinkage (XY)", _percent(1 - w.shrinkage)),
    )


def _cura(w: Wanted, file: Sliced) -> tuple[tuple[Where, str, str, str], ...]:
    return (
        ("print", "xy_offset", "Horizontal Expansion", _mm(w.outline_mm)),
        ("print", "hole_xy_offset", "Hole Horizontal Expansion", _mm(w.outline_mm - w.hole_mm)),
        ("print", "xy_offset_layer_0", "Initial Layer Horizontal Expansion", _mm(w.outline_mm - w.foot_mm)),
        ("filament", "material_shrinkage_percentage_xy", "Horizontal Scaling Factor Shrinkage Compensation",
         _percent(1 / (1 - w.shrinkage)).removesuffix("%")),
    )  # fmt: skip


def _all(w: Wanted) -> Wanted:
    return w


def _one_for_both(w: Wanted) -> Wanted:
    """PrusaSlicer moves holes and outline together."""
    return Wanted(w.outline_mm, w.outline_mm, w.foot_mm, w.shrinkage)


SLICERS: Mapping[str, Slicer] = {
    each.name: each
    for each in (
        Slicer("prusaslicer", "PrusaSlicer", _prusa, _one_for_both),
        Slicer("orcaslicer", "OrcaSlicer", _orca, _all),
        Slicer("bambustudio", "Bambu Studio", _orca, _all),
        Slicer("cura", "Cura", _cura, _all),
        Slicer("superslicer", "SuperSlicer", _super, _all),
    )
}


def flow_instead(width_mm: float, came_mm: float, file: Sliced, height_mm: float) -> float | None:
    """Return the flow multiplier that turns lines of the width ``came_mm`` into lines of the set width; a bead is a
    rectangle with round ends. None if the error is too small or too large for a wrong flow."""
    round_mm = height_mm * (1 - math.pi / 4)
    factor = (width_mm - round_mm) / max(came_mm - round_mm, 1e-3)
    return file.flow * factor if LEAST_FLOW < abs(factor - 1) < MOST_FLOW else None


# Profiles to import: the settings with which a file was sliced, with the corrections inserted.
#
# PrusaSlicer and SuperSlicer import all settings of the file as an INI (*Import Config*, or ``--load``). OrcaSlicer and
# Bambu Studio import a JSON preset that inherits from the file's own. Cura imports the file's profile with new values.
# A file that does not state its settings gets no profile: an INI without them would reset all others.

WHOLE = 60  # a file with at least so many settings states all of them
NAME = "fits"  # suffix of a profile's name
_INI = ("prusaslicer", "superslicer")
_JSON = ("orcaslicer", "bambustudio")


def write_profiles(folder: Path, settings: Mapping[str, Sequence[Setting]], file: Sliced, numbers: Any) -> list[Path]:
    """Write ``fit.json`` with all numbers, and a profile for the file's slicer, into a folder; return the paths of the
    written files."""
    folder.mkdir(parents=True, exist_ok=True)
    texts: dict[str, str | bytes] = {"fit.json": json.dumps(numbers, ensure_ascii=False, indent=1) + "\n"}
    mine = settings.get(file.maker, ())
    if file.maker in _INI and len(file.settings) >= WHOLE:
        texts[f"{file.maker}.ini"] = _ini(mine, file)
    elif file.maker in _JSON:
        texts |= _presets(mine, file)
    elif file.maker == "cura" and (containers := file.containers):
        texts["cura.curaprofile"] = _cura_profile(mine, containers)
    written = []
    for name, text in texts.items():
        path = folder / name
        with replacing(path, "wb") as handle:
            handle.write(text if isinstance(text, bytes) else text.encode())
        written.append(path)
    return written


def how_to_import(file: Sliced) -> str:
    """Say where the profile goes, or why there is none."""
    title = SLICERS[file.maker].title if file.maker in SLICERS else say("fit-its-slicer")
    if file.maker in _INI and len(file.settings) >= WHOLE:
        return say("fit-import-ini", title)
    if file.maker in _JSON and _parent(file, "print_settings_id"):
        return say("fit-import-json", title)
    if file.maker == "cura" and file.containers:
        return say("fit-import-cura")
    return say("fit-no-profile")


def _ini(mine: Sequence[Setting], file: Sliced) -> str:
    values = {key: value for key, value in file.settings.items() if not key.endswith("_gcode_substitutions")}
    known = {each.key: each.value for each in mine if each.key in values or each.is_new}
    return "".join(f"{key} = {value}\n" for key, value in sorted((values | known).items()))


def _presets(mine: Sequence[Setting], file: Sliced) -> dict[str, str]:
    found = {}
    for where, kind, id_key in (
        ("print", "process", "print_settings_id"),
        ("filament", "filament", "filament_settings_id"),
    ):
        if not (parent := _parent(file, id_key)):
            continue
        name = f"{parent} {NAME}"
        values: dict[str, Any] = {each.key: each.value for each in mine if each.where == where}
        if kind == "filament":
            values = {key: [value] for key, value in values.items()}
        head: dict[str, Any] = {"type": kind, "name": name, "from": "User", "inherits": parent, "version": "1.0.0.0"}
        head[id_key] = name if kind == "process" else [name]
        found[f"{file.maker}-{kind}.json"] = json.dumps(head | values, ensure_ascii=False, indent=1) + "\n"
    return found


def _parent(file: Sliced, key: str) -> str:
    return file.settings.get(key, "").split(";")[0].strip().strip('"')


def _cura_profile(mine: Sequence[Setting], containers: Sequence[str]) -> bytes:
    """Return Cura's profile: the first container is the machine's, the others belong to its extruders."""
    memory = io.BytesIO()
    with zipfile.ZipFile(memory, "w", zipfile.ZIP_DEFLATED) as archive:
        for number, text in enumerate(containers):
            config = configparser.ConfigParser(interpolation=None, strict=False)
            config.optionxform = str  # type: ignore[assignment,method-assign]
            config.read_string(text)
            if not config.has_section("values"):
                config.add_section("values")
            for each in mine:
                if (each.where == "filament") == (number == 0) or len(containers) == 1:
                    config["values"][each.key] = each.value
            plain = re.sub(r"\W+", "_", config["general"].get("name", "profile"))
            config["general"]["name"] = f"{config['general'].get('name', 'profile')} {NAME}"
            out = io.StringIO()
            config.write(out)
            archive.writestr(f"{plain}_{number}", out.getvalue())
    return memory.getvalue()
