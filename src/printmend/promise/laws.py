"""The laws of misfits: each says how the error of a motor's belt depends on time, direction, place or period."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from printmend.units import TURN_RAD

WARMING = 0.25  # time constant of a machine that warms up, as a share of the print, where none is known
LONG_MM = 10.0  # on longer moves the head reaches the commanded speed
TWO_MOTORS = (1, 2, 3)  # harmonics of a pulley that may differ between the two motors of an axis


@dataclass(frozen=True, eq=False)
class LawRows:
    """The N rows of one motor, as the laws need them.

    ``motor_mm`` are its positions and ``period_mm`` its turn; ``done`` is the share of the print's length up to a row,
    ``side`` the side of the belt that is pushed. ``own``, ``other`` and ``beds`` [N, 2] are the places of this motor,
    of the other one and of the bed's axes, each scaled to −1…1 over the print. ``across`` is the direction in which the
    other motor last moved, ``ways`` [N, 2] those of the bed's axes; ``move_mm`` is the length of the last move and
    ``bed_mm`` [N, 2] the place on the bed.
    """

    motor_mm: np.ndarray
    period_mm: float
    done: np.ndarray
    side: np.ndarray
    own: np.ndarray
    other: np.ndarray
    beds: np.ndarray
    across: np.ndarray
    move_mm: np.ndarray
    ways: np.ndarray
    bed_mm: np.ndarray

    def at(self, rows: np.ndarray) -> "LawRows":
        """Return some of the rows."""
        picked = {name: value[rows] if isinstance(value, np.ndarray) else value for name, value in vars(self).items()}
        return LawRows(**picked)

    def all_at(self, done: float) -> "LawRows":
        """Return the same rows as if all were printed when this share of the print is done."""
        return LawRows(**{**vars(self), "done": np.full_like(self.done, done)})


def _upper(one: LawRows, axis: float, place: float) -> np.ndarray:
    """Tell which rows lie in the upper part of one of the bed's axes."""
    return (one.beds[:, int(axis)] > place) * 1.0


def _waves(place_mm: np.ndarray, period_mm: float, harmonics: tuple[int, ...]) -> np.ndarray:
    angle = np.outer(place_mm, harmonics) * (TURN_RAD / period_mm)
    return np.concatenate([np.cos(angle), np.sin(angle)], axis=1)


def widest_mm(weights: np.ndarray) -> float:
    """Return the largest value of the waves of `TWO_MOTORS` with weights [6] mm, over a turn."""
    return float(np.abs(_waves(np.linspace(0.0, 1.0, 360), 1.0, TWO_MOTORS) @ weights).max())


def warmed(done: np.ndarray, share: float) -> np.ndarray:
    """Return how far a machine has warmed up [N], from 0 to 1, with a time constant that is a share of the print."""
    return np.asarray(1 - np.exp(-done / (share or WARMING)))


def _thermal(one: LawRows, share: float, _: float) -> np.ndarray:
    """Return the columns of a warming machine: its parts expand, and its end stop moves away from the fixed point."""
    grown = warmed(one.done, share)
    return np.stack([one.own * grown, grown], axis=1)


def _rail(one: LawRows, axis: float, _: float) -> np.ndarray:
    """Return the columns of one rail's play: a constant part, and a part that grows evenly during the print."""
    way = one.ways[:, int(axis)]
    return np.stack([way, way * one.done], axis=1)


Law = Callable[[LawRows, float, float], np.ndarray]  # rows, detail, place → columns [N, Q]
LAWS: dict[str, Law] = {
    "linear": lambda s, _, __: s.done[:, None],
    "step": lambda s, share, _: (s.done > share)[:, None] * 1.0,
    "creep": lambda s, share, _: 1 - np.exp(-s.done / share)[:, None],
    "wear": lambda s, _, __: (s.side * s.done)[:, None],
    "sticking": lambda s, _, __: (s.side * s.done)[:, None],
    "thermal": _thermal,
    "direction": lambda s, _, __: s.across[:, None],
    "racking-across": lambda s, _, __: (s.across * s.own)[:, None],
    "speed": lambda s, _, __: (s.side * np.minimum(1.0, s.move_mm / LONG_MM))[:, None],
    "halves": lambda s, axis, place: _upper(s, axis, place)[:, None],
    "halves-play": lambda s, axis, place: (s.side * _upper(s, axis, place))[:, None],
    "racking": lambda s, _, __: (s.side * s.other)[:, None],
    "rail-play": _rail,
    "two-motors": lambda s, _, __: _waves(s.motor_mm, s.period_mm, TWO_MOTORS) * s.other[:, None],
    "second-period": lambda s, period, _: _waves(s.motor_mm, period, (1,)),
    "rail-racking": lambda s, axis, _: (s.ways[:, int(axis)] * s.beds[:, 1 - int(axis)])[:, None],
    "rail-wave": lambda s, period, axis: _waves(s.bed_mm[:, int(axis)], period, (1,)),
}
