"""The play screen without a server: its law says what the program says, and the page works without a network."""

import json
import shutil
import subprocess
import sys
import threading
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
import pytest
from studio_server import CHROMIUM, Watched, chromium, until

from printmend.machine import Mechanism
from printmend.mend import mend_gcode
from printmend.model import exact_model
from printmend.studio import play as plate
from printmend.studio.play import Faults, Side, faults_of, play_printer, shown
from printmend.studio.scene import Tap, as_mended, as_printed, read_drawing

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tools" / "site"))
import make_site

NODE = shutil.which("node")
SHAPES = ("round", "eccentric", "oval", "flat", "square")
RUN = """
import { readFileSync, writeFileSync } from "fs";
import { preview } from "./faults.js";
const known = JSON.parse(readFileSync("printer.json"));
const cases = JSON.parse(readFileSync("cases.json"));
writeFileSync("out.json", JSON.stringify(cases.map((faults) => preview(faults, known))));
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site") / "demo"
    size_bytes = make_site.make(folder, ["wobble"])
    assert size_bytes + 6 * sum(path.stat().st_size for path in (folder / "plays").rglob("*")) < make_site.MOST_BYTES
    return folder


def _cases(rng: np.random.Generator) -> list[dict]:
    def side(shape: str) -> dict:
        return {"shape": shape, "dent_mm": float(rng.uniform(0, 1.5)), "angle_deg": float(rng.uniform(0, 360)),
                "play_mm": float(rng.choice([0.0, rng.uniform(0, 0.8)]))}  # fmt: skip

    def some(low: float, high: float) -> float:
        return float(rng.choice([0.0, rng.uniform(low, high)]))

    return [
        {"x": side(shape), "y": side(str(rng.choice(SHAPES))), "skew_deg": some(-2, 2), "screw_mm": some(0, 0.5)}
        for shape in SHAPES * 3
    ]


@pytest.mark.skipif(NODE is None, reason="needs node")
def test_the_translated_law_says_the_programs_numbers(site: Path, tmp_path: Path) -> None:
    for name in ("faults.js", "law.js", "printer.json"):
        shutil.copy(site / name, tmp_path / name)
    cases = _cases(np.random.default_rng(7))
    (tmp_path / "package.json").write_text('{"type": "module"}')
    (tmp_path / "cases.json").write_text(json.dumps(cases))
    (tmp_path / "run.js").write_text(RUN)
    subprocess.run([str(NODE), "run.js"], cwd=tmp_path, check=True, timeout=120)  # noqa: S603 - our own program
    for faults, said in zip(cases, json.loads((tmp_path / "out.json").read_text()), strict=True):
        wanted = shown(Faults(Side(**faults["x"]), Side(**faults["y"]), faults["skew_deg"], faults["screw_mm"]))
        for name, value in wanted.items():
            np.testing.assert_allclose(np.array(said[name], float), np.array(value, float), rtol=0, atol=1e-6)
    assert max(one["rms_mm"] for one in json.loads((tmp_path / "out.json").read_text())) > 0.5


PLAN = """
import { readFileSync, writeFileSync } from "fs";
import { gunzipSync } from "zlib";
import { mended, planned } from "./planner.js";
const read = (name) => JSON.parse(readFileSync(name)), known = read("printer.json");
const part = JSON.parse(gunzipSync(readFileSync("part.packed")));
const made = read("cases.json").map((faults) => mended(faults, part, known, 2048));
const told = made.map(({ before, after }) => ({ before, after }));
const same = read("machines.json").map((machine) => planned(machine, part, known).made);
writeFileSync("out.json", JSON.stringify([told, same.map((all) => all.map((p) => [p.x, p.y, p.z, p.share, p.feed]))]));
"""
OWN = [
    {"x": {"shape": "eccentric", "dent_mm": 0.9, "angle_deg": 40, "play_mm": 0.2},
     "y": {"shape": "square", "dent_mm": 0.5, "angle_deg": 75, "play_mm": 0.3}, "skew_deg": 0.4, "screw_mm": 0},
    {"x": {"shape": "flat", "dent_mm": 1.1, "angle_deg": 10, "play_mm": 0}, "screw_mm": 0.3, "skew_deg": 0,
     "y": {"shape": "round", "dent_mm": 0, "angle_deg": 0, "play_mm": 0.6}},
]  # fmt: skip


def told(mechanism: Mechanism) -> dict:
    """Return a machine as the page's planner takes it."""
    frame = mechanism.frame
    way = {"corexy": 0, "framed": int(not frame.is_identity), "origin": [0, 0], "scale": [frame.scale_mm] * 2,
           "terms": frame.coefficients_mm.tolist(), "wave_count": 0, "waves": []}  # fmt: skip
    tables = [
        {"first": t.first_mm, "rate": 1.0 / t.pitch_mm, "lower": t.lower_mm.tolist(), "upper": t.upper_mm.tolist()}
        for t in mechanism.motors
    ]
    screw = None if mechanism.screw is None else tables[2] | {"pushes": mechanism.screw.wobble_mm.T.tolist()}
    return {"way": way, "drives": tables[:2], "screw": screw}


