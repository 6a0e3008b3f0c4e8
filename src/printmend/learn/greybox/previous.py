"""A saved grey box as the prior of the next one: its parameters, how sure they were, how far machines drift.

A machine ages: its belts stretch, its pulleys slip on their shafts, its frame shifts, but worn shapes change slowly. So
the variance of each parameter grows between two prints, that of the play and of the pulley's phase most; and it grows
with the time between them (`aged`).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from printmend.errors import ModelError
from printmend.identify.drive import Design, bed_middle
from printmend.identify.drive.select import CROSS, HARMONICS
from printmend.learn.greybox.model import bed_grid_mm
from printmend.learn.greybox.rows import ripple_harmonics
from printmend.saved.branches import SCALE_MM, Branches
from printmend.saved.model import SavedModel, branches_of
from printmend.saved.values import number

# Standard deviations by which a machine's parameters drift between two prints, where `Drift` says 1. They are guesses
# of ours, on the large side: where the new print says more, it decides.
START_MM, OFFSET_MM = 2.0, 5.0  # the belt at the start, the print's place: where a plate lay on a scanner says nothing
SCALE_PERCENT, BEND_MM = 0.2, 0.02  # the belt's length (also another scanner's scale), and a bend along the axis
PLAY_MM, PLAY_SLOPE_MM = 0.3, 0.03  # the play, and its change along the axis [mm over 100 mm]
CROSS_MM = 0.1  # each term of the frame, 100 mm from the bed's middle
RIPPLE_MM = 1e-3  # each wave of the micro-step ripple
SHAPE_MM = 0.02  # the pulley's first harmonic; harmonic k drifts by this times k^−2.5
PHASE_RAD = 0.05  # the pulley's angle on its shaft
WALK_A_YEAR = 0.1  # share of these that each parameter walks at random in a year


@dataclass(frozen=True)
class Drift:
    """How much a machine changed, as shares of what is usual: play, scale with skew and phase, the pulley's shape, and
    where the measurement lies."""

    play: float
    scale: float
    shape: float
    place: float = 1.0


@dataclass(frozen=True, eq=False)
class Remembered:
    """One motor as it was: ``branches``, its parameters ``values`` [P] and ``sds`` [P] for the columns of ``design``.

    The design has room for what may be new: scale, play, harmonics, skew. ``known`` [P] marks what the old model had,
    ``seen`` is the share of the motor's turn that it was learned from.
    """

    branches: Branches
    design: Design
    values: np.ndarray
    sds: np.ndarray
    known: np.ndarray
    seen: float = 0.0

    def turned(self, phase_rad: float) -> np.ndarray:
        """Return the parameters [P] with the pulley turned on its shaft: cos k(φ + δ) for cos kφ."""
        values = self.values.copy()
        for wave in ("mean", "play", "elastic"):
            cos_at, sin_at = (self.design.parts[f"{wave}_{part}"] for part in ("cos", "sin"))
            k = self.design.waves(wave)
            c, s = np.cos(k * phase_rad), np.sin(k * phase_rad)
            cos_mm, sin_mm = self.values[cos_at], self.values[sin_at]
            values[cos_at], values[sin_at] = cos_mm * c + sin_mm * s, sin_mm * c - cos_mm * s
        return values

    def covariance(self, phase_rad: float, drift: "Drift") -> np.ndarray:
        """Return the prior's covariance [P, P] mm²: what was unsure, and what may have changed since."""
        moved = drift_mm(self.design)
        moved[self.design.place_at] *= drift.place
        moved[self.design.parts["play_powers"]] *= drift.play
        moved[self.design.parts["cross"]] *= drift.scale
        moved[self.design.parts["mean_powers"]][1:] *= drift.scale
        moved[self.design.harmonic > 0] *= drift.shape
        # All harmonics turn together with the pulley.
        slope = (self.turned(phase_rad + 1e-4) - self.turned(phase_rad - 1e-4)) / 2e-4
        return np.diag(self.sds**2 + moved**2) + (drift.scale * PHASE_RAD) ** 2 * np.outer(slope, slope)


def aged(past: Remembered, years: float, grown: Mapping[str, tuple[float, float]]) -> Remembered:
    """Return a motor as it may be by now: every parameter has walked at random, and faults have ``grown``.

    A random walk's variance grows with the time. ``grown`` says by how much (± standard deviation) the measurements so
    far let a fault's size be larger by now: of play [mm] and scale [%].
    """
    values, design = past.values.copy(), past.design
    variance = past.sds**2 + (WALK_A_YEAR * drift_mm(design)) ** 2 * years
    places = {"play": design.play_at, "scale": design.scale_at}
    for kind, (more, sd) in grown.items():
        at = places[kind]
        if past.known[at]:
            values[at] += more * (np.sign(values[at]) or 1.0)
            variance[at] += sd**2
    return replace(past, values=values, sds=np.sqrt(variance))


def drift_mm(design: Design) -> np.ndarray:
    """Return by how much each parameter [P] may drift between two prints, one standard deviation."""
    drift = np.zeros(design.size)
    drift[design.parts["start"]] = START_MM
    drift[design.parts["mean_powers"]] = (OFFSET_MM, SCALE_PERCENT, BEND_MM, BEND_MM)[: design.mean_powers]
    drift[design.parts["play_powers"]] = (PLAY_MM, PLAY_SLOPE_MM, PLAY_SLOPE_MM)[: design.play_powers]
    drift[design.parts["cross"]] = CROSS_MM
    wave = design.harmonic > 0
    drift[wave] = SHAPE_MM * design.harmonic[wave] ** -2.5
    drift[design.mask("ripple")] = RIPPLE_MM
    return drift


