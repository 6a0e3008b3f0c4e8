"""Measure the studio as a person meets it: from the drop of a file to its picture, mended and shown; start; memory.

    .venv/bin/python benchmarks/bench_studio.py [--only start idle trial phone small large half huge vast uploads]

`idle` is what server and workers hold once they have rehearsed. `trial` is the shortest way from broken to mended and
shared: *Mend it*, *Share* and *Save as PNG* are clicked as soon as they are there; `phone` is the same on a phone's
screen, where none of them may need scrolling. `small` is a sliced gear of 5 MB, `large` one of 300 000 moves, `half` a
vase of half a million segments. `huge` is six gears of 9 MB in one file of more than 50 MB, of which the page shows
600 000 points, `vast` sixteen of them, 150 MB. Each is dropped on the page in Debian's Chromium, which draws in
software. Wall time is what one waits; processor time is that of server, workers and browser together, and does not
depend on who else uses the machine.
"""

import argparse
import gzip
import os
import sys
import tempfile
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "integrations" / "tests"))
sys.path.insert(0, str(Path(__file__).parent))
from parts import part
from playwright.sync_api import Browser, Page, expect
from studio_server import Server, chromium

from printmend.client import Studio
from printmend.corruption import Corruption, CrookedFrame, Drive, EccentricBore, Play
from printmend.model.model import exact_model, write_model
from printmend.printer import read_printer
from printmend.studio.app import PAGE
from printmend.twin import Twin
from studio_part import gear_gcode, vase_gcode

FAULTS = Corruption(
    (Drive(pulley=EccentricBore(0.6, 1.0), belt=Play(0.3)), Drive(belt=Play(0.15))), CrookedFrame(skew_deg=0.5)
)
PARTS = {
    "small": lambda: gear_gcode(38.0, 18.0),
    "large": lambda: gear_gcode(62.0, 36.0),
    "half": vase_gcode,
    "huge": lambda: 6 * gear_gcode(58.0, 26.0),
    "vast": lambda: 16 * gear_gcode(58.0, 26.0),
}
LONGEST_MS = 600_000
PHONE = {"viewport": {"width": 390, "height": 844}, "device_scale_factor": 2, "is_mobile": True, "has_touch": True}
QUIET_S = 0.06  # of processor time in a second: nothing is at work
TURNS = 10


