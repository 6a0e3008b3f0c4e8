"""Run the suite on one candidate and say what it keeps."""

from collections.abc import Iterator
from dataclasses import dataclass

from printmend.errors import ConfigError, PrintmendError
from printmend.learn import ORACLE
from printmend.plugins import CONTROLLERS, CORRUPTIONS, LEARNERS, is_plugin, load_plugin
from printmend.plugins import EFFECTS as EFFECTS_GROUP

KINDS = ("learner", "controller", "family", "effect", "event")
_GROUPS = {"learner": LEARNERS, "controller": CONTROLLERS, "family": CORRUPTIONS, "effect": EFFECTS_GROUP}
_LONGEST = 200  # characters of a reason


@dataclass(frozen=True)
class CheckOutcome:
    """A check and what it found: ``reason`` is None where the candidate keeps it; a ``note`` says what it saw."""

    check: str
    reason: str | None
    note: str = ""


def kind_of(name: str) -> str:
    """Return which of `KINDS` a name or a place `module:NAME` is. Raise `ConfigError` for neither."""
    from printmend.corruption import EVENTS
    from printmend.effects import EFFECTS
    from printmend.learn import learner_names
    from printmend_lab.control.registry import controller_names
    from printmend_lab.sampling import families

    known = {"learner": (*learner_names(), ORACLE), "controller": controller_names(), "family": families()}
    known |= {"effect": tuple(EFFECTS), "event": tuple(EVENTS)}
    for kind in KINDS:
        if name in known[kind]:
            return kind
    if ":" not in name:
        for kind, group in _GROUPS.items():
            if is_plugin(group, name):
                return kind
        raise ConfigError(
            name, wanted="a learner, a controller, a family of faults, an effect, an event, or module:NAME",
            came="no such name", todo="correct it",
        )  # fmt: skip
    wanted = "a learner (name, fit), a controller (name, plan), an effect (terms, columns), or a function of a family"
    found = load_plugin(LEARNERS, name, wanted=wanted, has=())
    for kind, has in zip(KINDS, ("fit", "plan", "__call__", "columns"), strict=False):
        if hasattr(found, has):
            return kind
    came, todo = f"one of type {type(found).__name__}", "see `printmend.protocols` and `printmend_lab.protocols`"
    raise ConfigError(name, wanted=wanted, came=came, todo=todo)


def conformance(name: str) -> Iterator[CheckOutcome]:
    """Yield the outcome of every check on a learner, controller, family of faults, effect or event, one by one.

    What is both a family and an effect has the checks of both. Raises `ConfigError` for a name that is none of them.
    """
    kind = kind_of(name)
    if kind == "learner":
        from printmend.learn import check_model_name
        from printmend_lab.conformance import learners

        check_model_name(name)
        yield from _outcomes(learners.CHECKS, learners.LearnerCandidate(name))
    elif kind == "controller":
        from printmend_lab.conformance import controllers
        from printmend_lab.control.registry import controller

        controller(name)
        yield from _outcomes(controllers.CHECKS, controllers.ControllerCandidate(name))
    if kind == "family":
        from printmend_lab.conformance import families
        from printmend_lab.sampling import check_family

        check_family(name)
        yield from _outcomes(families.CHECKS, families.FamilyCandidate(name))
    elif kind == "event":
        from printmend_lab.conformance import events

        yield from _outcomes(events.CHECKS, events.EventCandidate(name))
    if kind in ("family", "effect"):
        from printmend.effects import EFFECTS, registered
        from printmend_lab.conformance import effects

        if kind == "effect" or name in EFFECTS:
            yield from _outcomes(effects.CHECKS, effects.EffectCandidate(registered(name)))


def _outcomes(checks: dict, candidate: object) -> Iterator[CheckOutcome]:
    for label, check in checks.items():
        try:
            note = check(candidate)
        except Exception as error:  # a plug-in may raise anything
            yield CheckOutcome(label, _said(error))
        else:
            yield CheckOutcome(label, None, note or "")


def _said(error: Exception) -> str:
    text = " ".join(str(error).split())
    if not isinstance(error, PrintmendError | AssertionError):
        text = f"{type(error).__name__}: {text}"
    return text if len(text) <= _LONGEST else text[: _LONGEST - 1] + "…"
