"""The part of the play screen: a plate with round holes, a word and a thin wall, whose damage anyone sees.

A hole that is no circle, a word that waves and a slanting wall that is not straight show what a pulley, a belt or a
screw does. The G-code is made here, for the middle of the printer's bed.
"""

import itertools
import math
from collections.abc import Iterator
from functools import lru_cache

import numpy as np
import shapely

from printmend.printer import Printer
from printmend.probe.gcode import CLOSING, LIFT_MM_S, PLAIN_START, TRAVEL_MM_S, filament_mm

SIZE_MM = (92.0, 60.0)
LAYER_MM, BEAD_MM, PRINT_MM_S = 0.25, 0.45, 40.0
PLATE_LAYERS, WORD_LAYERS, WALL_LAYERS = 8, 5, 40  # the word and the wall stand on the plate
WORD, _LETTER_MM, _SPACE_MM, _WORD_AT_MM, _WORD_BEAD_MM = "printmend", 8.4, 2.2, (-38.5, -21.5), 0.8
HOLES_MM = ((-24.0, 10.0, 13.0), (4.0, 16.0, 7.0), (4.0, -3.0, 4.0))  # x, y and radius, from the middle
_WALL_MM = ((17.0, -6.0), (40.0, 24.0))
_CORNER_MM, _CHORD_MM = 5.0, 0.6

Stroke = np.ndarray  # places [N, 2] mm that a bead joins


def _arc(x: float, y: float, across: float, high: float, begin_deg: float, end_deg: float) -> list[tuple[float, float]]:
    angles = np.radians(np.linspace(begin_deg, end_deg, 7 + round(abs(end_deg - begin_deg) / 20)))
    return [(x + across * math.cos(a), y + high * math.sin(a)) for a in angles]


# Strokes of the letters: small letters are 1 high.
_BOWL = _arc(0.4, 0.5, 0.4, 0.5, 0, 360)
_LETTERS: dict[str, tuple[float, list[list[tuple[float, float]]]]] = {
    "p": (0.8, [[(0, -0.45), (0, 1)], _BOWL]),
    "r": (0.5, [[(0, 0), (0, 1)], [*_arc(0.42, 0.55, 0.42, 0.45, 180, 70)]]),
    "i": (0.0, [[(0, 0), (0, 1)], [(0, 1.33), (0, 1.45)]]),
    "n": (0.7, [[(0, 0), (0, 1)], [(0, 0.6), *_arc(0.35, 0.62, 0.35, 0.38, 180, 0), (0.7, 0)]]),
    "t": (0.5, [[(0.2, 1.4), *_arc(0.45, 0.25, 0.25, 0.25, 180, 280)], [(-0.05, 1), (0.5, 1)]]),
    "m": (1.1, [
        [(0, 0), (0, 1)], [(0, 0.6), *_arc(0.275, 0.68, 0.275, 0.32, 180, 0), (0.55, 0)],
        [(0.55, 0.6), *_arc(0.825, 0.68, 0.275, 0.32, 180, 0), (1.1, 0)],
    ]),
    "e": (0.8, [[(0.02, 0.52), (0.8, 0.52), *_arc(0.4, 0.5, 0.4, 0.5, 5, 320)]]),
    "d": (0.8, [_BOWL, [(0.8, 1.5), (0.8, 0)]]),
}  # fmt: skip


@lru_cache(maxsize=1)
def layers() -> tuple[tuple[tuple[Stroke, float, bool], ...], ...]:
    """Return the strokes of each layer from the middle of the part: places, width of the bead, and if it fills."""
    plate, above = [], (*((stroke, _WORD_BEAD_MM, False) for stroke in _word()),)
    wall = ((np.array(_WALL_MM), BEAD_MM, False),)
    for number in range(PLATE_LAYERS):
        plate.append(
            (*((one, BEAD_MM, False) for one in _outlines()), *((one, BEAD_MM, True) for one in _fill(number)))
        )
    stands = [(*(above if number < WORD_LAYERS else ()), *wall) for number in range(WALL_LAYERS)]
    return (*plate, *stands)


def plate_gcode(printer: Printer) -> bytes:
    """Return the file that prints the part in the middle of a printer's bed."""
    middle, lines = (
        np.array(printer.middle_mm),
        ["; a plate with holes, a word and a wall\n", PLAIN_START, "G90\nM83\nG92 E0\n"],
    )
    for number, strokes in enumerate(layers(), start=1):
        z_mm = number * LAYER_MM
        lines.append(f";LAYER_CHANGE\n;Z:{z_mm:g}\n;HEIGHT:{LAYER_MM:g}\nG1 Z{z_mm:g} F{LIFT_MM_S * 60:g}\n")
        for stroke, bead_mm, _ in strokes:
            places = stroke + middle
            lines.append(f"G0 X{places[0][0]:.3f} Y{places[0][1]:.3f} F{TRAVEL_MM_S * 60:g}\n")
            feed = f" F{PRINT_MM_S * 60:g}"
            for before, place in itertools.pairwise(places):
                e_mm = filament_mm(math.dist(before, place) * bead_mm * LAYER_MM)
                lines.append(f"G1 X{place[0]:.3f} Y{place[1]:.3f} E{e_mm:.5f}{feed}\n")
                feed = ""
    return "".join([*lines, f"G0 Z{len(layers()) * LAYER_MM + 10:g} F{LIFT_MM_S * 60:g}\n", CLOSING]).encode()


def _word() -> Iterator[Stroke]:
    x, y = _WORD_AT_MM
    for letter in WORD:
        wide, strokes = _LETTERS[letter]
        for stroke in strokes:
            yield np.array(stroke) * _LETTER_MM + (x, y)
        x += wide * _LETTER_MM + _SPACE_MM


@lru_cache(maxsize=1)
def _shape() -> shapely.Polygon:
    wide, deep = (side / 2 - _CORNER_MM for side in SIZE_MM)
    plate = shapely.box(-wide, -deep, wide, deep).buffer(_CORNER_MM, quad_segs=12)
    holes = [
        shapely.Point(x, y).buffer(radius, quad_segs=round(radius * math.pi / 2 / _CHORD_MM))
        for x, y, radius in HOLES_MM
    ]
    return plate.difference(shapely.union_all(holes))


def _outlines() -> Iterator[Stroke]:
    for loop in (0.5, 1.5):
        shape = _shape().buffer(-loop * BEAD_MM)
        for ring in (shape.exterior, *shape.interiors):
            yield np.array(ring.coords)


def _fill(number: int) -> Iterator[Stroke]:
    """Yield lines at 45°, one layer this way and the next that, each as far as the outlines leave room."""
    room, reach = _shape().buffer(-2 * BEAD_MM), sum(SIZE_MM)
    turned = shapely.affinity.rotate(room, 45.0 if number % 2 else -45.0, origin=(0, 0))
    heights = np.arange(-reach / 2, reach / 2, BEAD_MM)
    back = math.radians(-45.0 if number % 2 else 45.0)
    turn = np.array([[math.cos(back), math.sin(back)], [-math.sin(back), math.cos(back)]])
    for count, y in enumerate(heights):
        line = turned.intersection(shapely.LineString([(-reach, y), (reach, y)]))
        pieces = [
            np.array(one.coords) for one in getattr(line, "geoms", [line]) if not one.is_empty and one.length > BEAD_MM
        ]
        pieces.sort(key=lambda one: one[0][0])
        for piece in pieces if count % 2 else [one[::-1] for one in pieces[::-1]]:
            yield piece @ turn
