"""A running studio for tests, that can be killed and started again, and a browser that looks at it."""

import os
import re
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from hosts import PRINTMEND
from playwright.sync_api import Browser, Page, sync_playwright

from printmend.client import Studio
from printmend.model import SavedModel, write_model
from printmend.provenance import read_model

CHROMIUM = Path("/usr/bin/chromium")
PICTURES = Path(__file__).resolve().parents[2] / "build" / "studio"
# WebGL in software; no sandbox, for the tests run as root
_FLAGS = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")


class Server:
    """`printmend studio` over ``folder``; a second start takes the first one's port. ``token`` is what it told."""

    def __init__(self, folder: Path, *options: str) -> None:
        self.folder, self.port, self.address, self.token, self._options = folder, 0, "", "", options
        self._process: subprocess.Popen | None = None
        self.start()

    def start(self) -> None:
        """Start it and wait until it listens."""
        command = [PRINTMEND, "studio", "--no-browser", "--port", self.port, "--folder", self.folder, *self._options]
        self._process = subprocess.Popen(  # noqa: S603 - our own program
            list(map(str, command)), stdout=subprocess.PIPE, text=True, start_new_session=True
        )
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        found = re.search(r"(http://127\.0\.0\.1:(\d+)/)(?:\?token=(\S+))?", line)
        assert found, line
        self.address, self.port, self.token = found[1], int(found[2]), found[3] or self.token

    @property
    def process(self) -> subprocess.Popen:
        """The running server."""
        assert self._process is not None
        return self._process

    def kill(self) -> None:
        """End it and its workers as a power cut would."""
        os.killpg(self.process.pid, signal.SIGKILL)
        self.process.communicate()

    def stop(self) -> None:
        """End it as Ctrl-C does."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
            try:
                self.process.communicate(timeout=20)
            except subprocess.TimeoutExpired:
                self.kill()

    def memory_bytes(self) -> int:
        """Return what it and its workers hold in memory; what several of them share counts once (PSS)."""
        total = 0
        for place in Path("/proc").glob("[0-9]*"):
            try:
                if os.getsid(int(place.name)) == self.process.pid:
                    found = re.search(r"^Pss: +(\d+) kB", (place / "smaps_rollup").read_text(), re.MULTILINE)
                    total += 1024 * int(found[1]) if found else 0
            except OSError:
                continue
        return total


def code_of(server: Server, model: SavedModel) -> tuple[Path, str]:
    """Return where a new printer of a studio has this model, and the code that the page would show to pair with it."""
    studio = Studio(server.address)
    key = str(studio.post("/printers", {"preset": "ender3"})["id"])
    there = server.folder / "printers" / key / "printer.mend.json"
    write_model(there, model)
    return there, str(studio.post(f"/printers/{key}/pair")["code"])


def paired(server: Server, model: Path, older: SavedModel, newer: SavedModel) -> None:
    """Pair a host's model with a printer of a studio at the host's terminal; then learn a newer one."""
    there, code = code_of(server, older)
    command = [PRINTMEND, "pair", server.address, code, "-m", model]
    subprocess.run(list(map(str, command)), check=True, capture_output=True)  # noqa: S603 - our own program
    assert read_model(str(model)).digest == older.digest
    write_model(there, newer)


@contextmanager
def chromium() -> Iterator[Browser]:
    """Start Debian's Chromium."""
    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=str(CHROMIUM), args=list(_FLAGS))
        try:
            yield browser
        finally:
            browser.close()


class Watched:
    """A page whose errors and requests are noted."""

    def __init__(self, page: Page, address: str) -> None:
        self.page, self.problems, self.foreign = page, [], []
        page.set_default_timeout(300_000)  # as long as a busy machine may take
        page.on("pageerror", lambda error: self.problems.append(str(error)))
        page.on("console", lambda said: said.type == "error" and self.problems.append(f"{said.text} {said.location}"))
        page.on("request", lambda request: self._request(request.url, address))

    def _request(self, url: str, address: str) -> None:
        if not url.startswith((address, "blob:" + address, "data:")):
            self.foreign.append(url)

    def picture(self, name: str, *, whole: bool = False) -> None:
        """Keep what the page shows."""
        PICTURES.mkdir(parents=True, exist_ok=True)
        self.page.screenshot(path=str(PICTURES / f"{name}.png"), full_page=whole)


def until(done, longest_s: float = 300.0, what: object = "it"):
    """Wait until ``done()`` is true and return what it is; the error names ``what`` was waited for."""
    end = time.monotonic() + longest_s
    while time.monotonic() < end:
        if value := done():
            return value
        time.sleep(0.1)
    raise AssertionError(f"{what} did not come about")


def drawn_finely(page: Page, change) -> None:
    """Do what changes the picture of a part, and wait until it is drawn anew with all that it has."""
    canvas = page.locator("[data-testid=part] canvas")
    before = int(canvas.get_attribute("data-pictures") or 0)
    change()
    until(lambda: int(canvas.get_attribute("data-pictures") or 0) > before
          and canvas.get_attribute("data-fine") == "true")  # fmt: skip
