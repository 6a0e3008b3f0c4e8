"""A diagnosis for someone who is no engineer: what a fault means, what to repair, what software carries."""

import math
from dataclasses import dataclass

from printmend.effects import EFFECTS
from printmend.effects.words import CARRIES, SOON_MM, Care
from printmend.effects.words import Fault as NamedFault

CERTAIN_SIGMAS, LIKELY_SIGMAS = 10.0, 5.0  # standard deviations from 0 at which a fault is certain, or very likely
REPAIR_MM = 0.5  # effect on a print above which a part should be replaced
SPAN_MM = 100.0  # size of the print whose error is told, for faults that grow with it


@dataclass(frozen=True)
class Advice:
    """What to do about one fault: ``urgency`` is repair, soon or software; ``effect_mm`` how far it shifts a print."""

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
    where = f"Motor {fault.part.upper()}" if corexy and fault.part != "frame" else fault.part.upper()
    size = abs(fault.value)
    kind = fault.kind.rstrip("0123456789.").removesuffix("-")  # harmonic-2 is a harmonic
    title, meaning, effect, repair, software = _said(kind, where, fault, size)
    if rails and kind == "play":
        repair = "Look at the rails and the head first: this play may be theirs. Then tighten the belt."
    nothing = repair.startswith("Nothing to repair")
    urgency = (
        "software" if nothing else "repair" if effect >= REPAIR_MM else "soon" if effect >= SOON_MM else "software"
    )
    if urgency == "software" and not repair.startswith("Nothing"):
        repair = f"Nothing, as long as it stays this small. If it grows: {repair[0].lower()}{repair[1:]}"
    return Advice(title, meaning, _sure(fault), effect, urgency, repair, software)


def _said(kind: str, where: str, fault: NamedFault, size: float) -> "Said":
    """Return what is said of a kind here, or else by the effect whose kind it is."""
    if kind not in _SAY:
        for effect in EFFECTS.values():
            care: Care | None = effect.advice(fault, where) if hasattr(effect, "advice") else None
            if care is not None:
                return care.title, care.meaning, care.effect_mm, care.repair, care.software
    return _SAY.get(kind, _other)(where, fault, size)


def _sure(fault: NamedFault) -> str:
    """Say how sure a fault is, and between which values it lies (two standard deviations)."""
    if fault.sd <= 0:
        return "seen; its size is an estimate without an error bar"
    sigmas = abs(fault.value) / fault.sd
    word = "certain" if sigmas >= CERTAIN_SIGMAS else "very likely" if sigmas >= LIKELY_SIGMAS else "likely"
    low, high = sorted((abs(fault.value) - 2 * fault.sd, abs(fault.value) + 2 * fault.sd))
    digits = 3 if fault.sd < 0.01 else 2
    first, last = f"{max(low, 0):.{digits}f}", f"{high:.{digits}f}"
    return f"{word}: {last} {fault.unit}" if first == last else f"{word}: between {first} and {last} {fault.unit}"


Said = tuple[str, str, float, str, str]
_CARRIES = CARRIES


def _scale(where: str, fault: NamedFault, size: float) -> Said:
    effect = size / 100 * SPAN_MM
    word = "large" if fault.value > 0 else "small"
    repair = (
        "Look at the pulley's size and number of teeth; replace it if it is the wrong one." if size > 2 else
        "Nothing to repair: correct the steps per millimetre (`printmend export` writes them)."
    )  # fmt: skip
    return (
        f"{where} prints {size:.2f} % too {word}",
        f"Every 100 mm along {where} come out {effect:.2f} mm too {'long' if fault.value > 0 else 'short'}.",
        effect, repair, "The firmware can hold it, or printmend.",
    )  # fmt: skip


def _harmonic(where: str, fault: NamedFault, size: float) -> Said:
    k = int(fault.kind.split("-")[1])
    effect = size / k
    if k == 1:
        title, meaning = f"{where} pulley is off its centre", f"The pulley wobbles {size:.2f} mm about its shaft"
        repair = "Replace the pulley; if the new one wobbles too, the motor's shaft is bent."
    else:
        shape = {2: "oval", 3: "three-cornered", 4: "four-cornered"}.get(k, "uneven")
        title, meaning = f"{where} pulley is {shape}", f"The pulley is {size:.2f} mm out of round, {k} times a turn"
        repair = "Replace the pulley: it is worn, squeezed or badly made."
    if effect < SOON_MM:
        repair = "Nothing to replace."
    return (
        title, f"{meaning}; lines swing by {effect:.2f} mm to either side, again and again.", effect, repair, _CARRIES,
    )  # fmt: skip


