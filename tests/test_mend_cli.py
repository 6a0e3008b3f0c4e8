"""The commands: where they write, what they say, how they end."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import shapely
from click.testing import CliRunner

from printmend.cli.main import group
from printmend.corruption import HEALTHY, Corruption, Drive, Play
from printmend.corruption.transmission import WrongRadius
from printmend.errors import GcodeError, InputError, ModelError, RefusedError, UnwritableError
from printmend.gcode.read import read_gcode
from printmend.measure.table import read_trace
from printmend.mend.many import is_done, mended_path
from printmend.mend.mend import mend_gcode
from printmend.model.model import exact_model, write_model
from printmend.probe import design_probe, write_probe
from printmend.report.part_view import look_at
from printmend.twin import Twin
from printmend.twin.gcode import print_dots
from tests.mending import BENT, ENDER3, SQUARE, START, exactly, text_of


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "part.gcode").write_bytes(SQUARE)
    (tmp_path / "printer.mend.json").write_text(text_of(BENT))
    (tmp_path / "broken.toml").write_text('[x.belt]\nkind = "play"\nplay_mm = 0.4\n')
    return tmp_path


def run(*args: object, data: bytes | None = None):
    return CliRunner().invoke(group, [str(arg) for arg in args], input=data)


def test_mend_writes_beside_the_part(folder: Path) -> None:
    result = run("mend", folder / "part.gcode", "-m", folder / "printer.mend.json")
    assert result.exit_code == 0, result.output
    assert (folder / "part.mended.gcode").exists()
    assert "as it is" in result.output
    assert "mended" in result.output


def test_reports(folder: Path) -> None:
    for name in ("report.html", "report.json"):
        result = run("mend", folder / "part.gcode", "-m", folder / "printer.mend.json", "--report", folder / name,
                     "--overwrite")  # fmt: skip
        assert result.exit_code == 0, result.output
    page = (folder / "report.html").read_text()
    assert page.count("data:image/svg+xml;base64,") == 2  # the part as it is and mended: its one layer needs no chart
    assert "safe to print" in page
    assert "http" not in page
    run("--lang", "de", "mend", folder / "part.gcode", "-m", folder / "printer.mend.json", "--overwrite",
        "--report", folder / "bericht.html")  # fmt: skip
    assert "bedenkenlos druckbar" in (folder / "bericht.html").read_text()
    plain = json.loads((folder / "report.json").read_text())
    assert plain["after"]["rms_mm"] < 0.006 < plain["before"]["rms_mm"]
    assert len(plain["layers"]) == 1
    assert isinstance(
        run("mend", folder / "part.gcode", "-m", folder / "printer.mend.json", "--report", folder / "r.txt").exception,
        InputError,
    )


def test_an_output_that_exists_is_spared(folder: Path) -> None:
    (folder / "part.mended.gcode").write_text("mine\n")
    arguments = ("mend", folder / "part.gcode", "-m", folder / "printer.mend.json")
    refused = run(*arguments)
    assert isinstance(refused.exception, InputError)
    assert "--overwrite" in str(refused.exception)
    assert (folder / "part.mended.gcode").read_text() == "mine\n"
    quiet = run(*arguments, "--overwrite", "--quiet")
    assert (quiet.exit_code, quiet.output) == (0, "")
    assert b"; mended by printmend" in (folder / "part.mended.gcode").read_bytes()


def test_many_files_and_folders(folder: Path) -> None:
    """Each has its line; what is wrong with one costs the others nothing; a second evening mends nothing twice."""
    jobs = folder / "jobs"
    (jobs / "new").mkdir(parents=True)
    for name in ("a.gcode", "new/b.gcode", ".hidden.gcode"):
        (jobs / name).write_bytes(SQUARE)
    (jobs / "c.gcode").write_text("M104 S0\n")
    (jobs / "far.gcode").write_bytes(START + b"G1 X219.95 E9 F1800\nG1 Y219.9 E9\n")
    arguments = ("mend", jobs, folder / "part.gcode", "-m", folder / "printer.mend.json", "--jobs", "2", "--json")
    done = run(*arguments)
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    assert [(Path(line["source"]).name, line["code"]) for line in lines] == [
        ("a.gcode", 0), ("c.gcode", 2), ("far.gcode", 3), ("b.gcode", 0), ("part.gcode", 0),
    ]  # fmt: skip
    assert done.exit_code == 2
    assert lines[0]["output"] == str(jobs / "a.mended.gcode")
    assert lines[0]["prediction"]["after"]["rms_mm"] < 0.006 < lines[0]["prediction"]["before"]["rms_mm"]
    assert "expected" in lines[1]["error"]
    assert not (jobs / "far.mended.gcode").exists()
    (jobs / "new" / "renamed.gcode").write_bytes((jobs / "a.mended.gcode").read_bytes())
    again = run("mend", jobs / "new", "-m", folder / "printer.mend.json")
    assert again.exit_code == 0, again.output
    assert [line.partition(": ")[2].partition(":")[0] for line in again.stdout.splitlines()] == ["already mended"] * 2
    assert sum("(--overwrite mends it again)" in line for line in again.stdout.splitlines()) == 1
    assert sorted(item.name for item in jobs.rglob("*.mended.*")) == ["a.mended.gcode", "b.mended.gcode"]
    (jobs / "new" / "renamed.gcode").unlink()
    (jobs / "new" / "b.gcode").write_bytes(SQUARE + b"G0 Z5\n")  # sliced again
    os.utime(jobs / "new" / "b.gcode", ns=(2 * 10**18, 2 * 10**18))
    assert run("mend", jobs / "new", "-m", folder / "printer.mend.json").exit_code == 2
    (jobs / "c.gcode").unlink()
    (jobs / "far.gcode").rename(jobs / "new" / "far.g.txt")
    apart = run("mend", folder / "part.gcode", jobs, "-m", folder / "printer.mend.json", "-o", folder / "out")
    assert apart.exit_code == 0, apart.output
    written = sorted(item.relative_to(folder / "out").as_posix() for item in (folder / "out").rglob("*.gcode"))
    assert written == ["a.gcode", "new/b.gcode", "part.gcode"]
    assert (folder / "out" / "a.gcode").read_bytes() == (jobs / "a.mended.gcode").read_bytes()


def test_what_was_not_mended_here_is_not_taken_for_done(folder: Path) -> None:
    """Another file moved in is mended though it is older; a healthy printer's file is done only where it is there."""
    source, model = folder / "part.gcode", exactly(BENT)
    target = mended_path(source)
    mend_gcode(source, model, target)
    assert is_done(source, target, model)
    (folder / "older").write_bytes(SQUARE + b"G0 Z5\n")
    os.utime(folder / "older", (1e9, 1e9))
    if os.name == "posix":  # elsewhere nothing tells when a file was moved
        (folder / "older").replace(source)
        assert not is_done(source, target, model)
    healthy = exactly(Corruption((Drive(), Drive())).lower(ENDER3).homed())
    target.write_bytes(source.read_bytes())
    assert is_done(source, target, healthy)
    target.write_text("G28\n; quite another\n")
    assert not is_done(source, target, healthy)


