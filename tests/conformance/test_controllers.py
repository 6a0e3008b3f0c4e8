"""What every registered controller must keep, whatever tables the model has."""

import pytest

from printmend.conformance.controllers import CHECKS, ControllerCandidate
from printmend.control.area import LeastArea
from printmend.control.registry import controller, controller_names
from tests.conformance import broken_by


@pytest.mark.parametrize("name", controller_names())
def test_keeps_what_a_controller_must(name: str) -> None:
    checks = CHECKS
    if isinstance(controller(name), LeastArea):  # it gives the RMSE away for the area
        checks = {label: check for label, check in checks.items() if not label.startswith("prints no worse")}
    assert broken_by(ControllerCandidate(name), checks) == {}
