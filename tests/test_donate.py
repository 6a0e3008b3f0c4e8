"""A donation holds what was measured and learned, and nothing of who measured it, where and when."""

import hashlib
import json
import os
import shutil
import zipfile
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from printmend.cli.main import group
from printmend.errors import InputError
from printmend.learn.learned import learn_model
from printmend.measure.plan import read_plan, write_plan
from printmend.measure.table import read_trace, write_trace
from printmend.mend.donation import donation, write_donation
from printmend.mend.history import remember, remember_learned
from printmend.model import SavedModel, model_text, parse_model, write_model
from printmend.path import Origin, Trace
from printmend.printer import read_printer
from printmend.probe import design_probe
from printmend.promise.belief import parse_belief
from tests.test_update import machine, printed

ENDER3 = replace(read_printer("ender3"), name="Bob Meier's Ender-3")
SECRETS = ("bob", "meier", "secret", "2026-05", "2026:05", "berlin", "/home")


@pytest.fixture(scope="module")
def measured() -> tuple[Trace, SavedModel]:
    """A test print on Bob's printer, and what was learned of it, with a note of his."""
    trace = replace(printed(machine(), 300, 1), origin=Origin(ENDER3.name, "cartesian", "0badcafe"))
    model = learn_model(trace, ENDER3)
    document = dict(model.document) | {"note": "of Bob Meier", "learner": "bobs.module:MINE"}
    document["trace"] = {**document["trace"], "file": "/home/bob/secret/trace.csv"}
    bobs = {"part": "x", "kind": "/home/bob", "value": 1, "sd": 1, "unit": "mm"}
    document["diagnosis"] = [*document["diagnosis"], bobs]
    noted = parse_model(model_text(replace(model, document=document)), subject="bob")
    return trace, noted


@pytest.fixture
def folder(tmp_path: Path, bobs: Path) -> Path:
    """All that Bob has, for one test."""
    return Path(shutil.copytree(bobs, tmp_path / bobs.name))


@pytest.fixture(scope="module")
def bobs(tmp_path_factory: pytest.TempPathFactory, measured: tuple[Trace, SavedModel]) -> Path:
    """All that Bob has, with his names in all of it."""
    trace, model = measured
    place = tmp_path_factory.mktemp("donate") / "secret of Bob"
    place.mkdir()
    write_plan(place / "bob.json", design_probe(ENDER3, marks=60))
    write_trace(place / "bob.csv", trace)
    lines = (place / "bob.csv").read_text().splitlines()
    lines = [f"{lines[0]},owner", *(f"{line},bob" for line in lines[1:])]
    (place / "bob.csv").write_text("\n".join([*lines[:3], "# from /home/bob/secret/scan.png,,", *lines[3:]]) + "\n")
    write_model(place / "bob.mend.json", model)
    first = datetime(2026, 5, 1, tzinfo=UTC)
    remember_learned(place / "bob.mend.json", model, "/home/bob/secret/trace.csv", when=first)
    verified = {"now_mm": 0.05, "said": "by Bob"}
    remember(place / "bob.mend.json", model, "verified", verified, when=first + timedelta(days=8))
    texts, exif = PngInfo(), Image.Exif()
    texts.add_text("Author", "Bob Meier")
    texts.add_itxt("XML:com.adobe.xmp", "<x>Berlin</x>")
    exif[0x013B], exif[0x0132] = "Bob Meier", "2026:05:01 10:00:00"
    exif.get_ifd(0x8825)[29] = "2026:05:01"  # GPS
    pixels = np.random.default_rng(0).integers(0, 255, (320, 400, 3), np.uint8)
    Image.fromarray(pixels).save(place / "bob.png", dpi=(600, 600), pnginfo=texts, exif=exif)
    Image.fromarray(pixels).save(place / "bob.jpg", dpi=(600, 600), exif=exif, comment=b"Berlin")
    return place


def donate(folder: Path, *more: str) -> Result:
    given = ["--probe", "bob.json", "--scan", "bob.png", "--scan", "bob.jpg", "--trace", "bob.csv"]
    given += ["-m", "bob.mend.json", "--check", "bob.png", "--check", "bob.csv"]
    names = [str(folder / name) if name.startswith("bob.") else name for name in given]
    return CliRunner().invoke(group, ["donate", *names, "-o", str(folder.parent / "given.zip"), *more])


