"""The studio: who may come in, what stays where, what a page may load, and that its pictures show what is predicted."""

import ast
import gzip
import hashlib
import importlib
import inspect
import json
import re
import sqlite3
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest
import uvicorn
from starlette.testclient import TestClient

from printmend import diagnosis
from printmend.client import Studio, StudioError
from printmend.corruption import Corruption, Drive, EccentricBore, Play, Screw
from printmend.diagnosis.advice import advise, advised
from printmend.diagnosis.named import misfits_of, unseen
from printmend.effects import EFFECTS, Of
from printmend.effects.words import Fault as NamedFault
from printmend.errors import InputError
from printmend.gcode.container import open_gcode
from printmend.gcode.read import read_gcode, starting_state
from printmend.gcode.sliced import is_test_print
from printmend.gcode.write import follow
from printmend.infer.machine import DRAWS
from printmend.learn import order as ordering
from printmend.learn import rows as row_words
from printmend.learn.learned import learn_model, todo
from printmend.machine import Mechanism
from printmend.measure import write_trace
from printmend.mend import check_gcode, mend_gcode
from printmend.mend.prediction import _beyond_seen
from printmend.mend.update import _change
from printmend.messages import GERMAN, Said, catalogue, say, translated
from printmend.model.model import SavedModel, exact_model, saved_model, write_model
from printmend.path import Trace
from printmend.plan import start
from printmend.printer import Printer, read_printer
from printmend.probe import design_probe, expected_error_mm
from printmend.promise import words as promise_words
from printmend.promise.words import scale_in_words
from printmend.studio import kernels, serve, work
from printmend.studio import scene as studio_scene
from printmend.studio.api import plain_name
from printmend.studio.app import PAGE, create_app
from printmend.studio.host import Host, checked_address, find_host
from printmend.studio.jobs import Jobs
from printmend.studio.next_print import next_print
from printmend.studio.places import DATABASE, Places
from printmend.studio.play import Faults, preview
from printmend.studio.scene import (
    MOST_POINTS,
    ROW,
    Scene,
    Tap,
    as_mended,
    as_printed,
    busiest,
    coarse,
    lay_points,
    read_drawing,
    read_motion,
    slicer_s,
    write_mended,
    write_wanted,
)
from printmend.studio.store import Store
from printmend.twin import Twin
from tests import naive_studio
from tests.believed import SCENES, part
from tests.mending import coarsely

HERE = "http://127.0.0.1:8765"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(Jobs, "warm", lambda jobs: None)  # no worker process is started before a job needs one
    return tmp_path / "studio"


def _client(folder: Path, **options: object) -> TestClient:
    return TestClient(create_app(Places.below(folder), workers=1, **options), base_url=HERE)  # type: ignore[arg-type]


def test_only_this_computer_and_its_own_pages_may_talk_to_it(folder: Path) -> None:
    with _client(folder) as client:
        assert client.get("/api/v1/health").json()["waiting"] == 0
        for host in ("evil.example", "127.0.0.1.evil.example:8765", "", "[::1", "127.0.0.1@evil.example"):
            assert client.get("/api/v1/health", headers={"host": host}).status_code == 421, host
        for headers in ({"origin": "http://evil.example"}, {"origin": "null"}, {"origin": "http://127.0.0.1:9999"},
                        {"sec-fetch-site": "cross-site"}):  # fmt: skip
            said = client.post("/api/v1/play/preview", json={}, headers=headers)
            assert said.status_code == 403, headers
            assert "another site" in said.json()["error"]
        assert client.post("/api/v1/play/preview", json={}, headers={"origin": HERE}).status_code == 200


def test_nothing_that_is_sent_grows_without_bounds_or_gets_out_of_its_folder(folder: Path) -> None:
    with _client(folder, most_bytes=1000) as client:
        assert client.post("/api/v1/uploads?name=a.gcode", content=b"x" * 1001).status_code == 413

        def endless() -> Iterator[bytes]:  # a body without a length
            for _ in range(50):
                yield b"x" * 100

        assert client.post("/api/v1/uploads?name=a.gcode", content=endless()).status_code == 413
        assert client.post("/api/v1/uploads?name=a.gcode", content=b"").status_code == 400
        table = {"content-type": "application/json"}
        long = client.post("/api/v1/play/preview", content=(b" " * 100_000 for _ in range(20)), headers=table)
        assert (long.status_code, long.json()["error"]) == (413, "the file is larger than 1 MB. Give a smaller file")
        assert list((folder / "uploads").iterdir()) == []
        sent = client.post("/api/v1/uploads", params={"name": "../../etc/pass\nwd.gcode"}, content=b"G28\n").json()
        assert sent["name"] == "pass_wd.gcode"
        assert [path.name for path in (folder / "uploads").iterdir()] == [sent["id"]]
        assert client.delete(f"/api/v1/uploads/{sent['id']}").status_code == 204
        assert list((folder / "uploads").iterdir()) == []
        for odd in ("..%2f..%2fstudio.sqlite", "%2e%2e", "0123456789abcdef", "0" * 400, "nul%00"):
            assert client.get(f"/api/v1/jobs/{odd}").status_code in (404, 422), odd
            assert client.get(f"/api/v1/jobs/{'0' * 16}/files/{odd}").status_code in (404, 422), odd
            assert client.get(f"/{odd}").status_code in (400, 404), odd
    assert plain_name("..") == plain_name("/") == plain_name(".") == "file"
    assert plain_name("C:\\x\\part 1.gcode.3mf") == "part 1.gcode.3mf"
    assert len(plain_name("x" * 500)) == 120


