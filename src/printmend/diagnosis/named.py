"""The posterior of a printer in words: faults that act, the Z screw included, and findings that fit no machine.

Each effect has its own words (`effects.words`); this module gathers the drawn machines. If nearly every drawn machine
has one of two effects and hardly any has both, the two are named together.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from printmend.effects import EFFECTS, Acts, Of, Places, Scene, title_of
from printmend.effects.effect import FEW_LAYERS, HARDLY_ANY, NEARLY_ALL, drawn_places
from printmend.effects.homing import lasting
from printmend.effects.wobble import LEAST_TURNS, OFTEN, shows_push, span_mm
from printmend.effects.words import (
    LEAST_SHOWN,
    NAMED_SIGMAS,
    Fault,
    Found,
    Told,
    amount,
    carrier_name,
    fault_of,
    is_of_motor,
    part_of,
    plain_kind,
    stands_out,
)
from printmend.errors import TraceError
from printmend.infer.machine import DRAWS, LIKELY, Part
from printmend.infer.screw import fit_height
from printmend.measure.checks import LEAST_RANK_CORRELATION, POSSIBLE_LEADS
from printmend.messages import Said, catalogue, is_one_of, parts_of, say, together
from printmend.model import SavedModel, screw_of
from printmend.model.branches import HARMONICS, ScrewSeries
from printmend.model.model import NOTE, SEVERITIES, WARNING, Misfit
from printmend.path import Trace, last_way
from printmend.printer import Printer

# What measured heights show of the Z screw's lift, and what they leave open.
#
# How it pushes the layers aside is an effect like others (`effects.wobble`).

KINDS = ("lead", "periodic", "backlash")
NOT_DOWN = "z-backlash-no-height-measured-after"  # message: what a tower without a way down leaves open
_GAPS = (  # messages: gaps of Z
    "z-heights-span-mm-turn-screw", "z-told-mm-only-measure-more", NOT_DOWN, "z-lead-backlash-no-heights-were",
    "z-wobble-flat-print",
)  # fmt: skip
Z_SAID = "z"  # the document's key of what was said of the lift, kind by kind


@dataclass(frozen=True, eq=False)
class Quantity:
    """One of `KINDS` as heights show it: its ``terms``, what is said of them, nothing of none, and how sure that is: in
    % for the lead, else in mm."""

    terms: np.ndarray
    said: str = ""
    faults: tuple[Fault, ...] = ()
    sd: float = 0.0


@dataclass(frozen=True, eq=False)
class Lift:
    """What is known of how the screw lifts, by kind; ``gaps`` says why the others are not."""

    known: Mapping[str, Quantity] = field(default_factory=dict)
    gaps: Mapping[str, str] = field(default_factory=dict)

    @property
    def faults(self) -> list[Fault]:
        return [fault for kind in KINDS if kind in self.known for fault in self.known[kind].faults]

    @property
    def words(self) -> list[str]:
        return [self.known[kind].said for kind in KINDS if kind in self.known and self.known[kind].said]

    @property
    def said(self) -> dict[str, str]:
        """What was said of each kind, as a model keeps it."""
        return {kind: self.known[kind].said for kind in KINDS if kind in self.known}

    def with_push(self, lead_mm: float, push_mm: np.ndarray) -> ScrewSeries | None:
        """Return the whole screw, None for one without a fault."""
        if not self.faults and not push_mm.any():
            return None
        of = {kind: each.terms for kind, each in self.known.items()}
        none = np.zeros(1)
        return ScrewSeries(
            lead_mm, float(of.get("lead", none)[0]), float(of.get("backlash", none)[0]),
            of.get("periodic", np.zeros(2 * HARMONICS)), push_mm,
        )  # fmt: skip


def lift_of(model: SavedModel) -> Lift:
    """Return what a model knows of how its screw lifts."""
    series = screw_of(model) or ScrewSeries.healthy(model.printer.z.mm_per_turn)
    terms = (np.array([series.lead_error]), series.height_mm, np.array([series.backlash_mm]))
    said = model.document.get(Z_SAID, {})
    rows = [row for row in model.document.get("diagnosis", []) if row["part"] == "z"]
    known = {}
    for kind, each in zip(KINDS, terms, strict=True):
        faults = tuple(fault_of(row) for row in rows if row["kind"].startswith(kind))
        if kind in said or each.any():
            known[kind] = Quantity(each, said.get(kind, ""), faults, faults[0].sd if faults else 0.0)
    return Lift(known)


def renewed_lift(old: Lift, new: Lift) -> Lift:
    """Return an old lift updated with new heights; a quantity that was known better, and is not contradicted, stays."""
    known = dict(old.known)
    for kind, now in new.known.items():
        was = old.known.get(kind)
        if was is None or not was.faults or not was.sd < now.sd or _away(kind, was, now):
            known[kind] = now
    return Lift(known, {kind: gap for kind, gap in new.gaps.items() if kind not in known})


def _away(kind: str, was: Quantity, now: Quantity) -> bool:
    unit = 100.0 if kind == "lead" else 1.0
    away = unit * float(np.linalg.norm((now.terms - was.terms)[:2]))
    return away > NAMED_SIGMAS * float(np.hypot(now.sd, was.sd))


def find_lift(trace: Trace, printer: Printer) -> Lift | None:
    """Learn how Z lifts, None where too few heights were measured.

    Raises `TraceError` for heights that are none of this printer.
    """
    if trace.z_mm is None or trace.z_measured_mm is None:
        return None
    z_mm, measured_mm, seen = trace.z_mm, trace.z_measured_mm, np.isfinite(trace.z_measured_mm)
    if seen.sum() < FEW_LAYERS:
        return None
    lead_mm = printer.z.mm_per_turn
    span_mm = float(np.ptp(z_mm[seen]))
    known: dict[str, Quantity] = {}
    gaps: dict[str, str] = {}
    turns = span_mm >= LEAST_TURNS * lead_mm
    if turns:
        _check_follows(z_mm[seen], measured_mm[seen])
    height = fit_height(z_mm, measured_mm, printer, turns=turns)
    if turns:
        lead, waves = _of_lead(height.terms[:1], height.sds[0]), _of_waves(height.terms[1:], height.sds[1:])
        for kind, own, sd_mm in (("lead", lead, float(height.sds[0] * span_mm)), ("periodic", waves, waves.sd)):
            if not own.terms.any() and sd_mm > WARNED_MM:
                gaps[kind] = say("z-told-mm-only-measure-more", say(f"z-{kind}"), f"{sd_mm:.2f}")
            else:
                known[kind] = own
    else:
        gaps["lead"] = too_low("lead-and-unevenness", span_mm, lead_mm)
    if (last_way(z_mm)[seen] < 0).any():  # a height was measured after the nozzle came down to it
        backlash_mm, sd = height.backlash_mm, height.backlash_sd_mm
        said = say("z-has-backlash", amount(backlash_mm, sd)) if backlash_mm else ""
        faults = (Fault("z", "backlash", backlash_mm, sd, "mm", said),) if backlash_mm else ()
        known["backlash"] = Quantity(np.array([backlash_mm]), said, faults, sd)
    else:
        gaps["backlash"] = say(NOT_DOWN)
    return Lift(known, gaps)


def _of_lead(terms: np.ndarray, share_sd: float) -> Quantity:
    percent, sd = 100 * float(terms[0]), 100 * float(share_sd)
    if not percent:
        return Quantity(terms, sd=sd)
    said = say("z-lead-too-long" if percent > 0 else "z-lead-too-short", amount(abs(percent), sd, "%"))
    return Quantity(terms, said, (Fault("z", "lead", percent, sd, "%", said),), sd)


def _of_waves(terms: np.ndarray, sds: np.ndarray) -> Quantity:
    once_sd = float(_sizes(sds)[0] / np.sqrt(2))
    each = ((k, size, float(sds[2 * k - 1])) for k, size in enumerate(_sizes(terms), 1))
    waved = [(k, size, sd) for k, size, sd in each if stands_out(size, sd)]
    if not waved:
        return Quantity(terms, sd=once_sd)
    said = say("z-lifts-unevenly", together(" / ", [say(OFTEN[k - 1], amount(size, sd)) for k, size, sd in waved]))
    faults = tuple(Fault("z", f"periodic-{k}", float(size), sd, "mm", said) for k, size, sd in waved)
    return Quantity(terms, said, faults, once_sd)


def _check_follows(z_mm: np.ndarray, measured_mm: np.ndarray) -> None:
    """Raise `TraceError` where measured heights [N] do not go with the commanded ones [N]."""
    wanted, came = (height - height.mean() for height in (z_mm, measured_mm))
    followed = float(wanted @ came / (wanted @ wanted))
    likeness = float(wanted @ came / max(np.linalg.norm(wanted) * np.linalg.norm(came), 1e-9))
    if likeness < LEAST_RANK_CORRELATION or not POSSIBLE_LEADS[0] < followed < POSSIBLE_LEADS[1]:
        raise TraceError(
            say("trace"), wanted=say("heights-that-follow"),
            came=say("heights-follow", f"{followed:.2f}", f"{likeness:.2f}"), todo=say("check-heights"),
        )  # fmt: skip


def is_gap_of_z(gap: str) -> bool:
    """Say whether a gap of a trace is one of Z, which a tower shows and no flat print."""
    return is_one_of(gap, _GAPS)


def too_low(what: str, span_mm: float, lead_mm: float) -> str:
    """Say that heights span too little to tell something of Z."""
    return say("z-heights-span-mm-turn-screw", say(f"z-{what}"), f"{span_mm:.1f}", f"{lead_mm:g}")


def _push_gap(scene: Scene) -> str:
    """Say that the measured layers do not show how the screw pushes them aside."""
    if not scene.layers:
        return say("z-wobble-flat-print")
    return too_low("wobble", span_mm(scene), scene.printer.z.mm_per_turn)


def _sizes(terms: np.ndarray) -> np.ndarray:
    """Return the amplitude of each harmonic of (a_1, b_1, a_2, …)."""
    return np.hypot(terms[::2], terms[1::2])


LEAST_COST_MM = 0.018  # root mean square on a print from which on an owner sees what cannot act
WARNED_MM = 0.03  # … and from which on it is a warning; a screw that is told less well is not called healthy
COVERED_SHARE = 0.6  # share of an axis of the bed that a print must span
UNSEEN = "unseen"  # the kind of the note about the rest
MOST_RIVALS = 2  # that are named beside an effect
SILENT = ("origin", "stretch", "resized", "paper", "shrinkage")  # no place is known, or they are said beside the scale


@dataclass(frozen=True)
class Diagnosis:
    """What was learned: the faults, one sentence about them, and one for each gap of the trace."""

    faults: tuple[Fault, ...]
    summary: str
    gaps: tuple[str, ...]


def diagnose(
    parts: Sequence[Part], scene: Scene, gaps: Sequence[str] = (), lift: Lift | None = None, before: str = ""
) -> Diagnosis:
    """Return the faults that act in one sentence, motor by motor; ``gaps`` is what the trace could not tell, ``lift``
    what is known of how Z lifts. What the sentence ``before`` left open stays so: a model's parts hold nothing of what
    its instrument may have done."""
    faults = faults_of(parts, scene)
    open_ = {part.values["a"] for part in parts_of(before) if is_one_of(part, ["motor-open"])}
    said = {name: [fault.words for fault in faults if fault.part == name] for name in (*scene.printer.motors, "frame")}
    motors = [
        say("motor-has", name.upper(), together(", ", said[name]))
        if said[name]
        else _unnamed(parts, motor, scene, open_)
        for motor, name in enumerate(scene.printer.motors)
    ]
    frame = [say("frame-has", together(", ", said["frame"]))] if said["frame"] else []
    lifts = lift or Lift()
    of_z = [*lifts.words, *(fault.words for fault in faults if fault.part == "z" and fault.words)]
    screw = [say("motor-has", "Z", together(", ", of_z))] if of_z else []
    screw = screw or ([say("motor-healthy", "Z")] if "lead" in lifts.known else [])
    summary = together("; ", [*motors, *frame, *screw])
    of_push = [] if shows_push(scene) else [_push_gap(scene)]
    return Diagnosis((*faults, *lifts.faults), summary, tuple(dict.fromkeys((*gaps, *of_push, *lifts.gaps.values()))))


def _unnamed(parts: Sequence[Part], motor: int, scene: Scene, open_: Collection[str]) -> str:
    """Say of a motor without a named fault whether what acts on it, or what most drawn machines have and the
    measurement tells from its own errors, moves a print all the same, and whether that is what no mechanism holds. One
    that is ``open_``, or may have what is told of the measurement, is not called healthy."""
    every = gathered(parts)
    own = [
        one for one in every
        if one.where == motor and is_of_motor(one.law) and (one.acts or one.chance >= LIKELY)
        and (one.law.of is Of.MACHINE or one.law.acts is Acts.DRIVE)
    ]  # fmt: skip
    places, name = drawn_places(scene), scene.printer.motors[motor].upper()
    size_mm = _rms_mm(sum((one.columns(places, scene) @ one.sizes_mm for one in own), np.zeros((1, 2))))
    drawn_mm = sum((one.columns(places, scene) @ one.draws_mm for one in own), np.zeros((1, 2, 1)))
    drawn_mm = drawn_mm[:, :, drawn_mm.any(axis=(0, 1))]
    sd_mm = float(np.sqrt(drawn_mm.var(axis=2).sum(axis=1).mean())) if drawn_mm.size else 0.0
    is_sure = size_mm > NAMED_SIGMAS * sd_mm or any(one.acts for one in own)
    if size_mm < LEAST_SHOWN or not is_sure:
        is_open = name in open_ or any(_is_told_of(motor, one, every, scene) for one in every)
        return say("motor-open" if is_open else "motor-healthy", name)
    return say(
        "motor-not-held" if any(_is_told(one) and not one.acts for one in own) else "motor-unclear",
        name,
        f"{size_mm:.2f}",
    )


def _is_told_of(motor: int, one: Found, every: Sequence[Found], scene: Scene) -> bool:
    """Tell whether an error that is told of the measurement may be a motor's; on a CoreXY both move each axis."""
    if not _is_told(one) or not (scene.corexy or one.where == motor) or not _is_sure(one):
        return False
    is_shown = _moved_mm(one, one.sizes_mm, drawn_places(scene), scene) >= LEAST_SHOWN
    is_likely = _chance(one, _rivals(one, every)) >= LIKELY
    return is_shown and is_likely and any(told.may_be_printers for told in _told(one, every, scene))


