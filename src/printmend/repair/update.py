"""Bring a saved model up to date with a second, smaller print, and say what changed: Bayes, the old one as the prior.

For each motor the posterior of the old print, widened by what a machine drifts, is the prior of the new one. How much
it drifted is what makes the new trace most likely, so that a machine that did not change stays as it was. The time
since then widens the prior, too, and the wear seen so far moves it: a random walk with drift (`Ageing`). Where even
that leaves more noise than learning from the new trace alone, the part was replaced: start anew.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from printmend.diagnosis.diagnosis import LEAST_FAULT_MM, NAMED_SIGMAS, Doubt, amount, doubt_of
from printmend.errors import ModelError, TraceError
from printmend.identify.drive import NOTHING, Choice, Rows, Structure, contacts, normal_equations
from printmend.identify.drive.fit import (
    LEAST_SIGMA_MM,
    Fit,
    Posterior,
    Prior,
    independent_share,
    lower_inverse,
    robust_sigma_mm,
    robust_weights,
)  # fmt: skip
from printmend.learn.greybox import (
    Drift,
    Greybox,
    GreyboxModel,
    Remembered,
    aged,
    model_of,
    motor_rows,
    remember,
    with_belts,
)
from printmend.learn.hybrid import with_residuals
from printmend.learn.walls import with_walls
from printmend.machine import Mechanism, print_from_home
from printmend.measure.once import counted_once, digest_of
from printmend.measure.whose import check_origin
from printmend.path import Trace
from printmend.printer import Printer
from printmend.promise.effects import CARRIED, parse_effects
from printmend.promise.misfit import NOTE, Misfit, misfit_section
from printmend.promise.misfit_rows import passed_over
from printmend.promise.misfit_tests import LEAST_COST_MM, UNSEEN, causes_of, effects_of, found_in, wandering
from printmend.promise.rails import freed
from printmend.repair.history import Ageing
from printmend.repair.learned import DIGESTS, greybox_model, known_digests
from printmend.repair.screw_update import screw_changes, seen_screw, with_seen_screw
from printmend.saved.model import SavedModel

PHASES = 48  # angles by which the pulley may have turned on its shaft that are tried
TURNED_SHARE = 0.5  # another angle must leave less than this share of the residual: pulleys rarely turn
# How far a machine may have drifted, from one that stayed as it was to one with another pulley. The evidence chooses.
DRIFTS = (
    Drift(0.02, 0.02, 0.1), Drift(1, 0.02, 0.1), Drift(1, 1, 0.1), Drift(1, 1, 1), Drift(3, 3, 5), Drift(5, 5, 25),
)  # fmt: skip
SYMMETRIC_SHARE = 0.98  # a turn of the pulley that matches to this share of the best match is as good
# Share of the usual drift of a print's place, where it lay as the old one did: homing repeats to 0.01 mm.
SAME_PLACE = 0.002
FIT_PASSES = 8  # most rounds of fitting
REPLACED_SHARE = 0.85  # where learning anew leaves less than this share of the noise, the part was replaced
RESIZED_PERCENT = 1.0  # a pulley whose scale changed by more has another size
REFUTED_RATIO = 1.3  # an old model that leaves so many times the residual of a fresh fit is wrong …
ALIKE_RATIO = 1.25  # … if the fresh fit leaves less than so many times the noise of the updated one
LEAST_SKEW_DEG = 0.02  # a smaller change of the skew is not worth a word
LEAST_RESCALE_PERCENT = 0.02  # and no smaller change of the scale
DIFFERENCE_FACTOR = 2**0.5  # standard deviation of the difference of two measurements over that of each
LEAST_CHANGE_MM = 0.01  # a smaller change is not worth a word
PLAIN_CHANGE_MM = 0.05  # a larger change is plain: it is told with two decimals


@dataclass(frozen=True)
class Change:
    """One quantity of one motor before and now, ``sd`` that of the difference."""

    part: str
    kind: str
    before: float
    now: float
    sd: float
    unit: str
    words: str


@dataclass(frozen=True, eq=False)
class Updated:
    """The new model, what changed, and the motors that had to be learned anew; ``is_known`` where the model was learned
    from this measurement, and stays as it was. ``missed_mm`` is how far the measurement lies from where the old model
    has it and from where a printer without faults would, root mean square, where the old model is no help."""

    model: SavedModel
    changes: tuple[Change, ...]
    anew: tuple[str, ...]
    is_known: bool = False
    missed_mm: tuple[float, float] | None = None

    @property
    def words(self) -> str:
        """Say what changed."""
        if self.is_known:
            return "the model was learned from this very measurement: it is counted once, and nothing changes"
        rows = [change.words for change in self.changes]
        rows += [f"{name} is not the one that the old model knew: learned anew" for name in self.anew]
        if len(self.anew) == len(self.model.printer.motors):
            rows.append("nothing of the old model is left: is this measurement of the same printer?")
        elif self.missed_mm is not None:
            old_mm, healthy_mm = self.missed_mm
            rows.append(
                f"the old model is {old_mm:.3f} mm off, a printer without faults {healthy_mm:.3f}: is this measurement "
                "of the same printer, with other parts?"
            )
        return "\n".join(rows or ["nothing changed by more than this trace can tell"])


def update(old: SavedModel, trace: Trace, *, rng: np.random.Generator, ageing: Ageing | None = None) -> Updated:
    """Update ``old`` with a trace of the same printer, which may be small.

    ``ageing`` says how long ago the old measurement was, and what was seen of wear: the older, the less it weighs.
    A measurement that the model was learned from is counted once: it changes nothing. Raises `ModelError` for a model
    that is not a grey box, `TraceError` like `learn`.
    """
    check_origin("the measurement", trace.origin, old.printer)
    digest = digest_of(trace)
    if digest in known_digests(old):
        return Updated(old, (), (), is_known=True)
    with threadpool_limits(1, user_api="blas"):
        trace, copies = counted_once(trace)
        trace = with_walls(trace, old.printer)
        screw = seen_screw(old, trace)
        guides_mm = old.mechanism.frame.waves_at_mm(trace.commanded_mm)
        updated = _updated(old, freed(screw.trace, guides_mm), rng, ageing, digest, passed_over(trace, copies))
        changes = tuple(
            Change("Z", words=f"Z {one['kind']} was {one['before']:.3f}, is {one['now']:.3f} {one['unit']}", **one)
            for one in screw_changes(old, screw)
        )
        model = updated.model
        if screw.said or screw.gaps or old.mechanism.screw is not None:
            model = with_seen_screw(old, model, screw, trace)
        return replace(updated, model=model, changes=(*updated.changes, *changes))


def same_machine(old: SavedModel, printer: Printer) -> None:
    """Raise `ModelError` where a model is of another machine than ``printer``."""
    if old.printer != printer:
        raise ModelError(
            "--update", wanted=f"a model of {printer.name}", came=f"one of {old.printer.name}, or with other axes",
            todo="leave --printer out, or name the printer of the old model",
        )  # fmt: skip


def _updated(
    old: SavedModel, trace: Trace, rng: np.random.Generator, ageing: Ageing | None, digest: str,
    said: tuple[Misfit, ...],
) -> Updated:  # fmt: skip
    printer = old.printer
    past = [remember(old, motor) for motor in range(2)]
    prior = past
    if ageing is not None:
        prior = [aged(one, ageing.months / 12, ageing.of(name)) for one, name in zip(past, printer.motors, strict=True)]
    if len(trace) < 2 or not np.isfinite(trace.commanded_mm).all():
        raise TraceError("trace", wanted="every commanded way-point", came="none or NaN", todo="check the trace")
    fresh = Greybox().fit(trace, printer, rng=rng)
    if (off_mm := wandering_mm(fresh, trace)) > LEAST_COST_MM:
        raise TraceError(
            "the measurement", wanted="one that knows its place to bring a model up to date",
            came=f"one that wanders: place and scale may be off by {off_mm:.2f} mm",
            todo="fix what measures, let it warm up, and measure again",
        )  # fmt: skip
    rows = [
        replace(row, origin_mm=one.branches.middle_mm)
        for row, one in zip(motor_rows(trace, printer, _turns_mm(past)), past, strict=True)
    ]
    chosen = [_updated_choice(row, one) for row, one in zip(rows, prior, strict=True)]
    if any(choice.structure.cross for choice in chosen):
        rows = with_belts(rows, chosen)
        chosen = [_updated_choice(row, one) for row, one in zip(rows, prior, strict=True)]
    anew = [
        _is_replaced(row, one, drive.choice, choice)
        for row, one, drive, choice in zip(rows, prior, fresh.drives, chosen, strict=True)
    ]
    if any(anew):
        chosen = [
            drive.choice if new else choice for drive, choice, new in zip(fresh.drives, chosen, anew, strict=True)
        ]
        rows = [
            replace(row, origin_mm=drive.branches.middle_mm, period_mm=drive.branches.period_mm) if new else row
            for row, drive, new in zip(rows, fresh.drives, anew, strict=True)
        ]
    fit = _with_sight(model_of(trace, printer, rows, chosen), past, anew, old.mechanism.frame.waves)
    changes = [
        change
        for motor, one in enumerate(past)
        if not anew[motor]
        for change in _changes(printer.motors[motor].upper(), one, chosen[motor], doubt_of(trace))
    ]
    names = tuple(name.upper() for name, new in zip(printer.motors, anew, strict=True) if new)
    details: dict[str, Any] = {"update": _update_section(old, changes, names)}
    details["misfit"], explained = _misfit_told(old, fit, trace, said, is_anew=any(anew))
    details[DIGESTS] = [*known_digests(old), digest]
    gaps = [gap for gap in old.findings[1:] if not any(gap.startswith(f"{name} ") for name in names)]
    return Updated(
        greybox_model(
            fit, trace, known_gaps=tuple(gaps), anew=names, more=details, old=None if any(anew) else old,
            explained_mm=explained,
        ),
        tuple(changes),
        names,
        missed_mm=_missed_mm(old, trace),
    )  # fmt: skip


def wandering_mm(fresh: GreyboxModel, trace: Trace) -> float:
    """Return by how much [mm] place and scale of a table may be off because what measures wanders, 0 where it does not:
    two standard deviations.

    ``fresh`` is what the table alone says. An error that goes with place does not wander: what a learned remainder
    leaves is looked at before it counts.
    """
    if not trace.instrument_doubt.is_exact:  # a scan sees all marks at once
        return 0.0
    effects, _ = effects_of(fresh, trace, causes_of(fresh, trace))
    if not wandering(fresh, trace, effects)[0]:
        return 0.0
    drift_mm, _ = wandering(fresh, trace, effects, with_residuals(fresh, trace, seed=0).left_mm)
    return 3**0.5 * drift_mm  # where an even drift of that size ends, from its mean


def _missed_mm(old: SavedModel, trace: Trace) -> tuple[float, float] | None:
    """Return how far a measurement lies from where an old model has it and from where a printer without faults would,
    wherever the plate lay; None where the old model is nearer, as it is to a printer whose fault has grown.

    The measurement is free of what the old model's wavy guides do; here they count again.
    """
    known = trace.measured_rows
    if not known.any():
        return None
    wanted = trace.commanded_mm
    printed = trace.measured_mm + old.mechanism.frame.waves_at_mm(wanted)
    both = (print_from_home(old.mechanism, wanted), wanted)
    left, whole = (float(np.sqrt(np.var((printed - each)[known], axis=0).sum())) for each in both)
    return (left, whole) if left**2 - whole**2 > PLAIN_CHANGE_MM**2 else None


def _update_section(old: SavedModel, changes: list[Change], anew: tuple[str, ...]) -> dict[str, Any]:
    """Return what the updated model's file says of the update."""
    plain = [
        {"part": c.part, "kind": c.kind, "before": round(c.before, 6), "now": round(c.now, 6), "sd": round(c.sd, 6),
         "unit": c.unit}
        for c in changes
    ]  # fmt: skip
    return {"from": old.digest, "changes": plain, "anew": list(anew)}


