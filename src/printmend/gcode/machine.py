"""The modal state of a machine that reads G-code, passed on from chunk to chunk, and its extruder's word.

That word is E, or A if a slicer writes for Mach3 or Machinekit.
"""

import enum
import re
from dataclasses import dataclass

import numpy as np

from printmend.gcode import kernels as k
from printmend.jit import record
from printmend.printer import Printer


class Flavour(enum.IntEnum):
    """The firmware families that read the same text differently.

    On Marlin 2 and Smoothie, G90/G91 also set E. On Klipper and Marlin 1, E is relative while either G91 or M83 is on.
    RepRapFirmware and Prusa's MK3 keep E apart. A bare G92 sets all axes to zero on Klipper, and does nothing on the
    others. An unknown firmware is read like Klipper.
    """

    UNKNOWN = k.FLAVOUR_UNKNOWN
    MARLIN2 = k.FLAVOUR_MARLIN2
    MARLIN1 = k.FLAVOUR_MARLIN1
    KLIPPER = k.FLAVOUR_KLIPPER
    RRF = k.FLAVOUR_RRF
    PRUSA = k.FLAVOUR_PRUSA

    @property
    def g90_influences_e(self) -> int:
        """How G90/G91 act on E: `kernels.E_EITHER`, `E_FOLLOWS` or `E_APART`."""
        return {Flavour.MARLIN2: k.E_FOLLOWS, Flavour.RRF: k.E_APART, Flavour.PRUSA: k.E_APART}.get(self, k.E_EITHER)


@dataclass(eq=False)
class MachineState:
    """``numbers`` and ``counts`` are records of NUMBERS and COUNTS of `kernels`.

    The kernel advances both in place: `copy` before a trial run, `expect_accel` before the first line. ``unsure_moves``
    counts the printing moves whose E firmwares read differently, if neither the file nor its numbers show its firmware.
    ``odd_axis`` is the letter of an axis that may be the extruder: it moves along in a file without E.
    """

    numbers: np.record
    counts: np.record
    unsure_moves: int = 0
    odd_axis: str = ""

    def copy(self) -> "MachineState":
        return MachineState(self.numbers.copy(), self.counts.copy(), self.unsure_moves, self.odd_axis)

    def expect_accel(self, accel_mm_s2: float, *, is_klipper: bool) -> None:
        """Assume this acceleration for printing moves until the file sets another."""
        self.numbers.accel = accel_mm_s2
        self.counts.tell = k.TELL_S if is_klipper else k.TELL_P

    @property
    def flavour(self) -> Flavour:
        return Flavour(int(self.counts.flavour))


def initial_state(printer: Printer | None = None, flavour: Flavour = Flavour.UNKNOWN) -> MachineState:
    """Return the state after power-on: at (0, 0, 0) but not certain of it, absolute, millimetres, no tool.

    Homing goes to ``printer``'s home position, or to the origin without a printer.
    """
    numbers, counts = record(k.NUMBERS), record(k.COUNTS)
    if printer is not None:
        numbers.home[:] = [axis.home_mm for axis in printer.axes]
    numbers.flow = 1.0
    counts.zero_known = counts.offset_known = 7
    counts.tool = -1
    counts.flavour = flavour
    counts.rule = flavour.g90_influences_e
    return MachineState(numbers, counts)


_CONFIG = re.compile(rb"gcode_flavor\"?[ \t]*[=:][ \t]*\"?([A-Za-z0-9_-]+)", re.IGNORECASE)  # a comment, or JSON
_CURA = re.compile(rb"^;FLAVOR:[ \t]*([A-Za-z0-9_ ()-]+)", re.MULTILINE)
_NAMES = {
    b"marlin2": Flavour.MARLIN2,
    b"smoothie": Flavour.MARLIN2,
    b"marlin": Flavour.MARLIN1,
    b"klipper": Flavour.KLIPPER,
    b"reprapfirmware": Flavour.RRF,
    b"rrf": Flavour.RRF,
}
_WITH_A = (b"mach3", b"machinekit")


def detect_flavour(*texts: bytes) -> Flavour:
    """Read the firmware from slicers' comments in pieces of a file (its head, its tail, its metadata).

    PrusaSlicer's `gcode_flavor = marlin` is its name for Marlin 1; Cura's `;FLAVOR:Marlin` is any Marlin, today
    nearly always 2.
    """
    name, is_cura = _named(texts)
    return Flavour.MARLIN2 if is_cura and name == b"marlin" else _NAMES.get(name, Flavour.UNKNOWN)


def says_a_extrudes(*texts: bytes) -> bool:
    """Return whether slicers' comments in pieces of a file name a firmware for which slicers write A instead of E."""
    return _named(texts)[0] in _WITH_A


def _named(texts: tuple[bytes, ...]) -> tuple[bytes, bool]:
    """Return the first firmware named in pieces of a file, in lower case, and whether Cura named it."""
    for text in texts:
        if b"gcode_flavor" in text.lower() and (found := _CONFIG.search(text)):
            return found[1].lower(), False
        if b";FLAVOR:" in text and (found := _CURA.search(text)):
            return found[1].strip().lower(), True
    return b"", False


_ENOUGH_MOVES = 20  # moves that name A; fewer do not decide what A is
_IMPLAUSIBLE_SHARE = 0.1  # A may be an extruder if at most this share of its moves is implausible
_MOST_FILAMENT_PER_MM = 0.3  # per mm of path: 1.75 mm filament then gives a line of 0.7 mm², wider than slicers write
_RECORDS, _FIRST_BYTES = 1 << 16, 1 << 16
_HEATS = re.compile(rb"^\s*M10[49]\b", re.MULTILINE)
_OTHER_AXES = [(letter, np.uint32(1 << (ord(letter) - ord("A")))) for letter in "ABCUVW"]


def settle_extruder(text: np.ndarray, state: MachineState, *, says_a: bool) -> None:
    """Record in ``state`` whether A drives the extruder, or which axis may drive it if the file does not say.

    ``text`` is a file's beginning. ``says_a`` means that its slicer wrote it for a firmware that extrudes with A.
    Otherwise A is the extruder if no move names E, the file heats a nozzle, and A advances like filament while X and Y
    move.
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
    """Return whether the axis' advances along moves are plausible for filament."""
    length_mm = np.hypot(rows["x1"] - rows["x0"], rows["y1"] - rows["y0"])
    pushing = (rows["words"] & k.WORD_E > 0) & (length_mm > 0)
    pushed_mm, length_mm = rows["advance"][pushing], length_mm[pushing]
    wrong = (pushed_mm <= 0) | (pushed_mm > _MOST_FILAMENT_PER_MM * length_mm)
    return len(pushed_mm) >= _ENOUGH_MOVES and float(wrong.mean()) <= _IMPLAUSIBLE_SHARE
