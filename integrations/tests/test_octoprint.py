"""The OctoPrint plugin, installed as a package in a real OctoPrint with its virtual printer."""

import json
import re
import shutil
import subprocess
import tempfile
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from hosts import INTEGRATIONS, PRINTMEND, call, environment, form, free_port, running, wait_for
from parts import part
from playwright.sync_api import Browser, Locator, Page, expect
from studio_server import CHROMIUM, PICTURES, Server, Watched, chromium, code_of

from klippy_run import HOSTS
from printmend.client import Studio, StudioError
from printmend.corruption import Corruption, Drive
from printmend.corruption.transmission import Play
from printmend.mend import mend_gcode
from printmend.model.model import exact_model, write_model
from printmend.printer import read_printer
from printmend.provenance import read_model, sealed_test_print

expect.set_options(timeout=600_000)  # as long as a busy machine may take
KEY = "0123456789ABCDEF0123456789ABCDEF"
CONFIG = """server: {{firstRun: false, onlineCheck: {{enabled: false}}, pluginBlacklist: {{enabled: false}}}}
serial: {{log: true, autoconnect: false}}
plugins:
  virtual_printer: {{enabled: true, simulated_errors: []}}
  tracking: {{enabled: false}}
  printmend: {{command: {command}, model: {model}}}
  _disabled: [announcements, tracking, errortracking, softwareupdate, discovery, pluginmanager, file_check]
"""


class OctoPrint:
    def __init__(self, url: str, base: Path) -> None:
        self.url, self.base = url, base

    def get(self, path: str, data: dict | None = None) -> dict:
        return call(self.url + path, data, {"X-Api-Key": KEY})

    def upload(self, name: str, text: bytes, *, start: bool = False) -> None:
        """Upload; return when it is answered."""
        body, headers = form({"print": str(start).lower()}, name, text)
        call(f"{self.url}/api/files/local", body, {**headers, "X-Api-Key": KEY})

    def told(self, name: str) -> dict:
        return self.get(f"/api/files/local/{name}").get("printmend", {})

    def start(self, name: str) -> None:
        wait_for(lambda: self.state() == "Operational", "the printer free")
        self.get(f"/api/files/local/{name}", {"command": "select", "print": True})

    def disk(self, name: str) -> Path:
        return self.base / "uploads" / name

    def said(self, what: str) -> int:
        """Return how often the plugin's log says something."""
        return (self.base / "logs/octoprint.log").read_text().count(what)

    def refuses(self, name: str, reason: str) -> bool:
        """Say whether a file's print was refused before a line of it was sent."""
        refused, before = self.said(f"refused {name}"), len(self.sent())
        self.start(name)
        wait_for(lambda: self.said(f"refused {name}") > refused, "the refusal")
        wait_for(lambda: self.state() == "Operational", "the printer free")
        lines = {line.split(";")[0].strip() for line in self.disk(name).read_text().splitlines()}
        return not [line for line in self.sent()[before:] if line in lines and line[:3] == "G1 "] and self.said(reason)

    def prints(self, name: str, mended: str) -> None:
        """Start a file; return when all of another was sent."""
        before = len(self.sent())
        self.start(name)
        wait_for(lambda: self.last(mended) in self.sent()[before:] and self.state() == "Operational", "the print")

    def last(self, name: str) -> str:
        return [line for line in self.disk(name).read_text().splitlines() if line.startswith("G1")][-1].split(";")[0]

    def state(self) -> str:
        return self.get("/api/job")["state"]

    def connected(self) -> bool:
        """Connect to the virtual printer where it is not; say whether it is."""
        if (state := self.state()) != "Operational" and not state.startswith(("Opening", "Connecting", "Detecting")):
            self.get("/api/connection", {"command": "connect", "port": "VIRTUAL"})
        return state == "Operational"

    def sent(self) -> list[str]:
        """Return the lines that went to the printer, without numbers and checksums."""
        log = (self.base / "logs/serial.log").read_text()
        return re.findall(r"- Send: N\d+ (.*)\*\d+$", log, re.MULTILINE)


