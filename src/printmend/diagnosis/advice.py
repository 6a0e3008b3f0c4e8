"""Advice for an owner: what a fault means, what to repair, what the software corrects, and what to print next."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from printmend.diagnosis.named import WARNED_MM
from printmend.effects import EFFECTS
from printmend.effects.effect import NEARLY_ALL
from printmend.effects.wobble import shows_push
from printmend.effects.words import REPAIR_MM, SOON_MM, Care, Fault, fault_of, plain_kind
from printmend.infer.fit import FEWEST_READ, Fit
from printmend.infer.machine import Part
from printmend.messages import catalogue, is_one_of, say, together, within
from printmend.model.model import REFITTED, SavedModel, said_of
from printmend.units import SELDOM_SDS

# The gaps of a trace: what it did not show of a motor, and the print that would.

SECTORS_PER_TURN = 40  # sectors of 9° in which contacts are counted
LEAST_CROSSING_MM = 3.0  # how far the other axis must move by itself, root mean square, for a crooked frame to show


@dataclass(frozen=True)
class Sight:
    """What the marks could see of one motor: the span of its contacts in ``turns``, the share of one turn that any of
    them met and that those ``forward`` and ``backward`` met, and how many of these there are."""

    turns: float
    angles: float
    forward_angles: float
    backward_angles: float
    forward: int
    backward: int


def gaps_of(fit: Fit, known: Sequence[Part] = ()) -> tuple[str, ...]:
    """Return the gaps of a trace, motor by motor, a sentence each, and how exactly its layers tell a push of Z. Parts
    of the machine may be ``known`` beside those that the trace was searched for."""
    printer, places = fit.scene.printer, fit.places.at(np.unique(fit.rows.mark))
    found = [*(block.slot for block in fit.blocks), *(part.key[:2] for part in known if part.is_likely)]
    plays = {motor for effect, motor in found if effect in ("play", "breathing", "friction")}
    gaps = []
    for motor, (name, turn_mm) in enumerate(zip(printer.motors, fit.scene.turns_mm, strict=True)):
        seen = sight(places.motor_mm[:, motor], places.side[:, motor], turn_mm)
        gaps += motor_gaps(name.upper(), seen, turn_mm, plays=motor in plays)
    one, two = printer.to_motor(places.bed_mm).T if len(places) else np.zeros((2, 1))
    if not _crosses(one, two) and not _crosses(two, one):
        first, second = (name.upper() for name in printer.motors)
        gaps.append(say("moved-together-only-so-crooked-frame", first, second))
    return (*gaps, *_wobble_gap(fit)) if shows_push(fit.scene) else tuple(gaps)


def _wobble_gap(fit: Fit) -> Iterator[str]:
    """Say how exactly the layers tell a push of Z once a turn, found or not, where that is not enough."""
    blocks, state = fit.dictionary.blocks, fit.state
    if not any(block.effect == "wobble" for block in fit.blocks):
        tried = next(b for b, block in enumerate(blocks) if block.effect == "wobble")
        state = fit.search.posterior((*state.members, (tried, 0)), state.sigma_mm, rounds=0)
    sds_mm = np.sqrt(np.diag(state.covariance))
    own = [sds_mm[at][::2] for (b, _), at in zip(state.members, fit.dictionary.own(state.members), strict=True)
           if blocks[b].effect == "wobble"]  # fmt: skip
    if (sd_mm := float(np.sqrt(np.mean(np.square(own))))) > WARNED_MM:
        yield say("z-told-mm-only-measure-more", say("z-wobble"), f"{sd_mm:.2f}")


def sight(motor_mm: np.ndarray, side: np.ndarray, turn_mm: float) -> Sight:
    """Return what marks [N] in contact at these positions of a motor, on these sides of its play, could see."""
    angles, counts = [], []
    seen = np.zeros(SECTORS_PER_TURN, bool)
    for way in (-1, 1):
        used = motor_mm[side == way]
        sector = (np.mod(used / turn_mm, 1.0) * SECTORS_PER_TURN).astype(np.int64) % SECTORS_PER_TURN
        hit = np.bincount(sector, minlength=SECTORS_PER_TURN) > 0
        # The neighbours of a hit count as seen, so that few marks are judged by their gaps and not by their count.
        hit |= np.roll(hit, 1) | np.roll(hit, -1)
        seen |= hit
        angles.append(float(hit.mean()))
        counts.append(len(used))
    # Whatever its neighbours, a span shorter than a turn leaves the rest of the turn unseen.
    turns = float(np.ptp(motor_mm[side != 0])) / turn_mm if (side != 0).any() else 0.0
    return Sight(turns, min(float(seen.mean()), turns), angles[0], angles[1], counts[0], counts[1])


def motor_gaps(name: str, seen: Sight, turn_mm: float, *, plays: bool) -> list[str]:
    """Return the gaps of one motor, and the prints that would close them."""
    gaps: list[str] = []
    if seen.angles < NEARLY_ALL:
        longer = say("print-least-mm-along-better-two", f"{turn_mm:.0f}", name, f"{2 * turn_mm:.0f}")
        spread = say("points-lie-same-few-angles-each", f"{turn_mm:.0f}")
        gaps.append(
            say("seen-over-part-of-turn", name, f"{100 * seen.angles:.0f}", longer if seen.turns < 1 else spread)
        )
    if min(seen.forward, seen.backward) < FEWEST_READ:
        way = say("forwards" if seen.forward > seen.backward else "backwards")
        gaps.append(say("measured-moving-only-so-play-unknown", name, way))
    elif plays and min(seen.forward_angles, seen.backward_angles) < NEARLY_ALL <= seen.angles:
        less = say("forwards" if seen.forward_angles < seen.backward_angles else "backwards")
        share = 100 * min(seen.forward_angles, seen.backward_angles)
        gaps.append(say("moved-over-pulley-s-turn-only", name, less, f"{share:.0f}", f"{turn_mm:.0f}"))
    return gaps


def _crosses(own_mm: np.ndarray, other_mm: np.ndarray) -> bool:
    """Tell whether the other motor moved by itself, not only along with this one."""
    own, other = own_mm - own_mm.mean(), other_mm - other_mm.mean()
    together = float(own @ other) / max(float(own @ own), 1e-300)
    return float(np.std(other - together * own)) > LEAST_CROSSING_MM


CERTAIN_SIGMAS = 10.0  # standard deviations from 0 at which a fault is certain; any that is named is likely
URGENCY = {  # the most urgent first
    "repair": say("urgency-repair"), "soon": say("urgency-soon"), "left": say("urgency-left"),
    "software": say("urgency-software"),
}  # fmt: skip
WORK = ("repair", "soon")  # urgencies of what an owner does something about


_NOTHING = (  # messages: nothing is broken, so nothing needs a repair
    "nothing-repair", "nothing-repair-correct-steps-per-millimetre", "nothing-repair-correct-z-steps-per",
    "nothing-repair-walls-look-good-else", "nothing-repair-walls-look-good-else-2",
    "nothing-repair-walls-look-good-else-3", "nothing-repair-walls-look-good-else-4",
    "nothing-repair-set-backlash-compensation",
)  # fmt: skip


@dataclass(frozen=True)
class Advice:
    """What to do about one fault: ``urgency`` is repair, soon, left (files are not mended for it) or software;
    ``effect_mm`` how far it shifts a print."""

    title: str
    meaning: str
    sure: str
    effect_mm: float
    urgency: str
    repair: str
    software: str


def advise(fault: Fault, *, corexy: bool = False, rails: bool = False) -> Advice:
    """Return the advice for one fault; ``rails`` says that the rails or the head of a CoreXY seem to have play, which
    the model tells as its belts'."""
    where = say("motor", fault.part.upper()) if corexy and fault.part != "frame" else fault.part.upper()
    kind = plain_kind(fault.kind)
    care = _care_of(kind, fault, where)
    repair = say("look-rails-head-first-play-may") if rails and kind == "play" else care.repair
    urgency, software = "software", care.software
    if care.effect_mm >= SOON_MM and not is_one_of(repair, _NOTHING):
        urgency = "repair" if care.effect_mm >= REPAIR_MM else "soon"
    if urgency == "software" and not is_one_of(repair, (*_NOTHING, "nothing-replace", "nothing-tighten")):
        repair = say("nothing-while-small", within(repair))
    if not fault.is_mended:
        why = kind if f"printmend-leaves-{kind}" in catalogue() else "doubtful" if fault.is_doubtful else "phase"
        urgency, software = urgency if urgency in WORK else "left", say(f"printmend-leaves-{why}")
    return Advice(care.title, care.meaning, _sure(fault), care.effect_mm, urgency, repair, software)


