"""Read small files whole, within bounds; write so that a kill at any moment leaves the old file or the new one."""

import contextlib
import os
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

from printmend.errors import InputError

MAX_TEXT_BYTES = 64_000_000


def read_text(path: str | Path, *, wanted: str, todo: str, error: type[InputError] = InputError) -> str:
    """Return the text of a UTF-8 file of at most `MAX_TEXT_BYTES`, without a byte order mark.

    Raises ``error`` where it cannot be read, is larger, or is not UTF-8.
    """
    try:
        with open(path, "rb") as file:
            data = file.read(MAX_TEXT_BYTES + 1)
    except (OSError, ValueError) as problem:
        came = (getattr(problem, "strerror", None) or str(problem)).lower()
        raise error(path, wanted=wanted, came=came, todo="check the path") from None
    if len(data) > MAX_TEXT_BYTES:
        raise error(path, wanted=wanted, came=f"more than {MAX_TEXT_BYTES // 1_000_000} MB", todo=todo)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise error(path, wanted=wanted, came="bytes that are not UTF-8 text", todo=todo) from None


@contextlib.contextmanager
def replacing(path: Path, mode: str = "w") -> Iterator[IO]:
    """Open a temporary file beside ``path`` that takes its place when the block ends without an error.

    The old file's permissions are kept; on an error the temporary file is removed and ``path`` is untouched.
    A device or a pipe is written to directly. Raises `InputError` where ``path`` cannot be written.
    """
    # A name of a file that is not UTF-8 may be part of the text.
    coding: dict[str, Any] = {} if "b" in mode else {"encoding": "utf-8", "errors": "replace"}
    path = Path(path)
    if not _is_replaceable(path):
        with open(path, mode, **coding) as device:
            yield device
        return
    path = path.resolve()
    try:
        handle = tempfile.NamedTemporaryFile(  # noqa: SIM115 — closed below, before it is renamed
            mode, dir=path.parent, prefix=f".{path.name[:60]}.", suffix=".tmp", delete=False, **coding
        )
    except OSError as error:
        raise _unwritable(path, error.strerror or str(error)) from None
    try:
        with handle:
            yield handle
            handle.flush()
            os.fsync(handle.fileno())
        permissions = path.stat().st_mode & 0o777 if path.exists() else 0o666 & ~_umask()
        os.chmod(handle.name, permissions)
        os.replace(handle.name, path)
    except BaseException:
        with contextlib.suppress(FileNotFoundError):
            os.unlink(handle.name)
        raise


def _is_replaceable(path: Path) -> bool:
    """Tell a regular file, or a place for one, from a device or pipe, which a rename would replace."""
    try:
        kind = path.stat().st_mode
    except FileNotFoundError:
        return True
    except OSError as error:
        raise _unwritable(path, error.strerror or str(error)) from None
    if stat.S_ISDIR(kind):
        raise _unwritable(path, "a folder")
    return stat.S_ISREG(kind)


def _unwritable(path: Path, came: str) -> InputError:
    todo = "choose another place, or make the folder" if "No such" in came else "choose another place"
    return InputError(path, wanted="a file that can be written", came=came[:1].lower() + came[1:], todo=todo)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
