"""Measure after mending: was the promise kept or broken, or is the measurement too coarse? Then update the model.

The check print is any probe's G-code, mended with the model and printed. Its plan has the intended positions of the
marks. Their measured errors, with the measurement noise subtracted, are compared with the promise for these marks. The
promise does not cover the shift of the whole print, which every homing changes.
"""

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from printmend.diagnosis.named import misfits_of
from printmend.effects import EFFECTS, Of, columns_of
from printmend.effects.effect import drawn_places, strokes_of
from printmend.errors import TraceError
from printmend.gcode.read import read_gcode
from printmend.infer.gram import seen
from printmend.infer.machine import DRAWS
from printmend.infer.search import search_of
from printmend.infer.update import Renewed
from printmend.learn.learned import PLANE_FACTOR, known_digests
from printmend.learn.order import once_in_order
from printmend.machine import print_from_home
from printmend.measure.checks import check_origin, check_trace, digest_of, with_heights
from printmend.mend.history import remember
from printmend.mend.mend import mend_gcode
from printmend.mend.update import Updated, changes_of, measured_again, update
from printmend.messages import say, say_count, together
from printmend.model import SavedModel
from printmend.path import Trace, last_way
from printmend.printer import Printer
from printmend.probe.layout import purge_mm, snapped
from printmend.promise.belief import Belief, belief_of, parse_belief
from printmend.promise.predict import HIGH, LOW, Errors, Outlook, PathPlaces, Promise, promised

_LEAST_STRETCH_PERCENT = 0.01  # a smaller stretch by the instrument is not reported
_NOISE_SD_SHARE = 0.15  # standard deviation of the stated noise of a measurement, as a share of it
_UNMENDED_SHARE = 0.9  # a print with more than this share of its unmended error was hardly mended …
_SAME_FAULT_SHARE = 0.5  # … if less than this share of its error differs from the model's unmended print
SEEN_FACTOR = 2.0  # a promise is kept if an error of this many times its upper end is ruled out
_SURELY_SDS = 2.0  # an error is surely found if it exceeds the smallest detectable one by so many standard deviations
_ASKED = "play"  # a measurement must be fine enough to show this effect, which grows most often


KEPT, BROKEN, UNSURE = "kept", "broken", "cannot tell"


