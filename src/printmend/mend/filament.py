"""Split a measured scale into the machine's and the filament's, and mend both together.

A model's own numbers describe only the machine. Its section ``filaments`` keeps the measured scales, and how much parts
shrink in each filament. `printed_in` returns the model as it prints in one of them.
"""

import re
from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np

from printmend.diagnosis.named import diagnose, words_of_z
from printmend.effects.effect import SCALE_MM
from printmend.effects.paper import variance
from printmend.errors import ConfigError, ModelError
from printmend.filament import UNNAMED, material_of, said_name
from printmend.infer.machine import DRAWS, Part
from printmend.learn.learned import AUTO, SEARCH, learn_model
from printmend.machine import Frame, Mechanism
from printmend.measure.callipers import DOUBTED_SIGMAS
from printmend.measure.checks import digest_of, heights_alone
from printmend.mend.history import Ageing
from printmend.mend.update import Updated, update
from printmend.mend.verify import Verdict, made, verify
from printmend.messages import is_one_of, say, together
from printmend.model import Branches, SavedModel, branches_of, saved_model, screw_of, with_screw
from printmend.model.branches import numbers
from printmend.path import Instrument, Trace
from printmend.printer import Printer
from printmend.promise.belief import Belief, belief_of, belief_section
from printmend.promise.filament import (
    CLAIM_SD,
    FILAMENTS,
    UNTOLD,
    Entry,
    are_told,
    entry_section,
    filament_section,
    known_filaments,
    parse_entries,
    split,
)
from printmend.promise.words import axis_scales, instrument_of

PLAIN = 0.025  # share: a larger scale error is the machine's, since no filament in the table shrinks by as much
SURE_SDS = 2.0  # least standard deviations of a scale error that a measurement without filament shows
PLAIN_SDS = 4.0  # least standard deviations of a scale error that only prints in filament show
OTHER_SDS = 5.0  # a scale this many standard deviations from the known one is another machine's
READING_SD_MM = 0.05  # standard deviation of a reading from a steel rule with half millimetres
TRAVELS_MM = (50.0, 2000.0)  # range of a travel that is read with a rule
LEAST_SD = 1e-4  # share: shrinkage varies at least this much between prints in one filament
MOST_OFF = 0.1  # share: a travel that is further off was read or typed wrongly
NUMBERS = ("printer", "motors", "frame", "screw", "noise_mm", "findings", "format", "version", "program", "learner")
_TRAVEL = re.compile(r"([xy])=(\d+(?:\.\d+)?):(\d+(?:[.,]\d+)?)", re.IGNORECASE)


def parse_travel(text: str) -> Entry:
    """Read the machine's scale, measured with a steel rule, from ``x=200:199.6``: the head was sent 200 mm along X, and
    went 199.6 mm. Raises `ConfigError` for anything else."""
    found = _TRAVEL.fullmatch(text.strip())
    sent, went = (float(each.replace(",", ".")) for each in found.groups()[1:]) if found else (0.0, 0.0)
    if found is None or not TRAVELS_MM[0] <= sent <= TRAVELS_MM[1] or abs(went / sent - 1) > MOST_OFF:
        raise ConfigError(
            "--travel", wanted=say("axis-how-far-head-sent-how"),
            came=repr(text), todo=say("send-50-mm-more-read-rule"),
        )  # fmt: skip
    scale, sd = np.full(2, np.nan), np.ones(2)
    axis = "xy".index(found[1].lower())
    scale[axis], sd[axis] = went / sent - 1, READING_SD_MM / sent
    return Entry(None, (float(scale[0]), float(scale[1])), (float(sd[0]), float(sd[1])), "rule")


def filament_of(trace: Trace | None, filament: str | None) -> str | None:
    """Return the filament of a measured print, or `UNNAMED` for a part whose filament is not named: every part shrinks.
    A trace with walls is a part. Dots on a plate or paper do not shrink: None."""
    return UNNAMED if filament is None and trace is not None and trace.normal is not None else filament


