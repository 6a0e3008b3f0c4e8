"""A cluster of workers: one that is killed costs no item and doubles none; wrong addresses are refused."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from printmend.errors import InputError
from printmend.executor import Cluster, Processes, Serial, executor

# In a process of its own: Dask's threads outlive a cluster by moments, which the other tests take for warnings.
SCRIPT = """
import sys
from printmend import executor as module
from printmend.errors import InputError
from printmend.executor import executor
from tests.mortal import dies_once
if __name__ == "__main__":
    module._CONNECT_S = 0.5
    try:
        list(executor(1, "tcp://127.0.0.1:9").map(dies_once, sys.argv[1:]))
    except InputError as error:
        said = str(error)
    assert "wanted a scheduler at tcp://127.0.0.1:9" in said and "start `dask scheduler`" in said, said
    found = list(executor(1, "local:2").map(dies_once, sys.argv[1:]))
    assert sorted(item for item, _ in found) == sorted(sys.argv[1:]), found
    assert all(item == value for item, value in found), found
"""


def test_nobody_at_the_address_is_said_and_a_lost_worker_costs_and_doubles_nothing(tmp_path: Path) -> None:
    items = [str(tmp_path / f"item{n}.txt") for n in range(5)]
    (tmp_path / "item1.die").touch()
    script = tmp_path / "run.py"
    script.write_text(SCRIPT)
    root = str(Path(__file__).parent.parent)
    done = subprocess.run(  # noqa: S603 (this interpreter, a list of arguments)
        [sys.executable, str(script), *items], capture_output=True, text=True, check=False, timeout=300,
        env={**os.environ, "PYTHONPATH": f"{root}/src:{root}"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert not (tmp_path / "item1.die").exists()
    assert Path(items[1]).read_text() == "ran\n"


@pytest.mark.parametrize("address", ["local", "local:0", "local:x", "http://host", "host:8786", "tcp:8786"])
def test_wrong_addresses_are_refused(address: str) -> None:
    with pytest.raises(InputError, match="wanted tcp://HOST:PORT or local:N"):
        executor(1, address)


def test_executors_by_number() -> None:
    assert executor(1) == Serial()
    assert executor(2) == Processes(2)
    assert executor(1, "tcp://host:8786") == Cluster("tcp://host:8786")
