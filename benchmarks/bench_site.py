"""Measure the page without a server: its size, its first picture, its mending; and what Python would cost there.

    .venv/bin/python benchmarks/bench_site.py [--pyodide node_modules/pyodide] [--out benchmarks/results/site.csv]

The page is made as by `make site`, and opened in Debian's Chromium with an empty cache: on this computer, and over a
line of 10 Mbit/s with 40 ms of delay. With ``--pyodide``, the folder of that npm package, Python is started in the
browser instead. It runs the planner's kernels as the plain Python that the live transform for Klipper runs
(integrations/klipper/live), without numpy, which that package does not have. Both mend the play screen's part for the
same machine.
"""

import argparse
import csv
import gzip
import json
import os
import shlex
import shutil
import statistics
import subprocess
import sys
import tempfile
import threading
import time
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "integrations" / "tests"), str(ROOT / "tools" / "site"), str(Path(__file__).parent)]

import make_site  # noqa: E402 — beside the site's tools
from playwright.sync_api import Browser, Page  # noqa: E402
from studio_server import chromium  # noqa: E402
from test_site import OWN, told  # noqa: E402

from printmend.model import exact_model, write_model  # noqa: E402
from printmend.studio.play import faults_of, play_printer  # noqa: E402

LINE = {"offline": False, "latency": 40, "downloadThroughput": 10e6 / 8, "uploadThroughput": 10e6 / 8}
NEEDED = ("pyodide.mjs", "pyodide.asm.mjs", "pyodide.asm.wasm", "python_stdlib.zip", "pyodide-lock.json")
IN_JAVASCRIPT = """async () => {
  const { planned } = await import("./planner.js");
  const body = (await fetch("./part.packed")).body.pipeThrough(new DecompressionStream("gzip"));
  const part = await new Response(body).json(), known = await (await fetch("./printer.json")).json();
  const machine = await (await fetch("./machine.json")).json(), begun = performance.now();
  const made = planned(machine, part, known).made;
  return [made.length, (performance.now() - begun) / 1000];
}"""
IN_PYTHON = """
import json, sys, time, zipfile
zipfile.ZipFile("/sources.zip").extractall("/program")
sys.path.insert(0, "/program/integrations/klipper/live")
import planner
part = json.load(open("/part.json"))
one = planner.Planner(json.load(open("/printer.mend.json")))
one.home(7)
made, begun = [], time.perf_counter()
rows = dict(zip(part["columns"], part["rows"]))
e = 0.0
for x0, y0, z0, x1, y1, z1, advance, feed in zip(*(rows[name] for name in
        ("x0", "y0", "z0", "x1", "y1", "z1", "advance", "feed"))):
    one.add([x0, y0, z0, e], [x1, y1, z1, e + advance], feed or 50.0)
    e += advance
    if len(one.waiting) > 400:
        one.plan(400, lambda wanted, moves: made.extend(moves))
one.plan(len(one.waiting), lambda wanted, moves: made.extend(moves))
[len(made), time.perf_counter() - begun]
"""
START = """async (files) => {
  const begun = performance.now(), { loadPyodide } = await import("./pyodide.mjs");
  const python = await loadPyodide({ indexURL: location.href });
  const ready = (performance.now() - begun) / 1000;
  for (const name of files) python.FS.writeFile("/" + name, new Uint8Array(await (await fetch(name)).arrayBuffer()));
  if (!files.length) return [ready, 0, 0];
  const [count, took] = python.runPython(await (await fetch("plan.py")).text()).toJs();
  return [ready, count, took];
}"""


class Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *words: object) -> None:
        pass


@contextmanager
def served(folder: Path) -> Iterator[str]:
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(folder)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}/"
    server.shutdown()
    server.server_close()


@contextmanager
def opened(browser: Browser, line: bool) -> Iterator[tuple[Page, list[float]]]:
    """A page with an empty cache, over a slow line or not, and the bytes that it has received."""
    context = browser.new_context()
    context.set_default_timeout(120_000)
    page, received = context.new_page(), []
    link = context.new_cdp_session(page)
    link.send("Network.enable")
    link.on("Network.dataReceived", lambda event: received.append(event["encodedDataLength"] or event["dataLength"]))
    if line:
        link.send("Network.emulateNetworkConditions", LINE)
    yield page, received
    context.close()


def first_picture(browser: Browser, address: str, line: bool) -> tuple[float, float]:
    """Return the seconds until the play screen is drawn, and the megabytes that came until then."""
    with opened(browser, line) as (page, received):
        begun = time.monotonic()
        page.goto(address, wait_until="commit")
        page.wait_for_selector("#drawing")
        page.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
        return time.monotonic() - begun, sum(received) / 1e6


