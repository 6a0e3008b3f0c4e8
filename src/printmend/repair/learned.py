"""From a trace to the saved model of a machine: what `printmend learn` does."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from threadpoolctl import threadpool_limits

from printmend.diagnosis.diagnosis import diagnose, doubt_of
from printmend.diagnosis.screw import ScrewFound, find_screw
from printmend.errors import ConfigError
from printmend.identify.drive import ALL_SEEN
from printmend.identify.drive.select import AS_GOOD_SHARE
from printmend.learn import learner
from printmend.learn.greybox import Greybox, GreyboxModel, LearnedDrive
from printmend.learn.hybrid import HybridModel, with_residuals
from printmend.learn.walls import with_walls
from printmend.machine import Frame, Mechanism, healthy_mechanism, healthy_transmission
from printmend.measure.once import counted_once, digest_of
from printmend.measure.whose import check_origin
from printmend.path import Trace
from printmend.printer import Printer
from printmend.promise.apply import acting, still_words
from printmend.promise.effects import Effect
from printmend.promise.halves import halves_of, is_belts, leaves_noise, step_effects
from printmend.promise.laws import LAWS
from printmend.promise.misfit import Misfit, misfit_section, misfit_words
from printmend.promise.misfit_printer import another_home, another_printers
from printmend.promise.misfit_rows import in_order, passed_over
from printmend.promise.misfit_tests import (
    IN_TIME,
    MOST_LOST,
    Cause,
    as_printed,
    causes_of,
    effects_of,
    found_in,
    of_one_time,
    told_lost,
    unrest_mm,
    wandering,
)
from printmend.promise.rails import is_printers, rail_effects, rails_of, waves_of, without_rails
from printmend.promise.scale import scale_words
from printmend.promise.section import instrument_scatter_mm, promise_section, residual_section
from printmend.promise.unexplained import DOUBTED_SCATTER
from printmend.protocols import WorldModel
from printmend.saved import Branches, SavedModel, ScrewSeries, saved_model, with_screw

AUTO = "auto"
_HYBRIDS = (AUTO, "hybrid")
Planar = TypeVar("Planar", bound=WorldModel)
FAR_ORIGIN_MM = 5.0  # an origin of a measurement's own further from the bed's is moved there
# … as a line through what is missed has it at home, where places scatter by this share of their distance from home,
# the line leaves less than this share of what is missed, and no stretch is larger than any printer's.
WIDE_SHARE, LINE_SHARE, MOST_STRETCH = 0.3, 0.5, 0.5
MOST_DOUBT_MM = 0.5  # with a larger doubt of the error at home, an origin is not moved there
PLANE_FACTOR = 2**0.5  # RMS distance on the bed over the standard deviation of one coordinate
LEAST_POWER_MM = 1e-9  # a smaller coefficient of a power above the 0th counts as none: it is what rounding leaves
DIGESTS = "measurements"  # the document's key of what tells the measurements that it was learned from
Z_SAID = "z"  # the document's key of what was said of Z, kind by kind
_TOWER_TODO = "A tower of two turns of the Z screw, measured at several heights, shows the rest: see docs/owners.md."
_PROBE_TODO = "`printmend probe` writes a print that shows all of it."


@dataclass(frozen=True, eq=False)
class Learned:
    """A saved model and what it was made of: the grey box within it (None for learners that have none), the trace that
    it was fitted to, put in order and free of what Z does, and what was found that no known fault makes."""

    saved: SavedModel
    box: GreyboxModel | None
    trace: Trace
    beyond: tuple[str, ...] = ()


def learn_model(
    trace: Trace, printer: Printer, *, model: str = AUTO, rng: np.random.Generator | None = None
) -> SavedModel:
    """Learn a machine from a trace, as `learn` does, and return its saved model."""
    return learn(trace, printer, model=model, rng=rng).saved


def learn(trace: Trace, printer: Printer, *, model: str = AUTO, rng: np.random.Generator | None = None) -> Learned:
    """Learn a machine from a trace.

    ``auto`` is the hybrid: the simplest machine that the trace supports, and what cross-validation adds to it; where a
    motor was not seen over its whole turn, the prior over pulleys says what the rest is like. Raises `TraceError` where
    the trace cannot support any, `ConfigError` where the named learner has no machine to mend with. ``rng`` picks the
    rows looked at first in a long trace; without it every run picks the same.
    """
    rng = np.random.default_rng(0) if rng is None else rng
    # Threads of the linear algebra cost more than they bring on systems of a few hundred unknowns.
    with threadpool_limits(1, user_api="blas"):
        return _learned(trace, printer, model, rng)


def _learned(trace: Trace, printer: Printer, model: str, rng: np.random.Generator) -> Learned:
    check_origin("the measurement", trace.origin, printer)
    digests = (digest_of(trace),)
    trace, copies = counted_once(trace)
    ordered = in_order(near_bed(with_walls(trace, printer), printer), printer)
    began = another_home(ordered.trace, printer)
    ordered = replace(ordered, found=(*passed_over(trace, copies), *ordered.found, *began))
    trace = ordered.trace
    fit, found = fit_beside_screw(trace, printer, lambda clean: _fit_planar(clean, printer, model, rng), rng=rng)
    moved: tuple[Misfit, ...] = ()
    if (box := _box_of(fit)) is not None:
        again, moved = as_printed(box, trace)
        is_shifted = moved and np.array_equal(again.measured_mm, trace.measured_mm, equal_nan=True)
        trace = again
        if is_shifted and model in (*_HYBRIDS, "greybox"):  # no grey box asks where the plate lay
            if found is not None:
                flat = replace(found.trace, placed=again.placed, instrument=again.instrument)
                found = replace(found, trace=flat)
        elif moved:
            fit, found = fit_beside_screw(
                trace, printer, lambda clean: _fit_planar(clean, printer, model, rng), rng=rng
            )
    flat = trace if found is None else found.trace
    if (box := _box_of(fit)) is None or _is_partial(box):
        fit = _completed(fit, flat, printer, model, rng)
        box = _box_of(fit)
    if box is not None:
        is_whole = not _is_partial(box)  # then what it leaves is learned once, of the time that the model is to be of

        def anew(clean: Trace) -> WorldModel:
            newer = _fit_planar(clean, printer, model, rng)
            return newer if is_whole else _completed(newer, clean, printer, model, rng)

        fit, flat, misfits, (effects, explained) = _learned_with_causes(fit, box, flat, anew)
        box = _box_of(fit) or box
        complete = _completed(fit, flat, printer, model, rng) if is_whole else fit
        walk_mm, wanders = wandering(box, flat, effects, getattr(complete, "left_mm", None))
        fit = fit if is_whole and walk_mm else complete  # what wanders would be taken for a remainder
        # A hybrid cannot be brought up to date by a second print: it must bring findings that are worth telling.
        hybrid = fit if isinstance(fit, HybridModel) and fit.findings else None
        more = {"misfit": misfit_section((*ordered.found, *moved, *misfits, *wanders), effects), DIGESTS: list(digests)}
        drifting_mm = max(unrest_mm(box, flat), walk_mm)
        saved = greybox_model(box, flat, hybrid=hybrid, more=more, explained_mm=explained, drifting_mm=drifting_mm)
        if found is not None and not found.is_silent:
            saved = with_screw_found(saved, found, found.series, trace)
        return Learned(saved, box, flat, () if hybrid is None else hybrid.findings)
    return _learned_without_parts(fit, trace, printer, "hybrid" if model == AUTO else model, ordered.found)


def _learned_without_parts(
    fit: WorldModel, trace: Trace, printer: Printer, name: str, found: tuple[Misfit, ...]
) -> Learned:
    """Return what the learner ``name`` made of a trace, whose machine has no grey box's parts."""
    mechanism = healthy_mechanism(printer) if name == "naive" else getattr(fit, "mechanism", None)
    if not isinstance(mechanism, Mechanism):
        raise ConfigError(
            f"--learner {name}",
            wanted="a learner whose model is a machine: motors, belts and a frame",
            came="one that only predicts steps on the lattice",
            todo="use --learner auto, or lightgbm-axis on a cartesian printer",
        )
    known = trace.measured_rows
    noise = float(np.sqrt(np.mean(np.square((trace.measured_mm - trace.commanded_mm)[known]))))
    details = {"misfit": misfit_section(found), "promise": residual_section(mechanism, trace)}
    finding = f"learned by {name}, which knows no play, no direction and no uncertainty"
    saved = saved_model(mechanism, learner=name, noise_mm=noise, findings=(finding,), details=details)
    return Learned(saved, None, trace)


