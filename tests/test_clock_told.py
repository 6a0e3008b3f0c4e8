"""Times that a file tells: told anew for the mended print, everything else byte for byte."""

import re
import struct
import zipfile
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printmend.clock.told import Moment, told_anew
from printmend.gcode import write
from printmend.gcode.bgcode import GCODE, MAGIC, THUMBNAIL, Block, block_text, gcode_blocks, read_blocks, read_header
from printmend.gcode.read import read_gcode
from printmend.mend import check_gcode, mend_gcode
from printmend.mend.against import judged
from tests import naive_clock
from tests.mending import BENT, START, exactly
from tests.test_clock import moves_of

LINES = [
    b"M73 P5 R59", b"M73 P5 R59 ; five percent", b"M73 Q7 S12", b"m73 p5 r9", b"M73 P10.5", b"M73 C4 D3", b"M73",
    b"M73 L3",
    b";TIME:451", b";TIME_ELAPSED:23.746823", b"; estimated printing time (normal mode) = 1d 2h 3m 4s",
    b"; estimated printing time (silent mode) = 44m 35s",
    b"; estimated first layer printing time (normal mode) = 1m 9s",
    b"; model printing time: 5m 1s; total estimated time: 11m 32s", b";Print Time:3620", b";PRINT.TIME:1234",
    b";   Build time: 1 hour 2 minutes", b";TIME:6666", b";TIME:", b"; estimated printing time", b";TIME:" + b"9" * 400,
]  # fmt: skip
SAME = Moment(30.0, 30.0, 100.0, 100.0)


@pytest.mark.parametrize("line", LINES, ids=lambda line: line.decode()[:40])
def test_where_mending_takes_no_time_no_byte_changes(line: bytes) -> None:
    assert told_anew(line, SAME) == line


@pytest.mark.parametrize(
    ("line", "wanted"),
    [
        (b"M73 P30 R70 ; P30", b"M73 P25 R180 ; P30"),  # 30 of 100 s are 60 of 240
        (b"M73 P30.00 R70.0", b"M73 P25.00 R180.0"),
        (b"m73 q30", b"m73 q25"),
        (b";TIME:100", b";TIME:240"),
        (b";TIME_ELAPSED:30.50", b";TIME_ELAPSED:61.00"),
        (b";PRINTING_TIME: 10", b";PRINTING_TIME: 24"),
        (b";REMAINING_TIME: 70", b";REMAINING_TIME: 180"),
        (b"; estimated printing time (normal mode) = 1h 40m 0s", b"; estimated printing time (normal mode) = 4h 0m 0s"),
        (b"; estimated printing time (normal mode) = 1m 40s", b"; estimated printing time (normal mode) = 4m 0s"),
        (b"; estimated printing time = 50m 0s", b"; estimated printing time = 120m 0s"),
        (b";   Build time: 1 hour 40 minutes", b";   Build time: 4 hour 0 minutes"),
        (
            b"; model printing time: 10s; total estimated time: 20s",
            b"; model printing time: 24s; total estimated time: 48s",
        ),
        (b";TIME:6666", b";TIME:6666"),
    ],
)
def test_times_grow_in_proportion(line: bytes, wanted: bytes) -> None:
    assert told_anew(line, Moment(30.0, 60.0, 100.0, 240.0)) == wanted


@given(
    st.sampled_from([b"M73 ", b";TIME:", b"; estimated printing time = ", b"; Build time: "]), st.binary(max_size=60)
)
def test_any_line_is_told_or_left(head: bytes, tail: bytes) -> None:
    for moment in (SAME, Moment(0.0, 0.0, 0.0, 0.0), Moment(1.0, 2.0, 1.0, 2.0)):
        assert told_anew(head + tail, moment)[:3] == head[:3]
    digits = rb"\d"
    assert re.sub(digits, b"", told_anew(head + tail, SAME)) == re.sub(digits, b"", head + tail)


ROUND = [(80 + 20 * np.cos(t), 80 + 20 * np.sin(t)) for t in np.linspace(0, 12 * np.pi, 300)]


def timed_part(end: bytes = b"\n") -> bytes:
    """A part whose slicer tells the time everywhere, in proportion to its moves."""
    rows = [b"; slicer", b";TIME:1000", *START.splitlines(), b"M73 P0 R17"]
    for i, (x, y) in enumerate(ROUND, 1):
        rows.append(b"G1 X%.3f Y%.3f E0.1 F3000" % (x, y))
        if i % 30 == 0:
            rows += [b"M73 P%d R%d" % (i / 3, 17 * (1 - i / 300)), b";TIME_ELAPSED:%.3f" % (i / 0.3)]
    rows += [b"; estimated printing time (normal mode) = 16m 40s", b""]
    return end.join(rows)


