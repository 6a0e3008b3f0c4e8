"""Bodies that are made here: any number of them by a seed, and the demonstrations' timing pulley.

Vertices are rounded to whole micrometres and put in order, so that neither the last digit of a sine nor the threads of
the geometry library show in the file. `GENERATOR` goes into every name: raise it when any body changes. numpy keeps its
random streams only from one release to the next, so that a die draws from SHA-256.
"""

import hashlib
from collections.abc import Sequence
from typing import TypeVar

import numpy as np

from printmend_lab.body.solid import Solid

Choice = TypeVar("Choice")


class Dice:
    """Draws from SHA-256 over a text and a counter."""

    def __init__(self, text: str) -> None:
        self._text, self._drawn = text, 0

    def uniform(self, low: float, high: float) -> float:
        """Return a number of [low, high)."""
        self._drawn += 1
        digest = hashlib.sha256(f"{self._text} {self._drawn}".encode()).digest()
        return low + (high - low) * (int.from_bytes(digest[:7], "big") / 2**56)

    def whole(self, low: int, high: int) -> int:
        """Return a whole number of low…high, both included."""
        return low + int(self.uniform(0.0, high - low + 1))

    def choice(self, items: Sequence[Choice]) -> Choice:
        return items[self.whole(0, len(items) - 1)]

    def chance(self, share: float) -> bool:
        """Return True in ``share`` of all cases."""
        return self.uniform(0.0, 1.0) < share


GENERATOR = 1  # the generator's version
LICENCE = "CC0-1.0"
KINDS = ("gear", "bracket", "vase", "text", "gyroid", "assembly")
_MICRON_MM = 1e-3  # the grid of the corners


def generated_name(seed: int, number: int) -> str:
    """Return the name of a body: its kind, the generator's version, the seed and the number."""
    return f"{_kind(seed, number)}-g{GENERATOR}-s{seed}-{number:05d}"


def generated_solid(seed: int, number: int) -> Solid:
    """Make the body of that number of a seed's endless list."""
    from printmend_lab.body import generators  # its libraries are an extra

    mesh = getattr(generators, _kind(seed, number))(Dice(f"{GENERATOR} {seed} {number} shape")).to_mesh()
    vertices, faces = _ordered(np.asarray(mesh.vert_properties)[:, :3], np.asarray(mesh.tri_verts))
    return Solid(generated_name(seed, number), vertices, faces)


def _kind(seed: int, number: int) -> str:
    return Dice(f"{GENERATOR} {seed} {number} kind").choice(KINDS)