def learn_in(
    trace: Trace, printer: Printer, filament: str | None, travels: Sequence[Entry] = (), *, model: str = AUTO,
    rng: np.random.Generator | None = None,
) -> SavedModel:  # fmt: skip
    """Learn a machine from a trace as `learn` does. ``filament`` is the measured part's, None for marks that cannot
    shrink; ``travels`` are the machine's scales measured with a rule."""
    filament = filament_of(trace, filament)
    if filament is None and not travels:
        return learn_model(trace, printer, model=model, rng=rng)
    if model not in (AUTO, SEARCH):
        raise ConfigError(
            say("filament-and-travel"),
            wanted=say("learner-knows-scales-auto"),
            came=model,
            todo=say("leave-learner-out"),
        )
    learned = learn_model(grown(trace, printer, filament), printer, model=model, rng=rng)
    return _settled(learned, (), (_shown(learned, filament), *travels))


def update_in(
    old: SavedModel, trace: Trace | None, filament: str | None, travels: Sequence[Entry] = (), *,
    rng: np.random.Generator, ageing: Ageing | None = None,
) -> Updated:  # fmt: skip
    """Update a model as `update` does, with a part printed in ``filament`` and ``travels`` measured with a rule, or
    without a ``trace`` with the rule alone. Raises `ModelError` for a model without drawn machines."""
    before, filament = parse_entries(old), filament_of(trace, filament)
    if trace is None:
        entries = (_shown(old, None),) if before is None else before
        return _ruled(Updated(old, (), ()), entries, travels)
    updated = update(old, grown(trace, old.printer, filament), rng=rng, ageing=ageing)
    if updated.is_known or (before is None and filament is None and not travels):
        return updated
    entries = (_shown(old, None),) if before is None else before
    if heights_alone(trace):  # heights show no scale of X and Y
        return _ruled(updated, entries, travels) if travels else updated
    shown = _shown(updated.model, filament)
    new = [axis for axis, name in enumerate("xy") if _is_other(entries, shown, axis) or _is_anew(updated, axis)]
    for axis in new:  # measurements of the previous machine no longer hold
        entries = tuple(_without(each, axis) for each in entries)
    changes = tuple(each for each in updated.changes if new or each.kind not in ("scale", "axes"))
    return _ruled(replace(updated, changes=changes), entries, (shown, *travels))


def _ruled(updated: Updated, before: Sequence[Entry], new: Sequence[Entry]) -> Updated:
    """Return an update with all its measured scales, which says those that a ``new`` rule settled."""
    entries = (*before, *new)
    rules = [each for each in new if each.kind == "rule"]
    axes = [a for a in _acting(entries) if any(np.isfinite(each.scale[a]) for each in rules)]
    settled = say("rule-settled", _both(["XY"[axis] for axis in axes])) if axes else ""
    return replace(updated, model=_settled(updated.model, before, new), settled=settled)


def _is_other(entries: Sequence[Entry], shown: Entry, axis: int) -> bool:
    """Return whether a measured scale contradicts the machine and the filament that the entries describe."""
    same = [each for each in entries if each.filament == shown.filament and np.isfinite(each.scale[axis])]
    one, sd = split(entries, axis), shown.sd[axis]
    if shown.filament is None:
        mean, sd = one.mean, float(np.hypot(sd, one.sd))
    elif same:
        mean, sd = same[-1].scale[axis], float(np.hypot(sd, same[-1].sd[axis]))
    else:
        material = material_of(shown.filament)
        mean, sd = one.mean - material.mean, float(np.linalg.norm([sd, one.sd, material.sd]))
    return abs(shown.scale[axis] - mean) > max(OTHER_SDS * sd, CLAIM_SD)


def _is_anew(updated: Updated, axis: int) -> bool:
    """Return whether a motor that moves this axis was learned anew: it got other parts."""
    names = [name.upper() for name in updated.model.printer.motors]
    return any(
        name in updated.anew for name in (names if updated.model.printer.kinematics == "corexy" else [names[axis]])
    )


