"""Whatever learning and bringing up to date write is read again, by all that read a model: a law over odd inputs."""

from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from printmend.corruption import Corruption, Drive, EccentricBore, Play
from printmend.learn.learned import learn_model
from printmend.mend.history import ageing_of, read_history, remember_learned, trends_of
from printmend.mend.update import update
from printmend.mend.verify import expectation
from printmend.model import SavedModel, model_text, read_model, write_model
from printmend.path import FLATBED, Trace
from printmend.printer import Printer, read_printer
from printmend.promise.belief import parse_belief
from printmend.twin import Twin
from printmend_lab.sampling import sample
from tests.test_greybox_learning import stairs

ENDER3, COREXY = read_printer("ender3"), read_printer("corexy")
BENT = Corruption((Drive(pulley=EccentricBore(0.4, 1.0), belt=Play(0.3)), Drive()))
FIRST = datetime(2025, 1, 1, tzinfo=UTC)


def measured(fault: Corruption, printer: Printer, way: np.ndarray, noise_mm: float = 0.03) -> Trace:
    way = np.vstack([[printer.home_mm], way[1:]])
    noise = np.random.default_rng(1).normal(0, noise_mm, way.shape)
    return Trace(way, Twin.of(fault, printer).follow(way) + noise, homed=True)


def enlarged(trace: Trace, times: float) -> Trace:
    return replace(trace, measured_mm=trace.commanded_mm + times * (trace.measured_mm - trace.commanded_mm))


def drawn(family: str) -> Corruption:
    return sample(family, np.random.default_rng(1))


def shaped(printer: Printer, **axis: float) -> Printer:
    """Return a printer with other axes; its end stops are at their lower ends."""
    both = {"home_mm": 0.0, "home_side": "min", **axis}
    return replace(printer, x=replace(printer.x, **both), y=replace(printer.y, **both))  # type: ignore[arg-type]


def screw_driven() -> tuple[Printer, Trace]:
    """A printer whose axes are screws, of which a few centimetres were measured: no length repeats in so few."""
    printer = shaped(ENDER3, mm_per_turn=8.0, microsteps=1)
    trace = measured(BENT, printer, stairs(200, 95.0, 125.0))
    return printer, replace(trace, measured_mm=np.where(trace.commanded_mm > 94.0, trace.measured_mm, np.nan))


def line() -> np.ndarray:
    there = np.concatenate([np.linspace(10, 200, 100), np.linspace(200, 10, 100)])
    return np.stack([np.full(200, 100.0), there], axis=1)


def stated(sigma_mm: float, noise_mm: float) -> Trace:
    trace = measured(BENT, ENDER3, stairs(120), noise_mm)
    return replace(trace, sigma_mm=np.full(len(trace), sigma_mm))


def named() -> Printer:
    return replace(ENDER3, name='"Кузня"\t\\ = [x] \x00 🖨')


ODD: dict[str, Callable[[], tuple[Printer, Trace]]] = {
    "ten points": lambda: (ENDER3, measured(BENT, ENDER3, stairs(12))),
    "a line of a CoreXY": lambda: (COREXY, measured(BENT, COREXY, line(), 0.0)),
    "stated unsure": lambda: (ENDER3, stated(5.0, 5.0)),
    "a long bed": lambda: (p := shaped(ENDER3, max_mm=1000.0), measured(drawn("ripple"), p, stairs(120, 6.0, 994.0))),
    "screws": screw_driven,
    "a large frame": lambda: (COREXY, enlarged(measured(drawn("frame"), COREXY, stairs(60)), 1.5)),
    "a scan and a name": lambda: (
        named(),
        replace(measured(BENT, named(), stairs(80)), placed=False, instrument=FLATBED),
    ),
}


def is_read(model: SavedModel, trace: Trace, path: Path) -> SavedModel:
    """Write a model; return what is read, whose drawn machines and expectation can be made of it."""
    write_model(path, model)
    again = read_model(path)
    assert model_text(again) == model_text(model)
    assert again.digest == model.digest
    assert parse_belief(again) is not None
    found = expectation(again, trace)
    assert found is None or np.isfinite([found.rms_low_mm, found.rms_mm, found.rms_high_mm]).all()
    return again


@pytest.mark.parametrize("name", ODD)
def test_what_is_learned_and_brought_up_to_date_is_read(name: str, tmp_path: Path) -> None:
    printer, trace = ODD[name]()
    path = tmp_path / "printer.mend.json"
    model = is_read(learn_model(trace, printer), trace, path)
    remember_learned(path, model, name, when=FIRST)
    later = FIRST + timedelta(days=30)
    moved = replace(trace, measured_mm=trace.measured_mm + 0.01)
    updated = update(model, moved, rng=np.random.default_rng(0), ageing=ageing_of(path, later))
    remember_learned(path, is_read(updated.model, moved, path), name, updated=True, when=later)
    assert len(events := read_history(path)) == 2
    assert all(trend.words for trend in trends_of(events))


@pytest.mark.parametrize("learner", ["naive", "printmend", "lightgbm-axis"])
def test_a_measurement_that_is_far_off_is_read(learner: str, tmp_path: Path) -> None:
    """Half a metre off: the square of that is no length."""
    trace = measured(BENT, ENDER3, stairs(150))
    far = replace(trace, measured_mm=trace.measured_mm + 500.0)
    is_read(learn_model(far, ENDER3, model=learner), far, tmp_path / "printer.mend.json")