TIMED = re.compile(rb"^(?:M73|;TIME|; estimated)", re.MULTILINE)


@pytest.mark.parametrize("end", [b"\n", b"\r\n"])
def test_a_mended_file_tells_its_own_times(tmp_path: Path, end: bytes) -> None:
    source, output = tmp_path / "part.gcode", tmp_path / "out.gcode"
    source.write_bytes(timed_part(end))
    prediction = mend_gcode(source, exactly(BENT), output).prediction
    duration = prediction.duration
    assert duration is not None
    assert duration.after_s > 1.01 * duration.before_s
    assert check_gcode(source, exactly(BENT)).duration == duration
    told, before = ([line for line in text.splitlines() if TIMED.match(line)] for text in
                    (output.read_bytes(), source.read_bytes()))  # fmt: skip
    assert len(told) == len(before)
    assert told[0] == b";TIME:%d" % round(1000 * duration.after_s / duration.before_s)
    percents = [int(found[1]) for line in told if (found := re.match(rb"M73 P(\d+)", line))]
    assert percents == sorted(percents)
    assert (percents[0], percents[-1]) == (0, 100)
    assert re.match(rb"M73 P100 R0$", told[-3])
    spent = [float(line.split(b":")[1]) for line in told if b"ELAPSED" in line]
    assert spent[-1] == pytest.approx(1000 * duration.after_s / duration.before_s, rel=1e-3)
    for text in (source, output):
        text.write_bytes(TIMED.sub(b";", text.read_bytes()))
    mend_gcode(source, exactly(BENT), tmp_path / "plain.gcode")
    plain = [line for line in (tmp_path / "plain.gcode").read_bytes().splitlines() if not line.startswith(b";")]
    assert plain == [line for line in output.read_bytes().splitlines() if not line.startswith(b";")]


def test_the_mended_seconds_are_those_of_the_written_file(tmp_path: Path) -> None:
    """What was planned takes as long as what was written, read again by the slow planner: retractions, too."""
    source, output = tmp_path / "part.gcode", tmp_path / "out.gcode"
    source.write_bytes(timed_part().replace(b";TIME_ELAPSED", b"G1 E-1 F1200\nG1 E1\nG1 F3000\n;TIME_ELAPSED"))
    duration = mend_gcode(source, exactly(BENT), output).prediction.duration
    assert duration is not None
    for path, seconds in ((source, duration.before_s), (output, duration.after_s)):
        moves = moves_of(path.read_text())
        assert len(moves) == len(read_gcode(path).moves)
        assert naive_clock.seconds(moves, duration.limits) == pytest.approx(seconds, rel=2e-3)


def test_a_file_that_is_held_against_its_source_is_timed_itself(tmp_path: Path) -> None:
    source, output = tmp_path / "part.gcode", tmp_path / "out.gcode"
    source.write_bytes(timed_part() + b"G2 I5 P3 E4\n")  # three circles
    prediction = mend_gcode(source, exactly(BENT), output).prediction
    found = judged(prediction, str(source), str(output), BENT).duration
    assert found is not None
    assert prediction.duration is not None
    assert found.before_s == prediction.duration.before_s
    assert found.after_s == pytest.approx(prediction.duration.after_s, rel=2e-3)
    slow = output.read_bytes().replace(b"F3000", b"F300")
    output.write_bytes(slow)
    later = judged(prediction, str(source), str(output), BENT).duration
    assert later is not None
    assert later.after_s > 1.5 * found.after_s


def test_numbered_lines_keep_their_times(tmp_path: Path) -> None:
    source, output = tmp_path / "part.gcode", tmp_path / "out.gcode"
    source.write_bytes(b"".join(b"N%d %b\n" % (i, line) for i, line in enumerate(timed_part().splitlines())))
    mend_gcode(source, exactly(BENT), output)
    old, new = (re.findall(rb"M73 P\d+ R\d+", path.read_bytes()) for path in (source, output))
    assert old == new


