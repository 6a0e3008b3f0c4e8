"""Mend a G-code file, or only predict the result; check that the file is for this printer, and limit the added time."""

import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO

import numpy as np

from printmend.clock import Duration, Stopwatch, limits_of, start_stopwatch, told_as_a_whole, with_times
from printmend.effects import EFFECTS
from printmend.errors import GcodeError, ModelError, RefusedError
from printmend.files import replacing
from printmend.gcode import kernels as k
from printmend.gcode.container import GcodeFile, Part, Text, open_gcode
from printmend.gcode.read import MachineState, e_warning, guessed_e_rule, starting_state
from printmend.gcode.sliced import Corners, Described, described, find_mark, find_test_print, lost_mark, marked, sliced
from printmend.gcode.write import Plan, TimePlace, follow, rewrite
from printmend.mend.prediction import Prediction, answer_to, prediction_of, with_doubt
from printmend.messages import say, say_count, together, within
from printmend.model.model import PHASE_TODO, REFITTED, SavedModel, refusals, said_of
from printmend.plan import Fineness, Planner, is_identity, start
from printmend.printer import Printer
from printmend.printer.printer import printers_named
from printmend.printer.toml import printers_like
from printmend.promise.words import in_words
from printmend.provenance import sealed

# Take the programs of a file through the planner: their starting state, their observers, and their notes.

_DOTS_WORDS = say("only-lines-counted")
Progress = Callable[[int], None]


@dataclass(frozen=True, eq=False)
class Read:
    """How a program was read: the notes about that (``said``), and the clocks that followed it."""

    part: Part
    said: tuple[str | None, ...]
    watch: Stopwatch

    @property
    def changed(self) -> str | None:
        """A note on a plate that is not what its checksum says, once it was read."""
        return None if self.part.is_as_summed else say("plate-changed", self.part.name)


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
    asked_mm_s2 = fineness.crossing_mm_s2 or owner.crossing_mm_s2 or limits.most_mm_s2
    most_mm_s2 = limits.most_mm_s2 or asked_mm_s2
    planner.begin(fineness.segments_per_s(state.flavour), min(asked_mm_s2, most_mm_s2), fineness.ease)
    held = None if asked_mm_s2 <= most_mm_s2 else say("crossings-speed-up-by-most", f"{most_mm_s2:.0f}")
    return state, Read(part, (*_said_of(hints, state, model.printer), held), watch)


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
    is_probe, said = find_test_print(*hints) == "probe", described(*hints)
    return e_warning(state), other_printer_words(said, printer), _DOTS_WORDS if is_probe else None


def counted(chunks: Iterator[np.ndarray], progress: Progress | None) -> Iterator[np.ndarray]:
    """Yield the chunks of a text, and tell ``progress`` how many bytes each had."""
    for chunk in chunks:
        yield chunk
        if progress is not None:
            progress(len(chunk))


# Keep the added time within a limit: draw the least important lines more coarsely until it holds.

_TRIALS = 6  # trials between an ease that is too slow and one that is not
_NEAR_SHARE = 0.1  # stop trying within this share of the limit
_NAMES = {  # messages
    k.ROLE_ASIDE: "role-aside", k.ROLE_INFILL: "role-infill", k.ROLE_SOLID: "role-solid",
    k.ROLE_INNER: "role-inner", k.ROLE_UNKNOWN: "role-unknown", k.ROLE_OUTER: "role-outer",
}  # fmt: skip


def eased(file: GcodeFile, model: SavedModel, fineness: Fineness, *, force: bool) -> tuple[Fineness, str | None]:
    """Return the finest fineness that keeps a file's printing time within the limit, and words about it.

    Plans the file once if it is fast enough anyway, otherwise up to two times more than `_TRIALS`. Raises
    `RefusedError` if it is too slow even with the coarsest lines, unless ``force``.
    """
    assert fineness.slower is not None
    limit = fineness.slower
    if _planned(file, model, fineness)[0] <= limit:
        return fineness, None
    low, high = 0.0, fineness.most_ease
    coarsest = replace(fineness, ease=high)
    least, found = _planned(file, model, coarsest)
    if least > limit:
        if not force:
            raise RefusedError(
                file.name, wanted=say("at-most-more-time", f"{100 * limit:g}"),
                came=say("share-with-coarsest", f"{100 * least:.1f}"), todo=say("allow-more-or-force"),
            )  # fmt: skip
        return coarsest, say("takes-longer-though", f"{100 * least:.1f}", coarser(found))
    for _ in range(_TRIALS):
        ease = float(np.sqrt((1.0 + low) * (1.0 + high))) - 1.0
        share, planner = _planned(file, model, replace(fineness, ease=ease))
        if share > limit:
            low = ease
            continue
        high, found = ease, planner
        if share > (1.0 - _NEAR_SHARE) * limit:
            break
    return replace(fineness, ease=high), say("to-take-no-longer", coarser(found))


