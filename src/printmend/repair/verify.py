"""Measure again after mending: was the promise kept, or can this measurement not tell? And bring the model up to date.

The check print is any probe's G-code, mended with the model and printed. Its plan says where marks were wanted; what
is measured of them is compared with what was promised for these places, the noise of the measurement taken off.
"""

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from printmend.diagnosis.screw import heights_mm
from printmend.errors import ModelError, TraceError
from printmend.learn.greybox import Greybox
from printmend.learn.walls import with_walls
from printmend.machine import print_from_home
from printmend.measure.once import digest_of
from printmend.measure.whose import check_origin
from printmend.path import Trace, last_way
from printmend.printer import Printer
from printmend.promise.budget import Budget, parse_budget
from printmend.promise.misfit_tests import LEAST_ROWS
from printmend.promise.predict import Errors, Outlook, PathPlaces, Promise, promised
from printmend.repair.history import remember
from printmend.repair.learned import PLANE_FACTOR, known_digests
from printmend.repair.update import Updated, update, wandering_mm
from printmend.saved import SCALE_MM, Design, SavedModel, branches_of

LEAST_MARKS = 10  # measured marks of a check print; fewer tell nothing
_LEAST_SIGMA_MM = 0.002  # smallest standard deviation of a mark: no scan is read better
_LEAST_STRETCH_PERCENT = 0.01  # a smaller stretch by the instrument is not worth a word
_NOISE_SD_SHARE = 0.15  # standard deviation of the stated noise of a measurement, as a share of it
_UNMENDED_SHARE = 0.9  # a print with more than this share of the error before mending was hardly mended …
_SAME_FAULT_SHARE = 0.5  # … if, of its error, less than this share is unlike the unmended print of the model
_SURE_SIGMAS = 2.0  # standard deviations within which a measured error is known
SEEN_FACTOR = 2.0  # a promise is kept where an error of so many times its upper end is ruled out
_MARKS_A_WAVE, _MOST_WAVES = 12, 6  # of each motor's turn so many waves are looked for in the errors of marks
_LEAST_COLUMN = 1e-6  # share of the largest of a set of columns, below which one is another's


KEPT, BROKEN, UNSURE = "kept", "broken", "cannot tell"


@dataclass(frozen=True)
class Verdict:
    """Distances of the marks from where they were wanted, root mean square [mm]: unmended as the model says
    (``before_mm``), as measured now, between ``now_low_mm`` and ``now_high_mm`` as far as this measurement can tell,
    and as was promised with its 90 % range; ``unlike_mm`` is how far they lie from where the model has them unmended.
    ``placed``: they contain where on the bed the print lies; else a shift of the whole is taken off, and
    ``stretch_percent`` of scale that may as well be the instrument's own. ``stated``: the measurement says how exact
    it is; ``wanders_mm`` is by how much place and scale may be off because what measures wanders."""

    marks: int
    before_mm: float
    now_mm: float
    now_low_mm: float
    now_high_mm: float
    promised_mm: float
    promised_low_mm: float
    promised_high_mm: float
    unlike_mm: float
    placed: bool
    stretch_percent: float = 0.0
    stated: bool = True
    wanders_mm: float = 0.0

    @property
    def result(self) -> str:
        """Broken where the error is surely more than was promised, kept where one of twice as much would have shown,
        and else that this measurement cannot tell."""
        if self.now_low_mm > self.promised_high_mm:
            return BROKEN
        return KEPT if self.now_high_mm <= SEEN_FACTOR * self.promised_high_mm else UNSURE

    @property
    def at_most_mm(self) -> float | None:
        """What the error may be at most where it is not surely above the noise of the measurement; None where it is."""
        return None if self.now_low_mm > 0 else self.now_high_mm

    @property
    def shows_from_mm(self) -> float:
        """The smallest error that this measurement would surely have shown to be more than was promised."""
        return float(np.hypot(self.promised_high_mm, self.now_high_mm))

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
        if self.result == KEPT:
            return f"{numbers}: kept ({self.marks} marks)"
        if self.result == UNSURE:
            if self.wanders_mm:
                return (
                    f"{numbers}: cannot tell. What measures wanders, so that place and scale may be off by "
                    f"{self.wanders_mm:.2f} mm: fix it, let it warm up, and measure again"
                )
            how = "scan the print" if self.stated else "scan the print, or say in sigma_mm how exact the table is"
            return (
                f"{numbers}: cannot tell. This measurement is too coarse, it shows only errors above "
                f"{self.shows_from_mm:.3f} mm: {how}"
            )
        if self.now_mm > _UNMENDED_SHARE * self.before_mm:
            if self.unlike_mm < _SAME_FAULT_SHARE * self.now_mm:
                return (
                    f"{numbers}: broken, and as far off as before mending. Was the mended file printed? And is it "
                    "compared with the places of the original, not with those of the mended file?"
                )
            return (
                f"{numbers}: broken, and as far off as before mending, but not as this printer was. Is it another "
                "printer's? Else a part was replaced or came loose: learn from a new test print"
            )
        return f"{numbers}: broken. Mend again with the model that -o brings up to date with this measurement"

    def json(self) -> dict[str, Any]:
        """Return plain values."""
        more = {"now_at_most_mm": self.at_most_mm, "shows_from_mm": self.shows_from_mm}
        return {**asdict(self), **more, "result": self.result, "kept": self.result == KEPT}


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
    repeating = _repeating(error, trace, model)
    noise2 = PLANE_FACTOR**2 * sigma**2 if len(stated) else repeating.rest_mm2
    now, low, high = _error_now_mm(error, noise2, repeating, is_stated=bool(len(stated)))
    wanders_mm = 0.0
    if trace.instrument_doubt.is_exact and len(known) >= LEAST_ROWS:
        wanders_mm = wandering_mm(Greybox().fit(trace, model.printer, rng=np.random.default_rng(0)), trace)
    low = float(np.sqrt(max(low**2 - (PLANE_FACTOR * wanders_mm) ** 2, 0.0)))
    after = outlook.after
    before_mm = float(np.sqrt(np.mean(np.sum(off**2, axis=1))))
    return Verdict(
        len(known), before_mm, now, low, high,
        PLANE_FACTOR * after.rms_mm, PLANE_FACTOR * after.rms_low_mm, PLANE_FACTOR * after.rms_high_mm,
        float(np.sqrt(max(np.mean(np.sum(unlike**2, axis=1)) - noise2, 0.0))), placed, stretch, bool(len(stated)),
        wanders_mm,
    )  # fmt: skip


