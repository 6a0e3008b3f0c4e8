"""The studio's job that says whether a part fits, and what follows from it: no browser, no worker process."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from starlette.testclient import TestClient

from printmend.cli.main import group
from printmend.mend.history import read_history
from printmend.messages import is_one_of
from printmend.model import read_model
from printmend.printer import read_printer
from printmend.printer.convert import printer_text
from printmend.promise.filament import UNTOLD
from printmend.studio import work
from printmend.studio.app import create_app
from printmend.studio.places import Places
from tests import foreign_part as foreign
from tests.test_studio import _german

pytestmark = pytest.mark.usefixtures("once")
HERE = "http://127.0.0.1:8000"


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A studio's folder with a printer, a part's file (a) and scans of its underside (b, c)."""
    folder, rng = tmp_path_factory.mktemp("studio"), np.random.default_rng(3)
    for name in ("printers/one", "uploads"):
        (folder / name).mkdir(parents=True)
    (folder / "printers/one" / work.PRINTER).write_text(printer_text(read_printer("ender3")))
    shape, _ = foreign.part(rng, sizes=(29, 30))
    (folder / "uploads/a").write_text(foreign.gcode(shape, layers=4))
    for name in "bc":  # printed twice
        rings = foreign.printed(shape, 0.05, 0.12, (-0.004, -0.004), rng)
        (folder / "uploads" / name).write_bytes(foreign.scan([(rings, 1.0, 0.03)], rng, below=True, dpi=300))
    return folder


def test_a_part_is_judged_learned_from_and_mended(data: Path) -> None:
    params = {"printer": "one", "upload": "a", "name": "part.gcode", "dpi": None, "distances_mm": [],
              "scans": [{"upload": "b", "name": "under.png"}], "filament": "pla-black"}  # fmt: skip
    result = work.run("fit", str(data / "jobs/1"), str(data), params)
    assert "error" not in result, result
    holes = result["numbers"]["layers"][0]["holes"]
    assert sorted(round(hole["drawn_mm"]) for hole in holes) == [4, 6, 8, 12]
    assert [one["degrees"] for one in result["asked"]] == [0, 90]
    assert {"trace.csv", "fit.json"} <= set(result["files"])
    json.dumps(result)
    learned = work.run(
        "learn", str(data / "jobs/2"), str(data), {"printer": "one", "part": "1", "filament": "pla-black"}
    )
    assert "error" not in learned, learned
    model = json.loads((data / "printers/one" / work.MODEL).read_text())
    assert list(model["filaments"]["known"]) == ["pla-black"]
    gaps = [gap for gap in read_model(data / "printers/one" / work.MODEL).findings if is_one_of(gap, UNTOLD)]
    assert gaps
    assert _german(gaps[0])
    mended = {"printer": "one", "upload": "a", "name": "part.gcode", "scene": False, "filament": "petg"}
    assert "one that this model knows: pla-black" in work.run("mend", str(data / "jobs/3"), str(data), mended)["error"]
    check = {"printer": "one", "part": "a", "name": "part.gcode", "scans": [{"upload": "c", "name": "under.png"}],
             "dpi": None, "distance_mm": None, "filament": "pla-black"}  # fmt: skip
    proved = work.run("verify", str(data / "jobs/4"), str(data), check)
    assert proved["verdict"]["marks"] > 200, proved
    assert read_history(data / "printers/one" / work.MODEL)[-1]["event"] == "verified"
    assert (
        "found 5; measure it again"
        in work.run("verify", str(data / "jobs/5"), str(data), {**check, "distance_mm": 5})["error"]
    )
    typed = ["verify", str(data / "uploads/c"), "--gcode", str(data / "uploads/a"), "--distance", "5", "-m"]
    result = CliRunner().invoke(group, [*typed, str(data / "printers/one" / work.MODEL)])
    assert "found 5; measure it again" in str(result.exception)


def test_the_api_checks_what_it_is_given(tmp_path: Path) -> None:
    with TestClient(create_app(Places.below(tmp_path), workers=1), base_url=HERE) as client:
        made = client.post("/api/v1/printers", json={"name": "one", "preset": "ender3"}).json()
        assert made["filaments"] == []
        sent = client.post("/api/v1/uploads?name=a.gcode", content=b"G28\n").json()["id"]
        wrong = {"upload": sent, "uploads": [sent], "filament": "wood"}
        answer = client.post(f"/api/v1/printers/{made['id']}/fit", json=wrong)
        assert answer.status_code == 400
        assert "begins with its polymer" in answer.json()["error"]
        assert client.post(f"/api/v1/printers/{made['id']}/fit", json={**wrong, "uploads": []}).status_code == 422
        (tmp_path / "printers" / made["id"] / work.MODEL).write_text("{}")
        both = {"uploads": [sent, sent], "part": sent}
        answer = client.post(f"/api/v1/printers/{made['id']}/verify", json=both)
        assert "one scan of the part's underside" in answer.json()["error"]
    shutil.rmtree(tmp_path)
