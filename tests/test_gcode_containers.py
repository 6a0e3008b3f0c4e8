"""Containers: plain text, .bgcode and .gcode.3mf in and out, the mark, and what is refused."""

import hashlib
import io
import re
import struct
import zipfile
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from printmend.errors import GcodeError
from printmend.gcode import bgcode
from printmend.gcode import kernels as k
from printmend.gcode.container import CHUNK_BYTES, MAX_LINE_BYTES, _without_moves, open_gcode
from printmend.gcode.read import read_gcode
from printmend.gcode.sliced import find_mark, marked

BGCODES = (
    ("martinfrances107__gcode-nom/benchy2-mk4s.bgcode", None),
    ("prusa3d__libbgcode/mini_cube_b.bgcode", "prusa3d__libbgcode/mini_cube_b_ref.gcode"),
    ("prusa3d__libbgcode/mini_cube_ps2.8.1.bgcode", "prusa3d__libbgcode/mini_cube_ps2.8.1.gcode"),
    (
        "prusa3d__Prusa-Firmware-Buddy/test_binary_heatshrink_meatpack.bgcode",
        "prusa3d__Prusa-Firmware-Buddy/test_plain.gcode",
    ),
    ("prusa3d__Prusa-Firmware-Buddy/test_binary_meatpack.bgcode", "prusa3d__Prusa-Firmware-Buddy/test_plain.gcode"),
)


def texts(part):
    return (chunk.data for chunk in part.chunks())


@pytest.mark.parametrize(("name", "twin"), BGCODES)
def test_bgcode_comes_back_byte_for_byte(corpus, name, twin):
    path = corpus / "gcode" / name
    copy = io.BytesIO()
    with open_gcode(path) as file:
        file.write(copy, texts)
    blocks, originals = ([*blocks_of(data)] for data in (copy.getvalue(), path.read_bytes()))
    assert [b.raw for b in blocks if b.kind != bgcode.GCODE] == [b.raw for b in originals if b.kind != bgcode.GCODE]
    assert text_of(blocks) == text_of(originals)
    assert {(b.compression, b.encoding) for b in blocks} == {(b.compression, b.encoding) for b in originals}
    # Packing is a function: the same lines give the same bytes as the slicer's own packer.
    for block in originals:
        if block.kind == bgcode.GCODE:
            text = bgcode.block_text(block, name)
            assert bgcode.gcode_blocks(text, block, checked=True) == block.raw


@pytest.mark.parametrize(("name", "twin"), [pair for pair in BGCODES if pair[1]])
def test_bgcode_moves_as_its_plain_twin(corpus, name, twin):
    packed, plain = (read_gcode(corpus / "gcode" / n).moves for n in (name, twin))
    np.testing.assert_array_equal(packed.end_mm, plain.end_mm)
    np.testing.assert_array_equal(packed.extrusion_mm, plain.extrusion_mm)
    np.testing.assert_array_equal(packed.layer, plain.layer)


def blocks_of(data: bytes):
    handle = io.BytesIO(data)
    _, checked = bgcode.read_header(handle, "test")
    return bgcode.read_blocks(handle, "test", checked=checked)


def text_of(blocks) -> bytes:
    return b"".join(bgcode.block_text(block, "test") for block in blocks if block.kind == bgcode.GCODE)


def small_bgcode(compression: int, encoding: int, *, checked: bool = True, text: bytes = b"") -> bytes:
    text = text or b";TYPE:Wall\nG28\n" + b"".join(
        b"G1X%d.5Y%dE.%d\n" % (i % 90, i % 70, i % 9 + 1) for i in range(9000)
    )
    like = bgcode.Block(bgcode.GCODE, compression, encoding, 0, b"", b"")
    meta = struct.pack("<HHIH", 2, 0, 7, 0) + b"a=b\nc=d"  # the slicer's settings
    meta += zlib.crc32(meta).to_bytes(4, "little") if checked else b""
    header = struct.pack("<4sIH", b"GCDE", 1, int(checked))
    return header + meta + bgcode.gcode_blocks(text, like, checked=checked)


@pytest.mark.parametrize("compression", [0, 1, 2, 3])
@pytest.mark.parametrize("encoding", [0, 1, 2])
@pytest.mark.parametrize("checked", [True, False])
def test_every_compression_and_encoding_round_trips(tmp_path, compression, encoding, checked):
    path = tmp_path / "a.bgcode"
    path.write_bytes(small_bgcode(compression, encoding, checked=checked))
    copy = io.BytesIO()
    with open_gcode(path) as file:
        assert len(read_gcode(path).moves) == 9000
        file.write(copy, texts)
    assert copy.getvalue() == path.read_bytes()


