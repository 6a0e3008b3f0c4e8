"""The engine: what effects promise to inference, what the search finds, and whether its draws are true (Talts 2018)."""

import itertools
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy import special

from printmend.corruption import corruption_of
from printmend.diagnosis.named import faults_of
from printmend.effects import EFFECTS, Acts, Of, Scene, columns_of, home_of, places_of, scene_of
from printmend.effects.effect import LINEAR, drawn_places, drawn_sizes, moves_of, name_of
from printmend.effects.prior import NEAR_SHARE, share_of
from printmend.effects.sized import Sized, frame_of
from printmend.effects.words import Found
from printmend.infer import kernels
from printmend.infer.fit import fitted, home_sd_of, reweighed, weighed, worn
from printmend.infer.gram import Block, Dictionary, Look, Rows, blocks_of, dictionary_of, gram_of, seen
from printmend.infer.machine import DRAWS, Part, machine_of
from printmend.infer.posterior import acting, central, drawn_by, drawn_of, drawn_sets, likely_set, posterior_of, seen_at
from printmend.infer.scatter import log_below
from printmend.infer.search import State, doubted, search_of, searched
from printmend.learn.learned import learn, learn_model
from printmend.machine import contacts_of, healthy_mechanism, print_from_home
from printmend.model.model import LEAST_WAVE_MM
from printmend.path import PAPER_SD, RESIZED, Trace
from printmend.printer import Printer, read_printer
from printmend.twin import Twin
from printmend_lab.sampling import drawn_parts, fault, measured

pytestmark = pytest.mark.usefixtures("all_rounds")
NOISE_MM = 0.02


def path_of(printer: Printer) -> tuple[np.ndarray, np.ndarray]:
    """Return way-points all over the bed, approached from every side, and which of them leave a dot."""
    rng = np.random.default_rng(4)
    low, high = np.array([[axis.min_mm, axis.max_mm] for axis in printer.axes[:2]]).T
    dots = low + rng.uniform(0.08, 0.92, (240, 2)) * (high - low)
    before = dots + rng.choice([-4.0, 4.0], (240, 2))
    path = np.concatenate([np.array(printer.home_mm)[None], np.stack([before, dots], axis=1).reshape(-1, 2)])
    return path, np.arange(len(path)) % 2 == 0


def scene_for(printer: Printer) -> Scene:
    path, dots = path_of(printer)
    dots[0] = False
    every = Trace(path, np.where(dots[:, None], path, np.nan), homed=True)
    scene = scene_of(every, printer)
    return replace(scene, home_sd_mm=home_sd_of(healthy_mechanism(printer), scene))


def scenes() -> Iterator[Scene]:
    for preset in ("ender3", "corexy"):
        scene = scene_for(read_printer(preset))
        yield scene
        layers = (0.2, 16.2, 17.0)
        instrument = replace(RESIZED, paper_sd=PAPER_SD)
        yield replace(
            scene, placed=False, instrument=instrument, walls=True, shrinkage_sd=0.002, layers=layers, step_mm=0.1
        )


@pytest.mark.parametrize("name", sorted(EFFECTS))
def test_an_effect_keeps_its_promises_to_inference(name: str) -> None:
    """Finite columns for each size, odds that add up to its share, nothing at home, shapes that stay its own."""
    effect, offered = EFFECTS[name], 0
    for scene in scenes():
        places = drawn_places(scene)
        by_place: dict[tuple[int, str], float] = {}
        for term in effect.terms(scene):
            offered += 1
            own = (term.where, name_of(effect, np.array([term.sign])))
            by_place[own] = by_place.get(own, 0.0) + float(np.exp(min(term.log_odds, 50.0)))
            if offered % 40 == 1:
                columns = columns_of(name, places, term.where, term.shape, scene)
                assert columns.shape == (len(places), 2, len(term.sd_mm))
                assert np.isfinite(columns).all()
                for shape in effect.finer(term.where, term.shape, 0, scene):
                    assert len(shape) == len(term.shape)
                    assert columns_of(name, places, term.where, shape, scene).shape == columns.shape
                if scene.homed and effect.of is Of.MACHINE and effect.from_home:
                    assert np.abs(columns_of(name, home_of(scene), term.where, term.shape, scene)).max() < 1e-12
        by_scene = ("origin", "stretch", "bead", "turn", "pulley", "shrinkage", "halves", "digits")
        if name not in by_scene:  # nor always there
            for (_, called), odds in by_place.items():
                assert odds / (1 + odds) == pytest.approx(share_of(called), rel=1e-6)
    assert offered


@pytest.mark.parametrize(
    "name",
    sorted(name for name, each in EFFECTS.items() if each.acts not in (Acts.NOT, Acts.SCREW) and each.of is Of.MACHINE),
)
def test_what_is_learned_is_what_the_twin_has(name: str, rng: np.random.Generator) -> None:
    """A model file lowers an effect as a series, the twin by its columns; `conformance` judges the twin's."""
    printer = read_printer("corexy" if name == "aspect" else "ender3")
    scene = scene_for(printer)
    terms = list(EFFECTS[name].terms(scene))
    term = terms[int(rng.integers(len(terms)))]
    part = Sized(name, term.where, term.shape, 1e-3 * rng.standard_normal(len(term.sd_mm)))
    parts = [part, *(Sized("play", motor, (), np.array([0.5])) for motor in range(2))]
    learned_one, _ = machine_of(scene, parts)
    twin, path = Twin(healthy_mechanism(printer)).with_effects(parts), path_of(printer)[0]
    motors = np.rint(printer.to_motor(path) / 0.0125) * 0.0125
    theirs = print_from_home(learned_one, printer.from_motor(motors))
    np.testing.assert_allclose(twin.follow(printer.from_motor(motors))[1:], theirs[1:], atol=1e-6)


DRIVES = sorted(name for name, effect in EFFECTS.items() if effect.acts is Acts.DRIVE and effect.of is Of.MACHINE)


@pytest.mark.parametrize("name", DRIVES)
def test_two_effects_of_a_drive_move_it_as_each_says(name: str, rng: np.random.Generator) -> None:
    """The machine of both, counted from a home that was not measured, is the sum of their columns."""
    span = ((60.0, 160.0), (60.0, 160.0))
    scene = replace(scene_for(read_printer("ender3")), motor_span_mm=span, bed_span_mm=span)
    places = drawn_places(scene)
    play = Sized("play", 0, (), np.array([0.6]))
    for other in DRIVES:
        names = [each for each in dict.fromkeys((name, other)) if each != "play"]
        parts = [play, *(_small(each, scene, rng) for each in names)]
        said = sum(columns_of(part.effect, places, 0, part.shape, scene)[:, 0] @ part.sizes_mm for part in parts)
        lower, upper = machine_of(scene, parts)[0].transmissions[0].branches_mm(places.motor_mm[:, 0])
        moved = np.where(places.side[:, 0] < 0, lower, upper) - places.motor_mm[:, 0]
        assert np.abs(moved - said).max() < 1e-4, other


def _small(name: str, scene: Scene, rng: np.random.Generator) -> Sized:
    """Return an effect of the first motor in its first shape, with small sizes."""
    term = next(each for each in EFFECTS[name].terms(scene) if each.where == 0)
    sizes = rng.standard_normal(len(term.sd_mm)) * term.sd_mm
    sizes *= NOISE_MM / np.linalg.norm(sizes)
    return Sized(name, 0, term.shape, np.abs(sizes) if term.sign else sizes)


