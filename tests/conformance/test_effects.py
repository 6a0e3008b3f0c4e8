"""What every effect must keep: the twin makes it by its name, and prints what its columns say."""

import pytest

from printmend.effects import EFFECTS
from printmend_lab.conformance.effects import CHECKS, EffectCandidate
from tests.conformance import broken_by

FEW_STEPS = 40  # of the chain, which has to find one effect here; `printmend conformance` takes them all


@pytest.mark.parametrize("name", sorted(EFFECTS))
def test_keeps_what_an_effect_must(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("printmend.infer.posterior.STEPS", FEW_STEPS)
    assert broken_by(EffectCandidate(name), CHECKS) == {}
