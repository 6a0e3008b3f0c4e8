"""A host gets a printer's model from the studio by a code of six digits, and each newer one by itself."""

import contextlib
import json
import socket
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import uvicorn
from click.testing import CliRunner

from printmend import client
from printmend.cli.main import group, main
from printmend.client import Studio, StudioError, pair_file
from printmend.corruption import Corruption, Drive, Play
from printmend.errors import InputError
from printmend.messages import GERMAN, translated
from printmend.model import exact_model, write_model
from printmend.printer import read_printer
from printmend.provenance import read_model
from printmend.studio import guard, pairing
from printmend.studio.app import create_app
from printmend.studio.devices import Devices
from printmend.studio.jobs import Jobs
from printmend.studio.places import Places
from tests.mending import coarsely

PRINTER = read_printer("ender3")


@contextlib.contextmanager
def _served(folder: Path) -> Iterator[tuple[str, str]]:
    """Serve a studio that asks for tokens; yield its address and a token."""
    devices = Devices(folder)
    token = devices.add("desk")
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        app = create_app(Places.below(folder), workers=1, devices=devices)
        config = uvicorn.Config(app, log_level="error", http=guard.Door, timeout_graceful_shutdown=1)
        server = uvicorn.Server(config)
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]}, daemon=True)
        thread.start()
        while not server.started:
            time.sleep(0.02)
        yield f"http://127.0.0.1:{listener.getsockname()[1]}", token
        server.should_exit = True
        thread.join()


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(Jobs, "warm", lambda jobs: None)
    (tmp_path / "studio").mkdir()
    return tmp_path / "studio"


def _learn(folder: Path, key: str, play_mm: float) -> str:
    """Let a printer have a model; return its digest."""
    model = exact_model(coarsely(Corruption((Drive(belt=Play(play_mm)), Drive())), PRINTER))
    write_model(folder / "printers" / key / "printer.mend.json", model)
    return model.digest


def test_a_paired_host_has_the_model_and_each_newer_one(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "host").mkdir()
    model = tmp_path / "host" / "printer.mend.json"
    with _served(folder) as (address, token):
        studio = Studio(address, token=token)
        key = studio.post("/printers", {"preset": "ender3", "name": "Cellar"})["id"]
        first = _learn(folder, key, 0.2)

        def say(*words: str, code: int = 0) -> str:
            done = CliRunner().invoke(group, ["pair", *words, "-m", str(model)])
            assert done.exit_code == code, done.output
            return done.output

        digits = studio.post(f"/printers/{key}/pair")["code"]
        assert "'Cellar'" in say(address, digits, "--name", "voron")
        assert read_model(str(model)).digest == first
        assert pair_file(model).stat().st_mode & 0o077 == 0
        assert "the newest already" in say("--update")
        second = _learn(folder, key, 0.4)
        assert "now the newest" in say("--update")
        assert read_model(str(model)).digest == second
        model.write_text("{")  # damaged: it is fetched anew
        say("--update")
        assert read_model(str(model)).digest == second
        with pytest.raises(StudioError, match="six digits"):  # a code is good once
            client.pair(model, address, digits, "other")
        kept = json.loads(pair_file(model).read_text())
        with pytest.raises(StudioError, match="needs its token"):  # it opens nothing else
            Studio(address, token=kept["token"]).get("/printers")
        assert [one["name"] for one in studio.get(f"/printers/{key}/pairs")] == ["voron"]
        assert kept["token"] not in (folder / "printers" / key / "pairs.json").read_text()
        pairing.part(folder / "printers" / key, "voron")
        with pytest.raises(StudioError, match="not paired"):
            client.update(model)
        assert read_model(str(model)).digest == second  # what it has stays
    pair_file(model).unlink()
    with pytest.raises(InputError, match="paired with a studio"):
        client.update(model)


def test_the_terminal_says_why_a_studio_does_not_answer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["printmend", "pair", "http://127.0.0.1:1", "123456", "-m", str(tmp_path / "m")])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    told = "http://127.0.0.1:1: expected a studio, found no answer; start it there with `printmend studio`, or correct"
    assert capsys.readouterr().err == f"printmend: {told} the address\n"


def test_what_a_studio_answers_is_known_in_german(folder: Path) -> None:
    with _served(folder) as (address, token):
        studio = Studio(address, token=token)
        for asked, words in (
            (lambda: Studio(address).get("/printers"), "Dieses Studio braucht sein Token"),
            (lambda: studio.get("/jobs/" + "0" * 16), "erwartet: ein Auftrag dieses Studios"),
            (lambda: Studio(address).fetch_model(folder / "m"), "Dieser Rechner ist nicht gekoppelt"),
        ):
            with pytest.raises(StudioError) as refused:
                asked()
            assert words in translated(refused.value.message, GERMAN)
    todo = "Es dort mit `printmend studio` starten oder die Adresse berichtigen"
    for where, words in (
        (address, f"erwartet: ein Studio; gefunden: keine Antwort. {todo}"),
        ("http://nobody.invalid", f"gefunden: ein unbekannter Name. {todo}"),
    ):
        with pytest.raises(StudioError) as refused:
            Studio(where).get("/printers")
        assert translated(refused.value.message, GERMAN).endswith(words)


def test_no_code_can_be_guessed_and_none_is_good_for_long(monkeypatch: pytest.MonkeyPatch) -> None:
    codes = pairing.Codes()
    good = codes.make("a" * 16)
    wrong = next(f"{n:06d}" for n in range(2) if f"{n:06d}" != good)
    for _ in range(pairing.MOST_WRONG):
        with pytest.raises(InputError):
            codes.take(wrong)
    with pytest.raises(InputError):
        codes.take(good)
    older, newer = codes.make("a" * 16), codes.make("a" * 16)
    if older != newer:
        with pytest.raises(InputError):
            codes.take(older)
    assert codes.take(newer) == "a" * 16
    late = codes.make("b" * 16)
    now_s = time.monotonic()
    monkeypatch.setattr(time, "monotonic", lambda: now_s + pairing.CODE_S + 1)
    with pytest.raises(InputError):
        codes.take(late)


def test_a_body_that_drips_in_is_ended(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guard, "_BODY_S", 0.4)
    with _served(folder) as (address, token):
        begun_s = time.monotonic()
        with socket.create_connection(("127.0.0.1", int(address.rpartition(":")[2])), timeout=10) as asker:
            host, kind = address.removeprefix("http://"), "Content-Type: application/json\r\nContent-Length: 1000"
            head = (
                f"POST /api/v1/play/preview HTTP/1.1\r\nHost: {host}\r\nAuthorization: Bearer {token}\r\n{kind}\r\n\r\n"
            )
            asker.sendall(head.encode())
            answer = b""
            asker.settimeout(0.05)
            while time.monotonic() - begun_s < 8:
                with contextlib.suppress(TimeoutError):
                    answer = asker.recv(1000)
                    break
                asker.sendall(b" ")
        assert answer == b"" or answer.startswith(b"HTTP/1.1 400")
        assert time.monotonic() - begun_s < 7
