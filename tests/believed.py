"""Scenes and believed parts by hand, for tests of what is said and exported."""

import numpy as np

from printmend.effects import EFFECTS, Scene
from printmend.effects.effect import held_mm
from printmend.infer.machine import DRAWS, Part
from printmend.printer import read_printer

SIGMA_MM = 0.004


def scene_of(preset: str) -> Scene:
    printer = read_printer(preset)
    bed = tuple((axis.min_mm + 10, axis.max_mm - 10) for axis in printer.axes[:2])
    corners = np.array([[x, y] for x in bed[0] for y in bed[1]])
    motor = printer.to_motor(corners)
    spans = tuple(zip(motor.min(axis=0).tolist(), motor.max(axis=0).tolist(), strict=True))
    turns = tuple(axis.mm_per_turn for axis in printer.axes[:2])
    return Scene(printer, turns, spans, bed, 9000.0, walls=True)  # type: ignore[arg-type]


SCENES = {preset: scene_of(preset) for preset in ("ender3", "corexy")}


def part(
    effect: str, where: int, sizes: list[float], shape: tuple[float, ...] = (), *, there: np.ndarray | None = None
) -> Part:
    """Return an effect with drawn sizes that scatter by `SIGMA_MM`; ``there`` [D] says which machines have it."""
    rng = np.random.default_rng(3)
    has = np.ones(DRAWS, bool) if there is None else there
    mean = np.array(sizes, float)
    draws = (mean[:, None] + SIGMA_MM * rng.standard_normal((len(sizes), DRAWS))) * has
    acts = held_mm(EFFECTS[effect], mean * has.mean())
    return Part(effect, where, shape, acts, draws)
