"""A second measurement of a known machine: it sharpens what did not change, and finds and names what did."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from printmend.corruption import Corruption, Drive, EccentricBore, Ellipse, Play
from printmend.effects import EFFECTS, Scene, places_of, scene_of
from printmend.effects.uneven import Uneven
from printmend.infer import update
from printmend.infer.fit import Fit, fitted
from printmend.infer.gram import blocks_of
from printmend.infer.machine import DRAWS, Part, machine_of, those_acting
from printmend.infer.posterior import Posterior, posterior_of
from printmend.infer.update import Renewed, both_seen, directions, rebased, renewed, told_apart, turned
from printmend.path import FLATBED, Trace
from printmend.printer import read_printer
from printmend.twin import Twin
from tests.test_greybox_learning import stairs

ENDER3 = read_printer("ender3")
NOISE_MM = 0.03
OTHER = Drive(pulley=EccentricBore(0.2, 2.2), belt=Play(0.05))


def machine(play_mm: float = 0.2, phase: float = 1.0, y: Drive | None = None) -> Corruption:
    y = Drive(pulley=Ellipse(6.6, 6.1, 0.4), belt=Play(0.3)) if y is None else y
    return Corruption((Drive(pulley=EccentricBore(0.5, phase), belt=Play(play_mm)), y))


def printed(corruption: Corruption, points: int, seed: int, low: float = 60.0, high: float = 130.0) -> Trace:
    way = stairs(points, low, high)
    noise = np.random.default_rng(seed).normal(0, NOISE_MM, way.shape)
    return Trace(way, Twin.of(corruption, ENDER3).follow(way) + noise, homed=True)


@pytest.fixture(scope="module")
def old() -> tuple[Fit, Posterior]:
    trace = printed(machine(), 400, 0, 6.0, 214.0)
    fit = fitted(trace, scene_of(trace, ENDER3, (40.0, 40.0)))
    return fit, posterior_of(fit, np.random.default_rng(0))


def again(old: tuple[Fit, Posterior], trace: Trace, **options: Any) -> Renewed:
    fit, posterior = old
    scene = both_seen(posterior.scene, scene_of(trace, ENDER3, (40.0, 40.0)))
    rng = np.random.default_rng(1)
    return renewed(posterior.parts, fit.mechanism, trace, scene, rng, first=posterior.scene, **options)


def size(parts: tuple[Part, ...], effect: str, where: int) -> tuple[float, float, float]:
    """Return what acts, the mean and the standard deviation of an effect's first size."""
    (part,) = (each for each in parts if (each.effect, each.where) == (effect, where) and each.chance > 0.5)
    return float(part.acts_mm[0]), float(part.mean_mm[0]), float(part.sd_mm[0])


def test_the_same_machine_is_known_better(old: tuple[Fit, Posterior]) -> None:
    found = again(old, printed(machine(), 300, 5), months=0.0)
    assert (found.changes, found.story.anew, found.story.events) == ((), (), ())
    for motor, play_mm in enumerate((0.2, 0.3)):
        (_, _, before), (acts, mean, sd) = (size(parts, "play", motor) for parts in (found.before, found.now.parts))
        assert sd < before
        assert abs(mean - play_mm) < 4 * sd
        assert acts == pytest.approx(mean, abs=sd)


def test_no_place_of_a_belt_need_be_offered(old: tuple[Fit, Posterior], monkeypatch: pytest.MonkeyPatch) -> None:
    """It is what shifts a print as the drawn machines do, whether the search may find one or not."""
    names = [name for name in EFFECTS if name != "place"]
    monkeypatch.setattr(update, "blocks_of", lambda scene, names=names: blocks_of(scene, names=names))
    found = again(old, printed(machine(), 300, 5), months=0.0)
    acts, mean, sd = size(found.now.parts, "play", 0)
    assert acts == pytest.approx(mean, abs=sd)


