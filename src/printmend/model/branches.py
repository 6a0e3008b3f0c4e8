"""The sections of a saved model for its motors and for Z: short sets of numbers, and the tables they lower to.

With the motor at m, x = (m − middle)/100 mm and φ = 2πm/turn, the branches of the generalised play are

    lower(m) = m + mean(m) − play(m)/2          upper(m) = m + mean(m) + play(m)/2

    mean(m) = Σ_p c_p xᵖ + Σ_k a_k cos kφ + b_k sin kφ + x Σ_k (e_k cos kφ + f_k sin kφ)
    play(m) = Σ_p d_p xᵖ + Σ_k g_k cos kφ + h_k sin kφ,   never below zero

The harmonics of ``mean`` are the pulley (physics.md eq. 2), those of ``play`` the two spans of a loose belt (eq. 7) or
slack on the shaft (eq. 10), the powers in ``play`` lost motion by friction (eq. 9), and the third sum of ``mean`` a
taut elastic belt, whose odd harmonics fade with the distance (eq. 8). An error without a period (a belt of uneven
pitch) is a sum of cosines over the measured span, added to the mean. An error with another period than the turn (an
idler off its centre) is a Fourier series of that period.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NoReturn

import numpy as np
from numpy.polynomial.chebyshev import chebval

from printmend.errors import ModelError
from printmend.machine import ScrewDrive, Transmission, healthy_mechanism, healthy_transmission, z_grid_mm
from printmend.messages import say
from printmend.path import frozen
from printmend.printer import Printer
from printmend.units import TURN_RAD

# Checked values of a saved model; a bad one raises `ModelError`.

LARGEST = 1e5  # no number of a model is larger, in whatever unit: 100 m
TODO = say("learn-again-printmend-learn-trace-csv")
_ROUNDED_MM = 3e-9  # by which rounding may change the difference of two entries of a table
_LEAST_LEAD_ERROR, _MOST_LEAD_ERROR = -0.9, 9.0  # of a screw: a tenth to ten times its lead


def rising_pair(lower_mm: np.ndarray, upper_mm: np.ndarray, subject: str) -> tuple[np.ndarray, np.ndarray]:
    """Return two tables that never fall, lower ≤ upper; refuse others.

    They were rounded to 1e-9 mm, so a flat stretch may go back by that much.
    """
    if min(np.diff(lower_mm).min(), np.diff(upper_mm).min(), (upper_mm - lower_mm).min()) < -_ROUNDED_MM:
        refuse(subject, say("tables-never-fall-lower-upper"), say("others"))
    lower = np.maximum.accumulate(lower_mm)
    return lower, np.maximum(np.maximum.accumulate(upper_mm), lower)


def rounded(value: Any) -> Any:
    """Round to 1e-9 mm: a thousand times finer than anything a machine does."""
    return np.round(value, 9).tolist() if isinstance(value, np.ndarray) else round(float(value), 9)


def section_of(document: Mapping[str, Any], key: str, kind: type, subject: str) -> Any:
    """Return a value of a kind; refuse another."""
    if not isinstance(value := document.get(key), kind):
        refuse(subject, say("as-2", key, kind.__name__), say("none") if value is None else repr(value)[:40])
    return value


def number(section: Mapping[str, Any], key: str, subject: str, most: float = LARGEST) -> float:
    """Return a number up to ``most``."""
    value = section.get(key)
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not is_number or not abs(value) <= most:  # type: ignore[arg-type]
        refuse(subject, say("number", key), say("none") if value is None else repr(value)[:40])
    return float(value)  # type: ignore[arg-type]


def numbers(section: Mapping[str, Any], key: str, subject: str, most: int) -> np.ndarray:
    """Return a list of at most ``most`` numbers up to `LARGEST`."""
    values = section.get(key)
    if not isinstance(values, list) or len(values) > most:
        refuse(subject, say("list-numbers-most", most, key), say("none" if values is None else "something-else"))
    if not set(map(type, values)) <= {int, float}:
        refuse(subject, say("numbers", key), say("something-else"))
    if values and not -LARGEST <= min(values) <= max(values) <= LARGEST:  # JSON's integers may be beyond any float
        refuse(subject, say("numbers-up", f"{LARGEST:g}", key), say("others"))
    return np.array(values, float)


def refuse(subject: str, wanted: str, came: str) -> NoReturn:
    """Raise `ModelError` for a value that printmend never writes."""
    raise ModelError(subject, wanted=wanted, came=came, todo=TODO)


SCALE_MM = 100.0  # distance from the middle at which x, in which the powers are taken, is 1


def warp_angle(span_mm: tuple[float, float], motor_mm: np.ndarray) -> np.ndarray:
    """Return π t [N], t the place within ``span_mm``; beyond it the ends hold."""
    return np.asarray(np.pi * np.clip((motor_mm - span_mm[0]) / (span_mm[1] - span_mm[0]), 0.0, 1.0))


@dataclass(frozen=True, eq=False)
class Wave:
    """A polynomial and a Fourier series: ``powers_mm`` [P], ``harmonics`` [H] and their ``cos_mm``, ``sin_mm`` [H]."""

    powers_mm: np.ndarray = field(default_factory=lambda: np.zeros(0))
    harmonics: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
    cos_mm: np.ndarray = field(default_factory=lambda: np.zeros(0))
    sin_mm: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        for name in ("powers_mm", "cos_mm", "sin_mm"):
            object.__setattr__(self, name, frozen(np.asarray(getattr(self, name), float)))
        object.__setattr__(self, "harmonics", frozen(np.asarray(self.harmonics, np.int64)))

    @property
    def is_zero(self) -> bool:
        return not (self.powers_mm.any() or self.cos_mm.any() or self.sin_mm.any())

    def polynomial_mm(self, x: np.ndarray) -> np.ndarray:
        """Return Σ c_p xᵖ [N]."""
        total = np.zeros(np.shape(x))
        for value in self.powers_mm[::-1]:
            total = total * x + value
        return total

    def series_mm(self, phase_rad: np.ndarray) -> np.ndarray:
        """Return the Fourier sum [N] at phases of the motor's turn."""
        total = np.zeros(np.shape(phase_rad))
        for k, cos_mm, sin_mm in zip(self.harmonics, self.cos_mm, self.sin_mm, strict=True):
            if cos_mm or sin_mm:
                total += cos_mm * np.cos(k * phase_rad) + sin_mm * np.sin(k * phase_rad)
        return total


