"""Two sheets that were measured as one: one part of the bed is offset from the other."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import GONE, STEPS, Of, Places, Scene, Shapes, Usual, along_both, steps
from printmend.effects.prior import number_of
from printmend.effects.words import LEAST_SHOWN, Found, Numbers, Told, span_mm
from printmend.messages import say


class Halves(Usual):
    """A step past a border along one bed axis. Either sheet may be the one that lies aside, where home says which: a
    machine's errors are counted from there. In the shape ``side`` is 1 for the upper one, −1 for the lower."""

    name = "halves"
    of = Of.INSTRUMENT
    fate = GONE
    keys = Numbers(("x_mm", "y_mm"), ("at_mm", "side"))

    def shapes(self, where: int, scene: Scene) -> Shapes:
        sides = (-1.0, 1.0) if scene.homed else (1.0,)
        return [(at, side) for at in steps(*scene.bed_span_mm[where]) for side in sides]

    def share(self, where: int, scene: Scene) -> float | None:
        return number_of(self.name, "placed_share" if scene.placed else "share")

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        at, side = shape
        return along_both(side * (side * (places.bed_mm[:, [where]] - at) > 0))

    def spacing(self, where: int, shape: tuple[float, ...], scene: Scene) -> tuple[float, ...]:
        return (span_mm(scene, where) / STEPS,)

    def told(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
        at, side = found.shape
        sizes_mm = side * found.sizes_mm
        off = [(name, size) for name, size in zip("XY", sizes_mm, strict=True) if abs(size) >= LEAST_SHOWN]
        where, part = ("XY"[found.where], f"{at:.0f}"), "upper" if side > 0 else "lower"
        if len(off) == 1:
            yield Told("halves", say(f"off-mm-{part}-part-mm", off[0][0], f"{off[0][1]:+.2f}", *where))
        elif off:
            sizes = (f"{size:+.2f}" for _, size in off)
            yield Told("halves", say(f"off-mm-mm-{part}-part-mm", *sizes, *where))
