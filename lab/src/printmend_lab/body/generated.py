"""Bodies that are made here: a seed and a number give the same solid for ever, and nobody else's licence applies.

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
