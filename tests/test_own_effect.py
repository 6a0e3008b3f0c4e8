"""An effect of one's own, from outside the package: docs/adding_an_effect.md is run, and what it learns is judged."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from printmend import effects
from printmend.cli.terminal import Terminal
from printmend.cli.twin import command as twin
from printmend.diagnosis.advice import advise
from printmend.diagnosis.named import faults_of, misfits_of
from printmend.effects import EFFECTS
from printmend.errors import ConfigError, ModelError
from printmend.infer.machine import DRAWS, Part
from printmend.infer.posterior import posterior_of
from printmend.measure.table import read_trace
from printmend.messages import GERMAN
from printmend.model import saved_model
from printmend.plugins import EFFECTS as GROUP
from printmend.printer import read_printer
from printmend.promise.belief import belief_section, parse_belief
from printmend_lab.conformance.effects import CHECKS, EffectCandidate
from tests.conformance import broken_by
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
    fit = page["fit"]
    parts = posterior_of(fit, np.random.default_rng(0)).parts
    (kink,) = [fault for fault in faults_of(parts, fit.scene) if fault.kind == "kink"]
    assert abs(kink.value - 0.2) < 4 * kink.sd + 1e-3
    assert not misfits_of(parts, fit.scene)
    one = advise(kink)
    assert one.title == "X belt is kinked"
    assert one.effect_mm == pytest.approx(kink.value)


def test_an_effect_of_ones_own_is_made_by_the_command_line_and_by_toml(page: dict[str, Any], tmp_path: Path) -> None:
    gcode, broken = tmp_path / "part.gcode", tmp_path / "broken.toml"
    moves = "\n".join(f"G1 X{x} Y100 E1" for x in (*range(20, 200, 4), *range(200, 20, -4)))
    gcode.write_text(f"G28\nG90\nM83\nG1 Z0.2 F3000\n{moves}\n")
    keys = page["KINKED"].partition(":")[2].replace(",", "\n").replace("=x", "='x'")
    broken.write_text(f"[[effect]]\nname = 'kink'\n{keys}\n")
    traces = []
    for words in (page["KINKED"], str(broken), "kink"):
        out = tmp_path / "trace.csv"
        said = [str(gcode), "--printer", "ender3", "--corruption", words, "--noise-mm", "0", "-o", str(out)]
        done = CliRunner().invoke(twin, said, catch_exceptions=False)
        assert done.exit_code == 0, done.output
        traces.append(read_trace(out, read_printer("ender3")))
        out.unlink()
    one, other, drawn = traces
    off_mm = one.measured_mm - one.commanded_mm
    bulge = 0.2 * np.exp(-0.5 * ((one.commanded_mm[:, 0] - 131) / 5.5) ** 2)
    np.testing.assert_allclose(off_mm[:, 0], bulge, atol=2e-3)  # the file has three decimals
    assert np.array_equal(one.measured_mm, other.measured_mm)
    assert np.abs(drawn.measured_mm - drawn.commanded_mm).max() > 0.01
    german = CliRunner().invoke(twin, ["--list"], obj=Terminal(GERMAN)).output
    assert "A belt that is ahead of its motor about one place" in german
    assert "refit: ein Riemen, der" in german
    assert "joint: eine Führung aus zwei Stücken" in german


def test_an_effect_of_ones_own_keeps_what_every_effect_must(page: dict[str, Any]) -> None:
    assert broken_by(EffectCandidate("kink"), CHECKS) == {}


def test_an_effect_of_ones_own_is_kept_in_the_model_file(page: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    fit = page["fit"]
    parts = posterior_of(fit, np.random.default_rng(0)).parts
    section = belief_section(fit.scene, parts)
    model = saved_model(fit.mechanism, learner="test", findings=("",), details={"promise": section})
    belief = parse_belief(model)
    assert belief is not None
    assert len(belief.of("kink", 0)) >= 1
    monkeypatch.delitem(EFFECTS, "kink")  # as where its package is not installed
    with pytest.raises(ModelError, match="found 'kink'; install the package"):
        parse_belief(model)


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
    known = {name: effect for name, effect in EFFECTS.items() if name != "kink"}
    monkeypatch.setattr(effects, "EFFECTS", known)
    monkeypatch.setattr(effects, "load_plugin", lambda group, name, **_: {(GROUP, "ours"): page["KINK"]}[group, name])
    assert effects._added("ours") == "kink"
    assert known["kink"] is page["KINK"]
    monkeypatch.setattr(page["Kink"], "name", "play")
    with pytest.raises(ConfigError, match="a name of its own"):
        effects._added("ours")
