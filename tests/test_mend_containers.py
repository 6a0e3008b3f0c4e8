"""Whole files: plain, .bgcode, .gcode.3mf; the mark; the corpus."""

import hashlib
import re
import zipfile
from pathlib import Path

import pytest

from printmend.corruption import HEALTHY, Corruption, Drive, Play
from printmend.errors import GcodeError, ModelError, RefusedError
from printmend.gcode.container import open_gcode
from printmend.gcode.machine import Flavour
from printmend.gcode.read import read_gcode
from printmend.mend import check_gcode, mend_gcode
from printmend.mend.against import judged
from printmend.printer import read_printer
from tests.mending import BENT, ENDER3, PLAY, SQUARE, START, coarsely, exactly, mended
from tests.test_mend_text import HEAD, TAIL

HEALTHY_ENDER3 = HEALTHY.lower(ENDER3)


def plain(folder: Path, text: bytes = HEAD + SQUARE + TAIL) -> Path:
    path = folder / "part.gcode"
    path.write_bytes(text)
    return path


def test_mends_a_plain_file_and_marks_it(tmp_path: Path) -> None:
    source, output = plain(tmp_path), tmp_path / "out.gcode"
    done = mend_gcode(source, exactly(BENT), output)
    assert done.prediction.after.rms_mm < 0.006 < done.prediction.before.rms_mm
    lines = output.read_bytes().splitlines()
    marks = [line for line in lines if line.startswith(b"; mended by printmend ")]
    assert len(marks) == 1
    assert exactly(BENT).digest.encode() in marks[0]
    again = judged(done.prediction, str(source), str(output), exactly(BENT).mechanism)
    assert again.after.rms_mm < 0.006


def test_does_not_mend_twice(tmp_path: Path) -> None:
    source, output = plain(tmp_path), tmp_path / "out.gcode"
    mend_gcode(source, exactly(BENT), output)
    before = output.read_bytes()
    with pytest.raises(GcodeError, match="mended with model"):
        mend_gcode(output, exactly(BENT), output)
    assert output.read_bytes() == before
    output.write_bytes(b"".join(line for line in before.splitlines(keepends=True) if b"; mended by" not in line))
    with pytest.raises(GcodeError, match="one that was mended; the comment"):  # its seal is still there
        mend_gcode(output, exactly(BENT), tmp_path / "again.gcode")


def test_in_place(tmp_path: Path) -> None:
    source = plain(tmp_path)
    source.chmod(0o640)
    mend_gcode(source, exactly(BENT), source)
    assert b"; mended by printmend" in source.read_bytes()
    assert source.stat().st_mode & 0o777 == 0o640
    assert [path.name for path in tmp_path.iterdir()] == ["part.gcode"]


def test_healthy_returns_every_byte(tmp_path: Path) -> None:
    source, output = plain(tmp_path), tmp_path / "out.gcode"
    mend_gcode(source, exactly(HEALTHY_ENDER3), output)
    assert output.read_bytes() == source.read_bytes()


def test_what_mending_would_not_help_stays_as_it_is(tmp_path: Path) -> None:
    """Moves along which the fault does not show: nothing would be better afterwards, so every byte stays."""
    source, output = plain(tmp_path, START + b"G1 X60.002 E1 F1800\n"), tmp_path / "out.gcode"
    left = mend_gcode(source, tiny_model(), output).prediction
    assert left.is_untouched
    assert left.after == left.before
    assert output.read_bytes() == source.read_bytes()
    mend_gcode(source, tiny_model(), output, force=True)
    assert output.read_bytes() != source.read_bytes()


def tiny_model():
    return exactly(coarsely(Corruption((Drive(belt=Play(0.001)), Drive()))))


def test_refuses_what_the_bed_does_not_hold(tmp_path: Path) -> None:
    source = plain(tmp_path, START + b"G1 X219.95 E9 F1800\nG1 Y219.9 E9\nG1 X0.05 E9\n")
    with pytest.raises(RefusedError, match="beyond the edge of the bed"):
        mend_gcode(source, exactly(PLAY), tmp_path / "out.gcode")


@pytest.mark.parametrize("comment", [b";LAYER_CHANGE\n", b""], ids=["layers", "no layer comments"])
def test_a_purge_line_at_the_edge_may_be_held_back(tmp_path: Path, comment: bytes) -> None:
    """Before the first layer comment the edge of the bed is not the part's; without comments nobody can tell."""
    purge = b"G0 X219.8 Y20 F6000\nG1 Y150 E10 F1500\nG0 X219.9\nG1 Y20 E10\n"
    source, output = plain(tmp_path, START + purge + comment + SQUARE.removeprefix(START)), tmp_path / "out.gcode"
    if not comment:
        with pytest.raises(RefusedError, match="beyond the edge of the bed"):
            mend_gcode(source, exactly(PLAY), output)
        return
    done = mend_gcode(source, exactly(PLAY), output)
    assert done.prediction.clamped_extruding > 0
    assert "held back" in done.prediction.summary()
    assert max(read_gcode(output, printer=ENDER3).moves.end_mm[:, 0]) <= 220


