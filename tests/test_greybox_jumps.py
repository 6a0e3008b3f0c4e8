"""Jumps in a trace: the compiled ladder against a slow one, and what a learner makes of skipped teeth."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from printmend.corruption import sample
from printmend.corruption.jump import MissedSteps, ToothSkips
from printmend.path import Trace
from printmend.printer import read_printer
from printmend.twin import Twin
from printmend.worldmodel.greybox import Greybox
from printmend.worldmodel.kernels.jumps import cheapest_levels
from tests.naive_greybox import cheapest_history

ZIGZAG_MM = np.array([[20.0, 30.0], [190.0, 180.0], [25.0, 35.0], [185.0, 60.0], [30.0, 170.0], [120.0, 40.0]])


@pytest.mark.parametrize("seed", range(5))
def test_the_ladder_is_climbed_at_the_least_cost(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cost, path = rng.exponential(2.0, (5, 3, 5)), np.empty((5, 2), np.int64)
    least = cheapest_levels(cost, 0.7, path)
    slow, history = cheapest_history(cost, 0.7)
    assert least == pytest.approx(slow)
    assert path.tolist() == [list(level) for level in history]


@pytest.mark.parametrize("family", ["play", "pulley"])
def test_a_machine_is_learned_in_spite_of_jumps(family: str) -> None:
    printer, rng = read_printer("ender3"), np.random.default_rng(8)
    fault = sample(family, rng)
    jumping = replace(
        fault,
        drives=tuple(replace(drive, skips=ToothSkips(3.0, 5 + i), missed=MissedSteps(3.0, 7 + i))
                     for i, drive in enumerate(fault.drives)),
    )  # fmt: skip
    at = np.concatenate([np.linspace(a, b, 120, endpoint=False) for a, b in itertools.pairwise(ZIGZAG_MM)])
    points = np.concatenate([[printer.home_mm], at])
    noise = rng.normal(0, 0.03, points.shape)
    calm, wild = (Twin.of(each, printer).follow(points) + noise for each in (fault, jumping))
    assert np.abs(wild - calm).max() > 1.9
    found = Greybox().fit(Trace(points, wild), printer, rng=rng)
    assert sum(map(len, found.jumps)) >= 4
    plain = Greybox().fit(Trace(points, calm), printer, rng=rng)
    assert not any(plain.jumps)
    for one, other in zip(found.drives, plain.drives, strict=True):
        motor = np.linspace(40.0, 160.0, 200)
        for mine, wanted in zip(one.branches.errors_mm(motor), other.branches.errors_mm(motor), strict=True):
            np.testing.assert_allclose(mine - mine.mean(), wanted - wanted.mean(), atol=0.08)
