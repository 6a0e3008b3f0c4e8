"""Mending on another computer, with a stand-in for ssh that runs the command here."""

import json
import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
from hosts import INTEGRATIONS, PRINTMEND
from parts import part

from printmend.model.model import exact_model, write_model
from printmend.printer import read_printer
from printmend_lab.sampling import sample


def test_a_file_goes_over_and_comes_back_mended(tmp_path: Path) -> None:
    program = tmp_path / "printmend-ssh"
    shutil.copy(INTEGRATIONS / "remote/printmend-ssh", program)
    (tmp_path / "printmend-ssh.host").write_text("me@pc\n")
    ssh = tmp_path / "ssh"
    ssh.write_text('#!/bin/sh\n[ "$3" = me@pc ] && exec sh -c "$4"\nexit 255\n')
    ssh.chmod(0o755)
    model, source, out = tmp_path / "it's mine.json", tmp_path / "part.gcode", tmp_path / "out.gcode"
    write_model(model, exact_model(sample("play", np.random.default_rng(1)).lower(read_printer("ender3"))))
    source.write_bytes(part(1))
    environment = {**os.environ, "PATH": os.pathsep.join([str(tmp_path), str(PRINTMEND.parent), os.environ["PATH"]])}

    def run(what: Path) -> subprocess.CompletedProcess:
        command = [program, "mend", what, "-m", model, "-o", out, "--report", tmp_path / "r.json"]
        return subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False, env=environment)  # noqa: S603

    done = run(source)
    assert done.returncode == 0, done.stderr
    assert b"; mended by printmend" in out.read_bytes()[:100]
    assert json.loads((tmp_path / "r.json").read_text())["after"]["rms_mm"] < 0.01
    out.unlink()
    assert run(tmp_path / "absent.gcode").returncode != 0
    source.write_bytes(b"G28\n")
    done = run(source)
    assert done.returncode == 2
    assert "no G0–G3 move" in done.stderr
    assert not out.exists()
    assert not list(tmp_path.glob("out.gcode.*"))
