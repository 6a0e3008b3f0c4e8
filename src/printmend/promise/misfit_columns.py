"""The candidates that the tests of misfit try, each a law with its parameters, and the rows that the laws are given."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from printmend.identify.drive.design import Rows
from printmend.identify.drive.second import other_periods_mm
from printmend.path import Trace, last_way
from printmend.promise.laws import LAWS, LawRows

BREAKS = np.linspace(0.1, 0.9, 17)  # shares of the print after which a step is looked for
FINER = 41  # breaks that are tried between both neighbours of the likeliest of these
CREEPS = (0.06, 0.1, 0.16, 0.25, 0.4, 0.7)  # time constants, as shares of the print
WARMINGS = (0.1, 0.25, 0.7)  # the same for warming: few, because with more of them one would fit a creep better
WARMING_ODDS = 20.0  # prior odds of a mere shift in time against warming, which also expands the machine
HALVES = np.linspace(-0.4, 0.4, 9)  # tried borders between two halves of the bed, whose span is −1 to 1
SEEN_SHARE = 0.8  # share of a motor's span that a period may have: longer ones do not show


@dataclass(frozen=True, eq=False)
class Candidate:
    """A law that is tried: its ``kind``, its parameters ``detail`` and ``place``, how many of its kind are tried."""

    kind: str
    tried: int = 1
    detail: float = 0.0
    place: float = 0.0

    def columns(self, one: LawRows) -> np.ndarray:
        """Return the law's columns [N, Q] at the rows."""
        return LAWS[self.kind](one, self.detail, self.place)


def law_rows(motors: list[Rows], which: int, commanded_mm: np.ndarray, side: np.ndarray) -> LawRows:
    """Return the rows of one motor as the laws need them."""
    rows, other = motors[which], motors[1 - which]
    done = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(commanded_mm, axis=0).T))])
    return LawRows(
        rows.motor_mm,
        rows.period_mm,
        done / max(float(done[-1]), 1e-9),
        side.astype(float),
        _scaled(rows.motor_mm),
        _scaled(other.motor_mm),
        np.stack([_scaled(axis) for axis in commanded_mm.T], axis=1),
        last_way(other.motor_mm),
        np.hypot(*np.diff(commanded_mm, axis=0, prepend=commanded_mm[:1]).T),
        np.stack([last_way(axis) for axis in commanded_mm.T], axis=1),
        commanded_mm,
    )


def in_time() -> Iterator[Candidate]:
    """Yield the candidates that shift places in the course of time."""
    yield Candidate("linear")
    for share in BREAKS:
        yield Candidate("step", len(BREAKS), float(share))
    for share in CREEPS:
        yield Candidate("creep", len(CREEPS), share)
    for share in WARMINGS:
        yield Candidate("thermal", int(WARMING_ODDS * len(WARMINGS)), share)


def finer_breaks(step: Candidate) -> list[Candidate]:
    """Return the steps between both neighbours of one."""
    width = BREAKS[1] - BREAKS[0]
    return [replace(step, detail=float(each)) for each in step.detail + np.linspace(-width, width, FINER)]


def wavy_axes(motor: int, trace: Trace, *, corexy: bool) -> tuple[int, ...]:
    """Return the axes of the bed along which a wave of a guide would show in a motor as in no part of its drive.

    Both motors of a CoreXY show both; another motor shows what pushes its axis along the other one, where no uneven
    instrument can have made it.
    """
    if corexy:
        return (0, 1)
    return () if trace.instrument_doubt.wave_mm else (1 - motor,)


def candidates(one: LawRows, wavy: tuple[int, ...], *, corexy: bool) -> Iterator[Candidate]:
    """Yield everything that is looked for; ``wavy`` are the axes along which a guide's wave is. What a rail does along
    itself is what a motor's belt does, but for a CoreXY's."""
    yield from in_time()
    for kind in ("wear", "direction", "racking-across", "speed"):
        yield Candidate(kind)
    for axis in range(2):
        for place in HALVES:
            yield Candidate("halves", 2 * len(HALVES), axis, float(place))
            yield Candidate("halves-play", 2 * len(HALVES), axis, float(place))
    yield Candidate("racking")
    for axis in range(2 * corexy):
        yield Candidate("rail-play", 2, axis)
        yield Candidate("rail-racking", 2, axis)
    yield Candidate("two-motors")
    periods = other_periods_mm(one.period_mm, SEEN_SHARE * float(np.ptp(one.motor_mm)))
    for period in periods:
        yield Candidate("second-period", len(periods), float(period))
    for axis in wavy:
        waves = other_periods_mm(one.period_mm, SEEN_SHARE * float(np.ptp(one.bed_mm[:, axis])))[::2]
        for period in waves:
            yield Candidate("rail-wave", 2 * len(waves), float(period), axis)


def _scaled(values: np.ndarray) -> np.ndarray:
    low, high = values.min(), values.max()
    return (2 * values - low - high) / max(float(high - low), 1e-9)
