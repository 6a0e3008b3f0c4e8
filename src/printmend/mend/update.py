"""Update a saved model with a second print: by Bayes' rule, or by the phase of its motors alone.

The drawn machines of the old model, widened by possible wear, are the prior; a search finds what changed since
(`infer.update`). If another machine explains the print better, the model is learned anew.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from printmend.diagnosis.advice import gaps_of
from printmend.diagnosis.named import (
    Z_SAID,
    Lift,
    acting_faults,
    diagnose,
    find_lift,
    gathered,
    is_named,
    kind_words,
    lift_of,
    misfits_of,
    part_words,
    renewed_lift,
)
from printmend.effects import EFFECTS, Acts, Scene, scene_of
from printmend.effects.prior import wear_share
from printmend.effects.pulley import HARMONICS
from printmend.effects.switch import spread_mm
from printmend.effects.teeth import TOOTH_MM
from printmend.effects.words import NAMED_SIGMAS, Fault
from printmend.errors import InputError, ModelError, TraceError
from printmend.infer.machine import DRAWS, Part, machine_of, those_acting
from printmend.infer.phase import Phase, found_phase
from printmend.infer.update import Event, Renewed, both_seen, renewed, surely_there
from printmend.learn.learned import (
    PLANE_FACTOR,
    enlarged,
    instrument_scatter_mm,
    known_digests,
    learn,
    push_of,
    times_seen,
    trace_section,
    with_z,
)  # fmt: skip
from printmend.learn.order import once_in_order
from printmend.measure.checks import check_origin, digest_of, heights_alone, with_heights
from printmend.mend.history import Ageing
from printmend.messages import Said, is_one_of, say, say_count, together
from printmend.model import SavedModel, saved_model, screw_of, with_screw
from printmend.model.model import DIGESTS, REFITTED, REFUSAL, Misfit, found_in, misfit_section
from printmend.path import Trace
from printmend.printer import Printer
from printmend.promise.belief import Belief, belief_of, belief_section, says_nothing
from printmend.promise.filament import UNTOLD
from printmend.promise.scatter import Scatter
from printmend.promise.words import seen_scales

LEAST_CHANGE = {"mm": 0.01, "%": 0.02, "°": 0.02}  # a smaller change is not reported
PLAIN_CHANGE = 0.05  # a larger change is reported with two decimals
OF_ONE_PRINT = ("offset",)  # kinds of fault that differ from print to print, such as how the plate lies


@dataclass(frozen=True)
class Change:
    """One quantity of one motor before and now, with the standard deviation ``sd`` of the difference."""

    part: str
    kind: str
    before: float
    now: float
    sd: float
    unit: str
    words: str


@dataclass(frozen=True, eq=False)
class Updated:
    """The new model, the changes, and the motors that were learned anew. ``is_known``: the model was learned from this
    measurement, so it stays unchanged. ``is_other``: nothing of the old machine explains it. ``settled`` says which
    scales a rule settled."""

    model: SavedModel
    changes: tuple[Change, ...]
    anew: tuple[str, ...]
    is_known: bool = False
    settled: str = ""
    is_other: bool = False

    @property
    def words(self) -> str:
        """Say what changed."""
        if self.is_known:
            return say("model-learned-very-measurement-counted-once")
        rows = [*(change.words for change in self.changes), *filter(None, [self.settled])]
        rows += [say("old-model-knew-learned-anew", name) for name in self.anew]
        if self.is_other:
            rows.append(say("nothing-old-model-left-measurement-same"))
        return together("\n", rows or [say("nothing-changed-more-trace-can-tell")])


def update(old: SavedModel, trace: Trace, *, rng: np.random.Generator, ageing: Ageing | None = None) -> Updated:
    """Update ``old`` with a trace of the same printer, which may be small.

    ``ageing`` gives the age of the old measurement and the observed wear: the older, the less it weighs. A measurement
    that the model was learned from changes nothing. Raises `ModelError` for a model without drawn machines,
    `TraceError` like `learn`.
    """
    check_origin(say("measurement-2"), trace.origin, old.printer)
    digest = digest_of(trace)
    if digest in known_digests(old):
        return Updated(old, (), (), is_known=True)
    belief = believed(old)
    with threadpool_limits(1, user_api="blas"):
        ordered = once_in_order(trace, old.printer)
        flat = with_heights(ordered.trace, old.printer)
        if heights_alone(flat):
            return _lifted(old, belief, flat, ordered.found, digest)
        found = measured_again(old, belief, flat, rng, ageing=ageing)
        if found.story.whole:
            return _anew(old, trace, rng)
        return _updated(old, belief, found, flat, ordered.found, digest)


def believed(old: SavedModel) -> Belief:
    """Return a model's drawn machines. Raises `ModelError` for a model without them."""
    belief = belief_of(old)
    if DIGESTS not in old.document:
        raise says_nothing()
    return belief


