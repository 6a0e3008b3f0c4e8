"""What every event of a print must keep: a homing, a refit, a filament."""

import pytest

from printmend.corruption import EVENTS
from printmend_lab.conformance.events import CHECKS, EventCandidate
from tests.conformance import broken_by


@pytest.mark.parametrize("name", sorted(EVENTS))
def test_keeps_what_an_event_must(name: str) -> None:
    assert broken_by(EventCandidate(name), CHECKS) == {}
