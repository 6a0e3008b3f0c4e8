"""Traces that are of no print, or of too little of one: a clear refusal, or a model no worse than none."""

from collections.abc import Callable

import numpy as np
import pytest

from printmend.errors import TraceError
from printmend.learn.learned import learn_model
from printmend.model.model import found_in, refusals
from printmend.path import Trace
from printmend.printer import read_printer
from printmend.twin import Twin
from printmend_lab.sampling import sample

PRINTER = read_printer("ender5")
Spoil = Callable[[np.ndarray, np.random.Generator], np.ndarray]


def zigzag(count: int) -> np.ndarray:
    corners = np.array([PRINTER.home_mm, (15, 205), (205, 40), (40, 15), (190, 190), (20, 120), (205, 100)])
    along = np.linspace(0, len(corners) - 1, count)
    return np.stack([np.interp(along, np.arange(len(corners)), corners[:, axis]) for axis in range(2)], axis=1)


def broken() -> Twin:
    return Twin.of(sample("pulley-play", np.random.default_rng(3)), PRINTER)


def far_off(measured_mm: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return np.where(np.arange(len(measured_mm))[:, None] == 7, 1e300, measured_mm)


NONSENSE: dict[str, Spoil] = {
    "another print's rows": lambda mm, rng: rng.permutation(mm),
    "noise": lambda mm, rng: rng.uniform(0, 220, mm.shape),
    "mirrored": lambda mm, rng: 220 - mm,
    "x and y swapped": lambda mm, rng: mm[:, ::-1].copy(),
    "inches": lambda mm, rng: mm / 25.4,
    "all the same": lambda mm, rng: np.full(mm.shape, 7.0),
    "one axis only": lambda mm, rng: np.stack([mm[:, 0], np.full(len(mm), np.nan)], axis=1),
    "nine points": lambda mm, rng: np.where(np.arange(len(mm))[:, None] < 9, mm, np.nan),
    "a wild cell": far_off,
}


@pytest.mark.parametrize("spoil", NONSENSE.values(), ids=NONSENSE)
def test_what_is_no_measurement_of_this_print_is_refused(spoil: Spoil, rng: np.random.Generator) -> None:
    points_mm = zigzag(200)
    with pytest.raises(TraceError) as refused:
        learn_model(Trace(points_mm, spoil(broken().follow(points_mm), rng)), PRINTER, rng=rng)
    assert "\n" not in str(refused.value)


def test_one_wrong_cell_is_left_out_and_named(rng: np.random.Generator) -> None:
    points_mm = zigzag(100)
    measured_mm = broken().follow(points_mm)
    noise_mm = rng.normal(0, 0.02, measured_mm.shape)
    measured_mm += noise_mm
    measured_mm[70, 0] += 10.0
    wrong = learn_model(Trace(points_mm, measured_mm), PRINTER, rng=np.random.default_rng(0))
    assert wrong.noise_mm == pytest.approx(noise_mm.std(), rel=0.1)
    place = f"({points_mm[70, 0]:g}, {points_mm[70, 1]:g}), one of"
    assert any(place in each["words"] for each in found_in(wrong.document))
    assert not refusals(wrong.document)


@pytest.mark.parametrize("first", [0, 5])
def test_a_table_that_does_not_begin_at_home_says_what_stays_open(first: int, rng: np.random.Generator) -> None:
    points_mm = zigzag(40)
    measured_mm = points_mm + rng.normal(0, 0.05, points_mm.shape)
    trace = Trace(points_mm[first:], measured_mm[first:], homed=not first)
    said = [each["words"] for each in found_in(learn_model(trace, PRINTER, rng=rng).document)]
    assert any("does not begin at home" in words for words in said) == bool(first)


@pytest.mark.parametrize(
    ("commanded_mm", "measured_mm", "named"),
    [
        (np.zeros((9, 3)), np.zeros((9, 3)), r"commanded_mm.*\(9, 2\), found \(9, 3\)"),
        (np.zeros((2, 9)), np.zeros((2, 9)), r"commanded_mm.*found \(2, 9\)"),
        (np.zeros((9, 2)), np.zeros((8, 2)), r"measured_mm.*\(9, 2\), found \(8, 2\)"),
        (np.zeros(9), np.zeros(9), r"commanded_mm.*found \(9,\)"),
    ],
)
def test_arrays_that_make_no_trace_are_named(commanded_mm: np.ndarray, measured_mm: np.ndarray, named: str) -> None:
    with pytest.raises(ValueError, match=named):
        Trace(commanded_mm, measured_mm)


def test_a_refusal_counts_the_points(rng: np.random.Generator) -> None:
    points_mm = zigzag(5)
    with pytest.raises(TraceError, match="5 in 5 rows"):
        learn_model(Trace(points_mm, points_mm), PRINTER, rng=rng)


LITTLE: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "one place": lambda mm: np.repeat(mm[:1], len(mm), axis=0),
    "one axis moved": lambda mm: mm * [1, 0] + [0, 110],
    "a millimetre": lambda mm: mm / 220 + 100,
}