def same_machine(old: SavedModel, printer: Printer) -> None:
    """Raise `ModelError` if a model is not of ``printer``."""
    if old.printer != printer:
        raise ModelError(
            say("update"), wanted=say("model", printer.name), came=say("other-axes", old.printer.name),
            todo=say("leave-printer-out-name-printer-old"),
        )  # fmt: skip


def measured_again(
    old: SavedModel, belief: Belief, trace: Trace, rng: np.random.Generator, *, ageing: Ageing | None = None,
    stories: bool = True, refit: bool = False,
) -> Renewed:  # fmt: skip
    """Return a model's machine as a flat trace renews it. Raises `TraceError` for a trace without measurements."""
    if not (trace.measured_rows | trace.wall_rows).any() or not np.isfinite(trace.commanded_mm).all():
        raise TraceError(say("trace"), wanted=say("measured-marks"), came=say("none-nan"), todo=say("check-trace"))
    printer = old.printer
    scene = both_seen(belief.scene, scene_of(trace, printer, belief.scene.turns_mm))
    grown = {} if ageing is None else {
        (kind, motor): size for motor, name in enumerate(printer.motors) for kind, size in ageing.of(name).items()
    }  # fmt: skip
    months = 0.0 if ageing is None else ageing.months
    again = partial(
        renewed, mechanism=old.mechanism, trace=trace, scene=scene, rng=rng, first=belief.scene, months=months,
        grown=grown, stories=stories, refit=refit,
    )  # fmt: skip
    found = again(belief.parts)
    if (mean := times_seen(found.now.parts).mean()) == 1.0:
        return found
    times = np.full(DRAWS, mean)
    found = again(enlarged(belief.parts, times))  # as the picture shows the old machine
    own = 1.0 / times_seen(found.now.parts)
    now = replace(found.now, parts=enlarged(found.now.parts, own))
    return replace(found, now=now, before=enlarged(found.before, 1.0 / times))


def _anew(old: SavedModel, trace: Trace, rng: np.random.Generator) -> Updated:
    """Learn a machine anew; Z stays as in the old model if the trace does not show it."""
    names = tuple(name.upper() for name in old.printer.motors)
    model = learn(trace, old.printer, rng=rng).saved
    details = {"update": {"from": old.digest, "changes": [], "anew": list(names)}}
    model = with_screw(model, screw_of(model), findings=model.findings, details=details)
    return Updated(model, (), names, is_other=True)


def _lifted(old: SavedModel, belief: Belief, trace: Trace, said: Sequence[Misfit], digest: str) -> Updated:
    """Update from heights alone how Z lifts; X and Y stay as they were. Raises `TraceError` for too few heights."""
    before, seen = lift_of(old), find_lift(trace, old.printer)
    if seen is None:
        heights_mm = trace.z_measured_mm
        count = 0 if trace.z_mm is None or heights_mm is None else int(np.isfinite(heights_mm).sum())
        raise TraceError(
            say("trace"), wanted=say("three-measured-heights"), came=f"{count}", todo=say("measure-more")
        )  # fmt: skip
    lift = renewed_lift(before, seen)
    gaps = [gap for gap in old.findings[1:] if not gap.startswith("Z ")]
    diagnosis = diagnose(belief.parts, belief.scene, gaps, lift, old.findings[0])
    changes = tuple(_lift_changes(before, lift))
    details = {
        "diagnosis": [fault.row for fault in diagnosis.faults],
        DIGESTS: [*known_digests(old), digest],
        Z_SAID: lift.said,
        "misfit": misfit_section((*said, *misfits_of(belief.parts, belief.scene))),
        "update": {"from": old.digest, "changes": _rows_of(changes), "anew": [], "of": "z"},
    }
    series = lift.with_push(old.printer.z.mm_per_turn, push_of(belief.parts))
    findings = (diagnosis.summary, *diagnosis.gaps)
    return Updated(with_screw(old, series, findings=findings, details=details), changes, ())