def _ordered(vertices_mm: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the mesh [V, 3], [F, 3] on whole micrometres, standing at the origin, vertices and faces in order."""
    micron = np.rint((vertices_mm - vertices_mm.min(axis=0)) / _MICRON_MM).astype(np.int64)
    places, index = np.unique(micron, axis=0, return_inverse=True)
    faces = index.ravel()[faces]
    whole = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    faces = faces[whole]
    first = np.argmin(faces, axis=1)
    faces = np.take_along_axis(faces, (first[:, None] + np.arange(3)) % 3, axis=1)
    return places * _MICRON_MM, faces[np.lexsort(faces.T[::-1])]


# The demonstrations' body: a 60-tooth GT2 timing pulley, some 40 mm across.
#
# A layer of it takes the motor's own 20-tooth pulley through a whole turn (40 mm) on each axis, so one printed layer
# shows every angle of a fault. `tools/make_demo_body.py` slices it into the file of `printmend.demo.contour`.

PITCH_MM = 2.0  # of a GT2 belt
PITCH_LINE_OFFSET_MM = 0.254  # the belt's cords run this far outside the teeth
# The GT2 groove: a root arc, two flank arcs whose centres lie on the outer circle, and rounded tooth tips.
DEPTH_MM, ROOT_RADIUS_MM = 0.75, 0.555
FLANK_RADIUS_MM, FLANK_CENTRE_MM = 1.0, 0.40
TIP_RADIUS_MM = 0.15  # of a tooth

TEETH = 60  # of the paper's pulley
BORE_MM = 5.0  # diameter
FLANGE_DIAMETER_MM, FLANGE_MM = 42.0, 1.0
TOOTHED_MM = 6.4  # for a belt of 6 mm


def timing_pulley() -> Solid:
    """Build the pulley as a closed surface: flange below, teeth above, a bore through both."""
    outline = toothed_outline_mm(TEETH)
    angle = np.arctan2(outline[:, 1], outline[:, 0])
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    bore, flange = circle * BORE_MM / 2, circle * FLANGE_DIAMETER_MM / 2
    top = FLANGE_MM + TOOTHED_MM
    # Rings around the material of the cross-section; neighbours are joined by a strip, the last to the first.
    rings = [(bore, 0.0), (flange, 0.0), (flange, FLANGE_MM), (outline, FLANGE_MM), (outline, top), (bore, top)]
    vertices = np.vstack([np.column_stack([ring, np.full(len(ring), z)]) for ring, z in rings])
    index = np.arange(len(vertices)).reshape(len(rings), -1)
    this, above = index, np.roll(index, -1, axis=0)
    next_this, next_above = np.roll(this, -1, axis=1), np.roll(above, -1, axis=1)
    faces = np.concatenate(
        [
            np.stack([this, next_this, next_above], axis=-1).reshape(-1, 3),
            np.stack([this, next_above, above], axis=-1).reshape(-1, 3),
        ]
    )
    return Solid("timing_pulley", vertices, faces)


def toothed_outline_mm(teeth: int) -> np.ndarray:
    """Return the outline [N, 2] of a GT2 pulley, counter-clockwise: one groove on the outer circle, repeated ``teeth``
    times.

    The outer radius is teeth·pitch/2π − the pitch-line offset.
    """
    radius = teeth * PITCH_MM / (2 * np.pi) - PITCH_LINE_OFFSET_MM
    groove = _half_groove_mm()
    groove = np.vstack([groove, groove[-2::-1] * [-1, 1]])  # from the left tip over the root to the right tip
    angle = groove[:, 0] / radius + 2 * np.pi * np.arange(teeth)[:, None] / teeth
    reach = np.broadcast_to(radius + groove[:, 1], angle.shape)
    return np.stack([reach * np.cos(angle), reach * np.sin(angle)], axis=-1).reshape(-1, 2)


def _half_groove_mm() -> np.ndarray:
    """Return the left half of a groove [N, 2], (along, outwards), from the tooth tip down to the root.

    The arcs are tangent: root centre (0, ROOT − DEPTH), flank centre (+FLANK_CENTRE, 0) for the left flank, and
    the tip's centre lies TIP below the outer circle at FLANK + TIP from the flank's centre.
    """
    tip_from_flank = np.sqrt((FLANK_RADIUS_MM + TIP_RADIUS_MM) ** 2 - TIP_RADIUS_MM**2)
    tip = np.array([FLANK_CENTRE_MM - tip_from_flank, -TIP_RADIUS_MM])
    flank, root = np.array([FLANK_CENTRE_MM, 0.0]), np.array([0.0, ROOT_RADIUS_MM - DEPTH_MM])
    meets_tip = np.arctan2(*(tip - flank)[::-1]) % (2 * np.pi)
    meets_root = np.arctan2(*(root - flank)[::-1]) % (2 * np.pi)
    return np.vstack(
        [
            _arc_mm(tip, TIP_RADIUS_MM, np.pi / 2, meets_tip - np.pi, 3)[:-1],
            _arc_mm(flank, FLANK_RADIUS_MM, meets_tip, meets_root, 3)[:-1],
            _arc_mm(root, ROOT_RADIUS_MM, meets_root, 1.5 * np.pi, 4),
        ]
    )


def _arc_mm(centre: np.ndarray, radius_mm: float, start: float, end: float, points: int) -> np.ndarray:
    angle = np.linspace(start, end, points)
    return centre + radius_mm * np.stack([np.cos(angle), np.sin(angle)], axis=1)
