"""A machine that grows or leans as it warms up during a print, and may still be warm at the start of the next."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import SCALE_MM, Of, Places, Profiles, Scene, Shapes, Usual, along_both
from printmend.effects.prior import apart_of, fate_of, number_of, numbers_of
from printmend.effects.words import LEAST_SHOWN, Found, Numbers, Told, span_mm
from printmend.messages import say


class Warmth(Usual):
    """Growth from the middle of the bed along both axes, a lean of each, and shifts of both, with one time constant."""

    name = "warmth"
    of = Of.SESSION
    fate = fate_of("warmth")
    keys = Numbers(("grow_x_mm", "lean_x_mm", "lean_y_mm", "grow_y_mm", "move_x_mm", "move_y_mm"), ("after_share",))

    def carriers(self, scene: Scene) -> range:
        return range(1)

    def shapes(self, where: int, scene: Scene) -> Shapes:
        return [(each,) for each in numbers_of(self.name, "times")]

    def profiles(self, where: int, scene: Scene) -> Profiles:
        """Return two profiles: mostly growth, or mostly lean. Both may shift the print."""
        small = number_of(self.name, "beside")
        return [(1.0, small, small, 1.0, 1.0, 1.0), (small, 1.0, 1.0, small, 1.0, 1.0)]

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        grown = (1.0 - np.exp(-places.done / shape[0]))[:, None]
        grows = along_both(scene.off_middle(places.bed_mm) * grown)
        return np.concatenate([grows, along_both(grown)], axis=2)

    def spacing(self, where: int, shape: tuple[float, ...], scene: Scene) -> tuple[float, ...]:
        return (apart_of(self.name, "times", shape[0]),)

    def told(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
        """Say what moved most: an axis that grew, with the other if both did, one that leaned, or one that shifted."""
        ends_mm = (1.0 - np.exp(-1.0 / found.shape[0])) * found.sizes_mm
        ends_mm[:4] *= np.tile([span_mm(scene, axis) / SCALE_MM for axis in range(2)], 2)
        grown_mm = ends_mm[[0, 3]]
        which = int(np.argmax(np.abs(ends_mm)))
        name, size_mm = "XXYYXY"[which], float(ends_mm[which])
        way = "grew" if size_mm > 0 else "shrank"
        if which >= 4:
            words = say("moved-mm-while-print-went-machine", name, f"{size_mm:+.2f}")
        elif which in (1, 2):
            words = say("leaned-mm-over-bed-during-print", name, f"{abs(size_mm):.2f}")
        elif (np.sign(size_mm) * grown_mm).min() >= LEAST_SHOWN:
            words = say(f"both-{way}-mm-end-end-while-print", *(f"{abs(each):.2f}" for each in grown_mm))
        else:
            words = say(f"{way}-mm-end-end-while-print", name, f"{abs(size_mm):.2f}")
        yield Told("thermal", words)
