"""The bench: what is drawn, what is kept, what happens when things go wrong."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from printmend.errors import ConfigError, InputError
from printmend_lab.bench.case import PAPER_ROWS, Case, Result, covering_layer, evaluate, read_results, row, run
from printmend_lab.bench.report import body_table, failure_texts, text_table
from printmend_lab.bench.table1 import cells, draw_cases, lines, set_up, table1
from printmend_lab.executor import Processes, Serial, WorkerDied, program_version
from printmend_lab.path import Body, Layer
from tests.bodies import write_vase
from tests.mortal import dies_on_two


def timeless(results: list[Result]) -> list[Result]:
    """Results without what a clock says."""
    no_times = {"learn_s": None, "plan_s": None}
    return [replace(item, values={**item.values, **no_times}) for item in results]


@pytest.fixture(scope="module")
def vases(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("vases")
    return [write_vase(folder / f"vase{i}.gcode", layers=6, radius_mm=9.0 + 2 * i) for i in range(3)]


def drawn(files: list[Path], **options: object) -> list[Case]:
    settings = {"protocol": "paper", "families": ("pulley",), "severity": "damaged", "seed": 1, **options}
    return draw_cases(files, **settings)


def test_what_is_drawn_for_a_body_does_not_depend_on_the_others(vases: list[Path], tmp_path: Path) -> None:
    families = ("pulley", "play", "gain-table")
    whole = {case.identity: case for case in drawn(vases, families=families)}
    assert len(whole) == 3
    for path in vases:
        (case,) = drawn([path], families=families)
        assert case == whole[case.identity]
    moved = tmp_path / "renamed.gcode"
    moved.write_bytes(vases[0].read_bytes())
    assert [case.identity for case in drawn([vases[0], moved])] == [drawn([moved])[0].identity]
    assert drawn([moved])[0].key("naive") == drawn([vases[0]])[0].key("naive")


def test_bodies_are_printed_on_the_printer_that_is_asked_for(vases: list[Path], tmp_path: Path) -> None:
    cases = drawn(vases[:1], printer="corexy", families=("pulley-loose",))
    _, (naive, best) = table1(cases, ("naive", "optimum"), tmp_path)
    assert naive.case.printer == "corexy"
    assert best.values["rmse_steps"] < 0.5 < naive.values["rmse_steps"]
    assert cases[0].key("naive") != drawn(vases[:1], families=("pulley-loose",))[0].key("naive")
    with pytest.raises(InputError, match="expected one of a1, aquila, corexy"):
        drawn(vases[:1], printer="teapot")


def test_limit_draws_a_prefix_of_the_seeds_order(vases: list[Path]) -> None:
    assert drawn(vases, limit=2) == drawn(vases)[:2]
    orders = {tuple(case.identity for case in drawn(vases, seed=seed)) for seed in range(8)}
    assert len(orders) > 1


def test_every_setting_that_decides_a_result_is_in_its_key(vases: list[Path]) -> None:
    case = drawn(vases[:1])[0]
    others = [
        replace(case, identity="0" * 16),
        replace(case, protocol="heldout"),
        replace(case, family="play"),
        replace(case, severity="realistic"),
        replace(case, seed=2),
    ]
    keys = {other.key("naive") for other in [case, *others]} | {case.key("oracle")}
    assert len(keys) == 7


def test_heldout_never_prints_the_training_layer_and_paper_may(vases: list[Path]) -> None:
    seen = {"paper": set(), "heldout": set()}
    for protocol, results in seen.items():
        for seed in range(6):
            (result,) = evaluate(drawn(vases[:1], protocol=protocol, seed=seed)[0], ("naive",))
            assert len(set(result.values["judged"])) == 3
            results.add(result.values["training_layer"] in result.values["judged"])
    assert seen == {"paper": {True, False}, "heldout": {False}}


def test_the_covering_layer_shows_most_of_the_motor_that_shows_less(ender5) -> None:
    """A long way on a short span teaches less than a shorter one over a turn; what is beyond a turn counts as one."""
    hatch = np.tile([[1, 0], [-1, 0]], (400, 1))
    layers = [
        Layer(n, 0.2, np.array([500, 500]), controls, np.ones(len(controls), bool))
        for n, controls in enumerate(
            (hatch, np.tile([1, 1], (150, 1)), np.tile([1, 1], (220, 1)), np.tile([1, 1], (260, 1)))
        )
    ]
    body = Body("bar", tuple(layers))
    assert body.training_layer is layers[0]
    assert covering_layer(body, ender5) is layers[3]  # both of the last show a turn; it is longer
    assert covering_layer(Body("bar", tuple(layers[:2])), ender5) is layers[1]
    assert covering_layer(Body("bar", tuple(layers[:1])), ender5) is layers[0]


def test_covered_learns_from_that_layer_and_does_not_judge_it(vases: list[Path]) -> None:
    (case,) = drawn(vases[:1], protocol="covered")
    stand = set_up(case)
    assert len(stand.layers) == 3


def test_a_seed_repeats_every_row(vases: list[Path]) -> None:
    case = drawn(vases[:1])[0]
    first = evaluate(case, PAPER_ROWS)
    again = [name for name in PAPER_ROWS if name in ("naive", "lightgbm", "greybox+optimal", "oracle")]
    assert len(again) >= 3
    assert timeless(evaluate(case, again)) == [item for item in timeless(first) if item.row in again]
    assert all(result.error is None for result in first)
    errors = {result.row: result.values["rmse_steps"] for result in first}
    assert errors["oracle"] < errors["naive"]
    assert first[0].values["rmse_mm"] == pytest.approx(0.2 * errors["naive"])


def test_a_second_run_evaluates_nothing_and_an_interrupted_one_goes_on(vases: list[Path], tmp_path: Path) -> None:
    path, cases = tmp_path / "table1.jsonl", drawn(vases)
    whole = run(cases, ("naive", "oracle"), tmp_path, Serial())
    assert len(whole) == 6
    text = path.read_text()
    evaluated = []

    def counted(case: Case, rows: tuple[str, ...]) -> list[Result]:
        evaluated.append((case.source, rows))
        return evaluate(case, rows)

    assert run(cases, ("naive", "oracle"), tmp_path, Serial(), evaluate=counted) == whole
    assert not evaluated
    # The machine went down in the middle of the fourth line.
    kept = text.splitlines(keepends=True)
    path.write_text("".join(kept[:3]) + kept[3][:40])
    again = run(cases, ("naive", "oracle"), tmp_path, Serial(), evaluate=counted)
    assert timeless(again) == timeless(whole)
    assert evaluated == [(cases[1].source, ("oracle",)), (cases[2].source, ("naive", "oracle"))]
    assert len(read_results(path)) == 6
    # More rows on the same bodies: only the new row runs.
    evaluated.clear()
    run(cases, ("naive", "optimum", "oracle"), tmp_path, Serial(), evaluate=counted)
    assert [rows for _, rows in evaluated] == [("optimum",)] * 3


def test_a_plug_in_that_is_edited_during_a_run_does_not_end_it(
    vases: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    code = ["first"]
    monkeypatch.setattr("printmend_lab.bench.case.code_digest", lambda *what, **how: code[0])

    def edited(case: Case, rows: tuple[str, ...]) -> list[Result]:
        code[0] = "second"
        return [Result(case, row, {"rmse_steps": 1.0}) for row in rows]

    found = run(drawn(vases[:2]), ("naive",), tmp_path, Serial(), evaluate=edited)
    assert [item.value("rmse_steps") for item in found] == [1.0, 1.0]


def test_results_that_are_something_else_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "results.jsonl"
    path.write_text('{"a": 1}\n')
    with pytest.raises(InputError, match="line 1"):
        read_results(path)


def test_processes_give_what_serial_gives(vases: list[Path], tmp_path: Path) -> None:
    cases = drawn(vases[:2])
    here = run(cases, ("naive", "lightgbm-axis"), tmp_path / "a", Serial())
    there = run(cases, ("naive", "lightgbm-axis"), tmp_path / "b", Processes(2))
    assert timeless(here) == timeless(there)


def test_a_killed_worker_costs_its_own_item_only() -> None:
    outcome = dict(Processes(2).map(dies_on_two, range(5)))
    assert isinstance(outcome.pop(2), WorkerDied)
    assert outcome == {0: 0, 1: 1, 3: 3, 4: 4}


def test_a_broken_body_is_a_failure_with_its_reason(vases: list[Path], tmp_path: Path) -> None:
    broken = tmp_path / "broken.gcode"
    broken.write_text("M104 S200\n")
    table, results = table1(drawn([broken, vases[0]]), ("naive", "oracle"), tmp_path / "out")
    assert [(line.bodies, line.failures) for line in table] == [(1, 1), (1, 1)]
    assert cells(table[0])[1] == "1 of 2"
    (text,) = failure_texts(results)
    assert text.startswith("broken (naive, oracle): ")
    one_layer = write_vase(tmp_path / "coin.gcode", layers=1, radius_mm=45.0)
    (result,) = evaluate(drawn([one_layer], protocol="heldout")[0], ("naive",))
    assert "a layer besides the training layer" in result.error


def result(body: str, name: str, rmse: float | None) -> Result:
    case = Case("table1", body, body, "play", "damaged", "paper", 0)
    if rmse is None:
        return Result(case, name, error="no reason")
    return Result(
        case, name, {"rmse_steps": rmse, "rmse_mm": 0.2 * rmse, "learn_s": 0.5, "plan_s": 0.1, "targets": 100}
    )


def test_cases_that_failed_alike_are_told_once() -> None:
    failed = [result(body, name, None) for body in "abcde" for name in ("naive", "mine")]
    assert failure_texts([*failed, result("f", "naive", 1.0), result("g", "naive", None)]) == [
        "a, b, c and 2 more (naive, mine): no reason", "g (naive): no reason",
    ]  # fmt: skip


def test_the_lines_of_the_table_are_the_statistics_of_its_bodies() -> None:
    results = [result(f"b{i}", "naive", 10.0 * i) for i in range(1, 5)]
    results += [result(f"b{i}", "oracle", 0.5) for i in range(1, 4)] + [result("b4", "oracle", None)]
    naive, oracle = lines(results, ("naive", "oracle"))
    assert naive.abrmse_steps == 25
    assert naive.abrmse_mm == 5
    assert naive.median_steps == 25
    assert naive.p95_steps == pytest.approx(np.percentile([10, 20, 30, 40], 95))
    assert naive.ratio_to_oracle == pytest.approx(20 / 0.5)
    assert naive.targets_s == pytest.approx(1000)
    assert (oracle.bodies, oracle.failures, oracle.ratio_to_oracle) == (3, 1, 1.0)
    (nothing,) = lines([result("b4", "forest", None)], ("forest",))
    assert cells(nothing) == ("forest", "0 of 1", "–", "–", "–", "–", "–", "–", "–")
    assert body_table(results, ("naive", "oracle")).splitlines()[-1].split() == ["b4", "40.000000", "–"]


def test_a_plain_table_lines_up() -> None:
    assert text_table(("a", "n"), [("long name", "1"), ("b", "22")]) == "a           n\nlong name   1\nb          22"


def test_unknown_names_are_refused_before_anything_is_written(vases: list[Path], tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"learner: .*crystal-ball"):
        table1(drawn(vases[:1]), ("naive", "crystal-ball"), tmp_path / "out")
    with pytest.raises(InputError, match=r"family: .*gremlins"):
        drawn(vases, families=("gremlins",))
    with pytest.raises((InputError, ConfigError)):
        row("naive+hope")
    assert not (tmp_path / "out").exists()


def test_every_result_is_one_line_of_json(vases: list[Path], tmp_path: Path) -> None:
    table1(drawn(vases[:1]), ("naive",), tmp_path / "out")
    (line,) = (tmp_path / "out" / "table1.jsonl").read_text().splitlines()
    record = json.loads(line)
    assert (record["row"], record["code"]) == ("naive", program_version())
    assert Result.of(record).flat() == record
    assert (tmp_path / "out" / "figure6-pulley-paper.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.skipif(shutil.which("prusa-slicer") is None, reason="PrusaSlicer is not on PATH")
def test_a_mesh_is_sliced_once_for_all_runs(tmp_path: Path) -> None:
    cube = tmp_path / "cube.stl"
    trimesh.creation.box((16, 16, 2)).export(cube)
    (case,) = drawn([cube], sliced=tmp_path / "sliced")
    (first,) = evaluate(case, ("naive",))
    (gcode,) = (tmp_path / "sliced").iterdir()
    written = gcode.stat().st_mtime_ns
    (second,) = evaluate(replace(case, protocol="heldout"), ("naive",))
    assert (first.error, second.error) == (None, None)
    assert gcode.stat().st_mtime_ns == written
    assert case.key("naive") == drawn([cube])[0].key("naive")
