"""Read G-code into moves: what the machine is told to do, line by line, in millimetres."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from printmend.errors import GcodeError
from printmend.gcode import kernels as k
from printmend.gcode.layers import layers_of
from printmend.gcode.machine import MachineState, detect_flavour, initial_state
from printmend.path import frozen
from printmend.printer import Printer

HEAD_BYTES = 1 << 20
_RECORDS_A_CALL = 1 << 16


@dataclass(frozen=True, eq=False)
class Moves:
    """Every motion of a file in its order, M of them, and what happened between them.

    ``line`` [M] counts from 0. ``kind`` [M] is KIND_LINEAR, KIND_CW or KIND_CCW of `kernels`. ``start_mm`` and
    ``end_mm`` [M, 3] are machine positions; ``known`` [M, 3] says which coordinates of both are certain (before homing
    they are counted from 0). ``center_mm`` [M, 2] is NaN for straight moves; in ``plane`` [M] 0 it is (x, y), in
    1 (z, x), in 2 (y, z). ``turns`` [M] counts further full circles. ``extrusion_mm`` [M] is filament, negative for
    retractions; ``feed_mm_s`` [M] is 0 before the first F word. ``extruding`` [M] is true where filament advances while
    the carriage moves. ``layer`` [M] counts from 0 (−1: before the first).

    Homing: ``home_index`` [H] is the move before which it happens (M for the end), ``home_axes`` [H, 3] the axes.
    Events that make the place or the engaged side of the belts uncertain (EVENT_*): ``event_index`` [V], ``event`` [V].
    """

    line: np.ndarray
    kind: np.ndarray
    start_mm: np.ndarray
    end_mm: np.ndarray
    known: np.ndarray
    center_mm: np.ndarray
    plane: np.ndarray
    turns: np.ndarray
    extrusion_mm: np.ndarray
    feed_mm_s: np.ndarray
    extruding: np.ndarray
    layer: np.ndarray
    home_index: np.ndarray
    home_axes: np.ndarray
    event_index: np.ndarray
    event: np.ndarray

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            object.__setattr__(self, name, frozen(getattr(self, name)))

    def __len__(self) -> int:
        return len(self.line)

    @property
    def arcs(self) -> np.ndarray:
        """A mask [M] of the arcs."""
        return self.kind != k.KIND_LINEAR


@dataclass(frozen=True, eq=False)
class Program:
    """A G-code file: its ``text`` (uint8, untouched) and its ``moves``."""

    name: str
    text: np.ndarray
    moves: Moves


def read_gcode(source: str | Path | bytes, *, printer: Printer | None = None) -> Program:
    """Read a G-code file, or its bytes; homing goes to ``printer``'s home, or to the origin.

    Raises `GcodeError` for what is not G-code or holds no motion.
    """
    if isinstance(source, bytes):
        name, text = "G-code", source
    else:
        name, text = str(source), _read_bytes(Path(source))
    buffer = frozen(np.frombuffer(text, np.uint8))
    state = initial_state(printer, detect_flavour(text[:HEAD_BYTES], text[-HEAD_BYTES:]))
    records = interpret_text(buffer, state)
    moves = moves_of(records)
    if not len(moves):
        raise GcodeError(name, wanted="G-code with motion", came="no G0–G3 move", todo="give a sliced file")
    return Program(name, buffer, moves)


def _read_bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise GcodeError(path, wanted="a G-code file", came=str(error.strerror), todo="check the path") from None


def interpret_text(text: np.ndarray, state: MachineState) -> np.ndarray:
    """Return the records of a whole text held in memory; ``state`` is advanced."""
    parts, position = [], 0
    capacity = _RECORDS_A_CALL
    while position < len(text):
        records = np.empty(capacity, k.RECORD)
        count, after = k.interpret(text, position, len(text), state.numbers, state.counts, records)
        if after == position:  # one line with more statements than fit
            capacity *= 4
        parts.append(records[:count].copy() if count < capacity // 2 else records[:count])
        position = after
    return np.concatenate(parts) if parts else np.empty(0, k.RECORD)


def moves_of(records: np.ndarray) -> Moves:
    """Turn records into moves; lines that only set F are left out, E moves are kept."""
    motion = np.isin(records["kind"], (k.KIND_LINEAR, k.KIND_CW, k.KIND_CCW))
    idle = (records["kind"] == k.KIND_LINEAR) & (records["words"] & _MOTION_WORDS == 0)
    keep = motion & ~idle
    rows = records[keep]
    before = np.concatenate([[0], np.cumsum(keep)])[:-1]
    homes, events = records["kind"] == k.KIND_HOME, records["kind"] == k.KIND_EVENT
    flags = rows["flags"]
    known = np.stack([(flags & k.FLAG_KNOWN_X0 << a != 0) & (flags & k.FLAG_KNOWN_X1 << a != 0) for a in range(3)], 1)
    moves = Moves(
        line=rows["line"],
        kind=rows["kind"],
        start_mm=np.stack([rows["x0"], rows["y0"], rows["z0"]], 1),
        end_mm=np.stack([rows["x1"], rows["y1"], rows["z1"]], 1),
        known=known,
        center_mm=np.stack([rows["c0"], rows["c1"]], 1),
        plane=rows["plane"],
        turns=rows["turns"],
        extrusion_mm=rows["advance"],
        feed_mm_s=rows["feed"] / 60.0,
        extruding=flags & k.FLAG_EXTRUDING != 0,
        layer=rows["layer"].astype(np.int64),
        home_index=before[homes],
        home_axes=(records["axes"][homes][:, None] >> np.arange(3)) & 1 != 0,
        event_index=before[events],
        event=records["event"][events],
    )
    return replace(moves, layer=layers_of(moves.layer, moves.start_mm[:, 2], moves.end_mm[:, 2], moves.extruding))


_MOTION_WORDS = 7 << 23 | 1 << 4  # X Y Z E