def near_bed(trace: Trace, printer: Printer) -> Trace:
    """Return a trace whose places have an origin of their own with that origin near the bed's, where it was far off.

    What is missed at one place is then the machine's, as everywhere else, and not tens of millimetres of the paper's.
    """
    known = trace.measured_rows
    off_mm = (trace.measured_mm - trace.commanded_mm)[known]
    if trace.placed or not len(off_mm) or np.abs(shift := np.median(off_mm, axis=0)).max() < FAR_ORIGIN_MM:
        return trace
    at_home = _missed_at_home_mm(trace.commanded_mm[known] - printer.home_mm, off_mm)
    if at_home is not None and np.abs(at_home - shift).max() > FAR_ORIGIN_MM:
        shift = at_home
    return replace(trace, measured_mm=trace.measured_mm - shift)


def _missed_at_home_mm(from_home_mm: np.ndarray, off_mm: np.ndarray) -> np.ndarray | None:
    """Return what places [N, 2] miss [N, 2] goes to at home [2]: a pulley of another size misses by tens of
    millimetres in the middle of the bed, and by nothing there. None where places do not show it."""
    line, *_ = np.linalg.lstsq(np.column_stack([np.ones(len(off_mm)), from_home_mm]), off_mm, rcond=None)
    left = off_mm - line[0] - from_home_mm @ line[1:]
    is_wide = (from_home_mm.std(axis=0) > WIDE_SHARE * np.abs(from_home_mm.mean(axis=0))).all()
    is_line = left.std() < LINE_SHARE * off_mm.std(axis=0).max() and np.abs(line[1:]).max() < MOST_STRETCH
    return np.asarray(line[0]) if is_wide and is_line else None


