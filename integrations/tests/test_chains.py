"""Chains of many steps: from a foreign printer's photo or scans to a mended part, a printer's year, a cluster,
a data set and the paper's figures.

`make test` holds the law of each step; here is what takes five seconds and more each.
"""

import json
import os
import re
import subprocess
import sys
import textwrap
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from tests import foreign_layer as foreign
from tests.bodies import write_vase
from tests.mending import ENDER5, SQUARE
from tests.test_mend_laws import part

import printmend
import printmend_lab
from printmend.cli.main import group
from printmend.corruption import Corruption, Drive, Play, corruption_toml
from printmend.errors import ScanError
from printmend.learn import learner
from printmend.learn.learned import learn_model
from printmend.measure import read_plan, write_trace
from printmend.measure.fiducials import find_sheet
from printmend.measure.image import read_image
from printmend.measure.measurement import measure_scans
from printmend.mend.history import read_history, trends_of
from printmend.mend.mend import mend_gcode
from printmend.mend.part import measure_part
from printmend.path import Trace
from printmend.printer import Printer, read_printer
from printmend.probe import design_probe
from printmend.protocols import WorldModel
from printmend.twin import Twin
from printmend_lab.bench.case import OPTIMUM, evaluate, read_results
from printmend_lab.bench.families import drawn_case
from printmend_lab.sampling import sample

PRINTER = read_printer("ender3")
BROKEN = foreign.Machine(waves=(((1, 0.2, 0.5),), ((1, 0.1, 2.0), (2, 0.06, 1.0))), play=(0.25, 0.12))
LIMIT_MM = 0.03
START = datetime(2026, 1, 1, tzinfo=UTC)
MONTH = timedelta(days=365.25 / 12)


@pytest.fixture
def scanned(tmp_path: Path) -> Path:
    """A folder with gear.gcode and star.gcode."""
    for name, shape in (("gear", foreign.gear()), ("star", foreign.star())):
        (tmp_path / f"{name}.gcode").write_text(foreign.gcode(shape)[0])
    return tmp_path


def test_a_photo_on_the_sheet_serves_as_a_scan_does(scanned: Path) -> None:
    text, strokes = foreign.gcode(foreign.gear(), layers=20)
    (scanned / "tall.gcode").write_text(text)
    taken = foreign.photo(BROKEN.strokes(strokes), np.random.default_rng(3), height=20 * foreign.HEIGHT)
    (scanned / "photo.jpg").write_bytes(taken)
    measured = measure_part(scanned / "photo.jpg", scanned / "tall.gcode", PRINTER)
    assert "14 tags" in measured.notes[0]
    mended = scanned / "photographed.gcode"
    mend_gcode(scanned / "star.gcode", learn_model(measured.trace, PRINTER), mended)
    assert foreign.paired_error(BROKEN, scanned / "star.gcode", mended) < LIMIT_MM


def test_the_edges_of_the_paper_under_a_part_serve_a_photo(scanned: Path) -> None:
    _, strokes = foreign.gcode(foreign.gear())
    printed = BROKEN.strokes(strokes)
    path = scanned / "paper.jpg"
    path.write_bytes(foreign.photo(printed, np.random.default_rng(2), tags=False, ruler=1.0))
    measured = measure_part(path, scanned / "gear.gcode", PRINTER)
    assert any("edges of A4 paper" in note for note in measured.notes)
    assert any("lines over 150 mm" in note for note in measured.notes), measured.notes
    mend_gcode(scanned / "star.gcode", learn_model(measured.trace, PRINTER), scanned / "by-paper.gcode")
    assert foreign.paired_error(BROKEN, scanned / "star.gcode", scanned / "by-paper.gcode") < LIMIT_MM
    assert find_sheet(read_image(path)[0]).error_mm < 0.05
    # a table as bright as the paper shows no edges
    path.write_bytes(foreign.photo([], np.random.default_rng(2), tags=False, table=240))
    assert find_sheet(read_image(path)[0]) is None


