"""A measurement with an origin of its own: the position of a sheet on a scanner, or of a print after homing."""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import ALWAYS, FAR_MM, GONE, Of, Places, Scene, Term, Usual, along_both
from printmend.effects.switch import scatter_of, spread_mm
from printmend.effects.words import Found, Numbers, Told
from printmend.messages import say
from printmend.units import SELDOM_SDS


class Origin(Usual):
    """A shift of everything: of any size or, if the position on the bed is known, as large as the scatter of the end
    stops. Errors count from there, because the next print has an origin of its own."""

    name = "origin"
    of = Of.INSTRUMENT
    fate = GONE
    keys = Numbers(("x_mm", "y_mm"))

    def terms(self, scene: Scene) -> Iterator[Term]:
        if not scene.placed:
            # even a sheet that looks aligned has an origin of its own
            yield Term(self.name, 0, (), (FAR_MM, FAR_MM), ALWAYS)
        elif scene.homed:
            scatter = scatter_of(scene.printer, scene.homed_again_mm)
            for weight, sd_mm in zip(scatter.weight.tolist(), scatter.sd_mm.tolist(), strict=True):
                if weight * sd_mm > 0.0:
                    yield Term(self.name, 0, (), (sd_mm, sd_mm), ALWAYS + math.log(weight))

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return along_both(np.ones((len(places), 1)))

    def told(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
        """Tell a shift that is no usual homing's."""
        if scene.placed and np.linalg.norm(found.sizes_mm) > SELDOM_SDS * spread_mm(scene, homings=1).max():
            words = say("everything-lies-mm-where-home-says", *(f"{each:+.2f}" for each in found.sizes_mm))
            yield Told("moved", words, is_harmless=True)