def words_of_z(summary: str) -> list[Said]:
    """Return what a diagnosis in one sentence says of Z."""
    said = [part for part in parts_of(summary) if is_one_of(part, ("motor-has", "motor-healthy"))]
    return [part for part in said if part.values["a"] == "Z"]


def part_words(part: str) -> str:
    """Return the name of a fault's part: a motor in capitals, or the frame."""
    return part.upper() if len(part) == 1 else say("part-frame") if part == "frame" else part


def kind_words(kind: str) -> str:
    """Return in words what a kind of fault is the size of: ``harmonic-1`` is a pulley's eccentricity."""
    plain = plain_kind(kind)
    known = next((name for name in (kind, plain) if f"kind-{name}" in catalogue()), None)
    return say(f"kind-{known}", kind[len(plain) + 1 :]) if known else kind.replace("_", " ")


def faults_of(parts: Sequence[Part], scene: Scene) -> list[Fault]:
    """Name the faults that act, motor by motor and the frame last; one that another effect explains as well says so."""
    return list(filter(is_named, acting_faults(parts, scene)))


def acting_faults(parts: Sequence[Part], scene: Scene) -> list[Fault]:
    """Return the faults that act, and those that are certain and do not; those that are too small or too uncertain for
    a name, too."""
    every = gathered(parts)
    there = [replace(one, acts=one.acts or _is_certain(one)) for one in every]
    found: list[Fault] = []
    for one, as_told in zip(every, there, strict=True):
        if not (one.acts or (as_told.acts and one.law.of is Of.MACHINE)):
            continue
        rivals = _rivals(one, every)
        for fault in _faults(as_told, there, scene):
            words = _or_else(fault.words, one, rivals, scene)
            words = words if one.acts else say("not-corrected", words)
            is_doubtful = one.is_held and not (one.acts or _is_lost(one, scene))
            found.append(replace(fault, words=words, is_mended=one.acts, is_doubtful=is_doubtful))
    order = [*scene.printer.motors, "frame"]
    return sorted(found, key=lambda fault: order.index(fault.part) if fault.part in order else len(order))


