"""From a trace to the saved model of a machine: what `printmend learn` does.

A search among few effects gives the first contacts. One search then finds the effects that made the measurement. Their
mean acts; machines drawn from all likely sets are the promise.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from printmend.diagnosis.advice import gaps_of
from printmend.diagnosis.named import NOT_DOWN, Z_SAID, Lift, diagnose, find_lift, is_gap_of_z, misfits_of
from printmend.effects import EFFECTS, Of, Scene, scene_of
from printmend.effects.effect import SCALE_MM
from printmend.effects.prior import share_of
from printmend.effects.sized import Sized
from printmend.errors import ConfigError
from printmend.infer.fit import Fit, begun, fitted
from printmend.infer.machine import DRAWS, Part, machine_of, those_acting
from printmend.infer.posterior import posterior_of
from printmend.infer.scatter import independent_share
from printmend.infer.search import LEAST_SIGMA_MM
from printmend.learn import learner
from printmend.learn.order import once_in_order, roughly
from printmend.learn.rows import FINEST_MM, LEAST_ROWS, MOST_LOST, lost_rows, outliers_of, said_of_rows, skipped
from printmend.machine import Mechanism
from printmend.measure.checks import (
    check_origin,
    check_trace,
    digest_of,
    is_at_home,
    with_heights,
)
from printmend.measure.table import read_trace
from printmend.messages import is_one_of, say, together
from printmend.metrics.robust import log_likelihood, scale_of
from printmend.model import SavedModel, saved_model, with_screw
from printmend.model.branches import HARMONICS
from printmend.model.model import DIGESTS, NOTE, WARNING, Misfit, misfit_section, misfit_words
from printmend.path import Trace
from printmend.printer import Printer, preset_names, printer_of, read_printer
from printmend.promise.belief import belief_section
from printmend.promise.filament import UNTOLD
from printmend.promise.scatter import Scatter
from printmend.promise.words import scale_words, seen_scales, shown_scales
from printmend.twin import Twin

# Whose print is it? A table may be of a printer with the other kinematics, or of one that homes elsewhere.
#
# Pulleys and play of a printer with a motor for each axis go with x and y, those of a CoreXY with x + y and x − y: each
# leaves much of what the other one does. So drives of the other kinematics, roughly learned, are a rival of the model
# with all its effects, with odds of their own. A healthy printer's table could be either's.

SURE_ODDS = 19.0  # from which on an owner is asked whose table it is


def another_printers(fit: Fit, trace: Trace) -> tuple[Misfit, ...]:
    """Return a warning where a printer of the other kinematics explains a trace better than what was learned of it."""
    if trace.wall_rows.any():
        return ()
    is_corexy = fit.scene.corexy
    other = roughly(trace, replace(fit.scene.printer, kinematics="cartesian" if is_corexy else "corexy"))
    theirs_mm, ours_mm = other.left_by_mark_mm(trace), fit.left_by_mark_mm(trace)
    known = np.isfinite(theirs_mm + ours_mm).all(axis=1)
    if known.sum() < LEAST_ROWS:
        return ()
    their, our = (log_likelihood(each[known].ravel(), LEAST_SIGMA_MM) for each in (theirs_mm, ours_mm))
    share = min(independent_share(each, scale_of(each, FINEST_MM)) for each in ours_mm[known].T)  # what is no noise
    nats = share * (their - our) + _of_set(other) - _of_set(fit) + math.log(share_of("other_printer"))
    if nats < math.log(SURE_ODDS):
        return ()
    their_mm, our_mm = (math.sqrt(2) * scale_of(each[known], FINEST_MM) for each in (theirs_mm, ours_mm))
    told = "table-looks-printer-motor-each-axis" if is_corexy else "table-looks-corexy-made-printer-motor"
    return (Misfit("printer", WARNING, our_mm, nats, say(told, f"{their_mm:.2f}", f"{our_mm:.2f}")),)


def _of_set(fit: Fit) -> float:
    """Return the logarithm of the odds of a fit's effects, less what their freedom costs."""
    gram, state = fit.search.gram, fit.state
    left = gram.square - gram.slope[state.columns] @ state.mean_mm
    return state.score + 0.5 * (gram.count * math.log(state.sigma_mm**2) + float(left) / state.sigma_mm**2)


