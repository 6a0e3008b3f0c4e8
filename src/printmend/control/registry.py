"""Controllers by name. Names cost nothing: a controller's module is imported when it is asked for.

To add a controller: give its module a dict ``CONTROLLERS`` from name to controller, and add a line here. The
conformance suite then runs on it.
"""

import importlib

from printmend.errors import ConfigError
from printmend.protocols import Controller

_MODULES = {
    "greedy": "printmend.control.greedy",
    "lookahead": "printmend.control.lookahead",
    "beam": "printmend.control.beam",
    "optimal": "printmend.control.optimal",
    **{f"optimal-{objective}": "printmend.control.objective" for objective in ("p95", "area", "frechet")},
}


def controller_names() -> tuple[str, ...]:
    """Return the names that `controller` takes."""
    return tuple(_MODULES)


def controller(name: str) -> Controller:
    """Return the controller of that name. Raise `ConfigError` where there is none."""
    if name not in _MODULES:
        raise ConfigError(
            "controller", wanted=f"one of {', '.join(_MODULES)}", came=repr(name), todo="correct the name"
        )
    found: Controller = importlib.import_module(_MODULES[name]).CONTROLLERS[name]
    return found