def misfits_of(parts: Sequence[Part], scene: Scene, nats: Sequence[float] = ()) -> list[Misfit]:
    """Say what cannot act: of the print, of the measurement, or of the printer but held by no mechanism.

    ``nats`` say how well the first of the parts are supported.
    """
    every = gathered(parts)
    evidence = {(part.effect, part.where): each for part, each in zip(parts, nats, strict=False)}
    places = drawn_places(scene)
    found: list[Misfit] = []
    said: list[Found] = []
    for one in sorted(every, key=lambda each: -each.chance):
        rivals = _rivals(one, every)
        if not _is_told(one) or any(each in said or each.acts for each in rivals):
            continue
        chance = _chance(one, rivals)
        if chance < LIKELY or not _is_sure(one):
            continue
        size_mm = _moved_mm(one, one.sizes_mm, places, scene)
        nats_of = evidence.get((one.effect, one.where), float(np.log(chance / max(1 - chance, 1 / DRAWS))))
        for told in _told(one, every, scene):
            words = _or_else(told.words, one, rivals, scene)
            words = words if chance >= NEARLY_ALL or rivals else say("likely-certain", words)
            if size_mm >= (LEAST_SHOWN if told.is_harmless else LEAST_COST_MM):
                severity = WARNING if size_mm >= WARNED_MM and not told.is_harmless else NOTE
                found.append(Misfit(told.kind, severity, size_mm, nats_of, words))
                said.append(one)
    found = [*_one_of_each(found), *unseen(scene)]
    return sorted(found, key=lambda each: (-SEVERITIES.index(each.severity), -each.size_mm))