def _rows_of(changes: Sequence[Change]) -> list[dict[str, Any]]:
    """Return changes as a model's document has them."""
    return [
        {"part": c.part, "kind": c.kind, "before": round(c.before, 6), "now": round(c.now, 6), "sd": round(c.sd, 6),
         "unit": c.unit}
        for c in changes
    ]  # fmt: skip


def _updated(
    old: SavedModel, belief: Belief, found: Renewed, trace: Trace, said: Sequence[Misfit], digest: str
) -> Updated:
    scene, parts = found.now.scene, found.now.parts
    mechanism, branches = machine_of(scene, those_acting(parts))
    noise_mm, own_mm = found.now.noise_mm, instrument_scatter_mm(trace)
    free = 2 * int(trace.measured_rows.sum())
    scatter = belief.scatter if own_mm is None else Scatter.of(noise_mm**2, free, own_mm)
    names = tuple(old.printer.motors[motor].upper() for motor in found.story.anew)
    before, seen = lift_of(old), find_lift(trace, old.printer)
    lift = renewed_lift(before, seen or Lift())
    diagnosis = diagnose(parts, scene, _left_open(old, found), lift)
    changes = [*changes_of(found), *_lift_changes(before, lift)]
    details: dict[str, Any] = {
        "diagnosis": [fault.row for fault in diagnosis.faults],
        "trace": trace_section(trace, found.fit, parts, PLANE_FACTOR * noise_mm),
        "promise": {
            **belief_section(
                replace(
                    scene,
                    placed=scene.placed or belief.placed,
                    homed_again_mm=(*belief.scene.homed_again_mm, *found.homed_mm),
                ),
                parts,
                scatter=scatter,
                outliers=belief.outliers,
                by_hand=belief.by_hand,
                motion=trace.motion or belief.motion,
            ),
            **({} if scene.placed else {"seen": seen_scales(scene, parts)}),
        },
        "misfit": misfit_section((*said, *misfits_of(parts, scene))),
        DIGESTS: [*known_digests(old), digest],
        **({Z_SAID: lift.said} if lift.known else {}),
        "update": {"from": old.digest, "changes": _rows_of(changes), "anew": list(names)},
    }
    model = saved_model(
        mechanism, learner=old.learner, branches=branches, noise_mm=noise_mm,
        findings=(diagnosis.summary, *diagnosis.gaps), details=details,
    )  # fmt: skip
    return Updated(with_z(model, lift, push_of(parts)), tuple(changes), names)


def _left_open(old: SavedModel, found: Renewed) -> list[str]:
    """Return the gaps of a new trace that no old one closed for a motor that is still the same, and what is open of a
    scale."""
    anew = [found.now.scene.printer.motors[motor].upper() for motor in found.story.anew]
    before, now = (
        [gap for gap in gaps if isinstance(gap, Said)]
        for gaps in (old.findings[1:], gaps_of(found.fit, found.now.parts))
    )
    known = [(gap.id, gap.values.get("a")) for gap in before]
    no_trace = "trace" not in old.document
    return [
        *(gap for gap in now if no_trace or gap.values["a"] in anew or (gap.id, gap.values["a"]) in known),
        *(gap for gap in before if is_one_of(gap, UNTOLD)),
    ]


def _lift_changes(before: Lift, now: Lift) -> Iterator[Change]:
    """Yield the sure changes of how Z lifts."""
    was, new = ({fault.kind: fault for fault in each.faults} for each in (before, now))
    for kind in sorted(was.keys() | new.keys()):
        none = replace((was | new)[kind], value=0.0, sd=0.0)
        old, found = was.get(kind, none), new.get(kind, none)
        sd = float(np.hypot(old.sd, found.sd))
        if abs(found.value - old.value) > NAMED_SIGMAS * sd:
            yield Change("Z", kind, old.value, found.value, sd, found.unit, _z_changed(old, found))