@dataclass(frozen=True)
class Verdict:
    """RMS distances of the marks from their intended positions [mm].

    ``before_mm`` is the unmended print's error, the median of what the model believes. According to this measurement,
    the error is now between ``now_low_mm`` and ``now_high_mm``. The promise has a 90 % range. ``unlike_mm`` is the
    distance from where the model puts the marks of an unmended print. A common shift is subtracted, and
    ``stretch_percent`` of scale that may be the instrument's own. ``stated``: the measurement states its own noise.
    ``wanders_mm`` is how far place and scale may be off because the instrument drifts. ``changed`` lists the sure
    changes of the machine, and a shift too large for a homing. ``ways_known``: way-points between the marks show from
    which side each was reached. ``scanned``: a picture was measured.
    """

    marks: int
    before_mm: float
    now_mm: float
    now_low_mm: float
    now_high_mm: float
    promised_mm: float
    promised_low_mm: float
    promised_high_mm: float
    unlike_mm: float
    stretch_percent: float = 0.0
    stated: bool = True
    wanders_mm: float = 0.0
    changed: tuple[str, ...] = ()
    ways_known: bool = True
    scanned: bool = False

    @property
    def result(self) -> str:
        """*Broken*: the error surely exceeds the promise. *Kept*: an error of twice the promise would have shown.
        Otherwise this measurement *cannot tell*."""
        if self.now_low_mm > self.promised_high_mm:
            return BROKEN
        return KEPT if self.now_high_mm <= SEEN_FACTOR * self.promised_high_mm else UNSURE

    @property
    def at_most_mm(self) -> float | None:
        """The upper limit of an error that is not surely above the measurement noise; None if it is."""
        return None if self.now_low_mm > 0 else self.now_high_mm

    @property
    def shows_from_mm(self) -> float:
        """The smallest error that this measurement would surely have shown to exceed the promise."""
        return float(np.hypot(self.promised_high_mm, self.now_high_mm))

    @property
    def words(self) -> str:
        """Return the verdict in one line, the numbers first."""
        return self.words_beside(None)

    def words_beside(self, newer_path: Path | None) -> str:
        """Return the verdict in one line; ``newer_path`` is the model that the measurement brought up to date."""
        now = f"{self.now_mm:.3f}" if self.at_most_mm is None else say("less-than", f"{self.at_most_mm:.3f}")
        promised = f"{self.promised_low_mm:.3f}–{self.promised_high_mm:.3f}"
        numbers = say("before-now-promised", f"{self.before_mm:.3f}", now, promised)
        if abs(self.stretch_percent) >= _LEAST_STRETCH_PERCENT:
            numbers = say("scale-taken-off", numbers, f"{self.stretch_percent:+.2f}")
        if self.result == KEPT:
            kept = say_count("verdict-kept", self.marks, numbers)
            but = [say("mending-did-not-help")] * (self.now_low_mm > self.before_mm) + [*self.changed]
            return say("kept-but", kept, together("; ", but)) if but else kept
        if self.result == UNSURE:
            if self.wanders_mm:
                return say("verdict-wanders", numbers, f"{self.wanders_mm:.2f}")
            coarse = "verdict-scan" if self.scanned else "verdict-coarse" if self.stated else "verdict-unstated"
            words = say(coarse, numbers, f"{self.shows_from_mm:.3f}")
            return words if self.ways_known else together(". ", [words, say("verdict-no-ways")])
        if self.now_mm > _UNMENDED_SHARE * self.before_mm:
            if self.unlike_mm < _SAME_FAULT_SHARE * self.now_mm:
                return say("verdict-as-before-mending", numbers)
            return say("verdict-farther-off" if self.now_low_mm > self.before_mm else "verdict-another-fault", numbers)
        if newer_path is not None:
            return say("verdict-broken-newer", numbers, newer_path)
        return say("verdict-broken", numbers)

    def json(self) -> dict[str, Any]:
        """Return plain values."""
        more = {"now_at_most_mm": self.at_most_mm, "shows_from_mm": self.shows_from_mm}
        return {**asdict(self), **more, "result": self.result, "kept": self.result == KEPT}


def verify(model: SavedModel, trace: Trace) -> Verdict:
    """Compare a measured check print, whose G-code was mended with ``model``, with the model's promise.

    The commanded positions of ``trace`` are the intended ones. The print counts as a second measurement of the machine;
    the error of the updated drawn machines at the marks is compared with the promise. Raises `TraceError` for a table
    that nobody could learn from, for another printer's marks and for marks that the model was learned from. Raises
    `ModelError` for a model without a promise.
    """
    belief = belief_of(model)
    check_origin(say("check-print"), trace.origin, model.printer)
    if digest_of(trace) in known_digests(model):
        raise TraceError(
            say("check-print"), wanted=say("print-mended"), came=say("measurement-model-learned-from"),
            todo=say("mend-test-print-print-measure-one"),
        )  # fmt: skip
    trace = once_in_order(trace, model.printer).trace
    check_trace(trace, model.printer)
    known = np.flatnonzero(trace.measured_rows)
    outlook, off = _outlook_at_marks(model, belief, trace)
    commanded, wanted_mm = made(model, trace)
    found = measured_again(model, belief, commanded, np.random.default_rng(0), stories=False)
    noise_mm = found.now.noise_mm
    sigmas = np.empty(0) if trace.sigma_mm is None else trace.sigma_mm[known]
    stated = sigmas[np.isfinite(sigmas)]
    own_mm = float(np.sqrt(np.mean(stated**2))) if len(stated) else model.noise_mm
    # scatter beyond the instrument's noise may or may not come from the printer
    beyond_mm = PLANE_FACTOR * float(np.sqrt(max(noise_mm**2 - ((1 + 2 * _NOISE_SD_SHARE) * own_mm) ** 2, 0.0)))
    surely_mm, wanders_mm = _errors_mm(found, wanted_mm)
    rounding_mm = PLANE_FACTOR * outlook.after.made_of.get("rounding", 0.0)  # scatters the marks as noise does
    whole_mm = np.sqrt(surely_mm**2 + wanders_mm**2 + rounding_mm**2)
    now = float(np.median(whole_mm))
    # a random walk imitates place and scale as far as its end strays: 6 times its mean square about its mean
    low2 = float(np.quantile(surely_mm, LOW) ** 2 - 6 * np.median(wanders_mm) ** 2) if _is_beyond(found) else 0.0
    high = float(np.sqrt(np.quantile(whole_mm, HIGH) ** 2 + beyond_mm**2 + _unseen_mm(found) ** 2))
    before, after = outlook.before, outlook.after
    error = (trace.measured_mm - trace.commanded_mm)[known]
    unlike = error - off - (error - off).mean(axis=0)
    return Verdict(
        len(known), PLANE_FACTOR * before.rms_mm, now, float(np.sqrt(max(low2, 0.0))), high,
        PLANE_FACTOR * after.rms_mm, PLANE_FACTOR * after.rms_low_mm, PLANE_FACTOR * after.rms_high_mm,
        float(np.sqrt(max(np.mean(np.sum(unlike**2, axis=1)) - (PLANE_FACTOR * noise_mm) ** 2, 0.0))),
        _stretch_percent(found), bool(len(stated)), float(np.median(wanders_mm)),
        (*(change.words for change in changes_of(found)), *_moved_words(found)), len(known) < len(trace) - 1,
        trace.instrument is not None,
    )  # fmt: skip


