"""Faults that no model of printmend has, laid over the foreign printer of `outside`: numpy only, nothing shared.

Each takes the moves, where the printer put them, and how far it had travelled before; it returns where they land now.
"""

import math
from collections.abc import Callable

import numpy as np

from outside import Move

Printed = list[np.ndarray]
Fault = Callable[[list[Move], Printed, float], Printed]


def _joined(printed: Printed) -> tuple[np.ndarray, np.ndarray]:
    """Return all places in one array, and how far the nozzle had gone at each."""
    places = np.concatenate(printed)
    return places, np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(places, axis=0).T))])


def _parted(places: np.ndarray, printed: Printed) -> Printed:
    return np.split(places, np.cumsum([len(way) for way in printed])[:-1])


def ringing(rng: np.random.Generator) -> Fault:
    """After each turn an axis swings out: a damped wave of the way since."""
    size, wave, fade = rng.uniform(0.02, 0.1), rng.uniform(1.0, 2.5), rng.uniform(2.0, 6.0)

    def swing(moves: list[Move], printed: Printed, before_mm: float) -> Printed:
        places, gone = _joined(printed)
        moved = places.copy()
        way = np.diff(places, axis=0, prepend=places[:1])
        speed = way / np.maximum(np.hypot(*way.T), 1e-9)[:, None]
        for axis in range(2):
            kicks = np.flatnonzero(np.abs(np.diff(speed[:, axis], prepend=0.0)) > 0.3)
            last = np.maximum.accumulate(np.where(np.isin(np.arange(len(gone)), kicks), np.arange(len(gone)), 0))
            since = gone - gone[last]
            kick = np.diff(speed[:, axis], prepend=0.0)[last]
            moved[:, axis] += size * kick * np.exp(-since / fade) * np.sin(2 * math.pi * since / wave)
        return _parted(moved, printed)

    return swing


def stick_slip(rng: np.random.Generator) -> Fault:
    """An axis stays until its motor is a little ahead, then slips most of the way."""
    hold = rng.uniform(0.02, 0.1)

    def slip(moves: list[Move], printed: Printed, before_mm: float) -> Printed:
        places, _ = _joined(printed)
        stuck = places.copy()
        for axis in range(2):
            at = places[0, axis]
            for i, to in enumerate(places[:, axis].tolist()):
                if abs(to - at) > hold:
                    at = to - math.copysign(0.2 * hold, to - at)
                stuck[i, axis] = at
        return _parted(stuck, printed)

    return slip


def creep(rng: np.random.Generator) -> Fault:
    """A clamp gives way: one axis shifts for good, the more the longer the printer has run."""
    size, way_mm, axis = rng.uniform(0.05, 0.3), rng.uniform(2e3, 2e4), int(rng.integers(2))

    def shift(moves: list[Move], printed: Printed, before_mm: float) -> Printed:
        places, gone = _joined(printed)
        moved = places.copy()
        moved[:, axis] += size * (1 - np.exp(-(gone + before_mm) / way_mm))
        return _parted(moved, printed)

    return shift


def wear(rng: np.random.Generator) -> Fault:
    """Play that grows with every metre, on one axis."""
    rate, axis = rng.uniform(0.05, 0.2) / 1e4, int(rng.integers(2))

    def lag(moves: list[Move], printed: Printed, before_mm: float) -> Printed:
        places, gone = _joined(printed)
        moved, at = places.copy(), places[0, axis]
        half = rate * (gone + before_mm) / 2
        for i, to in enumerate(places[:, axis].tolist()):
            at = min(max(at, to - half[i]), to + half[i])
            moved[i, axis] = at
        return _parted(moved, printed)

    return lag


def racking(rng: np.random.Generator) -> Fault:
    """A gantry that lags on one side: the error of x has the sign of its motion and grows away from the middle."""
    lean = rng.uniform(0.02, 0.15) / 100

    def rack(moves: list[Move], printed: Printed, before_mm: float) -> Printed:
        places, _ = _joined(printed)
        moved = places.copy()
        way = np.sign(np.diff(places[:, 0], prepend=places[0, 0]))
        last = way[np.maximum.accumulate(np.where(way != 0, np.arange(len(way)), 0))]
        moved[:, 0] -= last * lean * (places[:, 1] - 110)
        return _parted(moved, printed)

    return rack


def drift(rng: np.random.Generator) -> Fault:
    """The frame warms up anew in each print and grows."""
    growth, way_mm = rng.uniform(0.0003, 0.0015), rng.uniform(3e3, 1e4)

    def grow(moves: list[Move], printed: Printed, before_mm: float) -> Printed:
        places, gone = _joined(printed)
        return _parted(places * (1 + growth * (1 - np.exp(-gone / way_mm)))[:, None], printed)

    return grow


def jitter(rng: np.random.Generator) -> Fault:
    """A loose nozzle: every few millimetres somewhere else."""
    size, length = rng.uniform(0.01, 0.04), rng.uniform(1.0, 4.0)

    def shake(moves: list[Move], printed: Printed, before_mm: float) -> Printed:
        places, gone = _joined(printed)
        knots = np.arange(0, gone[-1] + 2 * length, length)
        off = [np.interp(gone, knots, rng.normal(0, 1.2 * size, len(knots))) for _ in range(2)]
        return _parted(places + np.stack(off, axis=1), printed)

    return shake


FAULTS = {each.__name__: each for each in (ringing, stick_slip, creep, wear, racking, drift, jitter)}