@pytest.mark.parametrize("name", ["crooked", "distortion"])
def test_a_small_print_makes_waves_that_a_model_file_holds(name: str, rng: np.random.Generator) -> None:
    scene = replace(scene_for(read_printer("ender3")), bed_span_mm=((100.0, 109.0), (100.0, 109.0)))
    for term in EFFECTS[name].terms(scene):
        waves = frame_of(scene, [Sized(name, term.where, term.shape, drawn_sizes(term, rng))]).waves
        assert (waves[:, 1] >= LEAST_WAVE_MM).all()


def test_play_that_builds_up_at_once_is_no_soft_one() -> None:
    """Where a part's walls tell little of the first bit after a reversal, such play would act in no print."""
    scene = scene_for(read_printer("ender3"))
    shortest = min(term.shape[0] for term in EFFECTS["soft_play"].terms(scene))
    for round_ in range(3):
        assert all(shape[0] >= shortest for shape in EFFECTS["soft_play"].finer(0, (shortest,), round_, scene))


@pytest.mark.parametrize(("length_mm", "off"), [(0.5, 1e-4), (4.0, 0.02)])
def test_soft_play_follows_the_law_of_dahl(length_mm: float, off: float, rng: np.random.Generator) -> None:
    """The columns know four strokes; the law, step by step, all of them."""
    printer = read_printer("ender3")
    scene, strokes = scene_for(printer), rng.choice([0.8, 3.0, 20.0], (300, 2)) * rng.choice([-1.0, 1.0], (300, 2))
    path = np.concatenate([np.array(printer.home_mm)[None], 110 + np.cumsum(strokes, axis=0)])
    contacts = contacts_of(healthy_mechanism(printer), path)
    places = places_of(Trace(path, path, homed=True), scene, contacts.row, contacts.side, path)
    said = columns_of("soft_play", places, 0, (length_mm,), scene)[:, 0, 0]
    lag, wanted = 1.0, [0.0]  # settled as it came to the end stop, where no error is left
    for moved in np.diff(path[:, 0]):
        way = -np.sign(moved)
        lag = way + (lag - way) * np.exp(-abs(moved) / length_mm)
        wanted.append(0.5 * (lag - 1.0))
    assert np.sqrt(np.mean((said - wanted) ** 2)) < off
    assert said.min() < -0.9


def test_a_travel_in_pieces_is_one_move_and_no_longer_one_is_judged(rng: np.random.Generator) -> None:
    turns = np.repeat(110 + np.cumsum(rng.choice([-1.5, 1.5], (40, 2)), axis=0), 2, axis=0)  # each place twice: a stop
    path = np.concatenate([[[0.0, 0.0]], turns[:1] * np.linspace(0.1, 1.0, 10)[:, None], turns])
    step, heading, length = moves_of(path)
    assert length[:11] == pytest.approx(np.hypot(*turns[0]) * np.linspace(0, 1, 11))
    assert length[13:] == pytest.approx(1.5 * np.sqrt(2))
    assert np.array_equal(step[12::2], np.zeros(len(step[12::2])))
    assert np.hypot(*heading[1:].T) == pytest.approx(1.0)
    printer, seen = read_printer("ender3"), np.where(np.arange(len(path))[:, None] > 12, path, np.nan)
    scene = scene_of(Trace(path, seen, homed=True), printer)
    (shape,) = {term.shape for term in EFFECTS["speed"].terms(scene)}
    assert shape == pytest.approx((1.5 * np.sqrt(2),))
    places = drawn_places(scene)
    far, short = (columns_of("speed", replace(places, move_mm=places.side[:, 0] * 0 + mm), 0, shape, scene)
                  for mm in (50.0, 1.5 * np.sqrt(2)))  # fmt: skip
    assert np.array_equal(far, short)


@pytest.mark.parametrize("preset", ["ender3", "corexy"])
def test_backlash_that_the_firmware_takes_up_and_is_not_there_is_found_and_left(
    preset: str, rng: np.random.Generator
) -> None:
    """The firmware moves each motor on by 0.25 mm at a reversal, of which play takes 0.1."""
    printer = read_printer(preset)
    path, dots = path_of(printer)
    motors = np.rint(printer.to_motor(path) / 0.0125) * 0.0125
    belts = motors.copy()
    for motor, belt in enumerate(belts.T):
        way, at = printer.motor_home_direction(motor), motors[0, motor]
        place = at + 0.075 * way
        for row, wanted in enumerate(motors[:, motor]):
            way, at = int(np.sign(wanted - at)) or way, wanted
            sent = wanted + 0.125 * way
            belt[row] = place = min(max(place, sent - 0.05), sent + 0.05)
        belt += motors[0, motor] - belt[0]  # the end stops are where it is
    printed = printer.from_motor(belts)
    corruption = corruption_of([f"play:on={name},size_mm=-0.15" for name in printer.motors])
    twin = Twin.of(corruption, printer)
    np.testing.assert_allclose(twin.seen(printer.from_motor(motors)), printed, atol=1e-9)
    measured = np.where(dots[:, None], printed + rng.normal(0, NOISE_MM, path.shape), np.nan)
    measured[0] = np.nan
    trace = Trace(printer.from_motor(motors), measured, homed=True)
    fit = fitted(trace, scene_of(trace, printer))
    posterior = posterior_of(fit, rng)
    plays = [part for part in posterior.parts if part.effect == "play" and part.chance > 0.95]
    assert sorted(part.where for part in plays) == [0, 1]
    for part in plays:
        low, middle, high = np.quantile(part.draws_mm, [0.05, 0.5, 0.9])
        assert middle == pytest.approx(-0.15, abs=0.01)
        assert high - low < 0.03
        assert not part.acts_mm.any()
    assert all(table.is_taut for table in fit.mechanism.transmissions)
    assert {fault.kind for fault in faults_of(posterior.parts, fit.scene)} == {"overcompensation"}


def test_a_pulley_has_the_prior_of_its_equation() -> None:
    """Physics.md eq. 18: 0.8 k^−2.5 mm of position, times the scales that may raise the evidence."""
    scene, order = scene_for(read_printer("ender3")), np.arange(1, 33)
    whole = [np.array(term.sd_mm) for term in EFFECTS["pulley"].terms(scene) if len(term.sd_mm) == 64]
    assert any(np.allclose(sds_mm, np.tile(0.8 * order**-2.5, 2)) for sds_mm in whole)


def test_no_finer_idler_is_the_pulley() -> None:
    scene = scene_for(read_printer("ender3"))
    turn_mm = scene.turns_mm[0]
    near = [term for term in EFFECTS["idler"].terms(scene) if abs(turn_mm / term.shape[0] - 2) < 0.1]
    finer = [turn_mm / shape[0] for term in near for shape in EFFECTS["idler"].finer(0, term.shape, 0, scene)]
    assert finer
    assert min(abs(turns - 2) for turns in finer) > NEAR_SHARE


