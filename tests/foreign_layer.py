"""A slicer, a broken printer and a scanner of our own making for tests: they share no code with printmend.

The slicer lays perimeters and lines of infill with shapely, the printer is a loop over short steps with uneven pulleys
and play, and the scanner draws beads as polygons of uneven width with Pillow.
"""

import io
import itertools
import math

import cv2
import numpy as np
import shapely
import shapely.affinity
from PIL import Image, ImageDraw, ImageFilter

NOZZLE, HEIGHT, FILAMENT = 0.45, 0.24, 1.75


def gear(centre=(115.0, 112.0), size=34.0, teeth=5, hole=8.0):
    """A wavy outline with an eccentric round hole and a slot: curves in every direction, no symmetry."""
    t = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    r = size * (1 + 0.12 * np.cos(teeth * t) + 0.06 * np.sin(2 * t + 0.4))
    body = shapely.Polygon(np.stack([centre[0] + r * np.cos(t), centre[1] + r * np.sin(t)], axis=1))
    body = body.difference(shapely.Point(centre[0] + 0.3 * size, centre[1] + 0.2 * size).buffer(hole))
    slot = shapely.LineString(
        [(centre[0] - 0.5 * size, centre[1] - 0.4 * size), (centre[0] - 0.2 * size, centre[1] + 0.3 * size)]
    )
    return body.difference(slot.buffer(3.0))


def star(centre=(115.0, 112.0), size=28.0):
    t = np.linspace(0, 2 * np.pi, 12, endpoint=False) + 0.2
    r = np.where(np.arange(12) % 2 == 0, size, 0.6 * size)
    return shapely.Polygon(np.stack([centre[0] + r * np.cos(t), centre[1] + r * np.sin(t)], axis=1))


def paths(shape, perimeters=2):
    """Closed walls from the outside in, then infill at 45°."""
    found = []
    for k in range(perimeters):
        inner = shape.buffer(-NOZZLE * (k + 0.5))
        for part in getattr(inner, "geoms", [inner]):
            found += [np.array(ring.coords) for ring in (part.exterior, *part.interiors)]
    inside = shapely.affinity.rotate(shape.buffer(-NOZZLE * perimeters), -45, origin=(0, 0))
    low_x, low_y, high_x, high_y = inside.bounds
    for k, y in enumerate(np.arange(low_y, high_y, NOZZLE)):
        cut = shapely.LineString([(low_x - 1, y), (high_x + 1, y)]).intersection(inside)
        for piece in getattr(cut, "geoms", [cut]):
            if piece.length > 1:
                line = np.array(piece.coords)[:: 1 if k % 2 else -1]
                found.append(np.array(shapely.affinity.rotate(shapely.LineString(line), 45, origin=(0, 0)).coords))
    return found


def gcode(shape, layers=1):
    """Marlin's G-code of the shape, and its strokes as arrays of way-points, layer 1 only."""
    strokes = paths(shape)
    lines = ["G28", "G21", "G90", "M83", "G92 E0"]
    for layer in range(layers):
        z = HEIGHT * (layer + 1)
        lines += [";LAYER_CHANGE", f"G1 Z{z:.2f} F600", ";TYPE:External perimeter"]
        for stroke in strokes:
            lines.append(f"G0 X{stroke[0, 0]:.4f} Y{stroke[0, 1]:.4f} F7200")
            for a, b in itertools.pairwise(stroke):
                area = HEIGHT * (NOZZLE - HEIGHT * (1 - math.pi / 4))
                e = math.dist(a, b) * area / (math.pi * FILAMENT**2 / 4)
                lines.append(f"G1 X{b[0]:.4f} Y{b[1]:.4f} E{e:.5f} F1800")
    return "\n".join(lines) + "\n", strokes


