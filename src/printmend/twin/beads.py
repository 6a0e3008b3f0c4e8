"""Print the beads of a part's layer on the twin, for a scan of its underside or top."""

import numpy as np

from printmend.fit.estimate import OUTER, outline_of
from printmend.gcode.read import Program
from printmend.measure.walls import CORNER_RAD, RASTER_MM, STEP_MM, Walls, read_walls
from printmend.metrics.shape import nearest
from printmend.twin.gcode import follow_finely
from printmend.twin.twin import Twin


def print_beads(program: Program, twin: Twin, *, layer: int = 1) -> list[tuple[np.ndarray, np.ndarray]]:
    """Print a part on the twin; return a layer's beads where an instrument sees them, without the skirt. Layers count
    from 1.

    Each bead has points [N, 2] mm, and its width [N] mm up to each point. A bulge at a corner is a bead with two equal
    points. Raises `GcodeError` like `read_walls`.
    """
    walls = read_walls(program, twin.printer, layer=layer)
    outline = outline_of(walls)
    wanted, printed, extruding, number = follow_finely(program, twin)
    printed = printed + twin.misread_mm(wanted)
    own_layer = number == np.unique(number[extruding & (number >= 0)])[layer - 1]
    drawn = extruding & own_layer & _on_part(walls, wanted[1:])
    wide_mm = 2 * (float(np.median(walls.half_mm)) + twin.wider_mm + (twin.beads.foot_mm if layer == 1 else 0.0))
    apart_mm, wall = nearest(walls.commanded_mm[walls.row], wanted)
    beside_hole = (apart_mm < STEP_MM) & (outline.group[wall] > OUTER)
    widths_mm = wide_mm + 2 * twin.beads.hole_mm * beside_hole
    cuts = np.flatnonzero(np.diff(np.concatenate([[False], drawn, [False]]).astype(int)))
    beads = []
    for first, last in zip(cuts[::2], cuts[1::2], strict=True):
        own = slice(first, last + 1)
        beads.append((printed[own], widths_mm[own]))
        way = np.diff(wanted[own], axis=0)
        if (wanted[first] == wanted[last]).all():
            way = np.vstack([way, way[:1]])  # a ring turns at its seam, too
        turn = np.abs(np.angle(np.exp(1j * np.diff(np.arctan2(way[:, 1], way[:, 0])))))
        for corner in first + 1 + np.flatnonzero(turn > CORNER_RAD):
            bulge_mm = widths_mm[corner] + 2 * twin.beads.corner_mm
            beads.append((printed[[corner, corner]], np.full(2, bulge_mm)))
    return beads


def _on_part(walls: Walls, places_mm: np.ndarray) -> np.ndarray:
    """Mark the places [N, 2] that lie on the file's part."""
    x, y = np.rint((places_mm - walls.corner_mm) / RASTER_MM).astype(int).T
    high, wide = walls.plastic.shape
    inside = (x >= 0) & (x < wide) & (y >= 0) & (y < high)
    return np.asarray(inside & walls.plastic[y.clip(0, high - 1), x.clip(0, wide - 1)])