def _learned_with_causes(
    fit: WorldModel, box: GreyboxModel, trace: Trace, learn: Callable[[Trace], WorldModel]
) -> tuple[WorldModel, Trace, tuple[Misfit, ...], tuple[tuple[Effect, ...], np.ndarray]]:
    """Ask what causes the misfit of a fit, and learn again where the answer makes that better.

    A trace is freed of the waves of guides and of a step between two halves of the bed, and where something changed
    during the print, all of it is put as it will be in the next one. Returns the model, the trace that it was learned
    from, the misfits that are left to tell, and what these may do to new prints with what they explain of the rows
    [N, 2] mm, motor by motor.
    """
    causes = causes_of(box, trace, guides=True)
    whose = another_printers(box, trace, causes)
    fit, box, trace, rails = _learned_without_guides(fit, box, trace, causes, learn)
    if any(cause.candidate.kind == "rail-wave" for cause in causes):  # else no guide's wave was told from the others
        causes = causes_of(box, trace)
    bent = rail_effects(box, trace, rails)
    carried, other = (rails, ()) if is_printers(trace) else ((), rails)
    fit, box, freed, step = _learned_without_step(fit, box, trace, learn)
    if freed is not trace:
        other, trace, causes = (*other, *step), freed, causes_of(box, freed)
    elif step:
        carried = (*carried, *step)
        causes = tuple(each for each in causes if (each.candidate.kind, each.motor) != ("halves", step[0].motor))
    bent = (*bent, *step_effects(box, trace, step))
    if (moved := of_one_time(box, trace, causes)) is not None:
        again = _with_guide_waves(learn(moved), box.mechanism.frame.waves)
        if (newer := _box_of(again)) is not None and newer.residual_after_mm <= box.residual_after_mm:
            timed = tuple(cause for cause in causes if cause.candidate.kind in IN_TIME)
            stay = tuple(cause for cause in causes_of(newer, moved) if cause.candidate.kind not in IN_TIME)
            gone, _ = effects_of(newer, moved, timed, of_one_time=True)
            effects, explained = effects_of(newer, moved, stay)
            misfits = found_in(newer, moved, (*other, *timed, *stay), carried, of_one_time=True)
            return again, moved, _told_beside(whose, misfits), ((*bent, *gone, *effects), explained)
    effects, explained = effects_of(box, trace, causes)
    misfits = found_in(box, trace, (*other, *causes), carried=carried)
    return fit, trace, _told_beside(whose, misfits), ((*bent, *effects), explained)


