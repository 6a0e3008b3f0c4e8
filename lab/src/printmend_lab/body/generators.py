"""Bodies as functions of a die: outlines carried upwards (gears, brackets, text), and curved walls (vases, gyroids)."""

import numpy as np
from manifold3d import CrossSection, FillRule, Manifold

from printmend.units import TURN_RAD
from printmend_lab.body.generated import Dice

_PRESSURE_RAD = np.deg2rad(20.0)
_LETTERS = "ABCDEFGHJKLMNPRSTUVWXYZ0123456789"
_HOLE_CORNERS = 32  # of a circle


def gear(dice: Dice) -> Manifold:
    """Draw a spur gear with involute flanks, a bore and, on large ones, holes that save plastic."""
    teeth, module_mm = dice.whole(12, 36), dice.uniform(1.0, 2.5)
    height_mm = dice.uniform(3.0, 8.0)
    outline = CrossSection([_involute_outline(teeth, module_mm)], FillRule.Positive)
    root_mm = module_mm * (teeth / 2 - 1.25)
    bore_mm = min(dice.uniform(1.5, 4.0), 0.4 * root_mm)
    outline = outline - CrossSection.circle(bore_mm, _HOLE_CORNERS)
    holes, hole_mm = dice.whole(3, 8), 0.3 * (root_mm - bore_mm)
    if root_mm > 12.0:
        middle_mm = (root_mm + bore_mm) / 2
        fits = min(hole_mm, middle_mm * np.sin(np.pi / holes) - 1.5)
        for k in range(holes) if fits > 1.0 else ():
            angle = TURN_RAD * k / holes
            centre = (middle_mm * float(np.cos(angle)), middle_mm * float(np.sin(angle)))
            outline = outline - CrossSection.circle(fits, _HOLE_CORNERS).translate(centre)
    solid = Manifold.extrude(outline, height_mm)
    if dice.chance(0.5):  # a hub
        hub_mm = min(bore_mm + dice.uniform(2.0, 4.0), 0.9 * root_mm)
        hub = CrossSection.circle(hub_mm, _HOLE_CORNERS) - CrossSection.circle(bore_mm, _HOLE_CORNERS)
        solid = solid + Manifold.extrude(hub, height_mm + dice.uniform(1.0, 4.0))
    return solid


def _involute_outline(teeth: int, module_mm: float) -> np.ndarray:
    """Return the corners [N, 2] of a gear, counter-clockwise; flanks as in Litvin and Fuentes (2004), §10."""
    pitch = module_mm * teeth / 2
    base, tip, root = pitch * np.cos(_PRESSURE_RAD), pitch + module_mm, pitch - 1.25 * module_mm
    radius = np.linspace(max(base, root), tip, 5)
    unroll = np.sqrt(np.maximum((radius / base) ** 2 - 1, 0.0))
    involute = np.tan(_PRESSURE_RAD) - _PRESSURE_RAD
    half = np.pi / (2 * teeth) + involute - (unroll - np.arctan(unroll))  # of a tooth, at each radius
    half = np.maximum(half, 0.05 / teeth)  # thin teeth end in a ridge
    corners = []
    for k in range(teeth):
        middle = TURN_RAD * k / teeth
        right = [(root, middle - half[0]), *zip(radius, middle - half, strict=True)]
        left = [*zip(radius[::-1], middle + half[::-1], strict=True), (root, middle + half[0])]
        corners += [(r * np.cos(a), r * np.sin(a)) for r, a in (*right, *left)]
    return np.array(corners)


def bracket(dice: Dice) -> Manifold:
    """Draw an angle bracket: a plate, an upright wall, holes in both and a rib between them."""
    length, width, thick = dice.uniform(25.0, 70.0), dice.uniform(15.0, 40.0), dice.uniform(2.0, 4.0)
    height = dice.uniform(8.0, 20.0)
    plate = Manifold.cube((length, width, thick))
    wall = Manifold.cube((thick, width, height))
    solid = plate + wall
    for _ in range(dice.whole(1, 3)):
        at, rib = dice.uniform(0.1, 0.9) * (width - thick), dice.uniform(0.4, 0.8)
        reach = rib * min(length - thick, 2 * height)
        corner = CrossSection([[(0.0, 0.0), (reach, 0.0), (0.0, rib * height)]], FillRule.Positive)
        solid = solid + Manifold.extrude(corner, thick).rotate((90.0, 0.0, 0.0)).translate((0.0, at + thick, 0.0))
    for _ in range(dice.whole(1, 4)):
        radius = dice.uniform(1.2, min(3.5, 0.2 * width))
        x = dice.uniform(2 * thick + radius, length - radius - 2.0)
        y = dice.uniform(radius + 2.0, width - radius - 2.0)
        solid = solid - Manifold.cylinder(3 * thick, radius, radius, _HOLE_CORNERS, True).translate((x, y, thick / 2))
    radius = dice.uniform(1.0, 0.2 * height)
    place = (thick / 2, dice.uniform(0.3, 0.7) * width, thick + 0.5 * (height - thick))
    hole = Manifold.cylinder(3 * thick, radius, radius, _HOLE_CORNERS, True).rotate((0.0, 90.0, 0.0))
    return solid - hole.translate(place)


def text(dice: Dice) -> Manifold:
    """Draw raised letters on a plate, in the font that comes with matplotlib."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextPath

    word = "".join(dice.choice(_LETTERS) for _ in range(dice.whole(2, 6)))
    size_mm, thick_mm, raised_mm = dice.uniform(12.0, 22.0), dice.uniform(1.2, 2.4), dice.uniform(0.8, 2.0)
    outline = TextPath((0.0, 0.0), word, size=size_mm, prop=FontProperties(family="DejaVu Sans", weight="bold"))
    polygons = [np.asarray(polygon) for polygon in outline.to_polygons(closed_only=True)]
    contours = [polygon[:-1] for polygon in polygons if len(polygon) > 3]
    letters = CrossSection(contours, FillRule.EvenOdd)
    left, low, right, high = letters.bounds()
    margin_mm = dice.uniform(2.0, 5.0)
    size = (right - left + 2 * margin_mm, high - low + 2 * margin_mm)
    plate = Manifold.cube((*size, thick_mm)).translate((left - margin_mm, low - margin_mm, 0.0))
    raised = Manifold.extrude(letters, raised_mm + 0.2).translate((0.0, 0.0, thick_mm - 0.2))
    return plate + raised


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
