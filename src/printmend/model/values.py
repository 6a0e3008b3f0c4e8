"""Checked values of a saved model; a bad one raises `ModelError`."""

from collections.abc import Mapping
from typing import Any, NoReturn

import numpy as np

from printmend.errors import ModelError
from printmend.messages import say

LARGEST = 1e5  # no number of a model is larger, in whatever unit: 100 m
TODO = say("learn-again-printmend-learn-trace-csv")


def rising(lower_mm: np.ndarray, upper_mm: np.ndarray, subject: str) -> tuple[np.ndarray, np.ndarray]:
    """Return two tables that never fall, lower ≤ upper; refuse others.

    They were rounded to 1e-9 mm, so a flat stretch may go back by that much.
    """
    falling = min(np.diff(lower_mm).min(), np.diff(upper_mm).min()) < -3e-9
    if falling or (upper_mm - lower_mm).min() < -3e-9:
        refuse(subject, say("tables-never-fall-lower-upper"), say("others"))
    lower = np.maximum.accumulate(lower_mm)
    return lower, np.maximum(np.maximum.accumulate(upper_mm), lower)


def rounded(value: Any) -> Any:
    """Round to 1e-9 mm: a thousand times finer than anything a machine does."""
    return np.round(value, 9).tolist() if isinstance(value, np.ndarray) else round(float(value), 9)


def section_of(document: Mapping[str, Any], key: str, kind: type, subject: str) -> Any:
    """Return a value of a kind; refuse another."""
    if not isinstance(value := document.get(key), kind):
        refuse(subject, say("as-2", key, kind.__name__), say("none") if value is None else repr(value)[:40])
    return value


def number(section: Mapping[str, Any], key: str, subject: str, most: float = LARGEST) -> float:
    """Return a number up to ``most``."""
    value = section.get(key)
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not is_number or not abs(value) <= most:  # type: ignore[arg-type]
        refuse(subject, say("number", key), say("none") if value is None else repr(value)[:40])
    return float(value)  # type: ignore[arg-type]


def numbers(section: Mapping[str, Any], key: str, subject: str, most: int) -> np.ndarray:
    """Return a list of at most ``most`` numbers up to `LARGEST`."""
    values = section.get(key)
    if not isinstance(values, list) or len(values) > most:
        refuse(
            subject,
            say("list-numbers-most", most, key),
            say("none") if values is None else say("something-else"),
        )
    if not set(map(type, values)) <= {int, float}:
        refuse(subject, say("numbers", key), say("something-else"))
    if values and not -LARGEST <= min(values) <= max(values) <= LARGEST:  # JSON's integers may be beyond any float
        refuse(subject, say("numbers-up", f"{LARGEST:g}", key), say("others"))
    return np.array(values, float)


def refuse(subject: str, wanted: str, came: str) -> NoReturn:
    """Raise `ModelError` for a value that printmend never writes."""
    raise ModelError(subject, wanted=wanted, came=came, todo=TODO)
