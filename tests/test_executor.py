"""A cluster of workers: one that is killed costs no item and doubles none; wrong addresses are refused."""

import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from printmend.bench.run import read_results
from printmend.errors import InputError
from printmend.executor import Cluster, Processes, Serial, executor, limited

# In a process of its own: Dask's threads outlive a cluster by moments, which the other tests take for warnings.
SCRIPT = """
import sys
from pathlib import Path
from printmend import executor as module
from printmend.bench.case import Case
from printmend.bench.run import run
from printmend.cli.main import group
from printmend.errors import InputError
from printmend.executor import executor
from tests.mortal import judged_once
if __name__ == "__main__":
    module._CONNECT_S = 0.5
    made = Path(sys.argv[1]).parent / "made"
    asked = ["dataset", "build", "--bodies", "generated:1", "-o", str(made), "--cluster", "tcp://127.0.0.1:9"]
    try:
        group.main(asked, standalone_mode=False)
    except InputError as error:
        said = str(error)
    assert "wanted a scheduler at tcp://127.0.0.1:9" in said and "start `dask scheduler`" in said, said
    assert not list(made.parent.glob("made*"))
    cases = [Case("table1", "", place, "play", "damaged", "paper", 0, source=place) for place in sys.argv[1:]]
    run(cases, ("naive", "oracle"), Path(sys.argv[1]).parent, executor(1, "local:2"), evaluate=judged_once)
"""


def test_a_table_on_a_cluster_neither_loses_nor_doubles_a_row_when_a_worker_dies(tmp_path: Path) -> None:
    places = [str(tmp_path / f"body{n}.txt") for n in range(5)]
    (tmp_path / "body1.die").touch()
    script = tmp_path / "run.py"
    script.write_text(SCRIPT)
    root = str(Path(__file__).parent.parent)
    done = subprocess.run(  # noqa: S603 (this interpreter, a list of arguments)
        [sys.executable, str(script), *places], capture_output=True, text=True, check=False, timeout=300,
        env={**os.environ, "PYTHONPATH": f"{root}/src:{root}"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert not (tmp_path / "body1.die").exists()
    assert Path(places[1]).read_text() == "ran\n"
    results = read_results(tmp_path / "table1.jsonl")
    assert sorted((result.case.source, result.row) for result in results) == [
        (place, row) for place in places for row in ("naive", "oracle")
    ]


def test_work_that_takes_too_long_on_a_worker_ends_it_once_it_has_answered(monkeypatch: pytest.MonkeyPatch) -> None:
    ended, over = threading.Event(), threading.Event()
    monkeypatch.setattr("printmend.executor.os._exit", lambda code: ended.set())
    monkeypatch.setattr("printmend.executor._ANSWERED_S", 0.0)
    assert limited(60.0, len, "abc") == 3
    with pytest.raises(ZeroDivisionError):
        limited(60.0, divmod, 1, 0)
    assert not ended.wait(0.05)
    with pytest.raises(TimeoutError):
        limited(0.01, over.wait)
    assert ended.wait(60.0)
    over.set()


@pytest.mark.parametrize("address", ["local", "local:0", "local:x", "http://host", "host:8786", "tcp:8786"])
def test_wrong_addresses_are_refused(address: str) -> None:
    with pytest.raises(InputError, match="wanted tcp://HOST:PORT or local:N"):
        executor(1, address)


def test_executors_by_number() -> None:
    assert executor(1) == Serial()
    assert executor(2) == Processes(2)
    assert executor(1, "tcp://host:8786") == Cluster("tcp://host:8786")