def processor_s(of: int | None = None) -> float:
    """Return the processor time [s] of a process and all that it started and that runs; of this one only the others."""
    rows = {}
    for place in Path("/proc").glob("[0-9]*"):
        try:
            fields = (place / "stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue
        rows[int(place.name)] = (int(fields[1]), sum(map(int, fields[11:15])))
    mine = {of or os.getpid()}
    while more := {pid for pid, (parent, _) in rows.items() if parent in mine} - mine:
        mine |= more
    return sum(rows[pid][1] for pid in mine - {os.getpid()} if pid in rows) / os.sysconf("SC_CLK_TCK")


class Watch:
    """Wall and processor time since it was made."""

    def __init__(self) -> None:
        self._wall_s, self._processor_s = time.monotonic(), processor_s()

    def __str__(self) -> str:
        wall_s, used_s = time.monotonic() - self._wall_s, processor_s() - self._processor_s
        return f"{wall_s:.1f} s (processor {used_s:.1f} s)"


class Most:
    """The most memory that a server and its workers hold while a block runs."""

    def __init__(self, server: Server) -> None:
        self._server, self.bytes, self._over = server, 0, threading.Event()

    def __enter__(self) -> "Most":
        self._looking = threading.Thread(target=self._look)
        self._looking.start()
        return self

    def _look(self) -> None:
        while not self._over.wait(0.05):
            self.bytes = max(self.bytes, self._server.memory_bytes())

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._looking.join()


def settle() -> None:
    """Wait until nothing is at work any more: the workers rehearse after the start, as while one looks for a file."""
    before = processor_s()
    while True:
        time.sleep(1.0)
        if (now := processor_s()) - before < QUIET_S:
            return
        before = now


def printer_of(server: Server, name: str) -> str:
    """Return the key of a new printer with faults that are known exactly."""
    key = Studio(server.address).post("/printers", {"preset": "ender3", "name": f"Workshop, {name}"})["id"]
    model = exact_model(Twin.of(FAULTS, read_printer("ender3")).homed())
    write_model(server.folder / "printers" / key / "printer.mend.json", model)
    return str(key)


def drop(browser: Browser, server: Server, key: str, name: str, folder: Path) -> None:
    """Drop a part on the Mend screen; print how long until it is shown, and until it is mended and shown."""
    text = PARTS[name]()
    (path := folder / f"{name}.gcode").write_bytes(text)
    page = browser.new_context(viewport={"width": 1280, "height": 860}, locale="en-GB").new_page()
    page.set_default_timeout(LONGEST_MS)
    page.goto(f"{server.address}#/printers/{key}/mend")
    page.wait_for_selector("input[type=file]", state="attached")
    settle()
    watch = Watch()
    with Most(server) as most:
        page.set_input_files("input[type=file][accept*=gcode]", path)
        page.wait_for_selector("canvas[data-frame]")
        shown = str(watch)
        page.wait_for_selector("text=Download mended")
        page.wait_for_selector("button:has-text('mended')")
        mended = str(watch)
        page.wait_for_selector("canvas[data-fine=true]")
        fine = str(watch)
    canvas = page.locator("canvas")
    canvas.focus()
    watch, before = Watch(), int(canvas.get_attribute("data-pictures") or 0)
    for _ in range(TURNS):
        page.keyboard.press("ArrowLeft")
        page.wait_for_function("(n) => Number(document.querySelector('canvas').dataset.pictures) > n", arg=before)
        before = int(canvas.get_attribute("data-pictures") or 0)
    turned = str(watch)
    page.wait_for_selector("canvas[data-fine=true]")
    job = next(job for job in Studio(server.address).get(f"/jobs?printer={key}") if job["params"]["name"] == path.name)
    after = job["result"]["prediction"]
    print(f"{name}: {len(text) / 1e6:.1f} MB, {after['moves']} moves; shown {shown}; mended and shown {mended}; "
          f"finely {fine}; {TURNS} pictures while it turns {turned}, then finely {watch}; "
          f"held {most.bytes / 1e6:.0f} MB at most, afterwards {server.memory_bytes() / 1e6:.0f} MB; "
          f"error {after['before']['rms_mm']:.3f} -> {after['after']['rms_mm']:.3f} mm; "
          f"the page holds {page.evaluate('performance.memory.usedJSHeapSize') / 1e6:.0f} MB", flush=True)  # fmt: skip
    page.context.close()


def trial(page: Page, since: Watch, what: str) -> None:
    """Mend, share and save as somebody who has never seen it; print how long each took."""
    page.set_default_timeout(LONGEST_MS)
    click(page, "Mend it")
    page.wait_for_selector("canvas[data-frame]")
    page.wait_for_selector(".number b[data-still=true]")
    off, mended = page.locator(".number b").all_inner_texts(), str(since)
    click(page, "Share")
    page.wait_for_selector("img.sharecard")
    with page.expect_download():
        click(page, "Save as PNG")
    print(f"{what}: to the mended part {mended}; to the saved card {since}; {off}", flush=True)


def click(page: Page, name: str) -> None:
    """Click a button that is seen without scrolling."""
    button = page.get_by_role("button", name=name).last
    expect(button).to_be_in_viewport(timeout=LONGEST_MS)
    button.click()


def uploads(server: Server, key: str, folder: Path) -> None:
    """Send and mend fifty files at once; print time and the most memory of the server and its workers."""
    studio, watch = Studio(server.address), Watch()
    for number in range(50):
        (folder / f"{number}.gcode").write_bytes(part(1).replace(b"G28", b"; part %d\nG28" % number, 1))

    def send(number: int) -> str:
        sent = studio.upload(folder / f"{number}.gcode")
        return str(studio.post(f"/printers/{key}/mend", {"upload": sent, "scene": False})["id"])

    with Most(server) as most, ThreadPoolExecutor(50) as many:
        for job in list(many.map(send, range(50))):
            assert studio.wait(job)["prediction"]["after"]["rms_mm"] < 0.01
    print(f"uploads: 50 at once, all mended in {watch}; at most {most.bytes / 1e9:.2f} GB of memory", flush=True)


def main() -> None:
    """Measure what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    names = ["start", "idle", "trial", "phone", *PARTS, "uploads"]
    parser.add_argument("--only", nargs="+", choices=names, default=names)
    only = parser.parse_args().only
    loaded = [path for path in PAGE.iterdir() if path.suffix in (".html", ".css", ".svg", ".js")]
    print(f"page: {sum(len(gzip.compress(path.read_bytes())) for path in loaded) / 1000:.0f} kB compressed", flush=True)
    with tempfile.TemporaryDirectory() as name, chromium() as browser:
        folder = Path(name)
        Server(folder / "studio").stop()  # warm: what is read from the disk has been read
        watch = Watch()
        server = Server(folder / "studio")
        try:
            page = browser.new_page()
            page.goto(server.address)
            page.wait_for_selector("#drawing", timeout=LONGEST_MS)
            if "start" in only:
                print(
                    f"start: drawn after {watch}, of which the server {processor_s(server.process.pid):.1f} s",
                    flush=True,
                )
            if "idle" in only:
                settle()
                print(f"idle: ready after {watch}; held {server.memory_bytes() / 1e6:.0f} MB", flush=True)
            if "trial" in only:
                trial(page, watch, "trial, from the command")
            page.close()
            if "phone" in only:
                page = browser.new_context(**PHONE).new_page()
                watch = Watch()
                page.goto(server.address)
                trial(page, watch, "phone, from the address")
                page.context.close()
            for one in PARTS:
                if one in only:
                    drop(browser, server, printer_of(server, one), one, folder)  # its page shows no other part before
            if "uploads" in only:
                uploads(server, printer_of(server, "uploads"), folder)
        finally:
            server.stop()


if __name__ == "__main__":
    main()