def _misfit_told(
    old: SavedModel, fit: GreyboxModel, trace: Trace, said: tuple[Misfit, ...], *, is_anew: bool
) -> tuple[dict[str, Any], np.ndarray]:
    """Return the section of what does not fit, and what that does to the rows, motor by motor [N, 2] mm."""
    causes = causes_of(fit, trace)
    effects, explained = effects_of(fit, trace, causes)
    found = found_in(fit, trace, causes)
    if not is_anew:  # the old print's places stay seen, however small the new one is
        found = (*(each for each in found if each.kind != UNSEEN), *_still_said(old, UNSEEN))
    # a new print is learned without the old model's wavy guides
    guides = tuple(each for each in parse_effects(old.document) if (each.kind, each.state) == ("rail-wave", CARRIED))
    found = (*(_still_said(old, "rail-wave") if guides else ()), *found)
    return misfit_section((*said, *found), (*guides, *effects)), explained


def _still_said(old: SavedModel, kind: str) -> list[Misfit]:
    """Return what an old model said that a new print does not tell: places never measured, guides."""
    section = old.document.get("misfit")
    rows = section.get("found", []) if isinstance(section, dict) else []
    words = [str(row.get("words")) for row in rows if isinstance(row, dict) and row.get("kind") == kind]
    return [Misfit(kind, NOTE, 0.0, 0.0, each) for each in words]