def another_home(trace: Trace, printer: Printer) -> tuple[Misfit, ...]:
    """Return a note if a table with positions on the bed does not begin at home: the print's shift is then unknown."""
    first = trace.commanded_mm[0]
    if is_at_home(first, printer):
        return ()
    home = f"{printer.home_mm[0]:g}", f"{printer.home_mm[1]:g}"
    if not trace.measured_rows[0] and any(is_at_home(first, read_printer(name)) for name in preset_names()):
        words = say("table-begins-where-other-printers-home", f"{first[0]:g}", f"{first[1]:g}", *home)
        return (Misfit("home", NOTE, 0.0, 0.0, words),)
    if not trace.placed:
        return ()
    return (Misfit("home", NOTE, 0.0, 0.0, say("table-does-not-begin-at-home", *home)),)


AUTO = "auto"
SEARCH = "printmend"  # the name of the search over effects: among learners, and in a model's file
PLANE_FACTOR = 2**0.5  # RMS distance on the bed over the standard deviation of one coordinate
DOUBTED_SCATTER = 2.0  # points that scatter by this factor more than their instrument says are reported
_TOWER_TODO = say("tower-two-turns-screw-measured-several")
_PROBE_TODO = say("printmend-probe-writes-print-shows-all")


@dataclass(frozen=True, eq=False)
class Learned:
    """A saved model and the search that it was made of (None where there was none), for the trace that it was fitted
    to: in order, its motors where they really went."""

    saved: SavedModel
    trace: Trace
    fit: Fit | None = None


def learn_model(
    trace: Trace | str | Path, printer: Printer | str | Path, *, model: str = AUTO,
    rng: np.random.Generator | None = None,
) -> SavedModel:  # fmt: skip
    """Learn a machine from a trace or its path, as `learn` does, and return its saved model; a ``printer`` may be
    named."""
    printer = printer_of(printer)
    trace = trace if isinstance(trace, Trace) else read_trace(trace, printer)
    return learn(trace, printer, model=model, rng=rng).saved


def learn(trace: Trace, printer: Printer, *, model: str = AUTO, rng: np.random.Generator | None = None) -> Learned:
    """Learn a machine from a trace.

    ``auto`` searches for the effects that made the measurement. Raises `TraceError` where the trace cannot support any,
    `ConfigError` where the named learner has no machine to mend with. ``rng`` draws the machines of the promise;
    without it every run draws the same.
    """
    rng = np.random.default_rng(0) if rng is None else rng
    # Threads of the linear algebra cost more than they bring on systems of a few hundred unknowns.
    with threadpool_limits(1, user_api="blas"):
        return _learned(trace, printer, model, rng)


def _learned(trace: Trace, printer: Printer, model: str, rng: np.random.Generator) -> Learned:
    check_origin(say("measurement-2"), trace.origin, printer)
    digests = (digest_of(trace),)
    ordered = once_in_order(trace, printer)
    told = (*ordered.found, *another_home(ordered.trace, printer))
    trace = with_heights(ordered.trace, printer)
    check_trace(trace, printer)
    if model not in (AUTO, SEARCH):
        return _learned_without_parts(trace, printer, model, told, rng)
    lift = find_lift(trace, printer)
    first, turned = begun(trace, scene_of(trace, printer))
    told = (*told, *skipped(trace, turned, printer))
    fit = fitted(turned, first.scene, first)
    return Learned(searched_model(fit, turned, told, {DIGESTS: list(digests)}, rng, lift), turned, fit)


