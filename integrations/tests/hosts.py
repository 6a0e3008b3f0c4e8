"""What the tests of hosts share: programs that run in the background, ports, a model and the command that mends."""

import http.client
import json
import os
import random
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

PRINTMEND = Path(sys.executable).parent / "printmend"
SOURCE = Path(__file__).resolve().parents[2] / "src"
INTEGRATIONS = SOURCE.parent / "integrations"
PATIENCE_S = 600
"""What does not come within this never will: a quiet computer needs a hundredth of it."""


def free_port() -> int:
    """Return a port that nobody listens at, below those from which connections are made: it stays free for a while."""
    while True:
        port = random.SystemRandom().randrange(20_000, 32_000)
        with socket.socket() as free:
            try:
                free.bind(("127.0.0.1", port))
            except OSError:
                continue
        return port


@contextmanager
def running(command: list, log: Path, **options) -> Iterator[subprocess.Popen]:
    """Run a program until the end of the block; then ask it to stop, and wait."""
    with log.open("ab") as out:
        process = subprocess.Popen(  # noqa: S603 — the programs that `make hosts` installed
            list(map(str, command)), stdout=out, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL, **options
        )
        try:
            yield process
        finally:
            process.terminate()
            try:
                process.wait(60)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def wait_for(ready: Callable[[], object], what: str) -> object:
    """Return the first true answer of ``ready``; a host that is not up yet may refuse or talk nonsense."""
    end = time.monotonic() + PATIENCE_S
    while True:
        try:
            if answer := ready():
                return answer
        except (OSError, ValueError, KeyError, urllib.error.URLError, http.client.HTTPException):
            pass
        if time.monotonic() > end:
            raise TimeoutError(f"{what} did not come within {PATIENCE_S} s")
        time.sleep(0.05)


def call(url: str, data: bytes | dict | None = None, headers: dict | None = None, method: str | None = None) -> dict:
    """Ask an HTTP server for JSON; an answer that says no is returned as {"status", "text"}."""
    if isinstance(data, dict):
        data, headers = json.dumps(data).encode(), {**(headers or {}), "Content-Type": "application/json"}
    request = urllib.request.Request(url, data=data, headers=headers or {}, method=method)  # noqa: S310 — loopback
    try:
        with urllib.request.urlopen(request, timeout=PATIENCE_S) as answer:  # noqa: S310 — loopback
            text = answer.read()
            return json.loads(text) if text else {}
    except urllib.error.HTTPError as error:
        return {"status": error.code, "text": error.read().decode("utf-8", "replace")}


def form(fields: dict, name: str, content: bytes) -> tuple[bytes, dict]:
    """Return the body and headers of an upload."""
    line = "printmendboundary"
    parts = [f'--{line}\r\nContent-Disposition: form-data; name="{k}"\r\n\r\n{v}\r\n' for k, v in fields.items()]
    parts.append(f'--{line}\r\nContent-Disposition: form-data; name="file"; filename="{name}"\r\n'
                 "Content-Type: application/octet-stream\r\n\r\n")  # fmt: skip
    body = "".join(parts).encode() + content + f"\r\n--{line}--\r\n".encode()
    return body, {"Content-Type": f"multipart/form-data; boundary={line}"}


def environment() -> dict:
    """Return the environment in which a host finds this checkout of printmend."""
    return {"PATH": os.environ["PATH"], "HOME": os.environ.get("HOME", "/"), "PYTHONPATH": str(SOURCE)}
