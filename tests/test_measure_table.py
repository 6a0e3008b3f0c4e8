"""trace.csv: what is written is read back, odd tables end in one clear line."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from printmend.errors import TraceError
from printmend.measure import read_trace, write_trace
from printmend.measure.checks import counted_once, digest_of
from printmend.path import Motion, Origin, Trace
from printmend.printer import read_printer
from printmend.probe import design_probe

PRINTER = read_printer("ender3")
HEADER = "x_mm,y_mm,x_measured_mm,y_measured_mm"


def table(tmp_path: Path, text: str | bytes) -> Path:
    path = tmp_path / "trace.csv"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def points(count: int = 60, *, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    commanded = np.vstack([[0.0, 0.0], rng.uniform(5, 215, (count - 1, 2))])
    return commanded, commanded + rng.normal(0, 0.2, commanded.shape)


def lines(commanded: np.ndarray, measured: np.ndarray) -> str:
    rows = [",".join(f"{v:.6f}" for v in row) for row in np.hstack([commanded, measured])]
    return "\n".join([HEADER, *rows]) + "\n"


@settings(max_examples=30, deadline=None)
@given(
    count=st.integers(20, 200),
    seed=st.integers(0, 2**32 - 1),
    sigma=st.booleans(),
    z=st.booleans(),
    layer=st.booleans(),
)
def test_written_traces_are_read_back(tmp_path_factory, count, seed, sigma, z, layer):
    rng = np.random.default_rng(seed)
    commanded, measured = points(count, seed=seed)
    measured[rng.random(measured.shape) < 0.2] = np.nan
    trace = Trace(
        commanded,
        measured,
        sigma_mm=np.where(rng.random(count) < 0.5, 0.05, np.nan) if sigma else None,
        z_mm=rng.uniform(0, 9, count) if z else None,
        layer=rng.integers(0, 9, count) if layer else None,
        homed=True,
        placed=not sigma,
    )
    path = tmp_path_factory.mktemp("table") / "trace.csv"
    write_trace(path, trace)
    if trace.measured_rows.sum() < 10:
        with pytest.raises(TraceError):
            read_trace(path, PRINTER)
        return
    back = read_trace(path, PRINTER)
    assert back.homed
    assert back.placed == trace.placed
    for name in ("commanded_mm", "measured_mm", "sigma_mm", "z_mm", "layer"):
        ours, theirs = getattr(trace, name), getattr(back, name)
        if ours is None:
            assert theirs is None
        else:
            np.testing.assert_allclose(theirs, ours, atol=5.1e-7)


def test_a_table_says_whose_it_is(tmp_path: Path) -> None:
    """Other models, other own names and other kinematics are other printers; a model with a name of its own may be."""
    path, (commanded, measured) = tmp_path / "trace.csv", points()
    measured[3] = np.nan
    left, right = (replace(PRINTER, name=name) for name in ('left, "old" one', "right one"))
    ender5, corexy = read_printer("ender5"), read_printer("corexy")
    for whose, same, others in (
        (PRINTER, (PRINTER, left), (ender5, corexy, replace(corexy, name="mine"))), (left, (left, PRINTER), (right,)),
    ):  # fmt: skip
        origin = Origin(whose.name, whose.kinematics, "0123abcd")
        write_trace(path, Trace(commanded, measured, homed=True, origin=origin))
        for printer in same:
            assert read_trace(path, printer).origin == origin
        for printer in others:
            with pytest.raises(TraceError, match=f"found one of {whose.name}"):
                read_trace(path, printer)
    np.testing.assert_array_equal(np.isnan(read_trace(path, left).measured_mm), np.isnan(measured))
    attic = replace(PRINTER, name=" Ender  3,\tattic ")
    plan = design_probe(attic, size_mm=60)
    write_trace(path, plan.trace(plan.marks_mm))
    assert read_trace(path, attic).origin == plan.origin


def test_a_copy_counts_once_and_a_second_measurement_twice(rng: np.random.Generator) -> None:
    commanded, measured = points(40)
    once = Trace(commanded, measured)
    twice = Trace(np.vstack([commanded] * 2), np.vstack([measured] * 2))
    again = Trace(np.vstack([commanded] * 2), np.vstack([measured, measured + rng.normal(0, 1e-4, measured.shape)]))
    layered = replace(twice, layer=np.repeat([0, 1], len(commanded)))
    there = np.linspace(10, 190, 40)
    way = np.concatenate([there, there[::-1]])[:, None] * [1.0, 0.5]
    back = Trace(way, 1.01 * way)  # no play, no noise: both ways measure the same
    shuffled = rng.permutation(np.hstack([twice.commanded_mm, twice.measured_mm]))
    mixed = Trace(shuffled[:, :2], shuffled[:, 2:])  # pasted twice and then put in no order: no neighbours tell
    for trace, copies in ((once, 0), (twice, 40), (again, 0), (layered, 0), (back, 0), (mixed, 40)):
        left, count = counted_once(trace)
        assert (count, len(left), int(left.measured_rows.sum())) == (copies, len(trace), len(trace) - copies)
    assert digest_of(once) == digest_of(replace(once, measured_mm=np.round(measured, 6))) != digest_of(twice)


def test_bom_crlf_spaces_quotes_and_unknown_columns_do_no_harm(tmp_path):
    commanded, measured = points()
    plain = read_trace(table(tmp_path, lines(commanded, measured)), PRINTER)
    notes = ("good", 'a 0.4" nozzle', '"good, but ""faint"""', "")
    rows = "".join(
        f'"{m[0]:.6f}", {c[0]:.6f} ,{notes[i % 4]},{c[1]:.6f},{m[1]:.6f}\r\n'
        for i, (c, m) in enumerate(zip(commanded, measured, strict=True))
    )
    odd = "\ufeffx_measured_mm, x_mm ,remark,y_mm,y_measured_mm\r\n" + rows + "\r\n"
    other = read_trace(table(tmp_path, odd), PRINTER)
    np.testing.assert_array_equal(plain.commanded_mm, other.commanded_mm)
    np.testing.assert_array_equal(plain.measured_mm, other.measured_mm)


