"""Parts with round holes, their G-code, and scans of how they came out: no code of printmend.

The parts are polygons of shapely, the scans are drawn by Pillow. Holes, outline, the first layer's foot and the scales
along X and Y come out as told, each wall as uneven as beads are.
"""

import io
import itertools
import math

import numpy as np
import shapely
import shapely.affinity
from PIL import Image, ImageDraw, ImageFilter

WIDTH_MM, HEIGHT_MM, FILAMENT_MM, LAYERS = 0.45, 0.2, 1.75, 12
DIAMETERS_MM = (4.0, 6.0, 8.0, 12.0)
TOUCHED_PIXELS = 0.3  # Pillow fills pixels that an edge touches, too: circles of 2 to 14 mm are drawn so much larger


def part(rng, centre=(110.0, 110.0), sizes=(28, 40)):
    """A plate with a wavy outline, four round holes of other sizes and a slot, and its design holes."""
    t = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    size = rng.uniform(*sizes)
    r = size * (1 + rng.uniform(0, 0.1) * np.cos(4 * t + rng.uniform(0, 6)) + 0.05 * np.sin(2 * t))
    body = shapely.Polygon(np.stack([centre[0] + r * np.cos(t), centre[1] + r * np.sin(t)], axis=1))
    holes = []
    for k, diameter in enumerate(DIAMETERS_MM):
        a = 2 * np.pi * k / 4 + 0.4
        at = (centre[0] + 0.5 * size * math.cos(a), centre[1] + 0.5 * size * math.sin(a))
        holes.append((at, diameter))
        body = body.difference(shapely.Point(at).buffer(diameter / 2, quad_segs=32))
    return body.difference(
        shapely.LineString([(centre[0] - 6, centre[1] - 2), (centre[0] + 6, centre[1] + 3)]).buffer(2.5)
    ), holes


def plate():
    """A square plate with four round holes: a part with corners."""
    body = shapely.box(80, 80, 140, 140)
    for at, diameter in zip(itertools.product((95, 125), repeat=2), DIAMETERS_MM, strict=True):
        body = body.difference(shapely.Point(at).buffer(diameter / 2, quad_segs=32))
    return body


def gcode(shape, layers=LAYERS):
    """Marlin's G-code of a plate: two walls and infill, the same in each layer."""
    strokes = []
    for k in range(2):
        inner = shape.buffer(-WIDTH_MM * (k + 0.5))
        for piece in getattr(inner, "geoms", [inner]):
            strokes += [np.array(ring.coords) for ring in (piece.exterior, *piece.interiors)]
    inside = shapely.affinity.rotate(shape.buffer(-WIDTH_MM * 2), -45, origin=(0, 0))
    low_x, low_y, high_x, high_y = inside.bounds
    for k, y in enumerate(np.arange(low_y, high_y, WIDTH_MM)):
        cut = shapely.LineString([(low_x - 1, y), (high_x + 1, y)]).intersection(inside)
        for piece in getattr(cut, "geoms", [cut]):
            if piece.length > 1:
                line = np.array(piece.coords)[:: 1 if k % 2 else -1]
                strokes.append(np.array(shapely.affinity.rotate(shapely.LineString(line), 45, origin=(0, 0)).coords))
    area = HEIGHT_MM * (WIDTH_MM - HEIGHT_MM * (1 - math.pi / 4)) / (math.pi * FILAMENT_MM**2 / 4)
    lines = ["G28", "G21", "G90", "M83", "G92 E0"]
    for layer in range(layers):
        lines += [";LAYER_CHANGE", f"G1 Z{HEIGHT_MM * (layer + 1):.2f} F600", ";TYPE:External perimeter"]
        for stroke in strokes:
            lines.append(f"G0 X{stroke[0, 0]:.4f} Y{stroke[0, 1]:.4f} F7200")
            for a, b in itertools.pairwise(stroke):
                lines.append(f"G1 X{b[0]:.4f} Y{b[1]:.4f} E{math.dist(a, b) * area:.5f} F1800")
    return "\n".join(lines) + "\n"