def _is_certain(found: Found) -> bool:
    """Tell whether nearly every drawn machine has an effect that a mechanism holds."""
    return found.law.acts is not Acts.NOT and found.chance >= NEARLY_ALL


def _is_lost(found: Found, scene: Scene) -> bool:
    """Tell whether an effect does not act because the next homing shifts it too far."""
    share = lasting(found.sizes_mm, found.effect, found.where, found.shape, scene)
    return share is not None and not share.any()


def unseen(scene: Scene) -> list[Misfit]:
    """Say which part of the bed was never measured."""
    parts = []
    for axis, name, (low, high) in zip(scene.printer.axes[:2], "XY", scene.bed_span_mm, strict=True):
        if high - low < COVERED_SHARE * (axis.max_mm - axis.min_mm):
            span = f"{low:.0f}", f"{high:.0f}", f"{axis.min_mm:.0f}", f"{axis.max_mm:.0f}"
            parts.append(say("axis-from-to-of", name, *span))
    if not parts:
        return []
    words = say("only-part-measured", parts[0] if len(parts) == 1 else say("and", *parts))
    return [Misfit(UNSEEN, NOTE, 0.0, 0.0, words)]


def gathered(parts: Sequence[Part]) -> list[Found]:
    """Return the effects that act or that any drawn machine has, near shapes of one put together; those that act first,
    as they come."""
    left = sorted(parts, key=lambda part: (not part.acts_mm.any(), -part.chance))
    left = [part for part in left if (part.acts_mm.any() or part.draws_mm.any()) and part.effect in EFFECTS]
    found: list[Found] = []
    while left:
        first, *left = left
        there, draws = np.asarray(first.draws_mm.any(axis=0)), first.draws_mm
        for part in sorted(filter(partial(_is_alternative, first), left), key=partial(_apart, first)):
            free = part.draws_mm.any(axis=0) & ~there  # machines that have both have two
            there, draws = there | free, draws + part.draws_mm * free
            at = next(number for number, each in enumerate(left) if each is part)
            left[at] = replace(part, draws_mm=part.draws_mm * ~free)
        left = [part for part in left if part.acts_mm.any() or part.draws_mm.any()]
        acts, is_wave = bool(first.acts_mm.any()), hasattr(EFFECTS[first.effect], "waves_mm")
        alone = draws is first.draws_mm and not is_wave  # else near shapes, or the next homings, share what acts
        sizes = (first.acts_mm if alone else draws.mean(axis=1)) if acts else draws[:, there].mean(axis=1)
        found.append(Found(EFFECTS[first.effect], first.where, first.shape, sizes, draws, acts))
    return found


