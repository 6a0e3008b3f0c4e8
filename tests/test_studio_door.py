"""Who comes into the studio from other computers, and what keeps others from coming in."""

import contextlib
import getpass
import http.client
import os
import plistlib
import re
import shlex
import shutil
import socket
import sqlite3
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from xml.etree import ElementTree

import pytest
import uvicorn
from click.testing import CliRunner
from httpx2 import Response
from starlette.testclient import TestClient

from printmend.cli.main import group
from printmend.corruption import Corruption, Drive, Play
from printmend.errors import InputError
from printmend.messages import GERMAN, restored, translated
from printmend.model import exact_model, write_model
from printmend.printer import read_printer
from printmend.studio import guard
from printmend.studio import serve as serving
from printmend.studio import store as quota
from printmend.studio.app import create_app
from printmend.studio.devices import Devices
from printmend.studio.jobs import Jobs
from printmend.studio.places import ADDRESS, Places
from printmend.studio.serve import serve, service, write_service
from printmend.studio.store import Store
from tests.mending import coarsely

HERE = "http://127.0.0.1:8765"
PART = "G28\nG90\nM83\nG1 Z0.2 F3000\nG1 X60 Y60\n" + "G1 X110 Y60 E2\nG1 Y100 E2\nG1 X60 E2\nG1 Y60 E2\n" * 3


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "studio").mkdir()
    return tmp_path / "studio"


def test_a_token_is_asked_for_and_kept_as_a_cookie_that_scripts_cannot_read(folder: Path) -> None:
    devices = Devices(folder)
    token, other = devices.add("phone"), devices.add("laptop")
    with TestClient(create_app(Places.below(folder), workers=1, devices=devices), base_url=HERE) as client:
        assert client.get("/").status_code == client.get("/api/v1/health").status_code == 401
        assert client.get("/api/v1/health", headers={"authorization": "Bearer wrong"}).status_code == 401
        assert client.get("/api/v1/health", headers={"authorization": f"Bearer {token}"}).status_code == 200
        come = client.get("/", params={"token": token})
        assert come.status_code == 200
        assert "HttpOnly; SameSite=Strict" in come.headers["set-cookie"]
        assert client.get("/api/v1/health").status_code == 200  # the browser sends the cookie now
        Devices(folder).revoke("Phone")  # by another program, while the studio runs
        assert client.get("/api/v1/health").status_code == 401
        assert client.get("/api/v1/health", headers={"authorization": f"Bearer {other}"}).status_code == 200


def test_a_folder_of_devices_holds_no_token_and_is_its_owners_alone(folder: Path) -> None:
    token = Devices(folder).add("phone")
    kept = folder / "devices.json"
    assert token not in kept.read_text()
    assert kept.stat().st_mode & 0o077 == 0
    assert Devices(folder).user_of(token) is not None  # after a restart
    Devices(folder).add(" tv\n")  # blanks around a name are not part of it
    assert [one.name for one in Devices(folder).known()] == ["phone", "tv"]
    for call, name, words in (
        ("add", "PHONE", "one of that name"),
        ("add", " ", "a name"),
        ("add", "../x", "without slashes"),  # no address could revoke it
        ("add", "a\\b", "without slashes"),
        ("add", "..", "not of dots alone"),
        ("revoke", "pc", "phone, tv"),
    ):
        with pytest.raises(InputError, match=words):
            getattr(Devices(folder), call)(name)
    kept.write_text("{")
    with pytest.raises(InputError, match="another file"):
        Devices(folder).known()


