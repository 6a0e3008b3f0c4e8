"""The grey box chooses parts that a trace can tell apart, and its tables say what its fit says."""

import dataclasses

import numpy as np
import pytest

from printmend.corruption import Corruption, Drive, ElasticBelt, FourierHull, Play
from printmend.learn.learned import learn
from printmend.machine import Mechanism
from printmend.path import Trace
from printmend.printer import read_printer
from printmend.probe import design_probe
from printmend.twin import Twin
from printmend_lab.bench.case import drawn_body
from printmend_lab.greybox import Greybox, GreyboxModel
from printmend_lab.published import layer_trace
from printmend_lab.sampling import sample

ENDER3, ENDER5 = read_printer("ender3"), read_printer("ender5")


def learned_layer(
    corruption: Corruption, rng: np.random.Generator, noise_mm: float = 0.0, *, turns: float = 2.5
) -> GreyboxModel:
    """Return what is learned from a layer of a body so many turns across."""
    layer = drawn_body(rng, ENDER5, size_mm=40.0 * turns).layers[0]
    trace = layer_trace(layer, Twin.of(corruption, ENDER5).run(layer.controls, layer.start_steps), ENDER5)
    noisy = trace.measured_mm + rng.normal(0, noise_mm, trace.measured_mm.shape)
    return Greybox().fit(dataclasses.replace(trace, measured_mm=noisy), ENDER5, rng=rng)


@pytest.mark.parametrize("seed", [2])
def test_a_learned_machine_prints_its_own_layer_again(seed: int) -> None:
    """Whole steps meet the ripple of one step at one phase: it is no ripple then, but an offset."""
    rng = np.random.default_rng(seed)
    twin = Twin.of(sample("everything", rng, "realistic"), ENDER5)
    layer = drawn_body(rng, ENDER5, size_mm=100.0).layers[0]
    printed = twin.run(layer.controls, layer.start_steps)
    model = Greybox().fit(layer_trace(layer, printed, ENDER5), ENDER5, rng=rng)
    again = Twin(model.mechanism).run(layer.controls, layer.start_steps)
    off_um = 200 * (again - printed)
    assert np.sqrt(np.mean(off_um**2)) < 5.0


@pytest.mark.parametrize("seed", [0])
def test_an_elastic_belt_is_learned_as_one_without_noise(seed: int) -> None:
    """A warp beside it explains the print no better, and holds only where the print went."""
    worn = FourierHull(5.94, (-0.229, -0.036, -0.006, 0.147), (0.504, -0.315, 0.413, -0.0004))
    drive = Drive(pulley=worn, belt=ElasticBelt(600.0))
    model = learned_layer(Corruption((drive, drive)), np.random.default_rng(seed))
    assert [drive.structure.warp_mm for drive in model.drives] == [0.0, 0.0]
    assert [drive.structure.elastic for drive in model.drives] == [True, True]


def test_what_repeats_nothing_is_no_elastic_belt_in_noise() -> None:
    """White residuals do not prove that a fit is right: noise hides the pattern of what it lacks."""
    rng = np.random.default_rng(0)
    corruption = sample("smooth", rng)
    model = learned_layer(corruption, rng, noise_mm=0.1)
    true = corruption.lower(ENDER5)
    assert isinstance(true, Mechanism)
    for drive, table, truth in zip(model.drives, model.mechanism.transmissions, true.transmissions, strict=True):
        motor_mm = np.linspace(*drive.branches.reach_mm, 200)
        off = table.branches_mm(motor_mm)[0] - truth.branches_mm(motor_mm)[0]
        assert np.std(off) < 0.008


def test_a_pulley_keeps_its_offset_in_noise() -> None:
    """Its waves have a zero of their own: without an offset they would bend to meet the layer where it starts."""
    rng = np.random.default_rng(8)
    corruption = sample("tabulated", rng)
    model = learned_layer(corruption, rng, noise_mm=0.1, turns=1.0)
    true = corruption.lower(ENDER5)
    assert isinstance(true, Mechanism)
    for drive, table, truth in zip(model.drives, model.mechanism.transmissions, true.transmissions, strict=True):
        motor_mm = np.linspace(*drive.branches.reach_mm, 200)
        off = table.branches_mm(motor_mm)[0] - truth.branches_mm(motor_mm)[0]
        assert drive.structure.offset
        assert np.abs(off - np.median(off)).max() < 0.04


