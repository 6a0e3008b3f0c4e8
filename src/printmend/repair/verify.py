"""Measure again after mending: was the promise kept? And bring the model up to date with what was measured.

The check print is any probe's G-code, mended with the model and printed. Its plan says where marks were wanted; what
is measured of them is compared with what was promised for these places, the noise of the measurement taken off.
"""

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from printmend.diagnosis.screw import heights_mm
from printmend.errors import ModelError, TraceError
from printmend.learn.walls import with_walls
from printmend.machine import print_from_home
from printmend.measure.once import digest_of
from printmend.measure.whose import check_origin
from printmend.path import Trace, last_way
from printmend.printer import Printer
from printmend.promise.budget import Budget, parse_budget
from printmend.promise.predict import Errors, Outlook, PathPlaces, Promise, promised
from printmend.repair.history import remember
from printmend.repair.learned import PLANE_FACTOR, known_digests
from printmend.repair.update import Updated, update
from printmend.saved import SavedModel

LEAST_MARKS = 10  # measured marks of a check print; fewer tell nothing
_LEAST_SIGMA_MM = 0.002  # smallest standard deviation of a mark: no scan is read better
_LEAST_STRETCH_PERCENT = 0.01  # a smaller stretch by the instrument is not worth a word
_NOISE_SD_SHARE = 0.15  # standard deviation of the stated noise of a measurement, as a share of it
_UNMENDED_SHARE = 0.9  # a print with more than this share of the error before mending was hardly mended …
_SAME_FAULT_SHARE = 0.5  # … if, of its error, less than this share is unlike the unmended print of the model
_SURE_SIGMAS = 2.0  # standard deviations by which a measured error may exceed its promise and keep it


@dataclass(frozen=True)
class Verdict:
    """Distances of the marks from where they were wanted, root mean square [mm]: unmended as the model says
    (``before_mm``), as measured now with its standard deviation, and as was promised with its 90 % range;
    ``unlike_mm`` is how far they lie from where the model has them unmended. ``placed``: they contain where on the bed
    the print lies; else a shift of the whole is taken off, and ``stretch_percent`` of scale that may as well be the
    instrument's own."""

    marks: int
    before_mm: float
    now_mm: float
    now_sd_mm: float
    promised_mm: float
    promised_low_mm: float
    promised_high_mm: float
    unlike_mm: float
    placed: bool
    stretch_percent: float = 0.0

    @property
    def kept(self) -> bool:
        """True where the error is within what was promised, as far as this measurement can tell."""
        return self.now_mm - _SURE_SIGMAS * self.now_sd_mm <= self.promised_high_mm

    @property
    def at_most_mm(self) -> float | None:
        """What the error may be at most where it is not above the noise of the measurement; None where it is."""
        return self.now_mm + _SURE_SIGMAS * self.now_sd_mm if self.now_mm <= self.now_sd_mm else None

    @property
    def words(self) -> str:
        """Say it in one line, the numbers first."""
        now = f"{self.now_mm:.3f}" if self.at_most_mm is None else f"less than {self.at_most_mm:.3f}"
        numbers = (
            f"{self.before_mm:.3f} mm before, {now} now, "
            f"{self.promised_low_mm:.3f}–{self.promised_high_mm:.3f} was promised"
        )
        if abs(self.stretch_percent) >= _LEAST_STRETCH_PERCENT:
            numbers += f" (a scale of {self.stretch_percent:+.2f} % may be the scanner's own and is taken off)"
        if self.kept:
            return f"{numbers}: kept ({self.marks} marks)"
        if self.now_mm > _UNMENDED_SHARE * self.before_mm:
            if self.unlike_mm < _SAME_FAULT_SHARE * self.now_mm:
                return f"{numbers}: broken, and as far off as before mending. Was the mended file printed?"
            return (
                f"{numbers}: broken, and as far off as before mending, but not as this printer was. Is it another "
                "printer's? Else a part was replaced or came loose: learn from a new test print"
            )
        return f"{numbers}: broken. Bring the model up to date with this measurement (-o), and mend again"

    def json(self) -> dict[str, Any]:
        """Return plain values."""
        return {**asdict(self), "now_at_most_mm": self.at_most_mm, "kept": self.kept}