@pytest.mark.parametrize("end", [",", ",,", ", ,"])
def test_lines_that_all_end_with_commas_have_empty_cells_there(tmp_path: Path, end: str) -> None:
    head, *rows = lines(*points()).splitlines()
    plain = read_trace(table(tmp_path, "\n".join([head, *rows])), PRINTER)
    more = read_trace(table(tmp_path, "\n".join([head, *(row + end for row in rows)])), PRINTER)
    np.testing.assert_array_equal(plain.measured_mm, more.measured_mm)


@pytest.mark.parametrize("blank", [",,,", " , , , ", ",,,,,"])
def test_blank_rows_of_a_spreadsheet_are_none(tmp_path: Path, blank: str) -> None:
    head, *rows = lines(*points()).splitlines()
    plain = read_trace(table(tmp_path, "\n".join([head, *rows])), PRINTER)
    more = read_trace(table(tmp_path, "\n".join([head, *rows[:4], blank, *rows[4:], blank, blank, ""])), PRINTER)
    np.testing.assert_array_equal(plain.commanded_mm, more.commanded_mm)
    np.testing.assert_array_equal(plain.measured_mm, more.measured_mm)
    assert (plain.blank_rows, more.blank_rows) == (0, 1)  # those at the end are none of the table's
    twice = [*rows[:4], blank, "", *rows[4:9], " \t", *rows[9:-1], blank, rows[-1], "", blank]
    assert read_trace(table(tmp_path, "\r\n".join([head, "", *twice])), PRINTER).blank_rows == 4
    with pytest.raises(TraceError, match="y_mm in every row"):
        read_trace(table(tmp_path, "\n".join([head, *rows[:4], blank, "1.0,,2.0,3.0", *rows[4:]])), PRINTER)


def test_empty_cells_mean_not_measured(tmp_path):
    commanded, measured = points()
    text = lines(commanded, measured).splitlines()
    text[1] = "0.0,0.0,,"
    text[5] = "50, 60 , ,"
    trace = read_trace(table(tmp_path, "\n".join(text)), PRINTER)
    assert np.isnan(trace.measured_mm[[0, 4]]).all()
    assert trace.measured_rows.sum() == len(commanded) - 2


@pytest.mark.parametrize("step", [1.0, 0.5, 0.1, 0.01, 0.001])
def test_the_step_of_a_rounded_table_is_seen(tmp_path: Path, step: float) -> None:
    commanded, measured = points()
    trace = read_trace(table(tmp_path, lines(commanded, step * np.round(measured / step))), PRINTER)
    assert trace.step_mm == (step if step > 0.001 else 0.0)  # a finer one is the noise of any instrument
    write_trace(tmp_path / "again.csv", trace)
    assert read_trace(tmp_path / "again.csv", PRINTER).step_mm == trace.step_mm