def searched_model(
    fit: Fit, trace: Trace, told: Sequence[Misfit], more: Mapping[str, Any], rng: np.random.Generator,
    lift: Lift | None = None,
) -> SavedModel:  # fmt: skip
    """Return the model of the effects that a search found, and of how Z lifts."""
    posterior = posterior_of(fit, rng)
    posterior = replace(posterior, parts=enlarged(posterior.parts, 1.0 / times_seen(posterior.parts)))
    mechanism, branches = machine_of(fit.scene, those_acting(posterior.parts))
    left_mm = fit.left_by_mark_mm(trace)
    lost = lost_rows(left_mm, trace.rounding_mm)
    kept_mm = left_mm[np.isfinite(left_mm).all(axis=1) & ~lost]
    kept_mm = kept_mm if len(kept_mm) else fit.left_mm()[:, None]  # walls are no dots
    noise_mm = float(np.sqrt(np.mean(kept_mm**2)))
    free = max(kept_mm.size - fit.freedom, 1)  # of the kept numbers, those that no size takes up
    scatter = Scatter.of(float(np.sum(kept_mm**2)) / free, free, instrument_scatter_mm(trace))
    promise = belief_section(
        fit.scene, posterior.parts, scatter=scatter, outliers=outliers_of(left_mm, lost), motion=trace.motion
    )
    if not fit.scene.placed:
        promise["shown"] = shown_scales(fit.scene, posterior.parts)
        promise["seen"] = seen_scales(fit.scene, posterior.parts)
    told = (
        *told,
        *another_printers(fit, trace),
        *misfits_of(posterior.parts, fit.scene, posterior.nats),
        *said_of_rows(posterior, trace, left_mm, lost),
    )
    push_mm = push_of(posterior.parts)
    if lift is None and push_mm.any():
        lift = Lift(gaps={"lead": say("z-lead-backlash-no-heights-were")})
    diagnosis = diagnose(posterior.parts, fit.scene, gaps_of(fit), lift)
    details: dict[str, Any] = {
        "diagnosis": [fault.row for fault in diagnosis.faults],
        "trace": trace_section(trace, fit, posterior.parts, PLANE_FACTOR * noise_mm, lost),
        "promise": promise,
        "misfit": misfit_section(told),
        **more,
        **({} if lift is None else {Z_SAID: lift.said}),
    }
    saved = saved_model(
        mechanism, learner=SEARCH, branches=branches, noise_mm=noise_mm,
        findings=(diagnosis.summary, *diagnosis.gaps), details=details,
    )  # fmt: skip
    return with_z(saved, lift or Lift(), push_mm)


def with_z(model: SavedModel, lift: Lift, push_mm: np.ndarray) -> SavedModel:
    """Return a model with how its screw lifts, and with its push [2·HARMONICS, 2] as a series has it."""
    series = lift.with_push(model.printer.z.mm_per_turn, push_mm)
    return model if series is None else with_screw(model, series, findings=model.findings, details={})


def times_seen(parts: Sequence[Part]) -> np.ndarray:
    """Return the size of each drawn machine's print in its picture, over its own [D]."""
    resized = (part.draws_mm[0] for part in parts if part.effect == "resized")
    return np.asarray(1.0 + sum(resized, np.zeros(DRAWS)) / SCALE_MM)


def enlarged(parts: Sequence[Part], times: np.ndarray) -> tuple[Part, ...]:
    """Return parts with all sizes, except the instrument's, multiplied by ``times`` [D], machine by machine: a resized
    picture shows every error resized."""
    return tuple(
        part
        if EFFECTS[part.effect].of is Of.INSTRUMENT
        else replace(part, acts_mm=part.acts_mm * times.mean(), draws_mm=part.draws_mm * times)
        for part in parts
    )


def push_of(parts: Sequence[Part]) -> np.ndarray:
    """Return the push of the Z screw that acts [2·HARMONICS, 2], as a series has it: sine and cosine of each wave."""
    terms = np.zeros((2 * HARMONICS, 2))
    for part in parts:
        if part.effect == "wobble":
            cos, sin = part.acts_mm.reshape(2, -1)
            terms[:, part.where] += np.stack([sin, cos], axis=1).ravel()
    return terms