def _errors_mm(found: Renewed, wanted_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return each drawn machine's RMS distance [DRAWS] of the marks from their wanted places, of which each row has one
    [N, 2], and how much of it is drift, which may be the printer's or the instrument's."""
    fit, scene = found.fit, found.now.scene
    nominal = scene.printer.from_motor(fit.places.motor_mm)
    ahead = np.einsum("mc,mc->m", fit.rows.along, (nominal - wanted_mm)[fit.rows.mark])
    sums = {False: np.repeat(ahead[:, None], DRAWS, axis=1)}
    sums[True] = np.zeros_like(sums[False])
    wanders = any(block.effect == "wander" for block in found.fit.blocks)
    for part in found.now.parts:
        of = EFFECTS[part.effect].of
        if of.is_printers:
            columns = seen(part.key, fit.places, fit.rows, scene)
            sums[wanders and of is Of.SESSION] += columns @ part.draws_mm
    along = fit.rows.along
    sums = {key: each - along @ np.linalg.lstsq(along, each, rcond=None)[0] for key, each in sums.items()}
    surely_mm, wanders_mm = (PLANE_FACTOR * np.sqrt(np.mean(sums[key] ** 2, axis=0)) for key in (False, True))
    return surely_mm, wanders_mm


def _moved_words(found: Renewed) -> list[str]:
    """Return what tells that the whole print lies elsewhere than its home says."""
    told = misfits_of(found.now.parts, found.now.scene) if found.now.scene.homed else []
    return [one.words for one in told if one.kind == "moved"]


def _is_beyond(found: Renewed) -> bool:
    """Return whether a check print shows an error that no drawn machine has."""
    of_print = (block.effect for block in found.fit.blocks if EFFECTS[block.effect].of is Of.SESSION)
    return bool(found.changes) or any(each != "wander" for each in of_print)


def _unseen_mm(found: Renewed) -> float:
    """Return the largest error at the marks from more play of a motor that this print would not show, be it a change or
    what the model left open."""
    fit = found.fit
    search = search_of(fit.dictionary, fit.rows, fit.rows.weight)  # the old machine is not summed out
    state = search.posterior(fit.state.members, fit.state.sigma_mm, rounds=0)
    blocks, most_mm = search.dictionary.blocks, 0.0
    for number, block in enumerate(blocks):
        if block.effect != _ASKED or number in {b for b, _ in state.members}:
            continue
        at = block.at.start
        crossing = search.gram.between(state.columns, np.array([at]))[:, 0] / state.sigma_mm**2
        told = search.gram.within(block.at)[0, 0] / state.sigma_mm**2 - crossing @ state.covariance @ crossing
        costs = 0.5 * np.log1p(block.sds_mm[:, 0] ** 2 * told) - block.log_odds
        size_mm = float((np.sqrt(2 * costs.min()) + _SURELY_SDS) / np.sqrt(max(told, 1e-12)))
        most_mm = max(most_mm, size_mm * float(np.sqrt(np.mean(search.dictionary.columns[:, at] ** 2))))
    return PLANE_FACTOR * most_mm


def _stretch_percent(found: Renewed) -> float:
    """Return the scale error that may be the instrument's [%]: the mean slope of its errors along both axes."""
    scene = found.now.scene
    places = drawn_places(scene)
    moved = np.zeros_like(places.bed_mm)
    for part in found.now.parts:
        if EFFECTS[part.effect].of is Of.INSTRUMENT:
            moved += columns_of(part.effect, places, part.where, part.shape, scene) @ part.mean_mm
    off, moved = (each - each.mean(axis=0) for each in (places.bed_mm, moved))
    return 100 * float(np.trace(np.linalg.lstsq(off, moved)[0])) / 2


def expectation(model: SavedModel, trace: Trace) -> Promise | None:
    """Return the expected distances of a trace's marks from their intended positions after mending: distances on the
    bed, as `verify` states them. None for a model without drawn machines."""
    belief = parse_belief(model)
    if belief is None or not trace.measured_rows.any():
        return None
    after = _outlook_at_marks(model, belief, trace)[0].after
    made = {name: PLANE_FACTOR * share for name, share in after.made_of.items()}
    sizes = ("rms_mm", "p95_mm", "max_mm", "rms_low_mm", "rms_high_mm", "planning_rms_mm")
    return replace(after, made_of=made, **{name: PLANE_FACTOR * getattr(after, name) for name in sizes})


def _sides(trace: Trace, printer: Printer) -> tuple[np.ndarray, np.ndarray]:
    """Return the direction in which each motor reached the measured marks [N, 2]: +1, −1, 0 before its first move; and
    how far it had gone since it last turned round [N, 2, STROKES]."""
    motors_mm, known = printer.to_motor(trace.commanded_mm), trace.measured_rows
    sides = last_way(motors_mm)
    return sides[known], strokes_of(motors_mm, sides, np.zeros(2))[known]


def _outlook_at_marks(model: SavedModel, belief: Belief, trace: Trace) -> tuple[Outlook, np.ndarray]:
    """Return the prediction for the measured marks [N], across the path, and the unmended error of each [N, 2]."""
    wanted, printer, known = trace.commanded_mm, model.printer, trace.measured_rows
    raw = print_from_home(model.mechanism, wanted)
    off = (raw - wanted)[known]
    gone_mm = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(wanted, axis=0).T))])[known]
    side, strokes_mm = _sides(trace, printer)
    # each mark counts along x and along y; across a path along x lies y, across one along y lies −x
    path = PathPlaces(
        np.repeat(wanted[known], 2, axis=0),
        np.tile(np.eye(2), (len(off), 1)),
        np.stack([off[:, 1], -off[:, 0]], axis=1).ravel(),
        np.repeat(side, 2, axis=0),
        np.ones(2 * len(off)),
        None if (z_mm := with_heights(trace, printer).z_mm) is None else np.repeat(z_mm[known], 2),
        np.repeat(gone_mm, 2),
        np.repeat(last_way(wanted)[known], 2, axis=0),
        np.repeat(strokes_mm, 2, axis=0),
    )
    before = Errors(float(np.sqrt(np.mean(path.off_mm**2))), 0.0, float(np.abs(path.off_mm).max()))
    outlook = promised(model.mechanism, belief, path, before, Errors(0.0, 0.0, 0.0), at_rest=True)
    assert outlook is not None  # every mark has a place
    return outlook, off