def test_parts_that_were_left_out_count_in_the_standard_deviations() -> None:
    """Friction that noise hides is left out; the error bars allow for it."""
    inside, widened = [], []
    for seed in range(2, 8):
        rng = np.random.default_rng([107, seed])
        twin, plan = Twin.of(sample("friction", rng), ENDER3), design_probe(ENDER3)
        marks = twin.follow(plan.waypoints_mm)[plan.rows]
        model = Greybox().fit(plan.trace(marks + rng.normal(0, 0.05, marks.shape)), ENDER3, rng=rng)
        assert isinstance(twin.mechanism, Mechanism)
        for drive, table, truth in zip(
            model.drives, model.mechanism.transmissions, twin.mechanism.transmissions, strict=True
        ):
            motor_mm = np.linspace(*drive.branches.reach_mm, 200)
            off = np.stack(table.branches_mm(motor_mm)) - np.stack(truth.branches_mm(motor_mm))
            sds, bare = (np.stack(each.sd_mm(motor_mm)) for each in (drive, dataclasses.replace(drive, left_out=None)))
            inside.append(np.abs(off - np.median(off)) < 2 * sds)
            widened.append(float(np.min(sds / bare)))
    assert np.mean(inside) > 0.85
    assert min(widened) >= 1.0


def test_a_motor_that_stands_still_has_no_ripple() -> None:
    there = np.arange(20.0, 200.0, 1.0)
    x = np.concatenate([there, there[::-1]])
    commanded = np.stack([x, np.full_like(x, 110.0)], axis=1)
    measured = commanded + np.stack([0.4 * np.cos(2 * np.pi * x / 40.0), np.zeros_like(x)], axis=1)
    model = Greybox().fit(Trace(commanded, measured), ENDER5, rng=np.random.default_rng(0))
    assert [drive.structure.ripple for drive in model.drives] == [False, False]


@pytest.mark.parametrize("way", ["one way", "there and back"])
def test_what_a_trace_cannot_tell_is_switched_off_and_said(way: str) -> None:
    """Going one way shows no play; one diagonal shows no skew, and a scale as it is."""
    rng = np.random.default_rng(3)
    twin = Twin.of(sample("pulley-play", rng), ENDER3)
    there = np.linspace((10.0, 10.0), (200.0, 200.0), 100)
    path_mm = np.concatenate([np.zeros((1, 2)), there] + [there[::-1]] * (way == "there and back"))
    printed = twin.follow(path_mm)
    trace = Trace(path_mm, printed + rng.normal(0, 0.02, printed.shape), homed=True)
    model = Greybox().fit(trace, ENDER3, rng=rng)
    gaps = " ".join(learn(trace, ENDER3).saved.findings[1:])
    assert ("play is unknown" in gaps) == (way == "one way")
    assert [drive.structure.play for drive in model.drives] == ["none" if way == "one way" else "constant"] * 2
    assert "crooked frame" in gaps
    assert model.mechanism.frame.is_identity
    assert isinstance(twin.mechanism, Mechanism)
    for drive, truth in zip(model.drives, twin.mechanism.transmissions, strict=True):
        ends = truth.branches_mm(np.array([20.0, 180.0]))[0]
        scale = np.diff(ends)[0] / 160.0  # four whole turns
        assert drive.branches.mean.powers_mm[1] == pytest.approx(100 * (scale - 1), abs=0.02)


@pytest.mark.parametrize("apart_mm", [10.0, 9.3])
def test_a_grid_of_parts_of_a_turn_is_said_to_be_one(apart_mm: float) -> None:
    """Points 10 mm apart meet four angles of a turn of 40 mm, however far they go."""
    there = np.arange(10.0, 200.0, apart_mm)
    path_mm = np.array([(x, y) for row, y in enumerate(there) for x in there[:: 1 if row % 2 == 0 else -1]])
    path_mm = np.concatenate([path_mm, path_mm[::-1, ::-1]])
    printed = Twin.of(sample("ellipse", np.random.default_rng(5)), ENDER3).follow(path_mm)
    gaps = learn(Trace(path_mm, printed), ENDER3).saved.findings[1:]
    assert any("same few angles" in gap for gap in gaps) == (apart_mm == 10.0)


@pytest.mark.parametrize("dwells", [False, True])
def test_play_shows_where_axes_move_one_after_the_other(dwells: bool) -> None:
    """A row that is measured while the motor stands still was reached from where the motor last came."""
    rng = np.random.default_rng(0)
    path_mm, shown = [np.array(ENDER3.home_mm)], [False]
    for point in rng.uniform(30.0, 190.0, (120, 2)):
        path_mm += [np.array([point[0], path_mm[-1][1]]), point] + [point] * dwells
        shown += [False] + [False] * dwells + [True]
    play = Corruption((Drive(belt=Play(0.3)), Drive(belt=Play(0.2))))
    printed = Twin.of(play, ENDER3).follow(np.array(path_mm)) + rng.normal(0, 0.02, (len(path_mm), 2))
    printed[~np.array(shown)] = np.nan
    model = Greybox().fit(Trace(np.array(path_mm), printed, homed=True), ENDER3, rng=rng)
    assert isinstance(model.mechanism, Mechanism)
    for table, width_mm in zip(model.mechanism.transmissions, (0.3, 0.2), strict=True):
        lower, upper = table.branches_mm(np.array([100.0]))
        assert (upper - lower).item() == pytest.approx(width_mm, abs=0.02)