def _turns_mm(past: list[Remembered]) -> tuple[float, float]:
    return (past[0].branches.period_mm, past[1].branches.period_mm)


def _with_sight(fit: GreyboxModel, past: list[Remembered], anew: list[bool], guides: np.ndarray) -> GreyboxModel:
    """Keep what the old print saw of axes, turns and ``guides``, the frame's waves [K, 6]: a small print must not make
    the rest unknown."""
    drives, tables = [], []
    for motor, (drive, one, new) in enumerate(zip(fit.drives, past, anew, strict=True)):
        (low, high), (old_low, old_high) = drive.branches.reach_mm, one.branches.reach_mm
        reach = (low, high) if new else (min(low, old_low), max(high, old_high))
        seen = drive.sight if new else replace(drive.sight, angles=max(drive.sight.angles, one.seen))
        drive = replace(drive, branches=replace(drive.branches, reach_mm=reach), sight=seen)
        drives.append(drive)
        tables.append(drive.branches.lower(fit.printer, motor))
    mechanism = Mechanism(fit.printer, (tables[0], tables[1]), replace(fit.mechanism.frame, waves=guides))
    return replace(fit, mechanism=mechanism, drives=(drives[0], drives[1]))


def _updated_choice(rows: Rows, past: Remembered) -> Choice:
    """Return what a motor's drive is like by now, given the old one as the prior.

    It takes the angle of the pulley that fits best, the likeliest drift, and no new part without support.
    """
    phases = np.arange(PHASES) * (2 * np.pi / PHASES)
    phase = 0.0
    if past.values[past.design.mask("mean")].any():
        losses = [_loss_mm(past, past.turned(float(turn)), rows) for turn in phases]
        best = int(np.argmin(losses))
        phase = float(phases[best]) if losses[best] < TURNED_SHARE * losses[0] else 0.0
    active = np.ones(past.design.size, bool)
    fit = _likeliest(rows, past, active, phase)
    if (unneeded := _unneeded(past, fit)).any():
        active &= ~unneeded
        fit = _likeliest(rows, past, active, phase)
    if _is_only_placed(past, fit):
        values = np.zeros(past.design.size)
        post = replace(fit.posterior, values=values)
        return Choice(NOTHING, past.design, replace(fit, posterior=post, touch=contacts(past.design, values, rows)))
    return Choice(_structure(past, active), past.design, fit)


