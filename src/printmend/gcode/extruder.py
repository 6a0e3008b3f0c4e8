"""Which word drives the extruder: E, or A as slicers write it for Mach3 and Machinekit."""

import re

import numpy as np

from printmend.gcode import kernels as k
from printmend.gcode.machine import MachineState

_ENOUGH_MOVES = 20  # that name A, before their numbers alone decide what it is
_IMPLAUSIBLE_SHARE = 0.1  # of these moves, up to which A is taken for an extruder
_MOST_FILAMENT_PER_MM = 0.3  # of path: a line 0.7 mm² thick of filament of 1.75 mm, wider than slicers write
_RECORDS, _FIRST_BYTES = 1 << 16, 1 << 16
_HEATS = re.compile(rb"^\s*M10[49]\b", re.MULTILINE)
_OTHER_AXES = [(letter, np.uint32(1 << (ord(letter) - ord("A")))) for letter in "ABCUVW"]


def settle_extruder(text: np.ndarray, state: MachineState, *, says_a: bool) -> None:
    """Note in ``state`` where A drives the extruder, and which axis may drive it where the file does not say.

    ``text`` is a file's beginning, ``says_a`` whether its slicer wrote it for a firmware that extrudes with A. Without
    that A is the extruder where no move names E, the file heats a nozzle, and A goes forwards with the moves in X and Y
    as filament does.
    """
    for top in (text[:_FIRST_BYTES], text):  # nearly every file names E in its first lines
        rows = _moves(top, state)
        if (rows["words"] & k.WORD_E).any():
            return
    odd = [letter for letter, bit in _OTHER_AXES if (rows["words"] & bit).any()]
    if "A" in odd:
        trial = state.copy()
        trial.counts.e_is_a = 1
        if says_a or (_HEATS.search(text.tobytes()) and _is_filament(_moves(text, trial))):
            state.counts.e_is_a = 1
            odd.remove("A")
    state.odd_axis = odd[0] if odd else ""


def _moves(text: np.ndarray, state: MachineState) -> np.ndarray:
    """Return the records of a text's moves in X and Y."""
    trial, records = state.copy(), np.empty(_RECORDS, k.RECORD)
    count, _ = k.interpret(text, 0, len(text), trial.numbers, trial.counts, records, k.NO_NOTES)
    rows = records[:count]
    return rows[(rows["kind"] <= k.KIND_CCW) & (rows["words"] & (k.WORD_X | k.WORD_Y) > 0)]


def _is_filament(rows: np.ndarray) -> bool:
    """Say whether the amounts pushed by moving commands may be filament."""
    length_mm = np.hypot(rows["x1"] - rows["x0"], rows["y1"] - rows["y0"])
    pushing = (rows["words"] & k.WORD_E > 0) & (length_mm > 0)
    pushed_mm, length_mm = rows["advance"][pushing], length_mm[pushing]
    wrong = (pushed_mm <= 0) | (pushed_mm > _MOST_FILAMENT_PER_MM * length_mm)
    return len(pushed_mm) >= _ENOUGH_MOVES and float(wrong.mean()) <= _IMPLAUSIBLE_SHARE