def learned(path: Path, slack_mm: float, size_mm: float = 6.0) -> bytes:
    """Write a model; return a part of this size that was mended with it."""
    model = exact_model(Corruption((Drive(belt=Play(slack_mm)), Drive(belt=Play(0.6)))).lower(read_printer("ender3")))
    write_model(path, model)
    with tempfile.TemporaryDirectory() as work:
        (source := Path(work, "in.gcode")).write_bytes(part(1, size_mm=size_mm))
        mend_gcode(source, model, out := Path(work, "out.gcode"))
        return out.read_bytes()


def set_up(base: Path, program: Path) -> None:
    """Make the settings, a user and a model."""
    model = base / "printer.mend.json"
    learned(model, 0.4)
    gated = base / "gated"  # printmend that waits for as long as there is a file HOLD
    wait = f'while [ -e "{base}/HOLD" ]; do sleep 0.1; done'
    gated.write_text(f'#!/bin/sh\necho "37 %" >&2\n{wait}\nexec "{PRINTMEND}" "$@"\n')
    gated.chmod(0o755)
    (base / "config.yaml").write_text(CONFIG.format(command=gated, model=model))
    add = [program, "--basedir", base, "user", "add", "me", "--password", "pw", "--admin"]
    subprocess.run(list(map(str, add)), check=True, capture_output=True, env=environment())  # noqa: S603
    users = base / "users.yaml"
    users.write_text(users.read_text().replace("apikey: null", f"apikey: {KEY}"))


@contextmanager
def octoprint_running(base: Path) -> Iterator[OctoPrint]:
    """Run OctoPrint with the plugin and its virtual printer in ``base`` until the end of the block."""
    program = HOSTS / "octoprint/bin/octoprint"
    if not (base / "config.yaml").exists():
        set_up(base, program)
    port = free_port()
    serve = [program, "serve", "--iknowwhatimdoing", "--basedir", base, "--host", "127.0.0.1", "--port", port]
    with running(serve, base / "out", env=environment()):
        host = OctoPrint(f"http://127.0.0.1:{port}", base)
        wait_for(lambda: host.get("/api/version")["server"], "OctoPrint up")
        wait_for(host.connected, "the virtual printer")
        yield host


@pytest.fixture(scope="module")
def octoprint(tmp_path_factory):
    with octoprint_running(tmp_path_factory.mktemp("octoprint")) as host:
        yield host


def signed_in(browser: Browser, octoprint: OctoPrint) -> Page:
    page = browser.new_context(locale="en-GB").new_page()
    page.set_default_timeout(600_000)
    page.goto(octoprint.url)
    page.locator("#login-user").fill("me")
    page.locator("#login-password").fill("pw")
    page.locator("#login-button").click()
    # The state comes by the socket that the plug-in's messages come by.
    expect(page.locator("#state")).to_contain_text("Operational")
    return page


def settings_of(page: Page) -> Locator:
    page.locator("#navbar_show_settings").click()
    page.locator("#settings_plugin_printmend_link a").click()
    return page.locator("#settings_plugin_printmend")


@pytest.fixture
def hold(octoprint: OctoPrint) -> Iterator[Path]:
    """Where a file keeps mending from its end; it never outlives its test."""
    path = octoprint.base / "HOLD"
    yield path
    path.unlink(missing_ok=True)