def verify_in(model: SavedModel, trace: Trace, filament: str | None) -> Verdict:
    """Compare a check print with the promise, as `verify` does, after undoing its shrinkage.

    If the model knows the ``filament``, mending enlarged the check print by its shrinkage; otherwise it did not. The
    uncertainty of the shrinkage is the filament's, and neither keeps nor breaks the promise.
    """
    known = known_filaments(model).get(filament or "")
    if known is None:
        return verify(model, grown(trace, model.printer, filament_of(trace, filament)))
    share = np.array([part.acts_mm[0] for part in known]) / SCALE_MM
    sd = max(float(part.draws_mm.std()) for part in known) / SCALE_MM
    return verify(model, _enlarged(trace, model.printer, share, sd))


def updated_in(model: SavedModel, trace: Trace, filament: str | None) -> Updated:
    """Update a model with a mended check print in a ``filament``, enlarged by mending as in `verify_in`."""
    mended = printed_in(model, filament) if filament in known_filaments(model) else model
    return update_in(model, made(mended, trace)[0], filament, rng=np.random.default_rng(0))


def printed_in(model: SavedModel, filament: str | None) -> SavedModel:
    """Return a model as it prints in a filament: mending must undo the machine's errors and the part's shrinkage.
    Raises `ModelError` for a filament that the model does not know."""
    if filament is None:
        return model
    material_of(filament)
    known = known_filaments(model)
    if filament not in known:
        raise ModelError(
            say("filament-option"), wanted=say("model-knows", ", ".join(known) or say("none-yet")), came=filament,
            todo=say("measure-part-printed-learn-update-filament"),
        )  # fmt: skip
    share = np.array([part.acts_mm[0] for part in known[filament]]) / SCALE_MM
    return replace(model, mechanism=shrunk(model.mechanism, share), filament=filament)


def shrunk(mechanism: Mechanism, share: np.ndarray) -> Mechanism:
    """Return a machine whose prints are smaller by a ``share`` [2] along X and Y, about the middle of its bed."""
    left, frame = 1.0 - np.asarray(share, float), mechanism.frame
    coefficients = frame.coefficients_mm * left[:, None]
    for axis, power in enumerate(((1, 0), (0, 1))):
        coefficients[axis, Frame.exponents.index(power)] -= share[axis] * frame.scale_mm
        coefficients[axis, 0] += share[axis] * mechanism.printer.middle_mm[axis]
    waves = frame.waves.copy()
    waves[:, 2:4], waves[:, 4:6] = waves[:, 2:4] * left[0], waves[:, 4:6] * left[1]
    return replace(mechanism, frame=Frame(coefficients, frame.scale_mm, waves))


def filament_words(model: SavedModel) -> tuple[str, ...]:
    """Return a line for the machine's own scale, if it is known, and one for each filament that a model knows."""
    entries = parse_entries(model)
    if not entries:
        return ()
    lines = []
    if axes := _acting(entries):
        own = [(split(entries, axis), "XY"[axis]) for axis in axes]
        shares = [say("percent-in-axis", f"{100 * one.mean:+.2f} ± {100 * one.sd:.2f}", name) for one, name in own]
        lines.append(say("machines-own-scale", _both(shares)))
    for name, parts in known_filaments(model).items():
        by = (f"{part.draws_mm.mean():.2f} ± {part.draws_mm.std():.2f}" for part in parts)
        lines.append(say("parts-shrink-by", said_name(name), say("scale-x-and-y", *by)))
    return tuple(lines)


def settled(model: SavedModel, filament: str | None) -> SavedModel:
    """Split the scale of a model, just learned from a `grown` trace, between machine and filament."""
    return model if filament is None else _settled(model, (), (_shown(model, filament),))


def grown(trace: Trace, printer: Printer, filament: str | None) -> Trace:
    """Return a part's trace as it was before it shrank, taking the mean shrinkage of its polymer."""
    if filament is None:
        return trace
    material, middle = material_of(filament), np.array(printer.middle_mm[:2])
    more = material.mean / (1 - material.mean)
    grown = replace(
        trace, measured_mm=trace.measured_mm + more * (trace.measured_mm - middle), shrinkage_sd=material.sd,
        shrunk=material.mean, taken=digest_of(trace),
    )  # fmt: skip
    if trace.normal is None or trace.offset_mm is None:
        return grown
    out_mm = (1 + more) * trace.offset_mm + more * np.sum((trace.commanded_mm - middle) * trace.normal, axis=1)
    return replace(grown, offset_mm=out_mm)


