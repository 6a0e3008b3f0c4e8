"""A motor's portrait by its believed parts: the curves are the machine's, the outline is the pulley's."""

import numpy as np
import pytest

from printmend.diagnosis.named import gathered
from printmend.diagnosis.portrait import contacts_of_fit, hull_mm, portrait
from printmend.effects import scene_of
from printmend.effects.sized import Sized
from printmend.infer.fit import fitted
from printmend.infer.machine import machine_of
from printmend.infer.posterior import posterior_of
from printmend.machine.printing import print_from_home
from printmend.path import Trace
from printmend.printer import read_printer
from printmend.units import TURN_RAD
from tests.believed import SCENES, part


def test_the_outline_of_a_pulley_is_its_shape_about_the_shaft() -> None:
    scene = SCENES["ender3"]
    radius = scene.turns_mm[0] / TURN_RAD
    round_mm = hull_mm([], 0, scene)
    assert np.hypot(*round_mm.T) == pytest.approx(np.full(len(round_mm), radius))
    large = hull_mm(gathered([part("scale", 0, [2.0])]), 0, scene)
    assert np.hypot(*large.T) == pytest.approx(np.full(len(large), 1.02 * radius))
    sizes = np.zeros(64)
    sizes[0] = 0.3
    off = hull_mm(gathered([part("pulley", 0, sizes.tolist())]), 0, scene)
    away = np.hypot(*off.T) - radius
    assert (away.max(), away.min()) == pytest.approx((0.3, -0.3), abs=0.01)  # the bore's eccentricity


@pytest.mark.parametrize("preset", ["ender3", "corexy"])
def test_the_curves_of_a_motor_are_the_machines(preset: str) -> None:
    printer, rng = read_printer(preset), np.random.default_rng(2)
    low, high = (np.array([getattr(axis, end) for axis in printer.axes[:2]]) for end in ("min_mm", "max_mm"))
    path = np.vstack([np.array(printer.home_mm)[None], rng.uniform(low + 10, high - 10, (300, 2))])
    scene = scene_of(Trace(path, path.copy(), homed=True), printer, (printer.x.mm_per_turn, printer.y.mm_per_turn))
    true, _ = machine_of(scene, [Sized("scale", 0, (), np.array([0.5])), Sized("play", 0, (), np.array([0.3]))])
    places = print_from_home(true, np.hstack([path, np.full((len(path), 1), printer.z.home_mm)]))[:, :2]
    trace = Trace(path, places + rng.normal(0, 0.01, places.shape), homed=True)
    fit = fitted(trace, scene)
    parts = posterior_of(fit, rng).parts
    drawn = portrait(parts, fit.scene, 0, contacts_of_fit(fit, 0), fit.state.sigma_mm)
    assert drawn.name == printer.motors[0].upper()
    branches = np.stack(true.transmissions[0].branches_mm(drawn.motor_mm)) - drawn.motor_mm
    assert np.abs(drawn.error_mm - branches).max() < 0.01
    off_mm = drawn.error_mm - branches
    line = np.polynomial.Polynomial.fit(drawn.motor_mm, off_mm.mean(axis=0), 1)(drawn.motor_mm)
    assert (np.abs(off_mm - line) < 6 * drawn.sd_mm + 1e-3).all()
    assert drawn.play_mm == pytest.approx(np.full(len(drawn.play_mm), 0.3), abs=0.01)
    assert drawn.scale_percent == pytest.approx(0.5, abs=0.02)
    assert set(drawn.point_side) == {0, 1}
    nearest = drawn.error_mm[drawn.point_side, np.searchsorted(drawn.motor_mm, drawn.point_motor_mm).clip(0, 1200)]
    assert np.std(drawn.point_error_mm - nearest) < 3 * drawn.noise_mm
    other = portrait(parts, fit.scene, 1, contacts_of_fit(fit, 1), fit.state.sigma_mm)
    assert np.abs(other.play_mm).max() < 0.01
