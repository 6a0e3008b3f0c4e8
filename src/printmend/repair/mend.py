"""Mend a G-code file, or only say what mending would do."""

import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO

import numpy as np

from printmend.errors import GcodeError, ModelError, RefusedError
from printmend.files import replacing
from printmend.gcode.container import GcodeFile, Part, Text, open_gcode
from printmend.gcode.header import Described, described
from printmend.gcode.mark import find_mark, find_test_print, marked
from printmend.gcode.read import MachineState, e_warning, guessed_e_rule, starting_state
from printmend.gcode.write import Plan, follow, rewrite
from printmend.invert import Fineness, Planner, is_identity, start
from printmend.printer import Printer
from printmend.printer.known import printers_named
from printmend.promise.laws import LAWS
from printmend.promise.misfit import refusals
from printmend.promise.words import in_words
from printmend.provenance import seal_key, sealed
from printmend.repair.prediction import Prediction, prediction_of, with_doubt
from printmend.saved.model import SavedModel

_OUTSIDE_MM = 15.0  # how far beyond the bed a file may print: purge lines and wipes lie a few millimetres beyond some
_DOTS_WORDS = (
    "only the lines of this test print are counted here, not its dots: a dot may be off in two directions, and these "
    "figures are distances across a line"
)
_BED_OFF_MM = 30.0  # how far a slicer's bed and the preset's may differ where the printer is the same …
_STRANGER_BED_OFF_MM = 15.0  # … and where the file names none that may be the model's
_MOST_HELD_SHARE = 0.005  # share of the path that may be held back at the edge of the bed: that is still a print
AS_USUAL = Fineness()
Progress = Callable[[int], None]
Watch = Callable[[Part, Plan], Plan]  # what is told of each program's plan, and may look on while it is carried out


