"""A wavy guide: it pushes the head aside as the head moves along it."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import Acts, Places, Profiles, Scene, Shapes, Usual, along, periods_apart_mm, waves
from printmend.effects.prior import periods_of
from printmend.effects.words import Care, Fault, Found, Waves, is_first, those_of, where_seen
from printmend.messages import say, together


class Rail(Usual):
    """A wave along one bed axis, across it; on a CoreXY along it, too."""

    name = "rail"
    kinds = ("wavy",)
    acts = Acts.WAVE
    most = 2
    keys = Waves(shape=("period_mm",))

    def shapes(self, where: int, scene: Scene) -> Shapes:
        return [(each,) for each in periods_of(self.name, scene.bed_span_mm[where])]

    def profiles(self, where: int, scene: Scene) -> Profiles:
        return [np.ones(4 if scene.corexy else 2)]

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        turn = waves(places.bed_mm[:, where], shape[0])
        across = along(1 - where, turn)
        return np.concatenate([across, along(where, turn)], axis=2) if scene.corexy else across

    def spacing(self, where: int, shape: tuple[float, ...], scene: Scene) -> tuple[float, ...]:
        return (periods_apart_mm(shape[0], scene.bed_span_mm[where]),)

    def faults(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Fault]:
        if is_first(found, (self.name,), beside):
            rails = those_of(self.name, beside)
            size = float(sum(_largest_mm(each.sizes_mm) for each in rails))
            sd = float(np.std([[_largest_mm(one) for one in each.draws_mm.T] for each in rails], axis=1).max())
            lengths = together(" / ", [f"{each.shape[0]:.0f}" for each in rails])
            yield Fault("frame", "wavy", size, sd, "mm", say("fault-wavy", f"{size:.2f}", lengths))

    def advice(self, fault: Fault, where: str) -> Care:
        """Return how far straight lines snake, and which part may be bent."""
        repair = where_seen(fault.size, say("look-along-rods-rails-replace-bent"))
        return Care(say("guides-wavy"), say("straight-lines-snake-up-mm", fault.shown), fault.size, repair)


def _largest_mm(sizes: np.ndarray) -> float:
    """Return by how much waves [2] or [4], cosine and sine by turns, push at most."""
    return float(np.linalg.norm(np.hypot(sizes[0::2], sizes[1::2])))
