"""Plans for other objectives than the RMSE: the kernels against slow versions, and never worse by the objective."""

from pathlib import Path

import numpy as np
import pytest
import shapely

from printmend.bench.objectives import objective_cases, objectives_table
from printmend.control.kernels import refine as kernels
from printmend.control.objective import OBJECTIVES, Objective, _Search, objective_value
from printmend.control.registry import controller
from printmend.corruption import sample
from printmend.learn.mechanism_model import MechanismModel
from printmend.printer import Printer, read_printer
from printmend.twin import Twin
from tests import naive_refine
from tests.bodies import write_vase
from tests.shapes import layer_along, ring_layer

LAYER = ring_layer((530.0, 530.0), 30.0)
ZIGZAG = layer_along(np.array([[530, 530], [540, 534], [529, 529], [531, 533]]))
_KINDS = {"rmse": kernels.RMSE, "p95": kernels.P95, "area": kernels.AREA, "frechet": kernels.FRECHET}


@pytest.mark.parametrize(("preset", "family"), [("ender5", "pulley-loose"), ("corexy", "everything")])
@pytest.mark.parametrize("objective", list(_KINDS))
def test_one_pass_is_the_slow_pass(objective: str, preset: str, family: str) -> None:
    """The kernel runs the machine only as far as an edit reaches; the slow version prints everything again."""
    model = MechanismModel(sample(family, np.random.default_rng(5)).lower(read_printer(preset)))
    apart = (1, 2, 3, 4, 6, 9)
    start, wanted = ZIGZAG.start_steps, ZIGZAG.nominal_steps.astype(float)
    plan = controller("lookahead").plan(model, wanted[1:], start)
    tables = model.tabulate(start)
    state = _Search.of(model, tables, plan, start)  # type: ignore[arg-type]
    kept = state.go(_KINDS[objective], wanted, tables, 0.4, 3)  # type: ignore[arg-type]
    slow = naive_refine.refine(
        objective, wanted, plan.controls.astype(int), lambda controls: Twin(model.mechanism).run(controls, start),
        0.4, 3, apart,
    )  # fmt: skip
    np.testing.assert_array_equal(state.controls[1:], slow)
    assert kept > 0 or objective != "area"
    np.testing.assert_allclose(state.bed, Twin(model.mechanism).run(slow, start), rtol=0, atol=1e-9)


@pytest.mark.parametrize("objective", OBJECTIVES)
@pytest.mark.parametrize("preset", ["ender5", "corexy"])
def test_never_worse_by_its_objective(objective: Objective, preset: str) -> None:
    model = MechanismModel(sample("pulley-loose", np.random.default_rng(6)).lower(read_printer(preset)))
    wanted = LAYER.nominal_steps.astype(float)
    values = {}
    for name in ("optimal", f"optimal-{objective}"):
        plan = controller(name).plan(model, wanted[1:], LAYER.start_steps)
        values[name] = objective_value(objective, wanted, plan.imagined_steps)
    assert values[f"optimal-{objective}"] <= values["optimal"]
    if objective == "area":
        assert values["optimal-area"] < 0.98 * values["optimal"]


def test_no_small_edit_improves_the_optimum(ender5: Printer) -> None:
    """A search for the RMSE finds nothing that dynamic programming has missed."""
    model = MechanismModel(sample("pulley-loose", np.random.default_rng(7)).lower(ender5))
    start, wanted = LAYER.start_steps, LAYER.nominal_steps.astype(float)
    tables = model.tabulate(start)
    state = _Search.of(model, tables, controller("optimal").plan(model, wanted[1:], start), start)  # type: ignore[arg-type]
    assert state.go(kernels.RMSE, wanted, tables, 0.0, 3) == 0  # type: ignore[arg-type]


def test_the_leash(rng: np.random.Generator) -> None:
    wanted = np.cumsum(rng.integers(-1, 2, (60, 2)), axis=0).astype(float)
    printed = wanted + rng.normal(0, 1.5, wanted.shape)
    short = kernels.leash(wanted, printed)
    assert short == pytest.approx(naive_refine.frechet(wanted, printed, kernels.LEASH))
    assert short >= shapely.frechet_distance(shapely.LineString(wanted), shapely.LineString(printed)) - 1e-9
    close = wanted + rng.normal(0, 0.1, wanted.shape)
    straight = np.stack([np.arange(60.0), np.arange(60.0)], axis=1)
    late = straight[np.maximum(np.arange(60) - 3, 0)]
    late[-1] = straight[-1]
    assert kernels.leash(wanted, close) <= np.hypot(*(close - wanted).T).max() + 1e-12
    assert kernels.leash(straight, late) == pytest.approx(np.hypot(2, 2))


def test_area_forgives_most_of_what_is_early_or_late() -> None:
    line = np.stack([np.arange(20.0), np.zeros(20)], axis=1)
    assert objective_value("area", line, line + np.array([0.4, 0.0])) == pytest.approx(0.3 * 19 * 0.4**2)
    assert objective_value("area", line, line + np.array([0.0, 0.5])) == pytest.approx(19 * (0.5 + 0.3 * 0.25))


def test_the_table_measures_what_was_planned(tmp_path: Path) -> None:
    vase = write_vase(tmp_path / "vase.gcode", layers=2, radius_mm=18.0)
    options = {"severity": "damaged", "layers": 1, "seed": 2, "printer": "ender5"}
    cases = objective_cases(vase, families=["pulley-loose"], **options)
    (best, area), _ = objectives_table(cases, ["rmse", "area"], tmp_path, learner="oracle")
    assert best.rmse_mm < area.rmse_mm
    assert area.area_mm2 < best.area_mm2
    assert 0 < best.p95_mm <= best.frechet_mm
    coin = write_vase(tmp_path / "coin.gcode", layers=1, radius_mm=45.0)
    _, (failure,) = objectives_table(objective_cases(coin, families=["play"], **options), ["rmse"], tmp_path)
    assert "a layer besides" in failure.error
