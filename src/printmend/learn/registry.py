"""World models by name; the module of a learner is imported only when it is needed.

To add a learner: give its module a dict ``LEARNERS`` from name to learner, and add a line here. The conformance suite
then runs on it. Those of other packages, printmend-lab's too, need no line: `printmend.plugins`.
"""

import importlib

import numpy as np

from printmend.errors import ConfigError, ModelError
from printmend.machine import GainMechanism, Mechanism
from printmend.messages import say
from printmend.path import Trace
from printmend.plugins import LEARNERS, is_plugin, load_plugin, plugin_names
from printmend.printer import Printer
from printmend.protocols import Learner, WorldModel

ORACLE = "oracle"
_MODULES = {
    "naive": "printmend.learn.mechanism_model",
}


def learner_names() -> tuple[str, ...]:
    """Return the names of the learners that are installed: printmend's own, then those of other packages."""
    return (*_MODULES, *plugin_names(LEARNERS))


def model_names() -> tuple[str, ...]:
    """Return the names that `fit` takes, places of plug-ins aside: the learners and the Oracle."""
    return (*learner_names(), ORACLE)


def learner(name: str) -> Learner:
    """Return the learner of that name, or at that place `module:NAME`. Raise `ConfigError` where there is none."""
    if name in _MODULES:
        found: Learner = importlib.import_module(_MODULES[name]).LEARNERS[name]
    elif is_plugin(LEARNERS, name):
        found = load_plugin(LEARNERS, name, wanted=say("learner-name-fit"), has=("name", "fit"))
    else:
        known = ", ".join(learner_names())
        raise ConfigError(
            say("subject-learner"), wanted=say("module-name", known), came=repr(name), todo=say("correct-name")
        )
    return found


def check_model_name(name: str) -> None:
    """Raise `ConfigError` for a name that `fit` does not take; a plug-in is imported to see."""
    if name not in model_names():
        learner(name)


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
        return fitted(learner(name), trace, printer, rng=rng)
    if truth is None:
        raise ConfigError(ORACLE, wanted=say("true-mechanism"), came=say("none"), todo=say("use-learner-real-prints"))
    from printmend.learn.mechanism_model import MechanismModel

    return MechanismModel(truth)


def fitted(chosen: Learner, trace: Trace, printer: Printer, *, rng: np.random.Generator) -> WorldModel:
    """Return what a learner, of any package, makes of a trace. Raise `ModelError` where that is no world model."""
    model = chosen.fit(trace, printer, rng=rng)
    if not isinstance(model, WorldModel):
        raise ModelError(
            say("subject-learner-named", chosen.name), wanted=say("model-printer-start-advance-tabulate"),
            came=type(model).__name__, todo=say("return-from-fit-see-printmend-protocols"),
        )  # fmt: skip
    return model