# Kinds of fault of a motor whose repair moves neither belt nor pulley; after any other the motor may stand elsewhere.
_NO_BELT = ("friction", "rub", "offset")


def advised(document: Mapping[str, Any]) -> list[tuple[dict[str, Any], Advice]]:
    """Return the faults of a saved model's document, each with the advice for it."""
    corexy = document["printer"]["kinematics"] == "corexy"
    rails = bool(said_of(document, "rail-play"))
    return [(row, advise(fault_of(row), corexy=corexy, rails=rails)) for row in document.get("diagnosis", [])]


def work_words(model: SavedModel) -> tuple[str, ...]:
    """Return a sentence for an owner who may have done the work on belts or pulleys that a model advises, and how to
    measure again; none where no such work is advised, or where the model knows of it."""
    document = model.document
    rows = [row for row, one in advised(document) if one.urgency in WORK and row["kind"] not in _NO_BELT]
    motors = [name for name in document["motors"] if any(row["part"] == name for row in rows)]
    if not motors or said_of(document, REFITTED):
        return ()
    options = " ".join(f"--refitted {name}" for name in motors)
    return (
        say("if-work-done-measure-again", together(", ", [name.upper() for name in motors]), model.called, options),
    )


def _care_of(kind: str, fault: Fault, where: str) -> Care:
    """Return what the effect says whose kind of fault it is, or what is said of a screw's lift."""
    for effect in EFFECTS.values():
        if hasattr(effect, "advice") and kind in getattr(effect, "kinds", (effect.name,)):
            return effect.advice(fault, where)
    size = fault.size
    if kind == "lead":  # mm in 100 mm
        title = say("prints-come-out-too", say("tall" if fault.value > 0 else "low"))
        return Care(title, say("mm-100-mm-height", fault.shown), size, say("nothing-repair-correct-z-steps-per"))
    if kind == "periodic":
        meaning = say("layers-too-thick-too-thin-turns", fault.shown)
        return Care(say("z-screw-lifts-unevenly"), meaning, size, say("clean-grease-z-screw-replace-if"))
    if kind == "backlash":
        meaning = say("after-each-z-hop-nozzle-mm", fault.shown)
        return Care(say("z-nut-has-play"), meaning, size, say("replace-z-nut-fit-one-spring"))
    effect_mm = size if fault.unit == "mm" else 0.0
    return Care(together(": ", [where, fault.kind]), fault.words, effect_mm, say("have-a-look"))


def _sure(fault: Fault) -> str:
    """Return how sure a fault is, and its range (two standard deviations)."""
    if fault.sd <= 0:
        return say("seen-size-estimate-without-error-bar")
    size, sigmas, off = fault.size, fault.size / fault.sd, SELDOM_SDS * fault.sd
    word = say("certain" if sigmas >= CERTAIN_SIGMAS else "likely")
    digits = 3 if fault.sd < 0.01 else 2
    first, last = f"{max(size - off, 0):.{digits}f}", f"{size + off:.{digits}f}"
    return say("sure-of", word, last, fault.unit) if first == last else say("between", word, first, last, fault.unit)