def zipped(folder: Path) -> float:
    """Return the megabytes of a folder's files as a host that packs by gzip sends them."""
    return sum(len(gzip.compress(path.read_bytes())) for path in folder.rglob("*") if path.is_file()) / 1e6


def python_there(folder: Path, package: Path, site: Path) -> None:
    """Lay out what a page with Python in it needs, and nothing else."""
    for name in NEEDED:
        shutil.copy(package / name, folder / name)
    (folder / "part.json").write_bytes(gzip.decompress((site / "part.packed").read_bytes()))
    (folder / "index.html").write_text("<!doctype html><title>Python</title>")
    (folder / "plan.py").write_text(IN_PYTHON)
    with zipfile.ZipFile(folder / "sources.zip", "w", zipfile.ZIP_DEFLATED) as file:
        for path in [*ROOT.glob("integrations/klipper/live/*.py"), *ROOT.glob("src/printmend/**/kernels/*.py"),
                     *ROOT.glob("src/printmend/**/kernels.py")]:  # fmt: skip
            file.write(path, path.relative_to(ROOT))


def measured(options: argparse.Namespace, folder: Path) -> Iterator[tuple[str, str, str]]:
    """Yield rows: what, the aim, and what came of it."""
    site, python = folder / "site", folder / "python"
    size = make_site.make(site, list(make_site.presets())) / 1e6
    yield "the whole folder; packed by gzip", "15 MB", f"{size:.1f} MB; {zipped(site):.1f} MB"
    printer = play_printer()[0]
    model = exact_model(faults_of(OWN[0]).corruption(printer).lower(printer))
    (site / "machine.json").write_text(json.dumps(told(model.mechanism)))
    with chromium() as browser:
        with served(site) as address:
            for line in (False, True):
                found = [first_picture(browser, address, line) for _ in range(options.times)]
                seconds, megabytes = (statistics.median(column) for column in zip(*found, strict=True))
                over = "over 10 Mbit/s" if line else "from this computer"
                yield f"first picture, {over}; until then", "3 s", f"{seconds:.1f} s; {megabytes:.2f} MB"
            with opened(browser, False) as (page, _):
                page.goto(address)
                count, seconds = page.evaluate(IN_JAVASCRIPT)
                yield f"the part planned by the translated kernels ({count} moves)", "", f"{seconds:.1f} s"
        if options.pyodide is None:
            return
        python.mkdir()
        python_there(python, options.pyodide, site)
        write_model(python / "printer.mend.json", model)
        megabytes = sum((python / name).stat().st_size for name in NEEDED) / 1e6
        packed = sum(len(gzip.compress((python / name).read_bytes())) for name in NEEDED) / 1e6
        version = json.loads((options.pyodide / "package.json").read_text())["version"]
        yield f"Pyodide {version} without numpy; packed by gzip", "15 MB", f"{megabytes:.1f} MB; {packed:.1f} MB"
        with served(python) as address:
            for line in (True, False):
                with opened(browser, line) as (page, _):
                    page.set_default_timeout(1_200_000)
                    page.goto(address)
                    given = [] if line else ["sources.zip", "part.json", "printer.mend.json"]
                    ready, count, seconds = page.evaluate(START, given)
                over = "over 10 Mbit/s" if line else "from this computer"
                yield f"Python ready, {over}", "3 s", f"{ready:.1f} s"
            yield f"the part planned by the kernels in Python ({count} moves)", "", f"{seconds:.1f} s"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pyodide", type=Path, help="folder of the npm package pyodide")
    parser.add_argument("--times", type=int, default=5, help="first pictures of which the median counts")
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    rows: list[Any] = []
    with tempfile.TemporaryDirectory(prefix="printmend-") as name:
        for row in measured(options, Path(name)):
            print(" | ".join(row), flush=True)
            rows.append(row)
    if options.out is not None:
        write(options.out, rows)


def write(path: Path, rows: list[Any]) -> None:
    """Write a table of results, with what made it."""
    git = ["git", "-C", str(ROOT), "describe", "--always", "--dirty"]
    commit = subprocess.run(git, capture_output=True, text=True, check=False).stdout.strip()  # noqa: S603 — a fixed command
    with path.open("w", encoding="utf-8", newline="") as file:
        file.write(
            "# The page without a server, in Chromium with an empty cache, medians; Python in the browser beside it. "
        )
        file.write(f"{os.cpu_count()} cores, load {os.getloadavg()[2]:.0f}.\n")
        file.write(f"# command: .venv/bin/python {shlex.join(sys.argv)}\n# commit: {commit or 'unknown'}\n")
        csv.writer(file, lineterminator="\n").writerows([("what", "aim", "found"), *rows])


if __name__ == "__main__":
    main()