def test_walls_have_no_step(tmp_path: Path) -> None:
    rows = "".join(f"{x},{x / 2},,,1,0,0.1\n" for x in range(5, 60))
    assert not read_trace(table(tmp_path, f"{HEADER},nx,ny,offset_mm\n0,0,,,,,\n{rows}"), PRINTER).step_mm


def test_a_trace_that_does_not_start_at_home_is_not_homed(tmp_path):
    commanded, measured = points()
    assert not read_trace(table(tmp_path, lines(commanded[1:], measured[1:])), PRINTER).homed


@pytest.mark.parametrize(
    ("factor", "columns", "named"),
    [(1 / 25.4, "measured", "25.4"), (1 / 10, "measured", "10"), (1 / 25.4, "commanded", "25.4")],
)
def test_a_wrong_unit_is_named_with_its_factor(tmp_path, factor, columns, named):
    commanded, measured = points()
    if columns == "measured":
        measured = measured * factor + 3.0
    else:
        commanded = commanded * factor
    with pytest.raises(TraceError, match=rf"{columns}.*factor of {named}"):
        read_trace(table(tmp_path, lines(commanded, measured)), PRINTER)


def test_a_table_wholly_in_inches_is_refused_and_a_small_print_is_not(tmp_path):
    commanded, measured = points()
    with pytest.raises(TraceError, match=r"as in inches; multiply all columns by 25\.4"):
        read_trace(table(tmp_path, lines(commanded / 25.4, measured / 25.4)), PRINTER)
    for at in (0.0, 100.0):  # as large, in the middle; or a third as large, in the corner
        small = at + commanded * (0.1 if at else 0.012)
        assert len(read_trace(table(tmp_path, lines(small, small + 0.01)), PRINTER)) == 60


def test_one_wrong_cell_far_off_the_bed_is_left_to_learning(tmp_path):
    assert read_trace(table(tmp_path, _with_row("50,5,50,818.9")), PRINTER).measured_mm.max() == 818.9


@pytest.mark.parametrize("gain", [0.6, 0.8, 1.0, 1.3])
def test_a_badly_damaged_printer_is_no_wrong_unit(tmp_path, gain):
    commanded, measured = points()
    assert len(read_trace(table(tmp_path, lines(commanded, measured * gain + 7)), PRINTER)) == 60


def _with_doubt(cell: str, first: str = "0.001") -> str:
    """Return a table whose instrument says ``cell`` in row 3, and ``first`` in the others."""
    head, *rows = lines(*points()).splitlines()
    return "\n".join([f"{head},scale_sd", *(f"{row},{cell if n == 3 else first}" for n, row in enumerate(rows, 1))])


def _with_row(text: str) -> str:
    commanded, measured = points()
    rows = lines(commanded, measured).splitlines()
    rows[20] = text
    return "\n".join(rows)


