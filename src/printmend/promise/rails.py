"""Guides that are wavy, told from the motors: they push one axis along the other, on a CoreXY both motors alike.

A CoreXY's motors work along the bed's diagonals: harmonics of a pulley, and errors that repeat nothing, can follow a
guide's wave where the test print went, and put waves of their own into a part. A bent frame can follow a long one. So
where a wave was surely found, all waves are looked for again beside what no guide does, taken out of the measurement,
and the motors are learned from the rest. Then the model's frame has them.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from printmend.identify.drive.design import Design, Rows
from printmend.identify.drive.fit import independent_share, robust_sigma_mm
from printmend.identify.drive.period import GUIDE_PERIODS_MM, sharpened
from printmend.identify.drive.second import columns_of, own_columns
from printmend.learn.greybox.model import GreyboxModel
from printmend.learn.greybox.rows import motor_rows
from printmend.machine.kernels.bed import MOST_WAVES, WAVE_FIELDS
from printmend.path import Trace
from printmend.printer import Printer
from printmend.promise.effects import CARRIED, STAYS, Effect
from printmend.promise.laws import LawRows
from printmend.promise.misfit_columns import Candidate, law_rows, wavy_axes
from printmend.promise.misfit_tests import (
    CLIP_SIGMAS,
    LEAST_COST_MM,
    LEAST_ROWS,
    MOST_ROWS,
    SURE_NATS,
    Cause,
    effect_of,
)
from printmend.units import TURN_RAD

# Steps between two halves of the bed: their border is at one of 33 places, the span from −1 to 1, along either axis.
BORDERS = tuple(
    Candidate("halves", 66, axis, float(place)) for axis in range(2) for place in np.linspace(-0.8, 0.8, 33)
)
ROUNDS = 2  # in which each wave's length is found again beside the others
LEAST_OWN_SHARE = 0.3  # share of a wave that a motor's other parts must leave


@dataclass(frozen=True, eq=False)
class Seen:
    """One motor's rows [M] as a rail's wave would show in them: what it may explain, ``left_mm`` [M], freed of the
    ``basis`` [M, B] of the motor's own parts, and the ``axes`` along which it would show."""

    one: LawRows
    left_mm: np.ndarray
    basis: np.ndarray
    axes: tuple[int, ...]

    def freed(self, columns: np.ndarray) -> np.ndarray:
        return np.asarray(columns - self.basis @ (self.basis.T @ columns))

    def with_wave(self, wave: Candidate) -> "Seen":
        """Return the rows with a wave among the motor's own parts."""
        return self.with_column(wave.columns(self.one)) if wave.place in self.axes else self

    def with_column(self, columns: np.ndarray) -> "Seen":
        """Return the rows with columns [M, Q] among the motor's own parts."""
        more = np.linalg.qr(self.freed(columns))[0]
        left = self.left_mm - more @ (more.T @ self.left_mm)
        return replace(self, left_mm=left, basis=np.column_stack([self.basis, more]))


def rails_of(box: GreyboxModel, trace: Trace, causes: tuple[Cause, ...]) -> tuple[Cause, ...]:
    """Return the waves of the guides, every motor's share of each, where ``causes``, guides among them, have one; else
    nothing."""
    if not can_be_told(box, trace) or not any(cause.candidate.kind == "rail-wave" for cause in causes):
        return ()
    rows = motor_rows(trace, box.printer, box.periods_mm)
    tried = []
    for imitating in (nothing, _periodic, _all_curved):
        seen = [seen_without(box, trace, rows, motor, imitating) for motor in range(2)]
        if waves := _waves(seen):
            left, waves = _sharpened(seen, waves)
            tried += [(left, _fitted(seen, waves)), (_of_halves(seen), ())]
    return min(tried, key=lambda each: each[0])[1] if tried else ()


def can_be_told(box: GreyboxModel, trace: Trace) -> bool:
    """Say whether a trace has rows enough, of dots, for what is not a motor's own to be told from its parts."""
    touches = [drive.choice.fit.touch for drive in box.drives]
    return not trace.wall_rows.any() and all(
        len(touch.at) == len(trace) and (touch.at >= 0).sum() >= LEAST_ROWS for touch in touches
    )


def nothing(design: Design) -> np.ndarray:
    """Mark no parameter [P]."""
    return np.zeros(design.size, bool)


