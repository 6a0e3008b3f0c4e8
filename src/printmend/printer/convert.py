"""Read a printer from its owner's files: Klipper's printer.cfg, or a slicer's printer profile."""

import re
from pathlib import Path

import tomli_w

from printmend.errors import ConfigError
from printmend.files import read_text
from printmend.messages import say
from printmend.printer.klipper import is_klipper, parse_klipper
from printmend.printer.printer import PAUSE, Printer
from printmend.printer.slicer import is_slicer_profile, parse_slicer, profile_of
from printmend.printer.toml import parse_printer, printer_section, read_printer

_WANTED = say("printer-cfg-slicer-printer-profile-ini")
_TODO = say("export-printer-profile-slicer-start-preset")
_GCODE = re.compile(r"^[GM]\d+\b", re.MULTILINE)  # a profile has its G-code within a value
_TOO = say("add-like-too")


def convert(path: Path, *, like: str | None = None, model: str | None = None) -> tuple[Printer, tuple[str, ...]]:
    """Read a printer from another program's file; return it, and words about settings that could not be converted.

    ``like`` names the preset that gives a slicer's profile its motors and end stops. ``model`` chooses a printer from a
    file that has several. The result has passed the checks of a printer's TOML. Raises `ConfigError` for anything else.
    """
    if not path.exists() and not path.suffix:  # a misspelt name of a preset
        read_printer(path)
    text, subject = read_text(path, wanted=_WANTED, todo=_TODO, error=ConfigError), str(path)
    left: tuple[str, ...] = ()
    if not text.strip():
        raise ConfigError(subject, wanted=_WANTED, came=say("empty-file"), todo=_TODO)
    if is_klipper(text):
        printer = parse_klipper(text, name=path.stem, subject=subject)
    elif _GCODE.search(text):
        raise ConfigError(subject, wanted=_WANTED, came=say("g-code-itself"), todo=_TODO)
    elif is_slicer_profile(text):
        todo = say("name-preset-like")
        values = profile_of(text, model=model, subject=subject, todo="" if like else _TOO)
        if like is None:
            raise ConfigError(subject, wanted=say("know-motors"), came=say("slicer-profile-say"), todo=todo)
        printer, left = parse_slicer(values, like=read_printer(like), name=path.stem, subject=subject)
    elif "=" in text:
        printer = parse_printer(text, subject=subject)
    else:
        raise ConfigError(subject, wanted=_WANTED, came=say("neither"), todo=_TODO)
    parse_printer(printer_text(printer), subject=subject)
    return printer, left


def printer_text(printer: Printer) -> str:
    """Return a printer as TOML that `read_printer` reads."""
    table = {**printer_section(printer), "extruder": printer.extruder}
    if printer.start_gcode:
        table["start_gcode"] = printer.start_gcode
    if printer.pause_gcode != PAUSE:
        table["pause_gcode"] = printer.pause_gcode
    return tomli_w.dumps(table, multiline_strings=True)
