"""Faults written down without any effect's columns: what is learned of them mends a print, and the promise holds."""

from collections.abc import Callable

import numpy as np
import pytest

from printmend.corruption import Corruption, Drive, EccentricBore
from printmend.learn.learned import learn_model
from printmend.mend.verify import expectation, made
from printmend.path import Trace, last_way
from printmend.printer import read_printer
from printmend.promise.predict import Promise
from printmend.twin import Twin
from tests.test_greybox_learning import stairs

NOISE_MM = 0.02
Law = Callable[[np.ndarray, np.random.Generator], np.ndarray]  # commanded [N, 2] → by how much they print elsewhere


def walk(count: int, rng: np.random.Generator, home_mm: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    """Return way-points from home over an Ender's bed: each other one is a dot, reached by a short move."""
    dots = rng.uniform(15, 205, (count, 2))
    return np.vstack([home_mm, np.stack([dots + rng.uniform(-4, 4, (count, 2)), dots], axis=1).reshape(-1, 2)])


def mended(law: Law) -> tuple[float, Promise]:
    """Return how far the dots of a mended walk lie off, root mean square, and what was promised of them."""
    rng = np.random.default_rng(3)
    path, is_dot = walk(450, rng), np.arange(901) % 2 == 0
    off_mm = law(path, rng) + rng.normal(0, NOISE_MM, path.shape)
    trace = Trace(path, np.where(is_dot[:, None], path + off_mm, np.nan), homed=True)
    model = learn_model(trace, read_printer("ender3"))
    wanted = walk(200, rng)
    fresh = Trace(wanted, np.where((np.arange(401) % 2 == 0)[:, None], wanted, np.nan), homed=True)
    mended, _ = made(model, fresh)
    printed_mm = mended.commanded_mm + law(mended.commanded_mm, rng)
    left_mm = (printed_mm - mended.measured_mm)[mended.measured_rows][1:]  # from where they are wanted, but for home
    promise = expectation(model, fresh)
    assert promise is not None
    return float(np.linalg.norm(left_mm.std(axis=0))), promise  # each homing puts all of a print elsewhere


def misses_a_tooth_and_rubs(path: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A belt of X without a tooth, and a cable that Y drags along part of its way."""
    there = (path[:, 1] > 60) & (path[:, 1] < 115)
    missing_mm = 0.3 * np.maximum(1.0 - np.abs(path[:, 0] - 97.0) / 2.5, 0.0)
    return np.stack([missing_mm, -0.08 * last_way(path[:, 1]) * there], axis=1)


def twists(path: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The bed turns about its middle with the direction of X."""
    return np.stack([0 * path[:, 0], 0.0006 * (path[:, 0] - 110.0) * last_way(path[:, 0])], axis=1)


def distorted(path: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The bed is pulled aside about one place, as by a cable."""
    away = np.square((path - [90.0, 130.0]) / 45.0).sum(axis=1)
    return 0.15 * np.exp(-away / 2)[:, None] * [0.8, -0.6]


def jointed(path: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return np.stack([0 * path[:, 0], 0.12 * (path[:, 0] > 120.0)], axis=1)


def wanders(path: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return np.asarray(np.cumsum(rng.normal(0, 0.06 / len(path) ** 0.5, path.shape), axis=0))


@pytest.mark.parametrize(
    ("law", "least_mm"),
    [(misses_a_tooth_and_rubs, 0.02), (distorted, 0.02)],
)
def test_what_a_machine_holds_is_mended_whoever_wrote_it(law: Law, least_mm: float) -> None:
    left_mm, promise = mended(law)
    assert left_mm < least_mm
    assert left_mm < promise.rms_high_mm


@pytest.mark.parametrize("law", [twists, wanders, jointed])
def test_what_cannot_be_mended_is_promised(law: Law) -> None:
    """A walk goes another way in each print: the measured one, walked again, would be more even."""
    left_mm, promise = mended(law)
    assert promise.rms_low_mm < left_mm < promise.rms_high_mm


@pytest.mark.parametrize(
    ("preset", "kind", "beyond_mm", "before_mm"),  # the first homes before the border, the others beyond it
    [
        ("ender3", "joint", (0.0, 0.0), (0.0, -0.12)),
        ("ender5", "joint", (0.0, 0.0), (0.0, -0.12)),
        ("ender3", "halves", (0.1, -0.06), (0, 0)),
        ("voron2-300", "halves", (0.1, -0.06), (0, 0)),
    ],
)
def test_a_border_moves_no_end_stop(
    preset: str, kind: str, beyond_mm: tuple[float, float], before_mm: tuple[float, float]
) -> None:
    """Whichever part of the bed holds home: a guide is as it was there, and either of two sheets may lie aside."""
    printer, rng = read_printer(preset), np.random.default_rng(3)
    path = walk(250, rng, printer.home_mm)
    off_mm = np.where(path[:, :1] > 120.0, beyond_mm, before_mm)
    if kind == "joint":
        off_mm -= off_mm[0]
    measured_mm = path + off_mm + rng.normal(0, NOISE_MM, path.shape)
    measured_mm[0] = np.nan
    model = learn_model(Trace(path, measured_mm, homed=True), printer)
    assert not model.document["diagnosis"]
    (found,) = model.document["misfit"]["found"]
    assert (found["kind"], found["severity"]) == (kind, "warning")


def test_a_sheet_that_turns_about_its_clip_is_one_cause() -> None:
    printer, rng = read_printer("ender3"), np.random.default_rng(5)
    path = walk(450, rng, printer.home_mm)
    x, y = (path - 20.0).T
    turned_mm = np.deg2rad(0.15) * np.stack([-y, x], axis=1)
    turned_mm[: len(path) // 2] = 0.0
    measured_mm = path + turned_mm + rng.normal(0, NOISE_MM, path.shape)
    model = learn_model(Trace(path, measured_mm, homed=True), printer)
    assert not model.document["diagnosis"]
    found, *beside = model.document["misfit"]["found"]
    assert found["kind"] == "sheet"
    assert "+0.15°" in found["words"]
    assert {each["kind"] for each in beside} <= {"left-out"}  # the point at that moment may be on either side


def test_a_skipped_tooth_is_no_lost_turn_of_the_motor() -> None:
    """Its 2 mm are nearly a whole number of electrical turns of this motor: the pulley did not turn with the belt."""
    printer, rng = read_printer("prusa-mk4s"), np.random.default_rng(4)
    path = stairs(200)
    eccentric = Corruption((Drive(pulley=EccentricBore(0.3, 1.0)), Drive()))
    measured = Twin.of(eccentric, printer).follow(path) + rng.normal(0, NOISE_MM, path.shape)
    measured[len(path) // 2 :, 0] += 2.0
    model = learn_model(Trace(path, measured, homed=True), printer)
    (fault,) = model.document["diagnosis"]
    assert (fault["part"], fault["kind"]) == ("x", "harmonic-1")
    assert fault["value"] == pytest.approx(0.3, abs=0.006)
