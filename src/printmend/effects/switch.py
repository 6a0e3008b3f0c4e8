"""Priors of end stops: how far one homing is from the next, by kind of switch.

The firmware counts from the point at which an end stop triggered. That point scatters, and sometimes a motor is off by
an electrical turn (four full steps).
"""

import math
from dataclasses import dataclass

import numpy as np

from printmend.effects.effect import Scene
from printmend.effects.prior import homing_priors
from printmend.effects.teeth import TOOTH_MM
from printmend.printer import Printer

GRID = np.linspace(-2.0, 2.0, 9)  # of the logarithm of a scatter, in its standard deviations
STEPS_A_TURN = 4  # full steps of an electrical turn


@dataclass(frozen=True, eq=False)
class Scatter:
    """The belief about an end stop: alternatives with their ``weight`` [G], each with the standard deviation [G] of the
    switching point, and the share of homings [G] after which a motor is an electrical turn off."""

    weight: np.ndarray
    sd_mm: np.ndarray
    turn: np.ndarray


def scatter_of(printer: Printer, seen_mm: tuple[tuple[float, float], ...] = ()) -> Scatter:
    """Return the belief about a printer's end stops, given the shifts ``seen_mm`` between two homings (size, its
    standard deviation)."""
    homing, turn_mm = printer.homing, float(_turns_mm(printer).mean())
    found: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    for name, share, sd, log_sd, chance in homing_priors():
        if homing.switch not in (name, "unknown"):
            continue
        grid, size_mm = (GRID, sd) if homing.scatter_mm is None else (np.zeros(1), homing.scatter_mm)
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


def drawn_shifts_mm(scene: Scene, count: int, rng: np.random.Generator, homings: int = 2) -> np.ndarray:
    """Draw each motor's shift [2, D] from the homing of the measured print to the next one; with one of ``homings``
    that from where the end stops switch in the mean."""
    printer = scene.printer
    scatter = scatter_of(printer, scene.homed_again_mm)
    kind, *turned = _evenly(3, count, rng)
    which = np.searchsorted(scatter.weight.cumsum()[:-1], kind)
    axes_mm = math.sqrt(homings) * scatter.sd_mm[which] * rng.standard_normal((2, count))
    aside = np.sign(np.array(turned) - scatter.turn[which] / 2) * (np.array(turned) < scatter.turn[which])
    return np.asarray(printer.to_motor(axes_mm.T).T + _turns_mm(printer)[:, None] * aside)


def _evenly(rows: int, count: int, rng: np.random.Generator) -> np.ndarray:
    """Draw uniform numbers [rows, count]: in each row one in each of ``count`` equal intervals, in any order (a Latin
    hypercube: McKay, Beckman, Conover 1979). So a rare event is as often among few draws as it is in truth."""
    order = rng.permuted(np.tile(np.arange(count), (rows, 1)), axis=1)
    return np.asarray((order + rng.uniform(size=order.shape)) / count)


def homing_mm(
    printer: Printer, rng: np.random.Generator, *, scatter_mm: float | None = None, turn_share: float | None = None
) -> np.ndarray:
    """Draw by how much one homing shifts both motors [2] from where their end stops switch in the mean.

    ``scatter_mm`` is the standard deviation of the switching point, ``turn_share`` the share of homings after which a
    motor is an electrical turn off; without them both are drawn for the kind of switch.
    """
    if scatter_mm is None or turn_share is None:
        scatter = scatter_of(printer)
        which = int(rng.choice(len(scatter.weight), p=scatter.weight))
        scatter_mm = float(scatter.sd_mm[which]) if scatter_mm is None else scatter_mm
        turn_share = float(scatter.turn[which]) if turn_share is None else turn_share
    aside = rng.choice((-1.0, 1.0), 2) * (rng.uniform(size=2) < turn_share)
    return np.asarray(printer.to_motor(scatter_mm * rng.standard_normal(2)) + _turns_mm(printer) * aside)


def refit_mm(printer: Printer, rng: np.random.Generator) -> np.ndarray:
    """Draw the shift of both motors [2] by belts that were taken off and put back on any tooth."""
    return np.array([TOOTH_MM * rng.integers(round(axis.mm_per_turn / TOOTH_MM)) for axis in printer.axes[:2]])


def _turns_mm(printer: Printer) -> np.ndarray:
    """Return how far an electrical turn of each motor moves its belt [2]."""
    return STEPS_A_TURN * np.array(printer.mm_per_step)


def spread_mm(scene: Scene, homings: int = 2) -> np.ndarray:
    """Return the standard deviation [2] of both motors' shifts from one homing to the next, but for electrical turns;
    with one of ``homings`` that from where the end stops switch in the mean."""
    scatter = scatter_of(scene.printer, scene.homed_again_mm)
    sd_mm = math.sqrt(homings * float(scatter.weight @ scatter.sd_mm**2))
    return np.asarray(sd_mm * np.linalg.norm(scene.printer.to_motor(np.eye(2)), axis=0))
