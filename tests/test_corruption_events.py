"""Jumps, the Z screw, warps, and bodies of three axes: laws and the equations of physics.md."""

import math
from dataclasses import replace

import numpy as np
import pytest

from printmend.corruption import (
    Corruption,
    CrookedFrame,
    Drive,
    MissedSteps,
    Play,
    Screw,
    ToothSkips,
    Warp,
    WrongRadius,
    parse_corruption,
)
from printmend.corruption.transmission import places_mm
from printmend.errors import ConfigError, InputError
from printmend.machine import Mechanism
from printmend.printer import Printer
from printmend.twin import Twin
from printmend_lab.body.layers import space_path
from printmend_lab.path import Body
from printmend_lab.sampling import sample
from tests.shapes import ring_layer

MIDDLE = np.array([550, 550, 200])


def forwards(ticks: int) -> np.ndarray:
    return np.repeat([[1, 0]], ticks, axis=0)


def test_a_tooth_skip_moves_the_carriage_by_ten_steps_for_good(ender5: Printer) -> None:
    """Eq. 11: each jump of an otherwise healthy machine is ±10 full steps, at the places of the Poisson process."""
    skips = ToothSkips(rate_per_m=60.0, seed=4)
    twin = Twin.of(Corruption((Drive(skips=skips), Drive())), ender5)
    printed = twin.run(forwards(1000), MIDDLE[:2] - [500, 0])
    off = printed[:, 0] - 50 - np.arange(1001)
    jumps = np.diff(off)
    places, signs = places_mm(60.0, (4, 0), 200.0)
    assert len(places) > 1
    assert set(np.unique(jumps)) <= {-10.0, 0.0, 10.0}
    np.testing.assert_array_equal(np.flatnonzero(jumps), np.ceil(places / 0.2) - 1)
    np.testing.assert_array_equal(jumps[jumps != 0], 10 * signs)
    assert not np.diff(printed[:, 1]).any()


def test_missed_steps_lose_the_angle(ender5: Printer) -> None:
    """Four steps are missed before the pulley: with 1.25 times its radius the carriage loses five."""
    drive = Drive(pulley=WrongRadius(1.25 * ender5.x.radius_mm), missed=MissedSteps(rate_per_m=10.0, seed=1))
    printed = Twin.of(Corruption((drive, Drive())), ender5).run(forwards(500), MIDDLE[:2] - [300, 0])
    jumps = np.diff(printed[:, 0]) - 1.25
    assert np.abs(jumps).max() > 1
    assert set(np.unique(np.rint(jumps))) <= {-5.0, 0.0, 5.0}


def test_rates_are_met() -> None:
    places, signs = places_mm(2.0, (7, 0), 1e6)
    assert len(places) == pytest.approx(2000, abs=150)
    assert abs(signs.mean()) < 0.08
    gaps = np.diff(places)
    assert gaps.std() == pytest.approx(gaps.mean(), rel=0.1)  # exponential


def test_a_longer_print_only_adds_jumps() -> None:
    short, long = places_mm(3.0, (2, 1), 5e4), places_mm(3.0, (2, 1), 2e5)
    for few, many in zip(short, long, strict=True):
        assert np.array_equal(few, many[: len(few)])


def test_no_travel_and_no_rate_jump_not(ender5: Printer) -> None:
    drive = Drive(skips=ToothSkips(0.0), missed=MissedSteps(5.0, seed=3))
    twin = Twin.of(Corruption((drive, drive)), ender5)
    still = twin.run(np.zeros((50, 2), int), MIDDLE[:2])
    assert np.array_equal(still, np.repeat(MIDDLE[None, :2], 51, axis=0))


def test_way_points_jump_where_controls_do(ender5: Printer) -> None:
    """The process runs in travel, so that a print as ticks and as way-points in mm jumps alike."""
    drive = Drive(skips=ToothSkips(8.0, seed=2), missed=MissedSteps(8.0, seed=2))
    twin = Twin.of(Corruption((drive, drive)), ender5)
    back = -np.ones((900, 2), int)
    ticks = twin.run(back, np.array(ender5.bed_steps)) * 0.2
    waypoints = 220.0 - 0.2 * np.repeat(np.arange(901)[:, None], 2, axis=1)
    np.testing.assert_allclose(twin.follow(waypoints), ticks, atol=1e-9)
    assert np.abs(ticks - waypoints).max() > 0.5