def _error_now_mm(
    error_mm: np.ndarray, noise_mm2: float, repeating: "_Repeating", *, is_stated: bool
) -> tuple[float, float, float]:
    """Return the root mean square [mm] of errors [N, 2] without the noise of measuring, and what it is at least and at
    most; noise that nobody stated is what repeats nothing, of which all may be noise, and none."""
    square = np.sum(error_mm**2, axis=1)
    doubt2 = 2 * _NOISE_SD_SHARE * noise_mm2 if is_stated else noise_mm2 / _SURE_SIGMAS
    now2, sd2 = float(square.mean()) - noise_mm2, float(np.hypot(square.std() / np.sqrt(len(square)), doubt2))
    low2, high2 = now2 - _SURE_SIGMAS * sd2, max(now2, 0.0) + _SURE_SIGMAS * sd2
    # what surely goes with place and direction is no noise, however much of that is
    if (sure2 := repeating.mm2 - _SURE_SIGMAS * repeating.sd_mm2) > max(low2, 0.0):
        now2, low2 = max(now2, repeating.mm2), sure2
        high2 = max(high2, now2)
    now, low, high = np.sqrt(np.maximum([now2, low2, high2], 0.0))
    return float(now), float(low), float(high)


@dataclass(frozen=True)
class _Repeating:
    """How much of the errors of marks any fault of drives and frame may have made, mean square and its standard
    deviation by the scatter of the ``rest_mm2``, mean square, too [mm²]."""

    mm2: float
    sd_mm2: float
    rest_mm2: float


def _repeating(error_mm: np.ndarray, trace: Trace, model: SavedModel) -> _Repeating:
    """Split the errors of the measured marks [N, 2] in what goes with place and way of the motors, and the rest."""
    printer, known, count = model.printer, trace.measured_rows, len(error_mm)
    waves = tuple(range(1, 1 + min(count // _MARKS_A_WAVE, _MOST_WAVES)))
    design = Design(mean_powers=3, play_powers=1, mean_harmonics=waves, play_harmonics=waves[:1])
    motors_mm, sides = printer.to_motor(trace.commanded_mm)[known], _sides(trace, printer)
    # to and from a motor is linear: the errors of marks are those of the belts
    belts, fitted, used = printer.to_motor(error_mm), np.zeros(error_mm.shape), 0.0
    for motor, middle_mm in enumerate(printer.to_motor(np.array(printer.middle_mm))):
        series = branches_of(model, motor)
        period_mm = printer.axes[motor].mm_per_turn if series is None else series.period_mm
        mean, play = design.columns(motors_mm[:, motor], period_mm, middle_mm)
        columns = np.column_stack([mean + sides[:, motor, None] / 2 * play, motors_mm[:, 1 - motor] / SCALE_MM])
        axes, sizes, _ = np.linalg.svd(columns, full_matrices=False)
        axes = axes[:, sizes > _LEAST_COLUMN * sizes[0]]
        fitted[:, motor] = axes @ (axes.T @ belts[:, motor])
        used += axes.shape[1] / 2
    found = np.asarray(printer.from_motor(fitted))
    rest2 = float(np.square(error_mm - found).sum() / max(count - used, 1.0))
    mine2 = float(np.square(found).sum() - used * rest2) / count
    sd2 = float(np.sqrt(used * rest2**2 + 2 * rest2 * count * max(mine2, 0.0))) / count
    # where neighbours along a motor's way are alike, too, as by an idler, that is no noise (von Neumann's ratio)
    smooth2, smooth_sd2 = rest2 * (1 - _unlike_neighbours(belts - fitted, motors_mm, sides)), rest2 / count**0.5
    if smooth2 > _SURE_SIGMAS * smooth_sd2:
        mine2, sd2, rest2 = mine2 + smooth2, float(np.hypot(sd2, smooth_sd2)), rest2 - smooth2
    uneven2 = (PLANE_FACTOR * trace.instrument_doubt.wave_mm) ** 2  # an uneven instrument's goes with place, too
    return _Repeating(mine2, float(np.hypot(sd2, 2 * uneven2)), rest2)


def _unlike_neighbours(left_mm: np.ndarray, motors_mm: np.ndarray, sides: np.ndarray) -> float:
    """Return the share of the squares of what is left of belts [N, 2] that marks do not share with their neighbours,
    to which the same motor came the same way."""
    orders = (np.lexsort(each) for each in zip(motors_mm.T, sides.T, strict=True))
    steps = sum(float(np.square(np.diff(left[order])).sum()) for left, order in zip(left_mm.T, orders, strict=True))
    return steps / max(2 * float(np.square(left_mm).sum()), 1e-18)


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

    One that does not break its promise is of this machine, even where a fresh fit explains the small print better.
    """
    return "the model was brought up to date" if verdict.result != BROKEN and newer.anew else newer.words


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
