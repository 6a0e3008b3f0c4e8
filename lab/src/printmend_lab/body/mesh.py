"""Solids from mesh files: STL, OBJ, 3MF and PLY, in mm, standing on the bed, repaired where that is safe.

A slicer closes small gaps by itself. So a solid is refused only if its slices would be garbage: it has no volume, or
its surface is open at most heights.
"""

import io
import zipfile
from pathlib import Path

import numpy as np
import trimesh

from printmend.errors import MeshError
from printmend.units import MM_PER_INCH
from printmend_lab.body.solid import MESH_SUFFIXES, Solid

UNITS_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "inch": MM_PER_INCH, "foot": 12 * MM_PER_INCH, "micron": 1e-3}

_UNIT_NAMES = {
    **{"millimeter": "mm", "millimeters": "mm", "centimeter": "cm", "centimeters": "cm", "meter": "m"},
    **{"meters": "m", "inches": "inch", "feet": "foot", "microns": "micron"},
}
_MAX_BYTES = 256 * 2**20  # of a file
_MAX_RATIO, _RATIO_MATTERS_BYTES = 200, 32 << 20  # a mesh as XML packs to a tenth
_MAX_FACES = 3_000_000  # triangles
_SMALL_MM = 10.0  # a smaller body may be in inches or metres, and the user is told so
_BRIDGED_MM = 2.0  # gaps that slicers close while they chain a contour
_MAX_OPEN = 0.75  # share of the heights at which the contour may be open
_HEIGHTS = 200  # at which a mesh is looked at for gaps
_FAR_MM = 1e5  # no printer prints a corner farther out
_THIN_MM = 1e-6  # a mesh no thicker is flat


def read_solid(path: Path, *, unit: str | None = None) -> Solid:
    """Read a mesh file; ``unit`` (a key of `UNITS_MM`) overrides the file's own, or mm where it names none.

    The orientation stays as given. Raises MeshError for what cannot be printed.
    """
    path = Path(path)
    if unit is not None and unit not in UNITS_MM:
        raise MeshError(path, wanted=f"a unit of {', '.join(UNITS_MM)}", came=repr(unit), todo="give one of them")
    mesh, file_unit = _parse(path)
    notes = []
    scale = UNITS_MM[unit or file_unit or "mm"]
    if scale != 1.0:
        notes.append(f"scaled by {scale:g} from {unit or file_unit} to mm")
    vertices, faces = np.asarray(mesh.vertices, float) * scale, np.asarray(mesh.faces, np.int64)
    _refuse_places(vertices, faces, path)
    with np.errstate(all="ignore"):  # the library divides by the areas of collapsed triangles
        mesh, repairs = _repair(trimesh.Trimesh(vertices, faces, process=False))
        _refuse_garbage(mesh, path)
    notes += repairs
    size = mesh.extents
    if unit is None and file_unit is None and size.max() < _SMALL_MM:
        extent = " × ".join(f"{edge:.3g}" for edge in size)
        notes.append(f"only {extent} mm: if the file is in inches or metres, give its unit")
    vertices = mesh.vertices - [0.0, 0.0, mesh.bounds[0, 2]]
    return Solid(path.stem, vertices, mesh.faces, tuple(notes))


def _parse(path: Path) -> tuple[trimesh.Trimesh, str | None]:
    """Return the file's triangles and the unit it names; every fault of the file becomes a MeshError."""
    suffix = path.suffix.lower()
    if suffix not in MESH_SUFFIXES or not path.is_file():
        raise MeshError(
            path, wanted=f"a mesh file ({', '.join(MESH_SUFFIXES)})",
            came="another kind" if path.exists() else "no file", todo="check the name, or export the body as STL",
        )  # fmt: skip
    if path.stat().st_size > _MAX_BYTES:
        raise MeshError(path, wanted="at most 256 MiB", came=f"{path.stat().st_size} bytes", todo="decimate it")
    data = path.read_bytes()
    try:
        if suffix == ".3mf":
            _refuse_zip_bomb(data)
        scene = trimesh.load_scene(io.BytesIO(data), file_type=suffix[1:], process=False)
        unit, mesh = scene.units, scene.to_mesh()
        faces = len(mesh.faces)
    except Exception as error:
        # Parsers of five formats read arbitrary bytes here: whatever they raise, the file is at fault.
        reason = "" if isinstance(error, ImportError) or not str(error) else f" ({error})"[:160]
        raise MeshError(
            path, wanted=f"an intact {suffix} mesh", came=f"a broken file{reason}", todo="export the mesh again"
        ) from error  # fmt: skip
    if not 0 < faces <= _MAX_FACES:
        came = f"{faces} triangles" if faces else "none"
        raise MeshError(
            path, wanted=f"a mesh of 1 to {_MAX_FACES} triangles", came=came, todo="export it again, decimated"
        )
    unit = _UNIT_NAMES.get(unit, unit)
    return mesh, unit if unit in UNITS_MM else None