@dataclass(frozen=True, eq=False)
class Branches:
    """The fault of one motor's drive. ``reach_mm`` are the measured motor positions. Beyond them, powers above the
    first continue as straight lines, so that they do not explode."""

    period_mm: float
    middle_mm: float
    reach_mm: tuple[float, float]
    mean: Wave = field(default_factory=Wave)
    play: Wave = field(default_factory=Wave)
    elastic: Wave = field(default_factory=Wave)
    warp_mm: np.ndarray = field(default_factory=lambda: np.zeros(0))
    warp_span_mm: tuple[float, float] = (0.0, 1.0)
    second: Wave = field(default_factory=Wave)
    second_mm: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "warp_mm", frozen(np.asarray(self.warp_mm, float)))

    @property
    def is_healthy(self) -> bool:
        waves = (self.mean, self.play, self.elastic, self.second)
        return all(wave.is_zero for wave in waves) and not self.warp_mm.any()

    def shifted(self, by_mm: float) -> "Branches":
        """Move the carriage's origin: add ``by_mm`` to all places, as `Transmission.shifted` does."""
        powers = self.mean.powers_mm if len(self.mean.powers_mm) else np.zeros(1)
        powers = np.concatenate([powers[:1] + by_mm, powers[1:]])
        return replace(self, mean=replace(self.mean, powers_mm=powers))

    def errors_mm(self, motor_mm: np.ndarray, *, turn: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """Return (mean, play) [mm] at motor positions [N]: what the drive adds to a healthy motor, and its play ≥ 0.

        Where the positions are evenly spaced with a whole number of ``turn`` entries a turn, one turn is evaluated.
        """
        x = (motor_mm - self.middle_mm) / SCALE_MM
        count = round(turn) if abs(turn - round(turn)) < 1e-9 and 0 < turn < len(motor_mm) else len(motor_mm)
        phase = np.mod(motor_mm[:count], self.period_mm) * (TURN_RAD / self.period_mm)

        def series(wave: Wave) -> np.ndarray:
            return np.resize(wave.series_mm(phase), len(motor_mm))

        mean = self._powers_mm(self.mean, motor_mm) + series(self.mean)
        if self.warp_mm.any():
            # An error without a period is known only where it was measured.
            angle = warp_angle(self.warp_span_mm, np.clip(motor_mm, *self.reach_mm))
            mean = mean + chebval(np.cos(angle), [0.0, *self.warp_mm])  # T_k(cos θ) = cos kθ
        if not self.elastic.is_zero:
            mean = mean + x * series(self.elastic)
        if not self.second.is_zero:
            mean = mean + self.second.series_mm(np.mod(motor_mm, self.second_mm) * (TURN_RAD / self.second_mm))
        play = self._powers_mm(self.play, motor_mm) + series(self.play)
        return mean, np.maximum(play, 0.0)

    def _powers_mm(self, wave: Wave, motor_mm: np.ndarray) -> np.ndarray:
        x = (motor_mm - self.middle_mm) / SCALE_MM
        if len(wave.powers_mm) < 3:
            return wave.polynomial_mm(x)
        low, high = ((end - self.middle_mm) / SCALE_MM for end in self.reach_mm)
        inside = np.clip(x, low, high)
        slope = Wave(wave.powers_mm[1:] * np.arange(1, len(wave.powers_mm)))
        return wave.polynomial_mm(inside) + (x - inside) * slope.polynomial_mm(inside)

    def lower(self, printer: Printer, motor: int) -> Transmission:
        """Return the tables of this drive on the grid of a healthy transmission; both are made non-decreasing."""
        healthy = healthy_transmission(printer, motor)
        if self.is_healthy:
            return healthy
        grid = healthy.motor_mm
        mean, play = self.errors_mm(grid, turn=self.period_mm / healthy.pitch_mm)
        first = int(np.searchsorted(grid, (self.reach_mm[0] + self.reach_mm[1]) / 2))
        lower = rising(grid + mean - play / 2, first)
        if not play.any():
            return replace(healthy, lower_mm=lower, upper_mm=lower)
        return replace(healthy, lower_mm=lower, upper_mm=np.maximum(rising(grid + mean + play / 2, first), lower))


def rising(table_mm: np.ndarray, first: int) -> np.ndarray:
    """Return a table [N] made non-decreasing from entry ``first`` outwards, so that a faulty end does not spread."""
    first = min(max(first, 0), len(table_mm))
    below = np.minimum.accumulate(table_mm[:first][::-1])[::-1]
    above = np.maximum.accumulate(table_mm[first:])
    return np.concatenate([np.minimum(below, above[0]) if len(above) else below, above])


# The section of a saved model for Z.
#
# A learned screw is kept as its series of few numbers (physics.md eq. 15), another one as tables on the printer's
# micro-steps.

HARMONICS = 2  # waves of a screw's turn that are kept, of the height and of the push


@dataclass(frozen=True, eq=False)
class ScrewSeries:
    """A screw in few numbers: ``height_mm`` [2·HARMONICS] = (a_1, b_1, a_2, …), and ``push_mm`` [2·HARMONICS, 2] =
    (p_1, q_1, …) for x and y."""

    lead_mm: float
    lead_error: float
    backlash_mm: float
    height_mm: np.ndarray
    push_mm: np.ndarray

    @classmethod
    def healthy(cls, lead_mm: float) -> "ScrewSeries":
        return cls(lead_mm, 0.0, 0.0, np.zeros(2 * HARMONICS), np.zeros((2 * HARMONICS, 2)))

    def tables(self, printer: Printer) -> ScrewDrive:
        """Return it as tables on the micro-steps of Z, without an origin."""
        motor_mm, first_mm, pitch_mm = z_grid_mm(printer)
        waves = waves_of(motor_mm, self.lead_mm, HARMONICS)
        error_mm = self.lead_error * motor_mm + waves @ self.height_mm
        centre = np.maximum.accumulate(motor_mm + error_mm)
        half_mm = self.backlash_mm / 2
        return ScrewDrive(Transmission(first_mm, pitch_mm, centre - half_mm, centre + half_mm), waves @ self.push_mm)

    def lower(self, printer: Printer) -> ScrewDrive:
        """Return it as tables, its origin where the end stop of Z puts it."""
        homed = replace(healthy_mechanism(printer), screw=self.tables(printer)).homed().screw
        assert homed is not None
        return homed


def waves_of(place_mm: np.ndarray, period_mm: float, harmonics: int) -> np.ndarray:
    """Return the columns [N, 2·harmonics] sin θ, cos θ, sin 2θ, … of the turns at places [N]."""
    angle = np.asarray(place_mm, float)[:, None] * (TURN_RAD / period_mm) * np.arange(1, harmonics + 1)
    return np.stack([np.sin(angle), np.cos(angle)], axis=2).reshape(len(angle), -1)


_MOST_MM = 100.0  # no height or push is off by more: larger tables would fill the memory
_LEAST_LEAD_MM = 0.1  # rise of a turn: no screw of a printer is finer


def screw_section(screw: ScrewDrive | ScrewSeries) -> dict[str, Any]:
    """Return Z as plain values."""
    if isinstance(screw, ScrewSeries):
        return {
            "kind": "series",
            "lead_mm": screw.lead_mm,
            "lead_error": rounded(screw.lead_error),
            "backlash_mm": rounded(screw.backlash_mm),
            "height_mm": rounded(screw.height_mm),
            "push_x_mm": rounded(screw.push_mm[:, 0]),
            "push_y_mm": rounded(screw.push_mm[:, 1]),
        }
    table, grid = screw.transmission, screw.transmission.motor_mm
    section = {"kind": "table", "lower_error_mm": rounded(table.lower_mm - grid)}
    if not table.is_taut:
        section["upper_error_mm"] = rounded(table.upper_mm - grid)
    return section | {f"push_{name}_mm": rounded(screw.wobble_mm[:, axis]) for axis, name in enumerate("xy")}


def parse_screw(section: Any, printer: Printer, subject: str) -> ScrewDrive:
    """Build Z from its section. Raise `ModelError` for a bad section."""
    if not isinstance(section, dict):
        refuse(subject, say("section-3"), repr(section)[:40])
    if section.get("kind") == "series":
        return parse_series(section, subject).lower(printer)
    if section.get("kind") != "table":
        refuse(subject, say("kind-series-table"), repr(section.get("kind"))[:40])
    grid, first_mm, pitch_mm = z_grid_mm(printer)
    names = ["lower_error_mm", "push_x_mm", "push_y_mm", *(["upper_error_mm"] if "upper_error_mm" in section else [])]
    columns = {name: numbers(section, name, subject, len(grid)) for name in names}
    if any(len(column) != len(grid) or np.abs(column).max() > _MOST_MM for column in columns.values()):
        refuse(subject, say("tables-errors-up-mm", len(grid), f"{_MOST_MM:g}"), say("others"))
    lower = columns["lower_error_mm"]
    lower_mm, upper_mm = rising_pair(grid + lower, grid + columns.get("upper_error_mm", lower), subject)
    push_mm = np.stack([columns["push_x_mm"], columns["push_y_mm"]], axis=1)
    return ScrewDrive(Transmission(first_mm, pitch_mm, lower_mm, upper_mm), push_mm)


def parse_series(section: dict[str, Any], subject: str) -> ScrewSeries:
    """Return the series of a section of that kind."""
    names = ["height_mm", "push_x_mm", "push_y_mm"]
    waves = [numbers(section, name, subject, 2 * HARMONICS) for name in names]
    lead_mm, backlash_mm = number(section, "lead_mm", subject), number(section, "backlash_mm", subject)
    lead_error = number(section, "lead_error", subject)
    is_lead = lead_mm >= _LEAST_LEAD_MM and _LEAST_LEAD_ERROR <= lead_error <= _MOST_LEAD_ERROR
    if not is_lead or not 0 <= backlash_mm <= _MOST_MM:
        refuse(subject, say("lead-mm-more-backlash-lead-error", f"{_LEAST_LEAD_MM:g}"), say("others"))
    if any(len(wave) != 2 * HARMONICS or np.abs(wave).max() > _MOST_MM for wave in waves):
        refuse(subject, say("sines-cosines-harmonics-up-mm", HARMONICS, f"{_MOST_MM:g}"), say("something-else"))
    return ScrewSeries(lead_mm, lead_error, backlash_mm, waves[0], np.stack(waves[1:], axis=1))
