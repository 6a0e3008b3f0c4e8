"""Advice for an owner: what a fault means, what to repair, and what the software corrects."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from printmend.effects import EFFECTS
from printmend.effects.words import SOON_MM, Care, fault_of
from printmend.effects.words import Fault as NamedFault
from printmend.messages import is_one_of, parts_of, say, together, within
from printmend.model.notes import REFITTED, said_of

CERTAIN_SIGMAS, LIKELY_SIGMAS = 10.0, 5.0  # standard deviations from 0 at which a fault is certain, or very likely
REPAIR_MM = 0.5  # effect on a print above which a part should be replaced
SPAN_MM = 100.0  # size of the print whose error is stated, for faults that grow with it
LEAST_ADVICE_MM = 0.01  # a fault with a smaller effect gets no paragraph
URGENCY = {  # the most urgent first
    "repair": say("urgency-repair"), "soon": say("urgency-soon"), "left": say("urgency-left"),
    "software": say("urgency-software"),
}  # fmt: skip
WORK = ("repair", "soon")  # urgencies of what an owner does something about


_NOTHING = (  # messages: nothing is broken, so nothing needs a repair
    "nothing-repair", "nothing-repair-correct-steps-per-millimetre", "nothing-repair-correct-z-steps-per",
    "nothing-repair-walls-look-good-else", "nothing-repair-walls-look-good-else-2",
    "nothing-repair-walls-look-good-else-3", "nothing-repair-walls-look-good-else-4",
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


def advise(fault: NamedFault, *, corexy: bool = False, rails: bool = False) -> Advice:
    """Return the advice for one fault; ``rails`` says that the rails or the head of a CoreXY seem to have play, which
    the model tells as its belts'."""
    where = say("motor", fault.part.upper()) if corexy and fault.part != "frame" else fault.part.upper()
    size = abs(fault.value)
    kind = fault.kind.rstrip("0123456789.").removesuffix("-")  # harmonic-2 is a harmonic
    title, meaning, effect, repair, software = _said(kind, where, fault, size)
    if rails and kind == "play":
        repair = say("look-rails-head-first-play-may")
    nothing = is_one_of(repair, _NOTHING)
    urgency = (
        "software" if nothing else "repair" if effect >= REPAIR_MM else "soon" if effect >= SOON_MM else "software"
    )
    if urgency == "software" and not is_one_of(repair, (*_NOTHING, "nothing-replace", "nothing-tighten")):
        repair = say("nothing-while-small", within(repair))
    if not fault.is_mended:
        urgency, software = urgency if urgency in WORK else "left", say("printmend-leaves-phase")
    return Advice(title, meaning, _sure(fault), effect, urgency, repair, software)


# Kinds of fault of a motor whose repair moves neither belt nor pulley; after any other the motor may stand elsewhere.
_NO_BELT = ("friction", "rub", "offset")


def advised(document: Mapping[str, Any]) -> list[tuple[dict[str, Any], Advice]]:
    """Return the faults of a saved model's document, each with the advice for it."""
    corexy = document["printer"]["kinematics"] == "corexy"
    rails = bool(said_of(document, "rail-play"))
    return [(row, advise(fault_of(row), corexy=corexy, rails=rails)) for row in document.get("diagnosis", [])]


def work_words(document: Mapping[str, Any]) -> tuple[str, ...]:
    """Return a sentence for an owner who may have done the work on belts or pulleys that a model advises, and how to
    measure again; none where no such work is advised, or where the model knows of it."""
    rows = [row for row, one in advised(document) if one.urgency in WORK and row["kind"] not in _NO_BELT]
    motors = [name for name in document["motors"] if any(row["part"] == name for row in rows)]
    if not motors or said_of(document, REFITTED):
        return ()
    options = " ".join(f"--refitted {name}" for name in motors)
    return (say("if-work-done-measure-again", together(", ", [name.upper() for name in motors]), options),)


def _said(kind: str, where: str, fault: NamedFault, size: float) -> "Said":
    """Return what is said of a kind here, or else by the effect whose kind it is."""
    if kind not in _SAY:
        for effect in EFFECTS.values():
            care: Care | None = effect.advice(fault, where) if hasattr(effect, "advice") else None
            if care is not None:
                return care.title, care.meaning, care.effect_mm, care.repair, care.software
    return _SAY.get(kind, _other)(where, fault, size)