def _is_alternative(first: Part, part: Part) -> bool:
    """Tell whether a part may be the same effect with another shape: of those that act, each is one of its own."""
    same = (part.effect, part.where, len(part.draws_mm)) == (first.effect, first.where, len(first.draws_mm))
    return same and not part.acts_mm.any()


def _apart(first: Part, part: Part) -> float:
    return float(np.abs(np.subtract(part.shape, first.shape)).sum())


def _is_told(found: Found) -> bool:
    """Tell whether an effect is told as what does not fit: it cannot act, or not in every print alike."""
    return not found.is_held or found.law.of is not Of.MACHINE


def _faults(found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Fault]:
    if hasattr(found.law, "faults"):
        yield from found.law.faults(found, beside, scene)
        return
    if _is_told(found):
        return
    places = drawn_places(scene)
    size, sd = found.size(lambda sizes: _moved_mm(found, sizes, places, scene))
    part = scene.printer.motors[found.where] if found.law.acts is Acts.DRIVE else "frame"
    yield Fault(part, found.effect, size, sd, "mm", say("fault-plain", _plain(found), f"{size:.2f}"))


def _told(found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
    if hasattr(found.law, "told"):
        yield from found.law.told(found, beside, scene)
    elif found.effect not in SILENT:
        where = carrier_name(scene, found.where)
        size_mm = _moved_mm(found, found.sizes_mm, drawn_places(scene), scene)
        words = say("shows-plain", where, _plain(found), f"{size_mm:.2f}")
        yield Told(found.effect, words, is_harmless=found.law.of is Of.INSTRUMENT)


def _plain(found: Found) -> str:
    return found.effect.replace("_", " ")


def is_named(fault: Fault) -> bool:
    """Tell whether a fault is large enough, and sure enough, to have a name."""
    return stands_out(fault.size, fault.sd)


def _is_sure(found: Found) -> bool:
    """Tell whether the sizes of an effect are known, in the machines that have it."""
    drawn = found.draws_mm[:, found.there]
    return bool(np.linalg.norm(found.sizes_mm) > NAMED_SIGMAS * np.sqrt(np.mean(drawn.var(axis=1))))


def _or_else(words: str, found: Found, rivals: Sequence[Found], scene: Scene) -> str:
    """Return what is said of an effect with the likeliest of its rivals, by their names."""
    told = [each for each in rivals if each.effect not in SILENT]
    names = dict.fromkeys(_name(each, found, scene) for each in sorted(told, key=lambda each: -each.chance))
    first, *others = list(names)[:MOST_RIVALS] or [""]
    for other in others:
        first = say("or", first, other)
    return say("or-else", words, first) if first else words


def _name(rival: Found, found: Found, scene: Scene) -> str:
    """Return the name of an effect's rival, with the motor or axis that has it unless both are of the same motor."""
    title, part = title_of(rival.name) or _plain(rival), part_of(rival.law, rival.where, scene)
    own = found.where == rival.where and is_of_motor(found.law) and is_of_motor(rival.law)
    return title if own or not part else say("name-of-part", part, title)


def _rivals(found: Found, every: Sequence[Found]) -> list[Found]:
    """Return the effects that share the odds with one: none of them is certain, and one excludes the other."""
    others = [each for each in every if each is not found and _is_open(each)] if _is_open(found) else []
    return [each for each in others if _excludes(found, each)]


def _chance(found: Found, rivals: Sequence[Found]) -> float:
    """Return the share of drawn machines that have an effect or one of its rivals."""
    return float(np.mean(np.any([each.there for each in (found, *rivals)], axis=0)))


def _is_open(found: Found) -> bool:
    """Tell whether a drawn machine may have an effect or not."""
    return HARDLY_ANY <= found.chance <= NEARLY_ALL


def _excludes(found: Found, other: Found) -> bool:
    """Tell whether the drawn machines have either of two effects, and hardly ever both."""
    both, fewer = (found.there & other.there).sum(), min(found.there.sum(), other.there.sum())
    return bool(both <= HARDLY_ANY * fewer)


def _moved_mm(found: Found, sizes_mm: np.ndarray, places: Places, scene: Scene) -> float:
    """Return by how much an effect moves places, root mean square."""
    return _rms_mm(found.columns(places, scene) @ sizes_mm)


def _rms_mm(moved_mm: np.ndarray) -> float:
    """Return the root mean square of how far places move [N, 2]."""
    return float(np.sqrt(np.mean(np.square(moved_mm).sum(axis=1))))


def _one_of_each(found: Sequence[Misfit]) -> list[Misfit]:
    """Return one finding for each kind: those of both motors or axes are joined."""
    joined: dict[str, Misfit] = {}
    for each in found:
        if (old := joined.get(each.kind)) is not None:
            each = Misfit(
                old.kind, max(old.severity, each.severity, key=SEVERITIES.index),
                float(np.hypot(old.size_mm, each.size_mm)), old.evidence + each.evidence,
                together("; ", [old.words, each.words]),
            )  # fmt: skip
        joined[each.kind] = each
    return list(joined.values())
