"""Where cases run: time limits, addresses. A cluster whose worker dies runs in integrations/tests/test_chains.py."""

import re
import threading

import pytest

from printmend.cluster import Cluster, limited
from printmend.errors import InputError
from printmend_lab.executor import Processes, Serial, Workers, executor, program_version


def test_work_that_takes_too_long_on_a_worker_ends_it_once_it_has_answered(monkeypatch: pytest.MonkeyPatch) -> None:
    ended, over = threading.Event(), threading.Event()
    monkeypatch.setattr("printmend.cluster.os._exit", lambda code: ended.set())
    monkeypatch.setattr("printmend.cluster._ANSWERED_S", 0.0)
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
    with pytest.raises(InputError, match="expected tcp://HOST:PORT or local:N"):
        Cluster.at(address)


def test_executors_by_number() -> None:
    assert executor(1) == Serial()
    assert executor(2) == Processes(2)
    assert executor(1, "tcp://host:8786") == Workers("tcp://host:8786")


class Client:
    """A cluster's client whose workers say which program they run."""

    def __init__(self, *versions: object) -> None:
        self.versions = versions

    def run(self, function, *, on_error: str) -> dict[str, object]:
        assert (function, on_error) == (program_version, "return")
        return {f"tcp://worker:{n}": said for n, said in enumerate(self.versions)}


def test_workers_of_another_program_are_refused() -> None:
    mine, cluster = program_version(), Workers("tcp://host:8786")
    cluster._compare_versions(Client(mine, mine))
    with pytest.raises(
        InputError, match=rf"expected workers with printmend {re.escape(mine)}, found 1 of 2 .*:1 with 0.1.0\+old"
    ):
        cluster._compare_versions(Client(mine, "0.1.0+old"))
    with pytest.raises(InputError, match="no such function"):  # one that cannot even say
        cluster._compare_versions(Client(AttributeError("no such function"), mine))