def _sure(fault: NamedFault) -> str:
    """Return how sure a fault is, and its range (two standard deviations)."""
    if fault.sd <= 0:
        return say("seen-size-estimate-without-error-bar")
    sigmas = abs(fault.value) / fault.sd
    word = say("certain" if sigmas >= CERTAIN_SIGMAS else "very-likely" if sigmas >= LIKELY_SIGMAS else "likely")
    low, high = sorted((abs(fault.value) - 2 * fault.sd, abs(fault.value) + 2 * fault.sd))
    digits = 3 if fault.sd < 0.01 else 2
    first, last = f"{max(low, 0):.{digits}f}", f"{high:.{digits}f}"
    return say("sure-of", word, last, fault.unit) if first == last else say("between", word, first, last, fault.unit)


Said = tuple[str, str, float, str, str]


def _carries() -> str:
    return say("printmend-carries-all")


def _scale(where: str, fault: NamedFault, size: float) -> Said:
    effect = size / 100 * SPAN_MM
    word = say("large" if fault.value > 0 else "small")
    repair = (
        say("look-pulley-s-size-number-teeth") if size > 2 else
        say("nothing-repair-correct-steps-per-millimetre")
    )  # fmt: skip
    return (
        say("prints-too", where, f"{size:.2f}", word),
        say("every-100-mm-along-come-out", where, f"{effect:.2f}", say("long" if fault.value > 0 else "short")),
        effect, repair, say("firmware-can-hold-printmend"),
    )  # fmt: skip


def _harmonic(where: str, fault: NamedFault, size: float) -> Said:
    k = int(fault.kind.split("-")[1])
    effect = size / k
    if k == 1:
        title = say("pulley-off-centre", where)
        meaning = say("pulley-wobbles", f"{size:.2f}", f"{effect:.2f}")
        repair = say("replace-pulley-if-new-one-wobbles")
    else:
        shape = say({2: "shape-oval", 3: "shape-three-cornered", 4: "shape-four-cornered"}.get(k, "shape-uneven"))
        title = say("pulley", where, shape)
        meaning = say("pulley-out-of-round", f"{size:.2f}", k, f"{effect:.2f}")
        repair = say("replace-pulley-worn-squeezed-badly-made")
    if effect < SOON_MM:
        repair = say("nothing-replace")
    return title, meaning, effect, repair, _carries()


def _play(where: str, fault: NamedFault, size: float) -> Said:
    return (
        say("belt-has-play", where),
        say("after-each-change-direction-stands-still", where, f"{size:.2f}"),
        size,
        say("tighten-belt-then-look-pulley-s") if size >= SOON_MM else say("nothing-tighten"),
        say("printmend-carries-takes-slack-up-each"),
    )


def _loose(where: str, fault: NamedFault, size: float) -> Said:
    return (
        say("belt-loose-uneven-pulley", where),
        say("after-each-change-direction-stands-still-2", where, f"{size:.2f}"),
        size,
        say("tighten-belt-pulley-pulls-tight-lets"),
        say("printmend-carries"),
    )


def _by_angle(where: str, fault: NamedFault, size: float) -> Said:
    return (
        say("pulley-loose-shaft", where),
        say("after-each-change-direction-stands-still-3", where, f"{size:.2f}"),
        size,
        say("tighten-grub-screw-flat-motor-s"),
        say("printmend-carries-while-stays-loose-screw"),
    )


def _friction(where: str, fault: NamedFault, size: float) -> Said:
    return (
        say("runs-stiffly-belt-stretches", where),
        say("after-change-direction-lags-mm-more", where, f"{size:.2f}"),
        size,
        say("clean-oil-guides-look-wheel-bearing"),
        say("printmend-carries"),
    )


_IDLER = ("fault-elastic-or-idler", "fault-idler", "fault-idler-of-teeth", "fault-idler-or-pulley")  # messages


def _elastic(where: str, fault: NamedFault, size: float) -> Said:
    if any(part.id in _IDLER for part in parts_of(fault.words)):
        return (
            say("belt-stretches-idler-wobbles", where),
            say("pulley-s-error-changes-along-belt"),
            size, say("tighten-belt-unless-tight-look-whether"), _carries(),
        )  # fmt: skip
    return (
        say("belt-stretches", where),
        say("pulley-s-error-felt-near-motor"),
        size, say("tighten-belt-unless-tight"), _carries(),
    )  # fmt: skip


def _drift(where: str, fault: NamedFault, size: float) -> Said:
    return (
        say("stretches-unevenly-along-bed", where),
        say("scale-changes-along-up-mm", where, f"{size:.2f}"),
        size, say("look-along-belt-guide-bend-place"), _carries(),
    )  # fmt: skip


def _warp(where: str, fault: NamedFault, size: float) -> Said:
    return (
        say("runs-unevenly-along-way", where),
        say("along-print-swings-up-mm-same", where, f"{size:.2f}"),
        size,
        say("look-along-belt-worn-stretched-stretch")
        if size >= SOON_MM else say("nothing-replace"),
        _carries(),
    )  # fmt: skip