def test_a_print_that_tells_everything_ends_where_learning_anew_ends() -> None:
    """A few distances tell play by a tenth of a millimetre, and some of their machines have none; then one belt was
    tightened, and a scan of the middle of the bed follows."""
    rng = np.random.default_rng(3)
    tight = printed(Corruption((Drive(belt=Play(0.1)), Drive(belt=Play(0.2)))), 300, 5)
    scan = replace(tight, placed=False, instrument=FLATBED)
    now, whole = (scene_of(each, ENDER3, (40.0, 40.0)) for each in (scan, printed(Corruption(), 50, 0, 6.0, 214.0)))
    drawn_mm = np.array([[0.5], [0.2]]) + 0.08 * rng.standard_normal((2, DRAWS))
    has = np.arange(DRAWS) % 24 > 0
    parts = tuple(
        Part("play", at, (), each[has].mean(keepdims=True), (each * has)[None]) for at, each in enumerate(drawn_mm)
    )
    mechanism, _ = machine_of(whole, those_acting(parts))
    found = renewed(parts, mechanism, scan, both_seen(whole, now), rng, first=whole)
    anew = posterior_of(fitted(scan, now), rng)
    for motor in range(2):
        (acts, mean, sd), (best, _, best_sd) = (size(each.parts, "play", motor) for each in (found.now, anew))
        assert acts == pytest.approx(best, abs=best_sd)
        assert mean == pytest.approx(acts, abs=sd)
        assert sd < 2 * best_sd


def test_a_cause_of_two_possible_shapes_stays_one_as_large() -> None:
    """Each drawn machine has either; the shape that acts may be one that few of them have."""
    scene, rng = scene_of(printed(machine(), 400, 0, 6.0, 214.0), ENDER3, (40.0, 40.0)), np.random.default_rng(2)
    narrow, sizes_mm = np.arange(DRAWS) % 5 < 3, 0.2 + 0.003 * rng.standard_normal((1, DRAWS))
    parts = (
        Part("splice", 0, (90.0, 4.0), np.array([0.0]), sizes_mm * narrow),
        Part("splice", 0, (90.0, 5.0), np.array([0.2]), sizes_mm * ~narrow),
    )
    mechanism, _ = machine_of(scene, those_acting(parts))
    way = stairs(300, 60.0, 130.0)
    trace = Trace(way, Twin(mechanism).follow(way) + rng.normal(0, NOISE_MM, way.shape), homed=True)
    both = both_seen(scene, scene_of(trace, ENDER3, (40.0, 40.0)))
    found = renewed(parts, mechanism, trace, both, rng, first=scene)
    assert (found.changes, found.story.anew) == ((), ())
    joints = [part for part in found.now.parts if part.effect == "splice"]
    assert sum(part.acts_mm[0] for part in joints) == pytest.approx(0.2, abs=0.02)
    assert np.abs(sum(part.draws_mm[0] for part in joints) - 0.2).max() < 0.03


def test_what_wears_is_known_less_after_a_year_and_wear_that_was_foretold_is_expected(
    old: tuple[Fit, Posterior],
) -> None:
    few = printed(machine(), 30, 5)
    few = replace(few, measured_mm=np.where(np.arange(len(few))[:, None] < 3, few.measured_mm, np.nan))
    foretold = {"months": 0.0, "grown": {("play", 0): (0.1, 0.01)}}
    soon, late, grown = (
        again(old, few, **options).now.parts for options in ({"months": 0.0}, {"months": 12.0}, foretold)
    )
    assert size(late, "play", 0)[2] > size(soon, "play", 0)[2]
    assert size(late, "pulley", 0)[2] == pytest.approx(size(soon, "pulley", 0)[2], rel=0.5)
    assert size(grown, "play", 0)[1] - size(soon, "play", 0)[1] > 0.02


def test_a_motor_with_other_parts_is_told_from_the_whole_machine(old: tuple[Fit, Posterior]) -> None:
    """`test_update` has another machine."""
    half = again(old, printed(machine(y=OTHER), 100, 8))
    assert (half.story.anew, half.story.whole) == ((1,), False)
    assert size(half.now.parts, "play", 1)[1] == pytest.approx(0.05, abs=0.02)


def test_an_end_stop_that_moved_takes_the_print_along_and_a_pulley_that_turned_does_not(
    old: tuple[Fit, Posterior],
) -> None:
    by_mm = 5.0
    there = printed(machine(phase=1.0 + by_mm * 2 * np.pi / 40.0), 300, 5)
    for kind, aside_mm in (("turned", 0.0), ("stop", by_mm)):
        trace = replace(there, measured_mm=there.measured_mm + np.array([aside_mm, 0.0]))
        found = again(old, trace)
        (event,) = found.story.events
        assert (event.kind, event.where) == (kind, 0)
        assert event.shift_mm(event.by_rad, found.now.scene) == pytest.approx(by_mm, abs=0.2)
        assert not any(part.is_likely for part in found.now.parts if part.effect == "shift")


