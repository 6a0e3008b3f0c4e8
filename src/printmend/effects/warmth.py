"""A machine that grows as it warms up during a print, and is cold at the start of the next."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import ANEW, SCALE_MM, Of, Places, Scene, Shapes, Usual, along, along_both
from printmend.effects.prior import apart_of, numbers_of
from printmend.effects.words import LEAST_SHOWN, Found, Numbers, Told, span_mm
from printmend.messages import say


class Warmth(Usual):
    """Growth from the middle of the bed along both axes, and shifts of both, with one time constant."""

    name = "warmth"
    of = Of.SESSION
    fate = ANEW
    keys = Numbers(("grow_x_mm", "grow_y_mm", "move_x_mm", "move_y_mm"), ("after_share",))

    def carriers(self, scene: Scene) -> range:
        return range(1)

    def shapes(self, where: int, scene: Scene) -> Shapes:
        return [(each,) for each in numbers_of(self.name, "times")]

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        grown = (1.0 - np.exp(-places.done / shape[0]))[:, None]
        x, y = scene.off_middle(places.bed_mm).T
        grows = [along(0, x[:, None] * grown), along(1, y[:, None] * grown)]
        return np.concatenate([*grows, along_both(grown)], axis=2)

    def spacing(self, where: int, shape: tuple[float, ...], scene: Scene) -> tuple[float, ...]:
        return (apart_of(self.name, "times", shape[0]),)

    def told(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
        """The axis that grew or moved most, or both where both grew."""
        course = 1.0 - np.exp(-1.0 / found.shape[0])
        grown = course * found.sizes_mm[:2] * [span_mm(scene, axis) / SCALE_MM for axis in range(2)]
        moved = course * found.sizes_mm[2:]
        which = int(np.argmax(np.abs([*grown, *moved])))
        name, size = "XY"[which % 2], float([*grown, *moved][which])
        way = "grew" if size > 0 else "shrank"
        if which >= 2:
            words = say("moved-mm-while-print-went-machine", name, f"{size:+.2f}")
        elif (np.sign(size) * grown).min() >= LEAST_SHOWN:
            words = say(f"both-{way}-mm-end-end-while-print", *(f"{abs(each):.2f}" for each in grown))
        else:
            words = say(f"{way}-mm-end-end-while-print", name, f"{abs(size):.2f}")
        yield Told("thermal", words)
