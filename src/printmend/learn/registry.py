"""World models by name. Names cost nothing: a learner's module is imported when it is asked for.

To add a learner: give its module a dict ``LEARNERS`` from name to learner, and add a line here. The conformance suite
then runs on it.
"""

import importlib

import numpy as np

from printmend.errors import ConfigError
from printmend.machine.mechanism import GainMechanism, Mechanism
from printmend.path import Trace
from printmend.printer import Printer
from printmend.protocols import Learner, WorldModel

ORACLE = "oracle"
_TREES = "printmend.learn.published.trees"
_MODULES = {
    "naive": "printmend.learn.naive",
    "lightgbm": _TREES,
    "lightgbm-axis": _TREES,
    "lightgbm-axis-periodic": _TREES,
    "lightgbm-rolled": _TREES,
    "lightgbm-axis-rolled": _TREES,
    "forest": _TREES,
    "forest-axis": _TREES,
    "greybox": "printmend.learn.greybox.greybox",
    "prior": "printmend.learn.prior.prior",
    "hybrid": "printmend.learn.hybrid.hybrid",
}


def learner_names() -> tuple[str, ...]:
    """Return the names that `learner` takes."""
    return tuple(_MODULES)


def model_names() -> tuple[str, ...]:
    """Return the names that `fit` takes: the learners and the Oracle."""
    return (*_MODULES, ORACLE)


def learner(name: str) -> Learner:
    """Return the learner of that name. Raise `ConfigError` where there is none."""
    if name not in _MODULES:
        raise ConfigError("learner", wanted=f"one of {', '.join(_MODULES)}", came=repr(name), todo="correct the name")
    found: Learner = importlib.import_module(_MODULES[name]).LEARNERS[name]
    return found


def fit(
    name: str,
    trace: Trace,
    printer: Printer,
    *,
    rng: np.random.Generator,
    truth: Mechanism | GainMechanism | None = None,
) -> WorldModel:
    """Make the model of that name: learned from the trace, or, for ``oracle`` only, from the truth itself.

    One call for every row of a table. Raise `ConfigError` for an unknown name or an Oracle without a truth,
    `TraceError` where the trace cannot support a model.
    """
    if name != ORACLE:
        return learner(name).fit(trace, printer, rng=rng)
    if truth is None:
        raise ConfigError(ORACLE, wanted="the true mechanism", came="none", todo="use a learner on real prints")
    from printmend.learn.mechanism_model import MechanismModel

    return MechanismModel(truth)