def few_moves_words(planner: Planner) -> str | None:
    """Say how far a file's lines may be off if the machine bends so sharply that walls would need many moves."""
    head = planner.model.head
    return say("to-have-few-moves", coarser(planner)) if head.chords[k.ROLE_OUTER] > head.chords[-1] else None


def _planned(file: GcodeFile, model: SavedModel, fineness: Fineness) -> tuple[float, Planner]:
    """Plan a file at a fineness; return the share of added time, and the planner."""
    planner = start(model.mechanism, tolerance_mm=fineness.tolerance_mm)
    before_s = after_s = 0.0
    for part in file.parts:
        state, one = begun(part, planner, model, fineness)
        follow(part.chunks(), state, planner.plan, look=one.watch.watch)
        one.watch.finish()
        before_s, after_s = before_s + one.watch.before.seconds, after_s + one.watch.after.seconds
    return after_s / before_s - 1.0 if before_s > 0.0 else 0.0, planner


def coarser(planner: Planner) -> str:
    """Say how far the lines of a file may be off."""
    mm, roles = planner.tolerances_mm, int(planner.counts.roles)
    drawn = [(say(name), f"{mm[role]:.3f}") for role, name in _NAMES.items() if roles >> role & 1]
    return say("lines-less-closely", together(", ", [say("role-within", *each) for each in drawn]))


# Check whether a file is for this printer, by its slicer's comments and by where it prints.

_OUTSIDE_MM = 15.0  # how far beyond the bed a file may print: purge lines and wipes lie a few millimetres beyond some
_BED_OFF_MM = 30.0  # how far a slicer's bed and the preset's may differ if the file names this printer …
_STRANGER_BED_OFF_MM = 15.0  # … and if it does not


def refuse_other_printer(name: str, printer: Printer, prediction: Prediction) -> None:
    """Raise `ModelError` if a file prints far beyond the printer's bed."""
    if prediction.extruding:
        refuse_beyond_bed(name, printer, prediction.low_mm, prediction.high_mm, say("use-model-printer-file"))


def refuse_beyond_bed(
    name: str, printer: Printer, low_mm: Sequence[float], high_mm: Sequence[float], todo: str
) -> None:
    """Raise `ModelError` if what is printed from ``low_mm`` to ``high_mm`` [2] goes far beyond the printer's bed."""
    for axis, low, high in zip((printer.x, printer.y), low_mm, high_mm, strict=True):
        if low < axis.min_mm - _OUTSIDE_MM or high > axis.max_mm + _OUTSIDE_MM:
            wanted = say("g-code-from-mm", printer.name, axis.name.upper(), f"{axis.min_mm:g}", f"{axis.max_mm:g}")
            came = say("extrusion-from-mm", f"{low:.1f}", f"{high:.1f}")
            raise ModelError(name, wanted=wanted, came=came, todo=todo)


def refuse_contradiction(name: str, said: Described, printer: Printer) -> None:
    """Raise `ModelError` if a file says that it is for a printer other than the model's."""
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


def other_printer_words(said: Described, printer: Printer) -> str | None:
    """Return a note about a file that seems to be for another printer, or for another bed on which it fits."""
    try:
        refuse_contradiction("", said, printer)
    except ModelError as error:
        return say("seems-for-other-printer", error.wanted, error.came)
    if words := small_bed_words(said, printer):
        return words
    other = _other_printer(said, printer, is_called=True)
    return say("file-names-printer", other, printer.name) if other else None


def _other_printer(said: Described, printer: Printer, *, is_called: bool = False) -> str | None:
    """Return the printer that a file names, if it is surely not the model's. Empty: the name is unknown. None: the file
    names the model's printer, or none. A printer that ``is_called`` by its owner is known by its numbers."""
    if not said.names:
        return None
    mine, theirs = printers_named(printer.name), [printers_named(each) for each in said.names]
    mine = printers_like(printer) if is_called and not mine else mine
    if not (mine and theirs) or any(mine & each for each in theirs):
        return None
    return next((each for each, printers in zip(said.names, theirs, strict=True) if printers), "")


