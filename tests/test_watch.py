"""The watched folder: half-copied files, restarts, changed files and models, files that cannot be mended."""

import json
import os
from pathlib import Path

import pytest
from click.testing import CliRunner

from printmend.cli.main import group
from printmend.errors import InputError
from printmend.gcode import sliced
from printmend.mend.many import JOURNAL, Watch
from printmend.mend.mend import mend_gcode
from printmend.model import read_model
from printmend.provenance import sealed_test_print
from tests.mending import BENT, PLAY, SQUARE, exactly, text_of


@pytest.fixture
def job(tmp_path: Path) -> Watch:
    (tmp_path / "printer.mend.json").write_text(text_of(BENT))
    with pytest.raises(InputError, match="expected a folder that files come into"):
        Watch(tmp_path / "in", tmp_path / "out", tmp_path / "printer.mend.json")
    (tmp_path / "in").mkdir()
    return Watch(tmp_path / "in", tmp_path / "out", tmp_path / "printer.mend.json")


def again(job: Watch) -> Watch:
    """A new process on the same folders."""
    return Watch(job.source, job.target, job.model_path)


def test_a_file_is_taken_when_it_has_come_to_rest(job: Watch) -> None:
    (job.source / "sub").mkdir()
    part = job.source / "sub" / "part.gcode"
    part.write_bytes(SQUARE[:40])
    assert job.look() == []
    part.write_bytes(SQUARE)
    assert job.look() == []
    (done,) = job.look()
    assert (done.code, done.output) == (0, job.target / "sub" / "part.gcode")
    assert b"; mended by printmend" in (job.target / "sub" / "part.gcode").read_bytes()
    assert part.read_bytes() == SQUARE
    assert job.look() == []


def test_a_restart_does_nothing_twice_but_what_has_changed(job: Watch) -> None:
    part, out = job.source / "part.gcode", job.target / "part.gcode"
    part.write_bytes(SQUARE)
    job.look(), job.look()
    first = out.read_bytes()
    with (job.target / JOURNAL).open("a") as journal:
        journal.write('{"file": ["cut sho')  # a kill while it was written
    new = again(job)
    assert new.look() == new.look() == []
    assert (job.target / JOURNAL).read_text().endswith("cut sho\n")
    job.model_path.write_text(text_of(PLAY))
    part.write_bytes(SQUARE.replace(b"X80", b"X90"))
    new.look()
    (done,) = new.look()
    assert done.code == 0
    assert out.read_bytes() != first
    assert new.model is not None
    assert new.model.digest == exactly(PLAY).digest


def test_what_cannot_be_mended_says_why_and_others_go_on(job: Watch) -> None:
    (job.source / "a.gcode").write_text("M104 S0\n")
    (job.source / "b.gcode").write_bytes(SQUARE)
    (job.source / "c.gcode").write_bytes(SQUARE)
    (job.target / "c.gcode").write_text("somebody's\n")
    (job.source / ".d.gcode").write_bytes(SQUARE)
    job.look()
    assert [(item.source.name, item.code) for item in job.look()] == [("a.gcode", 2), ("b.gcode", 0), ("c.gcode", 2)]
    assert "expected" in (job.target / "a.gcode.error.txt").read_text()
    assert (job.target / "c.gcode").read_text() == "somebody's\n"
    (job.source / "a.gcode").write_bytes(SQUARE)
    job.look(), job.look()
    assert (job.target / "a.gcode").exists()
    assert not (job.target / "a.gcode.error.txt").exists()


def test_a_file_that_changes_while_it_is_read_is_taken_later(job: Watch, monkeypatch: pytest.MonkeyPatch) -> None:
    part = job.source / "part.gcode"
    part.write_bytes(SQUARE)
    job.look()
    model = job._model
    monkeypatch.setattr(job, "_model", lambda: (part.write_bytes(SQUARE + b"G1 X60 Y70 E1\n"), model())[1])
    assert job.look() == []
    monkeypatch.undo()
    job.look()
    assert [item.code for item in job.look()] == [0]


def test_a_test_print_is_copied_as_it_is_and_mended_by_hand_alone(job: Watch) -> None:
    text = sealed_test_print(b"; printmend probe: 1 dots on one layer\n" + SQUARE)
    probe, out, check = job.source / "probe.gcode", job.target / "probe.gcode", job.source / "check.gcode"
    probe.write_bytes(text)
    arguments = ["watch", str(job.source), str(job.target), "-m", str(job.model_path), "--once", "--every", "0.1"]
    done = CliRunner().invoke(group, [*arguments, "--json"])
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout) == {"source": str(probe), "code": 0, "output": str(out), "test_print": True}
    assert out.read_bytes() == text
    done = CliRunner().invoke(group, ["mend", str(probe), "-m", str(job.model_path), "-o", str(check)])
    assert done.exit_code == 0, done.output
    assert b"; printmend probe: " in check.read_bytes()
    assert not sliced.is_test_print(check)
    assert "mended with this model already" in CliRunner().invoke(group, arguments).stdout  # as whoever asked wants it
    assert (job.target / "check.gcode").read_bytes() == check.read_bytes()
    probe.write_bytes(sealed_test_print(b"; printmend probe: 2 dots\n" + SQUARE))
    assert "must show the printer as it is" in CliRunner().invoke(group, arguments).stdout
    assert out.read_bytes() == (before := probe.read_bytes())
    probe.write_bytes(text + b"G1 X61 Y60\n")
    done = CliRunner().invoke(group, arguments)
    assert done.exit_code == 2
    assert "one that was changed since; write it again" in done.stderr
    assert out.read_bytes() == before


def test_what_was_mended_by_hand_is_current_and_no_other(job: Watch) -> None:
    part, mended, out = job.source / "part.gcode", job.source / "by_hand.gcode", job.target / "part.gcode"
    part.write_bytes(SQUARE)
    model = read_model(job.model_path)
    mend_gcode(part, model, mended)
    mend_gcode(part, model, out)
    by_hand = out.read_bytes()
    job.look()
    (done,) = job.look()
    assert (done.source, done.code, done.current) == (mended, 0, True)
    assert (job.target / mended.name).read_bytes() == mended.read_bytes()
    assert out.read_bytes() == by_hand
    (job.source / "forged.gcode").write_bytes(mended.read_bytes().replace(b"X80", b"X81"))
    mend_gcode(part, exactly(PLAY), job.source / "foreign.gcode")
    job.look()
    assert {(one.source.stem, one.code) for one in job.look()} == {("forged", 2), ("foreign", 2)}
    part.write_bytes(SQUARE.replace(b"X80", b"X90"))
    job.look()
    assert [one.code for one in job.look()] == [0]  # what was current is the watch's own
    assert out.read_bytes() != by_hand


def test_the_command(job: Watch) -> None:
    (job.source / "part.gcode").write_bytes(SQUARE)
    os.utime(job.source / "part.gcode", (1, 1))
    arguments = ["watch", str(job.source), str(job.target), "-m", str(job.model_path), "--once", "--every", "0.1"]
    done = CliRunner().invoke(group, arguments)
    assert done.exit_code == 0, done.output
    assert "written" in done.stdout
    assert CliRunner().invoke(group, arguments).stdout == ""
    with pytest.raises(InputError, match="a folder apart from IN"):
        Watch(job.source, job.source, job.model_path)
