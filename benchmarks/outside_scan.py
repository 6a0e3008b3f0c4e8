"""A second picture of a printed plate that shares no code with printmend: G-code strokes and blobs, drawn by OpenCV.

Where filament leaves a nozzle that moves, a stroke of the bead's width is drawn; where it leaves a nozzle that stands
still, a round blob of its volume. Retraction is counted. Nothing is known of marks or of a probe.json.
"""

import itertools
import math
import re
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

FILAMENT_MM2, LAYER_MM, MARGIN_MM = math.pi * 1.75**2 / 4, 0.24, 6.0
SHIFT = 4  # OpenCV draws in sixteenths of a pixel
_WORD = re.compile(r"([A-Za-z])\s*([-+]?\d*\.?\d+)")


@dataclass
class Bead:
    """A stroke from ``start_mm`` to ``end_mm`` (equal: a blob) of ``volume_mm3``."""

    start_mm: tuple[float, float]
    end_mm: tuple[float, float]
    volume_mm3: float


@dataclass
class Look:
    """How plate and scanner look; grey levels 0–255 for each of blue, green, red."""

    filament: tuple[int, int, int] = (35, 35, 35)
    bed: tuple[int, int, int] = (225, 225, 225)
    dpi: float = 600.0
    turn_deg: float = 0.0
    mirrored: bool = False
    blur_mm: float = 0.02
    noise: float = 3.0
    shade: float = 0.1


def read_beads(text: str, commanded: list, printed: list[np.ndarray]) -> list[Bead]:
    """Follow the E words of plain relative G-code (M83) beside the moves of `outside.read_moves`, printed somewhere."""
    beads, stored, number = [], 0.0, 0
    at = (0.0, 0.0)
    for line in text.splitlines():
        words = _WORD.findall(line.split(";")[0])
        if not words or words[0][0].upper() != "G" or float(words[0][1]) not in (0, 1, 28):
            continue
        end = tuple(printed[number][-1])
        if float(words[0][1]) != 28:
            value = {letter.upper(): float(found) for letter, found in words[1:]}
            stored += value.get("E", 0.0)
            if value.get("E", 0.0) > 0 and stored > 1e-9:
                way = (
                    [at, *map(tuple, printed[number])]
                    if commanded[number].start_mm != commanded[number].end_mm
                    else [at]
                )
                share = stored * FILAMENT_MM2 / max(1, len(way) - 1)
                beads += [Bead(a, b, share) for a, b in itertools.pairwise(way)] or [Bead(at, end, share)]
            stored = min(stored, 0.0)
        at = end
        number += 1
    return beads


def draw(beads: list[Bead], look: Look, rng: np.random.Generator) -> np.ndarray:
    """Return the scan [H, W, 3] uint8, blue first: the plate turned by any angle, with a free margin."""
    scale, turn = look.dpi / 25.4, math.radians(look.turn_deg)
    side = -1.0 if look.mirrored else 1.0

    def seen(point: tuple[float, float]) -> tuple[float, float]:
        x, y = side * point[0], -point[1]
        return (x * math.cos(turn) - y * math.sin(turn), x * math.sin(turn) + y * math.cos(turn))

    ends = np.array([[seen(bead.start_mm), seen(bead.end_mm)] for bead in beads])
    low, high = ends.min(axis=(0, 1)) - MARGIN_MM, ends.max(axis=(0, 1)) + MARGIN_MM
    width, height = (math.ceil(value * scale) for value in high - low)
    ink = np.zeros((height, width), np.uint8)
    for bead, (start, end) in zip(beads, (ends - low) * scale, strict=True):
        a, b = ([round((float(v) - 0.5) * 2**SHIFT) for v in point] for point in (start, end))
        if bead.start_mm == bead.end_mm:
            radius = math.sqrt(bead.volume_mm3 / LAYER_MM / math.pi) * scale * rng.normal(1, 0.03)
            cv2.circle(ink, a, round(radius * 2**SHIFT), 255, -1, cv2.LINE_AA, SHIFT)
        else:
            thick = bead.volume_mm3 / LAYER_MM / math.dist(bead.start_mm, bead.end_mm)
            cv2.line(ink, a, b, 255, max(1, round(thick * scale)), cv2.LINE_AA, SHIFT)
    share = cv2.GaussianBlur(ink, (0, 0), max(look.blur_mm * scale, 0.3)).astype(np.float32)[:, :, None] / 255
    picture = np.float32(look.bed) + share * np.float32(np.subtract(look.filament, look.bed))
    picture *= np.linspace(1 - look.shade, 1, width, dtype=np.float32)[None, :, None]
    picture += rng.standard_normal(picture.shape, np.float32) * np.float32(look.noise)
    return np.clip(picture, 0, 255).astype(np.uint8)


def save(path: Path, picture: np.ndarray, kind: str, dpi: float | None) -> None:
    """Write a picture as rgb, grey, grey16, alpha, palette or binary, in the format of the file's name."""
    rgb = Image.fromarray(np.ascontiguousarray(picture[:, :, ::-1]))
    if kind == "grey16":
        deep = np.asarray(rgb.convert("L")).astype(np.uint16) * 257
        image = Image.fromarray(deep)
    else:
        modes = {"rgb": "RGB", "grey": "L", "alpha": "RGBA", "palette": "P", "cmyk": "CMYK"}
        image = rgb.convert(modes[kind])
    stated = {} if dpi is None else {"dpi": (dpi, dpi)}
    if path.suffix == ".jpg":
        stated["quality"] = 85
    image.save(path, **stated)
