"""The learner that weighs the grey box and `meta` by blocks that they have not seen."""

import numpy as np
import pytest

from printmend.corruption import Corruption, Drive, Play
from printmend.learn import fit
from printmend.machine import Mechanism, healthy_transmission
from printmend.path import Trace
from printmend.twin import Twin
from printmend_lab.meta.weighed import LOG_ODDS, WeighedModel, _model, share


def test_votes_decide_only_where_they_agree(rng: np.random.Generator) -> None:
    noise = np.exp(rng.normal(0, 0.1, 5))
    ahead = np.stack([4.0 * noise, np.ones(5)], axis=1)  # meta's squares are a quarter in every block
    assert share(ahead) > 0.99
    assert share(ahead[:, ::-1]) < 0.01
    even = np.ones((5, 2))
    assert share(even) == pytest.approx(1 / (1 + np.exp(-LOG_ODDS)))
    torn = np.stack([np.array([100.0, 1, 1, 1, 1]), np.array([1.0, 1.5, 1.5, 1.5, 1.5])], axis=1)
    assert share(torn) < 0.5  # one block, however bad, does not decide
    assert share(even[:1]) == 0.0
    assert share(np.ones((5, 2)) * 1e-12) == share(even)  # exact is exact


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
