"""The studio behind a proxy that speaks TLS, by the recipes of docs/studio.md: nginx and Caddy, Chromium and hosts."""

import re
import shutil
import subprocess
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hosts import PRINTMEND, free_port, running, wait_for
from studio_server import CHROMIUM, Server, Watched, chromium

from printmend.client import Studio, StudioError
from printmend.model.model import exact_model, write_model
from printmend.printer import read_printer
from printmend.provenance import read_model
from printmend_lab.sampling import sample

PAGE = (Path(__file__).resolve().parents[2] / "docs/studio.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```text\n(.*?)```", PAGE, re.DOTALL)
NGINX = """daemon off; pid {folder}/pid; error_log stderr; user root;
events {{}}
http {{ access_log off; client_body_temp_path {folder}/a; proxy_temp_path {folder}/b; fastcgi_temp_path {folder}/c;
uwsgi_temp_path {folder}/d; scgi_temp_path {folder}/e; {recipe} }}
"""
CADDY = """{{
admin off
auto_https disable_redirects
storage file_system {folder}/kept
}}
{recipe}"""
LARGE_BYTES = 150_000_000


def _block(begins: str) -> str:
    """Return the block of the page that begins so, as the owner copies it."""
    return next(block for block in BLOCKS if block.startswith(begins))


def _there(command: str) -> str:
    return shutil.which(command) or shutil.which(command, path="/usr/sbin:/sbin") or ""


@pytest.fixture(scope="module", params=["nginx", "caddy"])
def proxied(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Server, str]]:
    """A studio behind a proxy, and the address that browsers have of it."""
    program = _there(request.param)
    if not program:
        pytest.skip(f"needs Debian's {request.param}")
    folder, port = tmp_path_factory.mktemp(request.param), free_port()
    for line in _block("openssl req").splitlines():
        subprocess.run(line.replace("studio.example", "localhost"), cwd=folder, shell=True, check=True,  # noqa: S602 - the page's
                       capture_output=True)  # fmt: skip
    server = Server(folder / "studio", "--name", "localhost")
    recipe = _block("server {" if request.param == "nginx" else "studio.example {")
    for was, now in (
        ("studio.example {", f"localhost:{port} {{"), ("studio.example", "localhost"), ("443", str(port)),
        ("127.0.0.1:8765", f"127.0.0.1:{server.port}"), ("/etc/ssl", str(folder)),
    ):  # fmt: skip
        recipe = recipe.replace(was, now)
    frame = NGINX if request.param == "nginx" else CADDY
    (config := folder / "proxy.conf").write_text(frame.format(folder=folder, recipe=recipe))
    command = [program, "-e", "stderr", "-c", config] if request.param == "nginx" else [
        program, "run", "--adapter", "caddyfile", "--config", config]  # fmt: skip
    try:
        with running(command, folder / "log"), pytest.MonkeyPatch.context() as patch:
            patch.setenv("SSL_CERT_FILE", str(folder / "studio.crt"))  # whoever comes knows this certificate
            address = f"https://localhost:{port}"
            wait_for(lambda: urllib.request.urlopen(f"{address}/icon.svg"), request.param)  # noqa: S310 - our own
            yield server, address
    finally:
        server.stop()


def test_a_large_file_goes_through_and_events_come_as_they_happen(proxied, tmp_path: Path) -> None:
    server, address = proxied
    studio = Studio(address, token=server.token)
    with pytest.raises(StudioError, match="token"):
        Studio(address).get("/printers")
    (large := tmp_path / "large.gcode").write_bytes(b"G1 X1 Y1 E1\n" * (LARGE_BYTES // 12))
    assert (server.folder / "uploads" / studio.upload(large)).stat().st_size == LARGE_BYTES
    faults = {"x": {"shape": "oval", "dent_mm": 0.7}, "y": {"play_mm": 0.1}}
    job = studio.post("/play", faults)["id"]
    with urllib.request.urlopen(f"{address}/api/v1/jobs/{job}/events?token={server.token}") as events:  # noqa: S310 - our own
        assert events.readline()
        assert studio.get(f"/jobs/{job}")["state"] in ("queued", "running")  # no proxy keeps events back until the end
    studio.post(f"/jobs/{job}/cancel")


def test_a_host_is_paired(proxied, tmp_path: Path) -> None:
    server, address = proxied
    studio = Studio(address, token=server.token)
    key = studio.post("/printers", {"preset": "ender3"})["id"]
    model = exact_model(sample("play", np.random.default_rng(1)).lower(read_printer("ender3")))
    write_model(server.folder / "printers" / key / "printer.mend.json", model)
    code = studio.post(f"/printers/{key}/pair")["code"]
    command = [PRINTMEND, "pair", address, code, "-m", tmp_path / "printer.mend.json"]
    subprocess.run(list(map(str, command)), check=True, capture_output=True)  # noqa: S603 - our own program
    assert read_model(str(tmp_path / "printer.mend.json")).digest == model.digest


@pytest.mark.skipif(not CHROMIUM.exists(), reason="needs Debian's chromium")
def test_a_browser_signs_in_and_lets_in_another(proxied) -> None:
    server, address = proxied
    with chromium() as browser:
        context = browser.new_context(locale="en-GB", ignore_https_errors=True)
        page = context.new_page()
        page.goto(address)
        page.get_by_label("Token").fill(server.token)
        page.get_by_role("button", name="Sign in").click()
        page.wait_for_selector("#drawing")  # sent for by POST, with this page's origin
        assert [(one["secure"], one["httpOnly"]) for one in context.cookies()] == [(True, True)]
        page.goto(f"{address}/#/devices")
        page.get_by_label("Its name").fill("phone")
        page.get_by_role("button", name="Let it in").click()
        other = page.locator(".address").inner_text()
        assert other.startswith(f"{address}/?token=")
        watched = Watched(browser.new_context(ignore_https_errors=True).new_page(), address)
        watched.page.goto(other)
        watched.page.wait_for_selector("#drawing")
        assert (watched.problems, watched.foreign) == ([], [])