def test_a_print_moved_as_far_as_is_said_is_on_the_bed(tmp_path: Path) -> None:
    def square(x: float) -> bytes:
        return START + b"".join(
            b"G1 X%.2f Y%d E1 F1800\n" % (x - a, y) for a, y in ((0, 60), (0, 80), (9, 80), (9, 60))
        )

    with pytest.raises(RefusedError, match=r"extruding commands 10\.\d+ mm beyond the edge") as refused:
        mend_gcode(plain(tmp_path, square(230.0)), exactly(PLAY), tmp_path / "out.gcode")
    away = float(re.search(r"([\d.]+) mm beyond", str(refused.value))[1])
    assert mend_gcode(plain(tmp_path, square(230.0 - away)), exactly(PLAY), tmp_path / "out.gcode").prediction.on_bed


def test_refuses_another_printers_file(tmp_path: Path) -> None:
    source = plain(tmp_path, START + b"G1 X290 Y250 E9 F1800\nG1 X20 E9\n")
    with pytest.raises(ModelError, match="use the model of the printer"):
        mend_gcode(source, exactly(BENT), tmp_path / "out.gcode")
    with pytest.raises(ModelError, match="use the model of the printer"):
        check_gcode(source, exactly(BENT))


@pytest.mark.parametrize(
    ("content", "match"),
    [(b"", "empty"), (bytes(range(128, 256)) * 99, "binary"), (b"GCDE\x01\0\0\0\x01\0garbage", "bgcode"),
     (b"; nothing\nM104 S0\n", "motion"), (b"PK\x03\x04 but no zip", "3mf|zip|ZIP|archive")],
)  # fmt: skip
def test_bad_files(tmp_path: Path, content: bytes, match: str) -> None:
    source = plain(tmp_path, content)
    with pytest.raises(GcodeError, match=match):
        mend_gcode(source, exactly(BENT), tmp_path / "out.gcode")
    assert not (tmp_path / "out.gcode").exists()


