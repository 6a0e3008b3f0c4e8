"""An axis by itself: driven over its bed in fine steps, and read by an instrument that looks along it alone."""

import numpy as np
import pytest

from printmend.learn.learned import learn
from printmend.learn.order import in_order
from printmend.path import Trace
from printmend.printer import read_printer

WAVE_MM, TURN_MM, PLAY_MM, NOISE_MM = 2.2, 44.6, 1.5, 0.02


def traverse() -> Trace:
    """Return a way out and back along X in steps of 0.6 mm: a pulley of another size bends it, and its belt plays."""
    out = np.arange(20.0, 200.0, 0.6)
    x = np.concatenate([[15.0], out, out[::-1]])
    back = np.arange(len(x)) > len(out)
    error = WAVE_MM * np.sin(2 * np.pi * x / TURN_MM) + np.where(back, PLAY_MM, 0.0)
    measured = x + error + np.random.default_rng(4).normal(0, NOISE_MM, len(x))
    y = np.full(len(x), 110.0)
    measured[0] = measured[back & (x > out[-1] - PLAY_MM)] = np.nan  # where it turns, the belt is still in its play
    return Trace(np.stack([x, y], axis=1), np.stack([measured, np.where(np.isnan(measured), np.nan, y)], axis=1))


def test_an_error_along_a_fine_path_is_no_slip_of_its_rows() -> None:
    trace = traverse()
    ordered = in_order(trace, read_printer("ender5"))
    assert ordered.trace is trace
    assert not ordered.found


def test_an_axis_is_learned_whose_fellow_nobody_measured() -> None:
    fit = learn(traverse(), read_printer("ender5")).fit
    assert fit is not None
    at = np.linspace(40.0, 180.0, 200)
    wave = WAVE_MM * np.sin(2 * np.pi * at / TURN_MM)
    lower, upper = (side - at - wave for side in fit.mechanism.transmissions[0].branches_mm(at))
    assert lower == pytest.approx(np.full(200, lower.mean()), abs=0.1)
    assert upper == pytest.approx(np.full(200, upper.mean()), abs=0.1)
    assert upper.mean() - lower.mean() == pytest.approx(PLAY_MM, abs=0.05)
