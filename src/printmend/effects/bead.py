"""Lines wider or narrower than set: every wall is offset by the same amount."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import Of, Places, Scene, Term, Usual
from printmend.effects.prior import number_of, size_mm
from printmend.effects.words import Found, Told
from printmend.messages import say


class Bead(Usual):
    """A shift along the normal of every wall."""

    name = "bead"
    of = Of.MATERIAL

    def terms(self, scene: Scene) -> Iterator[Term]:
        if scene.walls:
            yield Term(self.name, 0, (), (size_mm(self.name),), number_of(self.name, "log_odds"))

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return np.asarray(places.normal[:, :, None])

    def told(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
        size = float(found.sizes_mm[0])
        message = "walls-stand-out-mm-either-side" if size > 0 else "walls-fall-short-mm-either-side"
        yield Told("bead", say(message, f"{abs(size):.2f}"), is_harmless=True)