@given(
    st.lists(st.text(st.characters(max_codepoint=254, exclude_characters="\r\n"), max_size=40), max_size=20),
    st.booleans(),
)
@settings(deadline=None)
def test_meatpack_holds_any_lines(lines, no_spaces):
    text = "".join(f"{line}\n" for line in lines).encode("latin-1")
    out = np.empty(2 * len(text) + 6 * len(lines) + 16, np.uint8)
    packed = out[: k.pack(np.frombuffer(text, np.uint8), no_spaces, out)]
    back = np.empty(2 * len(packed) + 2, np.uint8)
    assert back[: k.unpack(packed, back)].tobytes() == text


def test_meatpack_of_a_known_line():
    # G1 X1 without spaces: G 1, X 1, then the line end and its padding.
    out = np.empty(64, np.uint8)
    size = k.pack(np.frombuffer(b"G1X1\n", np.uint8), True, out)
    assert out[:size].tobytes() == bytes([255, 255, 251, 255, 255, 247, 0x1D, 0x1E, 0xCC])


@given(st.binary(max_size=200))
@settings(deadline=None)
def test_unpacking_stays_within_its_buffer(data):
    packed = np.frombuffer(data, np.uint8)
    out = np.empty(2 * len(packed) + 2, np.uint8)
    assert k.unpack(packed, out) <= len(out)


@given(st.integers(0, 2**32), st.integers(1, 20))
@settings(max_examples=60, deadline=None)
def test_a_damaged_bgcode_is_refused_or_read_as_it_was(tmp_path_factory, seed, flips):
    data = bytearray(small_bgcode(1, 2, text=b"G28\nG1X5Y5\n" * 50))
    rng = np.random.default_rng(seed)
    for position in rng.integers(0, len(data), flips):
        data[position] ^= int(rng.integers(1, 256))
    path = tmp_path_factory.mktemp("damaged") / "a.bgcode"
    path.write_bytes(data[: int(rng.integers(1, len(data) + 1))])
    with pytest.raises(GcodeError) as caught:
        read_gcode(path)
    assert "\n" not in str(caught.value)


def project(tmp_path: Path, plates: dict[str, bytes], **others: bytes) -> Path:
    path = tmp_path / "part.gcode.3mf"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("[Content_Types].xml", "<x/>")
        for name, text in plates.items():
            archive.writestr(name, text)
            archive.writestr(name + ".md5", hashlib.md5(text, usedforsecurity=False).hexdigest().upper())
        for name, data in others.items():
            archive.writestr(name, data)
    return path


def test_a_project_comes_back_with_new_plates_and_sums(tmp_path):
    plates = {"Metadata/plate_10.gcode": b"G28\nG1 X3\n", "Metadata/plate_2.gcode": b"G28\r\nG1 X1\r\n" * 9}
    path = project(tmp_path, plates, picture=b"\x89PNG", notes=b"n" * 5000)
    out = tmp_path / "out.3mf"
    with open_gcode(path) as file, out.open("wb") as handle:
        assert [part.member for part in file.parts] == ["Metadata/plate_2.gcode", "Metadata/plate_10.gcode"]
        file.write(handle, lambda part: [*texts(part), b"; end\n"])
    with zipfile.ZipFile(out) as archive, zipfile.ZipFile(path) as original:
        assert sorted(archive.namelist()) == sorted(original.namelist())
        for name, text in plates.items():
            assert archive.read(name) == text + b"; end\n"
            digest = hashlib.md5(text + b"; end\n", usedforsecurity=False).hexdigest().upper()
            assert archive.read(name + ".md5").decode() == digest
        assert archive.read("notes") == original.read("notes")
        assert archive.getinfo("notes").date_time == original.getinfo("notes").date_time
        assert archive.getinfo("notes").compress_type == zipfile.ZIP_DEFLATED
    assert read_gcode(path).moves.end_mm[0, 0] == 1


def read_everything(path: Path) -> None:
    with open_gcode(path) as file:
        for part in file.parts:
            for _ in part.chunks():
                pass


def refused(path: Path) -> str:
    with pytest.raises(GcodeError) as caught:
        read_everything(path)
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith(str(path))
    return message


