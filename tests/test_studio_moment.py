"""The part that one plays with, the small picture of a part, and what a studio keeps on the disk."""

import itertools
import math
import xml.etree.ElementTree as ElementTree
from concurrent.futures import Future
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from starlette.testclient import TestClient

from printmend.corruption import Corruption, Drive, EccentricBore, Play
from printmend.gcode.read import read_gcode
from printmend.mend import mend_gcode
from printmend.model import exact_model
from printmend.printer import preset_names, read_printer
from printmend.studio import jobs as studio_jobs
from printmend.studio import play as plate
from printmend.studio import scene as studio_scene
from printmend.studio.app import create_app
from printmend.studio.jobs import Jobs
from printmend.studio.places import Places
from printmend.studio.play import Faults, Side, play_layer, preview
from printmend.studio.scene import Scene, Tap, as_mended, as_printed, read_drawing, write_photo, write_thumb
from printmend.studio.store import Store
from printmend.studio.work import THUMB
from tests.mending import coarsely

HERE = "http://127.0.0.1:8765"


def test_the_plate_has_round_holes_a_word_and_a_straight_wall() -> None:
    layers = plate.layers()
    assert len(layers) == plate.PLATE_LAYERS + plate.WALL_LAYERS
    outlines = [places for places, _, fills in layers[0] if not fills]
    for x, y, radius in plate.HOLES_MM:
        near = [math.dist((x, y), places[0]) for places in outlines]
        ring = outlines[int(np.argmin(np.abs(np.array(near) - radius - plate.BEAD_MM / 2)))]
        np.testing.assert_allclose(np.hypot(*(ring - (x, y)).T), radius + plate.BEAD_MM / 2, atol=0.03)
        assert (ring[0] == ring[-1]).all()
    fill = np.concatenate([places for places, _, fills in layers[0] if fills])
    for x, y, radius in plate.HOLES_MM:
        assert np.hypot(*(fill - (x, y)).T).min() > radius + 1.5 * plate.BEAD_MM
    (wall,) = (places for places, _, _ in layers[-1])
    assert wall.shape == (2, 2)
    assert set(plate.WORD) == set(plate._LETTERS)


@pytest.mark.parametrize("name", ["ender3", "prusa-mini", "trident-250"])
def test_the_plates_file_prints_its_strokes_in_the_middle_of_the_bed(name: str) -> None:
    printer = read_printer(name)
    moves = read_gcode(plate.plate_gcode(printer), printer=printer).moves
    drawn = moves.extruding
    strokes = [pair for layer in plate.layers() for places, _, _ in layer for pair in itertools.pairwise(places)]
    assert drawn.sum() == len(strokes)
    wanted = np.array([end for _, end in strokes]) + printer.middle_mm
    np.testing.assert_allclose(moves.end_mm[drawn, :2], wanted, atol=0.0011)
    assert set(np.unique(moves.layer[drawn])) == set(range(len(plate.layers())))


def test_every_printer_that_the_program_knows_has_room_for_the_plate() -> None:
    small = [name for name in preset_names() if min(read_printer(name).x.length_mm - plate.SIZE_MM[0],
             read_printer(name).y.length_mm - plate.SIZE_MM[1]) < 0]  # fmt: skip
    assert small == []


def test_a_slider_shows_the_plates_own_error_and_no_line_that_fills() -> None:
    places, joined = play_layer()
    assert len(places) == len(joined)
    healthy = preview(Faults())
    assert healthy["part_rms_mm"] < 0.01  # whole steps
    np.testing.assert_allclose(healthy["part_mm"], places, atol=0.001)
    assert preview(Faults(x=Side("eccentric", 0.9, 40.0)))["part_rms_mm"] > 0.2


def _scene(points: np.ndarray, layer: np.ndarray, joined: np.ndarray) -> Scene:
    none = np.zeros((len(points), 2))
    return Scene(points, none, none[:, 0], None, None, joined, none[:, 0], none[:, 0], layer, 1)


