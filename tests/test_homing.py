"""From one homing to the next: what a shift of the motors does to effects, to what acts, to a promise, to an update."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from printmend.corruption import Corruption, Drive, EccentricBore, Play
from printmend.corruption.transmission import Ripple
from printmend.diagnosis.advice import advise
from printmend.diagnosis.named import faults_of
from printmend.effects import EFFECTS, places_of, scene_of
from printmend.effects.homing import lasting, shifted, waves_of
from printmend.effects.switch import drawn_shifts_mm, homing_mm, refit_mm, scatter_of, spread_mm
from printmend.effects.words import fault_of
from printmend.errors import ConfigError
from printmend.infer.fit import fitted
from printmend.infer.posterior import Posterior, posterior_of
from printmend.infer.update import both_seen, renewed
from printmend.learn.learned import learn_model
from printmend.machine import Mechanism, healthy_mechanism, homed_again
from printmend.mend import check_gcode
from printmend.mend.verify import KEPT, verify
from printmend.model import SavedModel, saved_model
from printmend.path import Trace
from printmend.printer import Homing, Printer, read_printer
from printmend.printer.convert import printer_text
from printmend.printer.klipper import parse_klipper
from printmend.printer.toml import parse_printer
from printmend.promise.belief import Belief, belief_section, parse_belief
from printmend.promise.predict import after_homing
from printmend.twin import Twin
from tests.believed import SCENES
from tests.once import remembered
from tests.promised import CIRCLE
from tests.test_greybox_learning import stairs
from tests.test_printer_convert import KLIPPER
from tests.test_verify import checked

ENDER3 = replace(read_printer("ender3"), homing=Homing())
WAVY = [(name, shape) for name, shape in (
    ("pulley", ()), ("breathing", ()), ("idler", (31.0,)), ("teeth", (2.0,)), ("teeth", (0.4,))
)]  # fmt: skip


def of_switch(switch: str, printer: Printer = ENDER3) -> Printer:
    return replace(printer, homing=Homing(switch))  # type: ignore[arg-type]


def bent(size_mm: float = 0.4) -> Corruption:
    return Corruption((Drive(pulley=EccentricBore(size_mm, 1.0)), Drive(belt=Play(0.2))))


def printed(machine: Mechanism, seed: int, points: int = 400, noise_mm: float = 0.01) -> Trace:
    way = stairs(points)
    noise = np.random.default_rng(seed).normal(0, noise_mm, way.shape)
    return Trace(way, Twin(machine).follow(way) + noise, homed=True)


@remembered
def believed(machine: Mechanism, seed: int = 0) -> Posterior:
    trace = printed(machine, seed)
    fit = fitted(trace, scene_of(trace, machine.printer, (40.0, 40.0)))
    return posterior_of(fit, np.random.default_rng(0))


@pytest.mark.parametrize(("effect", "shape"), WAVY)
@pytest.mark.parametrize("by_mm", [0.1, -0.8, 13.0])
def test_shifted_sizes_are_the_same_wave_at_a_shifted_motor(
    effect: str, shape: tuple[float, ...], by_mm: float
) -> None:
    scene, rng = SCENES["ender3"], np.random.default_rng(2)
    waves_mm = waves_of(effect, 0, shape, scene)
    assert waves_mm is not None
    trace = Trace(rng.uniform(0, 220, (20, 2)), np.zeros((20, 2)))
    places = places_of(trace, scene, np.tile(np.arange(20)[:, None], 2), np.ones((20, 2)), trace.commanded_mm)
    sizes = rng.normal(size=(2 * len(waves_mm), 1))
    moved = EFFECTS[effect].columns(replace(places, motor_mm=places.motor_mm + by_mm), 0, shape, scene) @ sizes
    again = EFFECTS[effect].columns(places, 0, shape, scene) @ shifted(sizes, waves_mm, by_mm)
    assert moved == pytest.approx(again, abs=1e-9)


def test_the_twin_homes_again_with_the_same_pulley_elsewhere() -> None:
    machine = bent().lower(ENDER3)
    assert isinstance(machine, Mechanism)
    way = np.array([[0.0, 0.0], [10.0, 10.0], [30.0, 60.0]])
    whole_turn = Twin(homed_again(machine, np.array([40.0, 0.0]))).follow(way)
    assert whole_turn == pytest.approx(Twin(machine).follow(way), abs=1e-6)
    other = Twin(homed_again(machine, np.array([10.0, 0.0]))).follow(way)
    assert np.abs(other - whole_turn).max() > 0.1
    assert other[0] == pytest.approx(way[0])  # the end stops put home right


def test_each_motor_comes_to_stand_one_electrical_turn_of_its_own_aside() -> None:
    printer = read_printer("ender3")
    unlike = replace(printer, y=replace(printer.y, steps_per_turn=400), homing=Homing("sensorless", 0.0))
    scene = replace(SCENES["ender3"], printer=unlike)
    shifts_mm = drawn_shifts_mm(scene, 500, np.random.default_rng(0))
    for own_mm, turn_mm in zip(shifts_mm, 4 * np.array(unlike.mm_per_step), strict=True):
        assert np.unique(np.abs(own_mm).round(9)) == pytest.approx([0.0, turn_mm])


def test_draws_of_the_twins_homings_are_what_was_asked_for() -> None:
    rng = np.random.default_rng(4)
    shifts = np.array([homing_mm(ENDER3, rng, scatter_mm=0.05, turn_share=0.25) for _ in range(2000)])
    aside = np.rint(shifts / 0.8)
    assert np.mean(aside != 0) == pytest.approx(0.25, abs=0.03)
    assert (shifts - 0.8 * aside).std() == pytest.approx(0.05, rel=0.1)
    assert set(np.mod(refit_mm(ENDER3, rng), 2.0)) == {0.0}


@pytest.mark.parametrize(("switch", "kept"), [("unknown", {40.0}), ("phase", {40.0, 2.0, 0.8, 0.4, 0.2})])
def test_only_an_effect_that_the_next_homing_keeps_may_act(switch: str, kept: set[float]) -> None:
    """An electrical turn turns a belt tooth's wave round: who prints after one must not be worse off."""
    scene = replace(SCENES["ender3"], printer=of_switch(switch))
    waves = {40.0: ("idler", (40.0,)), **{each: ("teeth", (each,)) for each in (2.0, 0.8, 0.4, 0.2)}}
    sizes_mm = np.array([0.03, 0.0])
    shares = {length: lasting(sizes_mm, name, 0, shape, scene) for length, (name, shape) in waves.items()}
    assert {length for length, share in shares.items() if share is not None and share.all()} == kept
    assert lasting(np.ones(1), "play", 0, (), scene) is None
    long, short = shares[40.0], shares[2.0]
    assert long is not None
    assert short is not None
    assert 1.0 >= long[0] > short[0]


