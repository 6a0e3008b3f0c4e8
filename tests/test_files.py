"""Writing beside the old file: whose it is, what killed runs left, a full disk."""

import errno
import os
import time
from pathlib import Path

import pytest

from printmend.errors import InputError
from printmend.files import replacing


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