def test_finer_shapes_share_the_odds_of_the_grids_own(rng: np.random.Generator) -> None:
    """To the posterior each place of an effect is as likely beside finer shapes as without them."""
    scene = scene_for(read_printer("ender3"))
    path, dots = path_of(scene.printer)
    dots[0] = False
    parts = [
        Sized("idler", 0, (44.3,), np.array([0.08, 0.0])),
        Sized("splice", 1, (101.0, 4.0), np.array([0.3])),
        Sized("step", 0, (0.437,), np.array([0.2])),
    ]
    fit = fitted(measured(path, dots, scene, parts, NOISE_MM, rng), scene)
    finer = {each.slot for each in fit.dictionary.blocks if each.coarse is not None}
    assert finer == {("idler", 0), ("splice", 1), ("step", 0)}
    for blocks in (blocks_of(fit.scene), fit.search.apart().dictionary.blocks):
        odds = {slot: sum(float(np.exp(each.log_odds).sum()) for each in blocks if each.slot == slot) for slot in finer}
        for (effect, _), whole in odds.items():
            assert whole / (1 + whole) == pytest.approx(share_of(effect), rel=1e-6)


@pytest.mark.parametrize("at_mm", [99.0, 101.0])
def test_a_belt_joint_of_places_on_the_bed_is_hardly_two_sheets(at_mm: float, rng: np.random.Generator) -> None:
    scene = scene_for(read_printer("ender3"))
    path, dots = path_of(scene.printer)
    dots[0] = False
    fit = fitted(measured(path, dots, scene, [Sized("splice", 1, (at_mm, 1.0), np.array([0.2]))], 0.05, rng), scene)
    drawn = drawn_sets(fit.search, fit.state, rng)
    there = [{fit.dictionary.blocks[b].effect for b, _ in members} for members in drawn]
    assert np.mean(["halves" in each for each in there]) <= 0.05
    assert np.mean(["splice" in each for each in there]) >= 0.9


def test_play_wears_in_along_a_print(rng: np.random.Generator) -> None:
    """Belts touch where those of a machine do that has as much play as they have got by then."""
    scene = scene_for(read_printer("ender3"))
    path = np.cumsum(rng.uniform(-0.3, 0.3, (2000, 2)), axis=0) + 110.0
    new, old = (machine_of(scene, [Sized("play", 0, (), np.array([mm]))])[0] for mm in (0.1, 0.7))
    worn_mm = worn(
        path, [Sized("wear", 0, (), np.array([0.6]))], replace(scene, way_mm=np.hypot(*np.diff(path.T)).sum())
    )
    assert worn_mm[0, 0] == 0
    assert worn_mm[-1, 0] == pytest.approx(0.6)
    assert not worn_mm[:, 1].any()
    wears, all_worn = contacts_of(new, path, worn_mm), contacts_of(old, path, worn_mm - worn_mm[-1])
    np.testing.assert_array_equal(wears.row, all_worn.row)
    np.testing.assert_array_equal(wears.side, all_worn.side)
    behind_mm = wears.belt_mm[:, 0] - path[:, 0]
    assert [np.ptp(each) for each in (behind_mm[:400], behind_mm[-400:])] == pytest.approx([0.21, 0.69], abs=0.02)


def test_a_loose_nozzle_is_no_play_of_belts(rng: np.random.Generator) -> None:
    """It is dragged along within a circle, as a stone on a string is."""
    printer, play_mm = read_printer("corexy"), 0.3
    path = np.vstack([printer.home_mm, rng.uniform(20, 200, (200, 2))])
    at, places = path[0], np.empty_like(path)
    for row, (start, end) in enumerate(itertools.pairwise([path[0], *path])):
        for wanted in np.linspace(start, end, 100):
            away = at - wanted
            at = wanted + away * min(1.0, play_mm / 2 / max(float(np.hypot(*away)), 1e-9))
        places[row] = at
    learned = learn(Trace(path, places + rng.normal(0, NOISE_MM, path.shape), homed=True), printer).saved
    told = [each["kind"] for each in learned.document["misfit"]["found"] if each["severity"] != "note"]
    assert told == ["loose"]
    for table in learned.mechanism.transmissions:
        assert np.abs(table.upper_mm - table.lower_mm).max() < 1e-3


@pytest.mark.parametrize(("preset", "seed"), [("ender3", 0), ("corexy", 1)])
def test_noise_alone_makes_no_machine(preset: str, seed: int) -> None:
    printer = read_printer(preset)
    scene, (path, dots) = scene_for(printer), path_of(printer)
    dots[0] = False
    trace = measured(path, dots, scene, [], NOISE_MM, np.random.default_rng(seed))
    posterior = posterior_of(fitted(trace, scene), np.random.default_rng(0))
    assert not any(part.acts_mm.any() for part in posterior.parts)


def test_an_axis_that_moved_little_is_learned_from_home(ender5: Printer, rng: np.random.Generator) -> None:
    """Play may hide so short a way, but not the way from the end stops to it."""
    twin = Twin.of(fault("pulley", np.random.default_rng(5), "damaged"), ender5)
    x, y = rng.uniform(90, 90.5, 60), rng.uniform(70, 150, 60)
    way = np.vstack([ender5.home_mm[:2], np.stack([x, y], axis=1)])
    printed = twin.follow(way)
    seen_mm = printed + rng.normal(0, 0.02, printed.shape)
    seen_mm[0] = np.nan
    trace = Trace(way, seen_mm, homed=True)
    mechanism = learn_model(trace, ender5).mechanism
    naive = np.abs(printed - way)[1:, 0].mean()
    assert naive > 0.5
    assert np.abs(print_from_home(mechanism, way[1:]) - printed[1:])[:, 0].mean() < 0.02


def test_a_motor_that_stood_still_has_faults_of_finite_size(ender5: Printer, rng: np.random.Generator) -> None:
    """In the middle of its axis, where slopes are counted from 0."""
    x = np.linspace(20, 200, 40)
    way = np.stack([x, np.full_like(x, ender5.middle_mm[1])], axis=1)
    scene, named = scene_of(Trace(way, way, homed=True), ender5, (40.0, 40.0)), set()
    for block in blocks_of(scene, lambda term: term.where == 1):
        sizes = rng.normal(size=(block.sds_mm.shape[1], 20)) * block.sds_mm[0][:, None]
        found = Found(EFFECTS[block.effect], 1, block.shape, sizes[:, 0], sizes, acts=True)
        for said in getattr(found.law, "faults", lambda *_: ())(found, [found], scene):
            named.add(block.effect)
            assert np.isfinite([said.value, said.sd]).all()
    assert {"scale", "play"} <= named
    assert "bend" not in named


COMMON = ("place", "scale", "play", "skew", "pulley", "idler", "drift", "turn", "halves")


def test_a_long_trace_leaves_no_effect_out_that_all_of_its_marks_show() -> None:
    """Else all of several that may stand for one another would come to a drawn machine."""
    printer, rng = read_printer("ender3"), np.random.default_rng(1)
    path = np.vstack([printer.home_mm, rng.uniform(10, 210, (5000, 2))])
    seen = path * [1.0002, 1.0] + rng.normal(0, 0.1, path.shape)
    trace = Trace(path, seen, homed=True)
    fit = fitted(trace, scene_of(trace, printer))
    assert fit.search.gains(fit.state, fit.search.offered(fit.state.members)).values.max() <= 0


