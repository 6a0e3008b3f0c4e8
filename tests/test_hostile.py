"""Files that no command should fall over: one line, exit code 2, nothing written, nothing changed."""

# ruff: noqa: S603, S607 — runs our own program and fixed words

import contextlib
import json
import os
import shutil
import signal
import struct
import subprocess
import sys
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner

from printmend.cache import kernel_folder
from printmend.cli.main import group
from printmend.corruption import read_corruption
from printmend.errors import InputError, PrintmendError
from printmend.files import replacing
from printmend.gcode.read import read_gcode
from printmend.infer.distances import choose_distances
from printmend.learn.by_hand import said_by_hand
from printmend.measure.callipers import read_readings
from printmend.measure.plan import read_plan
from printmend.measure.table import read_trace
from printmend.model import read_model
from printmend.printer import read_printer
from printmend.probe import design_probe, write_probe
from printmend_lab.bench.case import read_results
from printmend_lab.body.mesh import read_solid
from tests.mending import BENT, SQUARE, START, text_of
from tests.mortal import heed_ctrl_c

PROGRAM = str(Path(sys.executable).parent / "printmend")
ENDER3 = read_printer("ender3")
PLAN = design_probe(ENDER3, size_mm=60)


def _readings(path: Path) -> object:
    distances = choose_distances(PLAN)
    return said_by_hand(distances, read_readings(path, distances))


def _trace(path: Path) -> object:
    return read_trace(path, ENDER3)


READERS: dict[str, Callable[[Path], object]] = {
    "printer": read_printer, "corruption": read_corruption, "model": read_model, "plan": read_plan,
    "readings": _readings, "trace": _trace,
}  # fmt: skip
FILES: dict[str, bytes] = {
    "zeros": b"\0" * 5000,
    "utf-16": 'kinematics = "cartesian"\n'.encode("utf-16"),
    "deep list": b"[" * 100_000,
    "deep object": b'{"a":' * 100_000,
    "deep array": b"a = " + b"[" * 100_000,
    "long integer": b"x = " + b"9" * 10_000,
    "plain long integer": b"9" * 10_000,
    "page": b"<!doctype html><html><body>404</body></html>",
    "image": b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR",
    "endless cell": b"x_mm,y_mm,x_measured_mm,y_measured_mm\n" + b"1" * 200_000,
    "terminal codes": b"\x1b[2J\x1b]0;owned\x07 = 1\n",
}


