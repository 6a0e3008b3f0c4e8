"""The clock: seconds of a file as it is and as mended, by a model of the firmware's planner.

`limits_of` reads from a file what its machine may do at most; `start_stopwatch` returns two clocks, which look on while
the file is planned and then say how long it takes.
"""

from printmend.clock.clock import (
    FIRMWARES,
    Clock,
    Duration,
    Limits,
    Stopwatch,
    file_seconds,
    klipper,
    limits_of,
    span_words,
    start_clock,
    start_stopwatch,
)
from printmend.clock.told import told_as_a_whole, with_times

__all__ = [
    "FIRMWARES",
    "Clock",
    "Duration",
    "Limits",
    "Stopwatch",
    "file_seconds",
    "klipper",
    "limits_of",
    "span_words",
    "start_clock",
    "start_stopwatch",
    "told_as_a_whole",
    "with_times",
]
