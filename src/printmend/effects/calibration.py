"""An instrument whose scale is wrong: an inexact rule, a microscope's stage, an image of another resolution.

Both axes of its table are off by the same share.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import SCALE_MM, Of, Places, Scene, Shapes, Usual
from printmend.effects.prior import fate_of
from printmend.effects.words import Found, Numbers, Told
from printmend.messages import say


class Calibration(Usual):
    """The scale error of a table's instrument, in mm per 100 mm.

    Its shape is the point that the error leaves in place: the printer's zero, or home. With a chance of one in five,
    the error was the printer's, and the next print has it, too. For pictures, `stretch` covers this. On a CoreXY, a
    frame error can look the same, so the scale is attributed to the machine.
    """

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