def _is_replaced(rows: Rows, past: Remembered, fresh: Choice, updated: Choice) -> bool:
    """Say whether a fresh fit should take the place of the updated one: the old model was of another part.

    Either it leaves clearly less noise (any less where the pulley has another size: none grows by wear), or it finds a
    healthy motor where the old model's fault can no longer be seen.
    """
    ratio = fresh.fit.posterior.sigma_mm / updated.fit.posterior.sigma_mm
    at = past.design.scale_at
    resized = abs(updated.fit.posterior.values[at] - past.values[at]) > RESIZED_PERCENT
    if ratio < (1.0 if resized else REPLACED_SHARE):
        return True
    values = past.values.copy()
    if not resized:  # another scanner's scale is no other part
        values[at] = updated.fit.posterior.values[at]
    refuted = _loss_mm(past, values, rows) > REFUTED_RATIO * fresh.fit.loss_mm
    return _is_healthy(fresh) and refuted and ratio < ALIKE_RATIO


def _is_healthy(choice: Choice) -> bool:
    return choice.structure.pulley == "none" and choice.structure.play == "none"


def _loss_mm(past: Remembered, values: np.ndarray, rows: Rows) -> float:
    """Return the mean |residual| of parameters [P], whatever the plate's place."""
    residual = contacts(past.design, values, rows).residual_mm[rows.weight > 0]
    return float(np.abs(residual - np.median(residual)).mean())


