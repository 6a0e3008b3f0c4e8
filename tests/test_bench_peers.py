"""The script that compares all learners, on one printer and few points."""

import csv
import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest

SCRIPT = Path(__file__).parents[1] / "benchmarks" / "bench_peers.py"


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    spec = importlib.util.spec_from_file_location("bench_peers", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "bench_peers", module)  # where its dataclass looks for its types
    spec.loader.exec_module(module)
    for name, value in {"FAMILIES": ("play",), "BUDGETS": (30, 100), "COMMON_POINTS": 30, "TICKS": 60,
                        "SLOW": ("backlash+greedy",)}.items():  # fmt: skip
        monkeypatch.setattr(module, name, value)
    return module


def test_every_learner_has_the_same_points_and_judge(
    script: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out, figure = tmp_path / "peers.csv", tmp_path / "peers.png"
    names = "naive,backlash,ilc,backlash+greedy"
    given = ["--learners", names, "--out", str(out), "--figure", str(figure), "--seed", "3"]
    monkeypatch.setattr(sys, "argv", ["bench_peers.py", *given])
    script.main()
    with open(out, encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [(row["learner"], row["points"], row["noise_mm"]) for row in rows[:5]] == [
        ("naive", "30", "0.05"), ("backlash", "30", "0.05"), ("ilc", "30", "0.05"), ("backlash+greedy", "30", "0.05"),
        ("naive", "100", "0.05"),
    ]  # fmt: skip
    assert len(rows) == 3 * (2 + 2) + 1
    assert [row["planner"] for row in rows[:4]] == ["optimal", "optimal", "itself", "greedy"]
    error = {(row["learner"], row["points"], row["noise_mm"]): float(row["rmse_steps"]) for row in rows}
    assert error["naive", "30", "0.05"] == error["naive", "100", "0.05"]
    assert error["backlash", "30", "0"] <= error["naive", "30", "0.05"]
    assert {row["prints"] for row in rows if row["learner"] == "ilc"} == {"5"}
    assert figure.stat().st_size > 10_000
    printed = capsys.readouterr().out
    assert "| learner | 30 points | 100 points | s |" in printed
    monkeypatch.setattr(sys, "argv", ["bench_peers.py", *given, "--draw-only"])
    script.main()
    assert printed.partition("\n\n")[2] == capsys.readouterr().out
    head = "# command: the first run\n"
    out.write_text(head + out.read_text(encoding="utf-8"), encoding="utf-8")
    monkeypatch.setattr(sys, "argv", ["bench_peers.py", *given, "--learners", "naive"])
    script.main()  # a run of some learners
    assert printed.partition("\n\n")[2].count("\n") == capsys.readouterr().out.partition("\n\n")[2].count("\n")
    kept = out.read_text(encoding="utf-8")
    assert kept.startswith(head)
    assert kept.count("\n") == 2 + len(rows)