def _periodic(design: Design) -> np.ndarray:
    return design.mask("mean", "warp", "second")


def _all_curved(design: Design) -> np.ndarray:
    """Mark the parameters [P] of a motor's parts that can follow a rail's wave, a bent frame's among them."""
    marked = _periodic(design)
    marked[design.parts["mean_powers"]] = np.arange(design.mean_powers) > 1
    marked[design.parts["cross"]] = [p + q > 1 for p, q in design.cross]
    return marked


def seen_without(
    box: GreyboxModel, trace: Trace, rows: list[Rows], motor: int, imitating: Callable[[Design], np.ndarray]
) -> Seen:
    """Return what a fit leaves of a motor's rows when the parts that may imitate another cause are given back."""
    choice = box.drives[motor].choice
    touch = choice.fit.touch
    used = np.flatnonzero((rows[motor].weight > 0) & (touch.at >= 0))
    used = used[:: max(1, len(used) // MOST_ROWS)]
    given = choice.fit.posterior.active & imitating(choice.design)
    residual = touch.residual_mm[used]
    most = CLIP_SIGMAS * robust_sigma_mm(residual)
    left = (
        np.clip(residual, -most, most)
        + columns_of(choice, rows[motor], used)[:, given] @ choice.fit.posterior.values[given]
    )
    basis = own_columns(choice, rows[motor], used, without=given)
    one = law_rows(rows, motor, trace.commanded_mm, touch.side).at(used)
    axes = wavy_axes(motor, trace, corexy=box.printer.kinematics == "corexy")
    return Seen(one, left - basis @ (basis.T @ left), basis, axes)


def _waves(seen: list[Seen]) -> list[Candidate]:
    """Return the waves of both rails that the rows surely hold, the largest first."""
    found: list[Candidate] = []
    while len(found) < MOST_WAVES:
        left_mm2 = [_left_mm2(seen, GUIDE_PERIODS_MM, axis) for axis in range(2)]
        axis, at = np.unravel_index(np.argmin(left_mm2), np.shape(left_mm2))
        best = _sharper(seen, Candidate("rail-wave", 2 * len(GUIDE_PERIODS_MM), float(GUIDE_PERIODS_MM[at]), int(axis)))
        if _nats(seen, best) <= SURE_NATS:
            break
        found.append(best)
        seen = [each.with_wave(best) for each in seen]
    return found


def _left_mm2(seen: list[Seen], periods_mm: np.ndarray, axis: int) -> np.ndarray:
    """Return the squares [K] mm² that both motors leave beside a wave of each length [K] along an axis."""
    total = np.zeros(len(periods_mm))
    for each in seen:
        total += float(each.left_mm @ each.left_mm)
        if axis not in each.axes:
            continue
        angle = np.outer(each.one.bed_mm[:, axis], TURN_RAD / periods_mm)
        cos, sin = np.cos(angle), np.sin(angle)
        own_cos, own_sin = each.freed(cos), each.freed(sin)
        a, b, c = (np.einsum("ij,ij->j", *two) for two in ((own_cos, own_cos), (own_cos, own_sin), (own_sin, own_sin)))
        d, e = each.left_mm @ own_cos, each.left_mm @ own_sin
        known = np.where(a + c >= LEAST_OWN_SHARE * len(angle), a * c - b * b, np.inf)  # cos² + sin² is 1 in each row
        total -= (c * d * d - 2 * b * d * e + a * e * e) / np.maximum(known, 1e-12)
    return total


def _sharpened(seen: list[Seen], waves: list[Candidate]) -> tuple[float, list[Candidate]]:
    """Return waves with the lengths that fit best beside each other, and what they and all else leave: the logarithm of
    the squares of each row, and a share of them for each parameter (the criterion of Schwarz 1978)."""
    for _ in range(ROUNDS):
        for at, wave in enumerate(waves):
            beside = seen
            for other in (*waves[:at], *waves[at + 1 :]):
                beside = [each.with_wave(other) for each in beside]
            waves = [*waves[:at], _sharper(beside, wave), *waves[at + 1 :]]
    for wave in waves:
        seen = [each.with_wave(wave) for each in seen]
    return sum(_criterion(each) for each in seen), waves


def _of_halves(seen: list[Seen]) -> float:
    """Return the least that one half of the bed being off leaves: a step is many waves, and none of them."""
    return min(sum(_criterion(each.with_column(one.columns(each.one))) for each in seen) for one in BORDERS)


def _criterion(seen: Seen) -> float:
    rows, parameters = seen.basis.shape
    return rows * np.log(max(float(seen.left_mm @ seen.left_mm), 1e-18) / rows) + parameters * np.log(rows)


def _sharper(seen: list[Seen], wave: Candidate) -> Candidate:
    spacing, axis = (GUIDE_PERIODS_MM[1] / GUIDE_PERIODS_MM[0] - 1) / wave.detail, int(wave.place)
    length = sharpened(wave.detail, spacing, lambda period: float(_left_mm2(seen, np.array([period]), axis)[0]))
    return replace(wave, detail=float(length))


def _nats(seen: list[Seen], wave: Candidate) -> float:
    """Return the log likelihood that a wave gains on both motors, beyond the logarithm of how many were tried."""
    gained = -np.log(wave.tried) - 4.0
    for each in seen:
        after = each.with_wave(wave).left_mm
        before2, after2 = (max(float(left @ left), 1e-18) for left in (each.left_mm, after))
        spare = max(len(after) - each.basis.shape[1], 1)
        gained += independent_share(after, robust_sigma_mm(after)) * spare / 2 * np.log(before2 / after2)
    return float(gained)


def _fitted(seen: list[Seen], waves: list[Candidate]) -> tuple[Cause, ...]:
    """Return the waves as causes, fitted together."""
    found = []
    for motor, each in enumerate(seen):
        if not (mine := [wave for wave in waves if wave.place in each.axes]):
            continue
        columns = np.hstack([wave.columns(each.one) for wave in mine])
        weights = np.linalg.lstsq(each.freed(columns), each.left_mm, rcond=None)[0].reshape(len(mine), 2)
        for at, wave in enumerate(mine):
            size_mm = float(np.std(wave.columns(each.one) @ weights[at]))
            found.append(Cause(motor, wave, weights[at], size_mm, SURE_NATS))
    return tuple(cause for cause in found if cause.size_mm > LEAST_COST_MM / 4)


def without_rails(box: GreyboxModel, trace: Trace, rails: tuple[Cause, ...]) -> Trace:
    """Return the trace without what waves of the rails do."""
    rows = motor_rows(trace, box.printer, box.periods_mm)
    off = np.zeros(trace.measured_mm.shape)
    for rail in rails:
        side = box.drives[rail.motor].choice.fit.touch.side
        one = law_rows(rows, rail.motor, trace.commanded_mm, side)
        off[:, rail.motor] += rail.candidate.columns(one) @ rail.weights
    return freed(trace, np.asarray(box.printer.from_motor(off)))


def freed(trace: Trace, off_mm: np.ndarray) -> Trace:
    """Return a trace whose places were pushed by ``off_mm`` [N, 2] as if they had not been."""
    measured_mm = trace.measured_mm - off_mm
    if trace.normal is None or trace.offset_mm is None:
        return replace(trace, measured_mm=measured_mm)
    return replace(trace, measured_mm=measured_mm, offset_mm=trace.offset_mm - (trace.normal * off_mm).sum(axis=1))


def is_printers(trace: Trace) -> bool:
    """Say whether waves in a trace are the printer's: an uneven scanner makes such waves, too."""
    return not trace.instrument_doubt.wave_mm


def waves_of(printer: Printer, rails: tuple[Cause, ...]) -> np.ndarray:
    """Return waves, either motor's share of each, as those of a `Frame` [K, 6]."""
    each: dict[tuple[float, float], np.ndarray] = {}
    for rail in rails:
        both = each.setdefault((rail.candidate.place, rail.candidate.detail), np.zeros((2, 2)))
        both[:, rail.motor] = rail.weights
    rows = [[*which, *np.asarray(printer.from_motor(both)).T.ravel()] for which, both in each.items()]
    return np.array(rows).reshape(-1, WAVE_FIELDS)


def rail_effects(box: GreyboxModel, trace: Trace, rails: tuple[Cause, ...]) -> tuple[Effect, ...]:
    """Return what the rails may do to new prints: the printer's are in the model, to a share of them; what may be the
    instrument's is not."""
    rows = motor_rows(trace, box.printer, box.periods_mm)
    state = CARRIED if is_printers(trace) else STAYS
    return tuple(effect_of(rail, rows, trace, state, np.zeros(3)) for rail in rails)
