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

from printmend.studio.play import Faults, Side, shown

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
        until(lambda: page.get_by_role("button", name="Mend it").is_disabled())  # it has no such play
        page.get_by_role("button", name="Wobbly pulley").click()
        page.get_by_role("button", name="Mend it").click()
        page.get_by_role("slider", name="Wipe between as it prints and mended").wait_for()
        before, after = (float(text.split()[0]) for text in page.locator(".number b").all_inner_texts()[:2])
        assert after < 0.05 < 0.3 < before
        assert watched.foreign == []
        assert watched.problems == []