def update_words(verdict: Verdict, newer: Updated) -> str:
    """Say what the check print changed in the model.

    A print that does not break its promise is of this machine, even if a fresh fit explains the small print better.
    """
    return say("model-brought-up-date") if verdict.result != BROKEN and newer.anew else newer.words


def updated(model: SavedModel, trace: Trace) -> Updated:
    """Bring the model up to date with a mended check print.

    Raises `ModelError` for a model without drawn machines, `TraceError` like `learn_model`.
    """
    return update(model, made(model, trace)[0], rng=np.random.default_rng(0))


def made(model: SavedModel, trace: Trace) -> tuple[Trace, np.ndarray]:
    """Return a check print as it was commanded after mending, and the intended position of each of its rows [N, 2].

    Dots get the moves of the mended file, which takes another path between them. Walls, and prints with heights or
    without a home, are taken place by place.
    """
    dots, printer = np.flatnonzero(trace.measured_rows), model.printer
    begins = np.array_equal(snapped(printer, trace.commanded_mm[:1]), snapped(printer, np.array([printer.home_mm])))
    if not (trace.homed and begins and len(dots)) or trace.wall_rows.any() or trace.z_mm is not None:
        return _each_made(model, trace), trace.commanded_mm
    moves, rests = _mended_dots(model, trace.commanded_mm, dots)
    measured, sigma = np.full((1 + moves.shape[0], 2), np.nan), np.full(1 + moves.shape[0], np.nan)
    wanted = np.vstack([trace.commanded_mm[:1], moves])
    commanded, rows = wanted.copy(), 1 + rests
    if dots[0] == 0:
        rows = np.append(0, rows)
    if len(np.unique(rows)) < len(dots):  # twice at one place
        return _each_made(model, trace), trace.commanded_mm
    measured[rows], wanted[rows] = trace.measured_mm[dots], trace.commanded_mm[dots]
    if trace.sigma_mm is not None:
        sigma[rows] = trace.sigma_mm[dots]
    sigmas = None if trace.sigma_mm is None else sigma
    return _commanded_to(trace, commanded, measured_mm=measured, sigma_mm=sigmas, normal=None, offset_mm=None), wanted


