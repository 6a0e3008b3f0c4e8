"""Bodies with curved walls: vases, gyroids, and solids that are put together from simple ones."""

import numpy as np
from manifold3d import CrossSection, FillRule, Manifold

from printmend.units import TURN_RAD
from printmend_lab.body.generated.dice import Dice

_CORNERS = 64  # of a circle
_CELL_MM = 1.4  # of the grid in which a gyroid is found


def vase(dice: Dice) -> Manifold:
    """Draw a vase: a wavy outline that turns and widens upwards, with a floor."""
    radius_mm, height_mm, wall_mm = dice.uniform(10.0, 25.0), dice.uniform(8.0, 20.0), dice.uniform(1.2, 2.0)
    waves, depth = dice.whole(2, 9), dice.uniform(0.02, 0.12)
    twist, wider = dice.uniform(-60.0, 60.0), dice.uniform(0.85, 1.25)
    angle = np.arange(_CORNERS) * (TURN_RAD / _CORNERS)
    wavy = radius_mm * (1 + depth * np.cos(waves * angle))
    outline = np.stack([wavy * np.cos(angle), wavy * np.sin(angle)], axis=1)
    steps = round(height_mm / 0.5)

    def shell(corners: np.ndarray) -> Manifold:
        section = CrossSection([corners], FillRule.Positive)
        return Manifold.extrude(section, height_mm, steps, twist, (wider, wider))

    inner = shell(outline * (1 - wall_mm / radius_mm))
    floor_mm = dice.uniform(0.8, 1.6)
    return shell(outline) - inner.trim_by_plane((0.0, 0.0, 1.0), floor_mm)


def gyroid(dice: Dice) -> Manifold:
    """Draw a block or a cylinder of gyroid walls, |sin x cos y + sin y cos z + sin z cos x| < thick (Schoen 1970)."""
    size = (dice.uniform(16.0, 28.0), dice.uniform(16.0, 28.0), dice.uniform(4.0, 8.0))
    period_mm, thick = dice.uniform(9.0, 14.0), dice.uniform(0.5, 0.8)
    shift = [dice.uniform(0.0, TURN_RAD) for _ in range(3)]
    rate = TURN_RAD / period_mm

    def inside(x: float, y: float, z: float) -> float:
        a, b, c = rate * x + shift[0], rate * y + shift[1], rate * z + shift[2]
        return thick - abs(np.sin(a) * np.cos(b) + np.sin(b) * np.cos(c) + np.sin(c) * np.cos(a))

    low, high = [-edge / 2 - 1 for edge in size], [edge / 2 + 1 for edge in size]
    walls = Manifold.level_set(inside, [*low, *high], _CELL_MM)
    floor = Manifold.cube((size[0], size[1], 0.8), True).translate((0.0, 0.0, 0.4 - size[2] / 2))
    if dice.chance(0.5):
        bound = Manifold.cube(size, True)
    else:
        radius = min(size[:2]) / 2
        bound = Manifold.cylinder(size[2], radius, radius, _CORNERS, True)
    return (walls + floor) ^ bound


def assembly(dice: Dice) -> Manifold:
    """Draw boxes, cylinders, cones and balls, added to and cut from one another, on a foot that holds them up."""
    foot = dice.uniform(10.0, 24.0)
    solid = Manifold.cylinder(dice.uniform(2.0, 4.0), foot, foot, _CORNERS)
    for _ in range(dice.whole(3, 8)):
        size = [dice.uniform(5.0, 22.0) for _ in range(3)]
        kind = dice.choice(("box", "cylinder", "cone", "ball"))
        if kind == "box":
            part = Manifold.cube(size, True)
        elif kind == "ball":
            part = Manifold.sphere(size[0] / 2, _CORNERS)
        else:
            top = size[0] / 2 if kind == "cylinder" else dice.uniform(0.1, 0.8) * size[0] / 2
            part = Manifold.cylinder(size[2], size[0] / 2, top, _CORNERS, True)
        part = part.rotate([dice.uniform(0.0, 360.0) for _ in range(3)])
        place = (dice.uniform(-foot, foot), dice.uniform(-foot, foot), dice.uniform(0.0, 8.0))
        part = part.translate(place)
        solid = solid - part if dice.chance(0.35) else solid + part
    solid = solid.trim_by_plane((0.0, 0.0, 1.0), 0.0)
    parts = solid.decompose()
    return max(parts, key=lambda part: part.volume())
