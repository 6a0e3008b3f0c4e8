"""Read G-code into moves: the commands, line by line, in millimetres; arcs become chords on request.

Layers follow the slicer's comments if there are any, otherwise the height.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from printmend.errors import GcodeError
from printmend.gcode import kernels as k
from printmend.gcode.container import HINT_BYTES, MAX_LINE_BYTES, Part, endless_line, open_gcode, refuse_binary
from printmend.gcode.machine import (
    Flavour,
    MachineState,
    detect_flavour,
    initial_state,
    says_a_extrudes,
    settle_extruder,
)
from printmend.gcode.sliced import find_e_rule
from printmend.messages import say
from printmend.path import frozen
from printmend.printer import Printer

RECORDS = 1 << 16
"""Records for each call of the interpreter: 10 MB."""


@dataclass(frozen=True, eq=False)
class Moves:
    """All M motions of a file in order, and the events between them.

    ``line`` [M] counts from 0. ``kind`` [M] is KIND_LINEAR, KIND_CW or KIND_CCW of `kernels`. ``start_mm`` and
    ``end_mm`` [M, 3] are machine positions; ``known`` [M, 3] says which coordinates of both are certain (before homing
    they count from 0). ``center_mm`` [M, 2] is NaN for straight moves; its axes are (x, y) for ``plane`` [M] 0, (z, x)
    for 1, and (y, z) for 2. ``turns`` [M] counts further full circles. ``extrusion_mm`` [M] is filament, negative for
    retractions; ``feed_mm_s`` [M] is 0 before the first F word. ``extruding`` [M] is true if filament advances while
    the carriage moves. ``layer`` [M] counts from 0 (−1: before the first).

    Homing: ``home_index`` [H] is the move before which it happens (M for the end), ``home_axes`` [H, 3] the axes.
    Events (EVENT_*) make the place or the engaged side of the belts uncertain: ``event_index`` [V], ``event`` [V].
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
    """Read a G-code file in any container, or plain text; homing goes to ``printer``'s home, or to the origin.

    In a project with several plates, read the first. Raises `GcodeError` for a source without G-code or motion.
    """
    if isinstance(source, bytes):
        refuse_binary(source[:HINT_BYTES], "G-code")
        return _program(
            "G-code", frozen(np.frombuffer(source, np.uint8)), (source[:HINT_BYTES], source[-HINT_BYTES:]), printer
        )
    with open_gcode(source) as file:
        return read_part(file.parts[0], printer=printer)


def read_part(part: Part, *, printer: Printer | None = None) -> Program:
    """Read one program of an open file."""
    return _program(part.name, frozen(np.concatenate([*part.chunks(), np.empty(0, np.uint8)])), part.hints(), printer)


def starting_state(part: Part, *, printer: Printer | None = None) -> MachineState:
    """Return the state before a program's first line, with its firmware's rules as far as the file shows them."""
    first = next(part.chunks(), np.empty(0, np.uint8))
    return _state_of(first[:HINT_BYTES], part.hints(), printer)


def _state_of(top: np.ndarray, hints: tuple[bytes, ...], printer: Printer | None) -> MachineState:
    """Return the state before the first line of a text that begins with ``top``."""
    state = initial_state(printer, detect_flavour(*hints))
    if len(top):
        settle_extruder(top, state, says_a=says_a_extrudes(*hints))
        settle_e(top, state)
    return state


def _program(name: str, text: np.ndarray, hints: tuple[bytes, ...], printer: Printer | None) -> Program:
    state = _state_of(text[:HINT_BYTES], hints, printer)
    moves = moves_of(interpret_text(text, state, name))
    if not len(moves):
        raise GcodeError(name, wanted=say("g-code-motion"), came=say("no-g0-g3-move"), todo=say("give-sliced-file"))
    return Program(name, text, moves)