def _bed_mm(printer: Printer) -> Corners:
    """Return the corners of a printer's bed."""
    return (printer.x.min_mm, printer.y.min_mm), (printer.x.max_mm, printer.y.max_mm)


def _beyond_bed_mm(prediction: Prediction, printer: Printer) -> float:
    """Return how far the file itself prints beyond the edge of the bed."""
    low, high = np.array(_bed_mm(printer))
    over = np.concatenate([low - prediction.printed_low_mm, prediction.printed_high_mm - high])
    return max(float(over.max()), 0.0)


def _bed_words(bed_mm: Corners) -> str:
    """Return from where to where a bed goes."""
    return say("from-corner-to-corner", *(f"{x:g}, {y:g}" for x, y in bed_mm))


def _has_other_bed(said: Described, printer: Printer) -> bool:
    """Return whether a file is for a bed that cannot be the printer's."""
    if said.bed_mm is None:
        return False
    off_mm = float(np.abs(np.subtract(_bed_mm(printer), said.bed_mm)).max())
    # check the names last: loading the known printers takes 50 ms
    return off_mm > _BED_OFF_MM or (off_mm > _STRANGER_BED_OFF_MM and _other_printer(said, printer) is not None)


def _is_within(said: Described, printer: Printer) -> bool:
    """Return whether a file's bed fits on the printer's bed, as a slicer's default bed mostly does."""
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


_MOST_HELD_SHARE = 0.005  # largest share of the path that may be held back at the edge of the bed
AS_USUAL = Fineness()
Watch = Callable[[Part, Plan], Plan]  # receives each program's plan, and may observe it at work


@dataclass(frozen=True, eq=False)
class Mended:
    """The result of mending: ``output`` is the mended file's path, None for the standard output."""

    output: Path | None
    prediction: Prediction


def mend_gcode(
    source: Path | str,
    model: SavedModel,
    output: Path | str | None,
    *,
    force: bool = False,
    fineness: Fineness = AS_USUAL,
    progress: Progress | None = None,
    watch: Watch | None = None,
) -> Mended:
    """Write ``source`` (`-` for the standard input) as the printer of ``model`` must read it to print it right.

    ``output`` may be the source itself; None is the standard output. Nothing is written unless all went well. A file
    that would gain nothing is returned byte for byte. Each plate of a project is a print of its own. ``fineness`` says
    how far the path may be off, and which firmware reads it. ``watch`` gets the plan of each program.

    Raises `GcodeError` for a file that cannot be read or was mended before, `ModelError` for another printer's file,
    and, unless ``force``, `RefusedError` if mending is not sure to help or would add too much time.
    """
    output = None if output is None else Path(output)
    with open_gcode(source) as file:
        refuse_mended(file)
        refuse_grown(file, model.filament)
        planner = start(model.mechanism, tolerance_mm=fineness.tolerance_mm)
        if is_healthy(model):
            if not force:
                _refuse_misfit(file, model)
            read = plan_file(file, planner, model, fineness, progress)
            with _destination(output) as handle:
                _copy(file, handle)
            return Mended(output, _predicted(planner, model, read))
        slower = None
        if fineness.slower is not None:
            fineness, slower = eased(file, model, fineness, force=force)
        with _destination(output) as handle:
            read = []
            folder = None if output is None else output.parent
            # Only a plain text can end with a seal: a container compresses each program by itself.
            key = model.seal_key if file.container == "plain" else None

            def texts(part: Part) -> Iterator[Text]:
                text = _mended_text(part, planner, model, fineness, progress, read, watch, folder)
                return text if key is None else sealed(text, key)

            def told(part: Part, line: bytes) -> bytes:
                return told_as_a_whole(line, read[file.parts.index(part)].watch)

            file.write(handle, texts, told, folder)
            prediction = _predicted(planner, model, read, marks=1)
            said = (slower or few_moves_words(planner), _crossing_words(planner, fineness))
            prediction = replace(prediction, warnings=(*prediction.warnings, *filter(None, said)))
            _check_worth_writing(file, model, prediction, force=force)
            if not (force or prediction.is_better or _is_probe(file)):
                prediction = prediction.left_as_it_is()
                handle.seek(0)
                handle.truncate()
                _copy(file, handle)
        return Mended(output, prediction)


