"""A solid body in mm, standing on the bed: what mesh files give and the slicer takes."""

from dataclasses import dataclass

import numpy as np

from printmend.errors import MeshError
from printmend.path import frozen
from printmend.printer import Printer

MESH_SUFFIXES = (".stl", ".obj", ".3mf", ".ply")


@dataclass(frozen=True, eq=False)
class Solid:
    """A closed surface: ``vertices_mm`` [V, 3], the lowest at z = 0, and ``faces`` [F, 3], counter-clockwise from
    outside.

    ``notes`` say how the file's own surface was changed.
    """

    name: str
    vertices_mm: np.ndarray
    faces: np.ndarray
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "vertices_mm", frozen(np.asarray(self.vertices_mm, float)))
        object.__setattr__(self, "faces", frozen(np.asarray(self.faces, np.int64)))

    @property
    def size_mm(self) -> np.ndarray:
        """The edges of the bounding box [3]."""
        return np.ptp(self.vertices_mm, axis=0)


def refuse_oversize(solid: Solid, printer: Printer) -> None:
    """Raise MeshError where the body does not fit the printer as it stands."""
    room = np.array([axis.length_mm for axis in printer.axes])
    if (solid.size_mm <= room + 1e-6).all():
        return
    turned = (np.sort(solid.size_mm) <= np.sort(room)).all()
    raise MeshError(
        solid.name,
        wanted=f"a body of {' × '.join(f'{edge:g}' for edge in room)} mm at most ({printer.name})",
        came=" × ".join(f"{edge:.1f}" for edge in solid.size_mm) + " mm",
        todo="turn it on another side" if turned else "scale or split it, or give a larger printer",
    )


def stl_bytes(solid: Solid) -> bytes:
    """Return the solid as binary STL."""
    corners = solid.vertices_mm[solid.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    rows = np.zeros(len(corners), [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    rows["normal"] = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0)
    rows["corners"] = corners
    return b"printmend".ljust(80, b" ") + np.uint32(len(rows)).tobytes() + rows.tobytes()
