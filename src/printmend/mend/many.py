"""Mend many files with one model: the files of a list, or every file that is put into a folder."""

import filecmp
import json
import shutil
import threading
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from printmend.errors import InputError, PrintmendError, own_fault, reason
from printmend.files import replacing
from printmend.gcode.container import open_gcode
from printmend.gcode.sliced import find_mark, is_test_print
from printmend.mend.mend import AS_USUAL, Mended, is_healthy, mend_gcode
from printmend.messages import say, together
from printmend.model import SavedModel, read_model
from printmend.plan import Fineness
from printmend.provenance import is_sealed

# A plain .3mf is a mesh more often than G-code: it is tried if named, and left alone in a folder.
SUFFIXES = (".gcode.3mf", ".bgcode", ".gcode", ".gco", ".g", ".nc", ".3mf")
_MARK = ".mended"


@dataclass(frozen=True, eq=False)
class FileOutcome:
    """The outcome for a file: ``mended``, or the ``error`` and its exit ``code`` (2 or 3, 1 for a bug in printmend).

    ``test_print``: the file is a test print of printmend's and was copied unchanged. ``current``: this model had mended
    the file already, so it was copied. ``already``: it was mended before and left alone.
    """

    source: Path
    output: Path | None
    mended: Mended | None = None
    error: str | None = None
    code: int = 0
    test_print: bool = False
    current: bool = False
    already: bool = False

    def json(self) -> dict[str, Any]:
        """Return plain values for one line."""
        said: dict[str, Any] = {"source": str(self.source), "code": self.code}
        if self.test_print:
            return {**said, "output": str(self.output), "test_print": True}
        for why in ("current", "already"):
            if getattr(self, why):
                return {**said, "output": str(self.output), why: True}
        if self.mended is None:
            return {**said, "error": self.error}
        prediction = self.mended.prediction.json()
        prediction.pop("layers", None)
        return {**said, "output": str(self.output) if self.output else None, "prediction": prediction}

    @property
    def words(self) -> str:
        """Say what happened to the file."""
        if self.test_print:
            return say("test-print-copied", self.source, self.output)
        if self.current:
            return say("current-copied", self.source, self.output)
        if self.already:
            if self.output == self.source:
                return say("mended-already", self.source)
            return say("terminal-mended-already-to", self.source, self.output)
        if self.mended is None:
            return self.error or ""
        prediction = self.mended.prediction
        before, after = f"{prediction.before.rms_mm:.3f}", f"{prediction.after.rms_mm:.3f}"
        said = say("mended-from-to", self.source, before, after, self.output)
        warnings = filter(None, (*prediction.warnings, prediction.left_words))
        return together("\n", [said, *(say("warning", each) for each in warnings)])


def mended_path(source: Path) -> Path:
    """Return PART.mended.gcode beside PART.gcode."""
    name = source.name
    suffix = next((s for s in SUFFIXES if name.lower().endswith(s)), "")
    stem = name[: len(name) - len(suffix)] if suffix else name
    return source.with_name(f"{stem}{_MARK}{name[len(stem) :] or '.gcode'}")


def gcode_files(paths: Sequence[Path]) -> dict[Path, Path]:
    """Return the given files, and all G-code files below the given folders except those named like mended files.

    Each comes with its path relative to its folder; a file given by itself comes with its name. Raises `InputError`
    for a folder without G-code.
    """
    found: dict[Path, Path] = {}
    for path in paths:
        if not path.is_dir():
            found[path] = Path(path.name)
            continue
        inside = [item for item in sorted(path.rglob("*")) if is_gcode_name(item.name) and item.is_file()]
        if not inside:
            raise InputError(path, wanted=say("folder-with-gcode"), came=say("none-2"), todo=say("name-another"))
        found.update({item: item.relative_to(path) for item in inside if item not in found})
    return found


def is_gcode_name(name: str) -> bool:
    """Return whether a name means G-code that was not mended yet; hidden files do not count."""
    low = name.lower()
    return low.endswith(SUFFIXES[:-1]) and not low.startswith(".") and f"{_MARK}." not in low


def refuse_overwriting(target: Path | None, source: Path) -> None:
    """Raise `InputError` if a file with other contents would be overwritten."""
    if target is not None and target.is_file() and not (source.exists() and target.samefile(source)):
        raise InputError(
            target, wanted=say("name-for-new-file"), came=say("file-there-already"),
            todo=say("use-overwrite"),
        )  # fmt: skip


