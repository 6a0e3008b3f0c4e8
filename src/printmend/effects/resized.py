"""A picture of another size than it says: a wrong resolution, a sheet that was fitted to its page. Until a length is
known, nobody can tell it from a printer whose axes are both off by the same."""

import math
from collections.abc import Iterator

import numpy as np

from printmend.effects.effect import SCALE_MM, Fate, Of, Places, Scene, Term, Usual
from printmend.effects.prior import share_of
from printmend.effects.words import Numbers


class Resized(Usual):
    """One scale for both axes, in mm per 100 mm. In half of the next prints it is there: then it was the printer's."""

    name = "resized"
    of = Of.SESSION
    fate = Fate(anew=0.5)
    keys = Numbers(("percent",))

    def terms(self, scene: Scene) -> Iterator[Term]:
        if sd := scene.instrument.resized_sd:
            share = share_of(self.name)
            yield Term(self.name, 0, (), (SCALE_MM * sd,), math.log(share / (1 - share)))

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        # where healthy belts would be: beside a scale of the motors, what they really do would stand for all that is
        # wrong with them
        return scene.off_middle(scene.printer.from_motor(places.motor_mm))[:, :, None]