def _play(where: str, fault: NamedFault, size: float) -> Said:
    return (
        f"{where} belt has play",
        f"After each change of direction {where} stands still for {size:.2f} mm.",
        size,
        "Tighten the belt; then look at the pulley's grub screw." if size >= SOON_MM else "Nothing to tighten.",
        "printmend carries it: it takes the slack up at each reversal. A tight belt is better: less to take up.",
    )


def _loose(where: str, fault: NamedFault, size: float) -> Said:
    return (
        f"{where} belt is loose on an uneven pulley",
        f"After each change of direction {where} stands still for about {size:.2f} mm, more at some angles.",
        size,
        "Tighten the belt. The pulley pulls it tight and lets it go once a turn: replace the pulley if it still does.",
        "printmend carries it.",
    )


def _by_angle(where: str, fault: NamedFault, size: float) -> Said:
    return (
        f"{where} pulley is loose on its shaft",
        f"After each change of direction {where} stands still for about {size:.2f} mm; how much depends on the angle.",
        size,
        "Tighten the grub screw on the flat of the motor's shaft, then the belt.",
        "printmend carries it while it stays as it is; a loose screw seldom does.",
    )


def _friction(where: str, fault: NamedFault, size: float) -> Said:
    return (
        f"{where} runs stiffly, and its belt stretches",
        f"After a change of direction {where} lags by {size:.2f} mm, more the farther it is from the motor.",
        size,
        "Clean and oil the guides, look for a wheel or bearing that binds; then tighten the belt.",
        "printmend carries it.",
    )


def _elastic(where: str, fault: NamedFault, size: float) -> Said:
    if "idler" in fault.words:
        return (
            f"{where} belt stretches, or an idler wobbles",
            "The pulley's error changes along the belt: the belt stretches, or an idler of nearly the pulley's size is "
            "off its centre.",
            size, "Tighten the belt, unless it is tight; look whether an idler wobbles.", _CARRIES,
        )  # fmt: skip
    return (
        f"{where} belt stretches",
        "The pulley's error is felt near the motor and fades along the belt.",
        size, "Tighten the belt, unless it is tight.", _CARRIES,
    )  # fmt: skip


def _ripple(where: str, fault: NamedFault, size: float) -> Said:
    return (
        f"{where} motor steps unevenly",
        f"Micro-steps are uneven by {size:.3f} mm.",
        size, "Nothing to repair; another motor driver may run smoother.", _CARRIES,
    )  # fmt: skip


def _drift(where: str, fault: NamedFault, size: float) -> Said:
    return (
        f"{where} stretches unevenly along the bed",
        f"The scale changes along {where}, by up to {size:.2f} mm.",
        size, "Look along the belt and the guide for a bend or a place that binds.", _CARRIES,
    )  # fmt: skip


def _warp(where: str, fault: NamedFault, size: float) -> Said:
    return (
        f"{where} runs unevenly along its way",
        f"Along {where} the print swings by up to {size:.2f} mm, at the same places each time but not once a turn of "
        "the motor: the belt's teeth are uneven or stretched, or the guide is.",
        size,
        "Look along the belt for a worn or stretched stretch, and along the guide for a dent; replace what is worn."
        if size >= SOON_MM else "Nothing to replace.",
        _CARRIES,
    )  # fmt: skip


def _period(where: str, fault: NamedFault, size: float) -> Said:
    length = fault.kind.removeprefix("period-")
    return (
        f"{where} swings every {length} mm",
        f"Lines swing by {size:.2f} mm to either side, again and again, but not once a turn of the printer's own "
        "pulley: an idler that the belt runs over is off its centre, or dirty, or the pulley is another one.",
        size,
        "Clean the idlers and look which of them wobbles, or the pulley; replace it." if size >= SOON_MM
        else "Nothing to replace.",
        _CARRIES,
    )  # fmt: skip


