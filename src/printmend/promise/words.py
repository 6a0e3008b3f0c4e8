"""The causes of an expected error in an owner's words, and of which type each is (JCGM 100:2008, 4.2 and 4.3)."""

from collections.abc import Mapping

from printmend.effects import title_of
from printmend.messages import say, together

# key of `Promise.made_of` → (in a line, in a table, type): type A is from the scatter of the measurement, B is not
_CAUSES = {
    "parameters": (say("cause-parameters"), say("budget-parameters"), "A"),
    "scatter": (say("cause-scatter"), say("budget-scatter"), "A"),
    "homing": (say("cause-homing"), say("budget-homing"), "B"),
    "instrument": (say("cause-instrument"), say("budget-instrument"), "B"),
    "motion": (say("cause-motion"), say("budget-motion"), "B"),
    "rounding": (say("cause-rounding"), say("budget-rounding"), "B"),
    "planning": (say("cause-planning"), say("budget-planning"), "B"),
}  # fmt: skip
_LEAST_MM, _LEAST_SHARE = 0.0005, 0.25  # a smaller cause, or share of the largest one, is not said in a line


def in_a_table(cause: str) -> tuple[str, str]:
    """Return a cause in words, and its type; an effect that does not act is called as it calls itself."""
    if cause in _CAUSES:
        return _CAUSES[cause][1:]
    return say("cause-misfit", in_words(cause)), "A"


def in_words(cause: str) -> str:
    """Return a cause in a few words."""
    return _CAUSES[cause][0] if cause in _CAUSES else title_of(cause) or cause.replace("_", " ")


def in_a_line(made_of: Mapping[str, float]) -> str:
    """Return what an expected error is made of, the largest first: ``the scanner 0.004; micro-steps 0.001``."""
    shares = sorted(made_of.items(), key=lambda item: -item[1])
    least_mm = max(_LEAST_MM, _LEAST_SHARE * max(made_of.values(), default=0.0))
    return together(
        "; ", [say("cause-of-mm", in_words(name), f"{share:.3f}") for name, share in shares if share >= least_mm]
    )
