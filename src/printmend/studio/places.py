"""The studio's folders: the owner's data, the studio's own state, and a cache that may be deleted.

The system determines where each belongs (XDG on Linux); a folder that the user names holds all three.
"""

import contextlib
import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from printmend.errors import InputError, reason
from printmend.messages import say

DATABASE, DEVICES, LOCK, ADDRESS = "studio.sqlite", "devices.json", "studio.lock", "address.json"
NOTES = (DATABASE, DEVICES, LOCK, ADDRESS)  # files in ``state``; SQLite adds others with names that begin alike
PARTS = ("printers", "uploads", "jobs")  # folders in ``data``; ``cache`` has folders for the jobs' pictures


@dataclass(frozen=True)
class Places:
    """A studio's folders: ``data`` for printers, models and parts, ``state`` for devices, the jobs' database and the
    lock, ``cache`` for small and three-dimensional pictures. They may be the same folder."""

    data: Path
    state: Path
    cache: Path

    @classmethod
    def below(cls, folder: Path) -> "Places":
        """Return one folder for everything."""
        return cls(folder, folder, folder)

    @classmethod
    def usual(cls) -> "Places":
        """Return the system's folders for a user's programs. Older studios kept their state among the data."""
        from platformdirs import PlatformDirs

        ours = PlatformDirs("printmend", appauthor=False, roaming=True)
        data, state, cache = (
            path / "studio" for path in (ours.user_data_path, ours.user_state_path, ours.user_cache_path)
        )
        return cls(data, data if any((data / name).exists() for name in (DATABASE, DEVICES)) else state, cache)

    @property
    def folders(self) -> list[Path]:
        """The different folders, each once."""
        return list(dict.fromkeys((self.data, self.state, self.cache)))

    def resolved(self) -> "Places":
        """Return the same places with absolute paths."""
        return Places(self.data.resolve(), self.state.resolve(), self.cache.resolve())

    def make(self) -> list[str]:
        """Make missing folders with access for their owner only, and restrict existing ones; return the failures.

        A folder that also holds other things keeps its rights: only the studio's own files in it are restricted. Raises
        `InputError` if nothing can be written.
        """
        try:
            for path in (*self.folders, *self._parts()):
                path.mkdir(mode=0o700, parents=True, exist_ok=True)
            for path in (self.state / DATABASE, self.state / LOCK):  # or SQLite makes them, readable by everybody
                path.touch(mode=0o600)
        except OSError as error:
            raise InputError(path, wanted=say("folder-can-be-written"), came=reason(error),
                             todo=say("terminal-name-another-folder")) from None  # fmt: skip
        own = [folder for folder in self.folders if all(map(_is_ours, folder.iterdir()))]
        notes = [path for path in self.state.iterdir() if path.is_file() and _is_ours(path)]
        return [*_close((*own, *self._parts()), 0o700), *_close(notes, 0o600)]

    def _parts(self) -> list[Path]:
        return list(dict.fromkeys((*(self.data / part for part in PARTS), self.cache / "jobs")))


def _is_ours(path: Path) -> bool:
    """Return by its name whether an item in a folder is the studio's; a half-written file begins with a dot."""
    return path.name in PARTS or path.name.lstrip(".").startswith(NOTES)


def _close(paths: Iterable[Path], mode: int) -> list[str]:
    """Let nobody but their owner use these files and folders; return those that others still can."""
    if os.name == "nt":  # rights there are no bits: a user's folder is the user's
        return []
    left = []
    for path in paths:
        with contextlib.suppress(FileNotFoundError):  # SQLite's own come and go
            if path.stat().st_mode & 0o777 != mode:
                with contextlib.suppress(OSError):
                    path.chmod(mode)
            if path.stat().st_mode & 0o077:
                left.append(str(path))
    return left