def _offset(where: str, fault: NamedFault, size: float) -> Said:
    return (
        f"{where} is shifted",
        f"Everything lies {size:.2f} mm to one side: shapes are right.",
        0.0, "Nothing to repair.", "printmend or the firmware's home offset carries it.",
    )  # fmt: skip


def _skew(where: str, fault: NamedFault, size: float) -> Said:
    effect = SPAN_MM * math.tan(math.radians(size))
    return (
        "The frame is not square",
        f"Right angles come out {size:.2f}° off: {effect:.2f} mm on 100 mm.",
        effect,
        "Loosen the frame, square it, tighten it." if effect >= SOON_MM else "Nothing to repair.",
        "The firmware can hold it (`printmend export`), or printmend.",
    )


def _axes(where: str, fault: NamedFault, size: float) -> Said:
    effect = size / 100 * SPAN_MM
    return (
        f"X prints {size:.2f} % {'larger' if fault.value > 0 else 'smaller'} than Y",
        f"Squares come out as rectangles, whichever motor turns: {effect:.2f} mm on 100 mm.", effect,
        "Look whether the belts run along the guides, from the idlers to the head." if effect >= SOON_MM
        else "Nothing to repair.", _CARRIES,
    )  # fmt: skip


def _bow(where: str, fault: NamedFault, size: float) -> Said:
    return _guides("The guides are bent", f"Straight lines bow, by up to {size:.2f} mm in the bed's corners.", size)


def _wavy(where: str, fault: NamedFault, size: float) -> Said:
    return _guides("The guides are wavy", f"Straight lines snake, by up to {size:.2f} mm.", size)


def _guides(title: str, meaning: str, size: float) -> Said:
    repair = "Look along the rods or rails; replace a bent one." if size >= SOON_MM else "Nothing to replace."
    return title, meaning, size, repair, _CARRIES


def _jump(where: str, fault: NamedFault, size: float) -> Said:
    return (
        f"{where} lost its place during the print",
        f"From one point on everything lies {size:.2f} mm off: the belt jumped a tooth, or the motor missed steps.",
        max(size, REPAIR_MM),
        "Tighten the belt, oil the guides, print slower or give the motor more current.",
        "Software cannot carry this: nobody knows when it jumps next.",
    )


def _lead(where: str, fault: NamedFault, size: float) -> Said:
    effect = size / 100 * SPAN_MM
    return (
        f"Prints come out too {'tall' if fault.value > 0 else 'low'}", f"{effect:.2f} mm on 100 mm of height.", effect,
        "Nothing to repair: correct the Z steps per millimetre, or let printmend.", _CARRIES,
    )  # fmt: skip


def _uneven(where: str, fault: NamedFault, size: float) -> Said:
    return (
        "The Z screw lifts unevenly", f"Layers are too thick and too thin in turns, by up to {size:.2f} mm.", size,
        "Clean and grease the Z screw; replace it if that does not help.", _CARRIES,
    )  # fmt: skip


def _backlash(where: str, fault: NamedFault, size: float) -> Said:
    return (
        "The Z nut has play", f"After each Z-hop the nozzle is {size:.2f} mm too high or too low.", size,
        "Replace the Z nut, or fit one with a spring.", _CARRIES,
    )  # fmt: skip


def _wobble(where: str, fault: NamedFault, size: float) -> Said:
    return (
        "The Z screw is bent", f"It pushes the layers aside by {size:.2f} mm, in a pattern that repeats up the walls.",
        size, "Roll the Z screw on a flat table; replace a bent one. Loosen the guide at its upper end.", _CARRIES,
    )  # fmt: skip


def _other(where: str, fault: NamedFault, size: float) -> Said:
    return f"{where}: {fault.kind}", fault.words, size if fault.unit == "mm" else 0.0, "Have a look.", _CARRIES


_SAY = {
    "scale": _scale, "harmonic": _harmonic, "play": _play, "loose-belt": _loose, "play-by-angle": _by_angle,
    "friction": _friction, "elastic": _elastic, "ripple": _ripple, "drift": _drift, "warp": _warp, "offset": _offset,
    "period": _period, "skew": _skew, "axes": _axes, "bow": _bow, "wavy": _wavy, "jump": _jump, "jumps": _jump,
    "lead": _lead, "periodic": _uneven, "backlash": _backlash, "wobble": _wobble,
}  # fmt: skip
