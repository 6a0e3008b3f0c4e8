"""An idler off its centre, or a belt whose error has a period of its own."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import Scene, Shapes, periods_apart_mm
from printmend.effects.prior import NEAR_SHARE, numbers_of, periods_of
from printmend.effects.teeth import TOOTH_MM, OfOnePeriod
from printmend.effects.words import Care, Fault, Found, amount, motor_name, where_seen
from printmend.messages import say

NEAR_TEETH = 0.1  # a period counts as a common idler's within this many teeth


class Idler(OfOnePeriod):
    """A wave of another length than the motor's turn."""

    name = "idler"
    kinds = ("period",)

    def shapes(self, where: int, scene: Scene) -> Shapes:
        return [(each,) for each in periods_of(self.name, scene.motor_span_mm[where])]

    def spacing(self, where: int, shape: tuple[float, ...], scene: Scene) -> tuple[float, ...]:
        return (periods_apart_mm(shape[0], scene.motor_span_mm[where]),)

    def is_possible(self, where: int, shape: tuple[float, ...], scene: Scene) -> bool:
        """Tell whether a wave of this length is none of the pulley's, whose waves fit into a turn."""
        turns = scene.turns_mm[where] / shape[0]
        return abs(turns - round(turns)) > NEAR_SHARE

    def faults(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Fault]:
        (period_mm,) = found.shape
        size, sd = found.size(lambda sizes: float(np.hypot(*sizes)))
        teeth = round(period_mm / TOOTH_MM)
        toothed = abs(period_mm / TOOTH_MM - teeth) < NEAR_TEETH and teeth in numbers_of(self.name, "teeth")
        words = say("fault-idler", f"{period_mm:.1f}", amount(size, sd))
        if toothed:
            words = say("fault-idler-of-teeth", f"{period_mm:.1f}", teeth, amount(size, sd))
        yield Fault(motor_name(scene, found.where), f"period-{period_mm:.1f}", size, sd, "mm", words)

    def advice(self, fault: Fault, where: str) -> Care:
        """Return how far lines swing and how often, and which part may wobble."""
        title = say("swings-every-mm", where, fault.kind.removeprefix("period-"))
        repair = where_seen(fault.size, say("clean-idlers-look-them-wobbles-pulley"))
        return Care(title, say("lines-swing-mm-either-side-again", fault.shown), fault.size, repair)
