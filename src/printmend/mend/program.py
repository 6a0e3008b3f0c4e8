"""Take the programs of a file through the planner: their starting state, their observers, and their notes."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from printmend.clock import Stopwatch, limits_of, start_stopwatch
from printmend.errors import GcodeError
from printmend.gcode.container import GcodeFile, Part
from printmend.gcode.mark import find_test_print
from printmend.gcode.read import MachineState, e_warning, starting_state
from printmend.gcode.sliced import described
from printmend.gcode.write import follow
from printmend.mend.meant import small_bed_words
from printmend.messages import say
from printmend.model.model import SavedModel
from printmend.plan import Fineness, Planner
from printmend.printer import Printer

_DOTS_WORDS = say("only-lines-counted")
Progress = Callable[[int], None]


@dataclass(frozen=True, eq=False)
class Read:
    """How a program was read: the notes about that (``said``), and the clocks that followed it."""

    said: tuple[str | None, ...]
    watch: Stopwatch


def plan_file(
    file: GcodeFile, planner: Planner, model: SavedModel, fineness: Fineness, progress: Progress | None
) -> list[Read]:
    """Plan a file, and return how each of its programs was read."""
    read = []
    for part in file.parts:
        state, one = begun(part, planner, model, fineness)
        follow(counted(part.chunks(), progress), state, planner.plan, look=one.watch.watch)
        one.watch.finish()
        read.append(one)
    return read


def begun(part: Part, planner: Planner, model: SavedModel, fineness: Fineness) -> tuple[MachineState, Read]:
    """Let the planner begin a program; return the state before its first line, and a first `Read`."""
    state, hints, owner = _beginning(part, model), part.hints(), model.printer.limits
    limits = limits_of(state.flavour, hints, fineness.firmware, owner)
    if owner.accel_mm_s2 is not None:
        state.expect_accel(owner.accel_mm_s2, is_klipper=limits.firmware == "klipper")
    watch = start_stopwatch(limits)
    crossing_mm_s2 = fineness.crossing_mm_s2 or owner.crossing_mm_s2 or limits.most_mm_s2
    planner.begin(fineness.segments_per_s(state.flavour), crossing_mm_s2, fineness.ease)
    return state, Read(_said_of(hints, state, model.printer), watch)


def _beginning(part: Part, model: SavedModel) -> MachineState:
    """Return the state before a program's first line; raise `GcodeError` for a file that does not say which axis
    extrudes."""
    state = starting_state(part, printer=model.printer)
    if axis := state.odd_axis:
        wanted, came = say("moves-extrude"), say("none-moves-name", axis)
        if axis == "A":
            todo = say("write-gcode-flavor-mach3-top-extruder")
            raise GcodeError(part.name, wanted=wanted, came=came, todo=todo)
        raise GcodeError(part.name, wanted=wanted, came=came, todo=say("slice-firmware-extrudes"))
    return state


def _said_of(hints: tuple[bytes, ...], state: MachineState, printer: Printer) -> tuple[str | None, ...]:
    """Return notes: how a program was read, for which bed, and what the prediction leaves out."""
    is_probe = find_test_print(*hints) == "probe"
    return e_warning(state), small_bed_words(described(*hints), printer), _DOTS_WORDS if is_probe else None


def counted(chunks: Iterator[np.ndarray], progress: Progress | None) -> Iterator[np.ndarray]:
    """Yield the chunks of a text, and tell ``progress`` how many bytes each had."""
    for chunk in chunks:
        yield chunk
        if progress is not None:
            progress(len(chunk))
