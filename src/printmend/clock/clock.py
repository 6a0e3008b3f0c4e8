"""The clock: how long a printer takes for a file, mended or as it is, by a model of its firmware's planner."""

from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from printmend.clock.kernels import layout as k
from printmend.clock.kernels.advance import advance
from printmend.clock.limits import Limits
from printmend.gcode.container import open_gcode
from printmend.gcode.kernels import NO_NOTES, PIECE, RECORD
from printmend.gcode.read import starting_state
from printmend.gcode.write import Planned, follow
from printmend.jit import record
from printmend.messages import say
from printmend.printer import Printer

_AS_IT_IS, _NO_RECORDS, _NO_PIECES = np.empty(0, np.int64), np.empty(0, RECORD), np.empty(0, PIECE)


@dataclass(frozen=True)
class Duration:
    """How long a file takes as it is and as mended [s], by which ``limits``, without heating, homing and probing."""

    before_s: float
    after_s: float
    limits: Limits

    @property
    def share(self) -> float:
        """The share of time that mending adds."""
        return self.after_s / self.before_s - 1.0 if self.before_s > 0.0 else 0.0

    def json(self) -> dict[str, Any]:
        """Return plain values for a report."""
        limits = self.limits
        return {
            "before_s": round(self.before_s, 2), "after_s": round(self.after_s, 2), "firmware": limits.firmware,
            "limits": limits.said,
        }  # fmt: skip

    def words(self, *, mended: bool) -> str:
        """Say how long it takes as it is, and ``mended``."""
        before, after = span_words(self.before_s), span_words(self.after_s)
        if mended:
            return say("it-takes-mended", before, after, f"{100 * self.share:+.1f}", *self.limits.words)
        return say("it-takes", before, *self.limits.words)

    def __add__(self, other: "Duration") -> "Duration":
        """Return the time of two prints, one after the other."""
        return replace(self, before_s=self.before_s + other.before_s, after_s=self.after_s + other.after_s)


@dataclass(eq=False)
class Clock:
    """A clock on its way through one program. Mutable, because a file of any length streams through it.

    ``times_s`` [TIMES] are the seconds at the places in the file that tell the time, as far as they were seen.
    """

    limits: np.record
    state: np.record = field(default_factory=lambda: record(k.CLOCK))
    queue: np.ndarray = field(default_factory=lambda: np.zeros(k.QUEUE, k.MOVE), repr=False)
    times_s: np.ndarray = field(default_factory=lambda: np.zeros(k.TIMES), repr=False)

    def advance(self, planned: Planned, *, mended: bool) -> None:
        """Let a part of a file go by, as it is or as it is planned."""
        first = planned.first if mended else _AS_IT_IS
        advance(
            self.limits, self.state, self.queue, self.times_s, planned.records, planned.begin, planned.end,
            planned.notes, first, planned.pieces, False,
        )  # fmt: skip

    def finish(self) -> None:
        """Let the machine stop."""
        advance(
            self.limits, self.state, self.queue, self.times_s, _NO_RECORDS, 0, 0, NO_NOTES, _AS_IT_IS, _NO_PIECES, True
        )

    @property
    def seconds(self) -> float:
        """How long all has taken that is done [s]."""
        return float(self.state.seconds)


def start_clock(limits: Limits) -> Clock:
    """Return a clock at the beginning of a program."""
    clock = Clock(limits.lower())
    clock.state.at[:] = np.nan
    clock.state.peak2 = np.inf
    return clock


@dataclass(eq=False)
class Stopwatch:
    """Both clocks of one program: of the file as it is, and of the mended one."""

    limits: Limits
    before: Clock
    after: Clock

    def watch(self, planned: Planned) -> None:
        """Let a part of the program go by on both."""
        self.before.advance(planned, mended=False)
        self.after.advance(planned, mended=True)

    def finish(self) -> None:
        """Let both machines stop."""
        self.before.finish()
        self.after.finish()

    @property
    def duration(self) -> Duration:
        """How long both have taken so far."""
        return Duration(self.before.seconds, self.after.seconds, self.limits)


def start_stopwatch(limits: Limits) -> Stopwatch:
    """Return both clocks at the beginning of a program."""
    return Stopwatch(limits, start_clock(limits), start_clock(limits))


def span_words(seconds: float) -> str:
    """Return a time in hours, minutes and seconds, the two largest that it has."""
    whole = round(seconds)
    hours, minutes = whole // 3600, whole % 3600 // 60
    if hours:
        return f"{hours} h {minutes} min"
    return f"{minutes} min {whole % 60} s" if minutes else f"{whole} s"


def file_seconds(path: Path | str, limits: Limits, printer: Printer) -> float:
    """Return how long ``printer`` takes for the programs of a file within ``limits`` [s]. Raises as `open_gcode`."""
    seconds = 0.0
    with open_gcode(path) as file:
        for part in file.parts:
            clock = start_clock(limits)
            state = starting_state(part, printer=printer)
            follow(part.chunks(), state, _as_it_is, look=partial(clock.advance, mended=False))
            clock.finish()
            seconds += clock.seconds
    return seconds


def _as_it_is(records: np.ndarray, _begin: int) -> tuple[int, np.ndarray, np.ndarray]:
    return len(records), np.zeros(len(records) + 1, np.int64), _NO_PIECES
