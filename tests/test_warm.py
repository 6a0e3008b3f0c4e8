"""`printmend warm`: what would be compiled when a command first needs it is compiled before."""

import importlib

from click.testing import CliRunner

from printmend.cli.warm import command
from printmend.mend.warm import STEPS, warm


def test_what_was_warmed_is_not_compiled_again(monkeypatch):
    learned = []
    # learning takes seconds when all is compiled, and has its own tests
    room = importlib.import_module("printmend.mend.warm")
    monkeypatch.setattr(room, "learn_model", lambda *of: learned.append(of))
    steps = []
    warm(steps.append)
    assert steps == list(STEPS)
    assert all(len(trace.commanded_mm) > 100 for trace, _ in learned)
    screw = {step: of for step, of in STEPS.items() if "screw" in step}  # either will do to see that nothing is left
    monkeypatch.setattr(room, "STEPS", screw)
    said = CliRunner().invoke(command)
    assert said.exit_code == 0
    assert said.stdout == "Nothing to do: everything is compiled for this machine.\n"
    assert len(learned) == 3
