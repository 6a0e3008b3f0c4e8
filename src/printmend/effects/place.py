"""A shifted belt: the end stop moved, or the belt rests elsewhere in its play."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import Acts, Places, Scene, Term, Usual, onto_bed
from printmend.effects.prior import alternatives, share_of
from printmend.effects.switch import spread_mm
from printmend.effects.words import Care, Fault, Found, amount, motor_name
from printmend.messages import say


class Place(Usual):
    """A shift of one belt."""

    name = "place"
    kinds = ("offset",)
    acts = Acts.DRIVE
    from_home = False

    def terms(self, scene: Scene) -> Iterator[Term]:
        if scene.placed:  # a measurement without a place has an origin of its own
            switches_mm = spread_mm(scene, homings=1)
            for motor, sd_mm in enumerate(scene.home_sd_mm):
                share = _share(sd_mm, float(switches_mm[motor])) if scene.homed else None
                yield from alternatives(self.name, motor, [()], (sd_mm,), share=share)

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return onto_bed(scene, where, np.ones((len(places), 1)))

    def faults(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Fault]:
        """Report a shift only for a motor without other faults; otherwise it goes with those."""
        others = [each for each in beside if each.acts and each is not found and each.where == found.where]
        if scene.placed and not others:
            value, sd = found.size()
            words = say("fault-shifted", amount(value, sd))
            yield Fault(motor_name(scene, found.where), "offset", value, sd, "mm", words)

    def advice(self, fault: Fault, where: str) -> Care:
        """Return how far the whole print is shifted, which spoils no shape."""
        meaning = say("everything-lies-mm-one-side-shapes", fault.shown)
        return Care(
            say("shifted", where), meaning, 0.0, say("nothing-repair"), say("printmend-firmware-s-home-offset-carries")
        )


def _share(home_sd_mm: float, switch_sd_mm: float) -> float:
    """Return the chance that a belt rests elsewhere: the more of its variance is play's, the surer it is."""
    usual, switch = share_of("place"), min(switch_sd_mm / home_sd_mm, 1.0) ** 2
    return usual + (1.0 - usual) * (1.0 - switch)