def test_drawn_printers_rank_evenly_among_their_draws() -> None:
    """Simulation-based calibration, in small: `benchmarks/bench_sbc.py` does it in large."""
    printer = read_printer("ender3")
    scene, (path, dots) = scene_for(printer), path_of(printer)
    dots[0] = False
    places, ranks = drawn_places(scene), []
    for seed in range(40):
        rng = np.random.default_rng([7, seed])
        true = [part for part in drawn_parts(scene, rng) if part.effect in COMMON]
        trace = measured(path, dots, scene, true, NOISE_MM, rng)
        fit = fitted(trace, scene, names=COMMON, quick=True)
        parts = posterior_of(fit, rng).parts
        none = np.zeros((len(places), 2, 1))
        acts = sum((_moved(part, part.acts_mm[:, None], places, scene) for part in parts), none)
        truth = sum((_moved(part, part.sizes_mm[:, None], places, scene) for part in true), none) - acts
        draws = sum((_moved(part, part.draws_mm, places, scene) for part in parts), none) - acts
        one, axis = int(rng.integers(len(places))), int(rng.integers(2))
        left = (np.square(each).sum(axis=(0, 1)) for each in (truth, draws))
        ranks.append([_rank(truth[one, axis], draws[one, axis], rng), _rank(*left, rng)])
    for column in np.array(ranks).T:
        counts = np.histogram(column, bins=5, range=(0, 1))[0]
        assert np.sum((counts - 8.0) ** 2 / 8.0) < 18.5  # χ² of 4 degrees: one in a thousand is larger


def _rank(truth: np.ndarray, draws: np.ndarray, rng: np.random.Generator) -> float:
    below, same = (draws < truth - 1e-9).sum(), (np.abs(draws - truth) <= 1e-9).sum()
    return float((below + rng.uniform() * (same + 1)) / (DRAWS + 1))


def test_normal_noise_is_taken_for_what_it_is(rng: np.random.Generator) -> None:
    """Its variance by the weighed rows is its own, and rows far off count for next to nothing."""
    noise, ones = NOISE_MM * rng.standard_normal(40_000), np.ones(40_000)
    rows = Rows(np.arange(40_000), np.ones((40_000, 2)), noise, ones, ones)
    gram = gram_of(np.zeros((40_000, 0)), rows, weighed(rows, noise))
    assert gram.square / gram.count == pytest.approx(NOISE_MM**2, rel=0.02)
    noise[:40] = 1.0
    assert weighed(rows, noise)[:40].max() < 0.01


def test_each_axis_counts_by_its_own_scatter(rng: np.random.Generator) -> None:
    along = np.repeat(np.eye(2), 4000, axis=0)
    noise, ones = NOISE_MM * (along @ [1.0, 3.0]) * rng.standard_normal(8000), np.ones(8000)
    weight = reweighed(Rows(np.arange(8000), along, noise, ones, ones), noise)
    assert np.median(weight[:4000]) / np.median(weight[4000:]) == pytest.approx(9.0, rel=0.15)
    assert np.exp(np.log(weight).mean()) == pytest.approx(1.0, abs=0.02)


def _moved(part: object, sizes: np.ndarray, places: object, scene: Scene) -> np.ndarray:
    if EFFECTS[part.effect].of is not Of.MACHINE:  # type: ignore[attr-defined]
        return np.zeros((len(places), 2, sizes.shape[1]))  # type: ignore[arg-type]
    columns = columns_of(part.effect, places, part.where, part.shape, scene)  # type: ignore[attr-defined,arg-type]
    return np.asarray(np.einsum("ncp,pd->ncd", columns, sizes))


def test_a_size_below_0_is_one_above_0_the_other_way_round(rng: np.random.Generator) -> None:
    columns, one = rng.standard_normal((40, 3)), np.ones(40)
    error, found = columns @ [1.0, -0.3, 0.2] + rng.standard_normal(40), []
    for sign in (1, -1):
        blocks = tuple(Block(name, 0, (), slice(b, b + 1), np.array([[1.0], [0.3]]), np.array([-0.5, -1.0]), signs)
                       for b, (name, signs) in enumerate((("scale", np.zeros(2)), ("skew", np.zeros(2)),
                                                          ("play", sign * np.array([1, -1])))))  # fmt: skip
        rows = Rows(np.arange(40), np.ones((40, 2)), error, one, one)
        search = search_of(Dictionary(blocks, columns * [1, 1, sign]), rows, one)
        states = [search.posterior(((0, 0), (2, at)), 1.0, rounds=0) for at in range(2)]
        without = search.posterior(((0, 0),), 1.0, rounds=0)
        gains = search.gains(without, np.array([2])).values
        assert gains == pytest.approx([state.score - without.score for state in states])
        dropped = [search.beside(state).without((2, at)).told for at, state in enumerate(states)]
        assert dropped == pytest.approx(-gains)
        found.append([*gains, *(sign * state.mean_mm[1] for state in states)])
        likely = np.exp(gains) / (1 + np.exp(gains).sum())
        best = max((without, *states), key=lambda state: state.score)
        drawn = Counter(each for _ in range(40) for each in drawn_sets(search, best, rng))
        shares = np.array([sum(count for each, count in drawn.items() if (2, at) in each) for at in range(2)])
        if best is without:
            assert shares / shares.sum() == pytest.approx(likely / likely.sum(), abs=0.05)
    assert found[0] == pytest.approx(found[1])


def test_sets_are_drawn_by_their_weight(rng: np.random.Generator) -> None:
    """Of four alike causes of a few numbers, the chain visits each of the sixteen sets as often as it weighs."""
    columns = rng.standard_normal((12, 1)) + 0.7 * rng.standard_normal((12, 4))
    error = columns @ [0.6, 0.0, 0.4, 0.0] + rng.standard_normal(12)
    names = ("scale", "skew", "play", "bend")
    blocks = tuple(Block(name, 0, (), slice(b, b + 1), np.ones((1, 1)), np.array([-0.5]), name == "play")
                   for b, name in enumerate(names))  # fmt: skip
    one = np.ones(12)
    rows = Rows(np.arange(12), np.ones((12, 2)), error, one, one)
    search = search_of(Dictionary(blocks, columns), rows, one)
    every = [tuple((b, 0) for b in range(4) if number >> b & 1) for number in range(16)]
    states = {members: search.posterior(members, 1.0, rounds=0) for members in every}
    weights = np.exp([states[members].score for members in every])
    likeliest = max(states.values(), key=lambda each: each.score)
    drawn = Counter(each for _ in range(40) for each in drawn_sets(search, likeliest, rng))
    shares = np.array([drawn[members] for members in every]) / (40 * DRAWS)
    assert shares == pytest.approx(weights / weights.sum(), abs=0.025)