def check_gcode(source: Path | str, model: SavedModel, *, progress: Progress | None = None) -> Prediction:
    """Predict the result of mending, and write nothing. Raises like `mend_gcode`, except if mending would not help."""
    with open_gcode(source) as file:
        refuse_mended(file)
        refuse_grown(file, model.filament)
        if said := said_of(model.document, REFITTED):  # the errors' places are unknown now
            raise RefusedError(file.name, wanted=say("model-measured-after-work"), came=said[0], todo=PHASE_TODO)
        planner = start(model.mechanism)
        read = plan_file(file, planner, model, AS_USUAL, progress)
        prediction = _predicted(planner, model, read)
        if (fewer := few_moves_words(planner)) is not None:
            prediction = replace(prediction, warnings=(*prediction.warnings, fewer))
        _refuse_motionless(file, prediction)
        refuse_other_printer(file.name, model.printer, prediction)
        return prediction


def is_healthy(model: SavedModel) -> bool:
    """Return whether there is nothing to mend."""
    return model.is_healthy or is_identity(model.mechanism)


def refuse_mended(file: GcodeFile) -> None:
    """Raise `GcodeError` for a mended file: its moves are no longer the wanted ones."""
    for part in file.parts:
        digest = find_mark(*part.hints())
        if digest is not None or lost_mark(*part.hints()):
            raise GcodeError(
                part.name, wanted=say("file-slicer-wrote"),
                came=say("mended-mark-gone") if digest is None else say("mended-model", digest),
                todo=say("give-original-check-mended-against"),
            )  # fmt: skip


def refuse_grown(file: GcodeFile, filament: str | None) -> None:
    """Raise `GcodeError` for a file that its slicer already enlarged against shrinkage, if mending would do it
    again."""
    for part in file.parts if filament is not None else ():
        if share := sliced(*part.hints()).shrinkage:
            raise GcodeError(
                part.name, wanted=say("part-slicer-did-enlarge-against-shrinkage"),
                came=say("enlarged-against", f"{100 * share:.2f}"),
                todo=say("leave-filament-out-set-slicer-shrinkage"),
            )  # fmt: skip


def _predicted(planner: Planner, model: SavedModel, read: list[Read], *, marks: int = 0) -> Prediction:
    """Return the prediction for a planned file, whose programs were ``read``.

    ``marks`` is how many lines mending inserted above the file's own.
    """
    prediction = with_doubt(prediction_of(planner), model)
    if is_healthy(model):
        prediction = prediction.left_as_it_is()
    lines, doubted = tuple(line - marks for line in prediction.unknown_lines), max(prediction.doubted_line - marks, 0)
    told = dict.fromkeys(words for one in read for words in (*one.said, one.changed) if words)
    warnings = (*prediction.warnings, *told)
    duration: Duration | None = None
    for one in read:
        duration = one.watch.duration if duration is None else duration + one.watch.duration
    return replace(prediction, unknown_lines=lines, doubted_line=doubted, warnings=warnings, duration=duration)


def _mended_text(
    part: Part, planner: Planner, model: SavedModel, fineness: Fineness, progress: Progress | None,
    read: list[Read], watch: Watch | None, folder: Path | None,
) -> Iterator[bytes | memoryview]:  # fmt: skip
    """Return a program's mended text, and append to ``read`` how the program was read.

    A text that states printing times waits in ``folder`` until they are known.
    """
    state, one = begun(part, planner, model, fineness)
    read.append(one)
    chunks = marked(counted(part.chunks(), progress), model.digest, guessed_e_rule(part, state))
    places: list[TimePlace] = []
    plan = planner.plan if watch is None else watch(part, planner.plan)
    texts = rewrite(chunks, state, plan, look=one.watch.watch, times=places)
    return with_times(texts, places, one.watch, folder)


def _crossing_words(planner: Planner, fineness: Fineness) -> str | None:
    """Say that the slack is crossed no faster, because the normal acceleration is unknown or no smaller."""
    asked_mm_s2, counts, head = fineness.crossing_mm_s2, planner.counts, planner.model.head
    if asked_mm_s2 is None or head.crossing < asked_mm_s2 or counts.hurried or not counts.takeups:
        return None
    return say("crossings-no-faster", f"{head.accel:.0f}") if head.accel >= asked_mm_s2 else say("no-crossing-sped-up")


