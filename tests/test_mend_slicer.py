"""A real slicer calls the program as its post-processing script, and what it gets back is still its file."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import trimesh

from printmend.gcode.read import read_gcode
from printmend.model import write_model
from tests import naive_mend
from tests.mending import BENT, ENDER3, exactly

SLICER = shutil.which("prusa-slicer")


@pytest.mark.skipif(SLICER is None, reason="prusa-slicer is not installed (apt-get install prusa-slicer)")
def test_post_processing(tmp_path: Path) -> None:
    body = trimesh.creation.cylinder(radius=12, height=3, sections=48)
    body.export(tmp_path / "body.stl")
    write_model(tmp_path / "printer.mend.json", exactly(BENT))
    program = Path(sys.executable).parent / "printmend"
    script = f"{program} mend --in-place -m {tmp_path / 'printer.mend.json'}"
    base = [str(SLICER), "-g", "--center", "110,110", "--layer-height", "0.3", str(tmp_path / "body.stl"), "-o"]
    plain, processed = tmp_path / "plain.gcode", tmp_path / "processed.gcode"
    subprocess.run([*base, str(plain)], check=True, capture_output=True)  # noqa: S603 — the slicer
    subprocess.run([*base, str(processed), "--post-process", script], check=True, capture_output=True)  # noqa: S603
    assert b"; mended by printmend" in processed.read_bytes()
    before, after = read_gcode(plain, printer=ENDER3).moves, read_gcode(processed, printer=ENDER3).moves
    assert after.layer.max() == before.layer.max() >= 8
    assert after.extrusion_mm.sum() == pytest.approx(before.extrusion_mm.sum(), abs=1e-3)

    anew = re.compile("mended|sealed|generated|post_process|estimated printing time")  # what mending adds or says anew

    def comments(path: Path) -> list[str]:
        lines = path.read_text().splitlines()[2:]
        return [line for line in lines if line.startswith(";") and not anew.search(line)]

    assert comments(processed) == comments(plain)
    # an independent reader sees the same heights, each with the same filament
    home = tuple(axis.home_mm for axis in ENDER3.axes)
    layers = []
    for path in (plain, processed):
        filament: dict[float, float] = {}
        for move in naive_mend.read_moves(path.read_bytes(), home):
            if move.draws:
                filament[round(move.end[2], 3)] = filament.get(round(move.end[2], 3), 0.0) + move.filament
        layers.append(filament)
    assert layers[0].keys() == layers[1].keys()
    assert all(layers[1][z] == pytest.approx(e, abs=1e-3) for z, e in layers[0].items())
    # the slicer itself still reads its configuration from the file
    command = [str(SLICER), "--load", str(processed), "--save", str(tmp_path / "config.ini")]
    subprocess.run(command, check=True, capture_output=True)  # noqa: S603 — the slicer
    assert "layer_height = 0.3" in (tmp_path / "config.ini").read_text()