def test_upload_and_print_prints_the_mended_copy_alone(octoprint: OctoPrint) -> None:
    text = part(1, size_mm=6.0)
    octoprint.upload("part.gcode", text, start=True)
    wait_for(lambda: octoprint.told("part.mended.gcode").get("state") == "current", "the copy")
    told = octoprint.told("part.mended.gcode")
    assert told["after"]["rms_mm"] < 0.01 < 0.1 < told["before"]["rms_mm"]
    wait_for(lambda: octoprint.told("part.gcode").get("copy") == "part.mended.gcode", "the link")
    assert octoprint.told("part.gcode")["state"] == "unmended"
    mended = octoprint.base / "uploads/part.mended.gcode"
    lines = [line.split(";")[0].strip() for line in mended.read_text().splitlines()]
    lines = [line for line in lines if line]
    wait_for(lambda: octoprint.state() == "Operational" and lines[-1] in octoprint.sent(), "the print")
    sent = octoprint.sent()
    begin = max(row for row in range(len(sent)) if sent[row : row + 2] == lines[:2])  # the last print of several
    assert sent[begin : begin + len(lines)] == lines
    original = {line.split(";")[0].strip() for line in text.decode().splitlines()} - set(lines)
    assert not original & set(sent)
    wait_for(lambda: octoprint.state() == "Operational", "the end of the print")
    # The same original once more: its copy is there.
    octoprint.get("/api/files/local/part.gcode", {"command": "select", "print": True})
    wait_for(lambda: octoprint.sent().count(lines[-1]) > sent.count(lines[-1]), "the second print")
    assert not original & set(octoprint.sent())
    wait_for(lambda: octoprint.state() == "Operational", "the end of the second print")


def test_an_upload_is_answered_at_once(octoprint: OctoPrint, hold: Path) -> None:
    hold.touch()
    octoprint.upload("quick.gcode", part(1, size_mm=6.0))  # returns, though mending cannot end
    assert octoprint.told("quick.mended.gcode") == {}
    hold.unlink()
    wait_for(lambda: octoprint.told("quick.mended.gcode").get("state") == "current", "the copy")


def test_a_test_print_is_printed_as_it_is(octoprint: OctoPrint) -> None:
    says = b"; printmend first layer: of a part\n" + part(1, size_mm=7.0)
    text = sealed_test_print(says)
    before = len(octoprint.sent())
    octoprint.upload("probe.gcode", text, start=True)
    wait_for(lambda: octoprint.told("probe.gcode").get("state") == "test print", "the word for it")
    lines = [line.split(";")[0].strip() for line in text.decode().splitlines()]
    lines = [line for line in lines if line]
    wait_for(lambda: octoprint.state() == "Operational" and lines[-1] in octoprint.sent()[before:], "the print")
    assert set(lines) <= set(octoprint.sent()[before:])
    assert octoprint.told("probe.mended.gcode") == {}
    octoprint.upload("says.gcode", says)
    wait_for(lambda: octoprint.told("says.gcode").get("state") == "forged", "the word for it")
    assert octoprint.refuses("says.gcode", "says that it is a test print")


def test_mending_can_be_cancelled(octoprint: OctoPrint, hold: Path) -> None:
    hold.touch()
    octoprint.upload("endless.gcode", part(1, size_mm=6.0))
    wait_for(lambda: octoprint.get("/api/plugin/printmend", {"command": "cancel"})["cancelled"], "the cancelling")
    wait_for(lambda: octoprint.told("endless.gcode") == {"state": "failed", "reason": "cancelled"}, "the reason")
    hold.unlink()
    assert octoprint.told("endless.mended.gcode") == {}


def test_what_cannot_be_mended_is_not_printed(octoprint: OctoPrint) -> None:
    before = len(octoprint.sent())
    far = b"G28\nM83\nG1 Z0.2\nG1 X900 Y900 F6000\nG1 X950 Y900 E1 F1800\n"
    octoprint.upload("bad.gcode", far, start=True)
    wait_for(lambda: octoprint.told("bad.gcode").get("state") == "failed", "the reason")
    assert "950" in octoprint.told("bad.gcode")["reason"]
    wait_for(lambda: octoprint.state() == "Operational", "the printer free")
    assert not [line for line in octoprint.sent()[before:] if "X9" in line]


