"""The effect of homing on a drive's effects: it shifts their waves along the motor.

Each place of the carriage has one tooth of the belt, one angle of the pulley and one phase of the motor. The firmware
counts from the point where the end stop switched. So all waves of a drive shift together, by the scatter of that point
and now and then by an electrical turn of the motor (four full steps). A motor's ripple repeats in an electrical turn,
so such a turn leaves it unchanged.
"""

import math
from dataclasses import dataclass

import numpy as np

from printmend.effects import EFFECTS, Of, Scene
from printmend.effects.prior import homing_priors
from printmend.printer import Homing, Printer

GRID = np.linspace(-2.0, 2.0, 9)  # of the logarithm of a scatter, in its standard deviations
HOMINGS = 4096  # that are drawn to see what may act
MOST_WORSE_SHARE = 0.01  # of the next homings that may make a print worse with an effect that acts
STEPS_A_TURN = 4  # full steps of an electrical turn
SEED = 23


@dataclass(frozen=True, eq=False)
class Scatter:
    """The belief about an end stop: alternatives with their ``weight`` [G], each with the standard deviation [G] of the
    switching point, and the share of homings [G] after which a motor is an electrical turn off."""

    weight: np.ndarray
    sd_mm: np.ndarray
    turn: np.ndarray


def scatter_of(homing: Homing, seen_mm: tuple[tuple[float, float], ...] = (), turn_mm: float = 0.8) -> Scatter:
    """Return the belief about end stops, given the shifts ``seen_mm`` between two homings (size, its standard
    deviation); ``turn_mm`` is a motor's electrical turn."""
    found: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    for name, share, sd, log_sd, chance in homing_priors():
        if homing.switch not in (name, "unknown"):
            continue
        known = homing.scatter_mm is not None
        grid = np.zeros(1) if known else GRID
        size_mm = homing.scatter_mm if homing.scatter_mm is not None else sd
        bell = np.exp(-0.5 * grid**2)
        own = bell / bell.sum() * (share if homing.switch == "unknown" else 1.0)
        found.append((own, size_mm * np.exp(log_sd * grid), np.full(len(grid), chance)))
    scatter = Scatter(*(np.concatenate(each) for each in zip(*found, strict=True)))
    told = np.log(np.maximum(scatter.weight, 1e-300))
    for shift_mm, own_mm in seen_mm:
        likely = np.zeros_like(told)
        variance = 2 * scatter.sd_mm**2 + own_mm**2 + 1e-12
        for aside, often in ((0.0, 1 - scatter.turn), (-turn_mm, scatter.turn / 2), (turn_mm, scatter.turn / 2)):
            likely = likely + often * np.exp(-0.5 * (shift_mm - aside) ** 2 / variance) / np.sqrt(variance)
        told = told + np.log(np.maximum(likely, 1e-300))
    weight = np.exp(told - told.max())
    return Scatter(weight / weight.sum(), scatter.sd_mm, scatter.turn)


def drawn_shifts_mm(scene: Scene, count: int, rng: np.random.Generator) -> np.ndarray:
    """Draw each motor's shift [2, D] from the homing of the measured print to the next one."""
    printer = scene.printer
    scatter = scatter_of(printer.homing, scene.homed_again_mm, _turn_mm(printer))
    which = rng.choice(len(scatter.weight), count, p=scatter.weight)
    axes_mm = math.sqrt(2) * scatter.sd_mm[which] * rng.standard_normal((2, count))
    aside = rng.choice((-1.0, 1.0), (2, count)) * (rng.uniform(size=(2, count)) < scatter.turn[which])
    return np.asarray(printer.to_motor(axes_mm.T).T + _turn_mm(printer) * aside)


def _turn_mm(printer: Printer) -> float:
    return STEPS_A_TURN * printer.x.mm_per_step


def spread_mm(scene: Scene) -> np.ndarray:
    """Return the standard deviation [2] of both motors' shifts but for electrical turns."""
    scatter = scatter_of(scene.printer.homing, scene.homed_again_mm, _turn_mm(scene.printer))
    sd_mm = math.sqrt(2 * float(scatter.weight @ scatter.sd_mm**2))
    return np.asarray(sd_mm * np.linalg.norm(scene.printer.to_motor(np.eye(2)), axis=0))


def waves_of(effect: str, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray | None:
    """Return the lengths [K] mm of an effect's waves along its motor; None where it has none, or is no machine's."""
    law = EFFECTS[effect]
    if law.of is not Of.MACHINE or not hasattr(law, "waves_mm"):
        return None
    return np.asarray(law.waves_mm(where, shape, scene))


def shifted(sizes_mm: np.ndarray, waves_mm: np.ndarray, by_mm: float | np.ndarray) -> np.ndarray:
    """Return sizes [2K, D], cosines first, of waves whose motor is shifted ``by_mm`` [D]."""
    angle = 2 * np.pi * np.divide.outer(np.broadcast_to(by_mm, sizes_mm.shape[1:]), waves_mm).T
    cos, sin = np.split(sizes_mm, 2)
    return np.vstack([cos * np.cos(angle) + sin * np.sin(angle), sin * np.cos(angle) - cos * np.sin(angle)])


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
