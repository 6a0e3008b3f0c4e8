"""A belt that sits elsewhere: the end stop moved, or the belt rests within its play."""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import FAR_MM, STAYS, Acts, Of, Places, Scene, Term, Usual, onto_bed
from printmend.effects.keys import Numbers
from printmend.effects.prior import alternatives, share_of
from printmend.effects.words import Fault, Found, amount, motor_name
from printmend.messages import say

HOME_SD_MM = 0.1  # of an end stop's place: switches scatter by as much


class Place(Usual):
    """A shift of one belt."""

    name = "place"
    of = Of.MACHINE
    acts = Acts.DRIVE
    from_home = False
    fate = STAYS
    keys = Numbers()

    def terms(self, scene: Scene) -> Iterator[Term]:
        if scene.placed:  # a measurement without a place has an origin of its own
            for motor in range(2):
                yield from alternatives(self.name, motor, [()], (HOME_SD_MM if scene.homed else FAR_MM,))
                if scene.homed and scene.home_play_mm[motor] > 0:  # the root of the mean square of a place within it
                    at_rest = share_of("at_rest")
                    sd_mm = scene.home_play_mm[motor] / math.sqrt(3)
                    yield Term(self.name, motor, (), (sd_mm,), math.log(at_rest / (1 - at_rest)))

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return onto_bed(scene, where, np.ones((len(places), 1)))

    def faults(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Fault]:
        """Report a shift only for a motor without other faults; otherwise it goes with those."""
        others = [each for each in beside if each.acts and each is not found and each.where == found.where]
        if scene.placed and not others:
            value, sd = found.size(lambda sizes: float(sizes[0]))
            words = say("fault-shifted", amount(value, sd))
            yield Fault(motor_name(scene, found.where), "offset", value, sd, "mm", words)