def test_neither_a_mark_nor_a_name_is_believed(octoprint: OctoPrint, tmp_path: Path) -> None:
    foreign, own = learned(tmp_path / "m.json", 0.9), learned(octoprint.base / "printer.mend.json", 0.4)
    mark = next(line for line in own.splitlines(True) if line.startswith(b"; mended by"))
    texts = {"foreign": (foreign, "not this printer's"), "forged": (mark + part(1), "not what printmend wrote")}
    for state, (text, reason) in texts.items():
        octoprint.upload(f"{state}.mended.gcode", text)
        wait_for(lambda state=state: octoprint.told(f"{state}.mended.gcode").get("state") == state, state)
        assert octoprint.refuses(f"{state}.mended.gcode", reason)
    # An unmended file of a mended one's name is one that gets a copy.
    octoprint.upload("evil.mended.gcode", part(1, size_mm=5.0), start=True)
    wait_for(lambda: octoprint.told("evil.mended.mended.gcode").get("state") == "current", "its copy")
    wait_for(lambda: octoprint.last("evil.mended.mended.gcode") in octoprint.sent()[-30:], "the print of its copy")
    wait_for(lambda: octoprint.state() == "Operational", "the end of the print")
    # What was mended somewhere else with this model is printed.
    octoprint.upload("elsewhere.gcode", own)
    wait_for(lambda: octoprint.told("elsewhere.gcode").get("state") == "current", "the seal")
    octoprint.prints("elsewhere.gcode", "elsewhere.gcode")


def test_a_copy_lives_as_long_as_its_original(octoprint: OctoPrint, hold: Path) -> None:
    copy = octoprint.disk("v.mended.gcode")
    octoprint.upload("v.gcode", part(1, size_mm=6.0))
    wait_for(lambda: octoprint.told("v.gcode").get("copy") == "v.mended.gcode", "the copy")
    hold.touch()
    octoprint.upload("v.gcode", part(1, size_mm=7.0))
    wait_for(lambda: not copy.exists(), "the old copy gone")
    hold.unlink()
    wait_for(lambda: octoprint.told("v.gcode").get("copy") == "v.mended.gcode", "the new copy")
    octoprint.get("/api/files/local/v.gcode", {"command": "move", "destination": "w.gcode"})
    wait_for(lambda: octoprint.told("w.gcode").get("copy") == "w.mended.gcode", "the copy of the new name")
    assert not copy.exists()
    call(f"{octoprint.url}/api/files/local/w.gcode", headers={"X-Api-Key": KEY}, method="DELETE")
    wait_for(lambda: not octoprint.disk("w.mended.gcode").exists(), "the copy gone with its original")


def test_what_the_printer_was_before_is_mended_anew(octoprint: OctoPrint) -> None:
    """After learning again: beside its original, under a name of its own, and all at once."""
    model = octoprint.base / "printer.mend.json"
    octoprint.upload("o.gcode", part(1, size_mm=8.0))
    wait_for(lambda: octoprint.told("o.gcode").get("copy") == "o.mended.gcode", "the copy")
    octoprint.get("/api/files/local/o.mended.gcode", {"command": "copy", "destination": "mine.gcode"})
    wait_for(lambda: octoprint.told("mine.gcode").get("state") == "current", "a copy of the copy")
    old = octoprint.disk("mine.gcode").read_bytes()
    learned(model, 0.3)
    octoprint.prints("mine.gcode", "mine.gcode")
    assert octoprint.disk("mine.gcode").read_bytes() != old
    octoprint.prints("o.gcode", "o.mended.gcode")
    assert octoprint.disk("o.mended.gcode").read_bytes() == octoprint.disk("mine.gcode").read_bytes()
    learned(model, 0.4)
    queued = octoprint.get("/api/plugin/printmend", {"command": "mend_all"})["queued"]
    assert {"o.mended.gcode", "mine.gcode"} <= set(queued)
    wait_for(lambda: octoprint.disk("o.mended.gcode").read_bytes() == old, "the first model's copy again")
    # One whose original is gone is not printed.
    wait_for(lambda: octoprint.disk("mine.gcode").read_bytes() == old, "and the other")
    call(f"{octoprint.url}/api/files/local/o.gcode", headers={"X-Api-Key": KEY}, method="DELETE")
    wait_for(lambda: not octoprint.disk("o.mended.gcode").exists(), "the copy gone with its original")
    learned(model, 0.3)
    assert octoprint.refuses("mine.gcode", "no longer kept")
    learned(model, 0.4)