@pytest.mark.skipif(NODE is None, reason="needs node")
def test_the_part_is_mended_in_the_browser_with_the_programs_numbers(site: Path, tmp_path: Path) -> None:
    """The same planner: for one machine the same commands; for one that the sliders make, the same part to 1e-6 mm."""
    printer = play_printer()[0]
    models = [exact_model(faults_of(faults).corruption(printer).lower(printer)) for faults in OWN]
    shutil.copytree(site, folder := tmp_path / "site")
    (folder / "package.json").write_text('{"type": "module"}')
    (folder / "cases.json").write_text(json.dumps(OWN))
    (folder / "machines.json").write_text(json.dumps([told(model.mechanism) for model in models]))
    (folder / "run.js").write_text(PLAN)
    subprocess.run([str(NODE), "run.js"], cwd=folder, check=True, timeout=300)  # noqa: S603 - our own program
    (path := tmp_path / "part.gcode").write_bytes(plate.plate_gcode(printer))
    drawing = read_drawing(path, printer)
    for model, said, pieces in zip(models, *json.loads((folder / "out.json").read_text()), strict=True):
        tap, other = taps = Tap(), Tap()
        for number, each in enumerate(taps):
            mend_gcode(path, model, tmp_path / f"mended-{number}.gcode", watch=each.watch)
        scene = as_printed(drawing, model.mechanism, aligned=True)
        scene = as_mended(scene, drawing, model.mechanism, tap, aligned=True)
        taken = other.taken()[1]
        wanted = np.column_stack([taken[name] for name in ("x", "y", "z", "share", "feed")])
        np.testing.assert_allclose(np.array(pieces), wanted, rtol=0, atol=1e-9)
        for name, error in (("before", scene.raw_error_mm), ("after", scene.mended_error_mm)):
            assert said[name]["rms_mm"] == pytest.approx(scene.rms_mm(error), abs=1e-6)
            assert said[name]["p95_mm"] == pytest.approx(float(np.quantile(error, 0.95)), abs=1e-5)
        assert said["after"]["rms_mm"] < 0.01 < 0.1 < said["before"]["rms_mm"]


@pytest.mark.skipif(not CHROMIUM.exists(), reason="needs Debian's chromium")
def test_the_page_mends_without_a_network_after_the_first_visit(site: Path) -> None:
    class Quiet(SimpleHTTPRequestHandler):
        def log_message(self, *words: object) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(site)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    address = f"http://127.0.0.1:{server.server_port}"
    with chromium() as browser:
        watched = Watched(browser.new_context(locale="en-GB", reduced_motion="reduce").new_page(), address)
        page = watched.page
        page.goto(address)
        page.wait_for_selector("#drawing")
        page.evaluate("navigator.serviceWorker.ready")
        until(lambda: page.evaluate("caches.keys().then((names) => names.length && caches.open(names[0])"
                                    ".then((one) => one.keys()).then((keys) => keys.length))"))  # fmt: skip
        server.shutdown()
        server.server_close()
        page.reload()
        page.wait_for_selector("#drawing")
        page.get_by_label("How far out of shape").first.fill("1.2")
        page.get_by_role("button", name="Mend it").click()  # a fault of one's own: planned in the browser
        page.get_by_role("slider", name="Compare as it prints with mended").wait_for()
        before, after = (float(text.split()[0]) for text in page.locator(".number b").all_inner_texts()[:2])
        assert after < 0.01 < 0.3 < before
        assert "the planner knows each fault exactly" in page.inner_text("body")
        watched.picture("site-own", whole=True)
        page.get_by_role("button", name="Change the faults").click()
        page.get_by_role("button", name="Wobbly pulley").click()
        page.get_by_role("button", name="Mend it").click()
        page.get_by_role("slider", name="Compare as it prints with mended").wait_for()
        before, after = (float(text.split()[0]) for text in page.locator(".number b").all_inner_texts()[:2])
        assert after < 0.05 < 0.3 < before
        assert watched.foreign == []
        assert watched.problems == []