def test_another_belt_has_another_pitch(old: tuple[Fit, Posterior]) -> None:
    """A picture that shows no scale of its own cannot tell it, so the drawn machines differ in it."""
    trace = printed(Corruption((machine().drives[0], Drive(pulley=Ellipse(6.6, 6.1, 1.4), belt=Play(0.02)))), 300, 5)
    found = again(old, replace(trace, placed=False, instrument=FLATBED))
    assert [(event.kind, event.where) for event in found.story.events] == [("belt", 1)]
    scales_mm = sum(part.draws_mm[0] for part in found.now.parts if (part.effect, part.where) == ("scale", 1))
    assert np.std(scales_mm) > 0.03


def test_a_pulley_turned_all_round_is_as_it_was(old: tuple[Fit, Posterior]) -> None:
    parts = old[1].parts
    there = turned(turned(parts, 0, 2.0), 0, 2 * np.pi - 2.0)
    for part, same in zip(parts, there, strict=True):
        assert np.abs(part.draws_mm - same.draws_mm).max() < 1e-9


def test_directions_hold_the_covariance_of_the_draws() -> None:
    rng = np.random.default_rng(3)
    draws = np.array([[1.0, 0.0], [0.9, 0.2]]) @ rng.standard_normal((2, DRAWS))
    draws = np.vstack([draws, np.zeros((1, DRAWS))])  # what none of them has stays nothing
    ways = directions(draws, np.eye(3))
    assert np.allclose((ways @ ways.T)[:2, :2], np.cov(draws[:2], bias=True), rtol=0.05)
    assert not ways[2].any()


def test_a_part_over_a_wider_span_is_the_same_belt(old: tuple[Fit, Posterior]) -> None:
    scene = old[1].scene
    narrow, wide = (
        replace(scene, homed=False, motor_span_mm=(span, (0.0, 200.0))) for span in ((60.0, 130.0), (6.0, 214.0))
    )
    orders = np.arange(1, Uneven().count + 1)
    sizes = np.random.default_rng(1).normal(0, 0.05, (len(orders), DRAWS)) / orders[:, None] ** 2
    part = Part("uneven", 0, (60.0, 130.0), sizes[:, 0], sizes)
    same = rebased(part, wide)
    assert same.shape == (6.0, 214.0)
    apart_mm = _belt_mm(part, narrow) - _belt_mm(same, wide)
    assert np.abs(apart_mm - apart_mm.mean(axis=0)).max() < 0.002  # a shift of all is the belt's place


def _belt_mm(part: Part, scene: Scene) -> np.ndarray:
    motor = np.column_stack([np.linspace(60.0, 130.0, 50), np.zeros(50)])
    trace = Trace(motor, motor)
    places = places_of(trace, scene, np.tile(np.arange(50)[:, None], 2), np.ones((50, 2)), motor)
    return np.asarray(EFFECTS[part.effect].columns(places, part.where, part.shape, scene) @ part.acts_mm)


def test_directions_know_a_sum_as_well_as_its_draws_do() -> None:
    """Two effects that are alike are each known badly and together well, however many others there are."""
    rng = np.random.default_rng(4)
    draws = rng.standard_normal((40, DRAWS))
    draws[1] = 0.01 * draws[1] - draws[0]
    makes = np.eye(40)
    makes[:2, 1] = 1.0, 0.0
    ways = directions(draws, makes.T @ makes)
    assert np.linalg.norm((makes @ ways)[0]) == pytest.approx((makes @ draws)[0].std(), rel=0.3)
    assert np.linalg.norm(ways, axis=1) == pytest.approx(draws.std(axis=1), rel=0.01)


def test_what_others_make_up_for_is_known_with_them_and_what_stands_alone_is_in_doubt() -> None:
    scene, rng = scene_of(printed(machine(), 400, 0, 6.0, 214.0), ENDER3, (40.0, 40.0)), np.random.default_rng(5)
    more_mm = 0.3 * (np.arange(DRAWS) % 12 == 0) * rng.standard_normal(DRAWS)  # few machines have a bend

    def parts(motor: int, of_scale: float) -> list[Part]:
        bend = np.stack([0.0 * more_mm, more_mm])
        scale = 0.5 + 0.002 * rng.standard_normal(DRAWS) + of_scale * more_mm
        shape = scene.motor_span_mm[motor]
        return [
            Part("scale", motor, (), np.array([0.5]), scale[None]), Part("bend", motor, shape, np.zeros(2), bend)
        ]  # fmt: skip

    known, doubted = told_apart([*parts(0, -0.6), *parts(1, 0.0)], scene)
    assert [part.key[:2] for part in known] == [("scale", 0), ("bend", 0), ("scale", 1)]
    assert [part.key[:2] for part in doubted] == [("bend", 1)]
