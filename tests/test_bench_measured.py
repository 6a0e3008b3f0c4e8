"""Measured sets: their forms, their splits, and a row for every learner."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image
from scipy.io import savemat

from printmend.errors import InputError, TraceError
from printmend.protocols import WorldModel
from printmend_lab.bench import measured as forms
from printmend_lab.bench.measured import (
    SOURCES,
    MeasuredRow,
    MeasuredSet,
    MeasuredStand,
    Track,
    bench_of,
    content_digest,
    less_free,
    measured_cases,
    measured_table,
    source,
    span,
)
from printmend_lab.cli.bench import command

# Of the words of every split, fixed before any learner was judged: a change makes another benchmark.
SPLITS = "ae2d5729c8d2eacb"
CORPUS = {
    "pulleys": "29096af59b4c808c",
    "encoder": "4a31ded6fa3ab1e0",
}  # of what is learned from and judged of the files themselves


def write_servo(path: Path) -> Path:
    """A log of the form of the published ones: a target every 5 rows, the servo behind it by half its play."""
    rng, head = np.random.default_rng(0), "timestamp,target pos (5),pos (5),target pos (3),pos (3)"
    lines, at = [head, "t,2047,,1747,"], 2047  # the published logs begin before the servos answer
    before = 2047
    for target in rng.integers(1800, 2300, 40):
        for k in range(5):
            at = at + (target - at) // 2 if k < 3 else target - 5 * int(np.sign(target - before))
            lines.append(f"t,{target},{at},1747,1748")
        before = target
    path.write_text("\n".join(lines) + "\n")
    return path


def write_damper(path: Path, count: int = 4000) -> Path:
    """A test as it is published: six columns, and what they are counted in."""
    t = np.linspace(0, 20, count)
    x = np.sin(t)
    data = np.stack([t, x, np.clip(np.cumsum(np.diff(x, prepend=0)) * 9, -1, 1), np.cos(t), 0 * t, 0 * t], axis=1)
    units = {"displacement": "in", "time": "s", "friction force": "kip", "actuator force": "lb"}
    said = {"dt": 20 / count, "sampling freq": count / 20, **{f"{name} units": unit for name, unit in units.items()}}
    path.write_text(json.dumps({"data": data.tolist(), **said}))
    return path


def write_encoder(path: Path) -> Path:
    counts = np.arange(16384)
    angle = counts * 36000 / 16384 + 20 * np.cos(2 * np.pi * counts / 16384) + 6392
    rows = "\n".join(f"{n},{round(a) % 36000}" for n, a in enumerate(angle))
    path.write_text("index,value\n" + rows + "\n")
    return path


def write_dimensions(path: Path) -> Path:
    lines = [f"{axis},{n * 5},{n * 5 * 1.01 + 0.02 * (n % 3)}" for axis in "xy" for n in range(1, 13)]
    path.write_text("axis,nominal_mm,measured_mm\n" + "\n".join(lines) + "\n")
    return path


def write_specimens(folder: Path, *, count: int = 4, dpi: int = 150, scale: float = 0.98) -> Path:
    """Scans of dog-bones that came out too small, each turned on its paper, with dust and a blue line beside."""
    folder.mkdir()
    lines = ["file,dpi,length_mm,width_mm,neck_mm"]
    for number in range(count):
        rows, columns = np.mgrid[0 : 4 * dpi, 0 : 7 * dpi] * 25.4 / dpi
        turn = np.radians(3.0 * number - 4)
        x, y = columns - columns.mean(), rows - rows.mean()
        along, across = x * np.cos(turn) + y * np.sin(turn), y * np.cos(turn) - x * np.sin(turn)
        half = scale * np.where(np.abs(along) > 40 * scale, 10.0, 5.0)
        bone = (np.abs(along) < 75 * scale) & (np.abs(across) < half)
        picture = np.full((*bone.shape, 3), 250, np.uint8)
        picture[bone] = (230, 200, 40)
        picture[2:4, 10:60] = (60, 60, 240)
        Image.fromarray(picture).save(folder / f"scan{number}.png")
        lines.append(f"scan{number}.png,{dpi},150,20,10")
    (folder / "nominal.csv").write_text("\n".join(lines) + "\n")
    return folder


def write_bouc_wen(folder: Path) -> Path:
    folder.mkdir()
    for name in ("multisine", "sinesweep"):
        u = np.sin(np.linspace(0, 40, 600))
        for kind, values in (("u", u), ("y", 0.01 * np.roll(u, 3))):
            savemat(folder / f"{kind}val_{name}.mat", {f"{kind}val_{name}": values[None]})
    return folder


def write_tanks(path: Path) -> Path:
    u = np.sin(np.linspace(0, 30, 500))[:, None]
    savemat(path, {"uEst": u, "yEst": u + 1, "uVal": u[::-1], "yVal": u[::-1] + 1, "Ts": 4.0})
    return path


def test_splits_are_sealed() -> None:
    words = "\n".join(f"{item.name}: {item.split}" for item in SOURCES)
    assert hashlib.sha256(words.encode()).hexdigest().startswith(SPLITS)


def test_every_source_says_its_licence_and_how_to_fetch_it() -> None:
    for item in SOURCES:
        assert all((item.licence, item.origin, item.fetch, item.split, item.place))
        assert item.origin != item.fetch


def test_servo_rows_count_once_settled(tmp_path: Path) -> None:
    (only,) = forms.read_servo(write_servo(tmp_path / "log.csv"))
    assert only.name == "servo 5"
    learned, judged = only.learned[0], only.judged[0]
    assert (len(learned.commanded), len(judged.commanded)) == (20, 20)
    np.testing.assert_array_equal(np.abs(learned.commanded - learned.measured), 5)


def test_a_servo_that_is_called_away_is_not_settled(tmp_path: Path) -> None:
    """As in the published log, whose second motor gets a new target while it is still on its way."""
    path = tmp_path / "log.csv"
    lines = ["target pos (5),pos (5),target pos (3),pos (3)"]
    for n in range(20):
        for k, pos in enumerate((1994, 2010, 2030, 2042, 2042)):
            lines.append(f"{2047 - n % 2},{pos},{2147 if n % 2 else 1747},{1748 + 80 * k}")
    path.write_text("\n".join(lines) + "\n")
    assert [item.name for item in forms.read_servo(path)] == ["servo 5"]


def test_a_damper_is_halved(tmp_path: Path) -> None:
    (only,) = forms.read_damper(write_damper(tmp_path / "d.json"))
    assert (len(only.learned[0].commanded), len(only.judged[0].commanded)) == (250, 250)


def test_an_encoders_turn_is_unwrapped(tmp_path: Path) -> None:
    (only,) = forms.read_encoder(write_encoder(tmp_path / "lut.csv"))
    assert only.mm_per_unit == 40 / 16384
    error = only.learned[0].measured - only.learned[0].commanded
    assert np.ptp(error) == pytest.approx(40 * 16384 / 36000, abs=1)
    assert set(only.learned[0].commanded) & set(only.judged[0].commanded) == set()


def test_an_encoder_is_the_same_from_a_table_and_from_firmware(tmp_path: Path) -> None:
    table = write_encoder(tmp_path / "a_lookup.csv")
    values = [line.split(",")[1] for line in table.read_text().splitlines()[1:]]
    firmware = tmp_path / "Firmware" / "lookup_table.cpp"
    firmware.parent.mkdir()
    old = ", ".join(["7"] * 16384)
    firmware.write_text(f"/* old {{{old}}} */\nconst int lookup[] = {{{', '.join(values)}}}; // {{1, 2}}\n")
    (by_table,), (by_firmware,) = forms.read_encoder(table), forms.read_encoder(tmp_path)
    assert content_digest(by_table) == content_digest(by_firmware)
    firmware.unlink()
    assert content_digest(forms.read_encoder(tmp_path)[0]) == content_digest(by_table)
    table.unlink()
    with pytest.raises(TraceError, match="neither"):
        forms.read_encoder(tmp_path)


def test_a_digest_is_of_content_not_of_units(tmp_path: Path) -> None:
    x = np.linspace(0, 9, 50)
    item = MeasuredSet("a", (Track(x, np.sin(x)),), (Track(x, np.cos(x)),))
    same = MeasuredSet("a", (Track(x * 25.4, np.sin(x) * (1 + 1e-13)),), (Track(x, np.cos(x)),))
    other = MeasuredSet("a", (Track(x, np.sin(x) * np.where(x > 5, 1.001, 1.0)),), (Track(x, np.cos(x)),))
    assert content_digest(item) == content_digest(same) != content_digest(other)


def test_dimensions_are_split_within_each_axis(tmp_path: Path) -> None:
    sets = forms.read_dimensions(write_dimensions(tmp_path / "d.csv"))
    assert [item.name for item in sets] == ["dimensions x", "dimensions y"]
    assert [float(track.commanded[1]) for track in sets[0].judged] == [10, 20, 30, 40, 50, 60]


def test_scanned_specimens_are_measured_however_they_lie(tmp_path: Path) -> None:
    (only,) = forms.read_specimens(write_specimens(tmp_path / "scans"))
    assert (len(only.learned), len(only.judged)) == (6, 6)
    for track in (*only.learned, *only.judged):
        assert track.measured[1] == pytest.approx(0.98 * track.commanded[1], abs=0.4)  # a pixel is 0.17 mm
    (tmp_path / "scans" / "scan1.png").write_bytes(b"no picture")
    with pytest.raises(TraceError, match="a scan as PNG"):
        forms.read_specimens(tmp_path / "scans")
    Image.new("RGB", (90, 90), "white").save(tmp_path / "scans" / "scan1.png")
    with pytest.raises(TraceError, match="a coloured specimen"):
        forms.read_specimens(tmp_path / "scans")


def test_matlab_benchmarks_are_read(tmp_path: Path) -> None:
    (tanks,) = forms.read_tanks(write_tanks(tmp_path / "dataBenchmark.mat"))
    assert len(tanks.learned[0].commanded) == len(tanks.judged[0].commanded) == 500
    (hysteretic,) = forms.read_bouc_wen(write_bouc_wen(tmp_path / "bw"))
    assert [len(track.commanded) for track in hysteretic.judged] == [300, 600]


@pytest.mark.parametrize(
    ("read", "name", "text", "named"),
    [
        (forms.read_servo, "a.csv", "x\n1\n", "motor that moved"),
        (forms.read_servo, "a.csv", "target pos (1),pos (1)\n1,much\n", "numbers"),
        (forms.read_damper, "a.json", "{}", "named data"),
        (forms.read_damper, "a.json", '{"data": [[1, 2]]}', "rows of time"),
        (forms.read_encoder, "a.csv", "index,value\n0,1\n", "counts 0 to"),
        (forms.read_encoder, "a.csv", "index,angle\n0,1\n", "column value"),
        (forms.read_dimensions, "a.csv", "axis,nominal_mm,measured_mm\nx,1,1\n", "8 positive"),
        (forms.read_tanks, "a.mat", "no matlab", "MATLAB"),
        (forms.read_pulleys, "a.csv", "a,b\n", "pulley_shape"),
    ],
)
def test_wrong_files_are_named(tmp_path: Path, read: object, name: str, text: str, named: str) -> None:
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(TraceError, match=named):
        read(path)  # type: ignore[operator]


def make_folder(root: Path) -> Path:
    """All forms at their places, but for the pulleys, which `tests/test_bench_real.py` makes."""
    for item in SOURCES:
        (root / item.place).parent.mkdir(parents=True, exist_ok=True)
    (root / source("encoder").place).mkdir()
    write_encoder(root / source("encoder").place / "made_lookup.csv")
    write_servo(root / source("servo").place)
    write_damper(root / source("damper").place)
    write_tanks(root / source("tanks").place)
    write_bouc_wen(root / source("bouc-wen").place)
    write_dimensions(root / source("dimensions").place)
    write_specimens(root / source("specimens").place)
    return root


def test_every_form_has_a_row_for_a_learner(tmp_path: Path) -> None:
    cases, absent = measured_cases(make_folder(tmp_path / "data"))
    assert [item.name for item in absent] == ["pulleys"]
    results = measured_table(cases, ("naive", "affine", "backlash", "backlash"), tmp_path / "out")
    assert [item.error for item in results] == [None] * len(results)
    share = {(item.row, item.case.body): item.values["share"] for item in results}
    assert all(value == 1.0 for (row, _), value in share.items() if row == "naive")
    assert share["backlash", "servo 5"] < 0.3
    assert share["affine", "dimensions x"] < 0.5
    again = measured_table(cases, ("naive",), tmp_path / "out")
    assert [item.values for item in again] == [item.values for item in results if item.row == "naive"]


def test_a_learners_prediction_does_not_depend_on_the_units(tmp_path: Path) -> None:
    motor = 30 * np.sin(np.linspace(0, 12, 400))
    track = Track(motor, np.clip(np.cumsum(np.diff(motor, prepend=0)), -20, 20))
    shares = []
    for scale in (1.0, -250.0):
        scaled = Track(track.commanded, scale * track.measured + 7)
        item = MeasuredSet("made", (scaled.part(0, 0.5),), (scaled.part(0.5, 1),))
        shares.append(MeasuredStand(item, bench_of(item)).judge(learned(item), MeasuredRow("backlash"))["share"])
    assert shares[0] == pytest.approx(shares[1], rel=1e-6)


def learned(item: MeasuredSet) -> WorldModel:
    stand = MeasuredStand(item, bench_of(item))
    return stand.fit(stand.measure(MeasuredRow("backlash")), MeasuredRow("backlash"))


def test_the_command_says_what_is_absent_and_how_to_fetch_it(tmp_path: Path) -> None:
    folder, out = make_folder(tmp_path / "data"), str(tmp_path / "out")
    command_line = ["measured", str(folder), "--models", "naive,affine", "--out", out]
    done = CliRunner().invoke(command, [*command_line, "--sets", "pulleys,dimensions", "--json"])
    assert done.exit_code == 0, done.output
    assert {item["body"] for item in json.loads(done.stdout)} == {"dimensions x", "dimensions y"}
    assert "absent: pulleys" in done.stderr
    assert "git clone" in done.stderr
    assert "| naive | 1.000 | 1.000 |" in (tmp_path / "out" / "measured.md").read_text()
    for wrong, named in (
        (["--sets", "no"], "expected names out of"),
        (["--sets", "pulleys"], "expected a measured set"),
    ):
        done = CliRunner().invoke(command, [*command_line, *wrong])
        assert isinstance(done.exception, InputError)
        assert named in str(done.exception)
    done = CliRunner().invoke(command, ["measured", str(folder), "--models", "oracle", "--out", out])
    assert "nobody knows the truth" in str(done.exception)


def test_what_is_free_is_taken_off() -> None:
    track = Track(np.array([0.0, 1, 2, 3]), np.array([5.0, 6, 7, 9]), run_up=-4)
    assert less_free(track, track.measured, "mean").mean() == pytest.approx(0)
    np.testing.assert_allclose(less_free(track, 3 + 2 * track.commanded, "line"), 0, atol=1e-12)
    np.testing.assert_array_equal(less_free(track, track.measured, "start"), track.measured)
    assert span([track]) == (-4.0, 3.0)
    assert len(track.part(0, 0.5).commanded) == 2


def test_the_corpus_is_read_and_sealed(corpus: Path) -> None:
    for name, sealed in CORPUS.items():
        found = hashlib.sha256()
        for one in source(name).read(corpus / "measured" / source(name).place):
            for track in (*one.learned, *one.judged):
                found.update(track.commanded.round(6).tobytes() + track.measured.round(6).tobytes())
        assert found.hexdigest().startswith(sealed), (name, found.hexdigest())