def _enlarged(trace: Trace, printer: Printer, share: np.ndarray, sd: float) -> Trace:
    """Return a trace with its wanted and measured places as they were before shrinking by a ``share`` [2] along X and
    Y; ``sd`` is the standard deviation of the share."""
    middle, more = np.array(printer.middle_mm[:2]), share / (1 - share)
    wanted, measured = (each + more * (each - middle) for each in (trace.commanded_mm, trace.measured_mm))
    wanted[0] = trace.commanded_mm[0]
    offset = trace.offset_mm
    if offset is not None and trace.normal is not None:
        offset = offset * (1 + np.sum(more * np.square(trace.normal), axis=1))
    return replace(
        trace, commanded_mm=wanted, measured_mm=measured, offset_mm=offset, shrinkage_sd=max(sd, LEAST_SD),
        taken=digest_of(trace),
    )  # fmt: skip


def _shown(model: SavedModel, filament: str | None) -> Entry:
    """Return the scale that a model's last measurement showed: machine and filament, or the machine alone for None."""
    belief, seen = belief_of(model), model.document["promise"].get("seen")
    if isinstance(seen, dict):
        mean, sd = (numbers(seen, name, "the model [promise]", 2) for name in ("mean", "sd"))
        known = {each.name for each in fields(Instrument)}
        own = Instrument(**{key: value for key, value in instrument_of(model).items() if key in known}).covariance
        half = np.array([1.0, -1.0])
        resized2 = sum(float(np.mean(np.square(part.draws_mm))) for part in belief.of("resized")) / SCALE_MM**2
        paper2 = variance(instrument_of(model).get("paper_sd", 0.0))
        sd = np.sqrt(sd**2 + own[0, 0] + own[1, 1] + 2 * half * own[0, 1] + resized2 + paper2)
    else:
        drawn = axis_scales(belief.scene, belief.parts)[1] + np.zeros((2, DRAWS))
        for part in belief.of("shrinkage"):
            drawn[part.where] -= part.draws_mm[0] / SCALE_MM
        mean, sd = drawn.mean(axis=1), drawn.std(axis=1)
    mean = mean - (0.0 if filament is None else material_of(filament).mean)
    return Entry(filament, (float(mean[0]), float(mean[1])), (float(sd[0]), float(sd[1])))


def _without(entry: Entry, axis: int) -> Entry:
    scale = (np.nan, entry.scale[1]) if axis == 0 else (entry.scale[0], np.nan)
    return replace(entry, scale=scale)


def _acts(entries: Sequence[Entry], axis: int) -> bool:
    """Return whether a scale is surely the machine's: known to 0.05 %, shown by a measurement without filament, or
    larger than any filament's."""
    one = split(entries, axis)
    alone = any(each.filament is None and np.isfinite(each.scale[axis]) for each in entries)
    least = SURE_SDS * one.sd if alone else max(PLAIN, PLAIN_SDS * one.sd)
    return one.is_told or abs(one.mean) > least


def _acting(entries: Sequence[Entry]) -> list[int]:
    """Return the axes whose scale is surely the machine's."""
    return [axis for axis in range(2) if _acts(entries, axis)]


