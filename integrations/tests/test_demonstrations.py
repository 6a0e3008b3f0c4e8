"""The demonstrations from end to end, as their commands run them, and the examples with agents.

`make test` holds the laws of what they are made of; here is what takes ten seconds each.
"""

import json
import runpy
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from tests.bodies import write_vase
from tests.mending import SQUARE
from tests.test_demo_scan import BROKEN

from printmend.cli.main import group
from printmend.demo import part
from printmend.demo import scan as demo_scan
from printmend.printer import Printer, read_printer
from printmend_lab.env import open_loop_agent, score_agent

EXAMPLES = Path(__file__).parents[2] / "examples"


def small_printer() -> Printer:
    """An Ender-5 with a bed of 110 mm: its plate is scanned in a fraction of the time."""
    big = read_printer("ender5")
    return replace(big, x=replace(big.x, max_mm=110.0, home_mm=110.0), y=replace(big.y, max_mm=110.0, home_mm=110.0))


def test_the_chain_mends_a_part_that_nobody_learned_from(tmp_path: Path) -> None:
    ticks: list[str] = []
    done = demo_scan.run_chain(small_printer(), BROKEN, tmp_path, seed=3, part=SQUARE, tick=ticks.append)
    assert len(ticks) + 1 == demo_scan.TICKS
    assert done.missing < 0.05 * done.marks
    assert done.mark_mm < 0.08
    assert done.before.rms > 0.1
    assert done.after.rms < 0.03
    assert not done.refused
    said = "\n".join(
        demo_scan.lines(done, written := [*demo_scan.written(tmp_path), demo_scan.write_picture(done, tmp_path)])
    )
    assert "pulley eccentric" in said
    assert {"overlay.png", "before-after.png", "part.mended.gcode"} <= {path.name for path in written}
    assert all(path.stat().st_size > 1000 for path in written if path.suffix == ".png")
    assert json.loads(json.dumps(demo_scan.figures(done)))["after"]["rms"] == done.after.rms


def test_one_layer_of_a_part_is_enough(tmp_path):
    done = part.run_part(read_printer("ender5"), tmp_path, seed=0)
    assert done.before.rms > 0.15
    assert done.after.rms < 0.03
    assert part.write_figure(done, tmp_path).stat().st_size > 50_000


def test_a_printer_prints_its_own_pulley(tmp_path: Path) -> None:
    arguments = ["selfrepair", "--hull", "egg", "--generations", "1", "--both", "-o", str(tmp_path), "--json"]
    done = CliRunner().invoke(group, arguments)
    assert done.exit_code == 0, done.output
    ways = json.loads(done.stdout)["ways"]
    first, after = ways["printmend"]["rms_mm"]
    assert first > 1.0
    assert after < 0.1 < ways["as it is"]["rms_mm"][1]
    assert (tmp_path / "selfrepair.png").stat().st_size > 10_000
    assert "; printmend" in (tmp_path / "generation-1.mended.gcode").read_text()[:2000]


def test_demo_tells_the_story(tmp_path: Path) -> None:
    out_folder, vase = tmp_path / "pictures", write_vase(tmp_path / "vase.gcode", layers=4, radius_mm=9.0)
    told = CliRunner().invoke(group, ["paper", "--body", str(vase), "--out", str(out_folder)], catch_exceptions=False)
    assert (told.exit_code, told.stderr) == (0, "")
    rows = told.stdout.splitlines()[2:7]
    names = ["Naive", "LightGBM", "LightGBM per axis", "Grey box", "Oracle"]
    assert [line.split("  ")[0] for line in rows] == names
    assert "broken: X pulley eccentric, X belt play, Y pulley ellipse, Y belt play" in told.stdout
    written = ["above.png", "corruption.toml", "solid.png", "test-layer.png"]
    assert sorted(path.name for path in out_folder.iterdir()) == written
    # What was broken can be broken again.
    again = ["paper", "--body", str(vase), "--corruption", str(out_folder / "corruption.toml"), "--json"]
    second = CliRunner().invoke(group, [*again, "--out", str(out_folder)], catch_exceptions=False)
    shown = [f"{row['rmse_steps']:.3f}" for row in json.loads(second.stdout)["rows"]]
    assert shown == [line.split()[-4] for line in rows]


@pytest.fixture
def beside_examples(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", [str(EXAMPLES), *sys.path])


@pytest.mark.usefixtures("beside_examples")
def test_the_agent_that_takes_up_play_does_not_deadlock() -> None:
    returns = runpy.run_path(str(EXAMPLES / "rl_agents.py"))["returns"](envs=12, ticks=300)
    random, naive, greedy, ahead = returns.values()
    assert ahead > -1.0 > naive > greedy
    assert naive > random
    assert np.isfinite(list(returns.values())).all()


@pytest.mark.usefixtures("beside_examples")
@pytest.mark.filterwarnings("ignore")  # of jax and flax
def test_the_agent_that_is_trained_stands_beside_planning() -> None:
    pytest.importorskip("skrl", reason="the extra `agents` is not installed")
    example = runpy.run_path(str(EXAMPLES / "train_agent.py"))
    found = example["compare"](example["train"](example["ShapeEnv"](8), 64, rollouts=32), count=2)
    shape, error = zip(*found.values(), strict=True)
    assert list(found)[:2] == ["Naive", "agent"]
    assert np.isfinite([*shape, *error]).all()
    assert found["agent"] != found["Naive"]
    assert found["optimal, learned from one layer"][0] < 0.5 * found["Naive"][0]


def test_agents_of_one_print_are_trained_and_plan(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("skrl", reason="the extra `agents` is not installed")
    monkeypatch.syspath_prepend(str(EXAMPLES))
    example, printer = runpy.run_path(str(EXAMPLES / "train_one_print.py")), read_printer("ender5")
    policy = example["train"](example["AimEnv"]("play", 8, 8), 64, rollouts=32)
    reads = example["taught"]("play", 8, 1, printer, seed=1, batch=4)
    for plan in (example["ppo_plan"](policy), reads):
        found = score_agent(open_loop_agent(plan, printer), "play", scenes=2)
        assert np.isfinite(found).all()
        assert (found <= 1.0 + 1e-9).all()
        assert found.any()  # neither is Naive
