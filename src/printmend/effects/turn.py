"""A plate that lay turned: everything turns about the middle of the bed."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import ALWAYS, FAR_MM, GONE, SCALE_MM, Of, Places, Scene, Term, Usual
from printmend.effects.prior import alternatives
from printmend.effects.words import Found, Numbers, Told
from printmend.messages import say


class Turn(Usual):
    """A turn, in mm per 100 mm."""

    name = "turn"
    of = Of.INSTRUMENT
    fate = GONE
    keys = Numbers(("angle_deg",))

    def terms(self, scene: Scene) -> Iterator[Term]:
        if scene.placed:
            yield from alternatives(self.name, 0)
        else:  # nobody knows how a sheet lay on a scanner
            yield Term(self.name, 0, (), (FAR_MM,), ALWAYS)

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        x, y = scene.off_middle(places.bed_mm).T
        return np.stack([-y, x], axis=1)[:, :, None]

    def told(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
        if scene.placed:  # otherwise the turn of the sheet is unknown
            turned = f"{np.degrees(np.arctan(found.sizes_mm[0] / SCALE_MM)):+.2f}"
            why = "only-frame-skewed" if scene.corexy else "plate-camera-lay"
            yield Told("turned", say(f"everything-turned-printer-{why}", turned), is_harmless=True)