def changes_of(found: Renewed) -> list[Change]:
    """Return the sure changes of named faults, and the pulleys that turned on their shafts."""
    scene, story = found.now.scene, found.story
    of_motors = [scene.printer.motors[motor] for motor in story.anew]
    changes = [_happened(found, event) for event in story.events if event.where not in story.anew]
    changes = [each for each in changes if abs(each.now) > max(NAMED_SIGMAS * each.sd, LEAST_CHANGE[each.unit])]
    # what was in doubt is no change where it came as the old machine may have had it
    known = surely_there(found.before, scene) | {key[:2] for key in found.changes}
    doubted = {part.key[:2] for part in found.before} - known
    before, now = (
        _likely([part for part in parts if part.key[:2] not in doubted], scene)
        for parts in (found.before, found.now.parts)
    )
    for key in dict.fromkeys([*before, *now]):
        if key[0] in of_motors or key[1] in OF_ONE_PRINT:
            continue
        other = before.get(key) or now[key]
        was, new = (each.get(key) or replace(other, value=0.0) for each in (before, now))
        sd = float(np.hypot(was.sd, new.sd))
        is_sure = abs(new.value - was.value) > max(NAMED_SIGMAS * sd, LEAST_CHANGE.get(new.unit, 0.0))
        if is_sure and (is_named(was) or is_named(new)):
            changes.append(_change(was, new, sd))
    return changes


def _likely(parts: Sequence[Part], scene: Scene) -> dict[tuple[str, str], Fault]:
    """Return the faults that act or that most drawn machines have, named or not, by part and kind, from those drawn
    machines that have them, near shapes put together."""
    likely = {slot for slot in surely_there(parts, scene) if EFFECTS[slot[0]].acts is not Acts.NOT}
    found = []
    for each in gathered(parts):
        if each.acts or (each.effect, each.where) in likely:
            draws_mm = each.draws_mm[:, np.resize(np.flatnonzero(each.there), DRAWS)]
            found.append(Part(each.effect, each.where, each.shape, draws_mm.mean(axis=1), draws_mm))
            likely.discard((each.effect, each.where))
    return {(fault.part, fault.kind): fault for fault in acting_faults(found, scene)}


def _change(was: Fault, new: Fault, sd: float) -> Change:
    if new.part == "z":
        return Change("Z", new.kind, was.value, new.value, sd, new.unit, _z_changed(was, new))
    grew = new.size > was.size
    digits, space = 2 if abs(new.value - was.value) >= PLAIN_CHANGE else 3, "" if new.unit == "°" else " "
    old, value = (round(each.value, digits) + 0.0 for each in (was, new))  # never −0
    name, what = part_words(new.part), kind_words(new.kind)
    if new.part != "frame":
        what = say("quantity-of-part", name, what)
    now = f"{value:.{digits}f}{space}{new.unit}"
    words = say("grew" if grew else "shrank", what, f"{old:.{digits}f}", now, f"{sd:.3f}")
    return Change(name, new.kind, was.value, new.value, sd, new.unit, words)


def _z_changed(was: Fault, new: Fault) -> str:
    kind, _, order = new.kind.partition("-")
    what = say(f"z-{kind}") if order in ("", "1") else together(" ", [say(f"z-{kind}"), order])
    return say("z-was-is", what, f"{was.value:.3f}", f"{new.value:.3f}", new.unit)


def _angles_rad(part: Part, draws_mm: np.ndarray, by_rad: float = 0.0) -> np.ndarray:
    """Return by how much farther than ``by_rad`` draws of a pulley [P, D] are turned from the mean of a part of it."""
    old, now = (cos - 1j * sin for cos, sin in (np.split(each, 2) for each in (part.mean_mm, draws_mm)))
    old = old * np.exp(-1j * HARMONICS * by_rad)
    more = -(HARMONICS * np.conj(old)) @ now / np.sum(HARMONICS**2 * np.abs(old) ** 2)
    return np.asarray(more.imag)