@pytest.mark.parametrize("content", FILES.values(), ids=FILES.keys())
@pytest.mark.parametrize("reader", READERS.values(), ids=READERS.keys())
def test_readers_refuse_in_one_line(reader: Callable[[Path], object], content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "given"
    path.write_bytes(content)
    with pytest.raises(PrintmendError) as caught:
        reader(path)
    line = str(caught.value)
    assert line.isprintable()
    assert len(line) < 1300
    assert "given" in line


@pytest.mark.parametrize("reader", READERS.values(), ids=READERS.keys())
def test_readers_refuse_what_is_no_file(reader: Callable[[Path], object], tmp_path: Path) -> None:
    loop = tmp_path / "loop"
    loop.symlink_to(loop)
    for path in (tmp_path, loop, tmp_path / "absent", tmp_path / ("x" * 300), Path("/dev/null\0")):
        with pytest.raises(PrintmendError):
            reader(path)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("files")
    (place / "part.gcode").write_bytes(SQUARE)
    (place / "talk.gcode").write_bytes(b"hello world\n" * 9)
    (place / "broken.toml").write_text('[x.belt]\nkind = "play"\nplay_mm = 0.4\n')
    (place / "printer.mend.json").write_text(text_of(BENT))
    write_probe(place / "probe.gcode", PLAN)
    return place


@pytest.fixture
def folder(files: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(files, tmp_path / "own"))


OVERWRITING = [
    "mend part.gcode -m printer.mend.json -o part.gcode",
    "mend part.gcode -m printer.mend.json -o printer.mend.json",
    "mend part.gcode -m printer.mend.json --report printer.mend.json",
    "mend part.gcode -m printer.mend.json -o x.json --report x.json",
    "twin part.gcode --printer ender3 --corruption broken.toml -o part.gcode",
    "twin part.gcode --printer ender3 --corruption broken.toml -o broken.toml",
    "twin part.gcode --printer ender3 --corruption broken.toml -o s.png --scan s.png",
    "learn trace.csv --printer ender3 -o trace.csv",
    "diagnose trace.html --printer ender3 --report trace.html",
    "measure scan.png --probe probe.json -o probe.json",
    "measure scan.png --probe probe.json --overlay scan.png",
]
MOTIONLESS = [
    "mend talk.gcode -m printer.mend.json -o out.gcode",
    "check talk.gcode -m printer.mend.json",
    "twin talk.gcode --printer ender3 --corruption broken.toml -o out.csv",
    "body talk.gcode",
    "probe --printer ender3 --for talk.gcode -o out.gcode",
]
UNWRITABLE = [
    "twin part.gcode --printer ender3 --corruption broken.toml -o out.csv --scan absent/out.png",
    "mend part.gcode -m printer.mend.json -o absent/out.gcode",
    "mend part.gcode -m printer.mend.json -o part.gcode/out.gcode",
    "twin part.gcode --printer ender3 --corruption broken.toml -o absent/out.csv",
    "export -m printer.mend.json --to klipper -o part.gcode/folder",
]


NUMBERS = [
    "twin part.gcode --printer ender3 --corruption broken.toml --noise-mm nan",
    "twin part.gcode --printer ender3 --corruption broken.toml --noise-mm 1e308",
    "twin part.gcode --printer ender3 --corruption broken.toml --seed -1",
    "probe --printer ender3 --size nan",
    "probe --printer ender3 --size inf",
    "measure scan.png --probe probe.json --dpi nan",
    "learn trace.csv --printer ender3 --travel x=nan:1",
    "demo --seed -1 --out demo",
    "bench families --coverage 0 --out bench",
    "bench families --coverage nan --out bench",
    "bench families --noise -1 --out bench",
    "dataset export-reference data --bodies part.gcode --corruptions -1",
]


@pytest.mark.parametrize("line", [*OVERWRITING, *MOTIONLESS, *UNWRITABLE, *NUMBERS])
def test_commands_leave_files_alone(line: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    before = {path: path.read_bytes() for path in folder.iterdir()}
    result = CliRunner().invoke(group, line.split())
    assert isinstance(result.exception, PrintmendError | OSError | SystemExit), result.exception
    assert result.exit_code != 0
    assert {path: path.read_bytes() for path in folder.iterdir() if path.is_file()} == before


def _program(*arguments: object, **options: object) -> subprocess.CompletedProcess:
    command = [PROGRAM, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False, **options)


def test_a_full_disk_ends_in_one_line(folder: Path) -> None:
    """A limit on the size of files stands for the disk; the old file stays."""
    (folder / "out.gcode").write_text("old")
    part = START + b"".join(b"G1 X%d Y%d E1 F1800\n" % (60 + i % 50, 60 + i % 7) for i in range(3000))
    (folder / "part.gcode").write_bytes(part)
    shell = f'ulimit -f 20; exec "{PROGRAM}" mend part.gcode -m printer.mend.json --overwrite -o out.gcode'
    done = subprocess.run(["bash", "-c", shell], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 2, done.stderr
    assert "too large" in done.stderr
    assert done.stderr.count("\n") == 1
    assert (folder / "out.gcode").read_text() == "old"
    assert not list(folder.glob(".*"))


@pytest.mark.parametrize("device", ["/dev/full", "-"])
def test_a_closed_or_full_output(folder: Path, device: str) -> None:
    if device == "-":
        with subprocess.Popen(
            [PROGRAM, "printer", "ender3"], stdout=subprocess.PIPE, stderr=subprocess.PIPE
        ) as running:
            running.stdout.close()
            assert running.stderr.read() == b""
        assert running.returncode == 141
        with subprocess.Popen(
            [PROGRAM, "probe", "--printer", "ender3", "-o", "heard.gcode"], cwd=folder, stdout=subprocess.PIPE
        ) as running:  # what it has to say is lost, what it has to write is not
            running.stdout.close()
        assert (folder / "heard.gcode").exists()
        return
    if not os.path.exists(device):
        pytest.skip("no /dev/full here")
    with open(device, "w") as full:
        done = subprocess.run([PROGRAM, "printer", "ender3"], stdout=full, stderr=subprocess.PIPE, check=False)
    assert done.returncode == 2
    assert done.stderr.count(b"\n") == 1
    with pytest.raises(InputError, match=device), replacing(Path(device)) as file:
        file.write("x")
    (folder / "full.gcode").symlink_to(device)
    with pytest.raises(InputError, match="no space left"):
        write_probe(folder / "full.gcode", design_probe(read_printer("ender3"), marks=40))
    assert not (folder / "full.json").exists()


def test_terminated_while_writing_leaves_no_temporary_file(tmp_path: Path) -> None:
    code = (
        "import sys; from printmend.cli import main as m; from printmend.files import replacing; import click, time\n"
        "@m.group.command('sleepy')\ndef sleepy():\n"
        " with replacing(sys.argv[2]) as file:\n  file.write('half'); print('ready', flush=True); time.sleep(60)\n"
        "m.LazyGroup.get_command = lambda self, context, name: sleepy\n"
        "sys.argv = ['printmend', 'sleepy', sys.argv[1]]\n"
        "sleepy.params = [click.Argument(['place'], expose_value=False)]\nm.main()\n"
    )
    for number, code_wanted in ((signal.SIGTERM, 143), (signal.SIGINT, 130)):
        with subprocess.Popen(
            [sys.executable, "-c", code, str(tmp_path / "out")], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            preexec_fn=heed_ctrl_c,
        ) as running:  # fmt: skip
            assert running.stdout.readline() == b"ready\n"
            running.send_signal(number)
            assert b"Traceback" not in running.stderr.read()
        assert running.returncode == code_wanted
        assert list(tmp_path.iterdir()) == []


def test_stopped_while_it_is_imported_it_ends_quietly(tmp_path: Path) -> None:
    (tmp_path / "click.py").write_text("import os, signal\nos.kill(os.getpid(), signal.SIGINT)\n")
    done = subprocess.run(
        [sys.executable, "-m", "printmend", "--version"], capture_output=True, check=False, preexec_fn=heed_ctrl_c,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])},
    )  # fmt: skip
    assert (done.returncode, done.stdout, done.stderr) == (130, b"", b"")


