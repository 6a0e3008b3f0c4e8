"""An idler off its centre, or a belt whose error has a period of its own."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import Scene, Shapes, finer_periods
from printmend.effects.prior import NEAR_SHARE, numbers_of, periods_of
from printmend.effects.pulley import LEAST_EFFECT_MM
from printmend.effects.teeth import TOOTH_MM, OfOnePeriod
from printmend.effects.words import Care, Fault, Found, amount, motor_name, where_seen
from printmend.messages import say

NEAR_TEETH = 0.1  # a period counts as a common idler's within this many teeth


class Idler(OfOnePeriod):
    """A wave of another length than the motor's turn."""

    name = "idler"
    kinds = ("period",)

    def shapes(self, where: int, scene: Scene) -> Shapes:
        periods = periods_of(self.name, scene.motor_span_mm[where])
        return [(each,) for each in periods if _is_another(each, scene.turns_mm[where])]

    def finer(self, where: int, shape: tuple[float, ...], round_: int, scene: Scene) -> Iterator[tuple[float, ...]]:
        finer = finer_periods(shape[0], round_)
        return (each for each in finer if _is_another(each[0], scene.turns_mm[where]))

    def faults(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Fault]:
        (period_mm,) = found.shape
        size, sd = found.size(lambda sizes: float(np.hypot(*sizes)))
        if size < LEAST_EFFECT_MM:
            return
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


def _is_another(period_mm: float, turn_mm: float) -> bool:
    """Tell whether a wave of this length is none of the pulley's, whose waves fit into a turn."""
    turns = turn_mm / period_mm
    return abs(turns - round(turns)) > NEAR_SHARE
