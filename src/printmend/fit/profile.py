"""Profiles to import: the settings that a file was sliced with, and the corrections in them.

PrusaSlicer and SuperSlicer take all settings of the file as an INI (*Import Config*, or ``--load``), OrcaSlicer and
Bambu Studio a preset as JSON that inherits from the file's own, Cura the file's own profile with other values. A file
that does not say its settings gets no profile: an INI without them would reset all others.
"""

import configparser
import io
import json
import re
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from printmend.files import replacing
from printmend.fit.setting import SLICERS, Setting
from printmend.gcode.sliced import Sliced
from printmend.messages import say

WHOLE = 60  # settings, from which on a file says all of them
NAME = "fits"  # what is added to a profile's name
_INI = ("prusaslicer", "superslicer")
_JSON = ("orcaslicer", "bambustudio")


def write_profiles(folder: Path, settings: Mapping[str, Sequence[Setting]], file: Sliced, numbers: Any) -> list[Path]:
    """Write ``fit.json`` with all numbers into a folder, and the profile of the slicer that made the file; return what
    was written."""
    folder.mkdir(parents=True, exist_ok=True)
    texts: dict[str, str | bytes] = {"fit.json": json.dumps(numbers, ensure_ascii=False, indent=1) + "\n"}
    mine = settings.get(file.maker, ())
    if file.maker in _INI and len(file.settings) >= WHOLE:
        texts[f"{file.maker}.ini"] = _ini(mine, file)
    elif file.maker in _JSON:
        texts |= _presets(mine, file)
    elif file.maker == "cura" and (containers := file.containers):
        texts["cura.curaprofile"] = _cura(mine, containers)
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


def _cura(mine: Sequence[Setting], containers: Sequence[str]) -> bytes:
    """Return Cura's profile: the first container is the machine's, the others its extruders'."""
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
