"""What every effect must keep: the twin makes it by its name, and prints what its columns say."""

import pytest

from printmend.effects import EFFECTS
from printmend_lab.conformance.effects import CHECKS, EffectCandidate
from tests.conformance import broken_by


@pytest.mark.parametrize("name", sorted(EFFECTS))
def test_keeps_what_an_effect_must(name: str) -> None:
    assert broken_by(EffectCandidate(name), CHECKS) == {}