COMMANDED, MEASURED = points()


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("", "column x_mm"),
        (HEADER + "\n", "no rows"),
        (HEADER + "\n0,0,0,0\n1,1,1,1\n", "2 in 2 rows"),
        (_with_row("5,5,nan,5"), "line 21.*'nan'"),
        (_with_row("5,5,5,inf"), "line 21.*'inf'"),
        (_with_row("5,5,five,5"), "line 21.*'five'"),
        (_with_row("5,,5,5"), "y_mm in every row"),
        (_with_row("5,5,5"), "4 cells in line 21"),
        (_with_row("500,5,500,5"), r"\(500, 5\) in row 20"),
        (lines(COMMANDED, MEASURED + 900), "measured points on the bed"),
        (_with_row("5,5,5\x00,5"), "UTF-8"),
        (lines(COMMANDED, MEASURED).replace("x_measured_mm", "xm"), "column x_measured_mm"),
        (lines(COMMANDED, MEASURED).replace("x_mm,y_mm", "x_mm,x_mm,y_mm"), "one column x_mm"),
        (lines(COMMANDED, MEASURED[:, ::-1]), "swapped"),
        (lines(COMMANDED, [[220, 0]] + MEASURED * [-1, 1]), "x mirrored"),
        (HEADER + "\n0,5,0,5,0,5,0,5\n" * 20, "4 cells a row.*8 cells in line 2.*decimal point"),
        (_with_row("12,5,30,12.4,30.1"), "4 cells a row.*5 cells in line 21.*decimal point"),
        (_with_row("12,5,30,,"), "5 cells in line 21"),  # not measured: what is too much is empty
        (_with_row("0,5,0,5,0,5,0,5").replace("\n", ",\n").replace("measured_mm,\n", "measured_mm\n"), "line 21"),
        (HEADER + ",note\n" + "0,5,0,5,good, but faint\n" * 20, "5 cells a row.*a text that has a comma in quotes"),
        (_with_row('5,5,"5,5'), "quote in line 21 that is not closed"),
        (_with_row('5,5,5,5,"lost') + '\n6,6,6,6,"', "quote in line 21 that is not closed"),
        (_with_doubt("0.002"), r"scale_sd 0\.001 in every row, found 0\.002 in row 3.*leave the column out"),
        (_with_doubt(""), r"scale_sd 0\.001 in every row, found an empty cell in row 3.*leave the column out"),
        (_with_doubt("0.001", ""), "scale_sd in every row, found an empty cell in row 1"),
        (_with_doubt("nan"), "a number for scale_sd in line 4, found 'nan'.*leave the column out"),
        (_with_doubt("small"), "a number for scale_sd in line 4, found 'small'.*leave the column out"),
        (b"\xff\x00\x01", "UTF-8"),
        (b"\xff\xfe\x00\xd8", "UTF-8"),
    ],
)
def test_bad_tables_end_in_one_line(tmp_path, text, named):
    with pytest.raises(TraceError, match=named) as caught:
        read_trace(table(tmp_path, text), PRINTER)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("decimal", [".", ","])
@pytest.mark.parametrize("mark", [";", "\t"])
@pytest.mark.parametrize("coding", ["utf-8", "utf-8-sig", "utf-16"])
def test_a_spreadsheet_may_save_in_its_own_language(tmp_path, decimal, mark, coding):
    text = lines(COMMANDED, MEASURED).replace("x_mm", "X_mm")
    wanted = read_trace(table(tmp_path, text), PRINTER)
    saved = text.replace(",", mark).replace(".", decimal).replace("\n", "\r\n")
    got = read_trace(table(tmp_path, saved.encode(coding)), PRINTER)
    quoted = re.sub(r"[\d.]+", lambda cell: f'"{cell[0].replace(".", decimal)}"', text)
    assert np.array_equal(read_trace(table(tmp_path, quoted), PRINTER).measured_mm, wanted.measured_mm)
    assert np.array_equal(got.commanded_mm, wanted.commanded_mm)
    assert np.array_equal(got.measured_mm, wanted.measured_mm)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(TraceError, match="no such file"):
        read_trace(tmp_path / "none.csv", PRINTER)


def test_hundreds_of_thousands_of_rows_are_read_whole(tmp_path):
    commanded, measured = points(300_000)
    measured[::7] = np.nan
    path = tmp_path / "trace.csv"
    write_trace(path, Trace(commanded, measured))
    trace = read_trace(path, PRINTER)
    assert len(trace) == 300_000
    np.testing.assert_allclose(trace.measured_mm, measured, atol=5.1e-7)


def test_a_failed_write_leaves_the_old_file(tmp_path):
    path = tmp_path / "trace.csv"
    path.write_text("old")
    commanded, measured = points()
    broken = Trace(commanded, measured, motion=Motion("far", 0.0))
    with pytest.raises(TypeError, match="real number"):
        write_trace(path, broken)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_correlations_that_no_instrument_has_are_refused(tmp_path: Path) -> None:
    text = lines(*points()).splitlines()
    more = "scale_sd,axes_sd,lean_sd,scale_axes,scale_lean,axes_lean"
    for last, possible in (("0.9", True), ("-0.9", False)):
        rows = [f"{text[0]},{more}", *(f"{row},0.001,0.001,0.001,0.9,0.9,{last}" for row in text[1:])]
        path = table(tmp_path, "\n".join(rows))
        if possible:
            assert read_trace(path, PRINTER).instrument.axes_lean == 0.9
        else:
            with pytest.raises(TraceError, match=r"possible together, found 0\.9, 0\.9, -0\.9"):
                read_trace(path, PRINTER)
