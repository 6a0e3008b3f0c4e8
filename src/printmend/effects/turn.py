"""A plate that was turned: everything is rotated about the middle of the bed."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import ALWAYS, FAR_MM, GONE, SCALE_MM, Of, Places, Scene, Term, Usual
from printmend.effects.prior import alternatives
from printmend.effects.words import Found, Numbers, Told
from printmend.messages import say


def about_middle(places: Places, scene: Scene) -> np.ndarray:
    """Return how a turn about the middle of the bed, of 1 mm per 100 mm, moves places [N, 2, 1] mm."""
    x, y = scene.off_middle(places.bed_mm).T
    return np.stack([-y, x], axis=1)[:, :, None]


def degrees_of(turn_mm: float) -> str:
    """Write a turn in mm per 100 mm as degrees."""
    return f"{np.degrees(np.arctan(turn_mm / SCALE_MM)):+.2f}"


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
        return about_middle(places, scene)

    def told(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
        if scene.placed:  # otherwise the turn of the sheet is unknown
            turned = degrees_of(found.sizes_mm[0])
            why = "only-frame-skewed" if scene.corexy else "plate-camera-lay"
            yield Told("turned", say(f"everything-turned-printer-{why}", turned), is_harmless=True)
