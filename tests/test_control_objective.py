"""Plans for the area: the kernels against slow versions, and never worse by the area."""

from pathlib import Path

import numpy as np
import pytest

from printmend.learn.mechanism_model import MechanismModel
from printmend.printer import Printer, read_printer
from printmend.twin import Twin
from printmend_lab.bench.objectives import objective_cases, objectives_table
from printmend_lab.control.area import area_cost, planned_print
from printmend_lab.control.kernels.refine import AREA, SQUARES, Print, refine
from printmend_lab.control.registry import controller
from printmend_lab.sampling import sample
from tests import naive_refine
from tests.bodies import write_vase
from tests.shapes import layer_along, ring_layer

LAYER = ring_layer((530.0, 530.0), 30.0)
ZIGZAG = layer_along(np.array([[530, 530], [540, 534], [529, 529], [531, 533]]))
APART = (1, 2, 3, 4, 6, 9)


def searched(
    model: MechanismModel, planner: str, shares: tuple[float, float], wanted: np.ndarray
) -> tuple[np.ndarray, Print, int]:
    """The controls of a plan, what one pass makes of it, and how many edits it kept."""
    start = wanted[0].astype(int)
    plan = controller(planner).plan(model, wanted[1:], start)
    tables = model.tabulate(start)
    state = planned_print(tables, plan, model.printer.to_motor(plan.controls.astype(int)))  # type: ignore[arg-type]
    kept = refine(shares, wanted, tables.arrays, state, 3, np.array(APART))  # type: ignore[union-attr]
    return plan.controls.astype(int), state, kept


@pytest.mark.parametrize(("preset", "family"), [("ender5", "pulley-loose"), ("corexy", "everything")])
@pytest.mark.parametrize("shares", [AREA, SQUARES])
def test_one_pass_is_the_slow_pass(shares: tuple[float, float], preset: str, family: str) -> None:
    """The kernel runs the machine only as far as an edit reaches; the slow version prints everything again."""
    model = MechanismModel(sample(family, np.random.default_rng(5)).lower(read_printer(preset)))
    wanted = ZIGZAG.nominal_steps.astype(float)
    controls, state, kept = searched(model, "lookahead", shares, wanted)
    slow = naive_refine.refine(
        shares, wanted, controls, lambda each: Twin(model.mechanism).run(each, ZIGZAG.start_steps), 3, APART
    )
    np.testing.assert_array_equal(state.controls[1:], slow)
    assert kept > 0 or shares == SQUARES
    np.testing.assert_array_equal(state.bed, Twin(model.mechanism).run(slow, ZIGZAG.start_steps))


@pytest.mark.parametrize("preset", ["ender5", "corexy"])
def test_less_area_than_the_optimum_of_the_rmse(preset: str) -> None:
    model = MechanismModel(sample("pulley-loose", np.random.default_rng(6)).lower(read_printer(preset)))
    wanted = LAYER.nominal_steps.astype(float)
    best, area = (
        area_cost(wanted, controller(name).plan(model, wanted[1:], LAYER.start_steps).imagined_steps)
        for name in ("optimal", "optimal-area")
    )
    assert area < 0.98 * best


def test_no_small_edit_improves_the_optimum(ender5: Printer) -> None:
    """A search for the RMSE finds nothing that dynamic programming has missed."""
    model = MechanismModel(sample("pulley-loose", np.random.default_rng(7)).lower(ender5))
    assert searched(model, "optimal", SQUARES, LAYER.nominal_steps.astype(float))[2] == 0


def test_area_forgives_most_of_what_is_early_or_late() -> None:
    line = np.stack([np.arange(20.0), np.zeros(20)], axis=1)
    assert area_cost(line, line + np.array([0.4, 0.0])) == pytest.approx(0.3 * 19 * 0.4**2)
    assert area_cost(line, line + np.array([0.0, 0.5])) == pytest.approx(19 * (0.5 + 0.3 * 0.25))


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