def _period(where: str, fault: NamedFault, size: float) -> Said:
    length = fault.kind.removeprefix("period-")
    return (
        say("swings-every-mm", where, length),
        say("lines-swing-mm-either-side-again", f"{size:.2f}"),
        size,
        say("clean-idlers-look-them-wobbles-pulley") if size >= SOON_MM
        else say("nothing-replace"),
        _carries(),
    )  # fmt: skip


def _offset(where: str, fault: NamedFault, size: float) -> Said:
    return (
        say("shifted", where),
        say("everything-lies-mm-one-side-shapes", f"{size:.2f}"),
        0.0, say("nothing-repair"), say("printmend-firmware-s-home-offset-carries"),
    )  # fmt: skip


def _skew(where: str, fault: NamedFault, size: float) -> Said:
    effect = SPAN_MM * math.tan(math.radians(size))
    return (
        say("frame-not-square"),
        say("right-angles-come-out-off-mm", f"{size:.2f}", f"{effect:.2f}"),
        effect,
        say("loosen-frame-square-tighten") if effect >= SOON_MM else say("nothing-repair"),
        say("firmware-can-hold-printmend-export-printmend"),
    )


def _axes(where: str, fault: NamedFault, size: float) -> Said:
    effect = size / 100 * SPAN_MM
    return (
        say("x-prints-larger" if fault.value > 0 else "x-prints-smaller", f"{size:.2f}"),
        say("squares-come-out-rectangles-whichever-motor", f"{effect:.2f}"), effect,
        say("look-whether-belts-run-along-guides") if effect >= SOON_MM
        else say("nothing-repair"), _carries(),
    )  # fmt: skip


def _bow(where: str, fault: NamedFault, size: float) -> Said:
    return _guides(say("guides-bent"), say("straight-lines-bow-up-mm-bed", f"{size:.2f}"), size)


def _wavy(where: str, fault: NamedFault, size: float) -> Said:
    return _guides(say("guides-wavy"), say("straight-lines-snake-up-mm", f"{size:.2f}"), size)


def _guides(title: str, meaning: str, size: float) -> Said:
    repair = say("look-along-rods-rails-replace-bent") if size >= SOON_MM else say("nothing-replace")
    return title, meaning, size, repair, _carries()


def _jump(where: str, fault: NamedFault, size: float) -> Said:
    return (
        say("lost-place-during-print", where),
        say("from-one-point-everything-lies-mm", f"{size:.2f}"),
        max(size, REPAIR_MM),
        say("tighten-belt-oil-guides-print-slower"),
        say("software-cannot-carry-nobody-knows-when"),
    )


def _lead(where: str, fault: NamedFault, size: float) -> Said:
    effect = size / 100 * SPAN_MM
    return (
        say("prints-come-out-too", say("tall" if fault.value > 0 else "low")),
        say("mm-100-mm-height", f"{effect:.2f}"), effect,
        say("nothing-repair-correct-z-steps-per"), _carries(),
    )  # fmt: skip


def _uneven(where: str, fault: NamedFault, size: float) -> Said:
    return (
        say("z-screw-lifts-unevenly"), say("layers-too-thick-too-thin-turns", f"{size:.2f}"), size,
        say("clean-grease-z-screw-replace-if"), _carries(),
    )  # fmt: skip


def _backlash(where: str, fault: NamedFault, size: float) -> Said:
    return (
        say("z-nut-has-play"), say("after-each-z-hop-nozzle-mm", f"{size:.2f}"), size,
        say("replace-z-nut-fit-one-spring"), _carries(),
    )  # fmt: skip


def _wobble(where: str, fault: NamedFault, size: float) -> Said:
    return (
        say("z-screw-bent"), say("pushes-layers-aside-mm-pattern-repeats", f"{size:.2f}"),
        size, say("roll-z-screw-flat-table-replace"), _carries(),
    )  # fmt: skip


def _other(where: str, fault: NamedFault, size: float) -> Said:
    return (
        together(": ", [where, fault.kind]),
        fault.words,
        size if fault.unit == "mm" else 0.0,
        say("have-a-look"),
        _carries(),
    )


_SAY = {
    "scale": _scale, "harmonic": _harmonic, "play": _play, "loose-belt": _loose, "play-by-angle": _by_angle,
    "friction": _friction, "elastic": _elastic, "drift": _drift, "warp": _warp, "offset": _offset,
    "period": _period, "skew": _skew, "axes": _axes, "bow": _bow, "wavy": _wavy, "jump": _jump, "jumps": _jump,
    "lead": _lead, "periodic": _uneven, "backlash": _backlash, "wobble": _wobble,
}  # fmt: skip