def test_renaming_changes_no_files_state(octoprint: OctoPrint) -> None:
    """Neither of the mended file, nor of the source: a file is judged by its content, and finds its source again."""
    model, old, new = octoprint.base / "printer.mend.json", "q.mended.gcode", "renamed.gcode"

    def rename(name: str, to: str) -> None:
        octoprint.get(f"/api/files/local/{name}", {"command": "move", "destination": to})
        wait_for(lambda: octoprint.told(to).get("state") and not octoprint.disk(name).exists(), f"{name} as {to}")

    octoprint.upload("q.gcode", part(1, size_mm=9.0))
    wait_for(lambda: octoprint.told("q.gcode").get("copy") == old, "the copy")
    first = octoprint.disk(old).read_bytes()
    rename(old, new)
    wait_for(lambda: octoprint.told(new)["state"] == "current", "the state under its new name")
    octoprint.prints(new, new)
    assert octoprint.disk(new).read_bytes() == first
    rename("q.gcode", "source.gcode")
    wait_for(lambda: octoprint.told("source.gcode").get("copy") == "source.mended.gcode", "its own copy")
    assert octoprint.told("source.gcode")["state"] == "unmended"
    octoprint.prints("source.gcode", "source.mended.gcode")
    octoprint.prints(new, new)  # still what the model in use made
    learned(model, 0.3)  # now it is stale, and its source has another name
    octoprint.prints(new, new)
    assert octoprint.disk(new).read_bytes() != first
    assert octoprint.told(new)["state"] == "current"
    learned(model, 0.4)


def test_a_queue_prints_each_file_as_its_state_asks(octoprint: OctoPrint, tmp_path: Path) -> None:
    """A queue starts one file after the other: each is judged as it starts, whatever was printed before it."""
    model = octoprint.base / "printer.mend.json"
    # No other test has this part: nobody keeps its source.
    foreign, own = learned(tmp_path / "m.json", 0.9, 7.25), learned(model, 0.4, 7.25)
    octoprint.upload("queued.gcode", part(1, size_mm=6.5))
    wait_for(lambda: octoprint.told("queued.gcode").get("copy") == "queued.mended.gcode", "the copy")
    octoprint.upload("queued-own.gcode", own)
    octoprint.upload("queued-foreign.gcode", foreign)
    octoprint.upload("queued-forged.gcode", own.replace(b"F1800", b"F1801"))
    for name, state in (("own", "current"), ("foreign", "foreign"), ("forged", "forged")):
        wait_for(lambda name=name, state=state: octoprint.told(f"queued-{name}.gcode").get("state") == state, state)
    octoprint.prints("queued-own.gcode", "queued-own.gcode")
    assert octoprint.refuses("queued-foreign.gcode", "not this printer's")
    octoprint.prints("queued.gcode", "queued.mended.gcode")  # unmended: its copy
    assert octoprint.refuses("queued-forged.gcode", "not what printmend wrote")
    learned(model, 0.3)  # between two of a queue
    stale = octoprint.disk("queued.mended.gcode").read_bytes()
    octoprint.prints("queued.mended.gcode", "queued.mended.gcode")
    assert octoprint.disk("queued.mended.gcode").read_bytes() != stale
    octoprint.prints("queued.gcode", "queued.mended.gcode")
    assert octoprint.refuses("queued-own.gcode", "no longer kept")  # stale, and nobody has its source
    learned(model, 0.4)


def test_mending_waits_for_a_print_and_an_ending_may_be_in_capitals(octoprint: OctoPrint) -> None:
    octoprint.upload("long.gcode", sealed_test_print(b"; printmend probe: one that waits\nM0\n" + part(2)), start=True)
    wait_for(lambda: octoprint.state() == "Paused", "the pause")
    octoprint.upload("c.GCODE", part(1, size_mm=6.0))
    wait_for(lambda: octoprint.told("c.GCODE").get("state") == "unmended", "the word for it")
    assert "c.mended.gcode" in octoprint.get("/api/plugin/printmend")["waiting"]  # beside what other tests left
    octoprint.get("/api/job", {"command": "cancel"})
    wait_for(lambda: octoprint.told("c.mended.gcode").get("state") == "current", "the copy")
    octoprint.prints("c.GCODE", "c.mended.gcode")


