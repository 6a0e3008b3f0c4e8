"""The loop that chooses its own test prints: it stops at its promise, and looks no further than it must."""

import json
from pathlib import Path

import numpy as np
from click.testing import CliRunner

from printmend.cli.main import group
from printmend.printer import read_printer
from printmend_lab.demo import curiosity
from printmend_lab.sampling import sample

PRINTER = read_printer("ender5")
BROKEN = sample("pulley-loose", np.random.default_rng(3))


def test_it_goes_on_until_the_promise_is_met() -> None:
    one = curiosity.run_way("active", PRINTER, BROKEN, promise_mm=0.2, rounds=4, seed=3)
    assert len(one) == 1
    assert one[0].promised_mm <= 0.2
    more = curiosity.run_way("active", PRINTER, BROKEN, promise_mm=0.03, rounds=4, seed=3)
    assert more[0] == one[0], "equal seeds print the same"
    assert more[-1].promised_mm <= 0.03 < more[-2].promised_mm
    assert more[-1].error_mm < 0.12, "twice the promise"
    assert more[-1].minutes > more[0].minutes > 0


def test_the_command_compares_and_draws(tmp_path: Path) -> None:
    arguments = ["curiosity", "--rounds", "1", "--promise", "0.001", "-o", str(tmp_path), "--json"]
    done = CliRunner().invoke(group, arguments, catch_exceptions=False)
    ways = json.loads(done.stdout)["ways"]
    assert list(ways) == list(curiosity.WAYS)
    assert all(len(rounds) == 1 and rounds[0]["error_mm"] > 0 for rounds in ways.values())
    assert (tmp_path / "curiosity.png").stat().st_size > 10_000
