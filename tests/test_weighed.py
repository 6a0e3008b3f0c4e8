"""The learner that weighs the grey box and `meta` by blocks that they have not seen."""

import numpy as np
import pytest

from printmend.corruption import Corruption, Drive, EccentricBore, Play
from printmend.learn import fit
from printmend.machine import Mechanism, healthy_transmission
from printmend.path import Trace
from printmend.twin import Twin
from printmend_lab.meta.weighed import OF, WeighedModel, _model, share, signs


def test_what_tells_of_either_learner_weighs_it() -> None:
    alike, ahead = np.zeros((2, 3)), np.full((2, 3), 1.0)
    assert share(alike) == pytest.approx(0.5)
    assert (share(ahead) > 0.99).all()
    assert share(ahead) == pytest.approx(1 - share(-ahead))
    assert share(1e6 * ahead) == pytest.approx(1.0)


def test_signs_say_who_foretells_what_nobody_learned_from(ender5, rng: np.random.Generator) -> None:
    wave = Corruption((Drive(pulley=EccentricBore(0.5)), Drive()))
    way = np.vstack([ender5.home_mm, 110 + rng.uniform(-45, 45, (120, 2))])
    printed = Twin.of(wave, ender5).follow(way)
    trace = Trace(way, printed + rng.normal(0, 0.02, printed.shape), homed=True)
    models = [fit(name, trace, ender5, rng=rng) for name in OF]
    told = signs(models, trace, ender5, (1, 2))
    assert told.shape == (2, 3)
    assert np.isfinite(told).all()
    np.testing.assert_allclose(signs(models[::-1], trace, ender5, (1, 2))[:, :2], -told[:, :2], atol=1e-12)


def test_a_mean_of_machines_lies_between_them(ender5) -> None:
    plain = healthy_transmission(ender5, 0)
    loose = plain.shifted(0.5)
    machines = [Mechanism(ender5, (one, healthy_transmission(ender5, 1))) for one in (plain, loose)]
    mixed = _model(machines, np.array([[0.25, 0.75], [1.0, 0.0]])).mechanism
    np.testing.assert_allclose(mixed.transmissions[0].lower_mm, plain.lower_mm + 0.375, atol=1e-9)
    np.testing.assert_allclose(mixed.transmissions[1].lower_mm, machines[0].transmissions[1].lower_mm, atol=1e-9)


def test_it_learns_a_play_and_repeats_itself(ender5, rng: np.random.Generator) -> None:
    twin = Twin.of(Corruption((Drive(belt=Play(0.6)), Drive(belt=Play(0.3)))), ender5)
    way = np.vstack([ender5.home_mm, 110 + rng.uniform(-40, 40, (80, 2))])
    printed = twin.follow(way)
    trace = Trace(way, printed + rng.normal(0, 0.02, printed.shape), homed=True)
    model, again = (
        fit("printmend_lab.meta.weighed:WEIGHED", trace, ender5, rng=np.random.default_rng(3)) for _ in range(2)
    )
    assert isinstance(model, WeighedModel)
    np.testing.assert_allclose(model.weights.sum(axis=1), 1.0)
    for drive, play_mm in zip(model.mechanism.transmissions, (0.6, 0.3), strict=True):
        assert (drive.upper_mm - drive.lower_mm).mean() == pytest.approx(play_mm, abs=0.05)
    np.testing.assert_array_equal(model.weights, again.weights)  # type: ignore[attr-defined]
