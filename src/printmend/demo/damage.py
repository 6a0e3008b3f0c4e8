"""What the demonstrations print and break, and where their pictures go."""

from importlib import resources
from pathlib import Path

import numpy as np

from printmend.corruption import Corruption, Drive, EccentricBore, Ellipse, Play
from printmend.errors import InputError
from printmend.messages import say
from printmend.units import TURN_RAD


def demo_body_gcode() -> bytes:
    """Return the G-code of a 60-tooth GT2 timing pulley in ABS for the Ender-5; `tools/make_demo_body.py` sliced it."""
    return (resources.files("printmend.demo") / "timing_pulley.gcode").read_bytes()


def demo_corruption(rng: np.random.Generator) -> Corruption:
    """Draw an Ender-5's bad day: a bore off its centre on X, a small and oval pulley on Y, both belts a little slack.

    Everyone can see it on the part, and a machine with it still moves. The play stays below what one control can take
    up, 3 steps at the weakest angle, because the paper's greedy planner stands still beyond (physics.md eq. 25).
    """
    bore_mm, phase_x, phase_y = rng.uniform(0.7, 1.2), rng.uniform(0, TURN_RAD), rng.uniform(0, TURN_RAD / 2)
    mean_mm, oval_mm = rng.uniform(5.7, 6.0), rng.uniform(0.5, 0.9)
    play_x, play_y = rng.uniform(0.1, 0.25, 2)
    x = Drive(pulley=EccentricBore(_mm(bore_mm), _mm(phase_x)), belt=Play(_mm(play_x)))
    y = Drive(pulley=Ellipse(_mm(mean_mm + oval_mm), _mm(mean_mm - oval_mm), _mm(phase_y)), belt=Play(_mm(play_y)))
    return Corruption((x, y))


def _mm(value: float) -> float:
    """Round to a micrometre, so that corruption.toml can be read."""
    return round(float(value), 3)


def check_out(out: Path) -> None:
    """Raise `InputError` where ``out`` cannot be a folder, before the work begins."""
    if out.exists() and not out.is_dir():
        raise InputError(out, wanted=say("folder-pictures"), came=say("file"), todo=say("terminal-name-another-out"))