def _told_beside(whose: tuple[Misfit, ...], misfits: tuple[Misfit, ...]) -> tuple[Misfit, ...]:
    """Return what is told of misfits: where a table looks like another printer's, all else follows from that, but for
    the guides' play, the other cause that looks so."""
    return (*whose, *(each for each in misfits if not whose or each.kind == "rail-play" or each.kind not in LAWS))


def _learned_without_guides(
    fit: WorldModel, box: GreyboxModel, trace: Trace, causes: tuple[Cause, ...], learn: Callable[[Trace], WorldModel]
) -> tuple[WorldModel, GreyboxModel, Trace, tuple[Cause, ...]]:
    """Learn again from a trace that is freed of what wavy guides do to it.

    Returns the model, its grey box, the freed trace and the causes that are guides. The model's frame has the waves
    where the guides are the printer's own and not the instrument's. Where the motors alone explain the trace as well,
    it returns what was given, and no causes.
    """
    if not (rails := rails_of(box, trace, causes)):
        return fit, box, trace, ()
    freed = without_rails(box, trace, rails)
    again = learn(freed)
    newer = _box_of(again)
    if newer is None or newer.residual_after_mm > AS_GOOD_SHARE * box.residual_after_mm:
        return fit, box, trace, ()
    if not is_printers(trace):
        return again, newer, freed, rails
    again = _with_guide_waves(again, waves_of(box.printer, rails))
    return again, _box_of(again) or newer, freed, rails


def _learned_without_step(
    fit: WorldModel, box: GreyboxModel, trace: Trace, learn: Callable[[Trace], WorldModel]
) -> tuple[WorldModel, GreyboxModel, Trace, tuple[Cause, ...]]:
    """Learn again from a trace that is freed of a step between two halves of the bed, which no printer makes.

    Returns the model, its grey box, the freed trace and the step; a belt may make a step along its own axis: then its
    model has it, and the trace is as given. Without a step it returns what was given, and no causes.
    """
    if not (step := halves_of(box, trace)) or is_belts(box, step):
        return fit, box, trace, step
    freed = without_rails(box, trace, step)
    again = _with_guide_waves(learn(freed), box.mechanism.frame.waves)
    newer = _box_of(again)
    is_better = newer is not None and newer.residual_after_mm <= AS_GOOD_SHARE * box.residual_after_mm
    if newer is None or not is_better or not leaves_noise(newer):
        return fit, box, trace, ()
    return again, newer, freed, step


def _with_guide_waves(fit: Planar, waves: np.ndarray) -> Planar:
    """Return a learned machine whose frame has these waves [K, 6]."""

    def on(mechanism: Mechanism) -> Mechanism:
        return replace(mechanism, frame=replace(mechanism.frame, waves=waves))

    if isinstance(fit, HybridModel):
        return replace(fit, box=_with_guide_waves(fit.box, waves), mechanism=on(fit.mechanism))
    return replace(fit, mechanism=on(fit.mechanism)) if isinstance(fit, GreyboxModel) else fit


def fit_beside_screw(
    trace: Trace, printer: Printer, fit: Callable[[Trace], Planar], *, rng: np.random.Generator
) -> tuple[Planar, ScrewFound | None]:
    """Return the planar model that ``fit`` learns from a trace once the push of Z is off, and what was found of Z."""
    model = fit(trace)
    if (box := _box_of(model)) is None:
        return model, None

    def rest_mm(clean: Trace) -> np.ndarray:
        return left_over_mm(Greybox().fit(clean, printer, rng=rng))

    found = find_screw(trace, printer, left_over_mm(box), rest_mm)
    return model if found is None or found.trace is trace else fit(found.trace), found


def _fit_planar(trace: Trace, printer: Printer, model: str, rng: np.random.Generator) -> WorldModel:
    """Learn x and y; of a hybrid the grey box alone.

    What the grey box leaves is learned once, when the trace is settled (`_completed`).
    """
    return learner("greybox" if model in _HYBRIDS else model).fit(trace, printer, rng=rng)