def _likeliest(rows: Rows, past: Remembered, active: np.ndarray, phase: float) -> Fit:
    """Return the fit under the drift with the most evidence, then with the measurement where the old one lay."""
    # A pulley that turned is not known to have turned by one of the tried phases exactly.
    drifts = [drift for drift in DRIFTS if phase == 0.0 or drift.scale >= 1]
    fits = [(_fit(rows, past, active, phase, drift), drift) for drift in drifts]
    fit, drift = max(fits, key=lambda pair: pair[0].posterior.log_evidence)
    placed = _fit(rows, past, active, phase, replace(drift, place=SAME_PLACE))
    return placed if placed.posterior.log_evidence > fit.posterior.log_evidence else fit


def _fit(rows: Rows, past: Remembered, active: np.ndarray, phase: float, drift: Drift) -> Fit:
    """Iterate contacts and least squares about the prior; return the pass with the largest evidence."""
    mean = np.where(active, past.turned(phase), 0.0)
    prior = past.covariance(phase, drift)[np.ix_(active, active)] + 1e-12 * np.eye(int(active.sum()))
    whitened = lower_inverse(np.linalg.cholesky(prior))
    precision = whitened.T @ whitened
    log_prior = np.linalg.slogdet(prior)[1]
    measured = rows.weight > 0
    values = _placed(past, mean, rows)
    best: Fit | None = None
    for _ in range(FIT_PASSES):
        touch = contacts(past.design, values, rows)
        residual = touch.residual_mm[measured]
        sigma = robust_sigma_mm(residual)
        share = independent_share(residual, sigma)
        weight = robust_weights(rows, touch.residual_mm, sigma, drop=False)
        plain = normal_equations(past.design, values, rows, touch, weight)
        normal = plain.tempered(share)
        matrix = normal.matrix[np.ix_(active, active)]
        away = (values - mean)[active]  # about the prior's mean
        slope = normal.slope[active] + matrix @ away
        sigma2 = max(sigma**2, LEAST_SIGMA_MM**2)
        for _ in range(3):
            whitened = lower_inverse(np.linalg.cholesky(matrix / sigma2 + precision))
            step = whitened.T @ (whitened @ (slope / sigma2))
            change = step - away
            misfit = max(normal.square - 2 * normal.slope[active] @ change + change @ matrix @ change, 0.0)
            covariance = whitened.T @ whitened
            known = len(step) - float(np.trace(covariance @ precision))
            sigma2 = max(misfit / max(normal.count - known, 1.0), LEAST_SIGMA_MM**2)
        log_det = log_prior - 2 * np.log(np.diag(whitened)).sum()
        evidence = -0.5 * (misfit / sigma2 + step @ precision @ step + log_det + normal.count * np.log(sigma2))
        values = np.zeros(past.design.size)
        values[active] = mean[active] + step
        post = Posterior(values, covariance, active, float(np.sqrt(sigma2)), Prior(), float(evidence))
        loss = float(np.abs(residual).mean())
        fit = Fit(post, plain, touch, loss, share)
        if best is None or evidence > best.posterior.log_evidence:
            best = fit
    assert best is not None
    final = contacts(past.design, best.posterior.values, rows)
    return replace(best, touch=final, loss_mm=float(np.abs(final.residual_mm[measured]).mean()))


