"""Mend many files with one model: a farm's evening. What is wrong with one file does not stop the others."""

import shutil
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from printmend.errors import InputError, PrintmendError
from printmend.files import replacing
from printmend.gcode.mark import is_test_print
from printmend.invert import Fineness
from printmend.repair.mend import AS_USUAL, Mended, mend_gcode
from printmend.saved import SavedModel

# The last one alone is a mesh more often than G-code: named, it is tried; in a folder it is left alone.
SUFFIXES = (".gcode.3mf", ".bgcode", ".gcode", ".gco", ".g", ".nc", ".3mf")
_MARK = ".mended"


@dataclass(frozen=True, eq=False)
class Outcome:
    """What became of a file: ``mended``, or the ``error`` and its exit ``code`` (2 or 3, 1 for a fault of ours).

    ``test_print`` is true of a test print of ours that was copied as it is.
    """

    source: Path
    output: Path | None
    mended: Mended | None = None
    error: str | None = None
    code: int = 0
    test_print: bool = False

    def json(self) -> dict[str, Any]:
        """Return plain values for one line."""
        said: dict[str, Any] = {"source": str(self.source), "code": self.code}
        if self.test_print:
            return {**said, "output": str(self.output), "test_print": True}
        if self.mended is None:
            return {**said, "error": self.error}
        prediction = self.mended.prediction.json()
        prediction.pop("layers", None)
        return {**said, "output": str(self.output) if self.output else None, "prediction": prediction}

    def __str__(self) -> str:
        if self.test_print:
            return f"{self.source}: a test print of printmend's must show the printer as it is: copied to {self.output}"
        if self.mended is None:
            return f"{self.error}"
        before, after = self.mended.prediction.before, self.mended.prediction.after
        said = f"{self.source}: {before.rms_mm:.3f} mm → {after.rms_mm:.3f} mm, written: {self.output}"
        return "\n".join([said, *(f"warning: {each}" for each in self.mended.prediction.warnings)])


def mended_path(source: Path, folder: Path | None = None) -> Path:
    """Return PART.mended.gcode beside PART.gcode; in a ``folder`` of their own files keep their names."""
    if folder is not None:
        return folder / source.name
    name = source.name
    suffix = next((s for s in SUFFIXES if name.lower().endswith(s)), "")
    stem = name[: len(name) - len(suffix)] if suffix else name
    return source.with_name(f"{stem}{_MARK}{name[len(stem) :] or '.gcode'}")


def gcode_files(paths: Sequence[Path]) -> list[Path]:
    """Return the files given, and the G-code files below the folders given without those that mending wrote.

    Raises `InputError` for a folder without any.
    """
    found: dict[Path, None] = {}
    for path in paths:
        if not path.is_dir():
            found[path] = None
            continue
        inside = [item for item in sorted(path.rglob("*")) if is_gcode_name(item.name) and item.is_file()]
        if not inside:
            raise InputError(path, wanted="a folder with G-code", came="none in it", todo="name another")
        found.update(dict.fromkeys(inside))
    return list(found)


def is_gcode_name(name: str) -> bool:
    """Tell by its name whether a file is G-code that was not mended yet, hidden and temporary files apart."""
    low = name.lower()
    return low.endswith(SUFFIXES[:-1]) and not low.startswith(".") and f"{_MARK}." not in low


def refuse_overwriting(target: Path | None, source: Path) -> None:
    """Raise `InputError` where a file of another content would be written over."""
    if target is not None and target.is_file() and not (source.exists() and target.samefile(source)):
        raise InputError(
            target, wanted="a name for a new file", came="a file that is there already",
            todo="use --overwrite, or another -o",
        )  # fmt: skip


def mend_files(
    sources: Sequence[Path],
    targets: Sequence[Path],
    model: SavedModel,
    *,
    force: bool = False,
    fineness: Fineness = AS_USUAL,
    overwrite: bool = False,
    spare_test_prints: bool = False,
    jobs: int = 1,
) -> Iterator[Outcome]:
    """Mend each source to its target, ``jobs`` at a time; yield what became of them, in their order.

    ``spare_test_prints`` copies a test print of ours as it is: mending it makes a check print, for which nobody asked.
    """
    taken: set[Path] = set()
    lock = threading.Lock()

    def mend(source: Path, target: Path) -> Outcome:
        try:
            with lock:
                if target.resolve() in taken:
                    raise InputError(
                        source,
                        wanted="an output of its own",
                        came=f"{target}, another file's too",
                        todo="mend it apart",
                    )
                taken.add(target.resolve())
            if not overwrite:
                refuse_overwriting(target, source)
            if spare_test_prints and is_test_print(source):
                with source.open("rb") as plain, replacing(target, "wb") as copy:
                    shutil.copyfileobj(plain, copy, 1 << 20)
                return Outcome(source, target, test_print=True)
            return Outcome(source, target, mend_gcode(source, model, target, force=force, fineness=fineness))
        except PrintmendError as error:
            return Outcome(source, target, error=str(error), code=error.exit_code)
        except OSError as error:
            return Outcome(source, target, error=f"{source}: {error.strerror or error}", code=2)
        except Exception as error:  # one file must not cost the others
            return Outcome(source, target, error=f"{source}: {type(error).__name__}: {error}", code=1)

    with ThreadPoolExecutor(jobs) as pool:  # the kernels run beside each other
        yield from pool.map(mend, sources, targets)
