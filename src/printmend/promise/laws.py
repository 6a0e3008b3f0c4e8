"""The laws of misfits: what each does to a motor's belt, by time, direction, half of the bed, period."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from printmend.units import TURN_RAD

WARMING = 0.25  # time constant of a machine that warms up, as a share of the print, where none is known
LONG_MM = 10.0  # moves longer than this have reached their speed
TWO_MOTORS = (1, 2, 3)  # harmonics of a pulley that may differ between the two motors of an axis


@dataclass(frozen=True, eq=False)
class Sideways:
    """One motor's rows as the tests see them, all [N] but two: the share of the print that is ``done``, the ``side`` of
    the belt that is touched, the motor's place ``own`` and that of the bed's axes ``beds`` [N, 2] from −1 to 1, which
    way the other motor last went, ``across``, the length of the last move on the bed, ``move_mm``, which way the bed's
    axes last went, ``ways`` [N, 2], and the place there, ``bed_mm`` [N, 2]."""

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

    def at(self, rows: np.ndarray) -> "Sideways":
        """Return some of the rows."""
        picked = {name: value[rows] if isinstance(value, np.ndarray) else value for name, value in vars(self).items()}
        return Sideways(**picked)

    def all_at(self, done: float) -> "Sideways":
        """Return the same rows as if all were printed when this share of the print is done."""
        return Sideways(**{**vars(self), "done": np.full_like(self.done, done)})


def _upper(one: Sideways, axis: float, place: float) -> np.ndarray:
    """Tell which rows lie in the upper part of one of the bed's axes."""
    return (one.beds[:, int(axis)] > place) * 1.0


def _waves(place_mm: np.ndarray, period_mm: float, harmonics: tuple[int, ...]) -> np.ndarray:
    angle = np.outer(place_mm, harmonics) * (TURN_RAD / period_mm)
    return np.concatenate([np.cos(angle), np.sin(angle)], axis=1)


def warmed(done: np.ndarray, share: float) -> np.ndarray:
    """Return how far a machine has warmed up [N], from 0 to 1, with a time constant that is a share of the print."""
    return np.asarray(1 - np.exp(-done / (share or WARMING)))


def _thermal(one: Sideways, share: float, _: float) -> np.ndarray:
    """Return how a machine that warms up grows, and how its end stop moves away from where it grows from."""
    grown = warmed(one.done, share)
    return np.stack([one.own * grown, grown], axis=1)


def _rail(one: Sideways, axis: float, _: float) -> np.ndarray:
    """Return the play of one of the bed's axes, as it was from the first point on and as it grew."""
    way = one.ways[:, int(axis)]
    return np.stack([way, way * one.done], axis=1)


Law = Callable[[Sideways, float, float], np.ndarray]  # rows, detail, place → columns [N, Q]
LAWS: dict[str, Law] = {
    "linear": lambda s, _, __: s.done[:, None],
    "step": lambda s, share, _: (s.done > share)[:, None] * 1.0,
    "creep": lambda s, share, _: 1 - np.exp(-s.done / share)[:, None],
    "wear": lambda s, _, __: (s.side * s.done)[:, None],
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