def _copy(file: GcodeFile, handle: IO[bytes]) -> None:
    """Write a file byte for byte."""
    with file.path.open("rb") as whole:
        shutil.copyfileobj(whole, handle, 1 << 20)


@contextmanager
def _destination(output: Path | None) -> Iterator[IO[bytes]]:
    """Open a temporary file that replaces the output once all is well, or goes to the standard output."""
    if output is not None:
        with replacing(output, "wb") as handle:
            yield handle
        return
    with tempfile.TemporaryFile() as spool:
        yield spool
        spool.seek(0)
        shutil.copyfileobj(spool, sys.stdout.buffer, 1 << 20)
        sys.stdout.buffer.flush()


def _check_worth_writing(file: GcodeFile, model: SavedModel, prediction: Prediction, *, force: bool) -> None:
    """Raise `RefusedError` or `ModelError` if the file should not be written."""
    _refuse_motionless(file, prediction)
    refuse_other_printer(file.name, model.printer, prediction)
    if force:
        return
    for part in file.parts:
        refuse_contradiction(part.name, described(*part.hints()), model.printer)
    _refuse_misfit(file, model)
    todo = say("print-original-use-force")
    if prediction.extruding + prediction.unknown == 0:
        raise RefusedError(
            file.name, wanted=say("prints-nothing"), came=say("moves-extrude-nothing", prediction.moves),
            todo=say("put-m83-top-each-meant-add"),
        )  # fmt: skip
    if prediction.mended_mm == 0:
        raise RefusedError(
            file.name, wanted=say("extruding-moves-known-place"), came=prediction.left_words,
            todo=say("home-g28-before-printing"),
        )  # fmt: skip
    if prediction.held_mm > _MOST_HELD_SHARE * prediction.length_mm:
        raise RefusedError(
            file.name,
            wanted=say("print-printer-can-reach"),
            came=say_count(
                "extruding-commands-mm-beyond-edge-bed",
                prediction.clamped_extruding,
                f"{prediction.beyond_mm + _beyond_bed_mm(prediction, model.printer):.2f}",
            ),
            todo=say("move-object-much-away-give-scale"),
        )
    cause = max(prediction.after.made_of.items(), key=lambda item: item[1], default=("", 0.0))[0]
    are_left = prediction.unknown > 0 and cause == "planning"
    if (prediction.is_expected_better or are_left) and not (prediction.is_better or _is_probe(file)):
        came = say("mm-instead-mm", f"{prediction.after.rms_mm:.4f}", f"{prediction.before.rms_mm:.4f}")
        if prediction.heights is not None:
            before, after = prediction.heights
            came = say("and-in-height", came, f"{after.rms_mm:.4f}", f"{before.rms_mm:.4f}")
        if prediction.unknown:
            came = together("; ", [came, prediction.left_words])
        if prediction.is_expected_better and (worse := prediction.chance_of_none) > 0:
            came = say("expected-but-no-gain", came, max(1, round(100 * worse)))
            is_printers = cause in EFFECTS and EFFECTS[cause].of.is_printers
            answer = None if is_printers else answer_to(model, cause)
            todo = say("answer-or-original", within(answer)) if answer else say("measure-more-or-original")
            todo = say("put-right-cause", in_words(cause)) if is_printers else todo
        raise RefusedError(file.name, wanted=say("smaller-error-after-mending-surely"), came=came, todo=todo)


def _is_probe(file: GcodeFile) -> bool:
    """Return whether a file is a test print of printmend's. Its dots are printed at rest, so the prediction counts only
    its lines."""
    return any(find_test_print(*part.hints()) == "probe" for part in file.parts)


def _refuse_misfit(file: GcodeFile, model: SavedModel) -> None:
    if said := said_of(model.document, REFITTED):
        raise RefusedError(file.name, wanted=say("model-measured-after-work"), came=said[0], todo=PHASE_TODO)
    if said := refusals(model.document):
        raise RefusedError(
            file.name, wanted=say("model-fits-own-measurement"), came=said[0],
            todo=say("measure-again-learn-use-force"),
        )  # fmt: skip


def _refuse_motionless(file: GcodeFile, prediction: Prediction) -> None:
    if prediction.moves + prediction.unknown == 0:
        raise GcodeError(file.name, wanted=say("g-code-motion"), came=say("g0-g3-move"), todo=say("give-sliced-file"))