def _mended_dots(model: SavedModel, wanted_mm: np.ndarray, dots: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the places [N, 2] to which a mended file goes from home along wanted places [M, 2], and which of them are
    the ``dots``; home, row 0, is left out.

    A test print begins with a line: it decides on which side of their slack the belts lie from there on."""
    lines = [f"G0 X{x:.5f} Y{y:.5f} F6000" for x, y in wanted_mm[1:].tolist()]
    line_mm = snapped(model.printer, np.array(purge_mm(model.printer)))
    if np.array_equal(snapped(model.printer, wanted_mm[1:3]), line_mm):
        lines[1] += " E1"
    for dot in dots[dots > 0]:
        lines[dot - 1] += "\nG1 E1"
    with TemporaryDirectory() as folder:
        source, output = Path(folder) / "wanted.gcode", Path(folder) / "mended.gcode"
        source.write_text("\n".join(["G21", "G90", "M83", "G28", *lines, ""]), encoding="utf-8")
        mend_gcode(source, model, output, force=True)
        moves = read_gcode(output, printer=model.printer).moves
    goes = (moves.start_mm[:, :2] != moves.end_mm[:, :2]).any(axis=1)
    return moves.end_mm[goes, :2], np.cumsum(goes)[~goes & (moves.extrusion_mm > 0)] - 1


def _each_made(model: SavedModel, trace: Trace) -> Trace:
    """Return a check print as it was commanded where mending moved each of its places by itself."""
    printer, mechanism = model.printer, model.mechanism
    belts = printer.to_motor(mechanism.frame.invert(trace.commanded_mm))
    sides = last_way(belts)
    commanded = printer.from_motor(mechanism.motors_at(belts, sides))
    commanded[0] = trace.commanded_mm[0]
    offset = trace.offset_mm
    if offset is not None and trace.normal is not None:  # a wall's offset counts from its commanded place
        offset = offset + np.sum(trace.normal * (trace.commanded_mm - commanded), axis=1)
    return _commanded_to(trace, commanded, offset_mm=offset)


def _commanded_to(trace: Trace, places_mm: np.ndarray, **changed: Any) -> Trace:
    """Return a print with the places [N, 2] that it was commanded to: no longer those of its test print, nor at
    heights. It counts as the same measurement."""
    return replace(
        trace, commanded_mm=places_mm, z_mm=None, z_measured_mm=None, layer=None, origin=None, blank_rows=0,
        taken=digest_of(trace), **changed,
    )  # fmt: skip


def remember_verdict(model_path: Path, model: SavedModel, verdict: Verdict) -> Path:
    """Add a verdict to the model's history, one JSON object a line; return the file."""
    return remember(model_path, model, "verified", verdict.json())
