"""The effect of homing on a drive's effects: it shifts their waves along the motor.

A position of the carriage fixes the tooth of the belt, the angle of the pulley and the phase of the motor. So all waves
of a drive shift together, by the scatter of the end stop (`effects.switch`). A motor's ripple repeats every electrical
turn, so a shift by such a turn leaves it unchanged.
"""

import numpy as np

from printmend.effects import EFFECTS, Of, Scene
from printmend.effects.effect import SEED
from printmend.effects.switch import drawn_shifts_mm

HOMINGS = 4096  # that are drawn to see what may act
MOST_WORSE_SHARE = 0.01  # of the next homings that may make a print worse with an effect that acts


def waves_of(effect: str, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray | None:
    """Return the lengths [K] mm of an effect's waves along its motor; None where it has none, or is no machine's."""
    law = EFFECTS[effect]
    if law.of is not Of.MACHINE or not hasattr(law, "waves_mm"):
        return None
    return np.asarray(law.waves_mm(where, shape, scene))


def shifted(sizes_mm: np.ndarray, waves_mm: np.ndarray, by_mm: float | np.ndarray) -> np.ndarray:
    """Return sizes [2K, D], cosines first, of waves whose motor is shifted ``by_mm`` [D], or all alike."""
    angle = 2 * np.pi * np.divide.outer(np.atleast_1d(by_mm), waves_mm).T
    (cos, sin), turn_cos, turn_sin = np.split(sizes_mm, 2), np.cos(angle), np.sin(angle)
    return np.vstack([cos * turn_cos + sin * turn_sin, sin * turn_cos - cos * turn_sin])


def lasting(sizes_mm: np.ndarray, effect: str, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray | None:
    """Return the share of each size [2K] that may act in the next print: its mean over the next homings. It is 0 if all
    the waves together would make the print worse after too many of them. None where homing shifts nothing."""
    waves_mm = waves_of(effect, where, shape, scene)
    if waves_mm is None:
        return None
    shift_mm = drawn_shifts_mm(scene, HOMINGS, np.random.default_rng(SEED))[where]
    cosines = np.cos(2 * np.pi * np.divide.outer(shift_mm, waves_mm))
    share = np.maximum(cosines.mean(axis=0), 0.0)
    square = np.sum(np.square(np.split(sizes_mm, 2)), axis=0)
    worse = (square * share * (share - 2 * cosines)).sum(axis=1) > 0.0
    return np.tile(share if worse.mean() <= MOST_WORSE_SHARE else 0.0 * share, 2)