CROOKED = foreign.Machine(waves=(((1, 0.25, 0.5),), ((1, 0.15, 2.0),)), play=(0.3, 0.15))


def test_sheets_are_joined_by_the_dots_that_they_share(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    asked = "probe --printer ender3 --on paper --scanner 110x140 --sheets 2 --dots 150 -o"
    outcome = CliRunner().invoke(group, [*asked.split(), str(tmp_path / "two.gcode")])
    assert outcome.exit_code == 0, outcome.output
    assert "Sheet 2 (110 × 140 mm (X × Y)): its left front corner at X" in outcome.output
    plan = read_plan(tmp_path / "two.json")
    printed, scans = np.empty((len(plan), 2)), []
    for number in (1, 2):
        dots, filament, _ = foreign.printed_dots(tmp_path / f"two-{number}.gcode", CROOKED)
        printed[plan.sheet_of == number - 1] = dots
        scans.append(tmp_path / f"scan-{number}.jpg")
        # the line at its start lies on the sheet, too; at its end a blob
        prime = plan.sheets[number - 1].waypoints_mm[1:3]
        radii = [*np.where(filament > 1.4 * filament.min(), 0.8, 0.5), 0.5]
        scans[-1].write_bytes(foreign.plate(np.vstack([dots, prime[1:]]), radii, rng, angle=4.0 - 3 * number,
                                            quarter=number - 1, threads=[prime]))  # fmt: skip
    with pytest.raises(ScanError, match="none of sheet 2"):
        measure_scans(scans[:1], plan)
    measured = measure_scans(scans[::-1], plan)
    assert any("2 scans of 2 sheets were joined by" in note for note in measured.notes)
    assert len(measured.missing) < 0.02 * len(plan)
    off = measured.measured_mm - printed
    off = off[np.isfinite(off).all(axis=1)]
    assert np.sqrt(np.square(off - off.mean(axis=0)).mean()) < 0.015
    model = learn_model(measured.trace, PRINTER)
    left = Twin(model.mechanism).follow(plan.waypoints_mm)[plan.rows] - printed
    assert np.std(left, axis=0).max() < 0.015


def test_wear_is_dated_though_every_update_believes_the_last(tmp_path: Path) -> None:
    """Play grows from 0.03 to 0.08 mm in five measurements of 0.05 mm of noise: it reaches 0.1 mm 1.6 months later."""
    plan, rng, model = design_probe(PRINTER), np.random.default_rng(3), tmp_path / "printer.mend.json"
    for month in range(5):
        twin = Twin.of(Corruption((Drive(belt=Play(0.03 + 0.0125 * month)), Drive())), PRINTER)
        printed = twin.follow(plan.waypoints_mm)
        seen = np.full_like(printed, np.nan)
        seen[plan.rows] = printed[plan.rows] + rng.normal(0, 0.05, (len(plan), 2))
        write_trace(tmp_path / "trace.csv", Trace(plan.waypoints_mm, seen, homed=True))
        day = (START + month * MONTH).strftime("%Y-%m-%d")
        how = ["--update", str(model)] if month else ["--printer", "ender3", "-o", str(model)]
        done = CliRunner().invoke(group, ["learn", str(tmp_path / "trace.csv"), *how, "--date", day])
        assert done.exit_code == 0, done.output
    play = next(one for one in trends_of(read_history(model)) if one.name.upper().startswith("X BELT PLAY"))
    assert play.is_sure
    assert play.crossing_s is not None
    crossing = (play.crossing_s - START.timestamp()) / MONTH.total_seconds()
    assert abs(crossing - 5.6) < 0.2 * 5.6
    shown = CliRunner().invoke(group, ["history", str(model), "--picture", str(tmp_path / "wear.png")])
    assert shown.exit_code == 0, shown.output
    assert "it will reach 0.10 mm about" in shown.output
    assert (tmp_path / "wear.png").stat().st_size > 5000
    assert len(json.loads(CliRunner().invoke(group, ["history", str(model), "--json"]).output)["events"]) == 5


def test_a_whole_print_teaches_what_half_a_turn_cannot() -> None:
    case = drawn_case("prints", "pulley-play", "damaged", 1.0, 0, 11)
    rows = (OPTIMUM, "fixed@120@0.05", "active@120@0.05", "half-turn@120@0.05")
    found = {one.row.partition("@")[0]: one for one in evaluate(case, rows)}
    assert all(one.error is None for one in found.values())
    best = found[OPTIMUM].values["rmse_steps"]
    for name in ("fixed", "active"):
        assert best <= found[name].values["rmse_steps"] < 1.3 * best
        assert 100 < found[name].values["measured"] <= 130
    assert found["half-turn"].values["rmse_steps"] > found["fixed"].values["rmse_steps"]


@dataclass(frozen=True)
class Mine:
    """A learner from outside: every printer is healthy."""

    name: str = "mine"

    def fit(self, trace: Trace, printer: Printer, *, rng: np.random.Generator) -> WorldModel:
        return learner("naive").fit(trace, printer, rng=rng)


def test_the_examples_in_the_package_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.chdir(tmp_path)
    corruption = sample("pulley-play", np.random.default_rng(4), "realistic")
    Path("broken.toml").write_text(corruption_toml(corruption))
    Path("part.gcode").write_bytes(SQUARE)
    Path("body.gcode").write_bytes(part(ENDER5))
    for package in (printmend, printmend_lab):
        doc = (package.__doc__ or "").splitlines()
        code = textwrap.dedent("\n".join(line for line in doc if line.startswith("    ") or not line.strip()))
        exec(code, {"MINE": Mine(), "bodies": ["body.gcode"]})  # noqa: S102 - our own docstrings
    said = capsys.readouterr().out
    before_mm, after_mm = map(float, re.findall(r"^  (?:as it is|mended) +([\d.]+) ", said, re.MULTILINE))
    assert before_mm > 0.1
    assert after_mm < 0.15 * before_mm
    naive, greybox, mine = (line.split() for line in said.splitlines()[-3:])
    assert [naive[0], greybox[0], mine[0]] == ["naive", "greybox", "mine"]
    assert mine[1:7] == naive[1:7]
    assert float(greybox[2]) < 0.5 * float(naive[2])


CLUSTERED = """
import sys, time
from pathlib import Path
from starlette.testclient import TestClient
from printmend.cluster import Cluster
from printmend.studio.app import create_app
from printmend.studio.places import Places
if __name__ == "__main__":
    with Cluster.at("local:1").client() as dask, dask.get_executor(pure=False) as pool:
        app = create_app(Places.below(Path(sys.argv[1])), cluster=pool)
        with TestClient(app, base_url="http://127.0.0.1:8765") as client:
            def done(job):
                while (job := client.get("/api/v1/jobs/" + job["id"]).json())["state"] in ("queued", "running"):
                    time.sleep(1.0)
                assert job["state"] == "done", job
                return job
            bent, sound = (client.post("/api/v1/play", json=faults).json() for faults in ({"screw_mm": 0.35}, {}))
            sound, job = done(sound), done(bent)
            assert sound["result"]["after"]["rms_mm"] < 0.01
            assert not sound["result"]["said"]["faults"]
            assert "printed.bin" in sound["files"]
            assert [one["title"] for one in job["result"]["said"]["faults"]] == ["The Z screw is bent"]
            assert job["result"]["after"]["rms_mm"] < 0.02 < 0.1 < job["result"]["before"]["rms_mm"]
            assert client.get(f"/api/v1/jobs/{job['id']}/files/mended.bin").status_code == 200
"""


def test_jobs_run_on_the_benches_cluster_and_play_mends_a_bent_screw_and_spares_what_is_sound(tmp_path: Path) -> None:
    (script := tmp_path / "run.py").write_text(CLUSTERED)
    done = subprocess.run(  # noqa: S603 (this interpreter, a list of arguments)
        [sys.executable, str(script), str(tmp_path / "studio")],
        capture_output=True,
        text=True,
        check=False,
        timeout=600,
    )
    assert done.returncode == 0, done.stderr[-3000:]


def run(*arguments: object) -> str:
    done = CliRunner().invoke(group, [str(one) for one in arguments], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.stdout


def test_a_data_set_becomes_the_papers_figures(tmp_path: Path) -> None:
    vase, data, out = write_vase(tmp_path / "vase.gcode", layers=4, radius_mm=9.0), tmp_path / "data", tmp_path / "out"
    run("dataset", "build", "--bodies", vase, "--corruptions", 1, "-o", data)
    text = run("figures", "--dataset", data, "--models", "naive,oracle", "-o", out)
    for number in range(1, 7):
        svg = (out / f"figure{number}.svg").read_text()
        assert svg.startswith("<?xml")
        assert svg.rstrip().endswith("</svg>")
    families = run("bench", "families", "--dataset", data, "--rows", "oracle+greedy", "--out", tmp_path / "families")
    family, bodies, oracle, ratio, best, one = families.splitlines()[-1].split()
    assert (family, bodies, one) == ("pulley", "1", "(1.00)")
    assert float(best) <= float(oracle)
    assert float(ratio.strip("()")) >= 1.0
    naive = next(line for line in text.splitlines() if line.startswith("naive")).split()
    assert float(naive[2]) > 1.0
    assert naive[-1] == "27.6", "the paper's own figure stands beside"
    assert f"naive & 1 & {naive[2]}" in (out / "table1.tex").read_text()
    assert f"| naive | 1 | {naive[2]} |" in " ".join((out / "table1.md").read_text().split())


# In a process of its own: Dask's threads outlive a cluster by moments, which the other tests take for warnings.
TABLE = """
import logging
import os
import sys
from pathlib import Path
from printmend import cluster
from printmend_lab.bench.case import Case
from printmend_lab.bench.case import run
from printmend.cli.main import group
from printmend.errors import InputError
from printmend_lab.executor import WorkerDied, executor
from tests.mortal import judged_once
if __name__ == "__main__":
    cluster._CONNECT_S = 0.5
    made = Path(sys.argv[1]).parent / "made"
    asked = ["dataset", "build", "--bodies", "generated:1", "-o", str(made), "--cluster", "tcp://127.0.0.1:9"]
    try:
        group.main(asked, standalone_mode=False)
    except InputError as error:
        said = str(error)
    assert "expected a scheduler at tcp://127.0.0.1:9" in said and "start `dask scheduler`" in said, said
    assert not list(made.parent.glob("made*"))
    cases = [Case("table1", "", place, "play", "damaged", "paper", 0, source=place) for place in sys.argv[1:]]
    pool = executor(1, "local:2")
    run(cases, ("naive", "oracle"), Path(sys.argv[1]).parent, pool, evaluate=judged_once)
    assert [value for _, value in pool.map(os._exit, [1])] == [WorkerDied()]
    with pool.client():
        logging.getLogger("distributed.scheduler").error("told of the disk")
"""


def test_a_table_on_a_cluster_neither_loses_nor_doubles_a_row_when_a_worker_dies(tmp_path: Path) -> None:
    places = [str(tmp_path / f"body{n}.txt") for n in range(5)]
    (tmp_path / "body1.die").touch()
    script = tmp_path / "run.py"
    script.write_text(TABLE)
    root = str(Path(__file__).parents[2])
    done = subprocess.run(  # noqa: S603 (this interpreter, a list of arguments)
        [sys.executable, str(script), *places], capture_output=True, text=True, check=False, timeout=300,
        env={**os.environ, "PYTHONPATH": f"{root}/src:{root}"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "ERROR - told of the disk" in done.stderr
    assert "workers died" not in done.stderr, "an error is told, workers that are lost are not"
    assert not (tmp_path / "body1.die").exists()
    assert Path(places[1]).read_text() == "ran\n"
    results = read_results(tmp_path / "table1.jsonl")
    assert sorted((result.case.source, result.row) for result in results) == [
        (place, row) for place in places for row in ("naive", "oracle")
    ]
