"""Checks of corruption values, made once when a value is built."""

import math
from typing import NoReturn

from printmend.errors import ConfigError
from printmend.messages import say


def refuse(value: object, wanted: str, came: str) -> NoReturn:
    """Raise a `ConfigError` that names the corruption's kind."""
    kind = getattr(value, "kind", type(value).__name__)
    raise ConfigError(say("subject-corruption", repr(kind)), wanted=wanted, came=came, todo=say("correct-value"))


def in_range(value: object, **limits: tuple[float, float]) -> None:
    """Check that the named fields are finite numbers (or tuples of them) within their limits; None passes."""
    for name, (low, high) in limits.items():
        field = getattr(value, name)
        if isinstance(field, list | tuple):
            object.__setattr__(value, name, tuple(field))
            items = tuple(field)
        else:
            items = () if field is None else (field,)
        for item in items:
            number = isinstance(item, int | float) and not isinstance(item, bool)
            if not number or not low <= item <= high or not math.isfinite(item):
                refuse(value, say("within", name, f"{low:g}", f"{high:g}"), repr(item))


def whole_in_range(value: object, **limits: tuple[int, int]) -> None:
    """Check that the named fields are whole numbers within their limits."""
    for name, (low, high) in limits.items():
        field = getattr(value, name)
        if not isinstance(field, int) or isinstance(field, bool) or not low <= field <= high:
            refuse(value, say("whole-number-from", name, low, high), repr(field))
