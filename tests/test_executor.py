"""Where cases run: time limits, addresses. A cluster whose worker dies runs in integrations/tests/test_chains.py."""

import threading

import pytest

from printmend.errors import InputError
from printmend.executor import Cluster, Processes, Serial, executor, limited


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
