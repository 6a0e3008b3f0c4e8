"""Is a file meant for this printer? Judge by its slicer's comments and by where it prints."""

import numpy as np

from printmend.errors import ModelError
from printmend.gcode.sliced import Corners, Described
from printmend.mend.prediction import Prediction
from printmend.messages import say
from printmend.printer import Printer
from printmend.printer.known import printers_named

_OUTSIDE_MM = 15.0  # how far beyond the bed a file may print: purge lines and wipes lie a few millimetres beyond some
_BED_OFF_MM = 30.0  # how far a slicer's bed and the preset's may differ where the printer is the same …
_STRANGER_BED_OFF_MM = 15.0  # … and where the file names none that may be the model's


def refuse_other_printer(name: str, printer: Printer, prediction: Prediction) -> None:
    """Raise `ModelError` where a file prints far beyond the printer's bed."""
    if not prediction.extruding:
        return
    todo = say("use-model-printer-file")
    for axis, low, high in zip((printer.x, printer.y), prediction.low_mm, prediction.high_mm, strict=True):
        if low < axis.min_mm - _OUTSIDE_MM or high > axis.max_mm + _OUTSIDE_MM:
            wanted = say("g-code-from-mm", printer.name, axis.name.upper(), f"{axis.min_mm:g}", f"{axis.max_mm:g}")
            came = say("extrusion-from-mm", f"{low:.1f}", f"{high:.1f}")
            raise ModelError(name, wanted=wanted, came=came, todo=todo)


def refuse_contradiction(name: str, said: Described, printer: Printer) -> None:
    """Raise `ModelError` where a file says that it is for another printer than the model's."""
    todo = say("use-model-printer-file-force-if", printer.name)
    other = _other_printer(said, printer)
    if (
        said.bed_mm is not None
        and _has_other_bed(said, printer)
        and (other is not None or not _is_within(said, printer))
    ):
        for_whom = say("of-printer", said.names[0]) if other is not None else ""
        own, theirs = _bed_words(_bed_mm(printer)), _bed_words(said.bed_mm)
        raise ModelError(name, wanted=say("g-code-bed-from", own), came=say("bed-from", theirs, for_whom), todo=todo)
    if said.print_mm is not None:
        low, high = said.print_mm
        ends = ((printer.x, low[0], high[0]), (printer.y, low[1], high[1]))
        for axis, least, most in ends:
            if least < axis.min_mm - _OUTSIDE_MM or most > axis.max_mm + _OUTSIDE_MM:
                wanted = say("g-code-from-mm", printer.name, axis.name.upper(), f"{axis.min_mm:g}", f"{axis.max_mm:g}")
                raise ModelError(name, wanted=wanted, came=say("header-from-mm", f"{least:g}", f"{most:g}"), todo=todo)
    if other:
        raise ModelError(name, wanted=say("g-code", printer.name), came=say("g-code", other), todo=todo)


def _other_printer(said: Described, printer: Printer) -> str | None:
    """Return the printer that a file names, if it is surely not the model's. Empty: the name is unknown. None: the file
    names the model's printer, or none."""
    mine, theirs = printers_named(printer.name), [printers_named(each) for each in said.names]
    if not (mine and theirs) or any(mine & each for each in theirs):
        return None
    return next((each for each, printers in zip(said.names, theirs, strict=True) if printers), "")


def _bed_mm(printer: Printer) -> Corners:
    """Return the corners of a printer's bed."""
    return (printer.x.min_mm, printer.y.min_mm), (printer.x.max_mm, printer.y.max_mm)


def _bed_words(bed_mm: Corners) -> str:
    """Return from where to where a bed goes."""
    return say("from-corner-to-corner", *(f"{x:g}, {y:g}" for x, y in bed_mm))


def _has_other_bed(said: Described, printer: Printer) -> bool:
    """Say whether a file is for a bed that cannot be the printer's."""
    if said.bed_mm is None:
        return False
    limit_mm = _BED_OFF_MM if _other_printer(said, printer) is None else _STRANGER_BED_OFF_MM
    return float(np.abs(np.subtract(_bed_mm(printer), said.bed_mm)).max()) > limit_mm


def _is_within(said: Described, printer: Printer) -> bool:
    """Say whether the bed that a file is for fits on the printer's, as a slicer's default bed mostly does."""
    if said.bed_mm is None:
        return False
    (low, high), (own_low, own_high) = said.bed_mm, _bed_mm(printer)
    least_mm = min(low[axis] - own_low[axis] for axis in range(2))
    return min(least_mm, *(own_high[axis] - high[axis] for axis in range(2))) >= -_OUTSIDE_MM


def small_bed_words(said: Described, printer: Printer) -> str | None:
    """Return a note about a file whose bed differs from the printer's but fits on it."""
    if said.bed_mm is None or not (_has_other_bed(said, printer) and _is_within(said, printer)):
        return None
    return say("slicer-s-bed-goes-from-printer", _bed_words(said.bed_mm), _bed_words(_bed_mm(printer)))
