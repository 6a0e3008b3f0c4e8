"""Mend every file that is put into a folder, until stopped; a restart continues where it was.

It polls the folders, which works on network drives too. It takes a file that has not changed between two looks. If the
file changes later, for example because copying had paused, it is mended again. OUT/.printmend-watch.jsonl records each
file that was begun or done (name, size, time of change). So nothing is done twice, and files that somebody else put
into OUT are never written over.
"""

import json
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from printmend.errors import InputError, PrintmendError
from printmend.files import replacing
from printmend.mend.many import FileOutcome, is_gcode_name, is_mended_to, mend_files
from printmend.messages import say
from printmend.model import SavedModel, read_model

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
