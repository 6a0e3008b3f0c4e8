"""Meshes: units, repair, refusals; and the shipped pulley as a solid."""

import warnings
import zipfile
from pathlib import Path

import numpy as np
import pytest

from printmend.errors import MeshError
from printmend.printer import Printer
from printmend_lab.body.generated import (
    FLANGE_DIAMETER_MM,
    FLANGE_MM,
    TEETH,
    TOOTHED_MM,
    timing_pulley,
    toothed_outline_mm,
)
from printmend_lab.body.mesh import read_solid
from printmend_lab.body.solid import Solid, refuse_oversize, stl_bytes

CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
CUBE = np.array(
    [
        *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
        *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
    ]
)


def cube(edge_mm: float = 20.0, faces: np.ndarray = CUBE) -> Solid:
    return Solid("cube", CORNERS * edge_mm, faces)


def write_stl(folder: Path, solid: Solid, name: str = "body.stl") -> Path:
    path = folder / name
    path.write_bytes(stl_bytes(solid))
    return path


def volume_mm3(solid: Solid) -> float:
    a, b, c = np.moveaxis(solid.vertices_mm[solid.faces], 1, 0)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def obj_text(vertices: np.ndarray, faces: np.ndarray) -> str:
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in vertices] + [f"f {a} {b} {c}" for a, b, c in faces + 1]
    return "\n".join(lines) + "\n"


def write_3mf(path: Path, unit: str = "millimeter", x: str = "1", extra: str = "") -> Path:
    corners = ((x, 0, 0), (0, 0, 0), (0, 1, 0), (0, 0, 1))
    vertices = "".join(f'<vertex x="{a}" y="{b}" z="{c}"/>' for a, b, c in corners)
    faces = ((0, 1, 2), (0, 3, 1), (0, 2, 3), (1, 3, 2))
    triangles = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in faces)
    mesh = f"<mesh><vertices>{vertices}</vertices><triangles>{triangles}</triangles></mesh>"
    model = (
        f'<?xml version="1.0"?><model unit="{unit}" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">'
        f'<resources><object id="1" type="model">{mesh}</object>{extra}</resources>'
        f'<build><item objectid="1"/></build></model>'
    )
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("3D/3dmodel.model", model)
    return path


def test_stl_survives_a_round_trip(tmp_path: Path) -> None:
    solid = read_solid(write_stl(tmp_path, cube()))
    assert solid.size_mm == pytest.approx([20, 20, 20])
    assert volume_mm3(solid) == pytest.approx(8000)
    assert solid.notes == ()


def test_a_body_is_put_on_the_bed_and_not_turned(tmp_path: Path) -> None:
    lifted = Solid("up", CORNERS * [10, 20, 30] + [5, -7, -40], CUBE)
    solid = read_solid(write_stl(tmp_path, lifted))
    assert solid.vertices_mm[:, 2].min() == 0
    assert solid.size_mm == pytest.approx([10, 20, 30])


def test_faces_turned_inwards_are_turned_back(tmp_path: Path) -> None:
    solid = read_solid(write_stl(tmp_path, cube(faces=CUBE[:, ::-1])))
    assert volume_mm3(solid) == pytest.approx(8000)
    assert solid.notes == ("turned triangles that faced inwards",)


def test_a_missing_face_is_filled(tmp_path: Path) -> None:
    solid = read_solid(write_stl(tmp_path, cube(faces=CUBE[2:])))
    assert volume_mm3(solid) == pytest.approx(8000)
    assert any("filled small holes" in note for note in solid.notes)


def test_faces_given_three_times_count_once(tmp_path: Path) -> None:
    solid = read_solid(write_stl(tmp_path, cube(faces=np.tile(CUBE, (3, 1)))))
    assert len(solid.faces) == 12
    assert volume_mm3(solid) == pytest.approx(8000)


def test_a_folded_fin_is_removed(tmp_path: Path) -> None:
    vertices = np.vstack([CORNERS * 20, [[40, 40, 40]]])
    fin = np.array([[6, 7, 8], [7, 6, 8]])
    path = tmp_path / "fin.obj"
    path.write_text(obj_text(vertices, np.vstack([CUBE, fin])))
    assert read_solid(path).size_mm == pytest.approx([20, 20, 20])


@pytest.mark.parametrize(
    ("unit", "edge_mm"), [("millimeter", 1.0), ("inch", 25.4), ("meter", 1000.0), ("foot", 304.8), ("micron", 1e-3)]
)
def test_3mf_units(tmp_path: Path, unit: str, edge_mm: float) -> None:
    solid = read_solid(write_3mf(tmp_path / "a.3mf", unit))
    assert solid.size_mm == pytest.approx([edge_mm] * 3)
    assert (unit == "millimeter") == (not any("scaled" in note for note in solid.notes)), "never scaled silently"


def test_a_tiny_body_is_named_and_not_scaled(tmp_path: Path) -> None:
    path = write_stl(tmp_path, cube(2.0))
    small = read_solid(path)
    assert small.size_mm == pytest.approx([2, 2, 2])
    assert "inches" in small.notes[0]
    assert read_solid(path, unit="inch").size_mm == pytest.approx([50.8] * 3)


def test_oversize_says_what_fits(ender5: Printer) -> None:
    refuse_oversize(cube(220), ender5)
    with pytest.raises(MeshError, match=r"220 × 220 × 300 mm.*230\.0 × 10\.0 × 5\.0 mm; turn it"):
        refuse_oversize(Solid("bar", CORNERS * [230, 10, 5], CUBE), ender5)
    with pytest.raises(MeshError, match="scale or split"):
        refuse_oversize(cube(301), ender5)


def tetrahedron_with(places: list[str]) -> bytes:
    corners = "\n".join(f"v {place}" for place in places)
    return f"{corners}\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n".encode()