def _refuse_zip_bomb(data: bytes) -> None:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        size = sum(entry.file_size for entry in archive.infolist())
    if size > 4 * _MAX_BYTES or size > max(_RATIO_MATTERS_BYTES, _MAX_RATIO * len(data)):
        raise ValueError(f"would unpack to {size >> 20} MiB")


def _refuse_places(vertices_mm: np.ndarray, faces: np.ndarray, path: Path) -> None:
    """Raise MeshError for triangles at NaN or infinite places, and for a mesh that is flat along an axis."""
    if not ((faces >= 0) & (faces < len(vertices_mm))).all():
        raise MeshError(path, wanted="corners that exist", came="numbers beyond them", todo="export the mesh again")
    corners = vertices_mm[faces.ravel()]
    if not np.isfinite(corners).all():
        raise MeshError(path, wanted="finite coordinates", came="NaN or infinity", todo="export the mesh again")
    if np.abs(corners).max() > _FAR_MM:
        raise MeshError(path, wanted="coordinates below 100 m", came="places beyond", todo="check the file's unit")
    if np.ptp(corners, axis=0).min() < _THIN_MM:
        raise MeshError(path, wanted="a solid", came="a surface without volume", todo="give the body a thickness")


def _repair(mesh: trimesh.Trimesh) -> tuple[trimesh.Trimesh, list[str]]:
    """Merge, cancel coincident faces, fill holes of three or four edges, orient; say what changed."""
    notes = []
    mesh.merge_vertices(merge_tex=True, merge_norm=True, digits_vertex=5)
    kept = _distinct_faces(mesh.faces)
    if len(kept) < len(mesh.faces):
        notes.append(f"removed {len(mesh.faces) - len(kept)} repeated or collapsed triangles")
        mesh.update_faces(kept)
    if len(mesh.faces) and len(_open_edges(mesh)):
        before = len(mesh.faces)
        mesh.fill_holes()
        if len(mesh.faces) > before:
            notes.append(f"filled small holes with {len(mesh.faces) - before} triangles")
    if len(mesh.faces):
        before_volume, wound = mesh.volume, mesh.is_winding_consistent
        mesh.fix_normals(multibody=True)
        if not wound or (before_volume < 0 < mesh.volume):
            notes.append("turned triangles that faced inwards")
    mesh.remove_unreferenced_vertices()
    return mesh, notes


def _distinct_faces(faces: np.ndarray) -> np.ndarray:
    """Return the indices of the faces to keep: coincident faces cancel in pairs that face each other, or one stays."""
    low, middle, high = np.sort(faces, axis=1).T
    a, b, c = faces.T
    # An even permutation of (low, middle, high) faces one way, an odd one the other.
    even = ((a == low) & (b == middle)) | ((b == low) & (c == middle)) | ((c == low) & (a == middle))
    sign = np.where(even, 1, -1) * ((low < middle) & (middle < high))
    _, group = np.unique(np.stack([low, middle, high], axis=1), axis=0, return_inverse=True)
    group = group.ravel()
    net = np.sign(np.bincount(group, weights=sign))
    candidates = np.flatnonzero(sign * net[group] > 0)
    _, first = np.unique(group[candidates], return_index=True)
    return np.sort(candidates[first])


def _open_edges(mesh: trimesh.Trimesh) -> np.ndarray:
    """Return the edges [N, 2] of an odd number of faces: there the contour of a slice has a loose end."""
    edges, count = np.unique(mesh.edges_sorted, axis=0, return_counts=True)
    return edges[count % 2 == 1]


def _refuse_garbage(mesh: trimesh.Trimesh, path: Path) -> None:
    if not len(mesh.faces):
        raise MeshError(path, wanted="a solid", came="a surface without volume", todo="give the body a thickness")
    share = _open_share(mesh)
    if share > _MAX_OPEN:
        raise MeshError(
            path, wanted="a closed surface", came=f"one that is open at {share:.0%} of its heights",
            todo="close it or remove its inner walls in the program that made it",
        )  # fmt: skip


def _open_share(mesh: trimesh.Trimesh) -> float:
    """Return the share of heights at which a horizontal slice has loose ends too far apart to be bridged."""
    edges = _open_edges(mesh)
    if not len(edges):
        return 0.0
    start, end = mesh.vertices[edges[:, 0]], mesh.vertices[edges[:, 1]]
    low, high = np.minimum(start[:, 2], end[:, 2]), np.maximum(start[:, 2], end[:, 2])
    z_low, z_high = mesh.bounds[:, 2]
    heights = z_low + (np.arange(_HEIGHTS) + 0.5) / _HEIGHTS * (z_high - z_low)
    is_open = 0
    for height in heights:
        crossing = np.flatnonzero((low < height) & (height <= high))[:1000]
        along = ((height - start[crossing, 2]) / (end[crossing, 2] - start[crossing, 2]))[:, None]
        loose = (start[crossing] + along * (end[crossing] - start[crossing]))[:, :2]
        gap = np.linalg.norm(loose[:, None] - loose[None], axis=2) + np.diag(np.full(len(loose), np.inf))
        is_open += bool(len(loose) and gap.min(axis=1).max() > _BRIDGED_MM)
    return is_open / _HEIGHTS
