"""Ripple of belt teeth and of the motor's full steps: vertical fine artefacts."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import STAYS, Acts, Of, Places, Scene, Term, onto_bed, waves
from printmend.effects.keys import Waves
from printmend.effects.prior import alternatives
from printmend.effects.words import Care, Fault, Found, Message, amount, motor_name

TOOTH_MM = 2.0  # of a GT2 belt

TITLE = Message("{a} belt ripples from tooth to tooth", "Der Riemen von {a} riffelt von Zahn zu Zahn")
MEANING = Message(
    "Walls show fine lines, a belt tooth apart, {a} mm deep.",
    "Wände zeigen feine Linien im Abstand eines Zahns, {a} mm tief.",
)
TIGHTEN = Message(
    "Nothing to repair; a belt that runs on its smooth side over the idlers ripples less.",
    "Nichts zu reparieren; ein Riemen, der mit dem glatten Rücken über die Umlenkrollen läuft, riffelt weniger.",
)


class Teeth:
    """A wave of one tooth or of one to four full steps."""

    name = "teeth"
    of = Of.MACHINE
    acts = Acts.DRIVE
    from_home = True
    fate = STAYS
    most = 2
    keys = Waves(shape=("period_mm",))

    def terms(self, scene: Scene) -> Iterator[Term]:
        for motor in range(2):
            step = scene.printer.axes[motor].mm_per_step
            yield from alternatives(self.name, motor, [(TOOTH_MM,), (4 * step,), (2 * step,), (step,)], (1.0, 1.0))

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return onto_bed(scene, where, waves(places.motor_mm[:, where], shape[0], np.ones(1)))

    def waves_mm(self, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return np.array(shape)

    def finer(self, shape: tuple[float, ...], round_: int) -> Iterator[tuple[float, ...]]:
        return iter(())

    def faults(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Fault]:
        size, sd = found.size(lambda sizes: float(np.hypot(*sizes)))
        (period_mm,) = found.shape
        is_teeth = period_mm == TOOTH_MM and period_mm != 4 * scene.printer.axes[found.where].mm_per_step
        kind, what = ("teeth", "ripple of belt teeth") if is_teeth else ("ripple", "ripple of full steps")
        words = f"{what} {amount(size, sd)}, every {period_mm:g} mm"
        yield Fault(motor_name(scene, found.where), kind, size, sd, "mm", words)

    def advice(self, fault: Fault, where: str) -> Care | None:
        """Say what a ripple of belt teeth does."""
        if fault.kind != "teeth":
            return None
        size_mm = abs(fault.value)
        return Care(TITLE(where), MEANING(f"{size_mm:.3f}"), size_mm, TIGHTEN())