PLACES = ["0 0 0", "9 0 0", "0 9 0", "0 0 9"]
BROKEN = {
    "empty.stl": b"",
    "text.stl": b"hello world\n" * 100,
    "lying count.stl": b" " * 80 + b"\xff\xff\xff\xff" + bytes(500),
    "truncated.stl": stl_bytes(cube())[:-70],
    "all ones.stl": b" " * 80 + b"\x04\0\0\0" + b"\xff" * 200,
    "binary.obj": bytes(range(256)) * 40,
    "no faces.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\n",
    "bad index.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n",
    "nan.obj": tetrahedron_with(["nan 0 0", *PLACES[1:]]),
    "infinite.obj": tetrahedron_with(["inf 0 0", *PLACES[1:]]),
    "far.obj": tetrahedron_with(["1e300 0 0", *PLACES[1:]]),
    "flat.obj": tetrahedron_with([*PLACES[:3], "9 9 0"]),
    "sheet.obj": b"v 0 0 0\nv 30 0 30\nv 0 30 20\nf 1 2 3\n",
    "doubled sheet.obj": b"v 0 0 0\nv 30 0 30\nv 0 30 20\nf 1 2 3\nf 1 3 2\n",
    "inner wall.obj": obj_text(CORNERS * 20, np.vstack([CUBE, [[0, 1, 7], [0, 7, 6]]])).encode(),
    "not a zip.3mf": b"PK rubbish",
    "wrong.ply": b"ply\nformat ascii 1.0\nelement vertex 99999999999\nproperty float x\nend_header\n",
    "long.ply": b"ply\nformat binary_little_endian 1.0\nelement vertex 99999999999\n"
    b"property float x\nproperty float y\nproperty float z\nend_header\n",
    "step.step": b"ISO-10303-21;",
}  # fmt: skip


@pytest.mark.parametrize("name", BROKEN)
def test_broken_meshes_are_refused_in_one_line(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(BROKEN[name])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(MeshError, match=r"expected .*, found .*; ") as caught:
            read_solid(path)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 500


def test_hostile_3mf(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    loop = '<object id="2"><components><component objectid="2"/></components></object>'
    assert len(read_solid(write_3mf(tmp_path / "loop.3mf", extra=loop)).faces) == 4
    with pytest.raises(MeshError, match="finite"):
        read_solid(write_3mf(tmp_path / "nan.3mf", x="nan"))
    monkeypatch.setattr("printmend_lab.body.mesh._MAX_BYTES", 2**18)
    bomb = tmp_path / "bomb.3mf"
    with zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("3D/3dmodel.model", bytes(2**21))
    with pytest.raises(MeshError, match="would unpack"):
        read_solid(bomb)


def test_missing_file_and_unknown_unit(tmp_path: Path) -> None:
    with pytest.raises(MeshError, match="no file"):
        read_solid(tmp_path / "nothing.stl")
    with pytest.raises(MeshError, match="furlong"):
        read_solid(write_stl(tmp_path, cube()), unit="furlong")


def test_every_prefix_of_a_mesh_is_read_or_refused(tmp_path: Path) -> None:
    """A file cut anywhere must never end in a traceback."""
    whole = {"a.stl": stl_bytes(cube()), "a.obj": obj_text(CORNERS * 20, CUBE).encode()}
    whole["a.3mf"] = write_3mf(tmp_path / "whole.3mf").read_bytes()
    refused = 0
    for name, data in whole.items():
        for size in range(0, len(data), max(1, len(data) // 25)):
            path = tmp_path / name
            path.write_bytes(data[:size])
            try:
                read_solid(path)
            except MeshError:
                refused += 1
    assert refused > 50


def test_the_pulley_is_closed_and_has_the_size_of_a_gt2_pulley() -> None:
    solid = timing_pulley()
    edges = np.concatenate([solid.faces[:, [0, 1]], solid.faces[:, [1, 2]], solid.faces[:, [2, 0]]])
    keys = edges[:, 0] * len(solid.vertices_mm) + edges[:, 1]
    back = edges[:, 1] * len(solid.vertices_mm) + edges[:, 0]
    assert len(np.unique(keys)) == len(keys), "each edge is used once in each direction"
    assert np.array_equal(np.sort(keys), np.sort(back))
    assert solid.size_mm == pytest.approx([FLANGE_DIAMETER_MM, FLANGE_DIAMETER_MM, FLANGE_MM + TOOTHED_MM], abs=0.01)
    full_mm3 = np.pi / 4 * (42.0**2 * 1.0 + 37.69**2 * 6.4 - 5.0**2 * 7.4)
    grooves_mm3 = TEETH * 6.4 * 0.75 * 1.0  # a groove is about 1 mm wide in the middle
    assert volume_mm3(solid) == pytest.approx(full_mm3 - grooves_mm3, rel=0.02)


def test_the_pulleys_outline_is_the_published_gt2_profile() -> None:
    outline = toothed_outline_mm(TEETH)
    radius = np.linalg.norm(outline, axis=1)
    outer = 60 * 2 / (2 * np.pi) - 0.254
    assert radius.max() == pytest.approx(outer, abs=1e-9)
    assert radius.min() == pytest.approx(outer - 0.75, abs=1e-9)
    angle = np.unwrap(np.arctan2(outline[:, 1], outline[:, 0]))
    assert (np.diff(angle) > 0).all(), "counter-clockwise, star-shaped"
    turned = outline @ np.array([[np.cos(a := 2 * np.pi / 60), np.sin(a)], [-np.sin(a), np.cos(a)]])
    assert turned == pytest.approx(np.roll(outline, -len(outline) // 60, axis=0), abs=1e-9)