def test_the_page_is_whole_by_itself_and_small(folder: Path) -> None:
    with _client(folder) as client:
        page = client.get("/")
        policy = page.headers["content-security-policy"]
        assert "script-src 'self';" in policy
        assert "unsafe" not in policy
        assert client.get("/api/v1/nowhere").json() == {"error": "Not Found"}
    for path in PAGE.iterdir():
        if path.suffix in (".html", ".css", ".svg") or (path.suffix == ".js" and path.name != "vendor.js"):
            text = path.read_text(encoding="utf-8")
            foreign = set(re.findall(r"(?:https?:)?//[\w.-]+\.\w+", re.sub(r"^\s*//.*$", "", text, flags=re.M)))
            assert not foreign - {"http://www.w3.org"}, path.name
            assert not re.search(r"\bstyle=\"|\bon[a-z]+=\"|eval\(|innerHTML", text), path.name
    loaded = [path for path in PAGE.iterdir() if path.suffix in (".html", ".css", ".svg", ".js")]
    assert sum(len(gzip.compress(path.read_bytes())) for path in loaded) < 400_000
    for line in (PAGE / "vendor.sha256").read_text().splitlines():
        digest, name = line.split()
        assert hashlib.sha256((PAGE / name).read_bytes()).hexdigest() == digest, "see tools/studio_vendor"


def _strings(language: str) -> dict[str, str]:
    text = (PAGE / f"strings.{language}.js").read_text(encoding="utf-8")
    rows = re.findall(r'(\w+): "((?:[^"\\]|\\.)*)"', text)
    assert len({key for key, _ in rows}) == len(rows), "one key has two texts"
    return {key: json.loads(f'"{value}"') for key, value in rows}


def test_every_text_is_there_in_every_language() -> None:
    english, german = _strings("en"), _strings("de")
    assert set(english) == set(german)
    for key, text in english.items():
        assert set(re.findall(r"{(\w+)}", text)) == set(re.findall(r"{(\w+)}", german[key])), key
    code = "".join(path.read_text(encoding="utf-8") for path in PAGE.glob("*.js") if path.name != "vendor.js")
    assert set(re.findall(r"\bt\(\"(\w+)\"", code)) <= set(english)


PART = "G28\nG90\nM83\n;LAYER_CHANGE\nG1 Z0.2 F3000\n" + "".join(
    f";LAYER_CHANGE\nG1 Z{0.2 * n + 0.2:.1f}\nG1 X60 Y60\nG1 X110 Y60 E2\nG2 X110 Y100 I0 J20 E3\nG1 E-1\n"
    f"G1 X60 Y95 Z3\nG1 Z{0.2 * n + 0.2:.1f}\nG1 E1\nG1 X61 Y61 E1.5\nG1 X90 Y85 E1.5\n"
    for n in range(3)
)