def test_nothing_personal_is_in_it_and_it_serves_all_the_same(folder: Path, measured: tuple[Trace, SavedModel]) -> None:
    assert donate(folder).exit_code == 0
    with zipfile.ZipFile(folder.parent / "given.zip") as given:
        files = {entry.filename: given.read(entry) for entry in given.infolist()}
        assert {entry.date_time for entry in given.infolist()} == {(1980, 1, 1, 0, 0, 0)}
    assert list(files) == [
        "manifest.json", "probe.json", "scan-1.png", "scan-2.png", "trace.csv", "printer.mend.json", "history.jsonl",
        "check-1.png", "check-2.csv",
    ]  # fmt: skip
    for name, data in files.items():
        if name.endswith(".png"):
            (folder / name).write_bytes(data)
            with Image.open(folder / name) as picture:
                assert set(picture.info) == {"dpi"}
            assert data.count(b"tEXt") + data.count(b"iTXt") + data.count(b"eXIf") == 0
        else:
            assert [secret for secret in SECRETS if secret in data.decode().lower()] == []
    (folder / "trace.csv").write_bytes(files["trace.csv"])
    given_trace = read_trace(folder / "trace.csv", read_printer("ender3"))
    np.testing.assert_allclose(given_trace.commanded_mm, measured[0].commanded_mm, atol=1e-5)
    np.testing.assert_allclose(given_trace.measured_mm, measured[0].measured_mm, atol=1e-5)
    (folder / "probe.json").write_bytes(files["probe.json"])
    assert len(read_plan(folder / "probe.json")) == len(read_plan(folder / "bob.json"))
    model = parse_model(files["printer.mend.json"].decode(), subject="given")
    assert parse_belief(model) is not None
    assert model.printer == replace(ENDER3, name=model.printer.name)
    assert [json.loads(line)["day"] for line in files["history.jsonl"].splitlines()] == [0, 8]


def test_the_manifest_says_what_each_file_is_and_the_terminal_what_was_left_out(folder: Path) -> None:
    said = donate(folder)
    with zipfile.ZipFile(folder.parent / "given.zip") as given:
        manifest = json.loads(given.read("manifest.json"))
        for file in manifest["files"]:
            data = given.read(file["name"])
            assert (len(data), hashlib.sha256(data).hexdigest()) == (file["bytes"], file["sha256"])
            assert file["name"] in said.output
            assert file["what"] in said.output
            assert all(words in said.output for words in file["left_out"])
    assert "1 line without numbers; 1 column of unknown name" in said.output
    assert "of the picture's metadata" in said.output
    assert "Nothing was sent" in said.output


def test_the_same_files_make_the_same_donation(folder: Path) -> None:
    donate(folder)
    first = (folder.parent / "given.zip").read_bytes()
    donate(folder)
    assert (folder.parent / "given.zip").read_bytes() == first


def test_a_picture_keeps_its_pixels_and_its_resolution(folder: Path) -> None:
    (part,) = donation(scans=[folder / "bob.png"])
    (folder / "part.png").write_bytes(part.data)
    with Image.open(folder / "part.png") as given, Image.open(folder / "bob.png") as own:
        assert given.info["dpi"] == pytest.approx(own.info["dpi"])
        np.testing.assert_array_equal(np.asarray(given), np.asarray(own))


def test_a_hostile_path_names_nothing_in_it(tmp_path: Path, folder: Path) -> None:
    odd = tmp_path / "..\n;$(bob)"
    odd.mkdir()
    (folder / "bob.csv").rename(odd / "..  bob.csv")
    write_donation(tmp_path / "given.zip", donation(trace=odd / "..  bob.csv"))
    with zipfile.ZipFile(tmp_path / "given.zip") as given:
        assert given.namelist() == ["manifest.json", "trace.csv"]
        assert b"bob" not in given.read("manifest.json") + given.read("trace.csv")


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ([], "name what to give"),
        (["--trace", "absent.csv"], "expected a file"),
        (["--trace", "."], "expected a file"),
        (["--trace", "pipe"], "expected a file"),
        (["--trace", "bob.mend.json"], "expected"),
        (["--probe", "bob.csv"], "expected a probe.json"),
        (["--scan", "bob.mend.json"], "expected a PNG, TIFF or JPEG scan"),
        (["--trace", "bob.csv", "-o", "bob.csv"], "expected a file of its own to write"),
    ],
)
def test_what_is_not_what_it_is_said_to_be_ends_in_one_line_and_writes_nothing(
    line: list[str], said: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    if "pipe" in line and not hasattr(os, "mkfifo"):
        pytest.skip("this system has no named pipes")
    if "pipe" in line:
        os.mkfifo("pipe")
    before = {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    done = CliRunner().invoke(group, ["donate", *line])
    assert done.exit_code != 0
    assert said in str(done.exception) + done.output
    assert {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()} == before


def test_too_much_is_refused(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="at most 12 pictures"):
        donation(scans=[folder / "bob.png"] * 13)
    monkeypatch.setattr("printmend.mend.donation.MOST_BYTES", 1000)
    with pytest.raises(InputError, match="crop the scans, or give fewer"):
        donation(scans=[folder / "bob.png"])