def _settled(model: SavedModel, before: Sequence[Entry], new: Sequence[Entry]) -> SavedModel:
    """Return a model with the machine's scale and each filament's shrinkage, as estimated from all entries."""
    belief, entries = belief_of(model), (*before, *new)
    _check_travels(before, new)
    rng = np.random.default_rng(0)
    splits = [split(entries, axis) for axis in range(2)]
    own = np.stack([each.draws(DRAWS, rng) for each in splits])  # [2, D]
    acting = _acting(entries)
    acts = np.array([one.mean if axis in acting else 0.0 for axis, one in enumerate(splits)])
    known = {
        name: _shrinkage(name, entries, own, acts, rng)
        for name in dict.fromkeys(each.filament for each in entries)
        if name
    }
    parts = _rescaled(belief, own, acts)
    gaps = [gap for gap in model.findings[1:] if not is_one_of(gap, UNTOLD)]
    if open_ := [axis for axis in range(2) if axis not in acting]:
        gaps.append(_untold(entries, open_))
    diagnosis = diagnose(parts, belief.scene, gaps, before=model.findings[0])
    of_z = words_of_z(model.findings[0])
    faults = [each for each in model.document.get("diagnosis", []) if each["part"] == "z"]
    section = {**model.document["promise"], "parts": belief_section(belief.scene, parts)["parts"]}
    if any(each.filament for each in entries) or are_told(entries):
        section.pop("shown", None)  # it held for machine and filament together, or says no more than is told
    section.pop("seen", None)
    details: dict[str, Any] = {key: value for key, value in model.document.items() if key not in NUMBERS}
    details |= {
        "diagnosis": [*(fault.row for fault in diagnosis.faults), *faults],
        "promise": section,
        FILAMENTS: {
            "measured": [entry_section(each) for each in entries],
            "known": {name: filament_section(each) for name, each in known.items()},
        },
    }  # fmt: skip
    mechanism, branches = _stretched(model, belief, acts - axis_scales(belief.scene, belief.parts)[0])
    findings, series = (together("; ", [diagnosis.summary, *of_z]), *diagnosis.gaps), screw_of(model)
    settled = saved_model(
        mechanism if series is None else replace(mechanism, screw=None), learner=model.learner, branches=branches,
        noise_mm=model.noise_mm, findings=findings, details=details,
    )  # fmt: skip
    return settled if series is None else with_screw(settled, series, findings=findings, details={})


def _check_travels(before: Sequence[Entry], new: Sequence[Entry]) -> None:
    """Raise `ConfigError` for a new scale by a rule that the other measurements contradict."""
    for rule in new:
        others = [each for each in (*before, *new) if each is not rule]
        for axis, scale in enumerate(rule.scale if rule.kind == "rule" else ()):
            if not np.isfinite(scale) or not any(np.isfinite(each.scale[axis]) for each in others):
                continue
            one = split(others, axis)
            if abs(scale - one.mean) > DOUBTED_SIGMAS * np.hypot(one.sd, rule.sd[axis]):
                seen = f"{100 * one.mean:+.2f}", f"{100 * one.sd:.2f}"
                raise ConfigError(
                    "--travel", wanted=say("scale-as-measured", "XY"[axis], *seen),
                    came=f"{100 * scale:+.2f} %", todo=say("sent-before-went-or-read-again"),
                )  # fmt: skip


def _shrinkage(
    name: str, entries: Sequence[Entry], own: np.ndarray, acts: np.ndarray, rng: np.random.Generator
) -> tuple[Part, Part]:
    """Return how much parts in a filament shrink along X and Y. Each draw pairs with a draw of the machine's scale
    ``own`` [2, D]: a print shows their sum better than either alone."""
    found = []
    for axis in range(2):
        seen = [each for each in entries if each.filament == name and np.isfinite(each.scale[axis])]
        if seen:
            weight = np.array([1 / max(each.sd[axis], 1e-6) ** 2 for each in seen])
            total = float(weight @ [each.scale[axis] for each in seen] / weight.sum())
            spread = rng.standard_normal(DRAWS) / np.sqrt(weight.sum())
            shrinks, drawn = acts[axis] - total, own[axis] - total - spread
        else:
            material = material_of(name)
            shrinks, drawn = material.mean, material.mean + material.sd * rng.standard_normal(DRAWS)
        found.append(Part("shrinkage", axis, (), np.array([SCALE_MM * shrinks]), SCALE_MM * drawn[None]))
    return found[0], found[1]