def test_a_pulleys_fine_waves_act_beside_its_long_ones() -> None:
    """It is the pulley that the next print must not be worse off with, not each of its waves."""
    scene = SCENES["ender3"]
    waves_mm = waves_of("pulley", 0, (), scene)
    assert waves_mm is not None
    sizes_mm = np.concatenate([0.3 / np.arange(1, len(waves_mm) + 1) ** 2.5, np.zeros(len(waves_mm))])
    share = lasting(sizes_mm, "pulley", 0, (), scene)
    assert share is not None
    assert share[waves_mm.argmax()] > share[waves_mm.argmin()] > 0.0
    sizes_mm[: len(waves_mm)][waves_mm > 3.0 * waves_mm.min()] = 0.0
    share = lasting(sizes_mm, "pulley", 0, (), scene)
    assert share is not None
    assert not share.any()


def test_seen_shifts_narrow_the_scatter() -> None:
    def sd_mm(*seen: tuple[float, float]) -> float:
        return float(spread_mm(replace(SCENES["ender3"], homed_again_mm=seen))[0])

    assert sd_mm(*[(0.004, 0.001), (-0.006, 0.001)] * 4) < 0.3 * sd_mm()
    assert sd_mm(*[(0.2, 0.01), (-0.3, 0.01)] * 4) > 1.2 * sd_mm()
    aside = scatter_of(ENDER3, ((0.8, 0.01),))
    assert aside.weight @ aside.sd_mm < 0.15  # an electrical turn is no wide scatter


def test_a_promise_holds_the_next_homing() -> None:
    machine = bent().lower(ENDER3)
    assert isinstance(machine, Mechanism)
    found = believed(machine)
    spreads = []
    for switch in ("phase", "sensorless"):
        scene = replace(found.scene, printer=of_switch(switch))
        belief = after_homing(Belief(scene, found.parts, placed=True))
        (pulley,) = (part for part in belief.parts if (part.effect, part.where) == ("pulley", 0))
        spreads.append(float(pulley.sd_mm[0] ** 2 + pulley.sd_mm[32] ** 2))
        (play,) = (part for part in belief.parts if (part.effect, part.where) == ("play", 1))
        assert play is next(part for part in found.parts if (part.effect, part.where) == ("play", 1))
    assert spreads[1] > 4 * spreads[0]


@pytest.mark.parametrize("by_mm", [0.0, 0.15])
def test_a_second_measurement_sees_how_far_the_end_stop_was_off(by_mm: float) -> None:
    machine = bent().lower(ENDER3)
    assert isinstance(machine, Mechanism)
    old = believed(machine)
    trace = printed(homed_again(machine, np.array([by_mm, 0.0])), 5)
    scene = both_seen(old.scene, scene_of(trace, ENDER3, (40.0, 40.0)))
    rng = np.random.default_rng(1)
    found = renewed(old.parts, machine.homed(), trace, scene, rng, first=old.scene, months=0.0)
    assert found.changes == ()
    (shift_mm, sd_mm), *_ = found.homed_mm
    assert shift_mm == pytest.approx(by_mm, abs=3 * sd_mm + 0.02)