def _completed(fit: WorldModel, trace: Trace, printer: Printer, model: str, rng: np.random.Generator) -> WorldModel:
    """Return a hybrid's grey box with the residuals that it leaves.

    Where it leaves none to speak of and a motor was not seen over its whole turn, ``auto`` takes the likeliest shape of
    the rest of the pulley instead.
    """
    if model not in _HYBRIDS or not isinstance(fit, GreyboxModel):
        return fit
    fit = with_residuals(fit, trace, seed=int(rng.integers(2**31)))
    if model == AUTO and not fit.findings and _is_partial(fit.box):
        return _with_guide_waves(learner("prior").fit(trace, printer, rng=rng), fit.box.mechanism.frame.waves)
    return fit


def _box_of(fit: WorldModel) -> GreyboxModel | None:
    """Return the grey box of what was learned, if there is one in it."""
    return fit.box if isinstance(fit, HybridModel) else fit if isinstance(fit, GreyboxModel) else None


def left_over_mm(box: GreyboxModel) -> np.ndarray:
    """Return what a machine leaves over of the measured points [N, 2] on the bed, NaN where nothing was measured."""
    residual = np.stack([drive.choice.fit.touch.residual_mm for drive in box.drives], axis=1)
    return np.asarray(box.printer.from_motor(residual))


def with_screw_found(model: SavedModel, found: ScrewFound, series: ScrewSeries | None, trace: Trace) -> SavedModel:
    """Add to a planar model what was found of Z; ``trace`` is the one with the push in it."""
    summary, *gaps = model.findings
    faults = [*model.document.get("diagnosis", []), *found.faults]
    details: dict[str, Any] = {"diagnosis": faults, Z_SAID: dict(found.said)}
    if "trace" in model.document:
        off = (trace.measured_mm - trace.commanded_mm)[trace.measured_rows]
        before_mm = float(np.sqrt(np.mean(np.square(off).sum(axis=1))))
        details["trace"] = {**model.document["trace"], "residual_before_mm": round(before_mm, 6)}
    findings = ("; ".join(filter(None, (summary, found.sentence))), *gaps, *found.gaps.values())
    return with_screw(model, series, findings=findings, details=details)


def _is_partial(fit: GreyboxModel) -> bool:
    """Tell whether a motor was not seen over its whole turn."""
    return any(drive.sight.angles < ALL_SEEN for drive in fit.drives)


def greybox_model(
    fit: GreyboxModel,
    trace: Trace,
    *,
    known_gaps: tuple[str, ...] | None = None,
    anew: tuple[str, ...] = (),
    more: Mapping[str, Any] | None = None,
    hybrid: HybridModel | None = None,
    old: SavedModel | None = None,
    explained_mm: np.ndarray | None = None,
    drifting_mm: float = 0.0,
) -> SavedModel:
    """Return a grey box as a saved model, its diagnosis and uncertainties included.

    A ``hybrid`` adds its residuals: a motor that has one is saved as tables.

    An update passes the ``known_gaps`` of the old model, whose print saw more: new ones count for motors learned
    ``anew`` only. ``more`` goes into the document; ``old`` is the model that is brought up to date;
    ``explained_mm`` [N, 2] is what found misfits do to the rows, motor by motor; ``drifting_mm`` the size of what
    changed in time and was not found to be any of them.
    """
    acts = acting(fit, trace, old, drifting_mm)
    fit = acts.fit
    diagnosis = diagnose(fit, doubt_of(trace))
    if known_gaps is not None:
        new = tuple(gap for gap in diagnosis.gaps if gap.startswith(tuple(f"{name} " for name in anew)))
        diagnosis = replace(diagnosis, gaps=(*known_gaps, *new))
    if acts.turn_rad:
        fit = replace(fit, mechanism=replace(fit.mechanism, frame=_turned(fit.mechanism, acts.turn_rad)))
    mechanism, branches = _anchored(fit, trace)
    details: dict[str, Any] = {
        "diagnosis": [
            {"part": f.part, "kind": f.kind, "value": round(f.value, 6), "sd": round(f.sd, 6), "unit": f.unit}
            for f in diagnosis.faults
        ],
        "trace": _trace_section(trace, fit, (hybrid or fit).residual_after_mm),
        "uncertainty": {drive.name: _uncertainty(drive) for drive in fit.drives},
        "promise": promise_section(acts, trace, explained_mm, *(() if hybrid is None else hybrid.left_and_doubt)),
        **(more or {}),
    }
    saved: list[Branches | None] = list(branches)
    added = () if hybrid is None else hybrid.findings
    if hybrid is not None:
        tables = list(mechanism.transmissions)
        for motor, residual in enumerate(hybrid.residuals):
            if residual is not None:
                tables[motor], saved[motor] = residual.added(tables[motor]), None
        mechanism = replace(mechanism, transmissions=(tables[0], tables[1]))
    return saved_model(
        mechanism,
        learner="greybox" if hybrid is None else "hybrid",
        branches=(saved[0], saved[1]),
        noise_mm=(hybrid or fit).noise_mm,
        findings=("; ".join((diagnosis.summary, *added)), *diagnosis.gaps),
        details=details,
    )