def verify(model: SavedModel, trace: Trace) -> Verdict:
    """Compare a measured check print, whose G-code was mended with ``model``, with what the model promised.

    ``trace`` has the places that were wanted as commanded ones. Raises `TraceError` for fewer than ten marks,
    another printer's and those that the model was learned from, `ModelError` for a model that promises nothing.
    """
    budget = parse_budget(model)
    if budget is None:
        raise ModelError(
            "the model", wanted="one that says what it does not know", came="one of an older printmend or learner",
            todo="learn it again from its trace",
        )  # fmt: skip
    check_origin("the check print", trace.origin, model.printer)
    if digest_of(trace) in known_digests(model):
        raise TraceError(
            "the check print", wanted="a print that was mended", came="the measurement that the model was learned from",
            todo="mend the test print, print it, and measure that one",
        )  # fmt: skip
    trace = with_walls(trace, model.printer)
    known = np.flatnonzero(trace.measured_rows)
    if len(known) < LEAST_MARKS:
        raise TraceError(
            "the check print", wanted=f"at least {LEAST_MARKS} measured marks", came=f"{len(known)}",
            todo="measure more of it",
        )  # fmt: skip
    placed = trace.placed and budget.placed
    # the instrument's stretch is taken off what was measured: neither is it in the promise for these marks
    outlook, off = _outlook_at_marks(model, budget if placed else replace(budget, stretch=()), trace)
    error = (trace.measured_mm - trace.commanded_mm)[known]
    sigmas = np.empty(0) if trace.sigma_mm is None else trace.sigma_mm[known]
    stated = sigmas[np.isfinite(sigmas)]
    sigma = float(np.sqrt(np.mean(stated**2))) if len(stated) else model.noise_mm
    stretch = 0.0
    if not placed:
        error = error - error.mean(axis=0)
        off = off - off.mean(axis=0)
        error, stretch = _unstretched(error, trace, model.printer.kinematics == "corexy", sigma)
    unlike = error - off
    square = np.sum(error**2, axis=1)
    noise2 = PLANE_FACTOR**2 * sigma**2
    now2 = float(square.mean()) - noise2
    now2_sd = float(np.hypot(square.std() / np.sqrt(len(known)), 2 * _NOISE_SD_SHARE * noise2))
    now = float(np.sqrt(max(now2, 0.0)))
    now_sd = float(np.sqrt(max(now2, 0.0) + now2_sd)) - now
    play, play_sd = _error_from_play(error, trace, model.printer)
    # what surely goes with direction is no noise, however much of that is
    if play - _SURE_SIGMAS * play_sd > max(now - _SURE_SIGMAS * now_sd, 0.0):
        now = max(now, play)
        now_sd = (now - play) / _SURE_SIGMAS + play_sd
    after = outlook.after
    before_mm = float(np.sqrt(np.mean(np.sum(off**2, axis=1))))
    return Verdict(
        len(known), before_mm, now, now_sd,
        PLANE_FACTOR * after.rms_mm, PLANE_FACTOR * after.rms_low_mm, PLANE_FACTOR * after.rms_high_mm,
        float(np.sqrt(max(np.mean(np.sum(unlike**2, axis=1)) - noise2, 0.0))), placed, stretch,
    )  # fmt: skip


def _error_from_play(error_mm: np.ndarray, trace: Trace, printer: Printer) -> tuple[float, float]:
    """Return how much of the errors of the measured marks [N, 2] goes with the way that the motors came, root mean
    square, and its standard deviation by the scatter of the marks themselves."""
    sides = _sides(trace, printer)
    sides = sides - sides.mean(axis=0)
    size = np.square(sides).sum(axis=0)
    if len(error_mm) < LEAST_MARKS or (size < 1).any():
        return 0.0, 0.0
    # to and from a motor is linear: the errors of marks are those of the belts
    belts = printer.to_motor(error_mm)
    found = np.sum(sides * belts, axis=0) / size
    sds = np.sqrt(np.square(belts - sides * found).sum(axis=0) / (len(belts) - 2) / size)
    rms, doubt = (
        float(np.sqrt(np.mean(np.sum(printer.from_motor(sides * each) ** 2, axis=1)))) for each in (found, sds)
    )
    return rms, doubt


def _unstretched(error_mm: np.ndarray, trace: Trace, corexy: bool, sigma_mm: float) -> tuple[np.ndarray, float]:
    """Return the errors of the measured marks [N, 2] without what may as well be the instrument's own stretch, its most
    likely one but no more than two of its standard deviations, and how much of that is its scale [%]."""
    x, y = (trace.commanded_mm - trace.commanded_mm[trace.measured_rows].mean(axis=0))[trace.measured_rows].T
    # common scale, half the difference of both axes' scales, half the lean; the x axis keeps its direction
    along_x = np.stack([x, x, y if corexy else 2 * y], axis=1)
    along_y = np.stack([y, -y, x if corexy else 0 * x], axis=1)
    columns, off = np.concatenate([along_x, along_y]), error_mm.T.ravel()
    prior = trace.instrument_doubt.covariance
    pull = np.linalg.solve(
        columns.T @ columns @ prior + max(sigma_mm, _LEAST_SIGMA_MM) ** 2 * np.eye(3), columns.T @ off
    )
    found = prior @ pull
    sds = float(np.sqrt(max(pull @ found, 0.0)))  # how far the instrument would have to be off
    found *= min(1.0, _SURE_SIGMAS / max(sds, 1e-9))  # the rest is the printer's
    return error_mm - (columns @ found).reshape(2, -1).T, 100 * float(found[0])