def test_pipes(folder: Path) -> None:
    """In a process of its own: the standard output holds the G-code and nothing else."""
    command = [str(Path(sys.executable).parent / "printmend"), "mend", "-", "-m", str(folder / "printer.mend.json")]
    done = subprocess.run(command, input=SQUARE, capture_output=True, check=True)  # noqa: S603 — our own program
    assert b"; mended by printmend" in done.stdout
    assert b"as it is" in done.stderr
    run("mend", folder / "part.gcode", "-m", folder / "printer.mend.json", "-o", folder / "out.gcode")
    assert (folder / "out.gcode").read_bytes() == done.stdout
    broken = subprocess.run(command, input=b"M104 S0\n", capture_output=True, check=False)  # noqa: S603 — our own program
    assert broken.returncode == 2
    assert broken.stdout == b""
    assert broken.stderr.count(b"\n") == 1


def test_in_place(folder: Path, monkeypatch) -> None:
    monkeypatch.setenv("PRINTMEND_PROGRESS", "1")  # as a program that starts it does
    done = run("mend", "--in-place", "-m", folder / "printer.mend.json", folder / "part.gcode")
    assert (done.exit_code, done.stderr.splitlines()) == (0, ["100 %"])
    assert b"; mended by printmend" in (folder / "part.gcode").read_bytes()
    again = run("mend", "--in-place", "-m", folder / "printer.mend.json", folder / "part.gcode")
    assert isinstance(again.exception, GcodeError)
    assert (
        run("mend", "--in-place", "-o", "x", "-m", folder / "printer.mend.json", folder / "part.gcode").exit_code == 2
    )


