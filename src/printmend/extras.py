"""Which extra brings a library that is not installed, asked before the work begins."""

import json
import shlex
import sys
from collections.abc import Iterable
from importlib.metadata import PackageNotFoundError, distribution
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import urlsplit

from printmend.errors import MissingToolError
from printmend.messages import say

# pyproject.toml and lab/pyproject.toml say what each extra installs.
_EXTRAS = {
    "numba": "compile",
    "cv2": "scan",
    "PIL": "scan",
    "scipy": "scan",
    "lightgbm": "trees",
    "matplotlib": "report",
    "mpl_toolkits": "report",
    "reportlab": "report",
    "lxml": "paper",
    "networkx": "paper",
    "sklearn": "paper",
    "trimesh": "paper",
    "gymnasium": "rl",
    "distributed": "cluster",
    "manifold3d": "dataset",
    "pyarrow": "dataset",
    "thingi10k": "thingi10k",
    "fastapi": "studio",
    "httpx2": "studio",
    "segno": "studio",
    "pebble": "studio",
    "platformdirs": "studio",
    "sqlalchemy": "studio",
    "uvicorn": "studio",
}
OWNERS, LABS, LAB_FOLDER = "printmend", "printmend-lab", "lab"
_LAB = {"dataset", "paper", "rl", "thingi10k"}  # extras of printmend-lab


def is_installed(module: str) -> bool:
    """Say whether a module can be imported, without importing it."""
    return find_spec(module) is not None


def install_command(modules: Iterable[str]) -> str:
    """Return the command that installs the extras of these modules."""
    extras = {_EXTRAS[module] for module in modules}
    asked = ((OWNERS, extras - _LAB), (LABS, extras & _LAB))
    return _pip(*(f"{_source(name)}[{','.join(sorted(some))}]" for name, some in asked if some))


def lab_command() -> str:
    """Return the command that installs the researchers' package."""
    return _pip(_source(LABS))


def _pip(*wanted: str) -> str:
    return shlex.join([sys.executable, "-m", "pip", "install", *wanted])


def _source(name: str) -> str:
    """Return what pip can install a package from: where it came from (PEP 610) if that is there, else its name.

    The researchers' package is beside the owners', in the same copy of the repository.
    """
    from urllib.request import url2pathname  # which imports all of HTTP

    for installed, folder in ((name, ""), (OWNERS, LAB_FOLDER if name == LABS else "")):
        try:
            came = json.loads(distribution(installed).read_text("direct_url.json") or "{}").get("url", "")
        except PackageNotFoundError:
            continue
        place = Path(url2pathname(urlsplit(came).path), folder)
        if came.startswith("file:") and place.exists():
            return str(place)
    return name


def require(subject: str, *modules: str) -> None:
    """Raise `MissingToolError` that names every one of these modules that is not installed, and one command for all.

    A command calls this first: what it needs at its end must not be missed there.
    """
    if missing := [module for module in modules if not is_installed(module)]:
        came = say("installation-without" if len(missing) == 1 else "installation-without-them")
        raise MissingToolError(subject, wanted=", ".join(missing), came=came, todo=install_command(missing))


def missing_extra(error: ImportError) -> MissingToolError | None:
    """Return in words which extra is missing, None where the module that cannot be imported is of none."""
    module = (error.name or "").partition(".")[0]
    if module not in _EXTRAS or not isinstance(error, ModuleNotFoundError):
        return None
    whose = LABS if _EXTRAS[module] in _LAB else OWNERS
    return MissingToolError(
        module, wanted=say("extra", repr(_EXTRAS[module]), whose), came=say("installation-without"),
        todo=install_command([module]),
    )  # fmt: skip