def _angle_sd_rad(part: Part) -> float:
    """Return how exactly the angle of a pulley is known."""
    return float(_angles_rad(part, part.draws_mm).std())


def _happened(found: Renewed, event: Event) -> Change:
    """Return by how much a pulley turned on its shaft or stands elsewhere, or an end stop moved, refined harmonic by
    harmonic.

    A belt that is put back a whole number of teeth away looks as if the pulley had turned, but for how the end stop
    scatters. So does an end stop that moved, unless it moves both motors, or the place of the print is known.
    """
    scene, motor, name = found.now.scene, event.where, found.now.scene.printer.motors[event.where].upper()
    way = float(scene.printer.to_motor(np.eye(2))[motor, motor]) if event.kind == "stop" else 1.0
    (before, *_), (now, *_) = found.of("pulley", motor)
    angles_rad = event.by_rad + _angles_rad(before, now.draws_mm, event.by_rad * way) / way
    by_rad, sd_rad = float(angles_rad.mean()), float(np.hypot(angles_rad.std(), _angle_sd_rad(before) / way))
    (shift_mm, shift_sd_mm), (value, sd) = (
        event.shift_mm(np.array([by_rad, -sd_rad]), scene),
        np.degrees([by_rad, sd_rad]),
    )
    is_alike = not (scene.placed or scene.corexy)
    if event.kind == "stop" and not is_alike:
        axis = "XY"[motor]
        words = say("end-stop-moved", axis, f"{shift_mm:+.2f}", f"{shift_sd_mm:.2f}")
        return Change(axis, "offset", 0.0, shift_mm, shift_sd_mm, "mm", words)
    words = say("belt-replaced" if event.kind == "belt" else "pulley-turned-shaft", name, f"{value:.1f}°", f"{sd:.1f}")
    teeth = round(shift_mm / TOOTH_MM)
    doubt_mm = NAMED_SIGMAS * float(np.hypot(shift_sd_mm, spread_mm(scene)[motor]))
    if event.kind != "belt" and teeth and abs(shift_mm - teeth * TOOTH_MM) < doubt_mm < TOOTH_MM / 2:
        words = say("pulley-turned-or-belt", words, say_count("count-teeth", abs(teeth)))
    if event.kind != "belt" and is_alike:
        words = say("pulley-turned-or-end-stop", words, f"{shift_mm:+.2f}")
    return Change(name, "phase", 0.0, value, sd, "°", words)


# After work on a known printer's belts or pulleys: measure again, or find the motors' phase from one print.
#
# Until then nothing is mended. A pulley that was turned on its shaft moves its errors to other places, and mending
# would add to them.

LEAST_SHIFT_MM = 0.05  # smallest shift of a motor that is reported
MOST_NOISE = 2.0  # a print of the same machine may scatter by so many times the old measurement's noise
LEAST_NOISE_MM = 0.005  # least noise of a measurement


def refitted(model: SavedModel, motors: Sequence[str]) -> SavedModel:
    """Return a model that refuses to mend until it is measured again, after work on belts or pulleys of ``motors``."""
    names = model.printer.motors
    if unknown := [name for name in motors if name.lower() not in names]:
        raise InputError(
            "--refitted", wanted=say("motor-of-this-printer", ", ".join(names)), came=unknown[0], todo=say("correct")
        )
    named = [name.upper() for name in names if name in {motor.lower() for motor in motors}]
    words = say("belt-pulley-worked-errors-elsewhere-now", named[0] if len(named) == 1 else say("and", *named))
    found = [one for one in found_in(model.document) if one["kind"] != REFITTED]
    refusal = {"kind": REFITTED, "severity": REFUSAL, "size_mm": 0.0, "evidence": 0.0, "words": words}
    misfit = {"misfit": {"found": [refusal, *found]}}
    return with_screw(model, screw_of(model), findings=model.findings, details=misfit)