def rough(ring, rng, scatter_mm=0.02):
    """A ring with the unevenness of beads: smooth over a millimetre."""
    line = shapely.LineString(ring.coords).segmentize(0.25)
    points = np.array(line.coords)[:-1]
    noise = rng.normal(size=len(points))
    kernel = np.exp(-0.5 * (np.arange(-12, 13) / 4.0) ** 2)
    noise = np.convolve(np.concatenate([noise[-12:], noise, noise[:12]]), kernel, "valid")
    noise *= scatter_mm / noise.std()
    away = np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0)
    away = np.stack([away[:, 1], -away[:, 0]], axis=1) / (np.hypot(*away.T)[:, None] + 1e-12)
    return points + away * noise[:, None]


def printed(shape, outline_mm, hole_mm, scale, rng, corner_mm=0.0):
    """Rings of the plastic: the outline moved out, the holes in, all of it scaled along X and Y. With ``corner_mm`` a
    bead is wider by that on either side where the outline turns sharply."""
    outer = shapely.Polygon(shape.exterior).buffer(outline_mm)
    if corner_mm:
        bead = shapely.Polygon(shape.exterior).buffer(-WIDTH_MM / 2, join_style="mitre")
        tips = shapely.MultiPoint(bead.simplify(0.3).exterior.coords)
        outer = outer.union(tips.buffer(WIDTH_MM / 2 + outline_mm + corner_mm))
    rings = [outer.exterior]
    rings += [shapely.Polygon(hole).buffer(-hole_mm).exterior for hole in shape.interiors]
    middle = np.array(shape.centroid.coords[0])
    return [(rough(ring, rng) - middle) * (1 + np.array(scale)) for ring in rings]


def came_out(rings, at, shape):
    """The diameter of the round hole that came out where ``shape`` has one at ``at`` [2], by its area."""
    where = shapely.Point(np.subtract(at, shape.centroid.coords[0]))
    hole = min((shapely.Polygon(ring) for ring in rings[1:]), key=lambda one: one.centroid.distance(where))
    return 2 * math.sqrt(hole.area / math.pi)


def scan(levels, rng, *, below, dpi=600, stretch=(0.0, 0.0)):
    """A scan of rings in ``levels``: (rings, how dark, how blurred in mm), the farthest from the glass first."""
    angle = rng.uniform(-6, 6)
    a, flip = math.radians(angle), np.array([-1.0 if below else 1.0, -1.0])
    spin = np.array([[math.cos(a), math.sin(a)], [-math.sin(a), math.cos(a)]])
    laid = [
        ([(ring * flip) @ spin * (1 + np.array(stretch)) for ring in rings], dark, blur) for rings, dark, blur in levels
    ]
    every = np.vstack([ring for rings, *_ in laid for ring in rings])
    low, size = every.min(axis=0) - 12.0, np.ptp(every, axis=0) + 24.0
    fine, (width, height) = 3, (int(v) for v in size * dpi / 25.4)
    share = np.zeros((height, width))
    for rings, dark, blur in laid:
        mask = Image.new("L", (width * fine, height * fine), 0)
        pen = ImageDraw.Draw(mask)
        for number, ring in enumerate(rings):
            drawn = shapely.Polygon((ring - low) * dpi / 25.4 * fine - 0.5).buffer(-TOUCHED_PIXELS)
            pen.polygon(list(drawn.exterior.coords), fill=0 if number else 255)
        small = mask.resize((width, height), Image.Resampling.BOX).filter(ImageFilter.GaussianBlur(blur * dpi / 25.4))
        share = np.maximum(share, dark * np.asarray(small, float) / 255)
    light = 1 + 0.05 * np.linspace(-1, 1, width)[None, :]
    image = np.stack(
        [(p + (i - p) * share) * light for i, p in zip((60, 55, 50), (232, 230, 226), strict=True)], axis=2
    )
    image += rng.normal(0, 3, image.shape)
    file = io.BytesIO()
    Image.fromarray(image.clip(0, 255).astype(np.uint8)).save(file, "PNG", compress_level=1, dpi=(dpi, dpi))
    return file.getvalue()
