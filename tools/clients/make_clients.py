"""Generate the studio's clients from its OpenAPI: `make clients` writes the description, Python and TypeScript.

    python tools/clients/make_clients.py build/clients

FOLDER gets openapi.json; python/printmend_studio, a package by openapi-python-client (needs httpx and attrs); and
typescript/, the types by openapi-typescript with a client of openapi-fetch, as a package that npm installs.
"""

import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from starlette.testclient import TestClient

from printmend.studio.app import create_app
from printmend.studio.places import Places

HERE = Path(__file__).resolve().parent
GENERATOR = HERE.parents[1] / ".venv-hosts/clients/bin/openapi-python-client"
_CLIENT = """\
import createClient, { type ClientOptions } from "openapi-fetch";
import type { paths } from "./studio.js";

export type { components, paths } from "./studio.js";

/** A client of the studio at an address, as "http://workshop:8765"; its token where the studio wants one. */
export const studio = (baseUrl: string, token?: string, options: ClientOptions = {}) =>
  createClient<paths>({ baseUrl, headers: token ? { Authorization: `Bearer ${token}` } : {}, ...options });
"""


def description() -> dict[str, Any]:
    """Return what a studio says of its API."""
    with tempfile.TemporaryDirectory() as folder:
        client = TestClient(
            create_app(Places.below(Path(folder) / "studio"), workers=1), base_url="http://127.0.0.1:8765"
        )
        answer: dict[str, Any] = client.get("/api/v1/openapi.json").json()
    return answer


def make_python(document: Path, folder: Path) -> None:
    """Generate the Python package."""
    if not GENERATOR.is_file():
        raise SystemExit(f"{GENERATOR} is missing: run `make clients`, which installs it")
    (config := folder.parent / "python.yaml").write_text("post_hooks: []\nliteral_enums: true\n")
    command = [GENERATOR, "generate", "--path", document, "--output-path", folder / "printmend_studio",
               "--meta", "none", "--overwrite", "--config", config, "--fail-on-warning"]  # fmt: skip
    subprocess.run(list(map(str, command)), check=True)  # noqa: S603 - the lock file's
    config.unlink()


def make_typescript(document: Path, folder: Path) -> None:
    """Generate the TypeScript package, compiled and checked."""
    npm = shutil.which("npm")
    if npm is None:
        raise SystemExit("npm is missing: install Node.js")
    for name in ("package.json", "package-lock.json"):
        shutil.copy(HERE / name, folder)
    subprocess.run([npm, "ci", "--silent", "--no-audit", "--no-fund"], cwd=folder, check=True)  # noqa: S603
    tools = folder / "node_modules/.bin"
    subprocess.run([str(tools / "openapi-typescript"), str(document), "-o", "studio.ts"], cwd=folder, check=True)  # noqa: S603
    (folder / "client.ts").write_text(_CLIENT)
    options = ["--strict", "--declaration", "--module", "nodenext", "--target", "es2022", "--outDir", "dist"]
    subprocess.run([str(tools / "tsc"), *options, "client.ts"], cwd=folder, check=True)  # noqa: S603
    package = json.loads((folder / "package.json").read_text())
    package |= {"name": "printmend-studio", "main": "dist/client.js", "types": "dist/client.d.ts"}
    package.pop("devDependencies")
    (folder / "package.json").write_text(json.dumps(package, indent=2) + "\n")


def make(folder: Path) -> None:
    """Write the description and both clients into a folder."""
    document, python, typescript = folder / "openapi.json", folder / "python", folder / "typescript"
    for each in (python, typescript):
        shutil.rmtree(each, ignore_errors=True)
        each.mkdir(parents=True)
    document.write_text(json.dumps(description(), indent=1) + "\n", encoding="utf-8")
    make_python(document.resolve(), python)
    make_typescript(document.resolve(), typescript)


if __name__ == "__main__":
    make(Path(sys.argv[1] if len(sys.argv) > 1 else "build/clients"))
