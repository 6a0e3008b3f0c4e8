"""What no part of a machine's model follows, as columns over one motor's rows: by time, direction, half, period."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from printmend.learn.drive.design import Rows
from printmend.path import last_way
from printmend.units import TURN_RAD

BREAKS = np.linspace(0.1, 0.9, 17)  # shares of the print after which a step is looked for
CREEPS = (0.06, 0.15, 0.3)  # time constants, as shares of the print
WARMING = 0.25  # time constant of a machine that warms up
LONG_MM = 10.0  # moves longer than this have reached their speed
HALVES = np.linspace(-0.4, 0.4, 9)  # where one half of the bed may end and the other begin, the span from −1 to 1
TWO_MOTORS = (1, 2, 3)  # harmonics of a pulley that may differ between the two motors of an axis
PERIODS_MM = np.geomspace(12.0, 150.0, 160)
OWN_PERIOD = 0.02  # a second period is at least so far from the turn's own harmonics, as a share


@dataclass(frozen=True, eq=False)
class Sideways:
    """One motor's rows as the tests see them, all [N]: the share of the print that is ``done``, the ``side`` of the
    belt that is touched, the motor's place ``own`` and that of the bed's axes ``beds`` [N, 2] from −1 to 1, which way
    the other motor last went, ``across``, the length of this motor's last move."""

    motor_mm: np.ndarray
    period_mm: float
    done: np.ndarray
    side: np.ndarray
    own: np.ndarray
    other: np.ndarray
    beds: np.ndarray
    across: np.ndarray
    move_mm: np.ndarray

    def at(self, rows: np.ndarray) -> "Sideways":
        """Return some of the rows."""
        picked = {name: value[rows] if isinstance(value, np.ndarray) else value for name, value in vars(self).items()}
        return Sideways(**picked)

    def ended(self) -> "Sideways":
        """Return the same rows as if all were printed at the end."""
        return Sideways(**{**vars(self), "done": np.ones_like(self.done)})


Columns = Callable[[Sideways], np.ndarray]


@dataclass(frozen=True, eq=False)
class Candidate:
    """One thing that may be: its ``kind``, its columns [N, Q], how many like it are tried, and a detail for words."""

    kind: str
    columns: Columns
    tried: int = 1
    detail: float = 0.0


def sideways(motors: list[Rows], which: int, commanded_mm: np.ndarray, side: np.ndarray) -> Sideways:
    """Return one motor's rows as the tests see them."""
    rows, other = motors[which], motors[1 - which]
    done = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(commanded_mm, axis=0).T))])
    return Sideways(
        rows.motor_mm,
        rows.period_mm,
        done / max(float(done[-1]), 1e-9),
        side.astype(float),
        _scaled(rows.motor_mm),
        _scaled(other.motor_mm),
        np.stack([_scaled(axis) for axis in commanded_mm.T], axis=1),
        last_way(other.motor_mm),
        np.abs(np.diff(rows.motor_mm, prepend=rows.motor_mm[:1])),
    )


def candidates(one: Sideways) -> Iterator[Candidate]:
    """Yield everything that is looked for."""
    yield Candidate("linear", lambda s: s.done[:, None])
    for share in BREAKS:
        yield Candidate("step", partial(_after, share=share), len(BREAKS), share)
    for share in CREEPS:
        yield Candidate("creep", partial(_crept, share=share), len(CREEPS), share)
    yield Candidate("wear", lambda s: (s.side * s.done)[:, None])
    yield Candidate("thermal", lambda s: (s.own * (1 - np.exp(-s.done / WARMING)))[:, None])
    yield Candidate("direction", lambda s: s.across[:, None])
    yield Candidate("speed", lambda s: (s.side * np.minimum(1.0, s.move_mm / LONG_MM))[:, None])
    for axis in range(2):
        for place in HALVES:
            tried = 2 * len(HALVES)
            yield Candidate("halves", partial(_beyond, axis=axis, place=place), tried, axis)
            yield Candidate("halves-play", partial(_play_beyond, axis=axis, place=place), tried, axis)
    yield Candidate("racking", lambda s: (s.side * s.other)[:, None])
    yield Candidate("two-motors", lambda s: _waves(s, s.period_mm, TWO_MOTORS) * s.other[:, None])
    span = np.ptp(one.motor_mm)
    turns = one.period_mm / PERIODS_MM
    apart = np.abs(turns / np.maximum(np.rint(turns), 1.0) - 1.0) > OWN_PERIOD
    periods = PERIODS_MM[apart & (0.8 * span > PERIODS_MM)]
    for period in periods:
        yield Candidate("second-period", partial(_waves, period_mm=period, harmonics=(1,)), len(periods), float(period))


def _after(one: Sideways, share: float) -> np.ndarray:
    return (one.done > share)[:, None] * 1.0


def _crept(one: Sideways, share: float) -> np.ndarray:
    return 1 - np.exp(-one.done / share)[:, None]


def _beyond(one: Sideways, axis: int, place: float) -> np.ndarray:
    return (one.beds[:, [axis]] > place) * 1.0


def _play_beyond(one: Sideways, axis: int, place: float) -> np.ndarray:
    return one.side[:, None] * _beyond(one, axis, place)


def _waves(one: Sideways, period_mm: float, harmonics: tuple[int, ...]) -> np.ndarray:
    angle = np.outer(one.motor_mm, harmonics) * (TURN_RAD / period_mm)
    return np.concatenate([np.cos(angle), np.sin(angle)], axis=1)


def _scaled(values: np.ndarray) -> np.ndarray:
    low, high = values.min(), values.max()
    return (2 * values - low - high) / max(float(high - low), 1e-9)
