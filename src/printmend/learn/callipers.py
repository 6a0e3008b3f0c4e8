"""Callipers instead of a scanner: at most twelve distances, and only what these can support.

For each motor the error at a mark is s·m − d·b/2 + a·sin(2πm/T) + c·cos(2πm/T): a scale s, play b (d is the direction
of approach), and an eccentric pulley; the bed has one skew x' = x + y·γ. A distance across two large dots also contains
the width that dots have on this plate. The distances are chosen one by one, each with the largest gain of information.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from printmend.errors import TraceError
from printmend.files import read_text
from printmend.machine import Frame, Mechanism, Transmission, healthy_transmission
from printmend.measure.plan import ProbePlan
from printmend.path import frozen
from printmend.printer import Printer

MOST_DISTANCES = 12  # distances that are asked for; more try an owner's patience
READING_SD_MM = 0.07  # standard deviation of one reading: the callipers and the hand that holds them
SHORTEST_MM, LONGEST_MM = 20.0, 145.0  # the common callipers open 150 mm
SURE_OF_SIDE_MM = 4.0  # a motor that came this far one way pushes the belt with a known side: no play is wider
SLIP_SHARE = 0.25  # a reading that differs from its distance by a larger share is a slip of the hand
NAMES = ("scale", "play", "sine", "cosine")  # of a motor's unknowns
# The unknowns are those of one motor, those of the other, the skew, and the width of dots.
SKEW_AT = 2 * len(NAMES)
UNKNOWNS = SKEW_AT + 2
OWNERS_WORDS = {
    "scale": "scale error (+: prints too large)", "play": "belt's play",
    "sine": "pulley off its centre, sine part", "cosine": "pulley off its centre, cosine part",
}  # fmt: skip
PRIOR_SD = (0.05, 0.6, 0.4, 0.4)  # their prior standard deviations: 1, then mm
SKEW_SD, WIDTH_SD_MM = 0.01, 0.2  # prior standard deviations of tan γ and of the dots' width
UNLIKE_SD = 1e-4  # of the difference of a CoreXY's two scales
SUPPORTED_SHARE = 0.5  # an estimate is the distances' own if its standard deviation is below this share of the prior's
SEEN_SIGMAS = 3.0  # an estimate within so many standard deviations of 0 is not corrected


@dataclass(frozen=True, eq=False)
class Distances:
    """``pairs`` [K, 2] numbers of the marks, both large dots; ``across_mm`` [K] the distance on a healthy printer,
    between outer edges or, where ``inner`` [K] says so, inner ones."""

    plan: ProbePlan
    pairs: np.ndarray
    across_mm: np.ndarray
    inner: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))

    def __post_init__(self) -> None:
        inner = np.asarray(self.inner, bool)
        object.__setattr__(self, "inner", frozen(inner if len(inner) else np.zeros(len(self.pairs), bool)))
        object.__setattr__(self, "pairs", frozen(np.asarray(self.pairs, np.int64)))
        object.__setattr__(self, "across_mm", frozen(np.asarray(self.across_mm, float)))


@dataclass(frozen=True)
class Estimate:
    """One quantity, ``value`` ± ``sd``; ``supported`` says that the distances tell it, and not the prior alone."""

    name: str
    value: float
    sd: float
    unit: str
    supported: bool

    @property
    def corrected(self) -> bool:
        """Whether it is to be corrected: the distances tell it, and it is not 0."""
        return self.supported and abs(self.value) > SEEN_SIGMAS * self.sd

    def __str__(self) -> str:
        factor, unit = {"": (100.0, "%"), "rad": (180 / math.pi, "°"), "mm": (1.0, "mm")}[self.unit]
        part, _, what = self.name.rpartition(" ")
        name = f"{part} {OWNERS_WORDS[what]}" if part and what in OWNERS_WORDS else self.name
        said = f"{name}: {self.value * factor:+.3f} ± {self.sd * factor:.3f} {unit}"
        if not self.supported:
            return said + ", which these distances cannot tell"
        return said if self.corrected else said + ", none to be seen"


def choose_distances(plan: ProbePlan) -> Distances:
    """Choose at most twelve distances between large dots that tell most about the machine."""
    pairs = measurable_pairs(plan)
    features = slopes(plan, pairs)
    covariance = prior_covariance(plan)
    chosen: list[int] = []
    for _ in range(MOST_DISTANCES):
        best, covariance = most_telling(features, covariance, chosen)
        chosen.append(best)
    return distances_of(plan, pairs[chosen])


def distances_of(plan: ProbePlan, pairs: np.ndarray, inner: np.ndarray | None = None) -> Distances:
    """Return distances between pairs [K, 2] of large dots."""
    marks, inner = plan.marks_mm, np.zeros(len(pairs), bool) if inner is None else inner
    across = np.hypot(*(marks[pairs[:, 1]] - marks[pairs[:, 0]]).T) + np.where(inner, -1, 1) * plan.big_dot_mm
    return Distances(plan, pairs, across, inner)


def most_telling(features: np.ndarray, covariance: np.ndarray, taken: Sequence[int]) -> tuple[int, np.ndarray]:
    """Return which distance, of those not ``taken``, tells most, and the covariance after it was read."""
    spread = np.einsum("ki,ij,kj->k", features, covariance, features)
    spread[list(taken)] = -1.0
    best = int(np.argmax(spread))
    gain = covariance @ features[best]
    return best, covariance - np.outer(gain, gain) / (READING_SD_MM**2 + spread[best])


def measurable_pairs(plan: ProbePlan) -> np.ndarray:
    """Return the pairs [K, 2] of large dots that callipers can span. Raises `TraceError` for too few."""
    marks, (_, run) = plan.marks_mm, plan.motor_approaches
    sure = plan.big & (run >= SURE_OF_SIDE_MM).all(axis=1)
    pairs = np.array(list(itertools.combinations(np.flatnonzero(sure), 2)), np.int64).reshape(-1, 2)
    length = np.hypot(*(marks[pairs[:, 1]] - marks[pairs[:, 0]]).T)
    pairs = pairs[(length >= SHORTEST_MM) & (length <= LONGEST_MM)]
    if len(pairs) < MOST_DISTANCES:
        raise TraceError(
            "the probe",
            wanted=f"{MOST_DISTANCES} pairs of large dots {SHORTEST_MM:.0f} to {LONGEST_MM:.0f} mm apart",
            came=f"{len(pairs)}",
            todo="print a larger probe",
        )
    return pairs


def describe(distances: Distances) -> list[str]:
    """Return one line a distance: which dots, and about how far apart."""
    marks = distances.plan.marks_mm
    lines = []
    for number, ((first, second), across) in enumerate(zip(distances.pairs, distances.across_mm, strict=True), start=1):
        (x0, y0), (x1, y1) = marks[first], marks[second]
        lines.append(
            f"{number:2d}. across the large dots at X{x0:.0f} Y{y0:.0f} and X{x1:.0f} Y{y1:.0f}, about {across:.1f} mm"
        )
    return lines


def parse_readings(text: str, distances: Distances, *, subject: str) -> np.ndarray:
    """Read distances [K] in mm, one a line (or the last cell of a CSV line), NaN where a line is empty.

    Raises `TraceError` for text, too many lines, and readings that cannot be of these dots (inches are named).
    """
    lines = [line.strip() for line in text.splitlines()]
    if lines and lines[0] and not _is_number(lines[0]):
        lines = lines[1:]  # a header
    while lines and not lines[-1]:
        lines.pop()
    if len(lines) > len(distances.pairs):
        raise TraceError(subject, wanted=f"{len(distances.pairs)} distances", came=f"{len(lines)}", todo="one a line")
    readings = np.full(len(distances.pairs), np.nan)
    for row, line in enumerate(lines):
        cell = line.rsplit(",", 1)[-1].strip()
        if not cell:
            continue
        about_mm = float(distances.across_mm[row])
        value = number_in(line, about_mm)
        if value is None:
            raise TraceError(
                subject, wanted=f"distance {row + 1} in mm", came=repr(cell[:30]), todo="write numbers like 123.45"
            )
        readings[row] = value
        _check_reading(subject, row + 1, value, about_mm)
    if not np.isfinite(readings).any():
        raise TraceError(subject, wanted="at least one distance", came="none", todo="measure a few of the list")
    return readings


def read_readings(path: str | Path, distances: Distances) -> np.ndarray:
    """Read distances [K] from a file, as `parse_readings` does."""
    text = read_text(path, wanted="a list of distances", todo="write them one a line", error=TraceError)
    return parse_readings(text, distances, subject=str(path))


def number_in(line: str, about_mm: float) -> float | None:
    """Return the number of a line, None without one: 146.25, 146,25, or the last cell of a table's row.

    Of several ways to read it, the one nearest to what is expected counts.
    """
    line = line.strip().removesuffix("mm").strip()
    whole, cell = line.replace(",", ".", 1), line.rsplit(",", 1)[-1]
    values = [float(text) for text in (cell, whole) if _is_number(text) and "," not in text]
    return min(values, key=lambda value: abs(value - about_mm)) if values else None


def _is_number(line: str) -> bool:
    try:
        return math.isfinite(float(line.rsplit(",", 1)[-1]))
    except ValueError:
        return False


def _check_reading(subject: str, number: int, came_mm: float, about_mm: float) -> None:
    if abs(came_mm / about_mm - 1) <= SLIP_SHARE:
        return
    inches = abs(came_mm * 25.4 / about_mm - 1) <= SLIP_SHARE
    raise TraceError(
        subject,
        wanted=f"distance {number} of about {about_mm:.1f} mm",
        came=f"{came_mm:g}" + (" (inches: a factor of 25.4)" if inches else ""),
        todo="measure it again in mm, or leave its line empty",
    )


def estimate(distances: Distances, readings_mm: np.ndarray) -> tuple[Estimate, ...]:
    """Return scale, play and first harmonic of each motor, and the skew, from readings [K] (NaN where not taken)."""
    known = np.isfinite(readings_mm)
    if not known.any():
        raise TraceError("the distances", wanted="at least one", came="none", todo="measure a few of the list")
    prior_sd = _prior_sd()
    values = np.zeros(len(prior_sd))
    prior = np.linalg.inv(prior_covariance(distances.plan))
    for _ in range(4):  # the distance bends a little with the errors themselves
        features, seen_mm = about(distances, readings_mm, values)
        covariance = np.linalg.inv(features.T @ features / READING_SD_MM**2 + prior)
        values = covariance @ (features.T @ seen_mm) / READING_SD_MM**2
    sd = np.sqrt(np.diag(covariance))
    motors = ("A", "B") if distances.plan.kinematics == "corexy" else ("X", "Y")
    labels = [
        (f"{motor} {name}", unit) for motor in motors for name, unit in zip(NAMES, ("", "mm", "mm", "mm"), strict=True)
    ]
    labels += [("skew", "rad"), ("dot width", "mm")]
    return tuple(
        Estimate(name, float(value), float(spread), unit, bool(spread < SUPPORTED_SHARE * prior))
        for (name, unit), value, spread, prior in zip(labels, values, sd, prior_sd, strict=True)
    )


def about(
    distances: Distances, readings_mm: np.ndarray, values: np.ndarray, harmonics: Sequence[int] = (1,)
) -> tuple[np.ndarray, np.ndarray]:
    """Return how the readings that were taken depend on the unknowns near these ``values`` [10]: the features [K, P],
    and what of the readings these have to explain [K].

    Each motor has an unknown sine and cosine for each of its pulley's ``harmonics``, of which the first comes first.
    """
    known = np.isfinite(readings_mm)
    plan, pairs = distances.plan, distances.pairs[known]
    moved = plan.marks_mm + _errors_mm(plan, values)
    side = np.where(distances.inner[known], -1.0, 1.0)
    across = np.hypot(*(moved[pairs[:, 1]] - moved[pairs[:, 0]]).T) + side * (plan.big_dot_mm + values[-1])
    features = _features(plan, pairs, moved, harmonics)
    features[:, -1] = side
    blocks = np.repeat([len(NAMES), SKEW_AT], len(harmonics) * 2 - 2)  # the values have no higher harmonics
    return features, readings_mm[known] - across + features @ np.insert(values, blocks, 0.0)


def mechanism(estimates: Sequence[Estimate], printer: Printer) -> Mechanism:
    """Return the machine that the worthwhile estimates describe: what is not known well is left healthy."""
    values = [estimate.value if estimate.corrected else 0.0 for estimate in estimates]
    transmissions = []
    for motor in range(2):
        scale, play, sine, cosine = values[len(NAMES) * motor : len(NAMES) * (motor + 1)]
        grid = healthy_transmission(printer, motor).motor_mm
        phase = 2 * np.pi * grid / printer.axes[motor].mm_per_turn
        middle = grid * (1 + scale) + sine * np.sin(phase) + cosine * np.cos(phase)
        half = max(play, 0.0) / 2
        pitch = float(grid[1] - grid[0])
        transmissions.append(Transmission(float(grid[0]), pitch, middle - half, middle + half))
    coefficients = np.zeros((2, 10))
    scale_mm = Frame().scale_mm
    coefficients[0, Frame.exponents.index((0, 1))] = values[SKEW_AT] * scale_mm
    return Mechanism(printer, (transmissions[0], transmissions[1]), Frame(coefficients, scale_mm)).homed()


def prior_covariance(plan: ProbePlan) -> np.ndarray:
    """Return the covariance [10, 10] of the unknowns before anything was measured.

    On a CoreXY two opposite scales are a skew and a turn, which no distance shows: there the scales count as alike, and
    the skew, which is likelier, has all of it.
    """
    covariance = np.diag(_prior_sd() ** 2)
    if plan.kinematics == "corexy":
        scales = (0, len(NAMES))
        covariance[scales, scales[::-1]] = PRIOR_SD[0] ** 2 - UNLIKE_SD**2 / 2
    return covariance


def slopes(plan: ProbePlan, pairs: np.ndarray) -> np.ndarray:
    """Return how every distance between outer edges depends on every unknown [K, 10]."""
    return _features(plan, pairs, plan.marks_mm)


def _prior_sd() -> np.ndarray:
    return np.array([*PRIOR_SD, *PRIOR_SD, SKEW_SD, WIDTH_SD_MM])


def _error_columns(plan: ProbePlan, harmonics: Sequence[int] = (1,)) -> np.ndarray:
    """Return the derivative of each mark's bed position by each unknown but the dots' width [M, 2, P − 1]."""
    motors, (side, _) = plan.to_motor(plan.marks_mm), plan.motor_approaches
    columns = []
    for motor in range(2):
        m, phase = motors[:, motor], 2 * np.pi * motors[:, motor] / plan.mm_per_turn[motor]
        waves = [wave(k * phase) for k in harmonics for wave in (np.sin, np.cos)]
        for column in (m, -side[:, motor] / 2, *waves):
            belts = np.zeros((len(plan), 2))
            belts[:, motor] = column
            columns.append(plan.from_motor(belts))
    columns.append(np.stack([plan.marks_mm[:, 1], np.zeros(len(plan))], axis=1))
    return np.stack(columns, axis=2)


def _errors_mm(plan: ProbePlan, values: np.ndarray) -> np.ndarray:
    """Return how far each mark lies off [M, 2] where the unknowns have these values."""
    return _error_columns(plan) @ values[:-1]


def _features(plan: ProbePlan, pairs: np.ndarray, places_mm: np.ndarray, harmonics: Sequence[int] = (1,)) -> np.ndarray:
    """Return the derivative of every distance by every unknown [K, P]."""
    along = places_mm[pairs[:, 1]] - places_mm[pairs[:, 0]]
    unit = along / np.hypot(*along.T)[:, None]
    columns = _error_columns(plan, harmonics)
    difference = columns[pairs[:, 1]] - columns[pairs[:, 0]]
    return np.hstack([np.einsum("kd,kdi->ki", unit, difference), np.ones((len(pairs), 1))])
