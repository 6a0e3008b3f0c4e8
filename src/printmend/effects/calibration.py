"""An instrument whose scale is off: a rule that is too long, a microscope's stage, an image of another resolution. Its
table shows both axes off by the same share."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import SCALE_MM, Of, Places, Scene, Shapes, Usual
from printmend.effects.prior import fate_of
from printmend.effects.words import Found, Numbers, Told
from printmend.messages import say


class Calibration(Usual):
    """A scale of a table's instrument, in mm per 100 mm. Its shape is the place from which it counts: the zero of the
    printer's coordinates, or home. In one of five next prints it is there: then it was the printer's. A picture's scale
    is as uncertain as its instrument says (`stretch`). On a CoreXY, whose bed axes share both motors, a frame that is
    too wide changes the mean of both axes as an instrument does: there the scale is the machine's."""

    name = "calibration"
    of = Of.INSTRUMENT
    fate = fate_of(name)
    keys = Numbers(("percent",), ("zero_x_mm", "zero_y_mm"))

    def carriers(self, scene: Scene) -> range:
        return range(scene.placed and not scene.corexy and not scene.instrument.covariance.any())

    def shapes(self, where: int, scene: Scene) -> Shapes:
        return list(dict.fromkeys([(0.0, 0.0), scene.printer.home_mm]))

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return ((places.bed_mm - shape) / SCALE_MM)[:, :, None]

    def told(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
        percent = float(found.sizes_mm[0])  # mm in 100 mm
        words = say("instrument-scale-off", f"{abs(percent):.2f}", say("large" if percent > 0 else "small"))
        yield Told("calibration", words, is_harmless=True)