@dataclass(frozen=True, eq=False)
class Mended:
    """What was done: ``output`` is where the mended file lies, None for the standard output."""

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

    ``output`` may be the source itself; None is the standard output. Nothing is written unless all went well. A model
    without a fault that fits its measurement returns the file byte for byte. The plates of a project are prints of
    their own. ``fineness`` says how far the path may be off, and which firmware reads it. ``watch`` may look on while
    each program is planned.

    Raises `GcodeError` for what cannot be read or was mended before, `ModelError` where the file is not for this
    printer, `RefusedError` where mending would not help and not ``force``.
    """
    output = None if output is None else Path(output)
    with open_gcode(source) as file:
        refuse_mended(file)
        planner = start(model.mechanism, tolerance_mm=fineness.tolerance_mm)
        if is_healthy(model):
            if not force:
                _refuse_misfit(file, model)
            said = _plan(file, planner, model, progress)
            with _destination(output) as handle, file.path.open("rb") as whole:
                shutil.copyfileobj(whole, handle, 1 << 20)
            return Mended(output, _predicted(planner, model, said))
        with _destination(output) as handle:
            said = []
            # Only a text can end with a seal: in a container the programs are compressed, each by itself.
            key = seal_key(model.document) if file.container == "plain" else None

            def texts(part: Part) -> Iterator[Text]:
                text = _mended_text(part, planner, model, fineness, progress, said, watch)
                return text if key is None else sealed(text, key)

            file.write(handle, texts)
            prediction = _predicted(planner, model, said, marks=1)
            _check_worth_writing(file, model, prediction, force=force)
        return Mended(output, prediction)


def check_gcode(source: Path | str, model: SavedModel, *, progress: Progress | None = None) -> Prediction:
    """Predict what mending would do, and write nothing. Raises like `mend_gcode`, except where it would not help."""
    with open_gcode(source) as file:
        refuse_mended(file)
        planner = start(model.mechanism)
        said = _plan(file, planner, model, progress)
        prediction = _predicted(planner, model, said)
        _refuse_motionless(file, prediction)
        _refuse_other_printer(file, model, prediction)
        return prediction


def is_healthy(model: SavedModel) -> bool:
    """Say whether there is nothing to mend."""
    return model.is_healthy or is_identity(model.mechanism)


def refuse_mended(file: GcodeFile) -> None:
    """Raise `GcodeError` for a file that was mended before: its moves are no longer what is wanted."""
    for part in file.parts:
        if (digest := find_mark(*part.hints())) is not None:
            raise GcodeError(
                part.name, wanted="a file as the slicer wrote it", came=f"one that was mended with model {digest}",
                todo="give the original (for `check`, the mended one with --against)",
            )  # fmt: skip


def _plan(file: GcodeFile, planner: Planner, model: SavedModel, progress: Progress | None) -> list[str | None]:
    """Plan a file, and return what is to be said of how each of its programs was read."""
    said = []
    for part in file.parts:
        state = starting_state(part, printer=model.printer)
        said += _said_of(part, state)
        planner.begin()
        follow(_counted(part.chunks(), progress), state, planner.plan)
    return said


def _said_of(part: Part, state: MachineState) -> list[str | None]:
    """Return what is to be said of how a program was read, and of what is not judged in it."""
    is_probe = find_test_print(*part.hints()) == "probe"
    return [e_warning(state), _DOTS_WORDS if is_probe else None]


def _predicted(planner: Planner, model: SavedModel, said: list[str | None], *, marks: int = 0) -> Prediction:
    """Return what to expect of a file that was planned, with what is to be ``said`` of it, once each.

    ``marks`` lines stood before what is printed that are not the file's own.
    """
    prediction = with_doubt(prediction_of(planner), model)
    lines = tuple(line - marks for line in prediction.unknown_lines)
    return replace(prediction, unknown_lines=lines, warnings=tuple(dict.fromkeys(filter(None, said))))


def _mended_text(
    part: Part, planner: Planner, model: SavedModel, fineness: Fineness, progress: Progress | None,
    said: list[str | None], watch: Watch | None,
) -> Iterator[memoryview]:  # fmt: skip
    """Yield the text of a program as it is mended, and add to ``said`` what is to be said of how it was read."""
    state = starting_state(part, printer=model.printer)
    said += _said_of(part, state)
    planner.begin(fineness.segments_per_s(state.flavour))
    chunks = marked(_counted(part.chunks(), progress), model.digest, guessed_e_rule(part, state))
    return rewrite(chunks, state, planner.plan if watch is None else watch(part, planner.plan))


def _counted(chunks: Iterator[np.ndarray], progress: Progress | None) -> Iterator[np.ndarray]:
    """Yield the chunks of a text, and tell ``progress`` how many bytes each had."""
    for chunk in chunks:
        yield chunk
        if progress is not None:
            progress(len(chunk))


@contextmanager
def _destination(output: Path | None) -> Iterator[IO[bytes]]:
    """Open what takes the output's place once all is well; for the standard output a temporary file."""
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
    """Raise where the file should not be written."""
    _refuse_motionless(file, prediction)
    _refuse_other_printer(file, model, prediction)
    if force:
        return
    for part in file.parts:
        _refuse_contradiction(part.name, described(*part.hints()), model.printer)
    _refuse_misfit(file, model)
    todo = "print the original, or use --force"
    if prediction.extruding + prediction.unknown == 0:
        raise RefusedError(
            file.name, wanted="a print", came=f"{prediction.moves} moves that extrude nothing",
            todo="put M83 at its top if each E is meant to add to the last, or use --force to mend them as travels",
        )  # fmt: skip
    if prediction.length_mm == 0:
        raise RefusedError(
            file.name, wanted="extruding moves from a known place", came="none", todo="home with G28 before printing"
        )
    if prediction.held_mm > _MOST_HELD_SHARE * prediction.length_mm:
        raise RefusedError(
            file.name, wanted="a print that this printer can reach",
            came=f"{prediction.clamped_extruding} extruding commands "
            f"{prediction.beyond_mm:.2f} mm beyond the edge of the bed",
            todo="move the object that much away from it, give the scale to the firmware first (`printmend export`), "
            "or use --force",
        )  # fmt: skip
    if not prediction.is_better and not _is_probe(file):
        came = f"{prediction.after.rms_mm:.4f} mm instead of {prediction.before.rms_mm:.4f} mm"
        if prediction.heights is not None:
            before, after = prediction.heights
            came += f", in height {after.rms_mm:.4f} mm instead of {before.rms_mm:.4f} mm"
        if (worse := prediction.chance_of_none) > 0 and prediction.after.rms_mm < prediction.before.rms_mm:
            share = max(1, round(100 * worse))
            came += f" expected, but no gain in {share} of 100 machines that the measurement allows"
            cause = max(prediction.after.made_of.items(), key=lambda item: item[1], default=("", 0.0))[0]
            if cause in LAWS:
                todo = f"put right what `printmend learn` said of {in_words(cause)} and measure again, or {todo}"
            else:
                todo = f"measure more (a whole probe, or with callipers the --distance that `measure` names), or {todo}"
        raise RefusedError(file.name, wanted="a smaller error after mending, surely", came=came, todo=todo)