class Machine:
    """Uneven pulleys (eccentric, oval, triangular), play on either axis, gains, a skewed frame."""

    def __init__(self, waves=((), ()), play=(0.0, 0.0), gain=(0.0, 0.0), skew=0.0, turn=40.0):
        self.waves, self.play, self.gain, self.skew, self.turn = waves, play, gain, skew, turn

    def run(self, points, home=(0.0, 0.0)):
        """Follow way-points [N, 2] from home; return where each came to lie."""
        corners = np.vstack([home, points])
        count = np.maximum(1, (np.hypot(*np.diff(corners, axis=0).T) / 0.1).astype(int))
        ends = np.cumsum(count)
        way = np.concatenate([[0.0], ends])
        belts = []
        for axis in range(2):
            m = np.interp(np.arange(1, ends[-1] + 1), way, corners[:, axis])
            mean = m * (1 + self.gain[axis])
            for order, size, phase in self.waves[axis]:
                mean = mean + size * np.sin(2 * math.pi * order * m / self.turn + phase)
            half, belt, places = self.play[axis] / 2, home[axis], []
            for value in mean.tolist():
                belt = min(max(belt, value - half), value + half)
                places.append(belt)
            belts.append(np.array(places)[ends - 1])
        return np.stack([belts[0] + math.tan(self.skew) * belts[1], belts[1]], axis=1)

    def strokes(self, strokes):
        """Print strokes one after the other; long lines are cut, so that they come out bent."""
        cut = []
        for stroke in strokes:
            line = [stroke[0]]
            for a, b in itertools.pairwise(stroke):
                n = max(1, int(math.dist(a, b) / 0.4))
                line += [a + (b - a) * k / n for k in range(1, n + 1)]
            cut.append(np.array(line))
        printed = self.run(np.vstack(cut))
        return np.split(printed, np.cumsum([len(line) for line in cut])[:-1])


def _draw(pen, line, radii):
    """Draw a line [N, 2] px as wide as its ``radii`` [N, 1]: a trapezium for each piece, a disc at its end."""
    p, q, r, s = line[:-1], line[1:], radii[:-1], radii[1:]
    d = q - p
    n = np.stack([-d[:, 1], d[:, 0]], axis=1) / (np.hypot(*d.T) + 1e-9)[:, None]
    pieces = np.hstack([p + n * r, q + n * s, q - n * s, p - n * r]).tolist()
    for piece, disc in zip(pieces, np.hstack([q - s, q + s]).tolist(), strict=True):
        pen.polygon(piece, fill=255)
        pen.ellipse(disc, fill=255)


