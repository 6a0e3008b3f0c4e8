"""What every registered controller must keep, whatever tables the model has."""

import pytest

from printmend.conformance.controllers import CHECKS, ControllerCandidate
from printmend.control.area import LeastArea
from printmend.control.registry import controller, controller_names

PAIRS = [
    (name, check)
    for name in controller_names()
    for check in CHECKS
    # it gives the RMSE away for the area
    if not (check.startswith("prints no worse") and isinstance(controller(name), LeastArea))
]


@pytest.mark.parametrize(("name", "check"), PAIRS)
def test_keeps_what_a_controller_must(name: str, check: str) -> None:
    CHECKS[check](ControllerCandidate(name))
