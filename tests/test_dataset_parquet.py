"""Data sets in Parquet: what is written is read back, a build goes on where it was killed, wrong files are named."""

import errno
import json
import os
import pickle
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import trimesh
from click.testing import CliRunner

from printmend.bench.table1 import dataset_cases
from printmend.bench.trial import evaluate
from printmend.body.mesh import read_solid
from printmend.body.solid import stl_bytes
from printmend.cli.main import group
from printmend.corruption import read_corruption
from printmend.dataset import build as builder
from printmend.dataset.build import Recipe, body_file, build_dataset, corruption_file, print_file, read_lines
from printmend.dataset.parquet import BODY_COLUMNS, PRINT_COLUMNS, read_about, read_body, read_print
from printmend.dataset.verify import contents, fetch_dataset, verify_dataset
from printmend.errors import InputError, TraceError, UnwritableError
from printmend.executor import Serial
from printmend.files import replacing
from printmend.metrics import rmse
from printmend.printer import read_printer
from printmend.twin import Twin
from tests.bodies import write_vase

RECIPE = Recipe(2, ("pulley-play", "gain-table"), "damaged", 3)


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("sources")
    files = [write_vase(folder / f"vase{n}.gcode", layers=4, radius_mm=9.0 + n) for n in range(3)]
    (folder / "broken.gcode").write_text("M104 S200\n")
    return [*files, folder / "broken.gcode"]


