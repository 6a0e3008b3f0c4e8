"""The generated clients, Python and TypeScript, talk to a running studio: a printer, its test print, a mended file."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from parts import part
from studio_server import Server

from printmend.client import Studio
from printmend.corruption import Corruption, Drive, Play
from printmend.model.model import exact_model, write_model
from printmend.printer import read_printer

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tools" / "clients"))
import make_clients

ENDER3 = read_printer("ender3")
IN_TYPESCRIPT = """\
import { readFileSync } from "node:fs";
import { studio } from "./dist/client.js";
const [address, printer, source] = process.argv.slice(2);
const client = studio(address);
const sent = {
  params: { query: { name: "part.gcode" } }, body: readFileSync(source), bodySerializer: (body) => body,
  headers: { "Content-Type": "application/octet-stream" },
};
const { data: upload } = await client.POST("/api/v1/uploads", sent);
const { data: health } = await client.GET("/api/v1/health");
const of = (key) => ({ params: { path: { key } } });
const { data: known } = await client.GET("/api/v1/printers/{key}", of(printer));
const body = { upload: upload.id, force: false, scene: false };
const { data: job } = await client.POST("/api/v1/printers/{key}/mend", { ...of(printer), body });
const { error, response } = await client.GET("/api/v1/jobs/{key}", of("0000000000000000"));
console.log(JSON.stringify({ health, name: known.name, kind: job.kind, status: response.status, error }));
"""
IN_PYTHON = """\
import io, json, sys, time
from printmend_studio import Client
from printmend_studio.api.files import files_upload
from printmend_studio.api.jobs import jobs_get
from printmend_studio.api.printers import printers_list, printers_mend
from printmend_studio.models.mend_in import MendIn
from printmend_studio.types import File
address, printer, source = sys.argv[1:]
client = Client(base_url=address)
names = [one.name for one in printers_list.sync(client=client)]
sent = File(payload=open(source, "rb"), file_name="part.gcode")
upload = files_upload.sync(client=client, body=sent, name="part.gcode")
job = printers_mend.sync(printer, client=client, body=MendIn(upload=upload.id, scene=False))
while job.state not in ("done", "failed", "cancelled"):
    time.sleep(0.1)
    job = jobs_get.sync(job.id, client=client)
told = job.result.to_dict()["prediction"]
status = jobs_get.sync_detailed("0" * 16, client=client).status_code
print(json.dumps({"state": job.state, "names": names, "status": status,
                  "before_mm": told["before"]["rms_mm"], "after_mm": told["after"]["rms_mm"]}))
"""


@pytest.fixture(scope="module")
def clients(tmp_path_factory: pytest.TempPathFactory) -> Path:
    if not make_clients.GENERATOR.is_file() or shutil.which("npm") is None:
        pytest.skip("needs `make hosts` and npm")
    folder = tmp_path_factory.mktemp("clients")
    make_clients.make(folder)
    return folder


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory):
    server = Server(tmp_path_factory.mktemp("studio") / "studio")
    yield server
    server.stop()


@pytest.fixture(scope="module")
def printer(server: Server) -> str:
    """A printer of the studio that has been learned."""
    key = str(Studio(server.address).post("/printers", {"preset": "ender3", "name": "By a client"})["id"])
    model = exact_model(Corruption((Drive(belt=Play(0.4)), Drive())).lower(ENDER3))
    write_model(server.folder / "printers" / key / "printer.mend.json", model)
    return key


def _said(command: list, folder: Path, **more: str) -> dict:
    done = subprocess.run(  # noqa: S603 - ours
        list(map(str, command)), cwd=folder, check=False, capture_output=True, text=True, timeout=300,
        env={**os.environ, **more},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_the_python_client_sends_a_file_and_has_it_mended(clients: Path, server: Server, printer: str) -> None:
    (source := clients / "part.gcode").write_bytes(part(1))
    (clients / "use.py").write_text(IN_PYTHON)
    python = make_clients.GENERATOR.with_name("python")  # the client needs httpx and attrs, which are there
    command = [python, "use.py", server.address.rstrip("/"), printer, source]
    told = _said(command, clients, PYTHONPATH=str(clients / "python"))
    assert (told["state"], told["status"]) == ("done", 404)
    assert "By a client" in told["names"]
    assert told["after_mm"] < told["before_mm"]


def test_the_typescript_client_does_the_same(clients: Path, server: Server, printer: str) -> None:
    folder = clients / "typescript"
    (folder / "use.mjs").write_text(IN_TYPESCRIPT)
    (source := clients / "part.gcode").write_bytes(part(1))
    told = _said(["node", "use.mjs", server.address.rstrip("/"), printer, source], folder)
    assert (told["name"], told["kind"], told["status"]) == ("By a client", "mend", 404)
    assert told["health"]["version"]
    wrong = 'import { studio } from "./client.js";\nawait studio("").GET("/api/v1/no-such-path");\n'
    (folder / "wrong.ts").write_text(wrong)
    strictly = ["--noEmit", "--strict", "--module", "nodenext", "--target", "es2022", "wrong.ts"]
    checked = [str(folder / "node_modules/.bin/tsc"), *strictly]
    failed = subprocess.run(checked, cwd=folder, check=False, capture_output=True, text=True)  # noqa: S603 - the lock file's
    assert failed.returncode != 0
    assert "wrong.ts(2," in failed.stdout