def _learned_without_parts(
    trace: Trace, printer: Printer, name: str, told: tuple[Misfit, ...], rng: np.random.Generator
) -> Learned:
    """Return the result of the learner ``name``, whose machine is not made of effects."""
    fit = learner(name).fit(trace, printer, rng=rng)
    if not isinstance(mechanism := getattr(fit, "mechanism", None), Mechanism):
        raise ConfigError(
            f"--learner {name}",
            wanted=say("learner-whose-model-machine-motors-belts"),
            came=say("only-predicts-steps-lattice"),
            todo=say("terminal-use-learner-auto-lightgbm-axis-cartesian"),
        )
    known = trace.measured_rows
    noise = float(np.sqrt(np.mean(np.square((trace.measured_mm - trace.commanded_mm)[known]))))
    left = (trace.measured_mm - Twin(mechanism).follow(trace.commanded_mm))[known]
    left = left if trace.placed else left - left.mean(axis=0)
    scene = scene_of(trace, printer)
    details = {"misfit": misfit_section(told), "promise": belief_section(scene, _left_by_place(scene, left))}
    findings = (say("learned-by-other", name),)
    saved = saved_model(mechanism, learner=name, noise_mm=noise, findings=findings, details=details)
    return Learned(saved, trace)


def _left_by_place(scene: Scene, left_mm: np.ndarray) -> list[Part]:
    """Return the residuals [N, 2] of a learner without uncertainty as errors of both motors by place; each may come
    again at any place."""
    rng = np.random.default_rng(0)
    size_mm = np.sqrt(np.mean(np.square(scene.printer.to_motor(left_mm)), axis=0))
    found: list[Part] = []
    for term in EFFECTS["uneven"].terms(scene):
        profile = np.array(term.sd_mm)
        if term.where == len(found):  # the first of a motor's: any size will do
            profile *= size_mm[term.where] / np.sqrt(np.sum(profile**2) / 2)
            draws = profile[:, None] * rng.standard_normal((len(profile), DRAWS))
            found.append(Part(term.effect, term.where, term.shape, np.zeros(len(profile)), draws))
    return found


def instrument_scatter_mm(trace: Trace) -> float | None:
    """Return the standard deviation of a coordinate that the instrument states, None where it states none.

    None for walls, too: their stated deviation was estimated from their own scatter, the printer's included.
    """
    stated = np.zeros(0) if trace.sigma_mm is None else trace.sigma_mm[trace.measured_rows]
    stated = stated[np.isfinite(stated) & (stated > 0)]
    if not len(stated) or trace.wall_rows.any():
        return None
    return float(np.hypot(max(np.median(stated), trace.rounding_mm), trace.instrument_doubt.wave_mm))


def errors_mm(trace: Trace, fit: Fit, parts: Iterable[Sized], told: np.ndarray) -> np.ndarray:
    """Return how far each row [N, 2] was printed from where it was commanded; ``told`` [N] are the rows that count.

    What ``parts`` say that the instrument and its origin did is no error, nor is the width of the beads, nor the mean
    shift of an unplaced print. Shrinkage, real or apparent, is one. A turn of dots counts, a turn of walls does not.
    """

    def is_taken_off(effect: str) -> bool:
        if effect == "turn":
            return bool(trace.wall_rows.any())
        if effect == "stretch":  # of a part that shrank, nobody knows whose the scale is
            return trace.shrinkage_sd is None
        return effect == "bead" or EFFECTS[effect].of is Of.INSTRUMENT

    shrank_mm = trace.shrunk * (trace.commanded_mm - fit.scene.middle_mm)
    moved_mm = shrank_mm + fit.moved_mm(part for part in parts if is_taken_off(part.effect))
    off_mm = trace.measured_mm - trace.commanded_mm - moved_mm
    if trace.normal is None or trace.offset_mm is None:
        return off_mm if trace.placed else off_mm - off_mm[told].mean(axis=0)  # nobody knows where the plate lay
    across_mm = trace.offset_mm - np.sum(moved_mm * trace.normal, axis=1)  # walls show no more
    if not trace.placed:
        some = told & trace.wall_rows
        shift_mm, *_ = np.linalg.lstsq(trace.normal[some], across_mm[some], rcond=None)
        across_mm, off_mm = across_mm - trace.normal @ shift_mm, off_mm - shift_mm
    return np.where(trace.wall_rows[:, None], across_mm[:, None] * trace.normal, off_mm)


