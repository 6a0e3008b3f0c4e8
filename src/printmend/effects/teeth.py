"""Fine ripple, as vertical fine artefacts (VFA) on walls: a wave of a belt tooth, of motor poles or of full steps."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import STAYS, Acts, Of, Places, Scene, Term, Usual, onto_bed, waves
from printmend.effects.keys import Waves
from printmend.effects.prior import alternatives
from printmend.effects.words import Care, Fault, Found, Message, amount, motor_name

TOOTH_MM = 2.0  # of a GT2 belt
STEPS = (4.0, 2.0, 1.0, 0.5)  # full steps of a motor's waves: a pair of poles is four
NAMES = {4.0: "motor poles", 2.0: "pairs of full steps", 1.0: "full steps", 0.5: "half steps"}

TEETH = Message("{a} belt ripples from tooth to tooth", "Der Riemen von {a} riffelt von Zahn zu Zahn")
POLES = Message("{a} motor ripples from pole to pole", "Der Motor von {a} riffelt von Pol zu Pol")
COILS = Message(
    "{a} motor steps unevenly: its coils differ",
    "Der Motor von {a} macht ungleiche Schritte: seine Spulen sind ungleich",
)
DETENT = Message("{a} motor steps unevenly", "Der Motor von {a} macht ungleiche Schritte")
MEANING = Message(
    "Walls show fine lines every {b} mm, {a} mm deep.", "Wände zeigen feine Linien alle {b} mm, {a} mm tief."
)
RIPPLE = Message(
    "Walls show very fine lines, {a} mm deep, that come with the motor's steps.",
    "Wände zeigen sehr feine Linien, {a} mm tief, im Takt der Motorschritte.",
)
BELT_TODO = Message(
    "Nothing to repair if walls look good. Else set the belt's tension, and look at the pulley's teeth. The belt's "
    "back belongs on smooth idlers, its teeth on toothed ones. Print outer walls at another speed.",
    "Nichts zu reparieren, wenn Wände gut aussehen. Sonst den Riemen richtig spannen und die Zähne der Scheibe "
    "ansehen. Der Rücken des Riemens gehört auf glatte Umlenkrollen, seine Zähne auf gezahnte. Außenwände mit "
    "anderem Tempo drucken.",
)
POLES_TODO = Message(
    "Nothing to repair if walls look good. Else change the motor's current, or try another driver: one coil's current "
    "is off. Print outer walls at another speed.",
    "Nichts zu reparieren, wenn Wände gut aussehen. Sonst den Motorstrom ändern oder einen anderen Treiber versuchen: "
    "Der Strom einer Spule ist verschoben. Außenwände mit anderem Tempo drucken.",
)
COILS_TODO = Message(
    "Nothing to repair if walls look good. Else change the motor's current, or try another driver: the two coils' "
    "currents differ. Print outer walls at another speed.",
    "Nichts zu reparieren, wenn Wände gut aussehen. Sonst den Motorstrom ändern oder einen anderen Treiber versuchen: "
    "Die Ströme der zwei Spulen sind ungleich. Außenwände mit anderem Tempo drucken.",
)
DETENT_TODO = Message(
    "Nothing to repair if walls look good. Else change the motor's current, or let the driver interpolate its steps. "
    "Print outer walls at another speed.",
    "Nichts zu reparieren, wenn Wände gut aussehen. Sonst den Motorstrom ändern oder den Treiber die Schritte "
    "interpolieren lassen. Außenwände mit anderem Tempo drucken.",
)
SAID = {4.0: (POLES, POLES_TODO), 2.0: (COILS, COILS_TODO)}


class Teeth(Usual):
    """A wave of one belt tooth, or of a half to four full steps."""

    name = "teeth"
    of = Of.MACHINE
    acts = Acts.DRIVE
    fate = STAYS
    most = 2
    keys = Waves(shape=("period_mm",))

    def terms(self, scene: Scene) -> Iterator[Term]:
        for motor in range(2):
            step = scene.printer.axes[motor].mm_per_step
            shapes = dict.fromkeys([(TOOTH_MM,), *((count * step,) for count in STEPS)])
            yield from alternatives(self.name, motor, list(shapes), (1.0, 1.0))

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return onto_bed(scene, where, waves(places.motor_mm[:, where], shape[0], np.ones(1)))

    def waves_mm(self, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return np.array(shape)

    def faults(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Fault]:
        size, sd = found.size(lambda sizes: float(np.hypot(*sizes)))
        (period_mm,) = found.shape
        count = period_mm / scene.printer.axes[found.where].mm_per_step
        name = next((words for steps, words in NAMES.items() if abs(count - steps) < 1e-6), "")
        kind, what = (f"ripple-{count:g}", f"ripple of {name}") if name else ("teeth", "ripple of belt teeth")
        words = f"{what} {amount(size, sd)}, every {period_mm:g} mm"
        yield Fault(motor_name(scene, found.where), kind, size, sd, "mm", words)

    def advice(self, fault: Fault, where: str) -> Care | None:
        """Say what a ripple does to walls, and what helps."""
        size_mm = abs(fault.value)
        if fault.kind == "teeth":
            return Care(TEETH(where), MEANING(f"{size_mm:.3f}", f"{TOOTH_MM:g}"), size_mm, BELT_TODO())
        if fault.kind.partition("-")[0] != "ripple":
            return None
        _, _, count = fault.kind.partition("-")
        title, todo = SAID.get(float(count or 1), (DETENT, DETENT_TODO))
        return Care(title(where), RIPPLE(f"{size_mm:.3f}"), size_mm, todo())
