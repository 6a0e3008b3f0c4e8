"""Thingi10K as a source: by its library (a stand-in here: its hub is elsewhere), or from a folder of its files."""

import json
import os
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from printmend.errors import InputError, MeshError
from printmend_lab.body.mesh import read_solid
from printmend_lab.dataset import bodies as thingi10k
from printmend_lab.dataset.bodies import body_files, licence_beside
from printmend_lab.dataset.build import Recipe, build_dataset
from printmend_lab.dataset.parquet import read_lines
from printmend_lab.executor import Serial
from tests.bodies import write_vase

ATTRIBUTION, PUBLIC = "Creative Commons - Attribution", "Public Domain"


@pytest.fixture
def hub(tmp_path: Path) -> Path:
    """A folder of its files as the library keeps them."""
    folder = tmp_path / "hub"
    folder.mkdir()
    for number, edge in ((900, 20.0), (72, 12.0), (431, 15.0)):
        box = trimesh.creation.box((edge, edge, 5.0))
        np.savez(folder / f"{number}.npz", vertices=box.vertices, facets=box.faces.astype(np.int32))
    return folder


def library(hub: Path, asked: list) -> SimpleNamespace:
    said = {path: PUBLIC if path.stem == "431" else ATTRIBUTION for path in hub.glob("*.npz")}
    rows = [{"file_id": int(path.stem), "file_path": str(path), "license": text} for path, text in said.items()]

    def dataset(license):
        asked.append(license)
        return [row for row in rows if license is None or row["license"] == license.replace("\\", "")]

    return SimpleNamespace(init=lambda variant: asked.append(variant), dataset=dataset)


def test_the_library_serves_by_number_and_licence(hub: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list = []
    monkeypatch.setitem(sys.modules, "thingi10k", library(hub, asked))
    files = body_files(["thingi10k"], made=tmp_path / "made")
    assert [path.name for path in files] == ["72.stl", "431.stl", "900.stl"]
    assert read_solid(files[1]).size_mm == pytest.approx([15.0, 15.0, 5.0])
    assert [licence_beside(path) for path in files] == [ATTRIBUTION, PUBLIC, ATTRIBUTION]
    assert body_files(["thingi10k:1"], made=tmp_path / "made") == files[:1]
    only = body_files(["thingi10k"], made=tmp_path / "only", licence=ATTRIBUTION)
    assert [path.stem for path in only] == ["72", "900"]
    assert asked[0] == "npz"
    with pytest.raises(InputError, match="bodies under “GPL”"):
        body_files(["thingi10k"], made=tmp_path / "made", licence="GPL")
    with pytest.raises(InputError, match="expected thingi10k or thingi10k:N"):
        body_files(["thingi10k:few"], made=tmp_path / "made")

    def absent(variant):
        raise RuntimeError("Failed to initialize dataset: no route to host")

    monkeypatch.setitem(sys.modules, "thingi10k", SimpleNamespace(init=absent))
    with pytest.raises(InputError, match="no route to host; name a folder of its files"):
        body_files(["thingi10k"], made=tmp_path / "made")


def test_a_folder_of_its_files_serves_without_a_network(hub: Path, tmp_path: Path) -> None:
    (hub / "licences.json").write_text(json.dumps({"72": PUBLIC, "431": ATTRIBUTION}))
    files = body_files([hub], made=tmp_path / "made")
    assert [path.name for path in files] == ["431.stl", "72.stl", "900.stl"]
    assert [licence_beside(path) for path in files] == [ATTRIBUTION, PUBLIC, None]
    some = body_files([hub], made=tmp_path / "made", licence="attribution")
    assert [path.stem for path in some] == ["431", "900"]  # nothing is known of the last: it is taken as asked
    np.savez(hub / "5.npz", vertices=np.zeros((3, 2)), facets=np.zeros((1, 3), int))
    with pytest.raises(MeshError, match=r"vertices \(3, 2\)"):
        body_files([hub], made=tmp_path / "made")
    np.savez_compressed(hub / "5.npz", vertices=np.arange(300.0).reshape(100, 3), facets=np.zeros((1, 3), int))
    damaged = bytearray((hub / "5.npz").read_bytes())
    damaged[60:90] = b"\xff" * 30
    (hub / "5.npz").write_bytes(damaged)
    with pytest.raises(MeshError, match="fetch it again"):
        body_files([hub], made=tmp_path / "made")
    (tmp_path / "alone").mkdir()
    (tmp_path / "alone" / "5.npz").write_bytes(damaged)
    with pytest.raises(InputError, match=r"found 1 damaged: .*fetch it again"):
        body_files([tmp_path / "alone"], made=tmp_path / "made", left_out=lambda path, why: None)
    unread: dict[Path, str] = {}
    assert len(body_files([hub], made=tmp_path / "made", left_out=unread.__setitem__)) == 3
    for _ in range(2):  # noted once, however often a build goes on
        built = build_dataset(tmp_path / "set", [], Recipe(1, ("play",), "damaged", 1), Serial(), unread=unread)
    assert [(body, "fetch it again" in why) for body, why in built.failures] == [("5", True)]


def test_licences_noted_at_once_are_all_kept(tmp_path: Path) -> None:
    for name in ("a", "b", "c"):
        thingi10k._note(tmp_path, {name: PUBLIC})
        os.utime(tmp_path / "licences.json", ns=(1, 1))  # as a coarse clock would have it
        assert licence_beside(tmp_path / f"{name}.stl") == PUBLIC
    assert licence_beside(tmp_path / "a.stl") == PUBLIC


def test_each_bodys_own_licence_is_noted(tmp_path: Path) -> None:
    files = [write_vase(tmp_path / f"{name}.gcode", layers=5, radius_mm=size) for name, size in (("a", 9), ("b", 10))]
    (tmp_path / "licences.json").write_text(json.dumps({"a": PUBLIC}))
    build_dataset(tmp_path / "set", files, Recipe(1, ("play",), "damaged", 1), Serial(), licence="CC0-1.0")
    assert [line["licence"] for line in read_lines(tmp_path / "set" / "bodies.jsonl")] == [PUBLIC, "CC0-1.0"]
    (tmp_path / "licences.json").write_text("[1]")
    with pytest.raises(InputError, match="licences by name"):
        licence_beside(files[0])
