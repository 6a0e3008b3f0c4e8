"""Who comes into the studio from other computers, and what keeps others from coming in."""

import getpass
import http.client
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
from pathlib import Path
from xml.etree import ElementTree

import pytest
import uvicorn
from click.testing import CliRunner
from httpx2 import Response
from starlette.testclient import TestClient

from printmend.cli.main import group
from printmend.cli.studio import usual_folder
from printmend.errors import InputError
from printmend.studio import guard
from printmend.studio.app import create_app
from printmend.studio.devices import Devices
from printmend.studio.serve import serve
from printmend.studio.service import service, write_service
from printmend.studio.store import Store

HERE = "http://127.0.0.1:8765"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "studio").mkdir()
    return tmp_path / "studio"


def test_a_token_is_asked_for_and_kept_as_a_cookie_that_scripts_cannot_read(folder: Path) -> None:
    devices = Devices(folder)
    token, other = devices.add("phone"), devices.add("laptop")
    with TestClient(create_app(folder, workers=1, devices=devices), base_url=HERE) as client:
        assert client.get("/").status_code == client.get("/api/health").status_code == 401
        assert client.get("/api/health", headers={"authorization": "Bearer wrong"}).status_code == 401
        assert client.get("/api/health", headers={"authorization": f"Bearer {token}"}).status_code == 200
        come = client.get("/", params={"token": token})
        assert come.status_code == 200
        assert "HttpOnly; SameSite=Strict" in come.headers["set-cookie"]
        assert client.get("/api/health").status_code == 200  # the browser sends the cookie now
        Devices(folder).revoke("Phone")  # by another program, while the studio runs
        assert client.get("/api/health").status_code == 401
        assert client.get("/api/health", headers={"authorization": f"Bearer {other}"}).status_code == 200


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
            answers.extend(client.get("/api/printers", headers=h).status_code for h in ({}, headers))
        sockets[0].close()

    monkeypatch.setattr(uvicorn.Server, "run", run)
    serve(folder, host="127.0.0.1", port=0, names=names, browser=False, told=told.append)
    assert answers == [401 if asks else 200, 200]


def test_an_address_that_the_computer_got_later_is_answered_to(folder: Path) -> None:
    """A lease may change over the years; a name that leads here is another site's, whatever address it led to."""
    app, new = create_app(folder, workers=1, devices=Devices(folder)), "192.168.7.9"
    token = {"authorization": f"Bearer {Devices(folder).add('phone')}"}
    with TestClient(app, base_url=f"http://{new}:8765") as client:
        assert client.get("/api/health", headers=token).status_code == 200
        for host in ("192.168.7.8", f"{new}.evil.example", "evil.example"):
            assert client.get("/api/health", headers={**token, "host": host}).status_code == 421, host
    with TestClient(app, base_url="http://evil.example") as client:
        assert client.get("/api/health", headers=token).status_code == 421


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


def test_everything_is_kept_where_the_system_has_users_data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.delenv("XDG_DATA_HOME", raising=False)
    assert usual_folder() == tmp_path / ".local/share/printmend/studio"
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    assert usual_folder() == tmp_path / "data/printmend/studio"
    assert CliRunner().invoke(group, ["studio", "--devices"]).exit_code == 0
    assert usual_folder().stat().st_mode & 0o077 == 0


def test_the_api_describes_itself_in_openapi_and_has_a_name_that_stays(folder: Path) -> None:
    with TestClient(create_app(folder, workers=1), base_url=HERE) as client:
        assert client.get("/api/v1/health").json() == client.get("/api/health").json()
        assert client.get("/api/v1/absent").status_code == client.get("/api/absent").status_code == 404
        for _ in range(2):
            document = client.get("/api/v1/openapi.json").json()
            assert document["openapi"] == "3.1.0"
            assert "itemSchema" not in str(document)
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


def test_connections_that_ask_for_nothing_keep_nobody_out(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guard, "ASK_S", 0.5)
    app = create_app(folder, workers=1)
    server = uvicorn.Server(
        uvicorn.Config(app, port=0, log_level="error", ws="none", http=guard.Door, limit_concurrency=50)
    )
    thread = threading.Thread(target=server.run)
    thread.start()
    silent: list[socket.socket] = []
    try:
        while not server.started:
            time.sleep(0.02)
        place = server.servers[0].sockets[0].getsockname()
        for k in range(2 * guard.MOST_SILENT):
            silent.append(socket.create_connection(place))
            if k % 2:
                silent[-1].sendall(b"GET /api/health HTTP/1.1\r\nHost: 127.0.0.1\r\nX-More: ")

        def ended() -> int:
            """Count those that the server has ended."""
            for one in silent:
                one.settimeout(5)
            return sum(_is_ended(one) for one in silent)

        assert ended() == len(silent)  # some at once, the others after the time to ask
        asking = http.client.HTTPConnection(*place, timeout=5)
        for _ in range(2):  # a second request on a connection, too, and then half of one
            asking.request("GET", "/api/health")
            answer = asking.getresponse()
            assert (answer.status, b"version" in answer.read()) == (200, True)
        asking.sock.sendall(b"GET /api/hea")
        silent.append(asking.sock)
        assert _is_ended(asking.sock)
        assert not guard.Door._silent
    finally:
        server.should_exit = True
        thread.join()
        for one in silent:
            one.close()


def _is_ended(link: socket.socket) -> bool:
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
    with TestClient(create_app(folder, workers=1, devices=devices), base_url=HERE) as client:
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
        assert client.get("/app.js").status_code == client.get("/api/openapi.json").status_code == 401
        assert client.get("/", params={"token": token}, headers=page).status_code == 200
        assert client.get("/", headers=page).status_code == 200  # by its cookie
    with TestClient(create_app(folder, workers=1, devices=devices), base_url="https://127.0.0.1") as client:
        assert client.get("/", params={"token": token}).headers["set-cookie"].endswith("; Secure")


def test_users_see_their_own_printers_and_everybodys(folder: Path) -> None:
    devices = Devices(folder)
    tokens = {"desk": devices.add("desk"), "anna": devices.add("phone", "Anna"), "ben": devices.add("tablet", "Ben")}
    with TestClient(create_app(folder, workers=1, devices=devices), base_url=HERE) as client:

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


def test_a_device_is_let_in_by_a_code(folder: Path) -> None:
    pytest.importorskip("segno", reason="needs segno, of the extra studio")
    devices = Devices(folder)
    token = devices.add("desk")
    with TestClient(create_app(folder, workers=1, devices=devices), base_url=HERE) as client:
        client.headers["authorization"] = f"Bearer {token}"
        fresh = client.post("/api/devices", json={"name": "phone"}).json()
        assert fresh["address"].startswith(f"{HERE}/?token=")
        assert fresh["qr"].startswith("data:image/svg+xml")
        assert devices.user_of(fresh["address"].partition("token=")[2]) is not None
        assert client.post("/api/devices", json={"name": "phone"}).status_code == 400
        assert client.delete("/api/devices/phone").status_code == 204
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
    store = Store(folder)
    assert [row["name"] for row in store.of("Anna").printers()] == ["old one"]
    store.close()
