"""The section of a saved model for Z.

A learned screw is kept as its series of few numbers (physics.md eq. 15), another one as tables on the printer's
micro-steps.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from printmend.machine import ScrewDrive, Transmission, healthy_mechanism, z_grid_mm
from printmend.messages import say
from printmend.model.values import number, numbers, refuse, rising, rounded
from printmend.printer import Printer
from printmend.units import TURN_RAD

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
    lower_mm, upper_mm = rising(grid + lower, grid + columns.get("upper_error_mm", lower), subject)
    push_mm = np.stack([columns["push_x_mm"], columns["push_y_mm"]], axis=1)
    return ScrewDrive(Transmission(first_mm, pitch_mm, lower_mm, upper_mm), push_mm)


def parse_series(section: dict[str, Any], subject: str) -> ScrewSeries:
    """Return the series of a section of that kind."""
    names = ["height_mm", "push_x_mm", "push_y_mm"]
    waves = [numbers(section, name, subject, 2 * HARMONICS) for name in names]
    lead_mm, backlash_mm = number(section, "lead_mm", subject), number(section, "backlash_mm", subject)
    lead_error = number(section, "lead_error", subject)
    if lead_mm < _LEAST_LEAD_MM or not 0 <= backlash_mm <= _MOST_MM or not -0.9 <= lead_error <= 9.0:
        refuse(subject, say("lead-mm-more-backlash-lead-error", f"{_LEAST_LEAD_MM:g}"), say("others"))
    if any(len(wave) != 2 * HARMONICS or np.abs(wave).max() > _MOST_MM for wave in waves):
        refuse(subject, say("sines-cosines-harmonics-up-mm", HARMONICS, f"{_MOST_MM:g}"), say("something-else"))
    return ScrewSeries(lead_mm, lead_error, backlash_mm, waves[0], np.stack(waves[1:], axis=1))