def test_refusals(folder: Path) -> None:
    (folder / "far.gcode").write_bytes(START + b"G1 X219.95 E9 F1800\nG1 Y219.9 E9\n")
    result = run("mend", folder / "far.gcode", "-m", folder / "printer.mend.json")
    assert isinstance(result.exception, RefusedError)
    assert result.exception.exit_code == 3
    assert not (folder / "far.mended.gcode").exists()
    forced = run("mend", folder / "far.gcode", "-m", folder / "printer.mend.json", "--force")
    assert forced.exit_code == 0, forced.output
    assert "edge of the bed" in forced.output
    (folder / "skip").mkdir()
    (folder / "skip" / "all.gcode").write_bytes(SQUARE.replace(b"G0 X60", b"/G91\nG0 X60"))
    (folder / "skip" / "last.gcode").write_bytes(SQUARE + b"/G91\nG1 X9 E1\n")
    told = run("mend", folder / "skip", "-m", folder / "printer.mend.json")
    assert told.exit_code == 3
    assert [words.count("The cause is line") for words in (told.stderr, told.stdout)] == [1, 1]
    assert "Warning: printing moves that are not mended: 1 (line" in told.stdout


def test_a_measurement_of_no_printer_is_refused_though_nothing_was_found(folder: Path) -> None:
    rng = np.random.default_rng(1)
    places = rng.uniform(20, 200, (80, 2))
    rows = np.hstack([places, places + rng.normal(0, 4.0, places.shape)])
    table = folder / "noise.csv"
    np.savetxt(table, rows, "%.3f", ",", header="x_mm,y_mm,x_measured_mm,y_measured_mm", comments="")
    learned = run("learn", table, "--printer", "ender3", "-o", folder / "noise.json")
    assert "healthy" in learned.output
    assert "Next: correct what the refusal names" in learned.output
    result = run("mend", folder / "part.gcode", "-m", folder / "noise.json", "-o", folder / "noise.gcode")
    assert isinstance(result.exception, RefusedError)
    assert not (folder / "noise.gcode").exists()
    assert (
        run(
            "mend", folder / "part.gcode", "-m", folder / "noise.json", "-o", folder / "noise.gcode", "--force"
        ).exit_code
        == 0
    )
    assert (folder / "noise.gcode").read_bytes() == (folder / "part.gcode").read_bytes()


def test_a_model_that_is_none(folder: Path) -> None:
    (folder / "other.json").write_text("{}")
    assert isinstance(run("mend", folder / "part.gcode", "-m", folder / "other.json").exception, ModelError)
    assert isinstance(run("mend", folder / "none.gcode", "-m", folder / "printer.mend.json").exception, GcodeError)


def test_check(folder: Path) -> None:
    model = folder / "printer.mend.json"
    result = run("check", folder / "part.gcode", "-m", model, "--json")
    predicted = json.loads(result.output)
    assert predicted["after"]["rms_mm"] < 0.006 < predicted["before"]["rms_mm"]
    run("mend", folder / "part.gcode", "-m", model)
    against = run("check", folder / "part.gcode", "-m", model, "--json", "--against", folder / "part.mended.gcode")
    found = json.loads(against.output)
    assert found["after"]["rms_mm"] == pytest.approx(predicted["after"]["rms_mm"], abs=0.002)
    same = json.loads(
        run("check", folder / "part.gcode", "-m", model, "--json", "--against", folder / "part.gcode").output
    )
    assert same["after"] == same["before"]
    told = run("check", folder / "part.gcode", "-m", model, "--against", folder / "part.gcode").output
    assert "Nothing is mended: every move stays as it is" in told
    assert not re.search("^  mended", told, re.MULTILINE)


