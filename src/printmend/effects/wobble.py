"""A bent Z screw that pushes the layers aside (physics.md eq. 15)."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import Acts, Places, Profiles, Scene, Usual, along, waves
from printmend.effects.prior import harmonics_of, profile_of
from printmend.effects.pulley import wave_sizes
from printmend.effects.words import Care, Fault, Found, Waves, amount, is_first, stands_out, those_of
from printmend.messages import say, together

HARMONICS = harmonics_of("wobble")
LEAST_TURNS = 0.75  # of the screw that layers must span; on fewer a wave looks like a slope
OFTEN = ("once-a-turn", "twice-a-turn")


class Wobble(Usual):
    """A Fourier series of the screw's turn along one bed axis."""

    name = "wobble"
    acts = Acts.SCREW
    keys = Waves(tuple(map(int, HARMONICS)))

    def carriers(self, scene: Scene) -> range:
        return range(2 if shows_push(scene) else 0)

    def profiles(self, where: int, scene: Scene) -> Profiles:
        return [2 * profile_of(self.name)]

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return along(where, waves(places.heights_mm(scene), scene.printer.z.mm_per_turn, HARMONICS))

    def faults(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Fault]:
        """How far both axes together go either way, along the direction in which that is most."""
        if not is_first(found, (self.name,), beside):
            return
        pushes = those_of(self.name, beside)
        ellipses = np.stack([each.sizes_mm.reshape(2, -1).T for each in pushes], axis=1)  # axes by cosine and sine
        size_mm = np.linalg.norm(ellipses, 2, axis=(1, 2))  # half the long axis is the largest singular value
        sd_mm = np.sqrt(np.mean([np.square(wave_sizes(each)[1]) for each in pushes], axis=0))
        named = [k for k in range(2) if stands_out(size_mm[k], sd_mm[k])]
        words = [say(OFTEN[k], amount(size_mm[k], sd_mm[k])) for k in named]
        for k in named:
            said = say("z-pushes-aside", together(" / ", words)) if k == named[0] else ""
            yield Fault("z", f"wobble-{k + 1}", float(size_mm[k]), float(sd_mm[k]), "mm", said)

    def advice(self, fault: Fault, where: str) -> Care:
        """Return how far a bent screw pushes layers aside, and how to find the bend."""
        meaning = say("pushes-layers-aside-mm-pattern-repeats", fault.shown)
        return Care(say("z-screw-bent"), meaning, fault.size, say("roll-z-screw-flat-table-replace"))


def shows_push(scene: Scene) -> bool:
    """Tell whether the layers span enough of a turn of the screw to show how it pushes them."""
    return span_mm(scene) >= LEAST_TURNS * scene.printer.z.mm_per_turn


def span_mm(scene: Scene) -> float:
    """Return the height that the layers span."""
    return scene.layers[1] - scene.layers[0] if scene.layers else 0.0