@pytest.mark.parametrize("shrink", LITTLE.values(), ids=LITTLE)
def test_from_too_little_no_pulley_is_made_up(
    shrink: Callable[[np.ndarray], np.ndarray], rng: np.random.Generator
) -> None:
    """What hardly moved says nothing of its pulley; the model is no worse than none."""
    twin, points_mm = broken(), shrink(zigzag(60))
    measured_mm = twin.follow(points_mm) + rng.normal(0, 0.05, points_mm.shape)
    model = learn_model(Trace(points_mm, measured_mm), PRINTER, rng=rng)
    other_mm = zigzag(400)[::-1] * 0.5 + 50
    printed_mm = twin.follow(other_mm)
    errors = [np.std(each - printed_mm, axis=0) for each in (Twin(model.mechanism).follow(other_mm), other_mm)]
    assert (errors[0] <= errors[1] * 1.02 + 0.05).all()
    assert len(model.findings) > 1  # it says what it could not tell


def test_noise_of_millimetres_is_no_fault(rng: np.random.Generator) -> None:
    points_mm = zigzag(200)
    model = learn_model(Trace(points_mm, points_mm + rng.normal(0, 5, points_mm.shape)), PRINTER, rng=rng)
    other_mm = zigzag(400)[::-1] * 0.5 + 50
    assert np.abs(np.std(Twin(model.mechanism).follow(other_mm) - other_mm, axis=0)).max() < 0.5


@pytest.mark.parametrize("spoil", [None, "another print's rows", "mirrored"])
def test_a_table_may_have_most_of_its_rows_on_one_line(spoil: str | None, rng: np.random.Generator) -> None:
    """Along it X stands still, and what a crooked frame adds follows no command of X."""
    along = np.linspace(10, 210, 80)
    points_mm = np.vstack([zigzag(40), np.stack([np.full(80, 110.0), along], axis=1)])
    measured_mm = Twin.of(sample("frame", np.random.default_rng(1)), PRINTER).follow(points_mm)
    if spoil is None:
        learn_model(Trace(points_mm, measured_mm), PRINTER, rng=rng)
        return
    with pytest.raises(TraceError):
        learn_model(Trace(points_mm, NONSENSE[spoil](measured_mm, rng)), PRINTER, rng=rng)


ENDLESS: dict[str, Spoil] = {
    "a random walk": lambda mm, rng: mm + np.cumsum(rng.normal(0, 0.05, mm.shape), axis=0),
    "18 teeth": lambda mm, rng: mm[0] + (mm - mm[0]) * 20 / 18,
}


@pytest.mark.parametrize("spoil", ENDLESS.values(), ids=ENDLESS)
def test_learning_ends_whatever_the_rows_are(spoil: Spoil, rng: np.random.Generator) -> None:
    """What it ends with is a refusal, or a machine that moves nothing far beyond what the rows did."""
    points_mm = zigzag(45)
    measured_mm = spoil(broken().follow(points_mm) + rng.normal(0, 0.03, points_mm.shape), rng)
    try:
        model = learn_model(Trace(points_mm, measured_mm, homed=True), PRINTER, rng=rng)
    except TraceError:
        return
    moved_mm = Twin(model.mechanism).follow(points_mm) - points_mm
    assert np.abs(moved_mm).max() < 2 * np.abs(measured_mm - points_mm).max() + 1.0
