"""A table is read the likeliest way: what its rows went through is undone, and whose it is is asked."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from printmend.corruption import Corruption, Drive, EccentricBore, Play
from printmend.learn.learned import another_printers, learn
from printmend.learn.order import in_order, roughly
from printmend.path import Trace
from printmend.printer import Printer, read_printer
from printmend.twin import Twin

CARTESIAN = read_printer("ender3")
COREXY = replace(CARTESIAN, kinematics="corexy")
BROKEN = Corruption((Drive(pulley=EccentricBore(0.4, 1.0), belt=Play(0.3)), Drive(belt=Play(0.1))))
NOISE_MM = 0.03


def table(printer: Printer = CARTESIAN, fault: Corruption = BROKEN, rows: int = 240) -> Trace:
    """Return a walk all over the bed, measured."""
    rng = np.random.default_rng(6)
    far = rng.uniform(15, 205, (rows // 2, 2))
    path = np.stack([far, far + rng.uniform(-6, 6, far.shape)], axis=1).reshape(-1, 2)
    return Trace(path, Twin.of(fault, printer).follow(path) + rng.normal(0, NOISE_MM, path.shape))


def moved(first: int, last: int, by: int) -> np.ndarray:
    """Return from which row each has its place, where some slipped."""
    rows = np.arange(240)
    rows[first + by : last] -= by
    return rows


SPOILT: dict[str, np.ndarray] = {
    "some slipped": moved(90, 200, 1),
    "reversed": np.arange(240)[::-1],
}


@pytest.mark.parametrize("rows", SPOILT.values(), ids=SPOILT)
def test_rows_in_another_order_are_put_right(rows: np.ndarray) -> None:
    whole = table()
    found = in_order(replace(whole, measured_mm=whole.measured_mm[rows]), CARTESIAN)
    kept = found.trace.measured_rows
    assert kept.mean() > 0.97
    assert np.array_equal(found.trace.measured_mm[kept], whole.measured_mm[kept])
    assert [each.severity for each in found.found] == ["warning"]


def test_a_whole_table_from_its_end_is_turned_round() -> None:
    """Only play tells the order, for each row keeps its own point."""
    whole = table()
    names = ("commanded_mm", "measured_mm")
    whole = replace(whole, homed=False, **{name: getattr(whole, name)[20:] for name in names})
    found = in_order(replace(whole, **{name: getattr(whole, name)[::-1] for name in names}), CARTESIAN)
    assert np.array_equal(found.trace.measured_mm, whole.measured_mm)
    assert [each.kind for each in found.found] == ["rows-reversed"]
    assert not in_order(whole, CARTESIAN).found


def walks(measured_mm: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return measured_mm + np.cumsum(rng.normal(0, 0.05, measured_mm.shape), axis=0)


def outliers(measured_mm: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return measured_mm + np.where(rng.random((len(measured_mm), 1)) < 0.1, rng.uniform(-8, 8, measured_mm.shape), 0.0)


@pytest.mark.parametrize("spoil", [walks, outliers])
def test_what_no_order_explains_is_left_as_it_came(
    spoil: Callable[[np.ndarray, np.random.Generator], np.ndarray], rng: np.random.Generator
) -> None:
    whole = table()
    trace = replace(whole, measured_mm=spoil(whole.measured_mm, rng))
    assert in_order(trace, CARTESIAN).trace is trace


@pytest.mark.parametrize(("of", "said_of"), [(COREXY, CARTESIAN), (COREXY, COREXY)])
def test_a_table_of_other_kinematics_is_asked_whose_it_is(of: Printer, said_of: Printer) -> None:
    found = learn(table(of), said_of).saved.document["misfit"]["found"]
    assert ("printer" in {each["kind"] for each in found}) == (of is not said_of)


def test_of_few_places_nobody_is_asked_whose_they_are() -> None:
    few = table(COREXY, rows=16)
    assert another_printers(roughly(few, CARTESIAN), few) == ()
