"""What no part of a machine's model follows, as columns over one motor's rows: by time, direction, half, period."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

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

    def all_at(self, done: float) -> "Sideways":
        """Return the same rows as if all were printed when this share of the print is done."""
        return Sideways(**{**vars(self), "done": np.full_like(self.done, done)})


@dataclass(frozen=True, eq=False)
class Candidate:
    """One thing that may be: its ``kind``, how many like it are tried, and the ``detail`` and ``place`` of its law."""

    kind: str
    tried: int = 1
    detail: float = 0.0
    place: float = 0.0

    def columns(self, one: Sideways) -> np.ndarray:
        """Return what it may do to each row, as columns [N, Q]."""
        return LAWS[self.kind](one, self.detail, self.place)


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
    yield Candidate("linear")
    for share in BREAKS:
        yield Candidate("step", len(BREAKS), float(share))
    for share in CREEPS:
        yield Candidate("creep", len(CREEPS), share)
    for kind in ("wear", "thermal", "direction", "speed"):
        yield Candidate(kind)
    for axis in range(2):
        for place in HALVES:
            yield Candidate("halves", 2 * len(HALVES), axis, float(place))
            yield Candidate("halves-play", 2 * len(HALVES), axis, float(place))
    yield Candidate("racking")
    yield Candidate("two-motors")
    span = np.ptp(one.motor_mm)
    turns = one.period_mm / PERIODS_MM
    apart = np.abs(turns / np.maximum(np.rint(turns), 1.0) - 1.0) > OWN_PERIOD
    periods = PERIODS_MM[apart & (0.8 * span > PERIODS_MM)]
    for period in periods:
        yield Candidate("second-period", len(periods), float(period))


def _upper(one: Sideways, axis: float, place: float) -> np.ndarray:
    """Tell which rows lie in the upper part of one of the bed's axes."""
    return (one.beds[:, int(axis)] > place) * 1.0


def _waves(one: Sideways, period_mm: float, harmonics: tuple[int, ...]) -> np.ndarray:
    angle = np.outer(one.motor_mm, harmonics) * (TURN_RAD / period_mm)
    return np.concatenate([np.cos(angle), np.sin(angle)], axis=1)


def _scaled(values: np.ndarray) -> np.ndarray:
    low, high = values.min(), values.max()
    return (2 * values - low - high) / max(float(high - low), 1e-9)


Law = Callable[[Sideways, float, float], np.ndarray]  # rows, detail, place → columns [N, Q]
LAWS: dict[str, Law] = {
    "linear": lambda s, _, __: s.done[:, None],
    "step": lambda s, share, _: (s.done > share)[:, None] * 1.0,
    "creep": lambda s, share, _: 1 - np.exp(-s.done / share)[:, None],
    "wear": lambda s, _, __: (s.side * s.done)[:, None],
    "thermal": lambda s, _, __: (s.own * (1 - np.exp(-s.done / WARMING)))[:, None],
    "direction": lambda s, _, __: s.across[:, None],
    "speed": lambda s, _, __: (s.side * np.minimum(1.0, s.move_mm / LONG_MM))[:, None],
    "halves": lambda s, axis, place: _upper(s, axis, place)[:, None],
    "halves-play": lambda s, axis, place: (s.side * _upper(s, axis, place))[:, None],
    "racking": lambda s, _, __: (s.side * s.other)[:, None],
    "two-motors": lambda s, _, __: _waves(s, s.period_mm, TWO_MOTORS) * s.other[:, None],
    "second-period": lambda s, period, _: _waves(s, period, (1,)),
}