def _rescaled(belief: Belief, own: np.ndarray, acts: np.ndarray) -> list[Part]:
    """Return a machine's parts with a new scale along the bed's axes: ``acts`` [2], and ``own`` [2, D] as drawn."""
    kept = [part for part in belief.parts if part.effect not in ("scale", "aspect", "shrinkage")]
    if not belief.scene.corexy:
        return [*(_part("scale", axis, acts[axis], own[axis]) for axis in range(2)), *kept]
    old = [_summed(belief, "scale", motor) for motor in range(2)]
    half_acts, half = ((a - b) / 2 / SCALE_MM for a, b in zip(*old, strict=True))
    motors = [
        _part("scale", motor, acts.mean() + sign * half_acts, own.mean(axis=0) + sign * half)
        for motor, sign in enumerate((1, -1))
    ]
    return [*motors, _part("aspect", 0, acts[0] - acts[1], own[0] - own[1]), *kept]


def _summed(belief: Belief, effect: str, where: int) -> tuple[float, np.ndarray]:
    parts = belief.of(effect, where)
    acts = sum(float(part.acts_mm[0]) for part in parts)
    return acts, np.asarray(sum((part.draws_mm[0] for part in parts), np.zeros(DRAWS)))


def _part(effect: str, where: int, acts: float, draws: np.ndarray) -> Part:
    return Part(effect, where, (), np.array([SCALE_MM * acts]), SCALE_MM * draws[None])


def _stretched(
    model: SavedModel, belief: Belief, more: np.ndarray
) -> tuple[Mechanism, tuple[Branches | None, Branches | None]]:
    """Return a machine whose prints are larger by the shares ``more`` [2] along X and Y, and each motor's series. End
    stops at which it starts keep their places."""
    mechanism, printer, scene = model.mechanism, model.printer, belief.scene
    at_mm = np.array(printer.home_mm if scene.homed else printer.middle_mm[:2], float)
    motors = np.full(2, more.mean()) if scene.corexy else more
    tables, branches = [], []
    for motor, table in enumerate(mechanism.transmissions):
        still_mm, share = float(printer.to_motor(at_mm)[motor]), float(motors[motor])
        added = share * (table.motor_mm - still_mm)
        tables.append(replace(table, lower_mm=table.lower_mm + added, upper_mm=table.upper_mm + added))
        one = branches_of(model, motor)
        if one is not None and share:
            powers = np.concatenate([one.mean.powers_mm, np.zeros(max(2 - len(one.mean.powers_mm), 0))])
            powers[0] += share * (one.middle_mm - still_mm)
            powers[1] += share * SCALE_MM
            one = replace(one, mean=replace(one.mean, powers_mm=powers))
        branches.append(one)
    frame, unlike = mechanism.frame, more - motors
    coefficients = frame.coefficients_mm.copy()
    for axis, power in enumerate(((1, 0), (0, 1))):
        coefficients[axis, Frame.exponents.index(power)] += unlike[axis] * frame.scale_mm
        coefficients[axis, 0] -= unlike[axis] * at_mm[axis]
    stretched = replace(
        mechanism, transmissions=(tables[0], tables[1]), frame=replace(frame, coefficients_mm=coefficients)
    )
    return stretched, (branches[0], branches[1])


def _untold(entries: Sequence[Entry], axes: Sequence[int]) -> str:
    """Say on which axes machine and filament cannot be separated, and how to separate them."""
    names = list(dict.fromkeys(each.filament for each in entries if each.filament))
    seen = []
    for name in names:
        last = [each for each in entries if each.filament == name][-1]
        shares = [
            say("percent-in-axis", f"{100 * last.scale[a]:+.2f}", "XY"[a]) for a in axes if np.isfinite(last.scale[a])
        ]
        seen.append(say("scale-of-filament", _both(shares), said_name(name)))
    which = _both(["XY"[axis] for axis in axes])
    if any(each.filament is None for each in entries):
        return say("whose-scale-not-settled", which)
    return say("whose-scale-untold", which, together(", ", seen))


def _both(words: Sequence[str]) -> str:
    """Join one or two phrases."""
    return say("and", *words) if len(words) == 2 else together("", words)