def test_a_screw_lifts_by_its_equation(ender5: Printer) -> None:
    """Eq. 15: z = (1 + ε)m + a sin(θ + φ) and (dx, dy) = κe (cos, sin)(θ + ψ), from where the print starts."""
    screw = Screw(lead_error=0.02, periodic_mm=0.1, periodic_phase_rad=0.4, wobble_mm=0.3, wobble_phase_rad=1.0)
    controls = np.repeat([[0, 0, 1]], 400, axis=0)
    printed = Twin.of(Corruption(screw=screw), ender5).run(controls, MIDDLE)
    m = 0.04 * (200 + np.arange(401))
    theta = 2 * np.pi * m / 8.0
    z = 1.02 * m + 0.1 * np.sin(theta + 0.4)
    np.testing.assert_allclose(0.04 * (printed[:, 2] - 200), z - z[0], atol=1e-9)
    for axis, wave in enumerate((np.cos, np.sin)):
        push = 0.3 * (wave(theta + 1.0) - wave(theta[0] + 1.0))
        np.testing.assert_allclose(0.2 * (printed[:, axis] - 550), push, atol=1e-9)


def test_z_backlash_shows_at_a_hop(ender5: Printer) -> None:
    """0.2 mm of play: the first half while rising, the whole at each reversal."""
    twin = Twin.of(Corruption(screw=Screw(backlash_mm=0.2)), ender5)
    controls = np.zeros((30, 3), int)
    controls[:, 2] = np.repeat([1, -1, 1], 10)
    height = 0.04 * (twin.run(controls, MIDDLE)[:, 2] - 200)
    np.testing.assert_allclose(height[[0, 10, 15, 20, 25, 30]], [0.0, 0.3, 0.3, 0.1, 0.1, 0.3], atol=1e-9)


def test_the_wobble_is_constant_inside_a_layer(ender5: Printer, rng: np.random.Generator) -> None:
    """Eq. 15: a layer alone prints as if the screw were straight; a whole body shifts its layers."""
    corruption = Corruption(screw=sample("screw", rng).screw)
    twin = Twin.of(corruption, ender5)
    body = Body("rings", tuple(ring_layer((530.0, 530.0), 30.0, turn=0.2 * k, index=k) for k in range(12)))
    path = space_path(body, ender5)
    printed = twin.run(path.controls, path.start_steps)
    nominal = path.nominal_steps
    assert np.array_equal(nominal[0], [*body.layers[0].start_steps, 5])
    shifts = []
    for place, layer in enumerate(body.layers):
        rows = np.flatnonzero(path.layer == place) + 1
        assert np.array_equal(nominal[rows, :2], layer.nominal_steps[1:])
        assert np.array_equal(nominal[rows, 2], np.full(len(rows), round(layer.z_mm / 0.04)))
        off = printed[rows, :2] - nominal[rows, :2]
        np.testing.assert_allclose(off, np.broadcast_to(off[0], off.shape), atol=1e-9)
        shifts.append(off[0] * 0.2)
    assert corruption.screw is not None
    assert 0.02 < np.ptp(shifts, axis=0).max() <= 2 * corruption.screw.wobble_mm + 1e-9


def test_a_body_of_three_axes_is_a_lattice_path(ender5: Printer) -> None:
    body = Body("rings", tuple(ring_layer((530.0, 530.0 + 9 * k), 30.0, turn=0.2 * k, index=k) for k in range(4)))
    for hop_mm in (0.0, 0.4):
        path = space_path(body, ender5, hop_mm=hop_mm)
        assert np.abs(path.controls).max() == 1
        assert (np.abs(path.controls).max(axis=1) > 0).all()
        assert not path.extruding[path.layer < 0].any()
        assert len(path.nominal_steps) == len(path.controls) + 1
        assert path.nominal_steps[:, 2].max() == 20 + round(hop_mm / 0.04)
        assert ((np.diff(np.sign(path.controls[path.controls[:, 2] != 0, 2])) != 0).sum() > 0) == (hop_mm > 0)