def _trace_section(trace: Trace, fit: GreyboxModel, left_mm: float) -> dict[str, Any]:
    """Return what a saved model tells of its measurement: rows, errors before and after, the instrument's scatter."""
    scatter_mm = instrument_scatter_mm(trace)
    off_mm = trace.measured_mm - trace.commanded_mm
    if len(fit.mechanism.frame.waves):  # the trace is free of these
        off_mm = off_mm + fit.mechanism.frame.waves_at_mm(trace.commanded_mm)
    told, lost = trace.measured_rows, told_lost(fit)
    few = len(lost) == len(trace) and 0 < lost.sum() <= MOST_LOST * told.sum()
    if few:  # what is left out is said by itself
        told = told & ~lost
        left_mm = min(left_mm, float(np.sqrt(np.nanmean(np.square(left_over_mm(fit)[told]).sum(axis=1)))))
    if not trace.placed:  # nobody knows where the plate lay
        off_mm = off_mm - off_mm[told].mean(axis=0)
    before_mm = float(np.sqrt(np.mean(np.square(off_mm[told]).sum(axis=1))))
    seen_mm = trace.commanded_mm[trace.measured_rows & ((np.arange(len(trace)) > 0) | (not trace.homed))]
    return {
        "rows": len(trace),
        "measured": fit.measured,
        **({"seen_mm": np.round([seen_mm.min(axis=0), seen_mm.max(axis=0)], 3).tolist()} if len(seen_mm) else {}),
        **({"left_out": int(lost.sum())} if few else {}),
        "residual_before_mm": round(before_mm, 6),
        "residual_after_mm": round(left_mm, 6),
        **({} if scatter_mm is None else {"instrument_mm": round(scatter_mm, 6)}),
    }


def _turned(mechanism: Mechanism, clockwise_rad: float) -> Frame:
    """Return the machine's frame turned about the middle of the bed."""
    printer, frame = mechanism.printer, mechanism.frame
    middle = np.array([printer.x.min_mm + printer.x.max_mm, printer.y.min_mm + printer.y.max_mm]) / 2
    cos, sin = np.cos(clockwise_rad), np.sin(clockwise_rad)
    turn = np.array([[cos, sin], [-sin, cos]])
    coefficients = turn @ frame.coefficients_mm
    coefficients[:, Frame.exponents.index((0, 0))] += middle - turn @ middle
    for axis, powers in enumerate(((1, 0), (0, 1))):
        coefficients[:, Frame.exponents.index(powers)] += frame.scale_mm * (turn - np.eye(2))[:, axis]
    return replace(frame, coefficients_mm=coefficients)


def _anchored(fit: GreyboxModel, trace: Trace) -> tuple[Mechanism, tuple[Branches, Branches]]:
    """Return the machine with its origin where the end stops put it, if the trace does not say where that is.

    A scan shows where marks lie to each other, not where on the bed. But the end stop stops the carriage at the
    home position by definition, so there the learned error is zero. Where the marks end too far from home to say what
    the error is there, the origin stays that of the trace.
    """
    branches = (fit.drives[0].branches, fit.drives[1].branches)
    if trace.placed or not trace.homed:
        return fit.mechanism, branches
    home_mm = fit.printer.to_motor(np.array(fit.printer.home_mm))
    doubt_mm = [float(np.max(drive.sd_mm(home_mm[[motor]]))) for motor, drive in enumerate(fit.drives)]
    if max(doubt_mm) > MOST_DOUBT_MM:
        return _unshifted(fit.mechanism, branches)
    homed = fit.mechanism.homed()
    moved = []
    for motor, one in enumerate(branches):
        shift_mm = homed.transmissions[motor].lower_mm[0] - fit.mechanism.transmissions[motor].lower_mm[0]
        powers = one.mean.powers_mm if len(one.mean.powers_mm) else np.zeros(1)
        moved.append(
            replace(one, mean=replace(one.mean, powers_mm=np.concatenate([powers[:1] + shift_mm, powers[1:]])))
        )
    return _unshifted(homed, (moved[0], moved[1]))