def scan(strokes, rng, *, dpi=600, below=True, angle=3.0, swell=0.09, texture=5.0, jpeg=88, dust=40, margin=12.0,
         stretch=(0.0, 0.0), ink=(60, 55, 50), plate=(232, 230, 226), size_mm=None):  # fmt: skip
    """Draw what a flatbed sees of a layer, as a JPEG in bytes."""
    finer = max(2, round(1200 / dpi))  # Pillow draws at whole pixels
    fine = finer * dpi / 25.4
    a = math.radians(angle)
    spin = np.array([[math.cos(a), math.sin(a)], [-math.sin(a), math.cos(a)]])
    flip = np.array([-1.0 if below else 1.0, -1.0])
    laid = [(line * flip) @ spin * (1 + np.array(stretch)) for line in strokes]
    low = np.vstack(laid).min(axis=0) - margin
    size = np.vstack(laid).max(axis=0) + margin - low if size_mm is None else np.array(size_mm)
    width, height = (int(v) for v in size * dpi / 25.4)
    picture = Image.new("L", (width * finer, height * finer), 0)
    pen = ImageDraw.Draw(picture)
    for line in laid:
        line = (line - low) * fine
        wide = (NOZZLE / 2 + swell) * fine
        radii = wide * (1 + 0.05 * np.interp(np.arange(len(line)), np.arange(0, len(line) + 30, 12),
                                             rng.normal(size=len(np.arange(0, len(line) + 30, 12)))))  # fmt: skip
        radii[0] *= rng.uniform(0.9, 1.5)
        radii[-1] *= rng.uniform(0.8, 1.4)
        _draw(pen, line, radii[:, None])
        pen.ellipse([*(line[0] - radii[0]), *(line[0] + radii[0])], fill=255)
    share = (
        np.asarray(picture.resize((width, height), Image.Resampling.BOX).filter(ImageFilter.GaussianBlur(1.0)), float)
        / 255
    )
    coarse = Image.fromarray(rng.normal(128, 40, (height // 5 + 1, width // 5 + 1)).clip(0, 255).astype(np.uint8))
    grain = np.asarray(coarse.resize((width, height), Image.Resampling.BILINEAR), float) / 40 - 3.2
    light = 1 + 0.05 * np.linspace(-1, 1, width)[None, :] - 0.03 * np.linspace(-1, 1, height)[:, None] ** 2
    image = np.stack([(p + (i - p) * share) * light for i, p in zip(ink, plate, strict=True)], axis=2)
    image += (grain * texture * (0.4 + share))[:, :, None] + rng.normal(0, 2, image.shape)
    drawn = Image.fromarray(image.clip(0, 255).astype(np.uint8))
    pen = ImageDraw.Draw(drawn)
    for _ in range(dust):
        x, y, r = rng.uniform(0, width), rng.uniform(0, height), rng.uniform(0.5, 3)
        shade = int(rng.choice([30, 250]))
        pen.ellipse([x - r, y - r, x + r, y + r], fill=(shade, shade, shade))
    file = io.BytesIO()
    drawn.save(file, "JPEG", quality=jpeg, dpi=(dpi, dpi))
    return file.getvalue()


def printed_dots(path, machine):
    """Return where the dots of a file come to lie [M, 2], their filament [M], and the strokes printed after the purge
    line, by a machine that starts at home: from the words of its lines alone."""
    way, dots, lines = [], {}, []
    at = np.zeros(2)
    for line in path.read_text().splitlines():
        words = line.partition(";")[0].split()
        if not words or words[0] not in ("G0", "G1"):
            continue
        value = {word[0]: float(word[1:]) for word in words[1:]}
        fed = value.get("E", 0.0)
        if "X" in value or "Y" in value:
            at = np.array([value.get("X", at[0]), value.get("Y", at[1])])
            way.append(at)
            if fed > 0:
                lines.append(len(way) - 1)
        elif fed > 0 and fed not in (0.6, 2.5):  # what is drawn back comes back
            dots[len(way) - 1] = fed
    printed = machine.run(way)
    return printed[list(dots)], np.array(list(dots.values())), [printed[k - 1 : k + 1] for k in lines[1:]]


def with_ruler(jpeg, line_mm, stretch=0.0, length=80.0):
    """Return a scan, a JPEG in bytes, with a ruler along its lower edge, as a scanner stretches it."""
    picture = Image.open(io.BytesIO(jpeg))
    dpi = float(picture.info["dpi"][0])
    scan = np.array(picture)
    below = np.full((round(36 * dpi / 25.4), scan.shape[1], 3), scan[-3:].mean(axis=(0, 1)), np.uint8)
    ruler = below[..., 1].copy()
    _lay_ruler(ruler, dpi / 25.4 * (1 + stretch), (8.0, 6.0), 1.5, line_mm, length)
    drawn = ruler != below[..., 1]
    below[drawn] = ruler[drawn][:, None]
    file = io.BytesIO()
    Image.fromarray(np.vstack([scan, below])).save(file, "JPEG", quality=85, dpi=(dpi, dpi))
    return file.getvalue()


def plate(places, radii, rng, *, threads=(), dpi=300, angle=3.0, quarter=0, jpeg=80, ink=(60, 55, 50),
          plate=(232, 230, 226), hair=0.1, texture=4.0, narrow=0.0):  # fmt: skip
    """Draw what a flatbed sees of dots of plastic [M, 2] with ``radii`` [M] from below, as a JPEG in bytes.

    Dots are wobbly polygons, some with a tail or a hair to the next; ``threads`` are strokes of a net of uneven width.
    """
    fine = 2 * dpi / 25.4
    a = math.radians(angle)
    spin = np.array([[math.cos(a), math.sin(a)], [-math.sin(a), math.cos(a)]])
    laid, nets = (places * [-1.0, -1.0]) @ spin, [(line * [-1.0, -1.0]) @ spin for line in threads]
    low = laid.min(axis=0) - 12.0
    width, height = (int(v) for v in (np.ptp(laid, axis=0) + 24.0) * dpi / 25.4)
    mask = np.zeros((2 * height, 2 * width), np.uint8)

    def at(points):
        return np.rint(((points - low) * fine - 0.5) * 16).astype(int)

    def stroke(points, wide):
        cv2.polylines(mask, [at(points)], False, 255, max(1, round(wide * fine)), cv2.LINE_AA, 4)

    for line in nets:
        cut = line[0] + np.linspace(0, 1, 12)[:, None] * (line[1] - line[0])
        for piece in itertools.pairwise(cut):
            stroke(np.array(piece), rng.uniform(0.33, 0.52))
    turn = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    for k, (middle, radius) in enumerate(zip(laid, radii, strict=True)):
        waves = sum(rng.normal(0, 0.05 / m) * np.cos(m * turn + rng.uniform(0, 6)) for m in (2, 3, 4))
        edge = radius * np.exp(rng.normal(0, 0.05)) * (1 + waves)
        cv2.fillPoly(mask, [at(middle + edge[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1))], 255,
                     cv2.LINE_AA, 4)  # fmt: skip
        if rng.random() < hair and k + 1 < len(laid):
            stroke(laid[k : k + 2], rng.uniform(0.08, 0.25))
    share = cv2.GaussianBlur(cv2.resize(mask, (width, height), interpolation=cv2.INTER_AREA), (0, 0), 0.7) / 255.0
    grain = cv2.resize(rng.normal(0, texture, (height // 4 + 1, width // 4 + 1)), (width, height))
    light = 1 - 0.15 * np.linspace(-1, 1, width)[None, :] ** 2
    image = np.stack([(p + (i - p) * share + grain) * light for i, p in zip(ink, plate, strict=True)], axis=2)
    image = (image + rng.normal(0, 2, image.shape)).clip(0, 255).astype(np.uint8)
    if narrow:
        square = np.float32([[0, 0], [width, 0], [width, height], [0, height]])
        seen = square + np.float32([[narrow * width, 0], [-narrow * width, 0], [0, 0], [0, 0]])
        image = cv2.warpPerspective(
            image, cv2.getPerspectiveTransform(square, seen), (width, height), borderMode=cv2.BORDER_REPLICATE
        )
    file = io.BytesIO()
    Image.fromarray(np.rot90(image, quarter).copy()).save(file, "JPEG", quality=jpeg, dpi=(dpi, dpi))
    return file.getvalue()


def _lay_ruler(paper, px_per_mm, corner_mm, turn_deg, line_mm, length=150.0, steel=205):
    """Draw a ruler into a grey picture: a body 22 mm wide, a line every ``line_mm`` along its upper edge, every fifth
    and tenth longer, and the words of its numbers as bars."""
    a = math.radians(turn_deg)
    along, down = np.array([math.cos(a), math.sin(a)]), np.array([-math.sin(a), math.cos(a)])

    def box(u0, u1, v0, v1, shade):
        corners = [np.array(corner_mm) + u * along + v * down for u, v in ((u0, v0), (u1, v0), (u1, v1), (u0, v1))]
        cv2.fillPoly(paper, [np.rint((np.array(corners) * px_per_mm - 0.5) * 16).astype(int)], shade, cv2.LINE_AA, 4)

    box(-4.0, length + 4.0, 0.0, 22.0, steel)
    for k in range(int(length / line_mm) + 1):
        tall = 7.5 if k % 10 == 0 else 5.5 if k % 5 == 0 else 3.8
        box(k * line_mm - 0.08, k * line_mm + 0.08, 0.6, tall, 35)
        if k % 10 == 0:
            box(k * line_mm - 1.0, k * line_mm - 0.6, 9.0, 11.5, 35)
            box(k * line_mm + 0.3, k * line_mm + 1.2, 9.0, 11.5, 35)


def photo(strokes, rng, *, height=0.24, focal_film=26.0, tilt=(0.12, -0.09), turn=17.0, k1=-0.03, stated=True,
          swell=0.06, size_px=(1500, 2000), sheet=1.0, ink=(60, 55, 50), tags=True, ruler=None, table=0):  # fmt: skip
    """Draw what a telephone sees of a part that lies upside down on the sheet of tags, as a JPEG in bytes.

    The paper is at z = 0, the part's underside at z = ``height``, its walls between them; a pinhole camera with its
    own focal length looks down, tilted, through a lens that bends lines. Without ``tags`` the paper is blank;
    ``ruler`` [mm between its lines] lays one on it; ``table`` is the grey of what lies around.
    """
    fine = 12.0
    paper = np.full((round(297 * fine), round(210 * fine)), 244, np.uint8)
    book = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36H11)
    middles = [(x, y) for y in np.linspace(14, 283, 5) for x in np.linspace(14, 196, 4)
               if x in (14, 196) or y in (14, 283)]  # fmt: skip
    for number, (x, y) in enumerate(middles if tags else ()):
        cells = cv2.aruco.generateImageMarker(book, number, 8)
        at = np.array([[0, 0], [7, 0], [0, 7]], np.float32)
        to = ((np.array([x, y]) - 7 + (at + 0.5) * 14 / 8) * fine * sheet - 0.5).astype(np.float32)
        cv2.warpAffine(cells, cv2.getAffineTransform(at, to), paper.shape[::-1], paper, cv2.INTER_NEAREST,
                       cv2.BORDER_TRANSPARENT)  # fmt: skip
    if ruler is not None:
        _lay_ruler(paper, fine, (30.0, 232.0), 4.0, ruler)
    a = math.radians(turn)
    spin = np.array([[math.cos(a), math.sin(a)], [-math.sin(a), math.cos(a)]])
    laid = [(line * [-1.0, -1.0]) @ spin for line in strokes]  # seen from below, y down
    every = np.vstack([*laid, np.zeros((1, 2))]) if not laid else np.vstack(laid)
    laid = [line - (every.min(axis=0) + every.max(axis=0)) / 2 + [108.0, 140.0] for line in laid]
    plastic = Image.new("L", paper.shape[::-1], 0)
    pen = ImageDraw.Draw(plastic)
    for line in laid:
        r = (NOZZLE / 2 + swell) * fine
        _draw(pen, line * fine, np.full((len(line), 1), r))
        pen.ellipse([*(line[0] * fine - r), *(line[0] * fine + r)], fill=255)
    mask = np.asarray(plastic)
    wide, high = size_px
    focal = focal_film / 43.27 * math.hypot(*size_px)
    away = focal * 297 / high * 1.18
    rx, ry = tilt
    turned = np.array([[1, 0, 0], [0, math.cos(rx), -math.sin(rx)], [0, math.sin(rx), math.cos(rx)]]) @ np.array(
        [[math.cos(ry), 0, math.sin(ry)], [0, 1, 0], [-math.sin(ry), 0, math.cos(ry)]]
    )
    eye = np.array([105.0, 148.5, 0.0]) - turned[2] * away  # z grows away from the camera: the plastic is at -height
    v, u = np.mgrid[0:high, 0:wide].astype(np.float32)
    u, v = u - (wide - 1) / 2, v - (high - 1) / 2
    bend = 1 + k1 * (u * u + v * v) / ((wide / 2) ** 2 + (high / 2) ** 2)
    u, v = u * bend / focal, v * bend / focal
    ray = [turned[0, k] * u + turned[1, k] * v + turned[2, k] for k in range(3)]

    def seen(raster, z, beyond=0):
        share = (-z - eye[2]) / ray[2]
        x, y = ((eye[k] + share * ray[k]) * fine - 0.5 for k in range(2))
        return cv2.remap(raster, x.astype(np.float32), y.astype(np.float32), cv2.INTER_AREA, borderValue=beyond) / 255.0

    light = 1 + 0.08 * (u + 0.5 * v)
    image = (235 * seen(paper, 0.0, table) + 12)[..., None] * np.array([1.0, 0.99, 0.96])
    levels = max(1, round(height / 1.5))
    for k in range(levels):
        there = seen(mask, height * (k + 1) / levels)[..., None]
        image = image * (1 - there) + there * np.array(ink) * (1.0 if k == levels - 1 else 0.7)
    image = cv2.GaussianBlur(image * light[..., None], (0, 0), 0.8) + rng.normal(0, 2.5, image.shape)
    told = Image.Exif()
    told.get_ifd(0x8769).update({0x829A: 0.01, 0xA405: int(focal_film)} if stated else {})
    file = io.BytesIO()
    Image.fromarray(image.clip(0, 255).astype(np.uint8)).save(file, "JPEG", quality=92, exif=told)
    return file.getvalue()


def way(path):
    """Way-points [N, 2] of the G0 and G1 lines of a file, and the filament [N] that each lays."""
    points, laid, x, y = [], [], None, None
    for line in path.read_text().splitlines():
        words = line.partition(";")[0].split()
        if words and words[0] in ("G0", "G1"):
            values = {word[0]: float(word[1:]) for word in words[1:]}
            if "X" in values or "Y" in values:
                x, y = values.get("X", x), values.get("Y", y)
                points.append((x, y))
                laid.append(max(values.get("E", 0.0), 0.0))
    return np.array(points), np.array(laid)


def paired_error(machine, wanted_path, printed_path):
    """RMS distance between what the machine prints of one file and what another asks for, at equal filament, shifted
    onto each other."""

    def dense(points, laid):
        places, filament, drawn, total = [], [], [], 0.0
        for i in range(1, len(points)):
            count = max(1, int(math.dist(points[i], points[i - 1]) / 0.5))
            for k in range(1, count + 1):
                places.append(points[i - 1] + (points[i] - points[i - 1]) * k / count)
                filament.append(total + laid[i] * k / count)
                drawn.append(laid[i] > 0)
            total += laid[i]
        return np.array(places), np.array(filament), np.array(drawn)

    ideal, at, drawn = dense(*way(wanted_path))
    places, here, printed = dense(*way(printed_path))
    places, here = machine.run(places)[printed], here[printed]
    wanted = np.stack([np.interp(here, at[drawn], ideal[drawn, axis]) for axis in range(2)], axis=1)
    steady = np.hypot(*np.diff(wanted, axis=0, prepend=wanted[:1]).T) < 0.6
    error = (places - wanted)[steady]
    off = np.hypot(*(error - np.median(error, axis=0)).T)
    return float(np.sqrt(np.mean(off[off < 3.0] ** 2)))  # where a stroke ends, filament tells both ends
