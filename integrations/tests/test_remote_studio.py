"""Mending in a studio on another computer, with the script that takes printmend's place."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hosts import INTEGRATIONS, PRINTMEND
from parts import part
from studio_server import Server

from printmend.client import Studio, StudioError
from printmend.model.model import exact_model, write_model
from printmend.printer import read_printer
from printmend_lab.sampling import sample


def test_a_file_goes_over_and_comes_back_mended(tmp_path: Path) -> None:
    server = Server(tmp_path / "studio")
    try:
        key = Studio(server.address).post("/printers", {"preset": "ender3", "name": "it's mine"})["id"]
        model = exact_model(sample("play", np.random.default_rng(1)).lower(read_printer("ender3")))
        write_model(server.folder / "printers" / key / "printer.mend.json", model)
        program = tmp_path / "printmend-http"
        shutil.copy(INTEGRATIONS / "remote/printmend-http", program)
        source, out = tmp_path / "part 1.gcode", tmp_path / "out.gcode"
        source.write_bytes(part(1))

        def run(what: Path, printer: str = "it's mine") -> subprocess.CompletedProcess:
            command = [sys.executable, program, "mend", what, "-m", printer, "-o", out, "--report", tmp_path / "r.json"]
            return subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False)  # noqa: S603

        assert "write the studio's address there" in run(source).stderr
        (tmp_path / "printmend-http.address").write_text(f"{server.address} no-token-needed\n")
        done = run(source)
        assert done.returncode == 0, done.stderr
        assert b"; mended by printmend" in out.read_bytes()[:100]
        assert json.loads((tmp_path / "r.json").read_text())["after"]["rms_mm"] < 0.01
        out.rename(tmp_path / "mended.gcode")
        for what, printer, words in (
            (tmp_path / "absent.gcode", "it's mine", "No such file"), (source, "another", "found it's mine"),
            (tmp_path / "mended.gcode", "it's mine", "mended.gcode: expected a file as the slicer wrote it"),
        ):  # fmt: skip
            failed = run(what, printer)
            assert failed.returncode == 2
            assert words in failed.stderr
            assert failed.stderr.count("\n") == 1
            assert not out.exists()
    finally:
        server.stop()
    assert "is it running?" in run(source).stderr


def test_the_address_that_a_studio_for_others_tells_is_one_that_it_answers_to(tmp_path: Path) -> None:
    command = [PRINTMEND, "studio", "--no-browser", "--host", "0.0.0.0", "--port", "0", "--folder", str(tmp_path)]  # noqa: S104
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as studio:  # noqa: S603 - our own program
        try:
            assert studio.stdout is not None
            line = studio.stdout.readline()
            told = re.search(r"(http://\S+)/\?token=(\S+)", line)
            assert told, line
            assert Studio(told[1], token=told[2]).get("/printers") == []
            with pytest.raises(StudioError):
                Studio(told[1], token="another").get("/printers")  # noqa: S106 - a wrong one
        finally:
            studio.terminate()