def is_done(source: Path, target: Path, model: SavedModel) -> bool:
    """Return whether a file is a mended file itself, or was mended to ``target`` as in `is_mended_to`."""
    try:
        return _mark(source) is not None or is_mended_to(source, target, model)
    except PrintmendError:  # mending it will report this error
        return False


def is_mended_to(source: Path, target: Path, model: SavedModel) -> bool:
    """Return whether ``target`` is the source mended with this model, and newer than the source and its last move."""
    try:
        came = source.stat()
        if target.samefile(source) or target.stat().st_mtime_ns < max(came.st_mtime_ns, came.st_ctime_ns):
            return False
        if is_healthy(model):  # a healthy model's files are copied
            return filecmp.cmp(source, target, shallow=False)
        return _mark(target) == model.digest
    except (OSError, PrintmendError):  # none there yet
        return False


def _mark(path: Path) -> str | None:
    """Return the digest of the model that mended a file; None for an unmended file."""
    with open_gcode(path) as file:
        return find_mark(*(hint for part in file.parts for hint in part.hints()))


def mend_files(
    sources: Sequence[Path],
    targets: Sequence[Path],
    model: SavedModel,
    *,
    force: bool = False,
    fineness: Fineness = AS_USUAL,
    overwrite: bool = False,
    as_they_are: bool = False,
    spare_done: Collection[Path] = (),
    jobs: int = 1,
) -> Iterator[FileOutcome]:
    """Mend each source to its target, ``jobs`` at a time; yield the outcomes in the same order.

    ``as_they_are`` copies printmend's test prints, because mending would make them check prints, for which nobody
    asked. It also copies files that this model mended. ``spare_done`` are sources to leave alone if they are mended
    already (`is_done`).
    """
    taken: set[Path] = set()
    lock = threading.Lock()

    def mend(source: Path, target: Path) -> FileOutcome:
        try:
            with lock:
                if target.resolve() in taken:
                    raise InputError(
                        source,
                        wanted=say("output-of-its-own"),
                        came=say("another-files-too", target),
                        todo=say("mend-it-apart"),
                    )
                taken.add(target.resolve())
            if source in spare_done and is_done(source, target, model):
                return FileOutcome(source, target if target.exists() else source, already=True)
            if not overwrite:
                refuse_overwriting(target, source)
            test_print = as_they_are and is_test_print(source)
            if test_print or (as_they_are and is_sealed(str(source), model.seal_key)):
                with source.open("rb") as plain, replacing(target, "wb") as copy:
                    shutil.copyfileobj(plain, copy, 1 << 20)
                return FileOutcome(source, target, test_print=test_print, current=not test_print)
            return FileOutcome(source, target, mend_gcode(source, model, target, force=force, fineness=fineness))
        except PrintmendError as error:
            return FileOutcome(source, target, error=error.message, code=error.exit_code)
        except OSError as error:
            return FileOutcome(source, target, error=together(": ", [str(source), reason(error)]), code=2)
        except Exception as error:  # one file must not cost the others
            told = say("terminal-own-fault", own_fault(error))
            return FileOutcome(source, target, error=together(": ", [str(source), told]), code=1)

    with ThreadPoolExecutor(jobs) as pool:  # the kernels release the GIL
        yield from pool.map(mend, sources, targets)


# Mend every file that is put into a folder, until stopped; a restart continues where it was.
#
# It polls the folders, which works on network drives too. It takes a file that has not changed between two looks. If
# the file changes later, for example because copying had paused, it is mended again. OUT/.printmend-watch.jsonl records
# each file that was begun or done (name, size, time of change). So nothing is done twice, and files that somebody else
# put into OUT are never written over.

JOURNAL = ".printmend-watch.jsonl"
_ERROR = ".error.txt"  # beside where the mended file would be: why it is not there
Seen = tuple[str, int, int]  # name below IN, bytes, time of change in ns