def test_a_restart_forgets_nothing(tmp_path: Path) -> None:
    with octoprint_running(tmp_path) as octoprint:
        octoprint.upload("r.gcode", part(1, size_mm=6.0))
        wait_for(lambda: octoprint.told("r.gcode").get("copy") == "r.mended.gcode", "the copy")
        healthy = part(1, size_mm=5.0)
        write_model(tmp_path / "printer.mend.json", exact_model(Corruption().lower(read_printer("ender3"))))
        octoprint.upload("healthy.gcode", healthy)
        wait_for(lambda: octoprint.told("healthy.gcode").get("copy"), "the copy of a healthy printer")
        assert octoprint.told("healthy.gcode")["state"] == "current"
    learned(tmp_path / "printer.mend.json", 0.4)
    with octoprint_running(tmp_path) as octoprint:
        octoprint.prints("r.gcode", "r.mended.gcode")
        assert octoprint.said("start r.gcode") == 1  # it was mended once
        octoprint.prints("healthy.gcode", "healthy.mended.gcode")
        assert octoprint.disk("healthy.gcode").read_bytes() == healthy
        assert octoprint.disk("healthy.mended.gcode").read_bytes() != healthy


@pytest.mark.skipif(not CHROMIUM.exists(), reason="needs Debian's chromium")
def test_a_printer_paired_in_the_settings_gets_the_studios_newer_models_by_itself(
    octoprint: OctoPrint, tmp_path: Path
) -> None:
    older, newer = (exact_model(Corruption((Drive(belt=Play(slack)), Drive())).lower(read_printer("ender3")))
                    for slack in (0.35, 0.45))  # fmt: skip
    before = octoprint.get("/api/settings")["plugins"]["printmend"]["model"]
    server = Server(tmp_path / "studio")
    try:
        there, code = code_of(server, older)
        with chromium() as browser:
            page = signed_in(browser, octoprint)
            settings = settings_of(page)
            settings.get_by_label("Address of the studio").fill(server.address)
            for digits, said in (("12345", "six digits"), (f"{code[:3]} {code[3:]}", "its model is in use now")):
                settings.get_by_label("Code", exact=True).fill(digits)
                settings.get_by_role("button", name="Pair").click()
                expect(settings.get_by_role("status").filter(has_text=said)).to_be_visible()
        model = Path(octoprint.get("/api/settings")["plugins"]["printmend"]["model"])
        assert octoprint.get("/api/plugin/printmend")["model"] == older.digest == read_model(str(model)).digest
        write_model(there, newer)
        octoprint.get("/api/plugin/printmend", {"command": "update"})
        wait_for(lambda: octoprint.get("/api/plugin/printmend")["model"] == newer.digest, "the newer model")
    finally:
        server.stop()
        octoprint.get("/api/settings", {"plugins": {"printmend": {"model": before}}})


def test_a_model_is_uploaded_and_tried(octoprint: OctoPrint) -> None:
    model = octoprint.base / "printer.mend.json"
    send = {"X-Api-Key": KEY, "Content-Type": "application/octet-stream"}
    refused = call(f"{octoprint.url}/plugin/printmend/model", model.read_bytes().replace(b"0.4", b"0.5"), send)
    assert (refused["status"], "changed or damaged" in refused["text"]) == (400, True)
    told = call(f"{octoprint.url}/plugin/printmend/model", model.read_bytes(), send)
    assert told["printer"] == "Creality Ender-3"
    assert Path(told["path"]).read_bytes() == model.read_bytes()
    assert octoprint.get("/api/settings")["plugins"]["printmend"]["model"] == told["path"]
    now = octoprint.get("/api/plugin/printmend")
    assert (now["model"], now["models"][0]["path"]) == (told["model"], told["path"])  # beside what a studio gave
    octoprint.get("/api/plugin/printmend", {"command": "test"})
    wait_for(lambda: octoprint.said("tested  {'reason': ''"), "the test square")
    octoprint.get("/api/settings", {"plugins": {"printmend": {"model": str(model)}}})


