"""What everything registered must keep: the checks of `printmend conformance`, and what only tests can see."""

from collections.abc import Callable, Mapping
from typing import TypeVar

Candidate = TypeVar("Candidate")


def broken_by(candidate: Candidate, checks: Mapping[str, Callable[[Candidate], None]]) -> dict[str, str]:
    """Return what a candidate says to each check that it does not keep: {} where it keeps all.

    One test runs all checks of a candidate, so that what it learned or printed is made once.
    """
    broken = {}
    for label, check in checks.items():
        try:
            check(candidate)
        except Exception as error:
            broken[label] = f"{type(error).__name__}: {error}"
    return broken
