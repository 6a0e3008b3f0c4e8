"""An effect of one's own, from outside the package: docs/adding_an_effect.md is run, and what it learns is judged."""

import re
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from printmend import effects
from printmend.diagnosis.advice import advise
from printmend.diagnosis.named import faults_of, misfits_of
from printmend.effects import EFFECTS
from printmend.errors import ConfigError
from printmend.infer.posterior import DRAWS, Part, posterior_of
from printmend.plugins import EFFECTS as GROUP
from printmend.promise.belief import belief_section, parse_belief
from printmend.saved import saved_model
from tests.test_docs import ROOT

PAGE = ROOT / "docs" / "adding_an_effect.md"


@pytest.fixture(scope="module")
def page() -> Iterator[dict[str, Any]]:
    """Run the page's blocks as one program, and yield its names."""
    names: dict[str, Any] = {"__name__": PAGE.stem}
    try:
        for block in re.findall(r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL):
            exec(compile(block, str(PAGE), "exec"), names)  # noqa: S102 — our own document
        yield names
    finally:
        EFFECTS.pop("kink", None)


def test_an_effect_of_ones_own_is_learned_named_and_mended(page: dict[str, Any]) -> None:
    fit, true = page["fit"], page["kink"]
    parts = posterior_of(fit, np.random.default_rng(0)).parts
    (kink,) = [fault for fault in faults_of(parts, fit.scene) if fault.kind == "kink"]
    assert abs(kink.value - true.sizes_mm[0]) < 4 * kink.sd + 1e-3
    assert not misfits_of(parts, fit.scene)
    one = advise(kink)
    assert one.title == "X belt is kinked"
    assert one.effect_mm == pytest.approx(kink.value)


def test_an_effect_of_ones_own_is_kept_in_the_model_file(page: dict[str, Any]) -> None:
    fit = page["fit"]
    parts = posterior_of(fit, np.random.default_rng(0)).parts
    section = belief_section(fit.scene, parts)
    model = saved_model(fit.mechanism, learner="test", findings=("",), details={"promise": section})
    belief = parse_belief(model)
    assert belief is not None
    assert len(belief.of("kink", 0)) >= 1


def test_an_effect_without_words_is_named_by_its_name(page: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    for words in ("faults", "advice"):
        monkeypatch.delattr(page["Kink"], words)
    draws = 0.2 + 0.001 * np.random.default_rng(1).standard_normal((1, DRAWS))
    (fault,) = faults_of([Part("kink", 1, (100.0, 5.0), np.array([0.2]), draws)], page["scene"])
    assert (fault.part, fault.kind) == ("y", "kink")
    assert 0 < fault.value < 0.2
    assert "kink" in advise(fault).title


def test_effects_of_other_packages_have_names_of_their_own(
    page: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(effects, "plugin_names", lambda group: ("ours",) if group == GROUP else ())
    monkeypatch.setattr(effects, "load_plugin", lambda group, name, **_: page["KINK"])
    assert effects._of_others() == {"kink": page["KINK"]}
    monkeypatch.setattr(page["Kink"], "name", "play")
    with pytest.raises(ConfigError, match="a name of its own"):
        effects._of_others()