@dataclass
class Watch:
    """IN, OUT and the record of finished files; `look` does one round."""

    source: Path
    target: Path
    model_path: Path
    force: bool = False
    told: Callable[[str], None] = lambda words: None
    done: dict[str, Seen] = field(default_factory=dict)
    ours: set[str] = field(default_factory=set)
    last: set[Seen] = field(default_factory=set)
    model: SavedModel | None = None
    model_time_ns: int = -1

    def __post_init__(self) -> None:
        if not self.source.is_dir():
            raise InputError(
                self.source, wanted=say("folder-files-come-into"), came=say("none"), todo=say("make-check-path")
            )
        self.target.mkdir(parents=True, exist_ok=True)
        if self.source.resolve() == self.target.resolve():
            raise InputError(self.target, wanted=say("folder-apart-from"), came=say("same"), todo=say("name-another"))
        for seen, code in self._journal():
            if code is not None:
                self.done[seen[0]] = seen
            else:
                self.ours.add(seen[0])

    def look(self) -> list[FileOutcome]:
        """Mend what is new and has not changed since the last look."""
        found = self._found()
        ready = [seen for seen in sorted(found) if seen in self.last and self.done.get(seen[0]) != seen]
        self.last = found
        outcomes = []
        for seen in ready:
            outcome = self._mend(seen)
            if outcome is not None:
                outcomes.append(outcome)
        return outcomes

    def _found(self) -> set[Seen]:
        found, inside = set(), self.target.resolve()
        for path in self.source.rglob("*"):
            try:
                if is_gcode_name(path.name) and path.is_file() and inside not in path.resolve().parents:
                    at = path.stat()
                    found.add((path.relative_to(self.source).as_posix(), at.st_size, at.st_mtime_ns))
            except OSError:  # gone again, or not ours to read yet
                continue
        return found

    def _mend(self, seen: Seen) -> FileOutcome | None:
        source, target = self.source / seen[0], self.target / seen[0]
        target.parent.mkdir(parents=True, exist_ok=True)
        model, there = self._model(), target.exists()
        done = seen[0] not in self.ours and there and is_mended_to(source, target, model)  # by `printmend mend`
        if seen[0] not in self.ours and (done or not there):  # it may overwrite its own files
            self.ours.add(seen[0])
            self._note(seen, None)
        if done:
            self.done[seen[0]] = seen
            self._note(seen, 0)
            return None
        ours = seen[0] in self.ours
        (outcome,) = mend_files([source], [target], model, force=self.force, overwrite=ours, as_they_are=True)
        try:
            at = source.stat()
        except OSError:
            return None  # removed meanwhile: it counts as new if it comes back
        if (at.st_size, at.st_mtime_ns) != seen[1:]:
            return None  # changed while it was read: a later look takes it
        why = target.with_name(target.name + _ERROR)
        if outcome.code:
            with replacing(why) as file:
                file.write(f"{outcome.error}\n")
        else:
            why.unlink(missing_ok=True)
        self.done[seen[0]] = seen
        self._note(seen, outcome.code)
        return outcome

    def _note(self, seen: Seen, code: int | None) -> None:
        with (self.target / JOURNAL).open("a", encoding="utf-8") as journal:
            journal.write(json.dumps({"file": seen, "code": code}) + "\n")

    def _model(self) -> SavedModel:
        """Return the model, read again if its file has changed; a model whose file is gone stays in use."""
        try:
            changed_ns = self.model_path.stat().st_mtime_ns
            if self.model is None or changed_ns != self.model_time_ns:
                self.model, self.model_time_ns = read_model(self.model_path), changed_ns
        except (OSError, PrintmendError) as error:
            if self.model is None:
                raise
            self.told(say("watch-old-model", getattr(error, "message", error)))
        return self.model

    def _journal(self) -> list[tuple[Seen, int | None]]:
        """Return the files begun (code None) and done."""
        try:
            text = (self.target / JOURNAL).read_text(encoding="utf-8")
            lines = text.splitlines()
        except FileNotFoundError:
            return []
        if lines and not text.endswith("\n"):  # a kill cut the last line short: the next one begins anew
            with (self.target / JOURNAL).open("a", encoding="utf-8") as journal:
                journal.write("\n")
        known: list[tuple[Seen, int | None]] = []
        for line in lines:
            try:
                values = json.loads(line)
                name, size, time_ns = values["file"]
                code = values["code"]
                known.append(((str(name), int(size), int(time_ns)), None if code is None else int(code)))
            except (ValueError, TypeError, KeyError):  # a line that a kill cut short
                continue
        return known


def watch(job: Watch, *, every_s: float, once: bool, tell: Callable[[FileOutcome], None]) -> int:
    """Look every ``every_s`` seconds, for ever or ``once`` (two looks); return the worst exit code of this run."""
    job._model()
    worst, looks = 0, 0
    while not (once and looks == 2):
        if looks:
            time.sleep(every_s)
        for outcome in job.look():
            tell(outcome)
            worst = min(filter(None, (worst, outcome.code)), default=0)
        looks += 1
    return worst
