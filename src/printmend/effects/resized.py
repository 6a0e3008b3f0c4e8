"""A picture that was resized: a wrong resolution, or a sheet that was fitted to its page. Until a length is known, it
looks like a printer whose axes have the same scale error."""

from collections.abc import Iterator

import numpy as np

from printmend.effects.effect import SCALE_MM, Of, Places, Scene, Term, Usual
from printmend.effects.prior import alternatives, fate_of
from printmend.effects.words import Numbers


class Resized(Usual):
    """One scale for both axes, in mm per 100 mm. In half of the next prints it is there: then it was the printer's."""

    name = "resized"
    of = Of.INSTRUMENT
    fate = fate_of(name)
    keys = Numbers(("percent",))

    def terms(self, scene: Scene) -> Iterator[Term]:
        if sd := scene.instrument.resized_sd:
            yield from alternatives(self.name, 0, sd_mm=SCALE_MM * sd)

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        # where healthy belts would be: beside a scale of the motors, what they really do would stand for all that is
        # wrong with them
        return scene.off_middle(scene.printer.from_motor(places.motor_mm))[:, :, None]