def _unshifted(
    mechanism: Mechanism, branches: tuple[Branches, Branches]
) -> tuple[Mechanism, tuple[Branches, Branches]]:
    """Return the machine without a shift that is all that a drive has: a scan's origin is no fault."""
    tables, kept = list(mechanism.transmissions), list(branches)
    for motor, one in enumerate(branches):
        powers = one.mean.powers_mm
        alone = replace(one, mean=replace(one.mean, powers_mm=np.zeros(len(powers))))
        if len(powers) and np.abs(powers[1:]).max(initial=0.0) < LEAST_POWER_MM and alone.is_healthy:
            kept[motor], tables[motor] = alone, healthy_transmission(mechanism.printer, motor)
    return replace(mechanism, transmissions=(tables[0], tables[1])), (kept[0], kept[1])


def known_digests(model: SavedModel) -> tuple[str, ...]:
    """Return the digests of the measurements that a model was learned from, where it says them."""
    digests = model.document.get(DIGESTS)
    return tuple(map(str, digests)) if isinstance(digests, list) else ()


def scatter_words(model: SavedModel) -> str:
    """Say by how much measured points scatter, and whose that is: only an instrument that tells its own scatter tells
    it from a printer's that lays each dot anew."""
    found, trace = PLANE_FACTOR * model.noise_mm, model.document.get("trace", {})
    own = PLANE_FACTOR * float(trace["instrument_mm"]) if "instrument_mm" in trace else None
    if own is None:
        return f"measuring, or the printer from dot to dot, scatters by {found:.3f} mm"
    if found <= DOUBTED_SCATTER * own:
        return f"measuring alone scatters by {found:.3f} mm"
    return f"the dots scatter by {found:.3f} mm where measuring does by {own:.3f}"


def report(model: SavedModel) -> str:
    """Return the diagnosis of a saved model as lines for a terminal."""
    first, *gaps = model.findings
    lines = [first]
    if "trace" in model.document:
        trace = model.document["trace"]
        without = f", {trace['left_out']} of them left out," if "left_out" in trace else ""
        lines.append(
            f"{trace['measured']} measured points{without} lie {trace['residual_before_mm']:.3f} mm off, typically; "
            f"{trace['residual_after_mm']:.3f} mm of that nothing explains, and {scatter_words(model)}"
        )
    return "\n".join(
        [
            *lines,
            *scale_words(model),
            *misfit_words(model.document),
            *still_words(model.document),
            *(f"not told by this trace: {gap}" for gap in gaps),
            *todo(gaps),
        ]
    )


def todo(gaps: Sequence[str]) -> tuple[str, ...]:
    """Return which prints would show what a trace did not tell."""
    of_z = {gap.startswith("Z ") for gap in gaps}
    return tuple(what for screw, what in ((False, _PROBE_TODO), (True, _TOWER_TODO)) if screw in of_z)


def _uncertainty(drive: LearnedDrive) -> dict[str, Any]:
    """Return the standard deviations of a drive's parameters, and of its branches where the trace went."""
    motor = np.linspace(*drive.branches.reach_mm, 201)
    lower, upper = drive.sd_mm(motor)
    sds, design = drive.choice.fit.posterior.sds, drive.choice.design
    return {
        "structure": {key: value for key, value in vars(drive.structure).items() if value not in (False, "none", 0)},
        "branch_sd_mm": round(float(np.sqrt(np.mean(np.concatenate([lower, upper]) ** 2))), 6),
        "largest_sd_mm": round(float(max(lower.max(), upper.max())), 6),
        "sd_mm": {
            name: np.round(sds[part], 6).tolist() for name, part in design.parts.items() if part.stop > part.start
        },
        "turns": round(drive.sight.turns, 2),
        "angles_seen": round(drive.sight.angles, 3),
        "reversals": drive.sight.reversals,
    }  # fmt: skip