def test_its_folder_alone_is_a_package_that_octoprint_can_install(tmp_path: Path) -> None:
    """As the plugin manager installs an archive, but for the network."""
    archive = shutil.make_archive(str(tmp_path / "plugin"), "zip", INTEGRATIONS, "octoprint")
    python, wheels = HOSTS / "octoprint/bin/python", tmp_path / "wheels"
    command = [python, "-m", "pip", "wheel", "--no-index", "--no-build-isolation", "--no-deps", "-w", wheels, archive]
    subprocess.run(list(map(str, command)), check=True, capture_output=True)  # noqa: S603
    with zipfile.ZipFile(next(wheels.glob("*.whl"))) as wheel:
        names = wheel.namelist()
        told = wheel.read(next(name for name in names if name.endswith("METADATA"))).decode()
    for name in ("provenance.py", "program.py", "static/js/printmend.js", "templates/printmend_settings.jinja2"):
        assert f"octoprint_printmend/{name}" in names
    assert any(name.endswith("LICENSE") for name in names)
    assert "Author: printmend's authors" in told


CHECKED = """
import importlib.metadata, json, sys, types
import octoprint_printmend as plugin
from octoprint.plugins.softwareupdate import SoftwareUpdatePlugin, version_checks

class Installed:
    version = "0.1.0"
    def __init__(self, url, more):
        self.url, self.more = url, more
    def read_text(self, name):
        assert name == "direct_url.json"  # what pip writes, see PEP 610
        return json.dumps({"url": self.url, **self.more}) if self.url else None

updates, said = SoftwareUpdatePlugin(), []
updates._settings = types.SimpleNamespace(global_get=lambda path: None)
for url, more in json.loads(sys.argv[1]):
    importlib.metadata.distribution = lambda name: Installed(url, more)
    told = plugin.__plugin_hooks__["octoprint.plugin.softwareupdate.check_config"]()
    for target, check in told.items():
        assert updates._get_version_checker(target, check) is version_checks.github_release
        assert updates._get_update_method(target, check) == "pip"
        assert updates._populated_check(target, check)["current"] == "0.1.0"
    said.append([[check["user"], check["repo"], check["pip"].format(target_version="0.2")] for check in told.values()])
print(json.dumps(said))
"""


def test_updates_come_from_where_it_was_installed_from() -> None:
    """As OctoPrint's own software update takes what the hook says."""
    zipped = "https://github.com/somebody/octoprint-printmend/archive/0.2.zip"
    came = [
        ("https://github.com/somebody/octoprint-printmend/archive/main.zip", {}),
        ("https://github.com/somebody/octoprint-printmend.git", {"vcs_info": {"vcs": "git"}}),
        ("https://github.com/a/printmend/archive/1.zip", {"subdirectory": "integrations/octoprint"}),
        ("file:///home/pi/octoprint", {}), ("https://example.com/x.zip", {}), ("", {}),
    ]  # fmt: skip
    command = [HOSTS / "octoprint/bin/python", "-c", CHECKED, json.dumps(came)]
    done = subprocess.run(list(map(str, command)), check=False, capture_output=True, text=True)  # noqa: S603
    assert done.returncode == 0, done.stderr
    own = [["somebody", "octoprint-printmend", zipped]]
    part_of = "https://github.com/a/printmend/archive/0.2.zip#subdirectory=integrations/octoprint"
    assert json.loads(done.stdout) == [own, own, [["a", "printmend", part_of]], [], [], []]