def test_relative_e_that_no_line_asks_for_is_said(folder: Path) -> None:
    rows = b"".join(b"G1 X%d Y%d E0.%d\n" % (60 + k % 20, 60 + k % 7, 1 + k % 3) for k in range(30))
    (folder / "part.gcode").write_bytes(START.replace(b"M83\n", b"") + rows)
    for command in (["mend"], ["mend", "--overwrite", "--json"], ["check"], ["check", "--json"]):
        result = run(*command, folder / "part.gcode", "-m", folder / "printer.mend.json")
        assert "this file prints before it sets M82 or M83. Its numbers look like relative E" in result.output


def test_twin(folder: Path) -> None:
    output = folder / "trace.csv"
    args = ("twin", folder / "part.gcode", "--printer", "ender3", "--corruption", folder / "broken.toml", "-o", output)
    assert run(*args, "--noise-mm", 0).exit_code == 0
    header, first = output.read_text().splitlines()[:2]
    assert header.startswith("x_mm,y_mm,x_measured_mm,y_measured_mm")
    assert first.startswith("0.000000,0.000000,0.000000,0.000000")
    # Six way-points: home, the travel, the corners. Homing at the minimum leaves the belt on the far side of its play.
    trace = np.loadtxt(output, delimiter=",", skiprows=1, usecols=range(4))
    assert trace[:, :2].tolist() == [[0, 0], [60, 60], [80, 60], [80, 80], [60, 80], [60, 60]]
    assert np.allclose(trace[:, 2], [0, 59.6, 79.6, 79.6, 60, 60], atol=0.01)
    assert np.allclose(trace[:, 3], trace[:, 1], atol=0.01)


def test_twin_noise_has_its_size_and_seed(folder: Path) -> None:
    rows = b"".join(b"G1 X%d Y%d E1\n" % (60 + k % 97, 60 + k % 89) for k in range(2000))
    (folder / "long.gcode").write_bytes(START + rows)
    base = ("twin", folder / "long.gcode", "--printer", "ender3", "--corruption", folder / "broken.toml")
    traces = []
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        assert run(*base, "--seed", seed, "-o", folder / name).exit_code == 0
        traces.append(read_trace(folder / name, ENDER3).measured_mm)
    run(*base, "--noise-mm", 0, "-o", folder / "d")
    exact = read_trace(folder / "d", ENDER3).measured_mm
    assert np.array_equal(traces[0], traces[1])
    assert not np.array_equal(traces[0], traces[2])
    assert np.std(traces[0] - exact) == pytest.approx(0.05, rel=0.05)


def test_twin_chords_and_later_homing(folder: Path) -> None:
    (folder / "arc.gcode").write_bytes(SQUARE + b"G28\nG0 X60 Y60\nG2 X80 Y60 I10 J0 E2\n")
    base = ("twin", folder / "arc.gcode", "--printer", "ender3", "--corruption", folder / "broken.toml")
    run(*base, "--noise-mm", 0, "-o", folder / "t.csv")
    trace = np.loadtxt(folder / "t.csv", delimiter=",", skiprows=1, usecols=range(4))
    assert trace[0, :2].tolist() == [0, 0]
    assert len(trace) > 20
    assert np.allclose(np.hypot(trace[1:, 0] - 70, trace[1:, 1] - 60), 10, atol=0.001)


