"""Read small files whole, within bounds; write so that a kill at any moment leaves the old file or the new one."""

import contextlib
import errno
import glob
import os
import stat
import tempfile
import time
from collections.abc import Iterator
from contextvars import ContextVar
from pathlib import Path
from typing import IO, Any

from printmend.errors import InputError, UnwritableError, reason
from printmend.messages import say

try:
    import fcntl
except ImportError:  # Windows has no such locks: leftovers of killed runs stay there
    fcntl = None  # type: ignore[assignment]

MAX_TEXT_BYTES = 64_000_000  # of a model, a trace or a configuration
_SUFFIX, _RANDOM = ".tmp", 8  # of a temporary file's name: its end, and the letters that `tempfile` draws before
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_Held = tuple[str, Path, int | None]  # a temporary file, whose place it takes, and what marks it as being written
_held: ContextVar[list[_Held] | None] = ContextVar("held", default=None)


def read_text(path: str | Path, *, wanted: str, todo: str, error: type[InputError] = InputError) -> str:
    """Return the text of a UTF-8 file of at most `MAX_TEXT_BYTES`, without a byte order mark.

    Raises ``error`` where it cannot be read, is larger, or is not UTF-8.
    """
    try:
        with open(path, "rb") as file:
            data = file.read(MAX_TEXT_BYTES + 1)
    except (OSError, ValueError) as problem:
        raise error(path, wanted=wanted, came=reason(problem), todo=say("check-path")) from None
    if len(data) > MAX_TEXT_BYTES:
        raise error(path, wanted=wanted, came=say("more-than-mb", MAX_TEXT_BYTES // 1000000), todo=todo)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise error(path, wanted=wanted, came=say("bytes-not-utf-8-text"), todo=todo) from None


@contextlib.contextmanager
def all_or_none() -> Iterator[None]:
    """Rename all files that `replacing` writes in this block when it ends; after an error, none of them."""
    held: list[_Held] = []
    token = _held.set(held)
    try:
        yield
        for name, path, _ in held:
            _take_place(name, path)
    finally:
        _held.reset(token)
        for name, _, lock in held:
            _forget(name, lock)


@contextlib.contextmanager
def replacing(path: Path, mode: str = "w") -> Iterator[IO]:
    """Open a temporary file beside ``path`` that takes its place when the block ends without an error.

    The old file's permissions and, for root, its owner are kept; on an error the temporary file is removed and ``path``
    is untouched. What earlier runs left there when they were killed is swept.
    A device or a pipe is written to directly. Raises `InputError` where ``path`` cannot be written or the disk is full.
    """
    # A name of a file that is not UTF-8 may be part of the text.
    coding: dict[str, Any] = {} if "b" in mode else {"encoding": "utf-8", "errors": "replace"}
    path = Path(path)
    if not _is_replaceable(path):
        try:
            with open(path, mode, **coding) as device:
                yield device
        except OSError as error:
            if error.errno in _FULL and error.filename is None:
                raise _unwritable(path, reason(error), error.errno) from None
            raise
        return
    path = path.resolve()
    prefix = f".{path.name[:60]}."
    _sweep(path.parent, prefix)
    try:
        handle = tempfile.NamedTemporaryFile(  # noqa: SIM115 — closed below, before it is renamed
            mode, dir=path.parent, prefix=prefix, suffix=_SUFFIX, delete=False, **coding
        )
    except OSError as error:
        raise _unwritable(path, reason(error), error.errno) from None
    lock, held = _lock(handle.fileno()), _held.get()
    try:
        with handle:
            yield handle
            handle.flush()
            os.fsync(handle.fileno())
        if held is not None:
            held.append((handle.name, path, lock))
            return
        _take_place(handle.name, path)
    except BaseException as error:
        _forget(handle.name, lock)
        if isinstance(error, OSError) and error.errno in _FULL and error.filename is None:
            raise _unwritable(path, reason(error), error.errno) from None
        raise
    _forget(handle.name, lock)


def check_place(path: Path) -> None:
    """Raise `UnwritableError` where no file can be written at ``path``: before the work that would be lost."""
    path = Path(os.path.abspath(path))
    if path.is_dir():
        raise _unwritable(path, say("folder"))
    if not path.parent.is_dir():
        raise _unwritable(path, say("no-such-folder", path.parent), errno.ENOENT)
    if not path.exists() and not os.access(path.parent, os.W_OK):
        raise _unwritable(path, say("folder-not-writable"))


def _lock(handle: int) -> int | None:
    """Mark a temporary file as being written; return what holds the mark until it is closed."""
    if fcntl is None:
        return None
    held = os.dup(handle)
    with contextlib.suppress(OSError):  # a file system without locks
        fcntl.flock(held, fcntl.LOCK_SH | fcntl.LOCK_NB)
    return held


def _sweep(folder: Path, prefix: str) -> None:
    """Remove the temporary files of a target that nobody writes any more."""
    if fcntl is None:
        return
    for name in glob.glob(glob.escape(prefix) + "*" + _SUFFIX, root_dir=folder, include_hidden=True):
        with contextlib.suppress(OSError), open(folder / name, "rb") as old:  # being written, or another's
            if len(name) == len(prefix) + _RANDOM + len(_SUFFIX) and time.time() - os.fstat(old.fileno()).st_mtime > 1:
                fcntl.flock(old, fcntl.LOCK_EX | fcntl.LOCK_NB)
                os.unlink(folder / name)


def _take_place(name: str, path: Path) -> None:
    """Put a temporary file in the place of another."""
    _dress_like(path, name)
    os.replace(name, path)


def _forget(name: str, lock: int | None) -> None:
    """Remove a temporary file, if it is still there, and its mark."""
    with contextlib.suppress(FileNotFoundError):
        os.unlink(name)
    if lock is not None:
        os.close(lock)


def _dress_like(path: Path, name: str) -> None:
    """Give a new file the old one's permissions, and its owner where that is allowed."""
    if not path.exists():
        os.chmod(name, 0o666 & ~_umask())
        return
    old, new = path.stat(), os.stat(name)
    if hasattr(os, "chown") and (old.st_uid, old.st_gid) != (new.st_uid, new.st_gid):
        with contextlib.suppress(PermissionError):
            os.chown(name, old.st_uid, old.st_gid)
    os.chmod(name, old.st_mode & 0o777)


def _is_replaceable(path: Path) -> bool:
    """Tell a regular file, or a place for one, from a device or pipe, which a rename would replace."""
    try:
        kind = path.stat().st_mode
    except FileNotFoundError:
        return True
    except OSError as error:
        raise _unwritable(path, reason(error), error.errno) from None
    if stat.S_ISDIR(kind):
        raise _unwritable(path, say("folder"))
    return stat.S_ISREG(kind)


def _unwritable(path: Path, came: str, number: int | None = None) -> UnwritableError:
    todo = say("choose-place-or-make-folder" if number == errno.ENOENT else "choose-another-place")
    if number in (errno.ENOSPC, errno.EDQUOT):
        todo = say("make-room-on-disk")
    return UnwritableError(path, wanted=say("file-can-be-written"), came=came, todo=todo)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