@pytest.mark.parametrize(("names", "asks"), [((), False), (("studio.example",), True)])
def test_a_studio_behind_a_proxy_asks_for_a_token(
    names: tuple[str, ...], asks: bool, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What a proxy on this computer passes on comes from this computer, whoever sent it."""
    told: list[str] = []
    answers = []

    def run(server: uvicorn.Server, sockets: list[socket.socket]) -> None:
        with TestClient(server.config.app, base_url=HERE) as client:
            token = told[0].partition("token=")[2].partition(" ")[0]
            headers = {"Authorization": f"Bearer {token}", "Host": names[0] if names else "127.0.0.1"}
            answers.extend(client.get("/api/v1/printers", headers=h).status_code for h in ({}, headers))
        sockets[0].close()

    monkeypatch.setattr(uvicorn.Server, "run", run)
    serve(Places.below(folder), host="127.0.0.1", port=0, names=names, browser=False, told=told.append)
    assert answers == [401 if asks else 200, 200]


def test_an_address_that_the_computer_got_later_is_answered_to(folder: Path) -> None:
    """A lease may change over the years; a name that leads here is another site's, whatever address it led to."""
    app, new = create_app(Places.below(folder), workers=1, devices=Devices(folder)), "192.168.7.9"
    token = {"authorization": f"Bearer {Devices(folder).add('phone')}"}
    with TestClient(app, base_url=f"http://{new}:8765") as client:
        assert client.get("/api/v1/health", headers=token).status_code == 200
        for host in ("192.168.7.8", f"{new}.evil.example", "evil.example"):
            assert client.get("/api/v1/health", headers={**token, "host": host}).status_code == 421, host
    with TestClient(app, base_url="http://evil.example") as client:
        assert client.get("/api/v1/health", headers=token).status_code == 421


@pytest.mark.parametrize(
    ("host", "names", "wanted"),
    [("workshop", (), "http://workshop:{port}/"), ("127.0.0.1", ("studio.example",), "https://studio.example/")],
)
def test_a_devices_address_is_that_of_the_studio_that_runs(
    host: str, names: tuple[str, ...], wanted: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not of one with the usual port, nor, behind a proxy, of the port that nobody else comes to."""
    listened: list[int] = []

    def listener(host: str, port: int) -> socket.socket:
        made = socket.create_server(("127.0.0.1", port))
        listened.append(made.getsockname()[1])
        return made

    def run(server: uvicorn.Server, sockets: list[socket.socket]) -> None:
        sockets[0].close()
        told.append(_told("--folder", str(folder), "--device", "phone"))
        told.append(_told("--folder", str(folder), "--device", "tablet", "--port", "9000", "--host", "attic"))

    told: list[str] = []
    monkeypatch.setattr(serving, "_listener", listener)
    monkeypatch.setattr(uvicorn.Server, "run", run)
    for _ in range(2):  # another port each time
        told.clear()
        serve(Places.below(folder), host=host, port=0, names=names, browser=False, told=lambda _: None)
        assert told[0].startswith("phone: " + wanted.format(port=listened[-1]) + "?token=")
        assert told[1].startswith("tablet: http://attic:9000/?token=")
        for name in ("phone", "tablet"):
            Devices(folder).revoke(name)
    serve(Places.below(folder), host="127.0.0.1", port=0, browser=False, told=lambda _: None)  # for nobody else
    assert told[2].startswith("phone: http://")
    assert ":8765/?token=" in told[2]


@pytest.mark.parametrize("asked", ["127.0.0.1", "workshop"])
def test_who_sits_at_the_studio_is_shown_an_address_that_others_reach(asked: str, folder: Path) -> None:
    """A phone that scans the code of 127.0.0.1 would look for a studio in itself."""
    pytest.importorskip("segno", reason="needs segno, of the extra studio")
    (token, places) = Devices(folder).add("desk"), Places.below(folder)
    (folder / ADDRESS).write_text('{"host": "attic", "port": 9000, "names": []}')
    app = create_app(places, workers=1, devices=Devices(folder), hosts=["127.0.0.1", "workshop"])
    headers, wanted = {"authorization": f"Bearer {token}"}, "attic:9000" if asked == "127.0.0.1" else "workshop:8765"
    with TestClient(app, base_url=f"http://{asked}:8765", headers=headers) as client:
        phone = client.post("/api/v1/devices", json={"name": "phone"}).json()["address"]
        key = client.post("/api/v1/printers", json={"preset": "ender3", "name": "Cellar"}).json()["id"]
        host = client.post(f"/api/v1/printers/{key}/pair").json()["address"]
    assert phone.startswith(f"http://{wanted}/?token=")
    assert host == f"http://{wanted}"


def test_devices_are_let_in_and_revoked_by_name(folder: Path) -> None:
    def say(*more: str) -> str:
        done = CliRunner().invoke(group, ["studio", "--folder", str(folder), *more])
        assert done.exit_code == 0, done.output
        return done.stdout

    address = say("--device", "phone", "--host", "workshop", "--port", "9000")
    assert address.startswith("phone: http://workshop:9000/?token=")
    assert Devices(folder).user_of(address.strip().partition("token=")[2]) is not None
    assert say("--devices").startswith("phone, since 20")
    say("--revoke", "phone")
    assert say("--devices") == ""


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A user's home, whose programs keep their things where XDG says."""
    monkeypatch.setenv("HOME", str(tmp_path))
    for kind in ("DATA", "STATE", "CACHE", "CONFIG"):
        monkeypatch.delenv(f"XDG_{kind}_HOME", raising=False)
    return tmp_path


def _told(*options: str) -> str:
    done = CliRunner().invoke(group, ["studio", *options])
    assert done.exit_code == 0, done.output
    return done.stdout


linux = pytest.mark.skipif(sys.platform != "linux", reason="XDG is for Linux")


@linux
def test_data_notes_and_pictures_are_kept_where_the_system_has_each(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    places = [home / ".local" / kind / "printmend/studio" for kind in ("share", "state")]
    assert Places.usual() == Places(*places, home / ".cache/printmend/studio")
    for kind in ("data", "state", "cache"):
        monkeypatch.setenv(f"XDG_{kind.upper()}_HOME", str(home / kind))
    assert Places.usual() == Places(*(home / kind / "printmend/studio" for kind in ("data", "state", "cache")))
    _told("--device", "phone")
    assert (home / "state/printmend/studio/devices.json").is_file()
    with TestClient(create_app(Places.usual(), workers=1), base_url=HERE) as client:
        key = client.post("/api/v1/printers", json={"preset": "ender3"}).json()["id"]
        model = exact_model(coarsely(Corruption((Drive(belt=Play(0.3)), Drive()))))
        write_model(home / "data/printmend/studio/printers" / key / "printer.mend.json", model)
        sent = client.post("/api/v1/uploads?name=a.gcode", content=PART).json()["id"]
        job = client.post(f"/api/v1/printers/{key}/mend", json={"upload": sent, "scene": True}).json()["id"]
        while (told := client.get(f"/api/v1/jobs/{job}").json())["state"] not in ("done", "failed"):
            time.sleep(0.05)
        assert told["state"] == "done", told
        kept = {kind: {path.name for path in (home / kind).rglob(f"jobs/{job}/*")} for kind in ("data", "cache")}
        assert kept["cache"] == {"thumb.svg", "printed.bin", "mended.bin"} <= set(told["files"])
        assert "a.mended.gcode" in kept["data"]
        assert not kept["data"] & kept["cache"]
        assert client.get(f"/api/v1/jobs/{job}/files/thumb.svg").status_code == 200
        shown = next(one for one in client.get("/api/v1/storage").json()["parts"] if one["part"] == "mended")
        assert shown["shown"] == [f"/api/v1/jobs/{job}/files/thumb.svg"]
        assert shown["bytes"] > sum(path.stat().st_size for path in (home / "cache").rglob("*.bin"))
        shutil.rmtree(home / "cache/printmend")  # whoever empties a cache loses pictures, and nothing else
        assert client.get(f"/api/v1/jobs/{job}").json()["files"] == ["a.mended.gcode"]
        assert client.get(f"/api/v1/jobs/{job}/files/thumb.svg").status_code == 404
        assert client.get(f"/api/v1/jobs/{job}/files/a.mended.gcode").status_code == 200
        assert client.delete(f"/api/v1/jobs/{job}").status_code == 204
        assert not list(home.rglob(job))
    shutil.rmtree(home / "state")  # nor are printers lost with the notes
    (store := Store(Places.usual())).close()
    assert [(row["id"], row["name"]) for row in store.printers()] == [(key, read_printer("ender3").name)]


@linux
def test_a_folder_of_before_is_used_as_it_is(home: Path) -> None:
    before = Places.below(home / ".local/share/printmend/studio")
    store = Store(before)
    store.add_printer("Old one", usually="")
    (store.path("job", job := store.add_job("play", None, {}))).mkdir()
    (store.path("job", job) / "thumb.svg").write_text("picture")  # beside the other files, as it was then
    store.end_job(job, "done", result={"files": ["thumb.svg"]})
    store.close()
    Devices(before.state).add("phone")
    assert Places.usual() == Places(before.data, before.data, home / ".cache/printmend/studio")
    assert _told("--devices").startswith("phone, since 20")
    with TestClient(create_app(Places.usual(), workers=1), base_url=HERE) as client:
        assert client.get(f"/api/v1/jobs/{job}/files/thumb.svg").text == "picture"
        assert client.get(f"/api/v1/jobs/{job}").json()["files"] == ["thumb.svg"]
        assert client.get("/api/v1/health").json()["waiting"] == 0
    assert [row["name"] for row in store.printers()] == ["Old one"]
    assert not (home / ".local/state").exists()


def test_what_is_kept_is_its_owners_alone(folder: Path) -> None:
    (folder / "printers").mkdir()
    (folder / "studio.sqlite").touch()
    for path in (folder, folder / "printers", folder / "studio.sqlite"):  # as earlier versions made them
        path.chmod(0o755)
    assert _told("--folder", str(folder), "--device", "phone").count("\n") == 1
    serving._alone(folder).close()
    (store := Store(Places.below(folder))).add_printer("one", usually="")
    modes = {path.name: path.stat().st_mode & 0o777 for path in (folder, *folder.iterdir())}
    store.close()
    files = {"studio.sqlite", "studio.sqlite-wal", "studio.sqlite-shm", "studio.lock", "devices.json"}
    assert {name: mode for name, mode in modes.items() if mode != 0o700} == dict.fromkeys(files, 0o600)
    assert set(modes) == {folder.name, "printers", "uploads", "jobs", *files}


def test_a_folder_with_other_things_stays_open_and_what_cannot_be_closed_is_said(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / "letter.txt").touch()
    folder.chmod(0o755)
    assert _told("--folder", str(folder), "--devices") == ""
    assert folder.stat().st_mode & 0o777 == 0o755
    (folder / "jobs").chmod(0o755)

    def refuse(*_: object) -> None:
        raise PermissionError

    monkeypatch.setattr(Path, "chmod", refuse)  # of somebody else, or on a drive that knows no rights
    told = _told("--folder", str(folder), "--devices")
    assert (
        told == f"Others on this computer may still read {folder / 'jobs'}: the system does not let that be changed.\n"
    )
    (folder / "file").touch()
    with pytest.raises(InputError, match="expected a folder that can be written to"):
        Places.below(folder / "file/below").make()


def test_the_api_describes_itself_in_openapi_and_has_a_name_that_stays(folder: Path) -> None:
    with TestClient(create_app(Places.below(folder), workers=1), base_url=HERE) as client:
        assert client.get("/api/v1/health").json() == client.get("/api/health").json()  # of before
        assert client.get("/api/v1/absent").status_code == client.get("/api/absent").status_code == 404
        for _ in range(2):
            document = client.get("/api/v1/openapi.json").json()
            assert document["openapi"] == "3.1.0"
            assert "itemSchema" not in str(document)
        assert {path[: len("/api/v1/")] for path in document["paths"]} == {"/api/v1/"}
        ids = [one["operationId"] for operations in document["paths"].values() for one in operations.values()]
        assert {
            "jobs_list",
            "jobs_cancel",
            "printers_add",
            "printers_get",
            "files_upload",
            "play_start",
            "studio_health",
        } <= set(ids)
        assert all(re.fullmatch(r"[a-z]+(_[a-z]+)+", one) for one in ids)
        assert document["components"]["securitySchemes"]["token"]["scheme"] == "bearer"


@contextlib.contextmanager
def _listening(folder: Path, early: Callable[[tuple], object] = lambda place: None) -> Iterator[tuple[str, int]]:
    """Run a studio and say where; ``early`` happens while nobody yet takes the connections that wait."""
    app = create_app(Places.below(folder), workers=1)
    config = uvicorn.Config(app, log_level="error", ws="none", http=guard.Door, limit_concurrency=50)
    server = uvicorn.Server(config)
    with socket.create_server(("127.0.0.1", 0), backlog=100) as door:
        place = door.getsockname()
        early(place)
        thread = threading.Thread(target=server.run, args=([door],))
        thread.start()
        try:
            while not server.started:
                time.sleep(0.02)
            yield place
        finally:
            server.should_exit = True
            thread.join()


def test_all_who_come_at_once_are_answered(folder: Path) -> None:
    """Though their connections are made before a word of them is read."""
    ask = b"GET /api/v1/health HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n"
    links: list[socket.socket] = []

    def come(place: tuple) -> None:
        for _ in range(45):
            links.append(socket.create_connection(place, timeout=60))
            links[-1].sendall(ask)

    with _listening(folder, come):
        answers = [link.recv(65536) for link in links]
        assert [answer[:12] for answer in answers] == [b"HTTP/1.1 200"] * 45
    for link in links:
        link.close()


def test_connections_that_ask_for_nothing_keep_nobody_out(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not even others of their own address: while it has its most, the longest silent one gives way."""
    monkeypatch.setattr(guard, "MOST_AN_ADDRESS", 20)
    monkeypatch.setattr(guard, "ASK_S", 0.5)
    silent: list[socket.socket] = []
    with _listening(folder) as place:
        for k in range(60):
            silent.append(socket.create_connection(place))
            if k % 2:
                silent[-1].sendall(b"GET /api/v1/health HTTP/1.1\r\nHost: 127.0.0.1\r\nX-More: ")
        asking = http.client.HTTPConnection(*place, timeout=60)
        for _ in range(2):  # a second request on a connection, too, and then half of one
            asking.request("GET", "/api/v1/health")
            answer = asking.getresponse()
            assert (answer.status, b"version" in answer.read()) == (200, True)
        asking.sock.sendall(b"GET /api/v1/hea")
        assert all(map(_is_ended, [*silent, asking.sock]))  # some at once, the others after the time to ask
        assert not guard.Door._silent
    for link in (*silent, asking):
        link.close()


def _is_ended(link: socket.socket) -> bool:
    link.settimeout(60)
    try:
        while link.recv(65536):
            pass
    except ConnectionError:
        pass
    except TimeoutError:
        return False
    return True


def test_a_browser_without_a_token_is_shown_a_page_that_asks_for_one(folder: Path) -> None:
    devices = Devices(folder)
    token = devices.add("phone")
    with TestClient(create_app(Places.below(folder), workers=1, devices=devices), base_url=HERE) as client:
        page = {"accept": "text/html,*/*"}
        asked = client.get("/", headers=page)
        assert asked.status_code == 401
        assert '<input name="token"' in asked.text
        assert 'role="alert" hidden' in asked.text
        assert "form-action 'self'" in asked.headers["content-security-policy"]
        wrong = client.get("/?token=guess", headers=page)
        assert wrong.status_code == 401
        assert 'role="alert" hidden' not in wrong.text
        for part in ("/style.css", "/icon.svg"):
            assert client.get(part).status_code == 200
        assert client.get("/app.js").status_code == client.get("/api/v1/openapi.json").status_code == 401
        assert client.get("/", params={"token": token}, headers=page).status_code == 200
        assert client.get("/", headers=page).status_code == 200  # by its cookie
    with TestClient(
        create_app(Places.below(folder), workers=1, devices=devices), base_url="https://127.0.0.1"
    ) as client:
        assert client.get("/", params={"token": token}).headers["set-cookie"].endswith("; Secure")


def test_users_see_their_own_printers_and_everybodys(folder: Path) -> None:
    devices = Devices(folder)
    tokens = {"desk": devices.add("desk"), "anna": devices.add("phone", "Anna"), "ben": devices.add("tablet", "Ben")}
    with TestClient(create_app(Places.below(folder), workers=1, devices=devices), base_url=HERE) as client:

        def ask(who: str, method: str, path: str, **more: object) -> Response:
            headers = {"authorization": f"Bearer {tokens[who]}"}
            return client.request(method, f"/api{path}", headers=headers, **more)  # type: ignore[arg-type]

        made = {who: ask(who, "POST", "/printers", json={"preset": "ender3", "name": f"of {who}"}).json()["id"]
                for who in tokens}  # fmt: skip
        seen = {who: {one["name"] for one in ask(who, "GET", "/printers").json()} for who in tokens}
        assert seen == {"desk": {"of desk", "of anna", "of ben"}, "anna": {"of desk", "of anna"},
                        "ben": {"of desk", "of ben"}}  # fmt: skip
        assert ask("ben", "GET", f"/printers/{made['anna']}").status_code == 404
        assert ask("ben", "DELETE", f"/printers/{made['anna']}").status_code == 404
        sent = ask("anna", "POST", "/uploads?name=a.gcode", content=b"G28\n").json()["id"]
        assert ask("ben", "DELETE", f"/uploads/{sent}").status_code == 404
        assert ask("ben", "POST", f"/printers/{made['ben']}/learn", json={"upload": sent}).status_code == 404
        assert ask("ben", "GET", "/storage").json()["parts"][3]["count"] == 0
        assert ask("anna", "GET", "/devices").status_code == 409  # only who sees everything lets others in
        assert ask("desk", "GET", "/health").json()["shared"] > ask("anna", "GET", "/health").json()["shared"]
        assert [one["user"] for one in ask("desk", "GET", "/devices").json()] == ["", "Anna", "Ben"]


def test_one_user_fills_neither_the_disk_nor_the_queue(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 30 MB a user has half; who sees everything has them all, and of jobs as many as the studio takes."""
    devices = Devices(folder)
    tokens = {"desk": devices.add("desk"), "anna": devices.add("phone", "Anna"), "ben": devices.add("tablet", "Ben")}
    monkeypatch.setattr(Jobs, "_schedule", lambda *_: None)  # they wait
    monkeypatch.setattr(quota, "MOST_WAITING", 2)
    app = create_app(Places.below(folder), workers=1, devices=devices, most_held_bytes=30_000_000)
    with TestClient(app, base_url=HERE) as client:

        def ask(who: str, path: str, **more: object) -> Response:
            return client.post(f"/api/v1{path}", headers={"authorization": f"Bearer {tokens[who]}"}, **more)  # type: ignore[arg-type]

        for size, status in ((10_000_000, 201), (6_000_000, 400), (1_000_000, 201)):
            sent = ask("anna", "/uploads?name=a.gcode", content=b"G" * size)
            assert sent.status_code == status, size
            if status == 400:
                told = sent.json()["error"]
                assert (
                    told == "Anna: expected at most 0.015 GB of one user, found 0.0 GB; free some of it under Storage"
                )
                german = translated(restored(told, sent.json()["messages"]), GERMAN)
                assert german.endswith(
                    "höchstens 0,015 GB von einem Benutzer; gefunden: 0,0 GB. Unter Speicher etwas davon freigeben"
                )
        headers = {"authorization": f"Bearer {tokens['anna']}"}
        storage = client.get("/api/v1/storage", headers=headers).json()
        assert storage["most_bytes"] == 15_000_000
        assert sum(part["bytes"] for part in storage["parts"]) + storage["kept_bytes"] == 11_000_000
        assert ask("ben", "/uploads?name=b.gcode", content=b"G" * 6_000_000).status_code == 201
        assert ask("desk", "/uploads?name=c.gcode", content=b"G" * 6_000_000).status_code == 201
        assert (
            ask("desk", "/uploads?name=c.gcode", content=b"G" * 9_000_000).status_code == 400
        )  # the studio's own bound
        monkeypatch.setattr(quota, "SHARE", 1.0)
        assert [ask("anna", "/play", json={}).status_code for _ in range(3)] == [202, 202, 400]
        assert "expected fewer than 2 jobs of one user" in ask("anna", "/play", json={}).json()["error"]
        assert ask("ben", "/play", json={}).status_code == 202
        assert [ask("desk", "/play", json={}).status_code for _ in range(4)] == [202] * 4


def test_all_and_a_users_own_are_measured_in_one_walk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each folder is read once, wherever the system has it; a user's own are the jobs, pictures and files of theirs."""
    store = Store(Places(*(tmp_path / name for name in ("data", "state", "cache"))))
    for owner, size in (("Anna", 1000), ("Ben", 300), (None, 20)):
        store.of(owner).add_upload(key := f"upload-{owner}", "a.gcode", size)
        job = store.add_job("mend", None, {}, owner)
        for path in (store.path("upload", key), store.path("job", job) / "a", store.pictures(job) / "b"):
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(bytes(size))
    naive = sum(path.stat().st_size for path in tmp_path.rglob("*") if path.is_file())
    read, scan = [], os.scandir
    monkeypatch.setattr(os, "scandir", lambda path: (read.append(str(path)), scan(path))[1])
    for owner, own in (("Anna", 3000), ("Ben", 900), (None, naive)):
        read.clear()
        assert store.of(owner).held() == (naive, own)
        assert len(read) == len(set(read)) == 3 + 3 + 1 + 3 + 3  # the three, their parts, and a job's two folders


def test_a_device_is_let_in_by_a_code(folder: Path) -> None:
    pytest.importorskip("segno", reason="needs segno, of the extra studio")
    devices = Devices(folder)
    token = devices.add("desk")
    with TestClient(create_app(Places.below(folder), workers=1, devices=devices), base_url=HERE) as client:
        client.headers["authorization"] = f"Bearer {token}"
        fresh = client.post("/api/v1/devices", json={"name": "phone"}).json()
        assert "/?token=" in fresh["address"]
        assert fresh["qr"].startswith("data:image/svg+xml")
        assert devices.user_of(fresh["address"].partition("token=")[2]) is not None
        assert client.post("/api/v1/devices", json={"name": "phone"}).status_code == 400
        assert client.delete("/api/v1/devices/phone").status_code == 204
        assert devices.user_of(fresh["address"].partition("token=")[2]) is None


@pytest.mark.parametrize("platform", ["linux", "darwin", "win32"])
def test_a_service_starts_the_studio_as_it_was_asked_for(platform: str, tmp_path: Path) -> None:
    made = service(options := ["--folder", "/data/our % <studio> für uns"], platform=platform, home=tmp_path)
    assert made.path.is_relative_to(tmp_path)
    if platform == "linux":
        line = next(line for line in made.text.splitlines() if line.startswith("ExecStart="))
        words = shlex.split(line.removeprefix("ExecStart=").replace("%%", "%"))
    elif platform == "darwin":
        words = plistlib.loads(made.text.encode())["ProgramArguments"]
    else:
        names = {"": "http://schemas.microsoft.com/windows/2004/02/mit/task"}
        task = ElementTree.fromstring(made.text)  # noqa: S314 - our own
        said = {name: str(task.findtext(f".//{name}", namespaces=names)) for name in ("Command", "Arguments", "UserId")}
        words = [said["Command"], *shlex.split(said["Arguments"])]
        assert said["UserId"] == getpass.getuser()
        assert task.findtext(".//ExecutionTimeLimit", namespaces=names) == "PT0S"  # for ever
    assert words == [sys.executable, "-m", "printmend", "studio", "--no-browser", *options]
    with pytest.raises(InputError, match="without quotes"):
        service(["--name", 'a"b'], platform=platform, home=tmp_path)
    write_service(made)
    assert made.path.read_text() == made.text


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="needs systemd")
def test_systemd_understands_the_service(tmp_path: Path) -> None:
    def told(text: str) -> str:
        (unit := tmp_path / "printmend-studio.service").write_text(text)
        done = subprocess.run(  # noqa: S603
            [str(shutil.which("systemd-analyze")), "verify", "--user", str(unit)], check=False, capture_output=True,
            text=True, timeout=60, env={"XDG_RUNTIME_DIR": str(tmp_path), "HOME": str(tmp_path)},
        )  # fmt: skip
        return done.stderr + f"{done.returncode or ''}"

    made = service(["--folder", "/data/our % st$udio\\x", "--port", "8765"], platform="linux", home=tmp_path)
    assert told(made.text) == ""
    assert "restart specifier" in told(made.text.replace("on-failure", "sometimes"))
    assert "not executable" in told(made.text.replace(sys.executable, "/no/such/python"))


def test_a_studio_from_before_there_were_users_keeps_its_printers(folder: Path) -> None:
    with sqlite3.connect(folder / "studio.sqlite") as link:
        link.execute("CREATE TABLE printers (id VARCHAR PRIMARY KEY, name VARCHAR NOT NULL, created_s FLOAT NOT NULL)")
        link.execute("INSERT INTO printers VALUES ('0000000000000000', 'old one', 1.0)")
    link.close()
    store = Store(Places.below(folder))
    assert [row["name"] for row in store.of("Anna").printers()] == ["old one"]
    store.close()