def _is_probe(file: GcodeFile) -> bool:
    """Say whether a file is one of our probes: its dots are printed standing, and lines are all that is judged."""
    return any(find_test_print(*part.hints()) == "probe" for part in file.parts)


def _refuse_misfit(file: GcodeFile, model: SavedModel) -> None:
    if said := refusals(model.document):
        raise RefusedError(
            file.name, wanted="a model that fits its own measurement", came=said[0],
            todo="measure again and learn, or use --force",
        )  # fmt: skip


def _refuse_motionless(file: GcodeFile, prediction: Prediction) -> None:
    if prediction.moves == 0:
        raise GcodeError(
            file.name, wanted="G-code with motion", came="no G0–G3 move in X or Y", todo="give a sliced file"
        )


def _refuse_other_printer(file: GcodeFile, model: SavedModel, prediction: Prediction) -> None:
    if not prediction.extruding:
        return
    printer = model.printer
    todo = "use the model of the printer that this file is for"
    for axis, low, high in zip((printer.x, printer.y), prediction.low_mm, prediction.high_mm, strict=True):
        if low < axis.min_mm - _OUTSIDE_MM or high > axis.max_mm + _OUTSIDE_MM:
            wanted = f"G-code for {printer.name}, {axis.name.upper()} from {axis.min_mm:g} to {axis.max_mm:g} mm"
            came = f"extrusion from {low:.1f} to {high:.1f} mm"
            raise ModelError(file.name, wanted=wanted, came=came, todo=todo)


def _refuse_contradiction(name: str, said: Described, printer: Printer) -> None:
    """Raise `ModelError` where a file says that it is for another printer than the model's."""
    todo = f"use the model of the printer that this file is for, or --force if it is this {printer.name}"
    mine, theirs = printers_named(printer.name), [printers_named(each) for each in said.names]
    stranger = bool(mine and theirs) and not any(mine & each for each in theirs)
    if said.bed_mm is not None:
        own = ((printer.x.min_mm, printer.y.min_mm), (printer.x.max_mm, printer.y.max_mm))
        off_mm = float(np.abs(np.subtract(own, said.bed_mm)).max())
        if off_mm > (_STRANGER_BED_OFF_MM if stranger else _BED_OFF_MM):
            for_whom = f" of {said.names[0]}" if stranger else ""
            shown = [f"({low[0]:g}, {low[1]:g}) to ({high[0]:g}, {high[1]:g}) mm" for low, high in (own, said.bed_mm)]
            raise ModelError(
                name, wanted=f"G-code for a bed from {shown[0]}", came=f"a bed from {shown[1]}{for_whom}", todo=todo
            )
    if said.print_mm is not None:
        low, high = said.print_mm
        ends = ((printer.x, low[0], high[0]), (printer.y, low[1], high[1]))
        for axis, least, most in ends:
            if least < axis.min_mm - _OUTSIDE_MM or most > axis.max_mm + _OUTSIDE_MM:
                wanted = f"G-code for {printer.name}, {axis.name.upper()} from {axis.min_mm:g} to {axis.max_mm:g} mm"
                raise ModelError(name, wanted=wanted, came=f"a header from {least:g} to {most:g} mm", todo=todo)
    if stranger and any(theirs):
        other = next(each for each, printers in zip(said.names, theirs, strict=True) if printers)
        raise ModelError(name, wanted=f"G-code for {printer.name}", came=f"G-code for {other}", todo=todo)
