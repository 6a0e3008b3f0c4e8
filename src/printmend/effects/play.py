"""A belt, shaft or head that lags when its motor reverses (physics.md eq. 7)."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import Acts, Places, Scene, Usual, belt_places, onto_bed
from printmend.effects.words import (
    PLACES,
    Care,
    Fault,
    Found,
    Told,
    along_motor_mm,
    amount,
    motor_name,
    those_of,
    where_seen,
)
from printmend.messages import say

PLAYS = ("play", "wear", "friction", "breathing", "rub")  # effects that make a motor's play


class Play(Usual):
    """Play that is the same everywhere. A negative size means that the firmware compensates more backlash than there
    is: after a reversal the carriage runs ahead. The tables of a motor cannot represent that."""

    name = "play"
    kinds = ("play", "overcompensation")
    acts = Acts.DRIVE
    positive = True
    below = "overcompensation"

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return onto_bed(scene, where, 0.5 * places.side[:, [where]])

    def faults(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Fault]:
        if found.name == self.below:
            size, sd = found.size(lambda sizes: -float(sizes[0]))
            words = say("fault-overcompensation", amount(size, sd))
            yield Fault(motor_name(scene, found.where), self.below, size, sd, "mm", words)
        elif not those_of("breathing", beside, found.where) and not those_of("friction", beside, found.where):
            mean, sd, *_ = play_mm(beside, found.where, scene)
            yield Fault(motor_name(scene, found.where), "play", mean, sd, "mm", say("fault-play", amount(mean, sd)))

    def told(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
        motor, size_mm = motor_name(scene, found.where), f"{abs(found.sizes_mm[0]):.2f}"
        yield Told(self.below, say("firmware-takes-up-more-set-less", motor.upper(), size_mm, _set_by(motor)))

    def advice(self, fault: Fault, where: str) -> Care:
        """Return the advice: what stands still or jumps after a reversal, and what to tighten or to set."""
        if fault.kind == self.below:
            title, said = say("firmware-takes-up-too-much", where), (where, fault.shown)
            setting = say("nothing-repair-set-backlash-compensation", *said, _set_by(fault.part))
            return Care(title, say("after-each-change-direction-jumps", *said), fault.size, setting)
        meaning = say("after-each-change-direction-stands-still", where, fault.shown)
        repair = where_seen(fault.size, say("tighten-belt-then-look-pulley-s"), say("nothing-tighten"))
        carries = say("printmend-carries-takes-slack-up-each")
        return Care(say("belt-has-play", where), meaning, fault.size, repair, carries)


def _set_by(motor: str) -> str:
    """Say what sets a motor's backlash compensation: firmwares keep that of a CoreXY's motors under X and Y."""
    return say("backlash-set-by", {"a": "X", "b": "Y"}.get(motor, motor.upper()))


def play_mm(beside: Sequence[Found], motor: int, scene: Scene) -> tuple[float, float, float, float]:
    """Return the mean play of one motor over the measured span, its standard deviation, and the least and the most."""
    places = belt_places(motor, along_motor_mm(scene, motor), 1.0)
    whole, drawn = np.zeros(PLACES), np.zeros(1)
    for name in PLAYS:
        for each in those_of(name, beside, motor):
            moved = each.columns(places, scene)
            belt = 2 * np.asarray(scene.printer.to_motor(np.moveaxis(moved, 2, 1))[:, :, motor])
            whole = whole + belt @ each.sizes_mm
            drawn = drawn + belt.mean(axis=0) @ each.draws_mm
    whole = np.maximum(whole, 0.0)
    return float(whole.mean()), float(drawn.std()), float(whole.min()), float(whole.max())