def test_a_homed_screw_is_at_home_at_home(ender5: Printer) -> None:
    twin = Twin.of(Corruption(screw=Screw(0.01, 0.1, 0.7, 0.4, 2.0, 0.3)), ender5)
    printed = twin.follow(np.array([[220.0, 220.0, 0.0], [100.0, 100.0, 8.0], [100.0, 100.0, 4.0]]))
    np.testing.assert_allclose(printed[0], [220.0, 220.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(printed[1, :2], [100.0, 100.0], atol=1e-9)  # a whole turn up the wobble is as at home
    assert np.abs(printed[2, :2] - 100.0).max() > 0.3


def test_a_warp_is_the_same_both_ways_and_of_no_period(ender5: Printer) -> None:
    warp = Warp((0.5, -0.8, 0.3, 0.6), spacing_mm=25.0, first_mm=60.0)
    mechanism = Corruption((Drive(warp=warp, belt=Play(0.3)), Drive())).lower(ender5)
    assert isinstance(mechanism, Mechanism)
    places = np.array([60.0, 85.0, 97.5, 135.0])
    lower, upper = mechanism.transmissions[0].branches_mm(places)
    np.testing.assert_allclose(upper - lower, 0.3, atol=1e-9)
    gauss = np.exp(-((places[:, None] - np.array([60.0, 85.0, 110.0, 135.0])) ** 2) / (2 * 25.0**2))
    np.testing.assert_allclose((lower + upper) / 2 - places, gauss @ [0.5, -0.8, 0.3, 0.6], atol=1e-6)


def test_frames_are_applied_as_their_polynomial(ender5: Printer, rng: np.random.Generator) -> None:
    frame = CrookedFrame(2.5, 1.03, 0.98, 0.4, -0.3)
    twin = Twin.of(Corruption(frame=frame), ender5)
    controls = rng.integers(-2, 3, (2000, 2))
    bed = 0.2 * (MIDDLE[:2] + np.concatenate([np.zeros((1, 2)), np.cumsum(controls, axis=0)]))
    lowered = frame.lower(ender5)
    expected = lowered.apply(bed)
    expected += 110.0 - expected[0]
    np.testing.assert_allclose(0.2 * twin.run(controls, MIDDLE[:2]), expected, rtol=0, atol=1e-10)


@pytest.mark.parametrize(
    "make",
    [
        lambda: ToothSkips(-1.0),
        lambda: ToothSkips(1.0, seed=-1),
        lambda: ToothSkips(1.0, seed=1.5),
        lambda: MissedSteps(1.0, steps=0),
        lambda: MissedSteps(math.nan),
        lambda: Screw(wobble_mm=-1.0),
        lambda: Screw(lead_error=-0.9),
        lambda: Warp((), 10.0),
        lambda: Warp((100.0, -100.0), 10.0),
        lambda: Warp((1.0,), 0.0),
        lambda: parse_corruption("[z.screw]\nwobble = 1", subject="x"),
        lambda: parse_corruption("[z.pulley]\nkind = 'flat'", subject="x"),
        lambda: parse_corruption("z = 1", subject="x"),
        lambda: parse_corruption("[x.skips]\nkind = 'tooth-skips'", subject="x"),
    ],
)
def test_impossible_values_are_refused(make) -> None:
    with pytest.raises(ConfigError, match=r"expected .*, found .*; "):
        make()


def test_a_screw_that_turns_back_is_refused(ender5: Printer) -> None:
    with pytest.raises(ConfigError, match="periodic_mm"):
        Corruption(screw=Screw(periodic_mm=2.0)).lower(ender5)


@pytest.mark.parametrize("lifts", [-300, 8000])
def test_leaving_the_z_axis_is_refused(lifts: int, ender5: Printer) -> None:
    controls = np.zeros((abs(lifts), 3), int)
    controls[:, 2] = np.sign(lifts)
    with pytest.raises(InputError, match="motor z"):
        Twin.of(Corruption(screw=Screw(0.01)), ender5).run(controls, np.array([550, 550, 0]))


def test_a_screw_too_fine_to_tabulate_is_refused(ender5: Printer) -> None:
    fine = replace(ender5, z=replace(ender5.z, mm_per_turn=0.1))
    with pytest.raises(ConfigError, match="micro-steps"):
        Corruption(screw=Screw(wobble_mm=0.1)).lower(fine)
