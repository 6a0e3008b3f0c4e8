"""The published layout: what is written is read back exactly, and what is wrong is named."""

from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from printmend.errors import InputError, TraceError
from printmend.twin import Twin
from printmend_lab.dataset.bodies import body_files, thinned
from printmend_lab.dataset.reference import COLUMNS, export_reference, read_reference, write_reference
from tests.bodies import circle_body, write_vase


@pytest.fixture
def gains(rng: np.random.Generator) -> np.ndarray:
    return rng.uniform(0.6, 1.3, (4, 1100))


@pytest.fixture
def folder(tmp_path: Path, gains: np.ndarray) -> Path:
    bodies = [circle_body("a", 3, 30.0), circle_body("b", 2, 45.0, (200, 900))]
    assert write_reference(tmp_path / "data", zip(bodies, [(1, 3), (4, 4)], strict=True), gains) == 2
    return tmp_path / "data"


def test_round_trip_is_exact(folder: Path, gains: np.ndarray, tmp_path: Path) -> None:
    reference = read_reference(folder)
    assert reference.names == ("a", "b")
    assert np.array_equal(reference.gains, gains)
    item = reference.body("a")
    wanted = circle_body("a", 3, 30.0)
    assert item.corruption_ids == (1, 3)
    for layer, want, printed in zip(item.body.layers, wanted.layers, item.printed_steps, strict=True):
        assert layer.index == want.index
        assert np.array_equal(layer.nominal_steps, want.nominal_steps)
        twin = Twin(reference.mechanism((1, 3)))
        assert np.array_equal(printed, twin.run(want.controls, want.start_steps))
    again = tmp_path / "again"
    items = [reference.body(name) for name in reference.names]
    write_reference(again, [(item.body, item.corruption_ids) for item in items], reference.gains)
    for name in reference.names:
        assert reference.path(name).read_bytes() == read_reference(again).path(name).read_bytes()


def test_the_files_are_what_the_published_code_reads(folder: Path, gains: np.ndarray) -> None:
    """No header, 14 columns, whole numbers as such, ids and rows from 1; position p's gain in column p − 1."""
    lines = (folder / "dataset" / "a.csv").read_text().splitlines()
    cells = lines[0].split(",")
    assert len(cells) == len(COLUMNS) == 14
    assert cells[:5] == ["1", "1", "3", "1", "580"]
    assert [int(line.split(",")[0]) for line in lines] == list(range(1, len(lines) + 1))
    assert np.array_equal(loadmat(folder / "simulation" / "add_dudw_data.mat")["all_data"], gains)
    table = np.genfromtxt(folder / "dataset" / "b.csv", delimiter=",")
    step = np.flatnonzero(table[:, 6] != 0)
    gain = gains[3, table[step, 4].astype(int) - 1]
    assert np.allclose(table[step, 8] - table[step, 5], gain * table[step, 6])
    assert (table[table[:, 6] == 0, 8] == table[table[:, 6] == 0, 5]).all()


def spoil(folder: Path, row: int, column: int, value: str) -> Path:
    path = folder / "dataset" / "a.csv"
    lines = path.read_text().splitlines()
    cells = lines[row].split(",")
    cells[column] = value
    lines[row] = ",".join(cells)
    path.write_text("\n".join(lines) + "\n")
    return folder


@pytest.mark.parametrize(
    ("row", "column", "value", "said"),
    [
        (4, 5, "nan", "nan in row 5, column 'x printed'"),
        (4, 13, "", "14 numbers a row"),
        (0, 0, "index", "no header"),
        (7, 1, "9", "id of 1…4"),
        (7, 2, "0", "id of 1…4"),
        (7, 1, "2", "one corruption a body"),
        (3, 3, "1.5", "whole number"),
        (3, 6, "2", "control of −1, 0 or 1"),
        (3, 7, "12", "nominal plus control"),
        (3, 4, "1101", "position of 0…1100"),
        (3, 10, "-5.5", "where the row before it ended"),
    ],
)
def test_a_spoilt_cell_is_named(folder: Path, row: int, column: int, value: str, said: str) -> None:
    with pytest.raises(TraceError, match=r"a\.csv") as caught:
        read_reference(spoil(folder, row, column, value)).body("a")
    assert said in str(caught.value)


def test_a_missing_column_is_named(folder: Path) -> None:
    path = folder / "dataset" / "a.csv"
    path.write_text("\n".join(line.rsplit(",", 1)[0] for line in path.read_text().splitlines()))
    with pytest.raises(TraceError, match=r"13 columns .* 'y printed next'"):
        read_reference(folder).body("a")


def test_an_empty_file_is_named(folder: Path) -> None:
    (folder / "dataset" / "a.csv").write_text("")
    with pytest.raises(TraceError, match="an empty file"):
        read_reference(folder).body("a")


def test_a_folder_that_is_no_data_set_is_named(tmp_path: Path, folder: Path) -> None:
    with pytest.raises(TraceError, match="no such folder"):
        read_reference(tmp_path / "nowhere")
    savemat(folder / "simulation" / "add_dudw_data.mat", {"other": np.ones((2, 1100))})
    with pytest.raises(TraceError, match="all_data, found other"):
        read_reference(folder)
    savemat(folder / "simulation" / "add_dudw_data.mat", {"all_data": np.ones((2, 1000))})
    with pytest.raises(TraceError, match="1100"):
        read_reference(folder)
    (folder / "simulation" / "add_dudw_data.mat").write_text("no matlab")
    with pytest.raises(TraceError, match="MATLAB 5"):
        read_reference(folder)


def test_export_from_gcode_repeats_and_thins(tmp_path: Path) -> None:
    vase = write_vase(tmp_path / "vase.gcode", layers=7)
    for name in ("one", "two"):
        done = export_reference(tmp_path / name, [vase], corruptions=5, seed=3, layers=3)
        assert done.bodies == 1
    one, two = (read_reference(tmp_path / name) for name in ("one", "two"))
    assert one.path("vase").read_bytes() == two.path("vase").read_bytes()
    assert len(one.gains) == 5
    assert [layer.index for layer in one.body("vase").body.layers] == [0, 3, 6]


def test_export_leaves_out_what_is_no_body_and_writes_nothing_when_none_is(tmp_path: Path) -> None:
    vase = write_vase(tmp_path / "vase.gcode")
    broken = tmp_path / "broken.gcode"
    broken.write_text("M104 S200\n")
    done = export_reference(tmp_path / "data", [broken, vase], corruptions=2, seed=0)
    assert done.bodies == 1
    assert [path for path, _ in done.refused] == [str(broken)]
    with pytest.raises(InputError):
        export_reference(tmp_path / "none", [broken], corruptions=2, seed=0)
    assert not (tmp_path / "none").exists()
    with pytest.raises(InputError, match="new or empty folder"):
        export_reference(tmp_path / "data", [vase], corruptions=2, seed=0)


def test_body_files_are_found_once_in_order(tmp_path: Path) -> None:
    for name in ("b.gcode", "a.STL", "note.txt"):
        (tmp_path / name).write_text("x")
    assert [path.name for path in body_files([tmp_path, tmp_path / "b.gcode"])] == ["a.STL", "b.gcode"]
    with pytest.raises(InputError, match="no such path"):
        body_files([tmp_path / "c.gcode"])
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="at least one body"):
        body_files([tmp_path / "empty"])


def test_thinning_keeps_the_ends() -> None:
    body = circle_body(layers=9)
    assert [layer.index for layer in thinned(body, 3).layers] == [0, 4, 8]
    assert thinned(body, None) is body
    assert thinned(body, 20) is body
