"""Controllers by name. Names cost nothing: a controller's module is imported when it is asked for.

To add a controller: give its module a dict ``CONTROLLERS`` from name to controller, and add a line here. The
conformance suite then runs on it. Those of other packages need no line: `printmend.plugins`.
"""

import importlib

from printmend.errors import ConfigError
from printmend.plugins import CONTROLLERS, is_plugin, load_plugin, plugin_names
from printmend_lab.control.check import Checked
from printmend_lab.protocols import Controller

_MODULES = {
    "greedy": "printmend_lab.control.greedy",
    "lookahead": "printmend_lab.control.lookahead",
    "optimal": "printmend_lab.control.optimal",
    "beam": "printmend_lab.control.beam",
    "optimal-area": "printmend_lab.control.area",
}


def controller_names() -> tuple[str, ...]:
    """Return the names of the controllers that come with printmend."""
    return tuple(_MODULES)


def controller(name: str) -> Controller:
    """Return the controller of that name, or at that place `module:NAME`. Raise `ConfigError` where there is none."""
    if name in _MODULES:
        found: Controller = importlib.import_module(_MODULES[name]).CONTROLLERS[name]
    elif is_plugin(CONTROLLERS, name):
        found = Checked(load_plugin(CONTROLLERS, name, wanted="a controller, with name and plan", has=("name", "plan")))
    else:
        known = ", ".join((*_MODULES, *plugin_names(CONTROLLERS)))
        raise ConfigError(
            "controller", wanted=f"one of {known}, or module:NAME", came=repr(name), todo="correct the name"
        )
    return found