def trace_section(
    trace: Trace, fit: Fit, parts: Sequence[Part], left_mm: float, lost: np.ndarray | None = None
) -> dict[str, Any]:
    """Return a saved model's section about its measurement: rows, errors before and after, the instrument's scatter.

    Points ``lost`` [N] that the model leaves out are counted, and are not among these errors.
    """
    scatter_mm = instrument_scatter_mm(trace)
    told = trace.measured_rows
    seen_mm = trace.commanded_mm[told & ((np.arange(len(trace)) > 0) | (not trace.homed))]
    count, measured = 0 if lost is None else int(lost.sum()), int(told.sum())
    if lost is not None and 0 < count <= MOST_LOST * measured:
        told = told & ~lost
    off_mm = errors_mm(trace, fit, (Sized(*part.key, part.mean_mm) for part in parts), told)[told]
    on_bed = PLANE_FACTOR if trace.wall_rows.any() else 1.0  # a wall shows what lies across it
    return {
        "rows": len(trace),
        "measured": measured,
        **({"seen_mm": np.round([seen_mm.min(axis=0), seen_mm.max(axis=0)], 3).tolist()} if len(seen_mm) else {}),
        **({"left_out": count} if told.sum() < measured else {}),
        "residual_before_mm": round(on_bed * float(np.sqrt(np.mean(np.square(off_mm).sum(axis=1)))), 6),
        "residual_after_mm": round(left_mm, 6),
        **({} if scatter_mm is None else {"instrument_mm": round(scatter_mm, 6)}),
    }


def known_digests(model: SavedModel) -> tuple[str, ...]:
    """Return the digests of the measurements that a model was learned from, if it has them."""
    return tuple(model.document.get(DIGESTS, ()))


def scatter_words(model: SavedModel) -> str:
    """Say by how much measured points scatter, and why. Only if the instrument states its own scatter can that be
    separated from the printer's."""
    found, trace = PLANE_FACTOR * model.noise_mm, model.document.get("trace", {})
    own = PLANE_FACTOR * float(trace["instrument_mm"]) if "instrument_mm" in trace else None
    if own is None:
        return say("scatter-of-either", f"{found:.3f}")
    if found <= DOUBTED_SCATTER * own:
        return say("scatter-of-measuring", f"{found:.3f}")
    return say("scatter-of-dots", f"{found:.3f}", f"{own:.3f}")


def report(model: SavedModel) -> str:
    """Return the diagnosis of a saved model as lines for a terminal."""
    first, *gaps = model.findings
    lines = [first]
    if "trace" in model.document:
        trace = model.document["trace"]
        sizes = (f"{trace['residual_before_mm']:.3f}", f"{trace['residual_after_mm']:.3f}", scatter_words(model))
        if "left_out" in trace:
            lines.append(say("error-before-without", trace["measured"], trace["left_out"], *sizes))
        else:
            lines.append(say("error-before", trace["measured"], *sizes))
    not_shown = (say("not-shown-by-trace", gap) for gap in gaps)
    return together("\n", [*lines, *scale_words(model), *misfit_words(model.document), *not_shown, *todo(gaps)])


def todo(gaps: Sequence[str]) -> tuple[str, ...]:
    """Return the prints that would close a trace's gaps."""
    # no print of ours tells whose a scale is; of a nut's play its gap says what is missing
    of_z = {is_gap_of_z(gap) for gap in gaps if not is_one_of(gap, (*UNTOLD, NOT_DOWN))}
    return tuple(what for screw, what in ((False, _PROBE_TODO), (True, _TOWER_TODO)) if screw in of_z)