def test_hostile_projects_are_refused(tmp_path):
    plate = {"Metadata/plate_1.gcode": b"G1 X1\n"}
    for bad in ("../evil", "/etc/passwd", "a\\b", "c:/x"):
        assert repr(bad) in refused(project(tmp_path, plate, **{bad: b"x"}))
    assert "unpack" in refused(project(tmp_path, {"Metadata/plate_1.gcode": b"0" * (64 << 20)}))
    assert "together" in refused(project(tmp_path, {f"Metadata/plate_{i}.gcode": b"0" * (17 << 20) for i in (1, 2)}))
    assert "no Metadata" in refused(project(tmp_path, {}))
    good = project(tmp_path, {"Metadata/plate_1.gcode": b"G1 X1\n" * 5000})
    data = good.read_bytes()
    good.write_bytes(data[: len(data) // 2])
    assert "broken zip" in refused(good)
    broken = bytearray(data)
    broken[data.index(b"plate_1.gcode") + 20] ^= 0xFF
    good.write_bytes(broken)
    refused(good)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "an empty file"),
        (bytes(range(256)) * 40, "other binary data"),
        (b"\x1f\x8b\x08" + bytes(2000), "other binary data"),
        (b"GCDE", "4 bytes"),
        (b"GCDE\x01\0\0\0\x01\0", "none"),
        (b"GCDE\x09\0\0\0\x01\0", "version 9"),
        (b"GCDE\x01\0\0\0\x01\0\x01\0", "the end of the file"),
        (b"GCDE\x01\0\0\0\x01\0\x63\0\0\0\0\0\0\0", "type 99"),
        (b"PK\x03\x04" + b"x" * 50, "a broken zip"),
        (b"G1 X1 " * ((CHUNK_BYTES + MAX_LINE_BYTES) // 6 + 1), "a line of more than"),
    ],
)
def test_bad_files_are_refused_in_one_line(tmp_path, data, words):
    path = tmp_path / "bad.gcode"
    path.write_bytes(data)
    assert words in refused(path)


def test_a_wrong_crc_a_missing_file_and_a_file_without_motion_are_refused(corpus, tmp_path):
    path = corpus / "gcode/prusa3d__Prusa-Firmware-Buddy/test_bad_crc_gcode.bgcode"
    assert "wrong CRC" in refused(path)
    assert "no such file" in refused(tmp_path / "nowhere.gcode")
    with pytest.raises(GcodeError, match="no G0–G3 move"):
        read_gcode(b"; only a comment\nM104 S200\n")


def test_text_with_foreign_bytes_is_still_text(tmp_path):
    path = tmp_path / "a.gcode"
    path.write_bytes(b"G28\n; caf\xe9 \xff\xfe \0\0\nG1 X5 ; \xc3\xa9\n" * 20)
    assert len(read_gcode(path).moves) == 20


@pytest.mark.parametrize("eol", [b"\n", b"\r\n", b"\r"])
def test_chunks_are_whole_lines_and_add_up(tmp_path, eol):
    line = b"G1 X10 Y10 E.1 ; " + b"x" * 50 + eol
    text = line * ((3 * CHUNK_BYTES) // len(line)) + b"G1 X1"
    path = tmp_path / "a.gcode"
    path.write_bytes(text)
    with open_gcode(path) as file:
        chunks = [bytes(chunk) for chunk in file.parts[0].chunks()]
        assert b"".join(chunks) == text
        assert b"".join(bytes(chunk) for chunk in file.parts[0].chunks()) == text  # once more
    assert all(chunk.endswith(eol[-1:]) for chunk in chunks[:-1])
    assert max(map(len, chunks)) < CHUNK_BYTES + MAX_LINE_BYTES
    assert len(chunks) >= 3


@pytest.mark.parametrize(
    ("text", "before"),
    [
        (b"; generated by a slicer\nG28\n", b"; generated by a slicer\n"),
        (b"; generated by a slicer\r\nG28\r\n", b"; generated by a slicer\r\n"),
        (b"\xef\xbb\xbfG28\n", b"\xef\xbb\xbf"),
        (b"G28\nG1 X1\n", b""),
        (b"; HEADER_BLOCK_START\n; x\n; HEADER_BLOCK_END\nG28\n", b"; HEADER_BLOCK_START\n; x\n; HEADER_BLOCK_END\n"),
        (b"; thumbnail begin 16x16 9\n; abc\n", b""),
        (b"%\nG1 X1\n", b"%\n"),
        (b"; one line", b"; one line\n"),
    ],
)
def test_the_mark_follows_the_header_and_is_found(text, before):
    output = b"".join(bytes(chunk) for chunk in marked([np.frombuffer(text, np.uint8)], "1a2b"))
    assert output.startswith(before + b"; mended by printmend ")
    assert find_mark(output) == "1a2b"
    assert find_mark(text) is None
    kept = re.sub(rb"; mended by printmend \S+ model=1a2b(\r?\n)?", b"", output)
    assert kept.rstrip(b"\n") == text.rstrip(b"\n")
    assert output.count(b"\r\n") in (0, output.count(b"\n"))


@given(
    st.lists(st.sampled_from([b"G1 X1", b"G1 X1 ; a", b"; b", b"", b"M104 S200", b'G"', b"T0\r"]), max_size=12),
    st.booleans(),
)
def test_hints_are_a_text_without_the_lines_that_only_move(lines: list[bytes], closed: bool) -> None:
    text = b"\n".join(lines) + (b"\n" if closed else b"")
    said = [
        line
        for line in re.findall(rb"[^\n]*\n|[^\n]+", text)
        if line[:1] != b"G" or any(byte in line for byte in b';("')
    ]
    assert _without_moves(text) == b"".join(said)
