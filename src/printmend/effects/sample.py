"""Places drawn over what was measured, on which the size of an effect is taken."""

import numpy as np

from printmend.effects.effect import LONG_MOVE_MM, Places, Scene

COUNT = 600  # of the places


def drawn_places(scene: Scene) -> Places:
    """Return places of a print on what was measured, each reached either way, by short and by long moves."""
    rng = np.random.default_rng(0)
    low, high = np.array(scene.bed_span_mm).T
    bed = rng.uniform(low, high, (COUNT, 2))
    side, ways = rng.choice([-1.0, 1.0], (2, COUNT, 2))
    normal = rng.standard_normal((COUNT, 2))
    return Places(
        scene.printer.to_motor(bed), side, bed, ways, -side, rng.uniform(0, 1, COUNT),
        rng.choice([1.0, LONG_MOVE_MM], COUNT), normal / np.linalg.norm(normal, axis=1, keepdims=True),
    )  # fmt: skip
