"""Two sheets that were measured as one: one part of the bed is offset from the other."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import GONE, Of, Places, Scene, Term, Usual, about, along_both
from printmend.effects.prior import alternatives
from printmend.effects.words import LEAST_SHOWN_MM, Found, Numbers, Told
from printmend.messages import say, together

BORDERS = 25  # places of a border that are tried
APART_MM = 8.0  # distance of two of them on a usual bed
OTHER_SHARE = 0.1  # a smaller share along the other axis is not reported

SHEETS = say("two-sheets-measured-show-guide-two")


class Halves(Usual):
    """A shift past a border along one bed axis."""

    name = "halves"
    of = Of.INSTRUMENT
    fate = GONE
    keys = Numbers(("x_mm", "y_mm"), ("at_mm",))

    def terms(self, scene: Scene) -> Iterator[Term]:
        for axis in range(2):
            yield from alternatives(self.name, axis, [(float(at),) for at in borders_mm(scene, axis)], (1.0, 1.0))

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return along_both((places.bed_mm[:, [where]] > shape[0]) * 1.0)

    def finer(self, where: int, shape: tuple[float, ...], round_: int, scene: Scene) -> Iterator[tuple[float, ...]]:
        yield from ((at,) for at in about(shape[0], APART_MM, round_))

    def told(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
        least_mm = max(LEAST_SHOWN_MM, OTHER_SHARE * float(np.abs(found.sizes_mm).max()))
        off = [(name, size) for name, size in zip("XY", found.sizes_mm, strict=True) if abs(size) >= least_mm]
        where = "XY"[found.where], f"{found.shape[0]:.0f}"
        if len(off) == 1:
            words = say("off-mm-upper-part-mm", off[0][0], f"{off[0][1]:+.2f}", *where)
            yield Told("halves", together(". ", [words, SHEETS]))
        elif off:
            words = say("off-mm-mm-upper-part-mm", *(f"{size:+.2f}" for _, size in off), *where)
            yield Told("halves", together(". ", [words, SHEETS]))


def borders_mm(scene: Scene, axis: int) -> np.ndarray:
    """Return the borders between two parts of the bed that are tried along an axis."""
    low, high = scene.bed_span_mm[axis]
    return np.linspace(low, high, BORDERS + 2)[2:-2]