def test_causes_that_change_at_once_are_drawn_by_their_weight(rng: np.random.Generator) -> None:
    """Eight causes that have nothing to do with each other: each of the twelve shapes of one is as likely as alone."""
    causes, shapes, length, one = 8, 12, 20, np.ones(160)
    columns, error = np.zeros((160, causes * shapes)), 0.5 * rng.standard_normal(160)
    for cause in range(causes):
        mine, own = slice(cause * length, (cause + 1) * length), slice(cause * shapes, (cause + 1) * shapes)
        columns[mine, own] = rng.standard_normal((length, 1)) + 0.15 * rng.standard_normal((length, shapes))
        error[mine] += 2.0 * columns[mine, own.start]
    blocks = tuple(
        Block("skew", b // shapes, (float(b),), slice(b, b + 1), np.ones((1, 1)), np.array([-4.0]))
        for b in range(causes * shapes)
    )
    search = search_of(Dictionary(blocks, columns), Rows(np.arange(160), np.ones((160, 2)), error, one, one), one)
    scores = np.array([search.posterior(((b, 0),), 0.5, rounds=0).score for b in range(causes * shapes)])
    weights = np.array([np.exp(some - some.max()) for some in scores.reshape(causes, shapes)])
    weights /= weights.sum(axis=1, keepdims=True)
    likeliest = tuple((int(b), 0) for b in shapes * np.arange(causes) + weights.argmax(axis=1))
    state = search.posterior(likeliest, 0.5, rounds=0)
    drawn = [each for _ in range(5) for each in drawn_sets(search, state, rng)]
    other = np.mean([len(set(members) - set(likeliest)) for members in drawn])
    assert other == pytest.approx(np.sum(1 - weights.max(axis=1)), abs=0.15)


def test_of_many_unlikely_causes_as_many_are_drawn_as_there_should_be(rng: np.random.Generator) -> None:
    """Sixty places where a cause of two shapes may be, each unlikely and unseen, beside one cause that is there."""
    odds, one = np.exp(-4.0), np.ones(12)
    causes = (("scale", 0, 1.0), *(("skew", where, shape) for where in range(60) for shape in (1.0, 2.0)))
    blocks = tuple(
        Block(name, where, (shape,), slice(b, b + 1), np.ones((1, 1)), np.array([0.0 if name == "scale" else -4.0]))
        for b, (name, where, shape) in enumerate(causes)
    )
    columns = np.hstack([np.ones((12, 1)), np.zeros((12, 120))])
    rows = Rows(np.arange(12), np.ones((12, 2)), 5.0 + rng.standard_normal(12), one, one)
    search = search_of(Dictionary(blocks, columns), rows, one)
    drawn = [each for _ in range(10) for each in drawn_sets(search, search.posterior(((0, 0),), 1.0, rounds=0), rng)]
    assert all(len({blocks[b].slot for b, _ in members}) == len(members) for members in drawn)
    assert np.mean([len(members) - 1 for members in drawn]) == pytest.approx(60 * 2 * odds / (1 + 2 * odds), abs=0.2)


def test_what_is_there_for_sure_may_be_of_any_likely_size(rng: np.random.Generator) -> None:
    """One cause is there for sure; each of the sizes that it may usually have is drawn as often as it weighs."""
    column = np.ones((12, 1))
    blocks = (Block("scale", 0, (), slice(0, 1), np.array([[4.0], [8.0], [40.0]]), np.zeros(3)),)
    one = np.ones(12)
    rows = Rows(np.arange(12), np.ones((12, 2)), 8.0 + rng.standard_normal(12), one, one)
    search = search_of(Dictionary(blocks, column), rows, one)
    states = [search.posterior(((0, variant),), 1.0, rounds=0) for variant in range(3)]
    weights = np.exp([state.score for state in states])
    drawn = Counter(each for _ in range(40) for ((_, each),) in drawn_sets(search, states[1], rng))
    assert np.array([drawn[v] for v in range(3)]) / (40 * DRAWS) == pytest.approx(weights / weights.sum(), abs=0.025)


@pytest.mark.parametrize("sign", [1, -1])
def test_what_must_be_of_one_sign_is_drawn_so(sign: int, rng: np.random.Generator) -> None:
    """Of two sizes that hang together, one of one sign, both are drawn as by trying until the one has it."""
    mean, root = np.array([-0.5 * sign, 1.0]), np.array([[1.0, 0.8], [0.0, 0.5]])
    state = State(((0, 0), (1, 0)), np.arange(2), mean, root, 1.0, 0.0)
    drawn = drawn_of(state, np.array([sign, 0]), 20000, rng)
    tried = mean[:, None] + root.T @ rng.standard_normal((2, 80000))
    tried = tried[:, sign * tried[0] > 0]
    assert (sign * drawn[0]).min() > 0
    assert drawn.mean(axis=1) == pytest.approx(tried.mean(axis=1), abs=0.02)
    assert np.cov(drawn) == pytest.approx(np.cov(tried), abs=0.02)


def test_dropping_a_member_is_as_if_it_had_not_been_there(rng: np.random.Generator) -> None:
    """The gains beside a set whose member was taken out are those of the smaller set: by how much its score grows."""
    columns = rng.standard_normal((40, 9)) + 0.8 * rng.standard_normal((40, 1))
    widths, first, blocks = (2, 1, 3, 1, 2), 0, []
    for name, width in zip(("scale", "skew", "pulley", "play", "bend"), widths, strict=True):
        sizes, odds = rng.uniform(0.5, 2.0, (2, width)), np.array([-0.5, -1.0])
        blocks.append(Block(name, 0, (), slice(first, first + width), sizes, odds, name == "play"))
        first += width
    one = np.ones(40)
    rows = Rows(np.arange(40), np.ones((40, 2)), columns @ rng.standard_normal(9) + rng.standard_normal(40), one, one)
    search = search_of(Dictionary(tuple(blocks), columns), rows, one)
    members, offered = ((2, 1), (0, 0), (1, 0)), np.array([0, 3, 4])
    state = search.posterior(members, 1.0, rounds=0)
    less = search.beside(state).without((0, 0))
    gains = less.gains(offered, -np.inf)
    fewer = (members[0], members[2])
    without = search.posterior(fewer, 1.0, rounds=0)
    assert state.score + less.told == pytest.approx(without.score, rel=1e-9)
    grown = [search.posterior((*fewer, (b, variant)), 1.0, rounds=0) for b, variant in gains.keys.tolist()]
    assert sorted(gains.keys.tolist()) == [[b, variant] for b in offered for variant in range(2)]
    np.testing.assert_allclose(gains.values, [each.score - without.score for each in grown], rtol=1e-9)
    for least in np.linspace(-20.0, 5.0, 11):  # a bound leaves out none that is as good
        above = gains.keys[less.told + gains.values > least].tolist()
        assert [each for each in less.gains(offered, least).keys.tolist() if each in above] == above
    assert not len(search.narrowed([]).gains(search.narrowed([]).posterior((), 1.0), np.zeros(0, int)).keys)


def test_what_is_given_is_summed_out(rng: np.random.Generator) -> None:
    """Beside members that stay, others add to the score what they add to that of all, in every search."""
    columns = rng.standard_normal((30, 6)) + 0.8 * rng.standard_normal((30, 1))
    blocks = tuple(
        Block(name, 0, (), slice(2 * b, 2 * b + 2), rng.uniform(0.5, 2.0, (1, 2)), np.array([-0.5]))
        for b, name in enumerate(("scale", "skew", "bend"))
    )
    one = np.ones(30)
    rows = Rows(np.arange(30), np.ones((30, 2)), columns @ rng.standard_normal(6) + rng.standard_normal(30), one, one)
    search = search_of(Dictionary(blocks, columns), rows, one)
    given = search.given(((0, 0),), 0.8).given(((1, 0),), 0.8)
    more = [given.posterior(each, 0.8, rounds=0) for each in ((), ((2, 0),))]
    whole = [search.posterior(((0, 0), (1, 0), *each), 0.8, rounds=0) for each in ((), ((2, 0),))]
    assert more[1].score - more[0].score == pytest.approx(whole[1].score - whole[0].score, rel=1e-9)
    np.testing.assert_allclose(more[1].mean_mm, whole[1].mean_mm[4:], rtol=1e-9)


def test_errors_of_millimetres_are_weighed_beside_noise_of_micrometres(rng: np.random.Generator) -> None:
    """A picture of another size than it says is all but the same as two scales: sets score as rows and priors, laid one
    under the other and triangulated, have it."""
    x, y = (
        np.stack([rng.uniform(-1.0, 1.0, 300), np.zeros(300)]),
        np.stack([np.zeros(300), rng.uniform(-1.0, 1.0, 300)]),
    )
    nearly = (x + y) * (1 + 1e-5 * rng.standard_normal((2, 300)))
    columns = np.stack([each.ravel() for each in (x, y, nearly, np.sin(8 * x), np.sin(8.1 * x))], axis=1)
    sds = (20.0, 20.0, 4.0, 1.0, 1.0)
    blocks = tuple(
        Block(name, where, (), slice(b, b + 1), np.array([[sd]]), np.zeros(1))
        for b, (name, where, sd) in enumerate(
            zip(("scale", "scale", "resized", "idler", "idler"), (0, 1, 0, 0, 1), sds, strict=True)
        )
    )
    error, one, sigma = columns @ [9.4, 0.0, 0.0, 0.4, 0.0] + 1e-3 * rng.standard_normal(600), np.ones(600), 2e-3
    search = search_of(Dictionary(blocks, columns), Rows(np.arange(600), np.ones((600, 2)), error, one, one), one)

    def laid_out(members: Sequence[int]) -> float:
        rows = np.vstack([np.column_stack([columns[:, members], error]) / sigma,
                          np.eye(len(members), len(members) + 1) / np.array(sds)[members, None]])  # fmt: skip
        root = np.abs(np.diag(np.linalg.qr(rows, mode="r")))
        return float(
            -search.gram.count * np.log(sigma) - root[-1] ** 2 / 2 - np.log(root[:-1] * np.array(sds)[members]).sum()
        )

    for members in ([0, 3], [0, 1, 3], [0, 1, 2, 3], [0, 2, 3], [0, 1, 2, 3, 4]):
        state = search.posterior(tuple((b, 0) for b in members), sigma, rounds=0)
        assert state.score == pytest.approx(laid_out(members), abs=0.01), members
    given = search.given(((0, 0), (1, 0)), sigma)
    two = [given.posterior(tuple((b, 0) for b in members), sigma, rounds=0).score for members in ([3], [2, 3])]
    assert two[1] - two[0] == pytest.approx(laid_out([0, 1, 2, 3]) - laid_out([0, 1, 3]), abs=0.01)


def test_what_most_machines_have_acts_though_no_size_of_it_is_likelier_than_nothing(rng: np.random.Generator) -> None:
    noise = np.linalg.qr(np.column_stack([np.ones(40), rng.standard_normal((40, 2))]))[0].T * np.sqrt(40)
    columns = np.column_stack([np.ones(40), noise[1]])
    blocks = tuple(
        Block(name, 0, (), slice(b, b + 1), np.array(sds)[:, None], np.full(len(sds), odds))
        for b, (name, sds, odds) in enumerate((("place", [1.0, 0.8, 0.6, 0.5], -1.0), ("skew", [1.0], -1.0)))
    )
    one = np.ones(40)
    rows = Rows(np.arange(40), np.ones((40, 2)), 0.33 * one + 0.25 * noise[1] + noise[2], one, one)
    search = search_of(Dictionary(blocks, columns), rows, one)
    none = search.posterior((), 1.0, rounds=0)
    assert search.gains(none, np.arange(2)).values.max() < 0
    sets = Counter(drawn_sets(search, none, rng))
    assert sum(count for members, count in sets.items() if 0 in dict(members)) > sets.total() / 2
    assert [b for b, _ in likely_set(search, none, sets).members] == [0]


def test_a_certain_cause_acts_though_another_is_in_doubt(rng: np.random.Generator) -> None:
    """Of a scale that a fifth of the drawn machines lack these would lose: it does not act, and all play does."""
    scene, there = replace(scene_for(read_printer("ender3")), placed=False), (np.arange(DRAWS) % 5 > 0) * 1.0
    play = Part("play", 1, (), np.array([0.3]), 0.3 + rng.normal(0, 0.001, (1, DRAWS)))
    scale = Part("scale", 1, (), np.array([0.5]), 0.5 * there[None] + rng.normal(0, 0.001, (1, DRAWS)))
    for parts in ((play, scale), (scale, play)):
        acts = {part.effect: part.acts_mm[0] for part in acting(scene, parts)}
        assert acts == {"play": 0.3, "scale": 0.0}
    sure = replace(scale, draws_mm=np.full((1, DRAWS), 0.5))
    assert [part.acts_mm[0] for part in acting(scene, (play, sure))] == [0.3, 0.5]


def test_what_helps_only_together_acts_together_and_takes_nothing_else_with_it(rng: np.random.Generator) -> None:
    """Two leans nearly cancel. Each helps beside the other; where no machine has them, neither acts, and play does."""
    scene = replace(scene_for(read_printer("ender3")), placed=False)
    play = Part("play", 1, (), np.array([0.3]), 0.3 + rng.normal(0, 0.001, (1, DRAWS)))
    leans = [
        Part("skew", where, (), np.array([size]), np.full((1, DRAWS), size)) for where, size in ((0, 0.4), (1, -0.3))
    ]
    assert [part.acts_mm[0] for part in acting(scene, (*leans, play))] == [0.4, -0.3, 0.3]
    absent = [replace(each, draws_mm=np.zeros((1, DRAWS))) for each in leans]
    assert [part.acts_mm[0] for part in acting(scene, (*absent, play))] == [0.0, 0.0, 0.3]


def test_what_acts_shifts_all_of_a_print_as_the_drawn_machines_do(rng: np.random.Generator) -> None:
    """A gantry that racks moves home as well; it does not act, and the pulley's shape still does."""
    scene = scene_for(read_printer("ender3"))
    waves = np.zeros((64, DRAWS))
    waves[0] = 0.03 + rng.normal(0, 0.002, DRAWS)
    pulley = Part("pulley", 1, (), waves.mean(axis=1), waves)
    racking = Part("racking", 1, (), np.zeros(2), np.array([[0.05], [0.0]]) + rng.normal(0, 0.002, (2, DRAWS)))
    acts = acting(scene, (pulley, racking))
    assert {part.effect for part in acts if part.acts_mm.any()} == {"pulley", "place"}
    places = drawn_places(scene)
    made, drawn = (
        sum(seen_at(part.key, places, scene) @ sizes(part) for part in acts).mean(axis=1)
        for sizes in (lambda part: part.acts_mm, lambda part: np.median(part.draws_mm, axis=1))
    )
    assert made == pytest.approx(drawn, abs=0.001)
    assert not any(part.acts_mm.any() for part in acting(scene, (racking,)))
    assert [part.key for part in acting(scene, (racking, racking))][:2] == [racking.key] * 2


def test_of_causes_that_look_alike_the_one_between_the_others_acts(rng: np.random.Generator) -> None:
    """In a scan of a CoreXY whose scale is open, a lean is that of the frame or of either belt."""
    printer = read_printer("corexy")
    path, _ = path_of(printer)
    trace = Trace(path, path, homed=True, placed=False)
    fit = fitted(trace, scene_of(trace, printer), names=("turn", "scale", "skew"), quick=True)
    number = {block.slot: b for b, block in enumerate(fit.dictionary.blocks)}
    sizes = {("scale", 0): 0.4, ("skew", 0): 0.4, ("scale", 1): -0.4}
    at = rng.permutation(DRAWS) % 3
    drawn, states = {}, []
    for k, (slot, size) in enumerate(sizes.items()):
        drawn[number[slot]] = Part(*slot, (), np.zeros(1), size * (at == k)[None])
        columns = np.array([fit.dictionary.blocks[number[slot]].at.start])
        states.append(State(((number[slot], 0),), columns, np.array([size]), np.eye(1), 0.01, 0.0))
    assert central(fit, drawn, states) is states[1]
    first = number["scale", 0]
    assert central(fit, {first: replace(drawn[first], draws_mm=np.full((1, DRAWS), 0.4))}, states) is states[0]


def test_a_guide_that_ends_steeply_makes_no_lean(rng: np.random.Generator) -> None:
    """A skewed CoreXY with a rail that waves: its lean is as large as it is, whatever slope the wave ends with."""
    printer, (path, dots) = read_printer("corexy"), path_of(read_printer("corexy"))
    x, y = path.T
    off_mm = np.stack([0.0012 * y, 0.05 * np.sin((x - 20) / 45)], axis=1)
    seen = path + off_mm - off_mm[0] + rng.normal(0, 0.01, path.shape)
    model = learn_model(Trace(path, np.where(dots[:, None], seen, np.nan), homed=True), printer)
    (lean,) = (fault for fault in model.document["diagnosis"] if fault["kind"] == "skew")
    assert abs(lean["value"]) == pytest.approx(np.degrees(0.0012), abs=0.015)
    assert not [fault for fault in model.document["diagnosis"] if fault["kind"] == "scale"]


def test_what_changes_play_comes_only_with_play_and_keeps_it(rng: np.random.Generator) -> None:
    """Motors that turn one way alone see changes of play as an uneven pulley: one cause that may be, another not."""
    columns = np.hstack([np.ones((40, 1)), rng.standard_normal((40, 2))])
    blocks = tuple(
        Block(name, 0, (), slice(b, b + 1), np.full((2, 1), [[1.0], [0.3]]), np.array([-0.5, -0.5]), needs=needs)
        for b, (name, needs) in enumerate((("play", ()), ("breathing", ("play", "friction")), ("skew", ())))
    )
    one = np.ones(40)
    rows = Rows(np.arange(40), np.ones((40, 2)), columns @ [0.02, 2.0, 0.0] + rng.standard_normal(40), one, one)
    search = search_of(Dictionary(blocks, columns), rows, one)
    assert search.offered(()).tolist() == [0, 2]
    assert search.offered(((0, 1),)).tolist() == [1, 2]
    both = ((0, 0), (1, 0))
    assert search.needed(both, (0, 0))
    assert not search.needed(both, (1, 0))
    assert {b for b, _ in searched(search, both, 1.0).members} >= {0, 1}
    drawn = drawn_sets(search, searched(search, both, 1.0), rng)
    assert all(1 not in each or 0 in each for each in ({b for b, _ in members} for members in drawn))


def test_alternatives_are_drawn_as_often_as_their_odds_say() -> None:
    odds, rng = np.array([5.0, 0.0, 2.5, 0.7]), np.random.default_rng(0)
    counts = np.array([np.bincount(drawn_by(odds, 96, rng), minlength=4) for _ in range(400)])
    wanted = 96 * odds / odds.sum()
    assert np.abs(counts - wanted).max() < 1
    assert np.allclose(counts.mean(axis=0), wanted, atol=0.1)


def test_causes_that_stand_for_another_only_together_are_doubted(rng: np.random.Generator) -> None:
    """A turned plate beside one leaning axis is the other axis leaning. No single exchange finds that."""
    x, y = rng.uniform(-1.0, 1.0, (2, 60))
    error, none, one = np.append(y, 0 * y), np.zeros(60), np.ones(120)  # y pushes x: one axis leans
    columns = np.stack([np.append(y, -x), np.append(none, x), error], axis=1)  # the turn, the other axis, and this one
    blocks = tuple(
        Block(name, where, (), slice(b, b + 1), np.array([[2.0]]), np.array([odds]))
        for b, (name, where, odds) in enumerate((("turn", 0, -3.0), ("skew", 0, -2.0), ("skew", 1, -4.0)))
    )
    noisy = error + 0.01 * rng.standard_normal(120)
    rows = Rows(np.arange(120), np.ones((120, 2)), noisy, one, one)
    search = search_of(Dictionary(blocks, columns), rows, one)
    stuck = searched(search, ((0, 0), (1, 0)), 0.01)
    assert sorted(stuck.members) == [(0, 0), (1, 0)]
    every = [
        search.posterior(tuple((b, 0) for b in some), 0.01)
        for count in range(4)
        for some in itertools.combinations(range(3), count)
    ]
    found = doubted(search, stuck)
    assert found.members == max(every, key=lambda each: each.score).members == ((2, 0),)
    assert doubted(search, found) is found


def test_two_linear_causes_are_exchanged_for_two_others_and_drawn_by_their_weight(rng: np.random.Generator) -> None:
    """Two scales of a CoreXY are two leans. No exchange of one helps, and without one another scale stands for it."""
    x, y = rng.uniform(-1.0, 1.0, (2, 60))
    none, one = np.zeros(60), np.ones(120)
    belts = np.stack([np.append(x + y, x + y), np.append(x - y, y - x)], axis=1) / 2
    columns = np.column_stack([belts, np.append(y, none), np.append(none, x), np.append(x, y)])
    odds = {("scale", 0): -2.0, ("scale", 1): -2.0, ("skew", 0): -1.5, ("skew", 1): -1.5, ("resized", 0): -3.0}
    blocks = tuple(
        Block(name, where, (), slice(b, b + 1), np.array([[1.0]]), np.array([odds[name, where]]))
        for b, (name, where) in enumerate(odds)
    )
    error = np.append(y, x) + 0.01 * rng.standard_normal(120)
    search = search_of(Dictionary(blocks, columns), Rows(np.arange(120), np.ones((120, 2)), error, one, one), one)
    scales, leans = (search.posterior(members, 0.01, rounds=0) for members in (((0, 0), (1, 0)), ((2, 0), (3, 0))))
    stuck = searched(search, scales.members, 0.01)
    assert stuck.members == scales.members
    assert doubted(search, stuck).members == leans.members
    drawn = Counter(each for _ in range(20) for each in drawn_sets(search, leans, rng))
    assert drawn[scales.members] / drawn[leans.members] == pytest.approx(np.exp(scales.score - leans.score), rel=0.3)


def test_linear_effects_are_linear() -> None:
    for scene in scenes():
        places = drawn_places(scene)
        off_mm = np.column_stack([np.ones(len(places)), scene.off_middle(places.bed_mm)])
        for term in (term for name in LINEAR for term in EFFECTS[name].terms(scene)):
            columns = columns_of(term.effect, places, term.where, term.shape, scene)[:, :, 0]
            assert np.allclose(off_mm @ np.linalg.lstsq(off_mm, columns, rcond=None)[0], columns)
            assert not term.shape


def test_a_cause_that_stands_for_two_takes_their_place(rng: np.random.Generator) -> None:
    """A creep of a time a little off and a shift are one creep, which fits a little worse: no exchange finds that, and
    in the shift's place something else would come first."""
    fast, shift, own, other, noise = np.linalg.qr(rng.standard_normal((120, 5)))[0].T * np.sqrt(120)
    both = fast + 0.3 * shift
    columns = np.stack([fast, shift, both + 1.6e-3 * own, shift + 4e-3 * other], axis=1)
    blocks = tuple(
        Block(name, 0, shape, slice(b, b + 1), np.array([[2.0]]), np.array([-4.0]))
        for b, (name, shape) in enumerate((("creep", (0.1,)), ("place", ()), ("creep", (0.16,)), ("tilt", ())))
    )
    one = np.ones(120)
    rows = Rows(np.arange(120), np.ones((120, 2)), both + 0.01 * noise, one, one)
    search = search_of(Dictionary(blocks, columns), rows, one)
    stuck = searched(search, ((0, 0), (1, 0)), 0.01)
    assert stuck.members == ((0, 0), (1, 0))
    assert doubted(search, stuck).members == ((2, 0),)


@pytest.mark.parametrize("freed", [0, 3])
def test_a_kernel_gains_what_the_formula_says(freed: int, rng: np.random.Generator) -> None:
    """For blocks of every width, side by side, with members taken out or not; what is not asked for is left alone."""
    shapes, variance = [(1, 3), (1, 3), (2, 1), (2, 1), (2, 1), (7, 4), (12, 2), (12, 2)], 0.7
    first = np.cumsum([0, *(p for p, _ in shapes)])
    slope, half = rng.standard_normal(first[-1]), 0.3 * rng.standard_normal((first[-1], 5))
    out_of, pull = rng.standard_normal((5, freed)), rng.standard_normal(freed)
    products = [at.T @ at + 5 * np.eye(p) for p, _ in shapes for at in [rng.standard_normal((p + 3, p))]]
    sizes = [rng.uniform(0.1, 2, (v, p)) for p, v in shapes]
    log_odds = rng.standard_normal(sum(v for _, v in shapes))
    asked, signs = rng.uniform(size=len(log_odds)) < 0.7, np.zeros(len(log_odds))
    signs[:6] = [0, 1, -1, 0, 1, -1]
    blocks = np.array([(at, *shape) for at, shape in zip(first, shapes, strict=False)])
    alternatives = kernels.Alternatives(blocks, np.concatenate([each.ravel() for each in sizes]), log_odds, signs)
    out, flat = np.full(len(asked), 9.0), np.concatenate([each.ravel() for each in products])
    kernels.gains(alternatives, flat, variance, slope, half, out_of, pull, asked, out)
    wanted = []
    for at, own, sds_mm in zip(first, products, sizes, strict=False):
        mine = half[at : at + len(own)]
        told = own / variance - mine @ mine.T + mine @ out_of @ (mine @ out_of).T
        pulled = slope[at : at + len(own)] + mine @ out_of @ pull
        for sd in sds_mm:
            whole, scaled = np.eye(len(sd)) + sd[:, None] * told * sd, sd * pulled
            wanted.append(0.5 * scaled @ np.linalg.solve(whole, scaled) - 0.5 * np.linalg.slogdet(whole)[1])
            if sign := signs[len(wanted) - 1]:
                wanted[-1] += special.log_ndtr(sign * pulled[0] / np.sqrt(sd[0] ** -2 + told[0, 0])) + np.log(2)
    np.testing.assert_allclose(out, np.where(asked, wanted + log_odds, 9.0), rtol=1e-9, atol=1e-12)


def test_a_kernel_weighs_a_set_as_the_formula_says(rng: np.random.Generator) -> None:
    """Of sets of every size: the normal posterior of the sizes and the evidence of the errors, of either sign."""
    for size in (0, 1, 7, 60):
        columns, sds_mm = rng.standard_normal((90, size)), rng.uniform(0.1, 2.0, size)
        errors, signs, variance = rng.standard_normal(90), np.zeros(size), 1.3
        signs[:1] = -1.0
        mean, root = np.empty(size), np.empty((size, size))
        given, limits = (float(errors @ errors), 90.0), (variance, 1e-6, 0, 1e-3)
        told = columns.T @ columns, columns.T @ errors
        found, evidence = kernels.weigh(told[0].copy(), told[1].copy(), sds_mm, signs, given, limits, mean, root)
        covariance = np.linalg.inv(told[0] / variance + np.diag(sds_mm**-2.0))
        whole = variance * np.eye(90) + columns * sds_mm**2 @ columns.T
        wanted = -0.5 * (np.linalg.slogdet(whole)[1] + errors @ np.linalg.solve(whole, errors))
        if size:
            wanted += special.log_ndtr(-mean[0] / np.sqrt(covariance[0, 0])) + np.log(2)
        np.testing.assert_allclose(mean, covariance @ told[1] / variance, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(root.T @ root, covariance, rtol=1e-9, atol=1e-12)
        assert (found, evidence) == (variance, pytest.approx(wanted, rel=1e-9))
        found, _ = kernels.weigh(
            told[0].copy(), told[1].copy(), sds_mm, signs, given, (variance, 1e-6, 300, 1e-9), mean, root
        )
        left = errors - columns @ mean
        freedom = size - np.trace(root.T @ root / np.outer(sds_mm, sds_mm)) if size else 0.0
        assert found == pytest.approx(float(left @ left + found * freedom) / 90, rel=1e-6)


def test_the_normal_tail_is_that_of_scipy() -> None:
    z = np.linspace(-60.0, 12.0, 800)
    assert log_below(z) == pytest.approx(special.log_ndtr(z), rel=1e-6, abs=1e-12)
    assert log_below(np.zeros((0, 3))).shape == (0, 3)
    assert np.array_equal(log_below(np.array([-1e200, -np.inf, np.inf])), [-np.inf, -np.inf, 0.0])


def test_a_dictionary_does_not_depend_on_the_places_that_no_row_is_of() -> None:
    printer = read_printer("ender3")
    path, dots = path_of(printer)
    scene, every = scene_for(printer), np.zeros((len(path), 2))
    places = places_of(Trace(path, path, homed=True), scene, np.tile(np.arange(len(path))[:, None], 2), every + 1, path)
    mark = np.flatnonzero(dots)[:20]
    rows = Rows(mark, np.tile([[1.0, 0.0]], (20, 1)), every[:20, 0], every[:20, 0] + 1, every[:20, 0] + 1)
    touched = contacts_of(healthy_mechanism(printer), printer.to_motor(path))
    found = dictionary_of(blocks_of(scene), Look(scene, places, rows, touched))
    for block in found.blocks:
        whole = seen(block.key, places, rows, scene)
        assert np.array_equal(found.columns[:, block.at], whole)