def test_3mf_keeps_everything_else(tmp_path: Path) -> None:
    source, output = tmp_path / "part.gcode.3mf", tmp_path / "out.gcode.3mf"
    text = HEAD + SQUARE + TAIL
    with zipfile.ZipFile(source, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("Metadata/plate_1.gcode", text)
        archive.writestr("Metadata/plate_1.gcode.md5", hashlib.md5(text, usedforsecurity=False).hexdigest().upper())
        archive.writestr("Metadata/slice_info.config", "<config/>")
    mend_gcode(source, exactly(BENT), output)
    with zipfile.ZipFile(output) as archive:
        plate = archive.read("Metadata/plate_1.gcode")
        digest = archive.read("Metadata/plate_1.gcode.md5")
        assert archive.read("Metadata/slice_info.config") == b"<config/>"
    assert b"; mended by printmend" in plate
    assert digest.decode().lower() == hashlib.md5(plate, usedforsecurity=False).hexdigest()
    with pytest.raises(GcodeError, match="mended"):
        mend_gcode(output, exactly(BENT), output)


def test_plates_of_a_project_are_prints_of_their_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each plate is mended as if it were alone, with its own checksum, by the firmware that the settings name. It is
    read to its end once."""
    source, output = tmp_path / "part.gcode.3mf", tmp_path / "out.gcode.3mf"
    plates = {1: START + b"G1 X80 Y80 E1 F1800\n", 2: SQUARE + b"G91\nG1 X5 E1\nG1 Y5 E1\nG90\nG1 X60 E2\n"}
    settings = b'{"from": "project", "gcode_flavor": "reprapfirmware"}'
    with zipfile.ZipFile(source, "w", zipfile.ZIP_DEFLATED) as archive:
        for number, text in plates.items():
            archive.writestr(f"Metadata/plate_{number}.gcode", 5 * (b";" + b"x" * 900_000 + b"\n") + text)
            text = archive.read(f"Metadata/plate_{number}.gcode")
            said = hashlib.md5(text, usedforsecurity=False).hexdigest() if number == 1 else "0" * 32
            archive.writestr(f"Metadata/plate_{number}.gcode.md5", said)
        archive.writestr("Metadata/project_settings.config", settings)
    with open_gcode(source) as file:
        assert [part.flavour() for part in file.parts] == [Flavour.RRF, Flavour.RRF]
    ends = []
    read = zipfile.ZipExtFile.read
    monkeypatch.setattr(zipfile.ZipExtFile, "read", lambda *a: read(*a) or ends.append(a[0].name) or b"")
    done = mend_gcode(source, exactly(BENT), output)
    monkeypatch.undo()
    assert ends.count("Metadata/plate_2.gcode") == 1
    assert len(done.prediction.layers) == 2
    (changed,) = done.prediction.warnings
    assert "plate_2.gcode does not match its checksum (.md5)" in changed
    with zipfile.ZipFile(output) as archive:
        for number, text in plates.items():
            plate = archive.read(f"Metadata/plate_{number}.gcode")
            assert plate.count(b"; mended by printmend") == 1
            assert plate.endswith(b"\n" + mended(text, exactly(BENT).mechanism, Flavour.RRF)[0])
            digest = archive.read(f"Metadata/plate_{number}.gcode.md5").decode()
            assert digest == hashlib.md5(plate, usedforsecurity=False).hexdigest()


def test_a_mended_file_is_not_checked_as_an_original(tmp_path: Path) -> None:
    source, output = plain(tmp_path), tmp_path / "out.gcode"
    mend_gcode(source, exactly(BENT), output)
    for model in (exactly(BENT), exactly(HEALTHY_ENDER3)):
        with pytest.raises(GcodeError, match="mended with model"):
            check_gcode(output, model)
    with pytest.raises(GcodeError, match="mended with model"):
        mend_gcode(output, exactly(HEALTHY_ENDER3), output)


def test_the_mark_is_found_behind_a_long_header(tmp_path: Path) -> None:
    head = b"; HEADER_BLOCK_START\n" + b"; x\n" * 700_000 + b"; HEADER_BLOCK_END\n"
    source, output = plain(tmp_path, head + SQUARE), tmp_path / "out.gcode"
    mend_gcode(source, exactly(BENT), output)
    with pytest.raises(GcodeError, match="mended with model"):
        mend_gcode(output, exactly(BENT), output)


def small_files(corpus: Path) -> list[Path]:
    return sorted(path for path in (corpus / "gcode").rglob("*") if path.is_file() and path.stat().st_size < 900_000)


def test_healthy_identity_on_the_corpus(corpus: Path, tmp_path: Path) -> None:
    output, checked = tmp_path / "out", 0
    for source in sorted(path for path in (corpus / "gcode").rglob("*") if path.is_file()):
        if "bad_crc" in source.name:
            continue
        try:
            mend_gcode(source, exactly(HEALTHY_ENDER3), output)
        except ModelError:
            continue  # larger than the bed of this printer
        assert output.read_bytes() == source.read_bytes(), source.name
        checked += 1
    assert checked >= 40


def test_mending_the_corpus(corpus: Path, tmp_path: Path) -> None:
    """Every file ends in one of three ways: mended and judged right by an independent reading, refused, or an error."""
    output, mended_files = tmp_path / "out.gcode", 0
    for source in small_files(corpus):
        output.unlink(missing_ok=True)
        try:
            done = mend_gcode(source, exactly(BENT), output)
        except (RefusedError, GcodeError, ModelError):
            assert not output.exists()
            continue
        mended_files += 1
        predicted = done.prediction
        if predicted.mended_mm == pytest.approx(predicted.length_mm):  # nothing stays as it is
            assert predicted.after.rms_mm < 0.02, source.name
        before, after = read_gcode(source, printer=ENDER3).moves, read_gcode(output, printer=ENDER3).moves
        assert after.layer.max() == before.layer.max(), source.name
        filament = after.extrusion_mm.sum(), before.extrusion_mm.sum()
        assert filament[0] == pytest.approx(filament[1], abs=1e-4 * (2 + before.layer.max())), source.name
    assert mended_files >= 8


def test_bgcode(corpus: Path, tmp_path: Path) -> None:
    source = corpus / "gcode" / "prusa3d__libbgcode" / "mini_cube_b.bgcode"
    output = tmp_path / "out.bgcode"
    with pytest.raises(ModelError, match="180, 180"):  # sliced for a smaller bed
        mend_gcode(source, exactly(BENT), output)
    done = mend_gcode(source, exactly(BENT), output, force=True)
    assert done.prediction.after.rms_mm < 0.01
    assert output.read_bytes()[:4] == b"GCDE"
    again = judged(done.prediction, str(source), str(output), exactly(BENT).mechanism)
    assert again.after.rms_mm < 0.01
    with pytest.raises(GcodeError, match="mended"):
        mend_gcode(output, exactly(BENT), output)


@pytest.mark.parametrize(
    ("preset", "said"),
    [
        ("prusa-mk3s", "MK3S"), ("prusa-mk3s", "Original Prusa i3 MK3S & MK3S+"), ("prusa-mini", "MINI"),
        ("voron2-250", "Voron V2.4 250mm"), ("ender3-v2", "ENDER3V2"), ("cr10s", "Creality CR-10S"), ("taz6", "TAZ6"),
        ("i3-mega", "I3MEGA"), ("ender5", "ENDER5"), ("corexy", "ENDER5"),
    ],
)  # fmt: skip
def test_a_printer_named_as_slicers_name_it_is_itself(tmp_path: Path, preset: str, said: str) -> None:
    source = tmp_path / "part.gcode"
    source.write_bytes(f"; printer_model = {said}\n".encode() + SQUARE)
    broken = coarsely(Corruption((Drive(belt=Play(0.4)), Drive())), read_printer(preset))
    mend_gcode(source, exactly(broken), tmp_path / "out.gcode")
    assert (tmp_path / "out.gcode").exists()


def test_bad_crc(corpus: Path, tmp_path: Path) -> None:
    source = corpus / "gcode" / "prusa3d__Prusa-Firmware-Buddy" / "test_bad_crc_gcode.bgcode"
    with pytest.raises(GcodeError, match="CRC"):
        mend_gcode(source, exactly(BENT), tmp_path / "out.bgcode")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("header", "named"),
    [
        ("; printer_model = ENDER5\n", "ENDER5"),
        ("; printer_model = MK3S\n", "MK3S"),
        ("; printer_model = Bambu Lab P1S\n", "for Bambu Lab P1S"),
        ("; printer_settings_id = Anycubic Kobra 2 0.4 nozzle\n", "Kobra 2"),
        ("; printer_settings_id = Original Prusa MK4S 0.4 nozzle\n", "MK4S"),
        ("; printer_model = Voron V2.4 300mm\n", "Voron"),
        ("; printer_model = Creality Ender-3 Pro\n", ""),
        ("; printer_settings_id = Dominic's printer plus\n", ""),
        ("; printer_settings_id = &\n", ""),
        ("; bed_shape = 0x0,300x0,300x300,0x300\n", "300, 300"),
        ("; printer_model = MK4S\n; bed_shape = 0x0,250x0,250x210,0x210\n", "of MK4S"),
        ("; Bed left:0 right:300 top:300 bottom:0\n; Bed type: fixed\n; Target: Voron V2.4 300mm\n", "of Voron V2.4"),
        ("; Bed left:0 right:1.2.3 top:. bottom:0\n; Target: something else\n", ""),
        (";MINX:20.1\n;MINY:20\n;MAXX:280\n;MAXY:210.5\n", "from 20.1 to 280 mm"),
        (";MINX:2.14748e+06\n;MINY:2.14748e+06\n;MAXX:-2.14748e+06\n;MAXY:-2.14748e+06\n", ""),
        ("; printer_model = \n; printer_settings_id = \n; bed_shape = 0x0,200x0,200x200,0x200\n", ""),
        (";TARGET_MACHINE.NAME:Prusa MINI+\n", "Prusa MINI"),
        ("; printer_settings_id = Bob's\n; bed_shape = 0x0,235x0,235x235,0x235\n", ""),
        ("; printer_settings_id = my own ender3\n; bed_shape = 5x5,230x5,230x230,5x230\n", ""),
    ],
)
def test_a_file_for_another_printer_needs_force(tmp_path, header, named):
    source, output = tmp_path / "part.gcode", tmp_path / "out.gcode"
    source.write_bytes(header.encode() + SQUARE)
    if named:
        with pytest.raises(ModelError, match=named) as caught:
            mend_gcode(source, exactly(BENT), output)
        assert "--force" in str(caught.value)
        assert not output.exists()
    mend_gcode(source, exactly(BENT), output, force=bool(named))
    assert output.exists()


def test_a_slicers_smaller_bed_is_said_and_mended(tmp_path):
    source, output = tmp_path / "part.gcode", tmp_path / "out.gcode"
    source.write_bytes(b"; bed_shape = 0x0,100x0,100x120,0x120\n" + SQUARE)
    (words,) = mend_gcode(source, exactly(BENT), output).prediction.warnings
    assert "from (0, 0) to (100, 120) mm, this printer's from (0, 0) to (220, 220) mm. The print fits" in words
    assert check_gcode(source, exactly(BENT)).warnings == (words,)
    source.write_bytes(b"; bed_shape = -60x-60,60x-60,60x60,-60x60\n" + SQUARE)
    with pytest.raises(ModelError, match=r"\(-60, -60\) to \(60, 60\)"):
        mend_gcode(source, exactly(BENT), output, force=False)
