"""Mend many files with one model. A file that fails does not stop the others."""

import filecmp
import shutil
import threading
from collections.abc import Collection, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from printmend.errors import InputError, PrintmendError, reason
from printmend.files import replacing
from printmend.gcode.container import open_gcode
from printmend.gcode.mark import find_mark, is_test_print
from printmend.mend.mend import AS_USUAL, Mended, is_healthy, mend_gcode
from printmend.messages import say, together
from printmend.model import SavedModel
from printmend.plan import Fineness
from printmend.provenance import is_sealed

# The last one alone is a mesh more often than G-code: named, it is tried; in a folder it is left alone.
SUFFIXES = (".gcode.3mf", ".bgcode", ".gcode", ".gco", ".g", ".nc", ".3mf")
_MARK = ".mended"


@dataclass(frozen=True, eq=False)
class FileOutcome:
    """What became of a file: ``mended``, or the ``error`` and its exit ``code`` (2 or 3, 1 for a fault of printmend's).

    ``test_print``: it is a test print of printmend's and was copied unchanged. ``current``: this model had mended it,
    so it was copied. ``already``: it was mended before and left alone.
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
        """Say what became of the file."""
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
        before, after = self.mended.prediction.before, self.mended.prediction.after
        said = say("mended-from-to", self.source, f"{before.rms_mm:.3f}", f"{after.rms_mm:.3f}", self.output)
        return together("\n", [said, *(say("warning", each) for each in self.mended.prediction.warnings)])


def mended_path(source: Path) -> Path:
    """Return PART.mended.gcode beside PART.gcode."""
    name = source.name
    suffix = next((s for s in SUFFIXES if name.lower().endswith(s)), "")
    stem = name[: len(name) - len(suffix)] if suffix else name
    return source.with_name(f"{stem}{_MARK}{name[len(stem) :] or '.gcode'}")


def gcode_files(paths: Sequence[Path]) -> dict[Path, Path]:
    """Return the files given, and the G-code files below the folders given without those named as mending names them.

    Each with its place below its folder, a file given by itself with its name. Raises `InputError` for a folder without
    any.
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
    """Tell by its name whether a file is G-code that was not mended yet, hidden and temporary files apart."""
    low = name.lower()
    return low.endswith(SUFFIXES[:-1]) and not low.startswith(".") and f"{_MARK}." not in low


def refuse_overwriting(target: Path | None, source: Path) -> None:
    """Raise `InputError` where a file of another content would be written over."""
    if target is not None and target.is_file() and not (source.exists() and target.samefile(source)):
        raise InputError(
            target, wanted=say("name-for-new-file"), came=say("file-there-already"),
            todo=say("use-overwrite"),
        )  # fmt: skip


def is_done(source: Path, target: Path, model: SavedModel) -> bool:
    """Say whether a file is mended itself, or with this model in ``target`` since it was written or moved there."""
    try:
        return _mark(source) is not None or is_mended_to(source, target, model)
    except PrintmendError:  # to be said of it when it is mended
        return False


def is_mended_to(source: Path, target: Path, model: SavedModel) -> bool:
    """Say whether a file is mended with this model in ``target`` since it was written or moved there."""
    try:
        came = source.stat()
        if target.samefile(source) or target.stat().st_mtime_ns < max(came.st_mtime_ns, came.st_ctime_ns):
            return False
        if is_healthy(model):  # whose files are copied
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
    """Mend each source to its target, ``jobs`` at a time; yield what became of them, in their order.

    ``as_they_are`` copies test prints of printmend's: mended, they would be check prints, and nobody asked for one. It
    also copies files that this model mended. ``spare_done`` are sources to leave alone if they are mended already
    (`is_done`).
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
            return FileOutcome(source, target, error=f"{source}: {type(error).__name__}: {error}", code=1)

    with ThreadPoolExecutor(jobs) as pool:  # the kernels run beside each other
        yield from pool.map(mend, sources, targets)
