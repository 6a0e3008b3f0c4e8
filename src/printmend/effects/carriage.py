"""A scanner whose carriage runs unevenly: places are off along each of its axes, by a process of the place there."""

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np

from printmend.effects.effect import GONE, Acts, Of, Places, Scene, Term, Usual, along
from printmend.effects.keys import Whole
from printmend.effects.prior import alternatives
from printmend.effects.words import Found, Told
from printmend.messages import say

COUNT = 24  # cosines over the picture, of a random process whose power falls with the square of the frequency

RUNS = partial(say, "scanner-carriage-runs-unevenly-along-up")


class Carriage(Usual):
    """Cosines along one axis of the picture, for both coordinates."""

    name = "carriage"
    of = Of.INSTRUMENT
    acts = Acts.NOT
    fate = GONE
    keys = Whole()

    def terms(self, scene: Scene) -> Iterator[Term]:
        if scene.instrument.wave_mm:
            profile = tuple(np.tile(1.0 / np.arange(1, COUNT + 1), 2))
            for axis in range(2):
                yield from alternatives(self.name, axis, [()], profile)

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        low, high = scene.bed_span_mm[where]
        place = np.clip((places.bed_mm[:, where] - low) / max(high - low, 1.0), 0.0, 1.0)
        series = np.cos(np.pi * place[:, None] * np.arange(1, COUNT + 1))
        return np.concatenate([along(where, series), along(1 - where, series)], axis=2)

    def told(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
        place = np.linspace(0.0, 1.0, 241)
        series = np.cos(np.pi * place[:, None] * np.arange(1, COUNT + 1))
        moved = np.hypot(*(series @ each for each in found.sizes_mm.reshape(2, -1)))
        yield Told("carriage", RUNS("XY"[found.where], f"{moved.max():.2f}"), is_harmless=True)
