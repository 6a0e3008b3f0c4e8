"""On a data set in the published layout, our naive and oracle rows are the published evaluation's."""

from pathlib import Path

import numpy as np
import pytest
from tests import naive_reference
from tests.bodies import circle_body, write_vase

from printmend_lab.bench.case import evaluate
from printmend_lab.bench.table1 import reference_cases, table1
from printmend_lab.dataset.reference import export_reference, write_reference


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Small bodies in the middle of the bed and at its corners (where positions are clipped), strongly bent gains."""
    root = tmp_path_factory.mktemp("reference") / "data"
    rng = np.random.default_rng(7)
    waves = np.cos(2 * np.pi * np.arange(1100) / 200 + rng.uniform(0, 6.3, (6, 1)))
    gains = rng.uniform(0.8, 1.1, (6, 1)) + 0.3 * waves + rng.uniform(-0.02, 0.02, (6, 1100))
    bodies = [
        (circle_body("middle", 3, 25.0), (1, 2)),
        (circle_body("low corner", 3, 20.0, (24, 24)), (3, 4)),
        (circle_body("high corner", 3, 20.0, (1076, 1076)), (5, 6)),
        (circle_body("same", 1, 30.0, (500, 300)), (2, 2)),
    ]
    write_reference(root, bodies, gains)
    return root


@pytest.mark.parametrize("model", ["naive", "oracle"])
def test_each_body_and_the_mean_equal_the_literal_rules(folder: Path, model: str, tmp_path: Path) -> None:
    published = naive_reference.published_results(folder, model)
    lines, results = table1(reference_cases(folder, protocol="paper", seed=0), [model], tmp_path)
    assert {result.case.body: result.values["rmse_steps"] for result in results} == pytest.approx(published, abs=1e-9)
    assert lines[0].abrmse_steps == pytest.approx(np.mean(list(published.values())), abs=1e-9)
    assert lines[0].bodies == len(published) == 4


def test_an_export_of_real_gcode_with_three_layers_leaves_nothing_to_chance(tmp_path: Path) -> None:
    vase = write_vase(tmp_path / "vase.gcode", layers=5, radius_mm=9.0)
    export_reference(tmp_path / "data", [vase], corruptions=4, seed=2, layers=3)
    errors = []
    for seed in range(3):
        (case,) = reference_cases(tmp_path / "data", protocol="paper", seed=seed)
        (result,) = evaluate(case, ("oracle",))
        assert result.values["judged"] == [0, 2, 4]
        errors.append(result.values["rmse_steps"])
    published = naive_reference.published_results(tmp_path / "data", "oracle")["vase"]
    assert errors == pytest.approx([published] * 3, abs=1e-9)


def test_learners_read_the_printed_positions_of_the_data_set(folder: Path, tmp_path: Path) -> None:
    """A learner fitted to the CSV's training layer does better than none on the strongly bent gains."""
    cases = reference_cases(folder, protocol="paper", seed=0)
    lines, _ = table1(cases, ["naive", "forest-axis", "oracle"], tmp_path)
    naive, forest, oracle = (line.abrmse_steps for line in lines)
    assert oracle < forest < naive
