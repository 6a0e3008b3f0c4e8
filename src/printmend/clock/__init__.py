"""The clock: the printing time of a file, as it is and as mended, by a model of the firmware's planner.

`limits_of` reads the limits of a file's machine; `start_stopwatch` returns two clocks, which observe the planning of
the file and then say how long it takes.
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
