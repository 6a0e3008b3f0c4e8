"""Which settings a firmware gets, by what the drawn machines have: laws of `export.supported`."""

import numpy as np
import pytest

from printmend.errors import RefusedError
from printmend.export.supported import export_supported
from printmend.infer.machine import DRAWS, Part, machine_of
from printmend.model import SavedModel, saved_model
from printmend.promise.belief import belief_section, parse_belief
from tests.believed import SCENES, part


def model_of(preset: str, parts: list[Part]) -> SavedModel:
    scene = SCENES[preset]
    mechanism, _ = machine_of(scene, [each.acting() for each in parts])
    return saved_model(mechanism, learner="test", findings=("",), details={"promise": belief_section(scene, parts)})


def with_sd(one: Part, sd_mm: float) -> Part:
    """Return a part whose drawn sizes scatter by ``sd_mm``."""
    draws = one.draws_mm.mean(axis=1, keepdims=True) + sd_mm * np.random.default_rng(4).standard_normal((1, DRAWS))
    return Part(one.effect, one.where, one.shape, one.acts_mm, draws)


def test_a_setting_is_written_where_its_fault_is_known() -> None:
    model = model_of("ender3", [part("scale", 0, [0.4]), part("play", 1, [0.3]), part("skew", 0, [0.5])])
    assert parse_belief(model) is not None
    export = export_supported(model, "marlin")
    assert set(export.settings) == {"scale of X", "backlash of Y", "skew"}
    assert export.after_mm < 0.1 * export.before_mm


@pytest.mark.parametrize(("effect", "name"), [("scale", "scale of X"), ("play", "backlash of X"), ("skew", "skew")])
def test_what_some_machines_do_not_have_is_not_written(effect: str, name: str) -> None:
    there = np.arange(DRAWS) >= DRAWS // 8  # so 12 of 100 have none
    sure, maybe = part("play", 1, [0.3]), part(effect, 0, [0.4], there=there)
    export = export_supported(model_of("ender3", [sure, maybe]), "marlin")
    assert export.settings == ("backlash of Y",)
    certain = export_supported(model_of("ender3", [sure, part(effect, 0, [0.4])]), "marlin")
    assert name in certain.settings


def test_what_the_instrument_may_have_made_is_refused() -> None:
    doubted = with_sd(part("scale", 0, [0.4]), 0.3)
    with pytest.raises(RefusedError, match="not known well enough"):
        export_supported(model_of("ender3", [doubted]), "klipper")


def test_two_motors_of_unlike_scales_are_no_skew() -> None:
    unlike = [part("scale", 0, [0.5]), part("scale", 1, [-0.3])]
    for parts in (unlike, [*unlike, part("skew", 0, [0.4], there=np.arange(DRAWS) % 2 == 0)]):
        export = export_supported(model_of("corexy", parts), "marlin")
        assert "skew" not in export.settings
        assert "M852 I" not in dict(export.files)["marlin.gcode"]
    lean = export_supported(model_of("corexy", [part("skew", 0, [0.5])]), "marlin")
    assert lean.settings == ("skew",)


def test_a_bent_frame_is_no_skew() -> None:
    cubic = [0.0] * 14
    cubic[6] = 0.4  # x by the cube of y, whose secant leans
    model = model_of("ender3", [part("bent", 0, cubic), part("play", 0, [0.3])])
    assert "skew" not in export_supported(model, "marlin").settings


def test_what_comes_again_and_no_setting_takes_is_doubt() -> None:
    play = part("play", 0, [0.3])
    without = export_supported(model_of("ender3", [play]), "marlin").doubt_mm
    racks = export_supported(model_of("ender3", [play, part("racking", 0, [0.3, 0.0])]), "marlin").doubt_mm
    assert racks > without + 0.02