@pytest.fixture(scope="module")
def data(sources: list[Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("data") / "set"
    built = build_dataset(root, sources, RECIPE, Serial(), licence="CC0-1.0")
    assert built.bodies == 3
    ((name, why),) = built.failures
    assert name.startswith("broken-")
    assert "no G0–G3 move" in why
    return root


def test_a_body_and_its_prints_come_back(data: Path) -> None:
    line = read_lines(data / "bodies.jsonl")[0]
    body = read_body(body_file(data, line["body"]))
    assert len(body.layers) == line["layer_count"] == 4
    printer = read_printer("ender5")
    for number in range(2):
        twin = Twin.of(read_corruption(corruption_file(data, number)), printer)
        printed = read_print(print_file(data, line["body"], number))
        for layer, places in zip(body.layers, printed, strict=True):
            np.testing.assert_array_equal(twin.run(layer.controls, layer.start_steps).astype(np.float32), places)
    assert read_body(body_file(data, line["body"]), []).layers == ()
    (one,) = read_body(body_file(data, line["body"]), [2]).layers
    assert one.index == body.layers[2].index
    assert np.array_equal(one.controls, body.layers[2].controls)
    assert np.array_equal(read_print(print_file(data, line["body"], 1), [2])[0], printed[2])


def test_files_are_typed_encoded_a_row_group_a_layer_and_say_what_they_are(data: Path) -> None:
    line = read_lines(data / "bodies.jsonl")[0]
    for path, columns in (
        (body_file(data, line["body"]), BODY_COLUMNS),
        (print_file(data, line["body"], 0), PRINT_COLUMNS),
    ):
        with pq.ParquetFile(path) as file:
            assert {field.name: str(field.type) for field in file.schema_arrow} == {
                name: kind.replace("float32", "float") for name, (kind, _) in columns.items()
            }
            assert file.num_row_groups == 4
            chunks = {file.metadata.row_group(0).column(i).path_in_schema: file.metadata.row_group(0).column(i)
                      for i in range(len(columns))}  # fmt: skip
        assert {chunk.compression for chunk in chunks.values()} == {"ZSTD"}
        for name, (kind, _) in columns.items():
            wanted = {"float32": "BYTE_STREAM_SPLIT", "bool": "PLAIN"}.get(kind, "DELTA_BINARY_PACKED")
            assert wanted in chunks[name].encodings
        about = read_about(path)
        assert about["licence"] == "CC0-1.0"
        assert about["source"].startswith("vase")
    found = contents(data)
    assert (found.bodies, found.failures, found.prints) == (3, 1, 6)
    assert found.points == sum(sum(part["rows"] for part in read_about(body_file(data, one["body"]))["layers"])
                               for one in read_lines(data / "bodies.jsonl"))  # fmt: skip
    assert verify_dataset(data) == []


# The third of four bodies is written and printed once when the machine goes down.
KILLED = """
import os, signal, sys
from pathlib import Path
from printmend.dataset import build as builder
from printmend.executor import Serial
real, calls = builder.write_print, []
def dies(path, *rest):
    calls.append(path)
    if len(calls) == 6:
        half = path.with_name(f".{path.name}.abcdefgh.tmp")
        half.write_bytes(b"half")
        os.utime(half, (0, 0))
        os.kill(os.getpid(), signal.SIGKILL)
    return real(path, *rest)
builder.write_print = dies
recipe = builder.Recipe(2, ("pulley-play", "gain-table"), "damaged", 3)
builder.build_dataset(Path(sys.argv[1]), [Path(name) for name in sys.argv[2:]], recipe, Serial())
"""


def test_a_build_that_was_killed_goes_on_and_writes_each_body_once(
    sources: list[Path], data: Path, tmp_path: Path
) -> None:
    root = tmp_path / "set"
    broken, *whole = reversed(sources)  # what fails comes first: it is not tried again either
    files = [broken, *whole]
    done = subprocess.run(  # noqa: S603 (this interpreter, a list of arguments)
        [sys.executable, "-c", KILLED, str(root), *map(str, files)], capture_output=True, text=True, check=False,
        timeout=300,
    )  # fmt: skip
    assert done.returncode == -signal.SIGKILL, done.stderr
    assert [len(read_lines(root / name)) for name in ("bodies.jsonl", "failures.jsonl")] == [2, 1]
    with (root / "bodies.jsonl").open("a") as file:
        file.write('{"identity": "cut')  # the machine went down in the middle of a line
    before = {path: path.stat().st_mtime_ns for path in (root / "prints").rglob("*.parquet")}
    assert len(before) == 5
    assert build_dataset(root, files, RECIPE, Serial()).bodies == 3
    lines = read_lines(root / "bodies.jsonl")
    assert len({line["identity"] for line in lines}) == len(lines) == 3
    assert len(read_lines(root / "failures.jsonl")) == 1
    for line in lines[:2]:  # only what was under way is done again
        for path in (print_file(root, line["body"], number) for number in range(2)):
            assert path.stat().st_mtime_ns == before[path]
    assert not list(root.rglob("*.tmp"))
    assert verify_dataset(root) == []
    for path in (data / "prints").rglob("*.parquet"):  # and nothing differs from a build in one go but the licence
        assert np.array_equal(
            np.concatenate(read_print(path)), np.concatenate(read_print(root / path.relative_to(data)))
        )


# A slicer that is known by what it does: it crashes, or hangs in a process of its own.
SLICER = """#!/bin/sh
case $(wc -c < body.stl) in
    %d) kill -SEGV $$ ;;
    *) sleep 600 & echo $! > %s; wait ;;
esac
"""


def test_a_body_that_crashes_or_hangs_the_slicer_is_listed_and_the_run_goes_on(
    sources: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    crashes, hangs = tmp_path / "crashes.stl", tmp_path / "hangs.stl"
    trimesh.creation.box((20, 20, 20)).export(crashes)
    trimesh.creation.icosphere(radius=15).export(hangs)
    program, pid = tmp_path / "bin" / "prusa-slicer", tmp_path / "pid"
    program.parent.mkdir()
    program.write_text(SLICER % (len(stl_bytes(read_solid(crashes))), pid))
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{program.parent}:{os.environ['PATH']}")
    tries = ((crashes, 300.0, "got a crash"), (hangs, 3.0, "slices within 3 s"), (hangs, 60.0, "slices within 60 s"))
    for file, limit_s, said in tries:
        if pid.exists():
            break  # else the machine was so busy that within 3 s nothing had begun
        root, recipe = tmp_path / f"{file.stem}-{limit_s:g}", replace(RECIPE, timeout_s=limit_s)
        built = build_dataset(root, [file, sources[0]], recipe, Serial())
        ((name, why),) = built.failures
        assert name.startswith(file.stem)
        assert said in why
        assert built.bodies == 1
    ended = Path(f"/proc/{pid.read_text().strip()}/status")
    for _ in range(100):
        if not ended.exists() or "zombie" in ended.read_text():
            return
        time.sleep(0.1)
    pytest.fail("the slicer goes on after its time")


def test_a_full_disk_ends_the_build_and_is_no_fault_of_a_body(
    sources: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root, real = tmp_path / "set", builder.write_print

    def full(path: Path, *rest: object) -> str:
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path, "wb"):
            raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(builder, "write_print", full)
    with pytest.raises(UnwritableError, match="no space left") as caught:
        build_dataset(root, sources, RECIPE, Serial())
    again = pickle.loads(pickle.dumps(caught.value))  # noqa: S301 - our own; it came from a worker's process
    assert (type(again), str(again)) == (UnwritableError, str(caught.value))
    assert not read_lines(root / "failures.jsonl")
    monkeypatch.setattr(builder, "write_print", real)
    built = build_dataset(root, sources, RECIPE, Serial())
    assert built.bodies == 3
    assert [name.split("-")[0] for name, _ in built.failures] == ["broken"]


def test_a_data_set_is_fetched_whole_and_faults_are_named(data: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    assert fetch_dataset(str(data), copy) == 9
    assert fetch_dataset(str(data), copy) == 0
    assert verify_dataset(copy) == []
    names = [line["body"] for line in read_lines(copy / "bodies.jsonl")]
    os.truncate(body_file(copy, names[0]), 100)
    print_file(copy, names[1], 1).unlink()
    wrong = "\n".join(verify_dataset(copy))
    assert f"{names[0]}.parquet: not the file that was written" in wrong
    assert f"{names[1]}.parquet: missing" in wrong
    with pytest.raises(TraceError, match="a Parquet file of this data set"):
        read_body(body_file(copy, names[0]))
    line = read_lines(copy / "bodies.jsonl")[0]
    line["files"] = {"../../escape.parquet": "0"}
    (copy / "bodies.jsonl").write_text(json.dumps(line) + "\n")
    with pytest.raises(InputError, match="below bodies/ and prints/"):
        fetch_dataset(str(copy), tmp_path / "other")


def test_a_data_set_that_replaces_another_in_its_folder_is_printed_on_its_own_printers(
    sources: list[Path], tmp_path: Path
) -> None:
    for seed in (3, 4):  # in one process, as a worker of a cluster that stays
        shutil.rmtree(tmp_path / "set", ignore_errors=True)
        build_dataset(tmp_path / "set", sources[:1], Recipe(1, ("pulley-play",), "damaged", seed), Serial())
        assert verify_dataset(tmp_path / "set") == []


def test_what_does_not_fit_is_refused(data: Path, sources: list[Path], tmp_path: Path) -> None:
    with pytest.raises(InputError, match="wanted corruptions 2, as the build began"):
        build_dataset(data, sources, Recipe(3, RECIPE.families, "damaged", 3), Serial())
    (tmp_path / "notes.txt").write_text("mine")
    asked = ["dataset", "build", "--bodies", "generated:1", "--families", "nope", "-o", str(tmp_path / "none")]
    assert "nope" in str(CliRunner().invoke(group, asked).exception)
    assert not list(tmp_path.glob("none*"))  # no bodies were made for it
    with pytest.raises(InputError, match="holds something"):
        build_dataset(tmp_path, sources, RECIPE, Serial())
    with pytest.raises(InputError, match="the folder of a data set"):
        contents(tmp_path)
    (tmp_path / "dataset.json").write_text('{"schema": 99}')
    with pytest.raises(InputError, match="wanted schema 1"):
        contents(tmp_path)


def test_the_table_of_a_data_set_is_made_of_its_prints(data: Path) -> None:
    """A printer that is not mended prints what the data set says: naive's error is that of the stored prints."""
    cases = dataset_cases(data, protocol="heldout", seed=1)
    assert len(cases) == 3
    every = dataset_cases(data, protocol="heldout", seed=1, every_printer=True)
    assert {(case.body, case.sample) for case in every} == {(case.body, n) for case in cases for n in (0, 1)}
    assert {case.key("naive") for case in cases} < {case.key("naive") for case in every}
    for case in cases:
        (result,) = evaluate(case, ("naive",))
        judged = result.values["judged"]
        wanted = [layer.nominal_steps for layer in read_body(body_file(data, case.body), judged).layers]
        printed = read_print(print_file(data, case.body, case.sample), judged)
        assert result.values["rmse_steps"] == pytest.approx(rmse(np.concatenate(wanted), np.concatenate(printed)), 1e-4)