def test_an_owner_sees_the_part_before_it_is_printed(folder: Path) -> None:
    run("mend", folder / "part.gcode", "-m", folder / "printer.mend.json")
    view = look_at(folder / "part.gcode", folder / "part.mended.gcode", BENT)
    assert view is not None
    before, after = (float(np.sqrt(np.mean(each.off_mm**2))) for each in (view.before, view.after))
    assert before > 0.1
    assert after < 0.01
    assert ((view.low_mm >= 0) & (view.high_mm <= 220)).all()
    (folder / "taller.gcode").write_bytes(SQUARE + b"\nG1 Z5\nG1 X70 Y60 E9\n")
    assert look_at(folder / "part.gcode", folder / "taller.gcode", BENT) is None  # other layers


def test_a_seam_is_drawn_where_it_is_printed(folder: Path) -> None:
    """Not where the motors are sent: with a pulley of the wrong size that is far away, and by the slack beside it."""
    broken = Corruption((Drive(pulley=WrongRadius(6.0), belt=Play(0.9)), Drive(belt=Play(0.9)))).lower(ENDER3).homed()
    angle = np.linspace(0, 2 * np.pi, 41)
    star = np.stack([np.cos(angle), np.sin(angle)], axis=1) * (10 + 3 * (np.arange(41) % 2))[:, None] + 70
    rows = "".join(f"G1 X{x:.3f} Y{y:.3f} E1\n" for x, y in star)
    (folder / "star.gcode").write_bytes(START + f"G0 X{star[0, 0]} Y{star[0, 1]}\nG1 F1800\n{rows}".encode())
    mend_gcode(folder / "star.gcode", exactly(broken), folder / "star.mended.gcode")
    view = look_at(folder / "star.gcode", folder / "star.mended.gcode", broken)
    assert view is not None
    assert len(view.seams_mm) > 10
    off = shapely.distance(shapely.LineString(star), shapely.points(view.seams_mm))
    assert off.max() < 0.05


def test_a_test_print_is_mended_as_a_check_print(folder: Path) -> None:
    """Its dots are printed standing, so that its lines, which are all that is judged, gain nothing."""
    plan = design_probe(ENDER3, size_mm=50, marks=100)
    write_probe(folder / "probe.gcode", plan)
    done = run("mend", folder / "probe.gcode", "-m", folder / "printer.mend.json", "-o", folder / "check.gcode")
    assert done.exit_code == 0, done.output
    assert "these figures cover the lines of this test print, not its dots" in done.output
    worst = []
    for name in ("probe", "check"):
        dots = print_dots(read_gcode(folder / f"{name}.gcode", printer=ENDER3), Twin(BENT), plan)
        worst.append(np.hypot(*(dots - plan.marks_mm).T).max())
    assert worst[0] > 0.2
    assert worst[1] < 0.02
    with pytest.raises(InputError, match=f"{len(plan)} dots"):
        print_dots(read_gcode(folder / "part.gcode", printer=ENDER3), Twin(BENT), plan)


def test_a_place_that_cannot_be_written_is_named_before_the_work(folder: Path) -> None:
    error = run("mend", folder / "part.gcode", "-m", folder / "printer.mend.json", "--report", folder / "no" / "r.html")
    assert isinstance(error.exception, UnwritableError)
    assert not (folder / "part.mended.gcode").exists()


def test_healthy_says_so(folder: Path) -> None:
    write_model(folder / "healthy.json", exact_model(HEALTHY.lower(ENDER3)))
    result = run("mend", folder / "part.gcode", "-m", folder / "healthy.json", "-o", folder / "same.gcode")
    assert result.exit_code == 0
    assert (folder / "same.gcode").read_bytes() == SQUARE
    (folder / "arcs.gcode").write_bytes(SQUARE + b"G2 X60 Y60 I9 E3\n")
    arcs = run("mend", folder / "arcs.gcode", "-m", folder / "healthy.json")
    assert "Nothing is mended: every move stays as it is" in arcs.output


def test_mend_does_not_import_what_it_does_not_need() -> None:
    heavy = "lightgbm sklearn scipy.linalg matplotlib cv2 trimesh shapely rich networkx"
    code = (
        "import sys; import printmend.cli.mend, printmend.mend, printmend.report.part, printmend.model.model;"
        f"print([name for name in '{heavy}'.split() if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)  # noqa: S603 — our own
    assert done.stdout.strip() == "[]"