def test_devices_and_pipes_are_written_not_replaced(tmp_path: Path) -> None:
    with replacing(Path(os.devnull)) as file:
        file.write("nothing")
    assert not Path(os.devnull).is_file()
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with subprocess.Popen(["cat", str(pipe)], stdout=subprocess.PIPE) as reader:
        with replacing(pipe) as file:
            file.write("through")
        assert reader.stdout.read() == b"through"
    with pytest.raises(InputError, match="a folder"), replacing(tmp_path):
        pass


def test_a_fault_of_our_own_is_one_line(folder: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    from printmend.cli import main

    def broken(path: Path) -> None:
        raise ZeroDivisionError("division\nby zero")

    monkeypatch.setattr("printmend.model.read_model", broken)
    monkeypatch.setattr("signal.signal", lambda number, handler: None)
    monkeypatch.setenv("PRINTMEND_TRACEBACK", "0")
    monkeypatch.setattr(sys, "argv", ["printmend", "export", "-m", "x", "--to", "marlin"])
    with pytest.raises(SystemExit) as caught:
        main.main()
    assert caught.value.code == 1
    shown = capsys.readouterr().err
    assert shown.count("\n") == 1
    assert "a bug in printmend" in shown


def test_any_locale_and_any_name(folder: Path) -> None:
    """No locale, no home, no UTF-8 but where a file says so, and a name that is not text in any of them."""
    name = os.fsdecode(b"p\xe4rt \xe2\x82\xac.gcode")
    with contextlib.suppress(OSError):  # some file systems want UTF-8
        (folder / "part.gcode").rename(folder / name)
    name = name if (folder / name).exists() else "part.gcode"
    environment = {"PATH": os.environ["PATH"], "LC_ALL": "C", "PYTHONIOENCODING": "ascii", "HOME": "/nonexistent",
                   "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}  # fmt: skip
    done = subprocess.run(
        [PROGRAM, "mend", name, "-m", "printer.mend.json", "--report", "r.html"],
        cwd=folder, env=environment, capture_output=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert (folder / name.replace(".gcode", ".mended.gcode")).exists()
    assert (folder / "r.html").exists()


def test_kernels_are_kept_where_nobody_else_can_write(tmp_path: Path) -> None:
    nowhere, temporary = Path("/dev/null/x"), tmp_path / "temporary"
    temporary.mkdir()
    assert kernel_folder(tmp_path, nowhere, temporary) is None
    assert kernel_folder(nowhere, tmp_path / "cache", temporary) is None
    own = kernel_folder(nowhere, nowhere, temporary)
    assert own == kernel_folder(nowhere, nowhere, temporary) == temporary / f"printmend-{os.getuid()}"
    assert own.stat().st_mode & 0o777 == 0o700
    own.chmod(0o777)
    other = kernel_folder(nowhere, nowhere, temporary)
    assert other not in (None, own)
    assert other.stat().st_mode & 0o777 == 0o700


@pytest.mark.parametrize(
    "content", [b"null\n", b"[]\n", b"7\n", b'{"a": 1}\n', b"[" * 100_000 + b"\n", b"notes\nof mine"]
)
def test_foreign_results_are_left_alone(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "table1.jsonl"
    path.write_bytes(content)
    with pytest.raises(InputError, match="earlier run"):
        read_results(path)
    assert path.read_bytes() == content


def test_small_files_that_would_fill_the_disk_are_refused(tmp_path: Path) -> None:
    packed = zlib.compress(b"\n" * (1 << 20), 9)
    head = struct.pack("<HHII", 1, 1, 1 << 20, len(packed)) + b"\0\0" + packed
    block = head + struct.pack("<I", zlib.crc32(head))
    (tmp_path / "bomb.bgcode").write_bytes(b"GCDE" + struct.pack("<IH", 1, 1) + block * 40)
    with zipfile.ZipFile(tmp_path / "bomb.3mf", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("3D/3dmodel.model", bytes(34 << 20))
    for read, name in ((read_gcode, "bomb.bgcode"), (read_solid, "bomb.3mf")):
        with pytest.raises(InputError, match="would unpack"):
            read(tmp_path / name)


@pytest.mark.parametrize("value", ["1e999", "-1", "[]", "null", "true", '"x"', "1e308", "9" * 30])
@pytest.mark.parametrize("key", ["row", "x_mm", "site", "direction", "reversal_mm", "big"])
def test_a_plan_with_an_odd_mark_is_read_or_refused(key: str, value: str, files: Path, tmp_path: Path) -> None:
    table = json.loads((files / "probe.json").read_text())
    table["marks"][3][key] = "ODD"
    (tmp_path / "probe.json").write_text(json.dumps(table).replace('"ODD"', value))
    with contextlib.suppress(PrintmendError):
        choose_distances(read_plan(tmp_path / "probe.json"))
