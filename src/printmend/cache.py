"""Where compiled kernels are kept when neither the program's folder nor the user's cache can be written to.

Numba keeps them beside the sources, else in the user's cache, else it refuses to start. A system-wide installation used
by an account without a home is such a case. What is kept is executed later, so that a folder which others can write to
is never used.
"""

import os
import stat
import tempfile
from pathlib import Path


def kernel_folder(program: Path, cache: Path, temporary: Path) -> Path | None:
    """Return the folder to keep kernels in, None where numba's own choice works.

    ``program`` is the package's folder, ``cache`` the user's cache, ``temporary`` the system's temporary folder.
    """
    if os.access(program, os.W_OK) or _can_make(cache / "numba"):
        return None
    place = temporary / f"printmend-{os.getuid()}"
    if _can_make(place) and _is_private(place):
        return place
    return Path(tempfile.mkdtemp(prefix="printmend-", dir=temporary))


def user_cache() -> Path:
    """Return the folder for what the user's programs keep."""
    return Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"))


def _can_make(folder: Path) -> bool:
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK)


def _is_private(folder: Path) -> bool:
    found = folder.lstat()
    return stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o077