def learn_phase(old: SavedModel, trace: Trace, *, rng: np.random.Generator) -> Updated:
    """Return the same machine with the motor angles that a print shows.

    Raises `ModelError` for a model without drawn machines. Raises `TraceError` like `learn`, for a measurement that the
    model was learned from, and for a print of another machine.
    """
    check_origin(say("measurement-2"), trace.origin, old.printer)
    digest = digest_of(trace)
    if digest in known_digests(old):
        raise TraceError(
            say("measurement-2"), wanted=say("print-after-work"), came=say("measurement-model-learned-from"),
            todo=say("print-probe-phase"),
        )  # fmt: skip
    belief = believed(old)
    with threadpool_limits(1, user_api="blas"):
        ordered = once_in_order(trace, old.printer)
        if not ordered.trace.measured_rows.any() and not ordered.trace.wall_rows.any():
            raise TraceError(say("trace"), wanted=say("measured-marks"), came=say("none"), todo=say("check-trace"))
        scene = both_seen(belief.scene, scene_of(ordered.trace, old.printer, belief.scene.turns_mm))
        phase = found_phase(belief.parts, old.mechanism, ordered.trace, scene, max(old.noise_mm, LEAST_NOISE_MM))
        moved = replace(belief, parts=phase.parts)
        machine = replace(old, mechanism=phase.mechanism)
        found = measured_again(machine, moved, ordered.trace, rng, refit=True)
        foreign: list[str] = [*(say("another-drive") for _ in (*found.story.anew, *found.story.belts))]
        foreign += [name for name, _, _ in found.changes if not wear_share(name) and EFFECTS[name].from_home]
        noise_mm, own_mm = found.now.noise_mm, max(old.noise_mm, LEAST_NOISE_MM)
        if found.story.whole or foreign or noise_mm > MOST_NOISE * own_mm:
            scatter = say("marks-scatter-instead", f"{noise_mm:.3f}", f"{own_mm:.3f}")
            raise TraceError(
                say("phase-print"), wanted=say("machine-of-model-elsewhere"), todo=say("print-whole-and-learn-anew"),
                came=together(", ", dict.fromkeys(foreign)) if foreign else scatter,
            )  # fmt: skip
        # the work moved the motors, not the end stop, so the shift says nothing about the scatter of end stops
        updated = _updated(old, moved, replace(found, homed_mm=()), ordered.trace, ordered.found, digest)
    # so small a print shows an idler's angle, but hardly its amplitude
    changes = (
        *_shifts(old, phase),
        *_homes(old, found),
        *(one for one in updated.changes if not one.kind.startswith("period")),
    )
    screw = screw_of(old)
    model = updated.model
    if screw is not None:
        model = with_screw(model, screw, findings=model.findings, details={})
    return replace(updated, model=model, changes=changes)


def _homes(old: SavedModel, found: Renewed) -> list[Change]:
    """Return how far each belt's home position moved: the work may have moved an end stop, too."""
    homes = []
    for motor, name in enumerate(old.printer.motors):
        before, now = found.of("place", motor)
        if now and ("place", motor) in [key[:2] for key in found.changes]:
            by_mm = float(sum(part.acts_mm[0] for part in now) - sum(part.acts_mm[0] for part in before))
            sd_mm = float(np.sum([part.draws_mm[0] for part in now], axis=0).std())
            words = say("motor-homes-elsewhere", name.upper(), f"{by_mm:+.2f}", f"{sd_mm:.2f}")
            homes.append(Change(name.upper(), "offset", 0.0, by_mm, sd_mm, "mm", words))
    return homes


def _shifts(old: SavedModel, phase: Phase) -> list[Change]:
    found = []
    for motor, name in enumerate(old.printer.motors):
        before_rad = [
            _angle_sd_rad(part) for part in phase.parts if part.key[:2] == ("pulley", motor) and part.mean_mm.any()
        ]
        before_mm = np.array(before_rad) * old.printer.mm_per_turn[motor] / (2 * np.pi)
        by_mm, sd_mm = float(phase.by_mm[motor]), float(np.hypot(phase.sd_mm[motor], np.sum(before_mm)))
        if np.isfinite(sd_mm) and abs(by_mm) > max(LEAST_SHIFT_MM, 2 * sd_mm):
            words = say("motor-stands-elsewhere", name.upper(), f"{by_mm:+.2f}", f"{sd_mm:.2f}")
            found.append(Change(name.upper(), "phase", 0.0, by_mm, sd_mm, "mm", words))
    return found
