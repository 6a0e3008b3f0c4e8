"""The effects that a corruption can name, each with a line about it and an example."""

import inspect
import math
import sys

from printmend.corruption.cause import named_keys, offered
from printmend.effects import EFFECTS
from printmend.effects.effect import Effect, Term
from printmend.effects.keys import AXES, Keys, limits_of

MOST_SHOWN = 2  # sizes in an example


def listing() -> list[tuple[str, str, str]]:
    """Return each effect with what it is, in a line, and an example of a text for `cause_of`."""
    return [(name, said(effect), example_of(name)) for name, effect in EFFECTS.items()]


def said(effect: Effect) -> str:
    """Return the first line of what is written over an effect, its file's where that is of it alone."""
    module = sys.modules.get(type(effect).__module__)
    text = inspect.getdoc(module) if module is not None and module.__name__.startswith("printmend.effects.") else None
    line = (text or inspect.getdoc(type(effect)) or effect.name).splitlines()[0]
    return line.partition(" (physics.md")[0].partition(" (eq.")[0].rstrip(".:")


def example_of(name: str) -> str:
    """Return a text for `cause_of`: an effect with one of the shapes that its terms have."""
    effect = EFFECTS[name]
    keys, terms = named_keys(effect), offered(effect)
    items = ["on=x"] if len({term.where for term in terms}) > 1 else []
    terms = [term for term in terms if term.where == terms[0].where]
    shape = typical_shape(keys, terms)
    sizes = [key for key in keys.names if key not in shape and key not in ("phase_rad", "harmonic")]
    for key, value in shape.items():
        items.append(f"{key}={AXES[int(value)] if key == 'axis' else format(value, '.3g')}")
    room_mm = shape.get("period_mm", math.inf) / 20  # a wave that leaves the belt moving forwards
    items += [f"{key}={min(limits_of(key)[2], room_mm):.3g}" for key in sizes[:MOST_SHOWN]]
    return f"{name}:{','.join(items)}"


def typical_shape(keys: Keys, terms: list[Term]) -> dict[str, float]:
    """Return the numbers of a shape that an effect often has, by their keys."""
    return dict(zip(getattr(keys, "shape", ()), terms[len(terms) // 4].shape if terms else (), strict=False))