def test_a_project_tells_the_times_of_each_plate(tmp_path: Path) -> None:
    source, output = tmp_path / "part.gcode.3mf", tmp_path / "out.gcode.3mf"
    with zipfile.ZipFile(source, "w") as archive:
        for plate in (1, 2):
            archive.writestr(f"Metadata/plate_{plate}.gcode", timed_part())
    duration = mend_gcode(source, exactly(BENT), output).prediction.duration
    assert duration is not None
    with zipfile.ZipFile(output) as archive:
        for plate in (1, 2):
            text = archive.read(f"Metadata/plate_{plate}.gcode")
            assert b";TIME:%d\n" % round(1000 * duration.after_s / duration.before_s) in text


def test_of_very_many_times_the_first_are_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where too many follow one another, what comes later stays, and nothing is told in another's place."""
    # the first batch of notes fits, the second does not, the third would
    monkeypatch.setattr(write, "_MOST_TIMES", 1100)
    source, output = tmp_path / "part.gcode", tmp_path / "out.gcode"
    text = timed_part()
    source.write_bytes(text + b"M73 P1 R9\n" * 2000 + text)
    mend_gcode(source, exactly(BENT), output)
    old, new = ([line for line in path.read_bytes().splitlines() if TIMED.match(line)] for path in (source, output))
    assert len(old) == len(new)
    assert new[0] != old[0]
    assert new[1020:] == old[1020:]


def in_blocks(text: bytes, metadata: bytes, *, compressed: int) -> bytes:
    """Return a binary G-code file: metadata that states the time, a thumbnail, the program, metadata again."""
    like = Block(GCODE, 1, 0, 0, b"", b"")
    data = zlib.compress(metadata) if compressed else metadata
    size = len(data).to_bytes(4, "little") if compressed else b""
    block = struct.pack("<HHI", 4, compressed, len(metadata)) + size + b"\0\0" + data
    picture = struct.pack("<HHI", THUMBNAIL, 0, 3) + b"\0" * 6 + b"png"
    block, picture = (each + zlib.crc32(each).to_bytes(4, "little") for each in (block, picture))
    return MAGIC + struct.pack("<IH", 1, 1) + block + picture + gcode_blocks(text, like, checked=True) + block


@pytest.mark.parametrize("compressed", [0, 1])
def test_the_metadata_of_a_binary_file_state_the_mended_time(tmp_path: Path, compressed: int) -> None:
    source, output = tmp_path / "part.bgcode", tmp_path / "out.bgcode"
    old = b"filament used [mm]=1.5\nestimated printing time (normal mode)=16m 40s\nobjects_info={}\n"
    source.write_bytes(in_blocks(timed_part(), old, compressed=compressed))
    duration = mend_gcode(source, exactly(BENT), output).prediction.duration
    assert duration is not None
    minutes, seconds = divmod(round(1000 * duration.after_s / duration.before_s), 60)
    with output.open("rb") as handle:
        _, checked = read_header(handle, "out")
        blocks = list(read_blocks(handle, "out", checked=checked))
    assert [block.kind for block in blocks if block.kind != GCODE] == [4, THUMBNAIL, 4]
    for block in (blocks[0], blocks[-1]):
        assert block_text(block, "out") == old.replace(b"16m 40s", b"%dm %ds" % (minutes, seconds))
        assert block.compression == compressed


def test_the_plates_of_a_project_state_their_own_mended_times(tmp_path: Path) -> None:
    source, output = tmp_path / "part.gcode.3mf", tmp_path / "out.gcode.3mf"
    plate = b'<plate>\n<metadata key="index" value="%d"/>\n<metadata key="prediction" value="1000"/>\n</plate>\n'
    info = b"<config>" + plate % 1 + plate % 2 + plate % 7 + b"</config>"
    with zipfile.ZipFile(source, "w") as archive:
        archive.writestr("Metadata/plate_1.gcode", timed_part())
        archive.writestr("Metadata/plate_2.gcode", timed_part().replace(b"F3000", b"F600"))
        archive.writestr("Metadata/slice_info.config", info)
    mend_gcode(source, exactly(BENT), output)
    with zipfile.ZipFile(output) as archive:
        texts = [archive.read(f"Metadata/plate_{number}.gcode") for number in (1, 2)]
        told = archive.read("Metadata/slice_info.config")
    times = [re.findall(rb"^;TIME:(\d+)", text, re.MULTILINE)[0] for text in texts]
    assert len({*times, b"1000"}) == 3
    for number, time in zip((1, 2), times, strict=True):
        info = info.replace(plate % number, (plate % number).replace(b"1000", time))
    assert told == info  # there is no plate 7