@pytest.mark.skipif(not CHROMIUM.exists(), reason="needs Debian's chromium")
def test_a_popup_tells_of_mending_and_cancels_it(octoprint: OctoPrint, hold: Path) -> None:
    with chromium() as browser:
        page = signed_in(browser, octoprint)
        popup = page.locator(".ui-pnotify")
        hold.touch()
        octoprint.upload("shown.gcode", part(1, size_mm=6.0))
        begun = popup.filter(has_text="Mending …").filter(has_text="shown.gcode")
        expect(begun).to_contain_text("37 %")
        expect(begun.locator(".bar")).to_have_attribute("style", re.compile("37%"))
        begun.get_by_role("button", name="Cancel").click()
        expect(popup.filter(has_text="Not mended, not printed").filter(has_text="cancelled")).to_be_visible()
        expect(begun).to_have_count(0)
        hold.unlink()
        octoprint.upload("shown2.gcode", part(1, size_mm=6.0))
        expect(popup.filter(has_text="shown2.mended.gcode").filter(has_text="→")).to_be_visible()
        # The list says the same, and that the model is another one now.
        page.locator("#files .search-query").fill("shown2")  # a page of the list has few files
        entry = page.locator("#files .entry").filter(has_text="shown2.mended.gcode")
        expect(entry.locator(".printmend")).to_have_text(re.compile(r"^mended 0\.\d+ mm → 0\.00\d mm$"))
        entry.hover(force=True)  # scrolls there; OctoPrint draws its list anew, and this asks again
        page.screenshot(path=PICTURES / "octoprint-files.png")
        learned(octoprint.base / "printer.mend.json", 0.3)
        settings = settings_of(page)
        settings.get_by_role("button", name="Save and test").click()
        expect(settings.get_by_role("status").filter(has_text="a test square")).to_contain_text("→")
        expect(entry.locator(".printmend")).to_contain_text("mended with an earlier model")
        entry.evaluate(
            "entry => { for (const one of [entry, ...entry.querySelectorAll('.printmend, .printmend *')]) "
            "if (one.scrollWidth > one.clientWidth + 1 && one.clientWidth) throw Error(one.outerHTML); }"
        )
        page.screenshot(path=PICTURES / "octoprint-settings.png")
        learned(octoprint.base / "printer.mend.json", 0.4)
    assert octoprint.told("shown.gcode") == {"state": "failed", "reason": "cancelled"}


@pytest.mark.skipif(not CHROMIUM.exists(), reason="needs Debian's chromium")
def test_the_page_sends_the_test_print_and_a_mended_file_to_octoprint(octoprint: OctoPrint, tmp_path: Path) -> None:
    server = Server(tmp_path / "studio")
    try:
        studio = Studio(server.address)
        key = studio.post("/printers", {"preset": "ender3", "name": "Cellar"})["id"]
        studio.post(f"/printers/{key}/probe", {"size_mm": 60})
        folder = server.folder / "printers" / key
        machine = Corruption((Drive(belt=Play(0.4)), Drive(belt=Play(0.6)))).lower(read_printer("ender3"))
        write_model(folder / "printer.mend.json", exact_model(machine))
        (source := tmp_path / "gear.gcode").write_bytes(part(1))
        with pytest.raises(StudioError, match="expected a key that it accepts, found a refusal"):
            studio.post(f"/printers/{key}/host", {"address": octoprint.url, "key": "wrong" + KEY[5:]})
        with chromium() as browser:
            watched = Watched(browser.new_context(locale="en-GB").new_page(), server.address)
            page = watched.page
            page.goto(server.address + f"#/printers/{key}/measure")
            page.get_by_role("button", name="Send it to the printer").click()
            page.get_by_label("Address").fill(octoprint.url)
            page.get_by_label("API key").fill(KEY)
            page.get_by_role("button", name="Connect").click()
            page.get_by_role("button", name="Send to OctoPrint").click()
            expect(page.get_by_text("probe.gcode is among the files of OctoPrint")).to_be_visible()
            assert (octoprint.base / "uploads/probe.gcode").read_bytes() == (folder / "probe.gcode").read_bytes()
            page.get_by_role("link", name="Mend", exact=True).click()
            page.set_input_files("input[type=file][accept*=gcode]", source)
            page.get_by_role("button", name="Send to OctoPrint").click()
            expect(page.get_by_text("gear.mended.gcode is among the files of OctoPrint")).to_be_visible()
            assert b"; mended by printmend" in (octoprint.base / "uploads/gear.mended.gcode").read_bytes()[:200]
            watched.picture("send")
            assert (watched.problems, watched.foreign) == ([], [])
        assert KEY not in str([studio.get("/printers"), studio.get("/jobs")])
        assert (folder / "host.json").stat().st_mode & 0o077 == 0
    finally:
        server.stop()
