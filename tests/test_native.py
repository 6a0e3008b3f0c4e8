"""The library of kernels that runs without numba: the same numbers as numba's code and as plain Python."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

import printmend
from printmend.jit import entry, inner, record
from printmend.native import NAME, Library, arguments_of, recording
from printmend.shipped import Shipped

sys.path.insert(0, str(Path(__file__).parents[1] / "tools"))

COMPILED = Path(printmend.__file__).parent / "compiled"
PLACE = np.dtype([("x", "f8"), ("n", "i8"), ("both", "f8", 2), ("flag", "u4"), ("kind", "u1")], align=True)


class Pair(NamedTuple):
    head: Any
    table: np.ndarray


@inner
def _half(value):
    return value / 2.0


@entry
def _numbers(a, n, yes):
    return _half(a) + n, n // 3, a > n, yes


@entry
def _change(pair, rows, out):
    """Change records and arrays of every layout in place."""
    scratch = np.zeros(7)
    for i in range(len(rows)):
        scratch[i % 7] += rows[i].x
        rows[i].n += pair.head.n
        rows[i].flag, rows[i].kind = np.uint32(i), np.uint8(200)
        rows[i].both[1] = pair.table[i % len(pair.table)]
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = scratch[(i + j) % 7] + np.sin(pair.head.x) ** 3


@entry
def _last(values, nothing):
    return values[len(values) - 1] if nothing is None else 0.0


@entry
def _array(n):
    return np.arange(n)


def rows() -> np.ndarray:
    made = np.zeros(20, PLACE)
    made["x"] = np.arange(20) / 7
    return made.view(np.recarray)


def head() -> Any:
    made = record(PLACE)
    made.x, made.n = 0.3, 5
    return made


def read_only(array: np.ndarray) -> np.ndarray:
    array.setflags(write=False)
    return array


def cases() -> list[tuple[Any, tuple]]:
    table = np.array([1.5, -2.5, 1e300])
    return [
        (_numbers, (0.7, 11, True)),
        (_numbers, (np.float64(0.7), np.int64(-11), False)),
        (_change, (Pair(head(), table), rows(), np.zeros((3, 4)))),
        (_change, (Pair(head(), table[::2]), rows()[::3], np.zeros((3, 4), order="F"))),
        (_change, (Pair(head(), table), rows()[::-1], np.zeros((6, 4))[::2, ::2])),
        (_last, (np.arange(5, dtype=np.uint8), None)),
        (_last, (np.arange(5.0), None)),
        (_last, (read_only(np.arange(6.0)), None)),
    ]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Library:
    """A library of the kernels above, called as numba was."""
    if shutil.which("cc") is None:
        pytest.skip("no C compiler (cc)")
    from native_kernels import emit, link

    from printmend import compiling

    folder = tmp_path_factory.mktemp("library")
    kept, shipped, fill = compiling.shipped, Shipped(folder / "shipped"), Shipped.fill
    calls, recording.calls, recording.on = recording.calls, {}, True
    compiling.shipped, Shipped.fill = (lambda _package: shipped), True
    try:
        for kernel, arguments in [*cases(), (_array, (3,))]:
            kernel._native = {}
            kernel.compiled._cache.load_overload = lambda _sig, _context: None
            kernel(*arguments)
        found = emit(recording.calls, shipped.modules, folder)
    finally:
        compiling.shipped, recording.calls, recording.on, Shipped.fill = kept, calls, False, fill
    assert {name.rpartition(".")[2] for name, _, _ in found} == {"_numbers", "_change", "_last"}  # no array comes back
    link(found, folder, folder)
    return Library(folder)


def called(made: Library, kernel: Any, arguments: tuple) -> Any:
    name = f"{kernel.py_func.__module__}.{kernel.py_func.__qualname__}"
    kinds, flat = arguments_of(arguments)
    return made.found(name, kernel.digest)[kinds](flat)


@pytest.mark.parametrize("case", range(len(cases())))
def test_the_library_does_what_numba_and_python_do(made: Library, case: int) -> None:
    kernel, ours = cases()[case]
    results = [called(made, kernel, ours)]
    changed = [ours]
    for run in (kernel.compiled, kernel.py_func):
        _, again = cases()[case]
        changed.append(again)
        results.append(run(*again))
    assert results[0] == results[1] == results[2]
    assert [type(each) for each in np.atleast_1d(results[0]).tolist()] == [
        type(each) for each in np.atleast_1d(results[1]).tolist()
    ]
    for one, other in ((changed[0], changed[1]), (changed[0], changed[2])):
        for a, b in zip(one, other, strict=True):
            if isinstance(a, np.ndarray):
                np.testing.assert_array_equal(a, b)


def test_code_of_another_source_or_for_other_arguments_is_not_run(made: Library) -> None:
    name = f"{_numbers.__module__}._numbers"
    assert made.found(name, lambda: "another") == {}
    assert made.found("printmend.no_such_kernel", lambda: "any") == {}
    calls = made.found(name, _numbers.digest)
    for values in ((1, 2, True), (np.float32(1), 2, True), (1.0, 2**63, True), (1.0, "2", True)):
        assert arguments_of(values)[0] not in calls
    kinds = {
        arguments_of((array,))[0]
        for array in (read_only(np.arange(5.0)), np.arange(5.0), np.arange(9.0)[::2], np.arange(5))
    }
    assert len(kinds) == 4


@pytest.mark.parametrize("text", ["", "{}", '{"version": 0}', '{"version": 1, "library": "none", "kernels": {}}'])
def test_a_torn_or_foreign_library_holds_nothing(tmp_path: Path, text: str) -> None:
    (tmp_path / f"{NAME}.json").write_text(text)
    assert Library(tmp_path).found("any", lambda: "any") == {}


def test_code_that_only_reads_takes_what_could_be_changed_and_no_other_way_round(made: Library) -> None:
    calls = made.found(f"{_last.__module__}._last", _last.digest)
    for array, there in ((np.arange(6.0), True), (read_only(np.arange(6.0)), True), (read_only(np.arange(6)), False)):
        kinds, flat = arguments_of((array, None))
        assert (kinds in calls) is there
        assert not there or calls[kinds](flat) == 5.0
    writes = made.found(f"{_change.__module__}._change", _change.digest)
    assert arguments_of((Pair(head(), np.zeros(3)), rows(), np.zeros((3, 4))))[0] in writes
    assert arguments_of((Pair(head(), np.zeros(3)), rows(), read_only(np.zeros((3, 4)))))[0] not in writes


def test_a_failing_kernel_is_an_error(made: Library) -> None:
    call = next(iter(made.found(f"{_numbers.__module__}._numbers", _numbers.digest).values()))
    call._called = lambda *_: 1
    with pytest.raises(RuntimeError, match="_numbers failed"):
        call([0.7, 11, True])


MEND = """
import sys
from printmend.cli.main import group
from printmend.gcode import container
container.CHUNK_BYTES = 60  # no chunk is of another kind than the first
try:
    group(sys.argv[1:], standalone_mode=False)
