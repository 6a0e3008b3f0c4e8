"""Learners, controllers, families of faults and effects of other packages.

Either by an entry point of an installed package,

    [project.entry-points."printmend.learners"]
    ours = "my_package.my_module:OURS"

(``OURS`` may also be a dict from name to learner), or by saying where it is, `my_package.my_module:OURS`, found from
the current folder too. Loading one runs its code.
"""

import importlib
import sys
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

from printmend.errors import ConfigError
from printmend.messages import say

LEARNERS, CONTROLLERS, CORRUPTIONS = "printmend.learners", "printmend.controllers", "printmend.corruptions"
EFFECTS = "printmend.effects"


def plugin_names(group: str) -> tuple[str, ...]:
    """Return the names that installed packages give in a group."""
    return tuple(sorted(_points(group)))


def is_plugin(group: str, name: str) -> bool:
    """Tell whether a name refers to another package; `module:NAME` always does."""
    return ":" in name or name in _points(group)


def place_of(group: str, name: str) -> str:
    """Return where something of another package is, as `module:NAME`."""
    return name if ":" in name else _points(group)[name].value


def load_plugin(group: str, name: str, *, wanted: str, has: tuple[str, ...]) -> Any:
    """Import the object of a name; ``wanted`` says in words what it must be, ``has`` lists the attributes that it
    needs.

    Raises `ConfigError` where it cannot be imported or is something else.
    """
    module_name, _, attribute = place_of(group, name).partition(":")
    module = imported(module_name, name)
    try:
        found = getattr(module, attribute)
    except AttributeError:
        raise ConfigError(
            name, wanted=say("key-in-section", wanted, module_name), came=say("no-such-name"), todo=say("correct")
        ) from None
    if isinstance(found, dict):
        found = found.get(name)
    missing = [key for key in has if not hasattr(found, key)]
    if missing or isinstance(found, type):
        came = say("class-would", attribute) if isinstance(found, type) else say("without", missing[0])
        raise ConfigError(name, wanted=wanted, came=came, todo=say("see-printmend-protocols"))
    return found


@cache
def _points(group: str) -> dict[str, EntryPoint]:
    return {point.name: point for point in entry_points(group=group)}


def imported(module: str, name: str) -> Any:
    """Import the module of a name. Raises `ConfigError` where it cannot be imported."""
    if "" not in sys.path and str(Path.cwd()) not in sys.path:
        sys.path.insert(0, str(Path.cwd()))  # as `python -m` does: a module of one's own lies where one works
    try:
        return importlib.import_module(module)
    except Exception as error:  # a plug-in may raise anything
        raise ConfigError(
            name, wanted=say("module-can-imported", repr(module)), came=f"{type(error).__name__}: {error}",
            todo=say("correct-install-run-where-lies"),
        ) from None  # fmt: skip
