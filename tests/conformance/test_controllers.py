"""What every registered controller must keep, whatever tables the model has."""

from functools import cache

import pytest

from printmend.twin import Twin
from printmend_lab.conformance import controllers
from printmend_lab.conformance.controllers import CHECKS, ControllerCandidate
from printmend_lab.control.area import LeastArea
from printmend_lab.control.registry import controller, controller_names
from printmend_lab.path import Layer
from tests.conformance import broken_by

# `beam` asks `advance` thousands of times a target: one law of each kind, on a part of the layer.
BEAM_TICKS = 16
BEAM = (
    "controls to 1 lead where imagined (play)", "controls to 3 lead where imagined (corexy)",
    "controls to 1 lead where imagined (joint)", "is repeatable (increments)", "leaves a healthy ender5 alone",
    "prints what it imagines (frame, corexy)", "prints no worse than the commands (pulley-play, ender5)",
)  # fmt: skip


class Printed:
    """The twins of the checks, each made once for all controllers."""

    of = staticmethod(cache(Twin.of))


@pytest.mark.parametrize("name", controller_names())
def test_keeps_what_a_controller_must(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(controllers, "Twin", Printed)
    checks = CHECKS
    if name == "beam":
        whole = controllers.LAYER
        part = Layer(0, 0.2, whole.start_steps, whole.controls[:BEAM_TICKS], whole.extruding[:BEAM_TICKS])
        monkeypatch.setattr(controllers, "LAYER", part)
        monkeypatch.setattr(controllers, "TARGETS", part.nominal_steps[1:])
        checks = {label: check for label, check in CHECKS.items() if label in BEAM or label.startswith("refuses")}
    if isinstance(controller(name), LeastArea):  # it gives the RMSE away for the area
        checks = {label: check for label, check in checks.items() if not label.startswith("prints no worse")}
    assert broken_by(ControllerCandidate(name), checks) == {}