finally:
    print(sorted(sys.modules.keys() & {"numba", "llvmlite"}))
"""


def test_mend_runs_without_numba_and_writes_the_same_text(tmp_path: Path) -> None:
    if not (COMPILED / f"{NAME}.json").is_file():
        pytest.skip("no library here: `make kernels` makes it")
    from printmend.gcode.kernels import emit
    from printmend.model import exact_model, write_model
    from tests.mending import BENT, SQUARE

    kernels = json.loads((COMPILED / f"{NAME}.json").read_text())["kernels"]
    if kernels["printmend.gcode.kernels.emit.emit"]["digest"] != emit.digest():
        pytest.skip("the library is of another source: `make kernels` makes it")
    model, part = tmp_path / "m.mend.json", tmp_path / "part.gcode"
    write_model(model, exact_model(BENT))
    part.write_bytes(SQUARE * 3)
    texts = []
    for numba in ("", "1"):
        output = tmp_path / f"out{numba}.gcode"
        command = [sys.executable, "-c", MEND, "mend", part, "-m", model, "-o", output]
        environment = {**os.environ, "PRINTMEND_NUMBA": numba}
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)  # noqa: S603
        assert done.stdout.splitlines()[-1] == ("['llvmlite', 'numba']" if numba else "[]")
        texts.append(output.read_bytes())
    assert texts[0] == texts[1]