@pytest.mark.parametrize("period_steps", [4.0, 10.0])
def test_a_ripple_that_a_homing_loses_is_named_and_not_mended(period_steps: float) -> None:
    machine = Corruption((Drive(Ripple((0.15,), (period_steps,), (1.0,))), Drive())).lower(ENDER3)
    assert isinstance(machine, Mechanism)
    found = believed(machine)
    (part,) = (part for part in found.parts if part.effect == "teeth" and part.chance > 0.9)
    assert not part.acts_mm.any()
    (fault,) = faults_of(found.parts, found.scene)
    assert (fault.part, fault.value) == ("x", pytest.approx(0.03, abs=0.005))
    for each in (fault, fault_of(fault.row)):
        assert not each.is_mended
        assert "leaves it" in advise(each).software


def test_what_is_known_of_homing_is_kept_in_printer_and_model() -> None:
    printer = replace(ENDER3, homing=Homing("switch", 0.03))
    assert parse_printer(printer_text(printer), subject="mine").homing == printer.homing
    assert "homing" not in printer_text(ENDER3)
    scene = replace(SCENES["ender3"], printer=printer, homed_again_mm=((0.1, 0.02),))
    model = saved_model(healthy_mechanism(printer), learner="test", findings=("",),
                        details={"promise": belief_section(scene, ())})  # fmt: skip
    belief = parse_belief(model)
    assert belief is not None
    assert belief.scene.homed_again_mm == ((0.1, 0.02),)
    assert belief.scene.printer.homing == printer.homing


@pytest.mark.parametrize(
    ("lines", "wanted"),
    [('switch = "magic"', "switch as one of"), ("scatter_mm = -1", "scatter_mm from 0"), ("kind = 1", "unknown key")],
)
def test_nonsense_about_homing_is_refused(lines: str, wanted: str) -> None:
    with pytest.raises(ConfigError, match=wanted):
        parse_printer(printer_text(ENDER3) + f"\n[homing]\n{lines}\n", subject="mine")


@pytest.mark.parametrize(
    ("old", "new", "switch"),
    [("", "", "unknown"), ("[stepper_x]", "[endstop_phase]\n[stepper_x]", "phase"),
     ("^PA5", "tmc2209_stepper_x:virtual_endstop", "sensorless")],
)  # fmt: skip
def test_klippers_file_says_how_it_homes(old: str, new: str, switch: str) -> None:
    assert parse_klipper(KLIPPER.replace(old, new, 1), name="mine", subject="mine").homing.switch == switch


LOOSE = Corruption((Drive(), Drive(belt=Play(0.2))))


@remembered
def learned_at(homed_mm: tuple[float, float], switch: str = "unknown") -> SavedModel:
    way = stairs(400)
    noise_mm = np.random.default_rng(3).normal(homed_mm, 0.03, way.shape)
    return learn_model(Trace(way, Twin.of(LOOSE, ENDER3).follow(way) + noise_mm, homed=True), of_switch(switch))


def test_a_shift_within_what_homings_do_is_no_fault_and_is_not_mended() -> None:
    model = learned_at((0.03, -0.02))
    assert [row["kind"] for row in model.document["diagnosis"]] == ["play"]
    assert "X healthy" in model.findings[0]
    assert not model.document["misfit"]["found"]
    belief = parse_belief(model)
    assert belief is not None
    assert not any(part.acts_mm.any() for part in belief.of("place", 0))
    assert sum(abs(part.acts_mm[0]) for part in belief.of("place", 1)) < 0.01  # that a belt rests in its play may last


def test_a_shift_beyond_them_is_told_the_end_stop_first() -> None:
    (found,) = learned_at((0.6, 0.0)).document["misfit"]["found"]
    assert found["kind"] == "moved"
    assert re.search(r"\(\+0\.[56]", found["words"])  # but for what a belt at rest in its play may make of it
    assert "from the home position: an end stop switched elsewhere, the plate" in found["words"]


def test_the_next_homing_moves_a_prints_place_and_not_its_shape(tmp_path: Path) -> None:
    (tmp_path / "part.gcode").write_text(CIRCLE)
    fine, coarse = (
        check_gcode(tmp_path / "part.gcode", learned_at((0.0, 0.0), switch)).after for switch in ("phase", "sensorless")
    )
    assert coarse.place_mm > 5 * fine.place_mm
    assert coarse.rms_mm == pytest.approx(fine.rms_mm, rel=0.1)
    assert coarse.rms_high_mm == pytest.approx(fine.rms_high_mm, rel=0.1)


@pytest.mark.parametrize(("homed_mm", "words"), [((-0.05, 0.06), ": kept ("), ((0.6, 0.0), "an end stop switched")])
def test_a_check_print_that_homed_elsewhere_keeps_its_promise(homed_mm: tuple[float, float], words: str) -> None:
    model = learned_at((0.03, -0.02))
    trace = checked(model, LOOSE, 0.03, is_stated=True)
    verdict = verify(model, replace(trace, measured_mm=trace.measured_mm + homed_mm))
    assert verdict.result == KEPT
    assert words in verdict.words
    assert bool(verdict.changed) == (homed_mm[0] > 0.5)