def interpret_text(text: np.ndarray, state: MachineState, name: str = "G-code") -> np.ndarray:
    """Return the records of a whole text held in memory; ``state`` is advanced."""
    parts, position = [], 0
    capacity = RECORDS
    while position < len(text):
        records = np.empty(capacity, k.RECORD)
        count, after = k.interpret(text, position, len(text), state.numbers, state.counts, records, k.NO_NOTES)
        if after == position:  # one line may hold more statements than fit
            capacity = larger(capacity, name)
        parts.append(records[:count].copy() if count < capacity // 2 else records[:count])
        position = after
    return np.concatenate(parts) if parts else np.empty(0, k.RECORD)


def larger(capacity: int, name: str = "G-code") -> int:
    """Return a larger size for a record array that a line did not fit into; refuse lines beyond `MAX_LINE_BYTES`."""
    if capacity > MAX_LINE_BYTES // 2:
        raise endless_line(name)
    return 2 * capacity


# A reading of E is implausible if moves would pull filament back while the head moves, or melt more than a nozzle can,
# or if most moves with an E push nothing. Good files have some such moves, because they name E on travels, too. The
# shares are our choices.
_ENOUGH_MOVES = 20  # fewest moves for which a share means anything
_IMPLAUSIBLE_SHARE = 0.1  # a reading of E is believed if at most this share of its moves is implausible
_IDLE_SHARE = 0.5  # a reading of E is implausible, too, if a larger share of its moves pushes nothing
_TOP_SHARE = 0.1  # share of a text that is its top: a mode set there holds for the whole print
_FILAMENT_PER_MM = 3.0  # filament per mm of path: no nozzle melts more
_SAME_MM = 1e-6  # filament: two rules agree on a move if their readings differ by less


def settle_e(text: np.ndarray, state: MachineState) -> None:
    """Correct ``state`` if the text's E words make sense only with another rule for relative extrusion.

    Some files leave M82 or M83 to a macro, and firmwares differ on what G90 does after M83. Two rules are compared by
    the printing moves that they read differently. The state's own rule is doubted if a tenth of these moves would pull
    filament back or melt more than a nozzle can, or if most of them name an E that pushes nothing. Then the rule that
    explains the text best is taken.
    """
    if (said := find_e_rule(text.tobytes())) is not None:
        state.counts.rule, state.counts.m83 = said
        return
    default = int(state.counts.rule), int(state.counts.m83)
    begins, own, length_mm = _pushed(text, state, *default)
    everywhere = np.ones(len(own), bool)
    alike = b"G91" not in text.tobytes() and _implausible_share(own, length_mm, everywhere) <= _IMPLAUSIBLE_SHARE
    if alike or _says_e_first(text.tobytes()):
        return
    better: list[tuple[float, int, int, int]] = []
    unsure = 0
    for m83 in (default[1], 1 - default[1]):
        for rule in (k.E_EITHER, k.E_FOLLOWS, k.E_APART):
            others, theirs, _ = _pushed(text, state, rule, m83)
            _, mine, its = np.intersect1d(begins, others, assume_unique=True, return_indices=True)
            pushed = own.copy()  # what one rule leaves unknown shows no difference
            pushed[mine] = theirs[its]
            apart = np.abs(pushed - own) > _SAME_MM
            share, other = _implausible_share(own, length_mm, apart), _implausible_share(pushed, length_mm, apart)
            if m83 == default[1] and other <= max(_IMPLAUSIBLE_SHARE, 4 * share):
                unsure = max(unsure, int(apart.sum()))
            if share > _IMPLAUSIBLE_SHARE and other < share / 4:
                better.append((_implausible_share(pushed, length_mm, everywhere), len(better), rule, m83))
    if better:
        state.counts.rule, state.counts.m83 = min(better)[2:]
    elif state.flavour == Flavour.UNKNOWN and unsure >= _ENOUGH_MOVES:
        state.unsure_moves = unsure


def _says_e_first(text: bytes) -> bool:
    """Return whether all rules agree on nearly all of a text: at its top stand any G91, then G90, then M82 or M83."""
    told, absolute = max(_last_statement(text, b"M82"), _last_statement(text, b"M83")), _last_statement(text, b"G90")
    return text.rfind(b"G91") <= absolute < told < _TOP_SHARE * len(text)


def _last_statement(text: bytes, word: bytes) -> int:
    """Return the offset of a statement's last occurrence outside comments, −1 if there is none."""
    at = text.rfind(word)
    while at >= 0 and (comment := text.find(b";", text.rfind(b"\n", 0, at) + 1, at)) >= 0:
        at = text.rfind(word, 0, comment)
    return at


def guessed_e_rule(part: Part, state: MachineState) -> tuple[int, int] | None:
    """Return how `settle_e` reads E, (rule, m83); None if the program says M82 or M83 and never G91."""
    head = next(part.chunks(), np.empty(0, np.uint8))[:HINT_BYTES].tobytes()
    if b"G91" not in head and (b"M82" in head or b"M83" in head):
        return None
    return int(state.counts.rule), int(state.counts.m83)


_RULES = {  # the message of each
    k.E_EITHER: "e-rule-either",
    k.E_FOLLOWS: "e-rule-follows",
    k.E_APART: "e-rule-apart",
}


def e_warning(state: MachineState) -> str | None:
    """Return a warning about how `settle_e` reads E; None if firmwares agree on this file.

    ``state`` is the state before the first line (`starting_state`).
    """
    if state.counts.m83:
        return say("file-prints-before-says-m82-m83")
    rule = int(state.counts.rule)
    if rule != state.flavour.g90_influences_e:
        return say("numbers-file-fit-only-printer-another", say(_RULES[rule]))
    if state.unsure_moves:
        return say("firmwares-read-e-differently", state.unsure_moves, say(_RULES[rule]))
    return None


def _pushed(text: np.ndarray, state: MachineState, rule: int, m83: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return where each move with an E that is known under a rule begins, the filament that it pushes, and its length
    [mm]. The chords of a curve count as one move."""
    trial = state.copy()
    trial.counts.rule, trial.counts.m83 = rule, m83
    records = np.empty(RECORDS, k.RECORD)
    count, _ = k.interpret(text, 0, len(text), trial.numbers, trial.counts, records, k.NO_NOTES)
    rows = records[:count]
    rows = rows[(rows["kind"] <= k.KIND_CCW) & (rows["words"] & k.WORD_E > 0) & (rows["words"] & k.WORDS_XYZ > 0)]
    length_mm = np.hypot(rows["x1"] - rows["x0"], rows["y1"] - rows["y0"]) + np.abs(rows["z1"] - rows["z0"])
    goes = length_mm > 0
    begins, move = np.unique(rows["begin"][goes], return_inverse=True)
    return begins, np.bincount(move, rows["advance"][goes]), np.bincount(move, length_mm[goes])


def _implausible_share(pushed_mm: np.ndarray, length_mm: np.ndarray, among: np.ndarray) -> float:
    """Return the share of implausible moves among those of the mask ``among``; 0 if these are too few."""
    pushed_mm, length_mm = pushed_mm[among], length_mm[among]
    if len(pushed_mm) < _ENOUGH_MOVES:
        return 0.0
    wrong = float(np.mean((pushed_mm < 0) | (pushed_mm > _FILAMENT_PER_MM * length_mm)))
    none = float(np.mean(pushed_mm == 0))
    return wrong + none if none > _IDLE_SHARE else wrong


def moves_of(records: np.ndarray) -> Moves:
    """Turn records into moves; lines that only set F are left out, E moves are kept."""
    motion = np.isin(records["kind"], (k.KIND_LINEAR, k.KIND_CW, k.KIND_CCW))
    idle = (records["kind"] == k.KIND_LINEAR) & (records["words"] & (k.WORDS_XYZ | k.WORD_E) == 0)
    keep = motion & ~idle
    rows = records[keep]
    before = np.concatenate([[0], np.cumsum(keep)])[:-1]
    homes, events = records["kind"] == k.KIND_HOME, records["kind"] == k.KIND_EVENT
    events &= records["event"] != k.EVENT_SAVE
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


_SAME_Z_MM = 1e-3  # smaller steps in height begin no layer
_SLOPED_LAYER_MM = 0.05  # on a rising path (vase mode) a new layer begins this far above the last one's start


def layers_of(marks: np.ndarray, z0_mm: np.ndarray, z1_mm: np.ndarray, extruding: np.ndarray) -> np.ndarray:
    """Return the layer [M] of each move, −1 before the first extruding layer.

    ``marks`` [M] counts the layer comments before each move. A comment without an extruding move after it (in a header,
    or a double comment) opens no layer. Without comments, a layer is a run of extruding moves at one height. Z-hops do
    not end it, because they extrude nothing. The travel between two layers belongs to the later one.
    """
    if len(marks) == 0:
        return np.empty(0, np.int64)
    used = np.unique(marks[extruding & (marks > 0)])
    if len(used):
        # A comment that opens no layer belongs to the layer before it.
        return np.searchsorted(used, marks, side="right").astype(np.int64) - 1
    printing = np.flatnonzero(extruding)
    layer = np.full(len(marks), -1, np.int64)
    if len(printing) == 0:
        return layer
    number = _by_height(z0_mm[printing], z1_mm[printing])
    # A travel belongs to the layer of the next extruding move; travels after the last one belong to the last layer.
    following = np.searchsorted(printing, np.arange(len(marks)))
    layer[:] = number[np.minimum(following, len(printing) - 1)]
    return layer


def _by_height(z0_mm: np.ndarray, z1_mm: np.ndarray) -> np.ndarray:
    """Number the layers of extruding moves [N] from 0."""
    flat = np.abs(z1_mm - z0_mm) <= _SAME_Z_MM
    if flat.all():
        changed = np.abs(np.diff(z1_mm)) > _SAME_Z_MM
        return np.concatenate([[0], np.cumsum(changed)])
    number = np.empty(len(z1_mm), np.int64)
    current, base = 0, z1_mm[0]
    for i in range(len(z1_mm)):
        threshold = _SAME_Z_MM if flat[i] else _SLOPED_LAYER_MM
        if i and abs(z1_mm[i] - base) > threshold:
            current, base = current + 1, z1_mm[i]
        number[i] = current
    return number


# Replace arcs with chords.

_MAX_CHORDS = 20_000_000  # a file of a few lines can ask for endless turns


def straightened(moves: Moves, tolerance_mm: float) -> Moves:
    """Return the moves with every arc replaced by chords that stay within ``tolerance_mm`` of it.

    Extrusion is split in proportion to the length; a helix rises linearly. Moves without arcs are returned unchanged.
    Raises `GcodeError` for more than 20 million chords.
    """
    arcs = np.flatnonzero(moves.arcs)
    if len(arcs) == 0:
        return moves
    counts = np.ones(len(moves), np.int64)
    points: list[np.ndarray] = []
    room = _MAX_CHORDS
    for i in arcs:
        chord_points = arc_points(
            moves.start_mm[i], moves.end_mm[i], moves.center_mm[i], int(moves.plane[i]),
            bool(moves.kind[i] == k.KIND_CW), int(moves.turns[i]), tolerance_mm,
        )  # fmt: skip
        points.append(chord_points)
        counts[i] = len(chord_points)
        room -= len(chord_points)
        if room < 0:
            raise GcodeError(
                say("subject-arcs"), wanted=say("most-chords", _MAX_CHORDS), came=say("arcs-need-more"),
                todo=say("check-file-s-radii-turns"),
            )  # fmt: skip
    source = np.repeat(np.arange(len(moves)), counts)
    first = np.concatenate([[0], np.cumsum(counts)])
    end_mm, start_mm = moves.end_mm[source], moves.start_mm[source]
    for i, chord_points in zip(arcs, points, strict=True):
        end_mm[first[i] : first[i + 1]] = chord_points
        start_mm[first[i] + 1 : first[i + 1]] = chord_points[:-1]
    return replace(
        moves,
        line=moves.line[source],
        kind=np.full(len(source), k.KIND_LINEAR, moves.kind.dtype),
        start_mm=start_mm,
        end_mm=end_mm,
        known=moves.known[source],
        center_mm=np.full((len(source), 2), np.nan),
        plane=moves.plane[source],
        turns=np.zeros(len(source), moves.turns.dtype),
        extrusion_mm=moves.extrusion_mm[source] / counts[source],
        feed_mm_s=moves.feed_mm_s[source],
        extruding=moves.extruding[source],
        layer=moves.layer[source],
        home_index=first[moves.home_index],
        event_index=first[moves.event_index],
    )


def arc_points(
    start_mm: np.ndarray, end_mm: np.ndarray, center_mm: np.ndarray, plane: int, clockwise: bool, turns: int,
    tolerance_mm: float,
) -> np.ndarray:  # fmt: skip
    """Return the ends [n, 3] of the chords of one arc, the last of them exactly ``end_mm``."""
    size = k.arc_chords(*start_mm, *end_mm, *center_mm, plane, clockwise, turns, tolerance_mm, np.empty((0, 3)))
    points = np.empty((size, 3))
    k.arc_chords(*start_mm, *end_mm, *center_mm, plane, clockwise, turns, tolerance_mm, points)
    return points
