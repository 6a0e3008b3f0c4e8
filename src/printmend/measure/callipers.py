"""Callipers instead of a scanner: distances across two large dots of a probe, and the owner's readings of them."""

import itertools
import math
import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from printmend.errors import TraceError
from printmend.files import read_text
from printmend.measure.plan import ProbePlan
from printmend.messages import say
from printmend.path import frozen

MOST_DISTANCES = 12  # most distances to ask for; more try an owner's patience
READING_SD_MM = 0.07  # standard deviation of one reading: the callipers and the hand that holds them
SHORTEST_MM, LONGEST_MM = 20.0, 145.0  # the common callipers open 150 mm
SURE_OF_SIDE_MM = 4.0  # after this much travel one way, the side that pushes the belt is known: no play is wider
DOUBTED_SIGMAS = 4.0  # a reading farther from its expected value than this is doubted
SLIP_SHARE = 0.25  # a reading off by more than this share of its distance is a slip of the hand
# A line's number in front of its reading: "9;", "9:", "9,", "9)", "9. ", "9 ", or alone, where no reading was taken.
_IN_FRONT = re.compile(r"(\d{1,3})(?:\s*[;:,)]\s*|\.?\s+|\.?$)")


@dataclass(frozen=True, eq=False)
class Distances:
    """``pairs`` [K, 2] are the numbers of two marks, both large dots. ``across_mm`` [K] is their distance on a healthy
    printer, between outer edges, or between inner edges where ``inner`` [K] is set."""

    plan: ProbePlan
    pairs: np.ndarray
    across_mm: np.ndarray
    inner: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))

    def __post_init__(self) -> None:
        inner = np.asarray(self.inner, bool)
        object.__setattr__(self, "inner", frozen(inner if len(inner) else np.zeros(len(self.pairs), bool)))
        object.__setattr__(self, "pairs", frozen(np.asarray(self.pairs, np.int64)))
        object.__setattr__(self, "across_mm", frozen(np.asarray(self.across_mm, float)))


def distances_of(plan: ProbePlan, pairs: np.ndarray, inner: np.ndarray | None = None) -> Distances:
    """Return distances between pairs [K, 2] of large dots."""
    marks, inner = plan.marks_mm, np.zeros(len(pairs), bool) if inner is None else inner
    across = np.hypot(*(marks[pairs[:, 1]] - marks[pairs[:, 0]]).T) + np.where(inner, -1, 1) * plan.big_dot_mm
    return Distances(plan, pairs, across, inner)


def measurable_pairs(plan: ProbePlan) -> np.ndarray:
    """Return the pairs [K, 2] of large dots that callipers can span. Raises `TraceError` for too few."""
    marks, (_, run) = plan.marks_mm, plan.motor_approaches
    sure = plan.big & (run >= SURE_OF_SIDE_MM).all(axis=1)
    pairs = np.array(list(itertools.combinations(np.flatnonzero(sure), 2)), np.int64).reshape(-1, 2)
    length = np.hypot(*(marks[pairs[:, 1]] - marks[pairs[:, 0]]).T)
    pairs = pairs[(length >= SHORTEST_MM) & (length <= LONGEST_MM)]
    if len(pairs) < MOST_DISTANCES:
        raise TraceError(
            say("subject-probe"),
            wanted=say("pairs-large-dots-mm-apart", MOST_DISTANCES, f"{SHORTEST_MM:.0f}", f"{LONGEST_MM:.0f}"),
            came=f"{len(pairs)}",
            todo=say("print-larger-probe"),
        )
    return pairs


def describe(distances: Distances) -> list[str]:
    """Return a line for each distance: which dots, and about how far apart."""
    marks = distances.plan.marks_mm
    lines: list[str] = []
    for number, ((first, second), across) in enumerate(zip(distances.pairs, distances.across_mm, strict=True), start=1):
        (x0, y0), (x1, y1) = marks[first], marks[second]
        ends = (f"{each:.0f}" for each in (x0, y0, x1, y1))
        lines.append(say("across-large-dots", f"{number:2d}", *ends, f"{across:.1f}"))
    return lines


def parse_readings(text: str, distances: Distances, *, subject: str) -> np.ndarray:
    """Read distances [K] in mm, one a line (or the last cell of a CSV line), NaN where a line is empty.

    A line may begin with its own number. Raises `TraceError` for text, too many lines, the number of another line, and
    readings that cannot be of these dots (inches are named).
    """
    lines = [line.strip() for line in text.splitlines()]
    if lines and lines[0] and _is_header(lines[0]):
        lines = lines[1:]
    while lines and not lines[-1]:
        lines.pop()
    if len(lines) > len(distances.pairs):
        raise TraceError(
            subject, wanted=say("distances-2", len(distances.pairs)), came=f"{len(lines)}", todo=say("one-a-line")
        )
    readings = np.full(len(distances.pairs), np.nan)
    for row, line in enumerate(lines):
        number = row + 1
        front, rest = _numbered(line)
        last = line.rsplit(",", 1)[-1]
        if not (rest and last if front == number else last):
            continue
        about_mm = float(distances.across_mm[row])
        value = number_in(line, about_mm)
        if value is None:
            raise TraceError(
                subject, wanted=say("distance-mm", number), came=repr(line[:30]), todo=say("write-numbers-like-123-45")
            )
        if front not in (None, number) and front <= len(readings) and value == number_in(rest, value):
            raise TraceError(
                subject, wanted=say("distance-mm", number), came=repr(line[:30]), todo=say("write-in-order-list")
            )
        _check_reading(subject, number, value, about_mm, line)
        readings[row] = value
    if not np.isfinite(readings).any():
        raise TraceError(subject, wanted=say("least-distance"), came=say("none"), todo=say("measure-few-list"))
    return readings


def read_readings(path: str | Path, distances: Distances) -> np.ndarray:
    """Read distances [K] from a file, as `parse_readings` does."""
    text = read_text(path, wanted=say("list-distances"), todo=say("write-them-line"), error=TraceError)
    return parse_readings(text, distances, subject=str(path))


def number_in(line: str, about_mm: float) -> float | None:
    """Return the number of a line, or None: 146.25, 146,25, what follows a number in front, or the last cell of a
    table's row.

    If a line can be read in several ways, the value nearest to ``about_mm`` counts.
    """
    line = line.strip().removesuffix("mm").strip()
    texts = (line, _numbered(line)[1], line.rsplit(",", 1)[-1])
    values = [value for text in texts if math.isfinite(value := _number(text.replace(",", ".", 1)))]
    return min(values, key=lambda value: abs(value - about_mm)) if values else None


def _numbered(line: str) -> tuple[int | None, str]:
    """Return a line's number in front of its reading, None without one, and what follows it."""
    front = _IN_FRONT.match(line)
    return (int(front[1]), line[front.end() :]) if front else (None, line)


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def _is_header(line: str) -> bool:
    """Return whether a line holds only words. A line with a digit, or nan, is a reading: skipping one would shift all
    later readings to the wrong distances."""
    return line.lower() != "nan" and not any(map(str.isdigit, line))


def _check_reading(subject: str, number: int, came_mm: float, about_mm: float, line: str) -> None:
    if abs(came_mm / about_mm - 1) <= SLIP_SHARE:
        return
    inches = abs(came_mm * 25.4 / about_mm - 1) <= SLIP_SHARE
    raise TraceError(
        subject,
        wanted=say("distance-about-mm", number, f"{about_mm:.1f}"),
        came=say("inches-factor", f"{came_mm:g}") if inches else repr(line[:30]),
        todo=say("measure-again-mm-leave-line-empty"),
    )