def _placed(past: Remembered, values: np.ndarray, rows: Rows) -> np.ndarray:
    """Shift the prior's mean to where the plate was measured, so that the first contacts are right."""
    residual = contacts(past.design, values, rows).residual_mm
    placed = values.copy()
    placed[past.design.place_at] += float(np.nanmedian(residual))
    return placed


def _unneeded(past: Remembered, fit: Fit) -> np.ndarray:
    """Mark the parameters [P] of parts that the old model did not have and that the trace does not demand."""
    design, post = past.design, fit.posterior
    parts = ("play_powers",), ("cross",), ("mean",), ("mean_powers",)
    unneeded = np.zeros(design.size, bool)
    at = np.flatnonzero(post.active)
    for names in parts:
        new = design.mask(*names) & ~past.known & post.active
        new[design.place_at] = False  # the plate's place is always open
        if not new.any():
            continue
        inside = np.isin(at, np.flatnonzero(new))
        w = post.values[new]
        chi2 = float(w @ np.linalg.solve(post.covariance[np.ix_(inside, inside)], w))
        negative = names == ("play_powers",) and w[0] <= 0  # no belt has less than no play
        if negative or chi2 < new.sum() + NAMED_SIGMAS * np.sqrt(2 * new.sum()) + NAMED_SIGMAS**2:
            unneeded |= new
    return unneeded


def _is_only_placed(past: Remembered, fit: Fit) -> bool:
    """Tell whether a motor that was healthy still is: all that is left is a place which measuring alone explains."""
    post = fit.posterior
    place = past.design.place_at
    if past.values.any() or np.delete(post.values, place).any() or not post.active[place]:
        return False
    return abs(float(post.values[place])) < NAMED_SIGMAS * float(post.sds[place])


def _structure(past: Remembered, active: np.ndarray) -> Structure:
    """Return the structure that the diagnosis names."""
    design, parts = past.design, past.design.parts
    harmonics = design.play_harmonics
    play = "free" if any(k % 2 == 0 for k in harmonics) else "loose" if harmonics else "constant"
    cross = max((p + q for p, q in np.array(design.cross)[active[parts["cross"]]].tolist()), default=0)
    return Structure(
        offset=True,
        scale=bool(active[design.scale_at]),
        drift=design.mean_powers > 2,
        cross=cross,
        ripple=bool(design.ripple),
        pulley="all" if (active & design.mask("mean")).any() else "none",
        play=play if active[parts["play_powers"]].any() else "none",
        friction=design.play_powers > 1,
        elastic=bool(design.elastic_harmonics),
        second_mm=design.second_mm,
    )