def test_a_small_picture_shows_the_widest_layer_within_its_box(tmp_path: Path) -> None:
    turn = np.linspace(0, 2 * np.pi, 9000)
    circle = np.column_stack([100 + 30 * np.cos(turn), 80 + 20 * np.sin(turn), np.full(9000, 0.2)])
    points = np.concatenate([circle, circle[:10] + np.array([0, 0, 0.2])])
    joined = np.ones(len(points), bool)
    joined[[8999, 9009]] = False
    layer = np.repeat([0, 1], [9000, 10])
    write_thumb(tmp_path / "a.svg", _scene(points, layer, joined))
    root = ElementTree.parse(tmp_path / "a.svg").getroot()  # noqa: S314 - our own
    x, y, wide, high = map(float, root.get("viewBox", "").split())
    path = root[0].get("d", "")
    assert path.count("M") == 1
    assert path.count("L") < 3500
    corners = np.array([point.split() for point in path.replace("M", "L").split("L")[1:]], float)
    assert (corners >= [x, y]).all()
    assert (corners <= [x + wide, y + high]).all()
    np.testing.assert_allclose(np.ptp(corners, axis=0), [60, 40], atol=0.3)
    write_thumb(tmp_path / "b.svg", _scene(points[:0], layer[:0], joined[:0]))
    assert not (tmp_path / "b.svg").exists()


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(Jobs, "warm", lambda jobs: None)
    return tmp_path / "studio"


def _ended(store: Store, kind: str, params: dict, size: int, *pictures: str) -> str:
    """Note a job that has ended, with a file of that size; it offers the file and ``pictures``."""
    key = store.add_job(kind, None, params)
    (store.path("job", key)).mkdir()
    (store.path("job", key) / "made.bin").write_bytes(bytes(size))
    for name in pictures:
        (store.path("job", key) / name).write_text("picture")
    store.end_job(key, "done", result={"files": ["made.bin", *pictures]})
    return key


def _failed(store: Store) -> None:
    """Note a job that failed after it drew a picture, which it does not offer."""
    key = store.add_job("measure", None, {})
    (store.path("job", key)).mkdir()
    (store.path("job", key) / THUMB).write_text("picture")
    store.end_job(key, "failed", error="no marks")


def test_a_photo_is_shown_small_and_upright_and_no_other_file(tmp_path: Path) -> None:
    photo, small = Image.new("RGB", (1200, 800), "red"), tmp_path / "small.jpg"
    (exif := Image.Exif())[274] = 6  # taken with the camera turned
    photo.save(tmp_path / "photo.jpg", exif=exif)
    assert write_photo(small, tmp_path / "photo.jpg")
    with Image.open(small) as seen:
        assert seen.height == 320 > seen.width > 200
    small.unlink()
    (tmp_path / "table.csv").write_text("x_mm,y_mm\n1,2\n")
    (tmp_path / "cut.jpg").write_bytes((tmp_path / "photo.jpg").read_bytes()[:600])
    assert not any(write_photo(small, tmp_path / name) for name in ("table.csv", "cut.jpg"))
    assert not list(tmp_path.glob("small*"))


def test_what_is_freed_is_gone_and_all_else_stays(folder: Path) -> None:
    folder.mkdir()
    store = Store(Places.below(folder))
    given, spare = "0" * 16, "1" * 16
    for key, size in ((given, 700), (spare, 300)):
        store.path("upload", key).write_bytes(bytes(size))
        store.add_upload(key, "a.gcode", size)
    mended = _ended(store, "mend", {"upload": given}, 4993, THUMB)
    _failed(store)
    played, learned = _ended(store, "play", {}, 2000), _ended(store, "learn", {}, 1000)
    store.close()
    with TestClient(create_app(Places.below(folder), workers=1), base_url=HERE) as client:

        def kept() -> dict[str, tuple[int, int]]:
            found = client.get("/api/v1/storage").json()
            return {one["part"]: (one["count"], one["bytes"]) for one in found["parts"]}

        assert kept() == {"mended": (1, 5000), "play": (1, 2000), "measured": (1, 7), "unused": (1, 300)}
        shown = {one["part"]: one["shown"] for one in client.get("/api/v1/storage").json()["parts"]}
        assert shown == {"mended": [f"/api/v1/jobs/{mended}/files/{THUMB}"], "play": [], "measured": [], "unused": []}
        assert client.get(shown["mended"][0]).text == "picture"
        assert client.delete("/api/v1/storage/measured").status_code == 200
        assert client.delete("/api/v1/storage/mended").status_code == 200
        assert kept() == {"mended": (0, 0), "play": (1, 2000), "measured": (0, 0), "unused": (1, 300)}
        assert [path.name for path in (folder / "uploads").iterdir()] == [spare]  # the mended file's own went with it
        client.delete("/api/v1/storage/unused")
        assert not list((folder / "uploads").iterdir())
        assert sorted(one["id"] for one in client.get("/api/v1/jobs").json()) == sorted([played, learned])
        assert not (folder / "jobs" / mended).exists()
        assert client.delete("/api/v1/storage/printers").status_code == 422