def _tables(path: Path, *kinds: str) -> list[np.ndarray]:
    """Read a packed picture as the page does."""
    data = path.read_bytes()
    at = 4 + int.from_bytes(data[:4], "little")
    count = json.loads(data[4:at])["points"]
    rows = -(-count // ROW) * ROW
    assert len(data) == at + rows * 8 * len(kinds)
    return [
        np.frombuffer(data, kind, rows * 4, at + 8 * rows * i).reshape(-1, 4)[:count] for i, kind in enumerate(kinds)
    ]


def _scene(path: Path, machine: Mechanism, most: int = MOST_POINTS) -> Scene:
    """Return a part as it is printed, and as mended, each arc and line planned even where nothing is wrong."""
    drawing, tap = read_drawing(path, machine.printer, most=most), Tap()
    with open_gcode(path) as file:
        part = file.parts[0]
        follow(part.chunks(), starting_state(part, printer=machine.printer), tap.over(start(machine).plan))
    return as_mended(as_printed(drawing, machine), drawing, machine, tap)


def test_the_picture_shows_what_is_predicted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The scene's errors are those that `check` adds up by its own means; what no planner touches is where it was."""
    (path := tmp_path / "part.gcode").write_text(PART)
    printer = read_printer("ender3")
    faults = Corruption((Drive(pulley=EccentricBore(0.4, 1.0), belt=Play(0.2)), Drive(belt=Play(0.3))))
    model = exact_model(coarsely(faults, printer))
    prediction = check_gcode(path, model)
    scene = _scene(path, model.mechanism)
    assert scene.mended_error_mm is not None
    assert scene.rms_mm(scene.raw_error_mm) == pytest.approx(prediction.before.rms_mm, rel=0.05)
    assert scene.rms_mm(scene.mended_error_mm) < 0.005 < 0.05 < scene.rms_mm(scene.raw_error_mm)
    assert scene.mended_error_mm.max() < 0.02
    length = np.linalg.norm(np.diff(scene.wanted_mm, axis=0), axis=1) * scene.joined[:-1]
    assert length.sum() == pytest.approx(prediction.length_mm, rel=1e-3)
    # a bead's cross-section times its length is its filament: a bar with round sides
    area = scene.height_mm * (scene.width_mm - scene.height_mm * (1 - np.pi / 4))
    assert (area[1:] * length).sum() == pytest.approx(3 * 8 * 2.405, rel=0.02)
    head = write_wanted(packed := tmp_path / "packed.bin", scene)
    base, raw = _tables(packed, "<u2", "<i2")
    assert base[:, :3] * head["step_mm"] + head["low_mm"] == pytest.approx(scene.wanted_mm, abs=1e-3)
    assert raw[:, :3] * [0.002, 0.002, 0.001] == pytest.approx(
        np.column_stack([scene.raw_mm, scene.raw_error_mm]), abs=1.1e-3
    )
    assert (base[:, 3] & 1 == scene.joined).all()
    assert base[:, 3] >> 1 & 255 == pytest.approx(100 * scene.width_mm, abs=0.51)
    assert base[:, 3] >> 9 == pytest.approx(100 * scene.height_mm, abs=0.51)
    write_mended(packed, scene)
    (mended,) = _tables(packed, "<i2")
    assert mended[:, 2] * 0.001 == pytest.approx(scene.mended_error_mm, abs=6e-4)
    assert [z for _, _, z in head["layers"]] == [0.2, 0.4, 0.6]
    assert 0 < scene.raw_busiest <= scene.mended_busiest
    motion = read_motion(path, printer)
    assert coarse(motion) is None  # small enough to be drawn at once
    monkeypatch.setattr(studio_scene, "COARSE_LINES", int(motion.drawn.sum()) // 2)
    few = coarse(motion)
    assert few is not None
    first = as_printed(lay_points(few), model.mechanism)
    assert (first.every, sorted({*first.layer.tolist()})) == (2, [0, 2])
    assert first.raw_error_mm.max() == pytest.approx(scene.raw_error_mm.max(), rel=0.1)
    assert {*first.height_mm.tolist()} == {*scene.height_mm.tolist()}
    healthy = saved_model(Twin.of(Corruption((Drive(), Drive())), printer).homed(), learner="exact")
    still = _scene(path, healthy.mechanism, most=20)
    assert still.every > 1
    assert still.raw_error_mm.max() < 1e-9
    assert still.mended_error_mm is not None
    assert still.mended_error_mm.max() < 0.02  # chords of arcs, a few millimetres long


def test_a_tower_is_printed_in_the_order_of_its_table_and_shows_a_bent_screw(folder: Path, tmp_path: Path) -> None:
    """What the studio writes, printed by a twin and measured by hand, adds the screw and leaves X and Y as known."""
    printer = read_printer("ender3")
    bent = Corruption(
        (Drive(pulley=EccentricBore(0.4, 1.0)), Drive()), screw=Screw(wobble_mm=0.3, wobble_phase_rad=0.6)
    )
    with _client(folder) as client:
        key = client.post("/api/v1/printers", json={"preset": "ender3"}).json()["id"]
        made = client.post(f"/api/v1/printers/{key}/tower").json()
        assert client.get(f"/api/v1/printers/{key}/tower").json() == made
        assert 16 < made["height_mm"] < 20
        files = f"/api/v1/printers/{key}/files"
        (gcode := tmp_path / "tower.gcode").write_bytes(client.get(f"{files}/tower.gcode").content)
        (table := tmp_path / "tower.csv").write_bytes(client.get(f"{files}/tower.csv").content)
        empty = read_gcode(gcode, printer=printer).moves
        rows = np.genfromtxt(table, delimiter=",", names=True)
        told = np.column_stack([rows[name] for name in ("x_mm", "y_mm", "z_mm")])
        known = empty.known.all(axis=1)
        assert empty.end_mm[known][:-1] == pytest.approx(told[1:], abs=2e-3)
        assert told[1] == pytest.approx([*told[0, :2], told[1:, 2].min() + 1])  # off the bed before it moves across it
        assert is_test_print(gcode)
        seen = Twin.of(bent, printer).follow(told) + np.random.default_rng(2).normal(0, 0.02, told.shape)
        write_trace(table, Trace(told[:, :2], seen[:, :2], z_mm=told[:, 2], z_measured_mm=seen[:, 2], homed=True))
        write_model(folder / "printers" / key / "printer.mend.json", _learned_flat(bent, printer))
        upload = client.post("/api/v1/uploads?name=tower.csv", content=table.read_bytes()).json()["id"]
    said = work.run("learn", str(tmp_path / "job"), str(folder), {"printer": key, "upload": upload})["said"]
    titles = " ".join(one["title"] for one in said["faults"])
    assert "X pulley is off its centre" in titles
    push = np.ptp([x for x, _ in said["machine"]["screw"]["push_mm"]]) / 2
    assert push == pytest.approx(0.3, rel=0.15)


def test_a_job_names_files_as_they_were_sent(tmp_path: Path) -> None:
    """No folder of the studio is in what it refuses, and scans of one name stay apart, whatever others are called."""
    uploads, printer = tmp_path / "uploads", tmp_path / "printers" / "p"
    for place in (uploads, printer, tmp_path / "job"):
        place.mkdir(parents=True)
    write_model(printer / work.MODEL, exact_model(coarsely(Corruption((Drive(belt=Play(0.3)), Drive())))))
    (uploads / "a").write_text("G28\nG90\nM83\nG1 X60 Y60 Z0.2 F3000\nG1 X90\n")
    (uploads / "b").write_text("other")
    params: dict[str, Any] = {"printer": "p", "upload": "a", "name": "empty.gcode"}
    refused = work.run("mend", str(tmp_path / "job"), str(tmp_path), params)["refused"]
    assert refused.startswith("empty.gcode: this file prints nothing")
    named = [{"upload": "a", "name": "s.png"}, {"upload": "a", "name": "s.png"}, {"upload": "b", "name": "1-s.png"}]
    found = work._scans(work.Job(tmp_path / "job", tmp_path, {"scans": named}))
    assert [path.read_text() == "other" for path in found] == [False, False, True]
    (uploads / "c").write_text(PART + "; bed_shape = 0x0,300x0,300x300,0x300\n; layer_height = 0.2\n")
    params = {"printer": "p", "upload": "c", "name": "large.gcode", "scene": False}
    said = work.run("mend", str(tmp_path / "large"), str(tmp_path), params)
    assert "found a bed from (0, 0) to (300, 300) mm" in said["error"]
    assert said["may_force"]
    done = work.run("mend", str(tmp_path / "large"), str(tmp_path), {**params, "force": True})
    assert (done["output"], done["may_force"]) == ("large.mended.gcode", False)
    assert done["prediction"]["after"]["rms_mm"] < 0.01
    (uploads / "d").write_text("no G-code\n")
    assert not work.run("mend", str(tmp_path / "no"), str(tmp_path), {**params, "upload": "d"})["may_force"]


def _learned_flat(bent: Corruption, printer: Printer) -> SavedModel:
    plan = design_probe(printer)
    measured = np.full(plan.waypoints_mm.shape, np.nan)
    measured[plan.rows] = Twin.of(replace(bent, screw=None), printer).follow(plan.waypoints_mm)[plan.rows]
    measured += np.random.default_rng(1).normal(0, 0.01, measured.shape)
    return learn_model(Trace(plan.waypoints_mm, measured, homed=True), printer)


CFG = "[printer]\nkinematics: cartesian\n" + "".join(
    f"[stepper_{axis}]\nrotation_distance: {turn}\nmicrosteps: 16\nposition_max: {size}\nposition_endstop: 0\n"
    for axis, turn, size in (("x", 40, 200), ("y", 40, 180), ("z", 8, 200))
)


def test_distances_are_those_of_the_slow_twin() -> None:
    rng = np.random.default_rng(3)
    wanted = rng.uniform(0, 5, (200, 2))
    wanted[50] = wanted[49]
    printed, joined, out = wanted + rng.normal(0, 0.7, (200, 2)), rng.random(200) < 0.8, np.empty(200)
    joined[-1] = False
    kernels.distances(wanted, printed, joined, 3, out)
    assert out == pytest.approx(naive_studio.distances(wanted, printed, joined, 3), abs=1e-12)
    assert (out > 0).any()


def test_the_pace_counts_the_busiest_second_and_the_slicer_says_the_time() -> None:
    slow, fast = np.full(3, 30.0), np.full(12, 0.5)
    way = np.zeros((19, 3))
    way[:, 0] = np.concatenate([slow, fast, slow, [0.0]])
    assert busiest(way, np.full(19, 20.0)) == 13
    assert busiest(way[:0], np.empty(0)) == 0
    assert slicer_s(b"G1 X1", b"; estimated printing time (normal mode) = 1d 2h 58m 52s\n") == 97132
    assert slicer_s(b"; model printing time: 1m; total estimated time: 17m 3s\n") == 1023
    assert slicer_s(b";FLAVOR:Marlin\r\n;TIME:6667\r\n") == 6667
    assert slicer_s(b";FLAVOR:Marlin\n;TIME:6666\n") is None  # what Cura's engine writes where it does not know
    assert slicer_s(b"; total estimated time: -\nG1 X1") is None


def test_points_are_those_of_the_slow_twin() -> None:
    rng = np.random.default_rng(4)
    count = 30
    start, end, center = rng.uniform(0, 9, (count, 3)), rng.uniform(0, 9, (count, 3)), rng.uniform(0, 9, (count, 2))
    turn, counts, jumped = rng.integers(-1, 2, count), rng.integers(1, 5, count), rng.random(count) < 0.3
    sweep, radius = turn * rng.uniform(0.1, 7, count), np.hypot(*(start[:, :2] - center).T)
    rows = int((counts + jumped).sum())
    out, at, begin = np.empty((rows, 3)), np.empty(rows), np.arange(count, dtype=float)
    kernels.points(start, end, center, turn, sweep, radius, begin, begin + 1, counts, jumped, out, at)
    assert out == pytest.approx(naive_studio.points(start, end, center, turn, sweep, counts, jumped), abs=1e-9)
    assert at == pytest.approx(np.concatenate([
        np.arange(0 if jumps else 1, many + 1) / many + line
        for line, (many, jumps) in enumerate(zip(counts, jumped, strict=True))
    ]))  # fmt: skip


def test_the_way_of_ones_own_printer(folder: Path) -> None:
    """Describe, write the test print, read the distances, learn from callipers: without a job, in the server itself."""
    with _client(folder) as client:
        assert {"ender3", "corexy"} <= {one["id"] for one in client.get("/api/v1/presets").json()}
        sent = client.post("/api/v1/uploads?name=printer.cfg", content=CFG).json()["id"]
        mine = client.post("/api/v1/printers", json={"upload": sent, "name": " Cellar "}).json()
        assert (mine["name"], mine["bed_mm"], mine["health"]) == ("Cellar", [0, 0, 200, 180], None)
        wide = client.post("/api/v1/printers", json={"preset": "ender3", "bed_mm": [150, 120]}).json()
        assert wide["bed_mm"] == [0, 0, 150, 120]
        again = client.post("/api/v1/printers", json={"preset": "ender3"}).json()
        assert again["name"] == f"{wide['name']} 2"
        for said in (client.post("/api/v1/printers", json={"preset": "ender3", "name": "cellar "}),
                     client.patch(f"/api/v1/printers/{again['id']}", json={"name": "Cellar"})):  # fmt: skip
            assert "expected a name of its own, found that of another printer" in said.json()["error"]
        assert "expected a name" in client.patch(f"/api/v1/printers/{again['id']}", json={"name": " "}).json()["error"]
        for end in ("\n", "\r", "\u2028"):
            wrong = {"name": f"Cellar{end}G28"}
            for said in (client.post("/api/v1/printers", json={"preset": "ender3", **wrong}),
                         client.patch(f"/api/v1/printers/{again['id']}", json=wrong)):  # fmt: skip
                assert (said.status_code, "expected name as text of one line" in said.json()["error"]) == (400, True)
        assert client.get(f"/api/v1/printers/{again['id']}").json()["name"] == again["name"]
        assert client.delete(f"/api/v1/printers/{again['id']}").status_code == 204
        assert client.delete(f"/api/v1/printers/{wide['id']}").status_code == 204
        wrongs: tuple[tuple[dict[str, Any], str], ...] = (
            ({}, "neither"), ({"preset": "../x"}, "none of that name"), ({"upload": "0" * 16}, "none"),
            ({"preset": "ender3", "bed_mm": [1e9, 5]}, "max_mm"), ({"preset": 5}, "preset"),
        )  # fmt: skip
        for wrong, words in wrongs:
            said = client.post("/api/v1/printers", json=wrong)
            assert said.status_code in (400, 404, 422), wrong
            assert words in said.json()["error"], said.json()
        place = f"/api/v1/printers/{mine['id']}"
        assert "write the test print first" in client.get(f"{place}/callipers").json()["error"]
        assert client.get(f"{place}/probe").json() is client.get(f"{place}/tower").json() is None
        probe = client.post(f"{place}/probe", json={"size_mm": 120}).json()
        assert client.get(f"{place}/probe").json() == probe
        assert probe["marks"] == len(probe["marks_mm"]) > 100
        other = client.post(f"{place}/probe", json={})
        assert "the plan of another test print" in other.json()["error"]
        assert client.get(f"{place}/files/probe.gcode").text.count("\nG1") > 1000
        assert client.get(f"{place}/files/notes.json").status_code == 404
        list_ = client.get(f"{place}/callipers").json()
        known = client.post(
            f"{place}/callipers", json={"readings_mm": [1.01 * one["about_mm"] for one in list_]}
        ).json()
        assert "scale" in known["said"]["headline"]
        assert len(known["said"]["machine"]["motors"][0]["outline_mm"]) == 180
        assert client.get(place).json()["healthy"] is False
        kept = folder / "printers" / mine["id"] / "printer.mend.json"
        document = json.loads(kept.read_text(encoding="utf-8"))
        refused = {"kind": "unfit", "severity": "refusal", "words": "the model leaves 0.31 mm of 0.34 mm"}
        kept.write_text(json.dumps({**document, "diagnosis": [], "misfit": {"found": [refused]}}), encoding="utf-8")
        card = client.get(place).json()  # no fault is known, but it is not called healthy
        assert (card["healthy"], card["health"]) == (False, refused["words"])
        kept.write_text(json.dumps(document), encoding="utf-8")
        assert client.patch(place, json={"name": "Attic"}).json()["name"] == "Attic"
        assert [one["name"] for one in client.get("/api/v1/printers").json()] == ["Attic"]
        bad = client.post(f"{place}/learn", json={"measurement": "0" * 16, "exclude": [-1]})
        assert (bad.status_code, bad.json()["error"]) == (
            422, "exclude: expected at least 0, found -1; see /api/v1/openapi.json",
        )  # fmt: skip
        document = client.get("/api/v1/openapi.json").json()
        assert {"get", "post"} <= set(document["paths"]["/api/v1/printers"])
        names = [one["operationId"] for operations in document["paths"].values() for one in operations.values()]
        assert len({*names}) == len(names)
        for operations in document["paths"].values():
            for operation in operations.values():
                assert operation["description"].startswith(operation["summary"])


def test_jobs_are_done_stopped_and_begun_again_and_another_program_mends_by_address(folder: Path) -> None:
    """A real server and a real worker: a job that a killed studio left is run, `client` mends, a running one stops."""
    store = Store(Places.below(folder))
    left = store.add_job("nonsense", None, {})  # a killed studio's: its kind is not known any more
    old = store.add_job("mend", None, {})
    store.end_job(old, "done")
    with sqlite3.connect(folder / "studio.sqlite") as link:
        link.execute("update jobs set ended_s = 1 where id = ?", [old])  # long ago
    link.close()
    store.close()
    app = create_app(Places.below(folder), workers=1, stopping=lambda: server.should_exit)
    server = uvicorn.Server(uvicorn.Config(app, port=0, log_level="error", ws="none"))
    thread = threading.Thread(target=server.run)
    thread.start()
    try:
        while not server.started:
            time.sleep(0.02)
        studio = Studio(f"http://127.0.0.1:{server.servers[0].sockets[0].getsockname()[1]}")
        stopped = studio.post("/play", {"x": {"shape": "oval", "dent_mm": 1}})["id"]
        assert studio.post(f"/jobs/{stopped}/cancel")["state"] == "cancelled"
        (part := folder / "part 1.gcode").write_text(PART)
        key = studio.post("/printers", {"preset": "ender3", "name": "Cellar"})["id"]
        with pytest.raises(StudioError, match="measure its test print first"):
            studio.mend(part, printer="Cellar", output=folder / "out.gcode")
        faults = Corruption((Drive(pulley=EccentricBore(0.4, 1.0), belt=Play(0.2)), Drive(belt=Play(0.3))))
        model = exact_model(coarsely(faults))
        write_model(folder / "printers" / key / "printer.mend.json", model)
        result = studio.mend(part, printer="Cellar", output=folder / "out.gcode")
        mend_gcode(part, model, folder / "here.gcode")
        assert (folder / "out.gcode").read_bytes() == (folder / "here.gcode").read_bytes()
        assert result["prediction"]["after"]["rms_mm"] < 0.01
        assert result["doubt_mm"] == pytest.approx([0.0, 0.0], abs=1e-6)  # colours show more for a learned model
        with pytest.raises(StudioError, match="one that was mended with model"):
            studio.mend(folder / "out.gcode", printer=key, output=folder / "twice.gcode")
        with pytest.raises(InputError, match="expected a printer of the studio, found Cellar"):
            studio.mend(part, printer="nobody", output=folder / "twice.gcode")
        assert not (folder / "twice.gcode").exists()
        assert studio.get(f"/jobs/{left}")["state"] == "failed"
        with pytest.raises(StudioError, match="expected a job of this studio"):
            studio.get(f"/jobs/{old}")
        assert studio.get(f"/jobs/{stopped}")["state"] == "cancelled"
        with pytest.raises(StudioError, match="expected a job of this studio"):
            studio._open("GET", f"/jobs/{old}/events")
        kept = studio.upload(part)
        jobs = [studio.post(f"/printers/{key}/mend", {"upload": kept, "scene": False})["id"] for _ in range(2)]
        for job, left_over in zip(jobs, (True, False), strict=True):  # the file goes with the last job that has it
            followed = studio._open("GET", f"/jobs/{job}/events")
            studio._open("DELETE", f"/jobs/{job}").close()
            followed.read()  # ends whole, as that of any other job: a stream that breaks off raises here
            assert (folder / "uploads" / kept).exists() == left_over
        one, gone, two = (studio.post(f"/printers/{key}/mend", {"upload": studio.upload(part), "scene": False})["id"]
                          for _ in range(3))  # fmt: skip
        shared = studio._open("GET", f"/jobs/events?key={one}&key={gone}&key={two}&key={old}")
        studio._open("DELETE", f"/jobs/{gone}").close()
        told = [json.loads(line[6:]) for line in shared.read().decode().splitlines() if line.startswith("data: ")]
        last = {job["id"]: job["state"] for job in told}
        assert (last[one], last[two]) == ("done", "done")
        with pytest.raises(StudioError, match="expected a job of this studio"):
            studio._open("GET", f"/jobs/events?key={old}&key={gone}")
        going = studio.post("/play")["id"]
        stream = studio._open("GET", f"/jobs/{going}/events")
    finally:
        server.should_exit = True  # as Ctrl-C does, while a page follows a job
        thread.join()
    assert b'"state"' in stream.read()


class _Strange(BaseHTTPRequestHandler):
    """A computer in the network that is neither OctoPrint nor Moonraker, and tries what it can."""

    asked: ClassVar[list[str]] = []
    mainsail = False  # or else Mainsail's nginx, which packs what it is asked to

    def do_GET(self) -> None:
        self.asked.append(self.path)
        if self.mainsail and self.path == "/server/info":
            body = b'{"result": {"klippy_state": "ready"}}'
            packed = "gzip" in self.headers.get("Accept-Encoding", "")
            self.send_response(200)
            if packed:
                self.send_header("Content-Encoding", "gzip")
            self.end_headers()
            self.wfile.write(gzip.compress(body) if packed else body)
            return
        way = self.path.split("/")[1]
        if way == "elsewhere":
            self.send_response(302)
            self.send_header("Location", "/secret")
            self.end_headers()
            return
        body = b" " * 500_000 if way == "endless" else b'{"text": "Duet 3", "result": "ok"}'
        self.send_response(200)
        self.send_header("Content-Length", str(10 * len(body) if way == "endless" else len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *words: object) -> None:
        pass


def test_only_octoprint_and_moonraker_are_sent_to(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for text in ("ftp://octopi.local", "file:///etc/passwd", "http://me:pw@octopi.local", "http://", "http://a b",
                 "?y", "http://[::1", "http://octopi:99999", "http://a..b", "x" * 64):  # fmt: skip
        with pytest.raises(InputError, match="expected http"):
            checked_address(text)
    assert checked_address(" octopi.local/ ") == "http://octopi.local"
    assert checked_address("https://print.example:7125/one") == "https://print.example:7125/one"
    for text in ("http://fluidd.local/#/", "fluidd.local/?#temp"):  # as browsers show it
        assert checked_address(text) == "http://fluidd.local"
    server = ThreadingHTTPServer(("127.0.0.1", 0), _Strange)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        address = f"http://127.0.0.1:{server.server_port}"
        with _client(folder) as client:
            key = client.post("/api/v1/printers", json={"preset": "ender3"}).json()["id"]
            assert "connect it first" in client.post(f"/api/v1/printers/{key}/send", json={}).json()["error"]
            for way in ("/other", "/elsewhere", "/endless"):
                said = client.post(f"/api/v1/printers/{key}/host", json={"address": address + way, "key": "k"})
                assert said.status_code == 400
                assert "expected OctoPrint or Moonraker" in said.json()["error"]
            assert client.get(f"/api/v1/printers/{key}").json()["host"] is None
        assert "/secret" not in _Strange.asked
        assert len(_Strange.asked) == 12  # where it was told, and at the root
        monkeypatch.setattr(_Strange, "mainsail", True)
        assert find_host(f"{address}/console", "") == Host(address, "", "moonraker")
    finally:
        server.shutdown()
        server.server_close()
    with pytest.raises(InputError, match="is it running"):
        find_host(address, "")


def _german(text: str) -> str | None:
    """Return what the page says in German; None where any part of it would stay English."""
    if not isinstance(text, Said) or any(
        isinstance(part, Said) and _german(part) is None for part in text.values.values()
    ):
        return None
    is_known = text.id in catalogue() or not re.search("[a-z]{3}", text.id)
    return translated(text, GERMAN) if is_known else None


_REFUSING = """studio.api studio.api_printers studio.host studio.jobs studio.store studio.work measure.distance
measure.dots measure.measurement measure.plan measure.scan measure.table measure.image measure.ruler
mend.mend mend.update mend.verify gcode.bgcode gcode.container gcode.read gcode.threemf
printer.convert printer.klipper printer.slicer printer.toml probe.layout probe.gcode probe.tower measure.callipers
measure.checks model.model files learn.order filament measure.page
mend.filament mend.part fit.estimate measure.lie measure.walls measure.silhouette"""


def test_why_something_did_not_work_is_said_in_the_pages_own_words() -> None:
    """Whatever the page's jobs may refuse has an id: `tests/test_messages.py` looks at its German and its English."""
    seen = 0
    for name in _REFUSING.split():
        module = importlib.import_module(f"printmend.{name}")
        for call in ast.walk(ast.parse(inspect.getsource(module))):
            given = call.keywords if isinstance(call, ast.Call) else []
            for word in (one.value for one in given if one.arg in ("wanted", "came", "todo")):
                for text in _words_beside(word):
                    assert not re.search("[A-Za-z]{3}", text), f"{name}: {text!r} has no id"
                seen += 1
    assert seen > 300


def _words_beside(node: ast.expr) -> Iterator[str]:
    """Yield the words of an expression that stand in no message, as `say` and `together` make one."""
    if isinstance(node, ast.Constant):
        yield str(node.value)
    elif isinstance(node, ast.JoinedStr | ast.BoolOp):
        for part in node.values:
            yield from _words_beside(part)
    elif isinstance(node, ast.IfExp):
        yield from (*_words_beside(node.body), *_words_beside(node.orelse))
    elif isinstance(node, ast.BinOp):
        yield from (*_words_beside(node.left), *_words_beside(node.right))


_KINDS = """scale harmonic-1 harmonic-2 harmonic-5 play loose-belt play-by-angle friction elastic ripple-4
ripple-2 ripple-1 drift warp
offset period-34.6 splice teeth
skew axes bow wavy jump lead periodic-1 backlash wobble-1"""
_GROWING = "harmonic-3 harmonic-4 bump rub crooked distortion"  # … and what may grow beside them
_OF_FRAME = ("skew", "axes", "bow", "wavy", "crooked", "distortion")
# of Z, of one print, of older models
_OTHERS = ("offset", "jump", "lead", "periodic-1", "backlash", "wobble-1")


def test_all_that_is_said_of_a_printer_is_said_in_german_too() -> None:
    for kind in _KINDS.split():
        for value, sd in ((0.02, 0.0), (-0.3, 0.05), (3.0, 0.001)):
            one = advise(NamedFault("x", kind, value, sd, "mm", "words"), corexy=value > 1)
            for text in (one.title, one.meaning, one.sure, one.repair, one.software):
                assert _german(text), text
    rails = advise(NamedFault("a", "play", 0.1, 0.01, "mm", ""), corexy=True, rails=True)
    fault = {"part": "a", "kind": "play", "value": 0.1, "sd": 0.01, "unit": "mm"}
    found = [{"kind": "rail-play", "severity": "warning", "words": ""}]
    document = {"printer": {"kinematics": "corexy"}, "diagnosis": [fault], "misfit": {"found": found}}
    assert [one.repair for _, one in advised(document)] == [rails.repair]
    assert "rails and the head first" in rails.repair
    assert _german(rails.repair)
    idler = say("or-else", say("fault-elastic", "0.1 mm"), say("fault-idler", "31.4", "0.1 mm"))
    for words in (say("fault-elastic-or-idler", "0.1 mm"), idler):
        either = advise(NamedFault("x", "elastic", 0.1, 0.01, "mm", words))
        for text in (either.title, either.meaning, either.repair):
            assert "idler" in text
            assert _german(text), text
    seen = diagnosis.advice.Sight(0.4, 0.4, 1.0, 0.5, 9, 2)
    for change in ({}, {"turns": 2.0}, {"angles": 1.0, "backward": 9}):
        gaps = diagnosis.advice.motor_gaps("X", replace(seen, **change), 40.0, plays=True)
        assert gaps
        for text in (*gaps, *todo((*gaps, say("z-backlash-no-height-measured-after")))):
            assert _german(text), text
    _check_effects()
    gone = SimpleNamespace(printed_low_mm=(5.0, 9.0), printed_high_mm=(210.0, 12.0))
    words = say("only-part-measured", say("axis-from-to-of", "X", "20", "90", "0", "220"))
    unseen = {"kind": "unseen", "severity": "note", "words": words}
    section = {"seen_mm": [[20.0, 10.0], [90.0, 12.0]]}
    few = SimpleNamespace(document={"trace": section, "misfit": {"found": [unseen]}})
    (beyond,) = _beyond_seen(few, gone)  # type: ignore[arg-type]
    assert _german(beyond)
    seen, shifts = np.arange(0, 40, 2), np.repeat([0, 1, 0, -2, 3], 4)
    order = [ordering._history_words(seen[:count], shifts[:count]) for count in (8, 12, 16, 20)]
    for put in (*order, *map(say, ("rows-reversed-order", "measured-rows-reversed-order"))):
        trace = Trace(np.zeros((1, 2)), np.zeros((1, 2)))
        assert _german(ordering._put_right(trace, put, 1.0).found[0].words), put
    said = ordering.passed_over(replace(trace, blank_rows=3), 7)
    assert [each.kind for each in said if _german(each.words)] == ["rows-repeated", "rows-blank"]
    for period in (96.0, 99.9, 120.9):
        wave = np.zeros((64, 1))
        wave[2] = 1.0
        part = SimpleNamespace(effect="pulley", where=0, acts_mm=wave[:, 0])
        printer = SimpleNamespace(motors=("x",), axes=(SimpleNamespace(mm_per_turn=40.0),))
        scene = SimpleNamespace(printer=printer, turns_mm=(period,))
        box = SimpleNamespace(scene=scene, parts=(part,))
        told = row_words._other_turns(box)[0].words  # type: ignore[arg-type]
        assert f"repeats every {period / 3:.1f} mm" in told  # three equal waves in what was learned
        assert _german(told), period
    for kind in (*_KINDS.split(), *_GROWING.split()):
        if kind not in _OTHERS:
            before, now = (
                NamedFault("frame" if kind in _OF_FRAME else "x", kind, size, 0.01, "mm", "") for size in (0.1, 0.3)
            )
            grew, shrank = (_change(*both, 0.01).words for both in ((before, now), (now, before)))
            assert " stieg von " in (_german(grew) or ""), grew
            assert " sank von " in (_german(shrank) or ""), shrank
    for acts in (0.0, 0.01):
        settles = say("scale-settled-by-callipers")
        for cause, settled in (
            ("scale-picture-causes-part", settles),
            ("scale-picture-causes-all", say("scale-settled-by-scan", settles)),
            ("scale-paper-causes-part", say("scale-settled-by-travel")),
        ):
            assert _german(scale_in_words(np.full(2, 0.01), np.full(2, acts), 0.002, settled, cause))


def _check_effects() -> None:
    """All that effects say of a print, sure, likely, and one or the other, has its German."""
    there = np.arange(DRAWS) % 4 > 0
    for preset, scene in SCENES.items():
        for name, effect in EFFECTS.items():
            if effect.of is Of.MACHINE and not hasattr(effect, "told"):
                continue
            for term in {term.where: term for term in effect.terms(scene)}.values():
                for size in (-0.4, 0.3):
                    sizes = [size / (1 + at) for at in range(len(term.sd_mm))]
                    sure = misfits_of([part(name, term.where, sizes, term.shape)], scene)
                    maybe = misfits_of([part(name, term.where, sizes, term.shape, there=there)], scene)
                    for one in (*sure, *maybe):
                        assert _german(one.words), f"{preset}: {one.words}"
        narrow = replace(scene, bed_span_mm=((20.0, 90.0), scene.bed_span_mm[1]))
        assert all(_german(one.words) for one in unseen(narrow))
    for cause in ("scatter", *EFFECTS):
        assert _german(promise_words.in_words(cause)), cause


def test_the_next_print_is_the_smallest_that_tells_enough() -> None:
    printer = read_printer("ender3")
    gap = "X was seen on 40 % of its pulley's turn only; the rest is a guess."
    assert next_print(printer, ()) is None
    assert next_print(printer, (say("z-told-mm-only-measure-more", say("z-lead"), "0.20"),)) is None
    found = next_print(printer, (gap,))
    assert found is not None
    whole = expected_error_mm(printer, design_probe(printer))
    smaller = expected_error_mm(printer, design_probe(printer, size_mm=found.size_mm - 10))
    assert found.expected_mm <= 2 * whole < smaller


def test_a_bent_screw_pushes_the_walls_that_play_draws() -> None:
    assert preview(Faults(screw_mm=0.35))["wall_mm"] != preview(Faults())["wall_mm"]


def test_a_database_that_is_none_is_said_in_one_line(tmp_path: Path) -> None:
    places = Places.below(tmp_path)
    Store(places).close()
    (places.state / DATABASE).write_bytes(b"no database" * 1000)
    with pytest.raises(InputError, match="expected the studio's database, found file is not a database; make room"):
        Store(places)


def test_a_folder_is_one_studios_and_one_that_cannot_be_locked_is_said(tmp_path: Path) -> None:
    held = serve._alone(tmp_path)
    with pytest.raises(InputError, match="one that a running studio has"):
        serve._alone(tmp_path)
    held.close()
    serve._alone(tmp_path).close()
    (tmp_path / "studio.lock").write_text("no lock" * 100)
    with pytest.raises(InputError, match="expected a lock that the studio makes"):
        serve._alone(tmp_path)
    with pytest.raises(InputError, match="check that the folder can be written"):
        serve._alone(tmp_path / "absent")