def _changes(name: str, past: Remembered, now: Choice, doubt: Doubt) -> list[Change]:
    """Compare the motor's play, scale, skew, pulley and its phase; a change must exceed NAMED_SIGMAS standard
    deviations.

    ``doubt`` is what the points of each of both measurements share: two scans differ by more than their marks do.
    """
    design, post = past.design, now.fit.posterior
    sds, found = post.sds, []

    def compare(kind: str, what: str, before: float, after: float, sd: float, unit: str, least: float) -> None:
        if abs(after - before) > max(NAMED_SIGMAS * sd, least):
            verb = "grew" if abs(after) > abs(before) else "shrank"
            digits, space = 2 if abs(after - before) >= PLAIN_CHANGE_MM else 3, "" if unit == "°" else " "
            old, new = (round(value, digits) + 0.0 for value in (before, after))  # never −0
            words = f"{name} {what} {verb} from {old:.{digits}f} to {new:.{digits}f}{space}{unit} (± {sd:.3f})"
            found.append(Change(name, kind, before, after, sd, unit, words))

    at = design.play_at
    known, seen = (max(float(values[at]), 0.0) for values in (past.values, post.values))  # as the tables have it
    compare("play", "belt play", known, seen, float(np.hypot(past.sds[at], sds[at])), "mm",
            LEAST_CHANGE_MM)  # fmt: skip
    at = design.scale_at
    sd = float(np.linalg.norm([past.sds[at], sds[at], DIFFERENCE_FACTOR * doubt.scale_percent]))
    compare("scale", "scale error", past.values[at], post.values[at], sd, "%", LEAST_RESCALE_PERCENT)
    if design.cross and design.cross[0] == (0, 1):  # mm in 100 mm
        at = design.cross_at
        before, after = (float(np.degrees(np.arctan(values[at] / 100))) for values in (past.values, post.values))
        sd = float(np.hypot(np.degrees(np.hypot(past.sds[at], sds[at]) / 100), DIFFERENCE_FACTOR * doubt.skew_deg))
        compare("skew", "axis' skew", before, after, sd, "°", LEAST_SKEW_DEG)
    turn, turn_sd = _pulley_turn(past, post, sds, doubt.wave_mm)
    if _keeps_shape(past, post) and abs(turn) > max(NAMED_SIGMAS * turn_sd, _least_turn_deg(past)):
        words = f"{name} pulley turned on its shaft by {amount(turn, turn_sd, '°')}"
        found.append(Change(name, "phase", 0.0, turn, turn_sd, "°", words))
    for i, k in enumerate(design.waves("mean")[:4]):
        both = design.wave_at("mean", i)
        before, after = (float(np.hypot(*v[both])) * k for v in (past.values, post.values))
        sd = float(np.sqrt(np.mean(past.sds[both] ** 2 + sds[both] ** 2) + 2 * doubt.wave_mm**2)) * k
        shape = {1: "eccentricity", 2: "ovalness", 3: "three corners", 4: "four corners"}[int(k)]
        compare(f"harmonic-{k}", f"pulley's {shape}", before, after, sd, "mm", max(LEAST_CHANGE_MM, LEAST_FAULT_MM * k))
    return found


def _keeps_shape(past: Remembered, post: Posterior) -> bool:
    """Say whether the pulley is still as uneven as it was, by half: else its phase means nothing."""
    at = past.design.mask("mean")
    old, new = (float(np.linalg.norm(values[at])) for values in (past.values, post.values))
    return new > 0.5 * old


def _least_turn_deg(past: Remembered) -> float:
    """Return the turn [°] of the pulley that moves a print by twice the least change worth a word."""
    size_mm = float(np.linalg.norm(past.values[past.design.mask("mean")]))
    return float(np.degrees(2 * LEAST_CHANGE_MM / max(size_mm, LEAST_CHANGE_MM)))


def _pulley_turn(past: Remembered, post: Posterior, sds: np.ndarray, wave_mm: float) -> tuple[float, float]:
    """Return by how many degrees the pulley turned: the largest correlation of old and new harmonics; and its sd."""
    cos_at, sin_at = past.design.parts["mean_cos"], past.design.parts["mean_sin"]
    k = past.design.waves("mean")
    old = past.values[cos_at] - 1j * past.values[sin_at]
    new = post.values[cos_at] - 1j * post.values[sin_at]
    weight = float((k**2 * np.abs(old) ** 2).sum())
    if weight < LEAST_FAULT_MM**2:
        return 0.0, 0.0
    turns = np.linspace(-np.pi, np.pi, 14401)
    match = (np.exp(-1j * np.outer(turns, k)) @ (np.conj(old) * new)).real
    noise = past.sds[cos_at] ** 2 + sds[cos_at] ** 2
    noise = noise + 2 * wave_mm**2
    sd = np.sqrt((k**2 * np.abs(old) ** 2 * noise).sum()) / weight
    # An oval pulley looks the same after half a turn: of equal peaks, the smallest turn.
    peak = (match >= np.roll(match, 1)) & (match >= np.roll(match, -1)) & (match > SYMMETRIC_SHARE * match.max())
    turn = turns[peak][np.argmin(np.abs(turns[peak]))]
    return float(-np.degrees(turn)), float(np.degrees(sd))
