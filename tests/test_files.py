"""Writing beside the old file: whose it is, what killed runs left, a full disk."""

import errno
import os
import time
from pathlib import Path

import pytest
from click.testing import CliRunner

from printmend.cli.main import group
from printmend.errors import InputError
from printmend.files import all_or_none, replacing


def test_leftovers_of_killed_runs_are_swept_but_not_what_is_being_written(tmp_path: Path) -> None:
    target = tmp_path / "part.gcode"
    kept = [tmp_path / ".part.gcode.mine.tmp", tmp_path / ".other.gcode.abcdefgh.tmp"]
    left = tmp_path / ".part.gcode.abcdefgh.tmp"
    for path in (left, *kept):
        path.write_text("half")
        os.utime(path, (time.time() - 100, time.time() - 100))
    with replacing(target) as first:
        first.write("first")
        os.utime(first.name, (time.time() - 100, time.time() - 100))
        with replacing(target) as second:
            second.write("second")
    assert target.read_text() == "first"
    assert sorted(tmp_path.iterdir()) == sorted([target, *kept])


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root may give files away")
def test_root_keeps_the_owner(tmp_path: Path) -> None:
    target = tmp_path / "part.gcode"
    target.write_text("old")
    target.chmod(0o640)
    os.chown(target, 1234, 2345)
    with replacing(target) as file:
        file.write("new")
    found = target.stat()
    assert (target.read_text(), found.st_uid, found.st_gid, found.st_mode & 0o777) == ("new", 1234, 2345, 0o640)


def test_a_full_disk_is_told_with_the_name_of_the_file(tmp_path: Path) -> None:
    target = tmp_path / "part.gcode"

    def write() -> None:
        with replacing(target) as file:
            file.write("half")
            raise OSError(errno.ENOSPC, "No space left on device")

    with pytest.raises(InputError, match=r"part\.gcode.*no space left.*make room"):
        write()
    assert list(tmp_path.iterdir()) == []


def test_files_of_a_block_take_their_places_together_or_not_at_all(tmp_path: Path) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    first.write_text("old")

    def write(fails: bool) -> None:
        with all_or_none():
            for path in (first, second):
                with replacing(path) as file:
                    file.write("new")
                assert first.read_text() == "old"
            if fails:
                raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write(fails=True)
    assert [path.name for path in tmp_path.iterdir()] == ["first"]
    write(fails=False)
    assert sorted((path.name, path.read_text()) for path in tmp_path.iterdir()) == [("first", "new"), ("second", "new")]


def test_a_command_that_fails_at_its_end_leaves_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise InputError("page", wanted="a", came="b", todo="c")

    monkeypatch.setattr("printmend.probe.leaflet.write_leaflet", fail)
    asked = ["probe", "--printer", "ender3", "--size", "40", "-o", str(tmp_path / "probe.gcode")]
    assert isinstance(CliRunner().invoke(group, asked).exception, InputError)
    assert list(tmp_path.iterdir()) == []