def expectation(model: SavedModel, trace: Trace) -> Promise | None:
    """Return how far the measured marks of a trace are expected to lie from where they are wanted once it is mended:
    distances on the bed, as `verify` states them. None for a model that says nothing of its doubt."""
    budget = parse_budget(model)
    if budget is None or not trace.measured_rows.any():
        return None
    after = _outlook_at_marks(model, budget, trace)[0].after
    made = {name: PLANE_FACTOR * share for name, share in after.made_of.items()}
    sizes = ("rms_mm", "p95_mm", "max_mm", "rms_low_mm", "rms_high_mm", "shape_rms_mm", "planning_rms_mm")
    return replace(after, made_of=made, **{name: PLANE_FACTOR * getattr(after, name) for name in sizes})


def _sides(trace: Trace, printer: Printer) -> np.ndarray:
    """Return which way each motor came to the measured marks [N, 2]: +1, −1, 0 before its first move."""
    sides = [last_way(column) for column in printer.to_motor(trace.commanded_mm).T]
    return np.stack(sides, axis=1)[trace.measured_rows]


def _outlook_at_marks(model: SavedModel, budget: Budget, trace: Trace) -> tuple[Outlook, np.ndarray]:
    """Return what to expect of the measured marks [N], across the path, and how far each is off unmended [N, 2]."""
    wanted, printer, known = trace.commanded_mm, model.printer, trace.measured_rows
    raw = print_from_home(model.mechanism, wanted)
    off = (raw - wanted)[known]
    gone_mm = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(wanted, axis=0).T))])[known]
    # each mark counts along x and along y; across a path along x lies y, across one along y lies −x
    path = PathPlaces(
        np.repeat(wanted[known], 2, axis=0),
        np.tile(np.eye(2), (len(off), 1)),
        np.stack([off[:, 1], -off[:, 0]], axis=1).ravel(),
        np.repeat(_sides(trace, printer), 2, axis=0),
        np.ones(2 * len(off)),
        None if (z_mm := heights_mm(trace, printer)) is None else np.repeat(z_mm[known], 2),
        np.repeat(gone_mm, 2),
        np.repeat(np.stack([last_way(axis) for axis in wanted.T], axis=1)[known], 2, axis=0),
    )
    before = Errors(float(np.sqrt(np.mean(path.off_mm**2))), 0.0, float(np.abs(path.off_mm).max()))
    outlook = promised(model.mechanism, budget, path, before, Errors(0.0, 0.0, 0.0), at_rest=True)
    assert outlook is not None  # every mark has a place
    return outlook, off


def update_words(verdict: Verdict, newer: Updated) -> str:
    """Say what the check print changed in the model.

    One that keeps its promise is of this machine, even where a fresh fit explains the small print better.
    """
    return "the model was brought up to date" if verdict.kept and newer.anew else newer.words


def updated(model: SavedModel, trace: Trace) -> Updated:
    """Bring the model up to date with a mended check print: what was really commanded is what mending had made of it.

    Raises `ModelError` for a model that is no grey box, `TraceError` as `learn_model` does.
    """
    printer, mechanism = model.printer, model.mechanism
    belts = printer.to_motor(mechanism.frame.invert(trace.commanded_mm))
    motors = np.empty_like(belts)
    for motor, table in enumerate(mechanism.transmissions):
        side, grid = last_way(belts[:, motor]), table.motor_mm
        forward, back = (
            belts[:, motor] - np.interp(belts[:, motor], branch, branch - grid)
            for branch in (table.lower_mm, table.upper_mm)
        )
        motors[:, motor] = np.where(side > 0, forward, np.where(side < 0, back, belts[:, motor]))
    commanded = printer.from_motor(motors)
    commanded[0] = trace.commanded_mm[0]
    offset = trace.offset_mm
    if offset is not None and trace.normal is not None:  # a wall's offset counts from what was commanded
        offset = offset + np.sum(trace.normal * (trace.commanded_mm - commanded), axis=1)
    made = Trace(
        commanded, trace.measured_mm, sigma_mm=trace.sigma_mm, homed=trace.homed, placed=trace.placed,
        instrument=trace.instrument, normal=trace.normal, offset_mm=offset,
    )  # fmt: skip
    return update(model, made, rng=np.random.default_rng(0))


def remember_verdict(model_path: Path, model: SavedModel, verdict: Verdict) -> Path:
    """Add a verdict to the model's history, one JSON object a line; return the file."""
    return remember(model_path, model, "verified", verdict.json())
