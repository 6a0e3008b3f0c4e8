"""A sheet of paper that took up moisture, or lost it, between its print and its measurement.

No second picture and no distance on the sheet shows this. How far the machine travels does.
"""

from collections.abc import Iterator

import numpy as np

from printmend.effects.effect import GONE, SCALE_MM, Of, Places, Scene, Term, Usual
from printmend.effects.prior import alternatives, mild_shares, profile_of
from printmend.effects.words import Numbers


class Paper(Usual):
    """How far the sheet has grown along X and along Y, in mm per 100 mm. Its grain may lie along either."""

    name = "paper"
    of = Of.INSTRUMENT
    fate = GONE
    keys = Numbers(("x_percent", "y_percent"))

    def terms(self, scene: Scene) -> Iterator[Term]:
        if sd := scene.instrument.paper_sd:
            profile = profile_of(self.name)
            yield from alternatives(self.name, 0, [()], profile, profile[::-1], sd_mm=SCALE_MM * sd)

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return scene.off_middle(places.bed_mm)[:, :, None] * np.eye(2)


def variance(paper_sd: float) -> float:
    """Return the variance of a sheet's growth along either axis, as a share squared."""
    return paper_sd**2 * float(np.mean(np.square(mild_shares("paper"))) * np.mean(np.square(profile_of("paper"))))
