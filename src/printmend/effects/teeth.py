"""Fine ripple, as vertical fine artefacts (VFA) on walls: a wave of a belt tooth, of motor poles or of full steps."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import Acts, Places, Scene, Term, Usual, onto_bed, waves
from printmend.effects.prior import alternatives, each_share, number_of, share_of, size_mm
from printmend.effects.words import Care, Fault, Found, Waves, amount, motor_name
from printmend.messages import say

TOOTH_MM = 2.0  # of a GT2 belt, which printers have: a pulley has a whole number of them
# Messages by full steps of a motor's waves, of which a pair of poles has four: its name, what it is, and what to do.
RIPPLES = {
    4.0: ("fault-ripple-poles", "motor-ripples-pole-pole", "nothing-repair-walls-look-good-else-3"),
    2.0: ("fault-ripple-pairs", "motor-steps-unevenly-coils-differ", "nothing-repair-walls-look-good-else-2"),
    1.0: ("fault-ripple-steps", "motor-steps-unevenly", "nothing-repair-walls-look-good-else"),
    0.5: ("fault-ripple-half-steps", "motor-steps-unevenly", "nothing-repair-walls-look-good-else"),
}


class OfOnePeriod(Usual):
    """A wave along one belt; its shape is the period."""

    acts = Acts.DRIVE
    most = 2
    keys = Waves(shape=("period_mm",))

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return onto_bed(scene, where, waves(places.motor_mm[:, where], shape[0]))

    def waves_mm(self, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return np.array(shape)


class Teeth(OfOnePeriod):
    """A wave of one belt tooth, or of a half to four full steps."""

    name = "teeth"
    kinds = ("teeth", "ripple")

    def terms(self, scene: Scene) -> Iterator[Term]:
        for motor in range(2):
            step = scene.printer.axes[motor].mm_per_step
            periods = dict.fromkeys([TOOTH_MM, *(count * step for count in RIPPLES)])
            share = each_share(share_of(self.name), len(periods))
            for period in periods:
                sd_mm = min(size_mm(self.name), period / (2 * np.pi * number_of(self.name, "back")))
                yield from alternatives(self.name, motor, [(period,)], (1.0, 1.0), share=share, sd_mm=sd_mm)

    def faults(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Fault]:
        size, sd = found.size(lambda sizes: float(np.hypot(*sizes)))
        (period_mm,) = found.shape
        count = period_mm / scene.printer.axes[found.where].mm_per_step
        name = next((name for steps, (name, _, _) in RIPPLES.items() if abs(count - steps) < 1e-6), None)
        kind = f"ripple-{count:g}" if name else "teeth"
        words = say(name or "fault-ripple-teeth", amount(size, sd), f"{period_mm:g}")
        yield Fault(motor_name(scene, found.where), kind, size, sd, "mm", words)

    def advice(self, fault: Fault, where: str) -> Care:
        """Return a ripple's effect on walls, and what helps."""
        if fault.kind == "teeth":
            meaning = say("walls-show-fine-lines-every-mm", f"{TOOTH_MM:g}", f"{fault.size:.3f}")
            repair = say("nothing-repair-walls-look-good-else-4")
            return Care(say("belt-ripples-tooth-tooth", where), meaning, fault.size, repair)
        _, _, count = fault.kind.partition("-")
        _, title, todo = RIPPLES.get(float(count or 1), RIPPLES[1.0])
        meaning = say("walls-show-very-fine-lines-mm", f"{fault.size:.3f}")
        return Care(say(title, where), meaning, fault.size, say(todo))