def _is_uneven(model: SavedModel, motor: int) -> bool:
    """Say whether a motor has errors that repeat nothing: of its belt by turns, or kept as tables."""
    branches = branches_of(model, motor)
    return model.learner == "hybrid" if branches is None else bool(branches.warp_mm.any())


def remember(model: SavedModel, motor: int) -> Remembered:
    """Read one motor of a saved grey box. Raise `ModelError` where the model is of another kind."""
    name = model.printer.motors[motor]
    branches = branches_of(model, motor)
    section = model.document.get("uncertainty", {}).get(name, {})
    uneven = [name.upper() for each, name in enumerate(model.printer.motors) if _is_uneven(model, each)]
    if uneven:
        raise ModelError(
            "--update",
            wanted="a machine whose faults repeat with the motor's turn",
            came=f"an uneven belt or guide on {' and '.join(uneven)}, which a small print cannot update",
            todo="learn anew from a whole probe, without --update",
        )
    if model.learner != "greybox" or branches is None or not isinstance(section.get("sd_mm"), dict):
        raise ModelError(
            "--update",
            wanted="a model that `learn` made with auto or greybox",
            came=f"one made by {model.learner}",
            todo="print a whole probe again and learn from it, without --update",
        )
    old = _design(branches, section["sd_mm"], model, motor)
    design = Design(
        mean_powers=max(old.mean_powers, 2),
        play_powers=max(old.play_powers, 1),
        cross=old.cross or CROSS[:1],
        ripple=old.ripple,
        mean_harmonics=tuple(range(1, HARMONICS + 1)),
        play_harmonics=old.play_harmonics,
        elastic_harmonics=old.elastic_harmonics,
        second_harmonics=old.second_harmonics,
        second_mm=old.second_mm,
        warp_span_mm=old.warp_span_mm,
    )
    values, sds = _values(branches, old, model, motor), _saved_sds(section["sd_mm"], old)
    known = design.moved(np.ones(old.size), old) > 0
    seen = number(section, "angles_seen", f"the model [uncertainty {name}]", 1.0) if "angles_seen" in section else 0.0
    return Remembered(branches, design, design.moved(values, old), design.moved(sds, old), known, seen)


def _design(branches: Branches, sds: dict[str, Any], model: SavedModel, motor: int) -> Design:
    harmonics = tuple(int(k) for k in branches.mean.harmonics)
    ripple = tuple(k for k in harmonics if k > HARMONICS)
    allowed = {k for motor in range(2) for k in ripple_harmonics(model.printer, motor)}
    cross = len(sds.get("cross", ()))
    return Design(
        mean_powers=len(branches.mean.powers_mm),
        play_powers=len(branches.play.powers_mm),
        cross=CROSS[: cross if cross <= len(CROSS) else 0],
        ripple=tuple(k for k in ripple if k in allowed),
        mean_harmonics=tuple(k for k in harmonics if k <= HARMONICS),
        play_harmonics=tuple(int(k) for k in branches.play.harmonics if k <= HARMONICS),
        elastic_harmonics=tuple(int(k) for k in branches.elastic.harmonics if k <= HARMONICS),
        second_harmonics=tuple(int(k) for k in branches.second.harmonics if k <= HARMONICS),
        second_mm=branches.second_mm,
        warp_span_mm=model.printer.motor_range_mm(motor),
    )


def _values(branches: Branches, design: Design, model: SavedModel, motor: int) -> np.ndarray:
    values = np.zeros(design.size)
    values[design.parts["mean_powers"]] = branches.mean.powers_mm
    values[design.parts["play_powers"]] = branches.play.powers_mm
    values[design.parts["cross"]] = _cross_mm(design, model, motor)
    waves = {
        "mean": branches.mean, "ripple": branches.mean, "play": branches.play, "elastic": branches.elastic,
        "second": branches.second,
    }  # fmt: skip
    for name, wave in waves.items():
        at = np.isin(wave.harmonics, design.waves(name))
        values[design.parts[f"{name}_cos"]] = wave.cos_mm[at]
        values[design.parts[f"{name}_sin"]] = wave.sin_mm[at]
    return values


def _saved_sds(sds: dict[str, Any], design: Design) -> np.ndarray:
    """Return the saved standard deviations [P]; a part whose length is another counts as unknown before the drift."""
    listed = np.zeros(design.size)
    for name, part in design.parts.items():
        numbers = np.asarray(sds.get(name, ()), float)
        if numbers.shape == (part.stop - part.start,) and np.isfinite(numbers).all():
            listed[part] = numbers
    return listed


def _cross_mm(design: Design, model: SavedModel, motor: int) -> np.ndarray:
    """Return a frame's terms in the coordinates of one motor [C]: the inverse of what learning a frame does."""
    frame, printer = model.mechanism.frame, model.printer
    if not design.cross:
        return np.zeros(0)
    bed = bed_grid_mm(printer)
    at = (printer.to_motor(bed) - bed_middle(printer)) / SCALE_MM
    moved = printer.to_motor(frame.apply(bed) - bed - frame.waves_at_mm(bed))[:, motor]
    columns = np.stack([at[:, motor] ** p * at[:, 1 - motor] ** q for p, q in design.cross], axis=1)
    return np.linalg.lstsq(columns, moved, rcond=None)[0]
