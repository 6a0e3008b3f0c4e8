"""The metrologist's numbers of a machine, against faults whose numbers are known beforehand."""

import numpy as np
import pytest

from printmend.corruption import HEALTHY, Corruption, CrookedFrame, Drive, EccentricBore, Play
from printmend.diagnosis.portrait import circle, positioning
from printmend.printer import read_printer

ENDER3 = read_printer("ender3")


def test_a_healthy_machine_has_no_error() -> None:
    mechanism = HEALTHY.lower(ENDER3)
    for axis in (0, 1):
        assert positioning(mechanism, axis).systematic_mm < 1e-6
    run = circle(mechanism)
    assert run.both_mm < 1e-6
    assert run.mean_mm == pytest.approx(0.0, abs=1e-6)


def test_play_is_the_reversal_error_and_steps_in_the_circle() -> None:
    mechanism = Corruption((Drive(belt=Play(0.3)), Drive())).lower(ENDER3)
    x, y = (positioning(mechanism, axis) for axis in (0, 1))
    assert (x.axis, y.axis) == ("x", "y")
    assert x.reversal_mm == pytest.approx(0.3, abs=1e-6)
    assert x.mean_reversal_mm == pytest.approx(0.3, abs=1e-6)
    assert (x.systematic_mm, x.mean_mm) == (pytest.approx(0.3, abs=1e-6), pytest.approx(0.0, abs=1e-6))
    assert y.reversal_mm == pytest.approx(0.0, abs=1e-6)
    run = circle(mechanism)
    # clockwise, x grows on the upper half and lags by half the play, and on the lower half it is as much ahead; the
    # other run is the mirror image
    for off, way in ((run.clockwise_mm, -1), (run.counter_mm, 1)):
        inner = (np.abs(np.sin(run.angle_rad)) > 0.2) & (np.abs(np.cos(run.angle_rad)) > 0.1)
        wanted = way * 0.15 * np.cos(run.angle_rad) * np.sign(np.sin(run.angle_rad))
        assert np.abs(off - wanted)[inner].max() < 0.002
    assert run.both_mm == pytest.approx(0.3, abs=0.01)


def test_an_eccentric_pulley_shows_in_positioning_not_in_reversal() -> None:
    mechanism = Corruption((Drive(pulley=EccentricBore(0.4, 0.7)), Drive())).lower(ENDER3)
    x = positioning(mechanism, 0)
    assert x.reversal_mm < 1e-6
    assert x.systematic_mm == pytest.approx(0.8, abs=0.01)  # a swing of twice its size
    assert x.mean_mm == pytest.approx(x.systematic_mm)


def test_a_crooked_frame_makes_the_circle_an_oval() -> None:
    run = circle(Corruption((Drive(), Drive()), CrookedFrame(skew_deg=0.5)).lower(ENDER3))
    # a shear by s stretches one diagonal by s/2 and shortens the other as much
    assert run.both_mm == pytest.approx(run.radius_mm * np.radians(0.5), rel=0.02)
    assert run.circular_mm[0] == pytest.approx(run.both_mm, rel=1e-6)
    assert run.mean_mm == pytest.approx(0.0, abs=0.002)
