"""Mend a G-code file, or only say what mending would do."""

import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO

from printmend.clock import Duration, told_as_a_whole, with_times
from printmend.effects import EFFECTS
from printmend.errors import GcodeError, RefusedError
from printmend.files import replacing
from printmend.gcode.container import GcodeFile, Part, Text, open_gcode
from printmend.gcode.mark import find_mark, find_test_print, marked
from printmend.gcode.read import guessed_e_rule
from printmend.gcode.sliced import described, sliced
from printmend.gcode.write import Plan, TimePlace, rewrite
from printmend.mend.meant import refuse_contradiction, refuse_other_printer
from printmend.mend.prediction import Prediction, prediction_of, with_doubt
from printmend.mend.program import Progress, Read, begun, counted, plan_file
from printmend.mend.slower import eased, few_moves_words
from printmend.messages import say
from printmend.model.model import SavedModel
from printmend.model.notes import PHASE_TODO, REFITTED, refusals, said_of
from printmend.plan import Fineness, Planner, is_identity, start
from printmend.promise.words import in_words
from printmend.provenance import sealed

_MOST_HELD_SHARE = 0.005  # most of the path that may be held back at the edge of the bed, as a share
AS_USUAL = Fineness()
Watch = Callable[[Part, Plan], Plan]  # gets each program's plan, and may watch while it is carried out


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
    without a fault returns the file byte for byte. Each plate of a project is a print of its own. ``fineness`` says how
    far the path may be off, and which firmware reads it. ``watch`` gets the plan of each program.

    Raises `GcodeError` for what cannot be read or was mended before, `ModelError` where the file is not for this
    printer, `RefusedError` where mending would not help, or take longer than it may, and not ``force``.
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
            with _destination(output) as handle, file.path.open("rb") as whole:
                shutil.copyfileobj(whole, handle, 1 << 20)
            return Mended(output, _predicted(planner, model, read))
        slower = None
        if fineness.slower is not None:
            fineness, slower = eased(file, model, fineness, force=force)
        with _destination(output) as handle:
            read = []
            folder = None if output is None else output.parent
            # Only a text can end with a seal: in a container the programs are compressed, each by itself.
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
        return Mended(output, prediction)


def check_gcode(source: Path | str, model: SavedModel, *, progress: Progress | None = None) -> Prediction:
    """Predict what mending would do, and write nothing. Raises like `mend_gcode`, except where it would not help."""
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
    """Say whether there is nothing to mend."""
    return model.is_healthy or is_identity(model.mechanism)


def refuse_mended(file: GcodeFile) -> None:
    """Raise `GcodeError` for a file that was mended before: its moves are no longer the wanted ones."""
    for part in file.parts:
        if (digest := find_mark(*part.hints())) is not None:
            raise GcodeError(
                part.name, wanted=say("file-slicer-wrote"), came=say("mended-model", digest),
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
    """Return what to expect of a file that was planned, whose programs were ``read``.

    ``marks`` lines stood before what is printed that are not the file's own.
    """
    prediction = with_doubt(prediction_of(planner), model)
    lines = tuple(line - marks for line in prediction.unknown_lines)
    warnings = tuple(dict.fromkeys(words for one in read for words in one.said if words))
    duration: Duration | None = None
    for one in read:
        duration = one.watch.duration if duration is None else duration + one.watch.duration
    return replace(prediction, unknown_lines=lines, warnings=warnings, duration=duration)


def _mended_text(
    part: Part, planner: Planner, model: SavedModel, fineness: Fineness, progress: Progress | None,
    read: list[Read], watch: Watch | None, folder: Path | None,
) -> Iterator[bytes | memoryview]:  # fmt: skip
    """Return the text of a program as it is mended, and add to ``read`` how it was read.

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
    """Say that crossings are not sped up, because the normal acceleration is unknown."""
    if fineness.crossing_mm_s2 is None or planner.counts.hurried or not planner.counts.takeups:
        return None
    return say("no-crossing-sped-up")


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
    """Raise where the file should not be written."""
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
    if prediction.length_mm == 0:
        raise RefusedError(
            file.name, wanted=say("extruding-moves-known-place"), came=say("place-unknown", prediction.unknown),
            todo=say("home-g28-before-printing"),
        )  # fmt: skip
    if prediction.held_mm > _MOST_HELD_SHARE * prediction.length_mm:
        raise RefusedError(
            file.name,
            wanted=say("print-printer-can-reach"),
            came=say(
                "extruding-commands-mm-beyond-edge-bed", prediction.clamped_extruding, f"{prediction.beyond_mm:.2f}"
            ),
            todo=say("move-object-much-away-give-scale"),
        )
    if not prediction.is_better and not _is_probe(file):
        came = say("mm-instead-mm", f"{prediction.after.rms_mm:.4f}", f"{prediction.before.rms_mm:.4f}")
        if prediction.heights is not None:
            before, after = prediction.heights
            came = say("and-in-height", came, f"{after.rms_mm:.4f}", f"{before.rms_mm:.4f}")
        if (worse := prediction.chance_of_none) > 0 and prediction.after.rms_mm < prediction.before.rms_mm:
            came = say("expected-but-no-gain", came, max(1, round(100 * worse)))
            cause = max(prediction.after.made_of.items(), key=lambda item: item[1], default=("", 0.0))[0]
            todo = say("put-right-cause", in_words(cause)) if cause in EFFECTS else say("measure-more-or-original")
        raise RefusedError(file.name, wanted=say("smaller-error-after-mending-surely"), came=came, todo=todo)


def _is_probe(file: GcodeFile) -> bool:
    """Say whether a file is a test print of printmend's: its dots are printed at rest, so the prediction counts lines
    only."""
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
    if prediction.moves == 0:
        raise GcodeError(file.name, wanted=say("g-code-motion"), came=say("g0-g3-move"), todo=say("give-sliced-file"))