def test_a_studio_holds_no_more_than_it_may(folder: Path) -> None:
    with TestClient(create_app(Places.below(folder), workers=1, most_held_bytes=1_000_000), base_url=HERE) as client:
        assert client.post("/api/v1/uploads?name=a.gcode", content=bytes(500_000)).status_code == 201
        refused = client.post("/api/v1/uploads?name=b.gcode", content=bytes(800_000))
        assert refused.status_code == 400
        assert refused.json()["error"] == ("the studio: expected at most 0.001 GB in its folder, found 0.0 GB; "
                                           "free some of it under Storage")  # fmt: skip
        assert len(list((folder / "uploads").iterdir())) == 1


def test_of_a_large_part_every_nth_layer_is_read_and_lies_where_it_would(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    printer = read_printer("ender3")
    path = tmp_path / "plate.gcode"
    path.write_bytes(plate.plate_gcode(printer))
    bent = Corruption((Drive(pulley=EccentricBore(0.5, 1.0), belt=Play(0.2)), Drive(belt=Play(0.1))))
    model = exact_model(coarsely(bent, printer))
    scenes = []
    for small_bytes in (10**9, 0):  # once all of it is read, and once every fifth layer
        monkeypatch.setattr(studio_scene, "_SMALL_BYTES", small_bytes)
        drawing = read_drawing(path, printer, most=5000)
        tap = Tap(drawing.motion.there)
        mend_gcode(path, model, tmp_path / "mended.gcode", watch=tap.watch)
        scenes.append(as_mended(as_printed(drawing, model.mechanism), drawing, model.mechanism, tap))
    whole, some = scenes
    assert drawing.motion.every == 5
    assert whole.every > 1
    assert some.every % 5 == 0
    shared = {*whole.layer.tolist()} & {*some.layer.tolist()}
    assert shared
    for error in ("raw_error_mm", "mended_error_mm"):
        means = [[getattr(one, error)[one.layer == layer].mean() for layer in sorted(shared)] for one in scenes]
        assert means[1] == pytest.approx(means[0], rel=0.03, abs=0.0002)  # points lie at other places of a line
    assert some.raw_error_mm.max() == pytest.approx(whole.raw_error_mm.max(), rel=0.1)
    np.testing.assert_allclose(np.unique(some.height_mm), plate.LAYER_MM)


def test_workers_rest_where_no_job_runs_and_the_next_job_has_new_ones(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = []

    class Pool(studio_jobs.ProcessPool):
        def __init__(self, *given: object, **named: object) -> None:
            made.append(self)
            self.asked, self.stopped = [], False

        def schedule(self, function: object, args: tuple = (), timeout: float | None = None) -> Future:
            self.asked.append(Future())
            return self.asked[-1]

        def stop(self) -> None:
            self.stopped = True

        def join(self) -> None:
            pass

    monkeypatch.setattr(studio_jobs, "ProcessPool", Pool)
    (tmp_path / "studio").mkdir()
    jobs = Jobs(store := Store(Places.below(tmp_path / "studio")), workers=1)
    key = jobs.submit("play", None, {})
    jobs.rest()
    assert len(made) == 1  # a job runs
    made[0].asked[-1].set_result({"files": []})
    assert store.job(key)["state"] == "done"
    jobs.rest()
    assert [one.stopped for one in made] == [True, False]
    jobs.submit("play", None, {})
    assert len(made[1].asked) == 1
    jobs.close()
    store.close()
