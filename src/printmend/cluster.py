"""Workers on other machines: a cluster of Dask distributed, and a limit on the time of what runs there."""

import contextlib
import logging
import os
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any, Self, TypeVar

from printmend.errors import InputError
from printmend.messages import say

Value = TypeVar("Value")

_CONNECT_S = 10.0  # until a scheduler counts as silent
_ANSWERED_S = 2.0  # by then the answer of a worker that is ended has left it
_RESTARTED_S = 60.0  # by then a worker of this machine that was lost has started again, even on a busy one
ONE_THREAD = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True)
class Cluster:
    """Workers of Dask distributed: ``address`` of a scheduler (tcp://…), or local:N for N processes on this machine."""

    address: str

    @classmethod
    def at(cls, address: str) -> Self:
        """Return the cluster of an address. Raises `InputError` for one that is neither a scheduler's nor local:N."""
        kind, _, rest = address.partition(":")
        whole = rest.isascii() and rest.isdigit() and int(rest) > 0
        if not (whole if kind == "local" else kind in ("tcp", "tls") and rest.startswith("//")):
            raise InputError("--cluster", wanted=say("tcp-host-port-local-n"), came=repr(address), todo=say("correct"))
        return cls(address)

    @contextlib.contextmanager
    def client(self) -> Iterator[Any]:
        """Connect to the scheduler, or start one here; give Dask's client. Raise `InputError` where none answers."""
        from distributed import Client, LocalCluster

        kind, _, count = self.address.partition(":")
        with contextlib.ExitStack() as stack:
            if kind == "local":
                threads = dict.fromkeys(ONE_THREAD, "1")
                cluster = LocalCluster(
                    n_workers=int(count),
                    threads_per_worker=1,
                    dashboard_address=None,
                    env=threads,
                    memory_limit=0,
                    silence_logs=logging.ERROR,  # a worker that is lost is a warning: its work goes to another
                )
                stack.enter_context(cluster)
                log = logging.getLogger("distributed.scheduler")
                log.addFilter(_is_news)
                stack.callback(log.removeFilter, _is_news)
                client = stack.enter_context(Client(cluster))
                stack.callback(_wait_until_started, client, int(count))
                yield client
            else:
                yield stack.enter_context(self.connected())

    def connected(self) -> Any:
        """Return a client of the scheduler. Raise `InputError` where none answers."""
        from distributed import Client

        for name in ("distributed.client", "distributed.utils"):  # what they would log at length, we say in one line
            logging.getLogger(name).setLevel(logging.CRITICAL)
        try:
            return Client(self.address, timeout=_CONNECT_S)
        except (OSError, ValueError, TimeoutError) as error:
            came = f"{type(error).__name__}: {error}"
            todo = say("start-dask-scheduler-correct-address")
            raise InputError("--cluster", wanted=say("scheduler", self.address), came=came, todo=todo) from None


def _wait_until_started(client: Any, workers: int) -> None:
    """Wait until as many workers stand: Dask cannot close a cluster in which a lost one is being started again."""
    until = time.monotonic() + _RESTARTED_S
    while len(client.nthreads()) < workers and time.monotonic() < until:
        time.sleep(0.1)


def _is_news(record: logging.LogRecord) -> bool:
    """Tell whether an error of Dask's scheduler is more than what is said of the item: that its workers died."""
    return "workers died while trying to run it" not in record.getMessage()


def limited(limit_s: float, work: Callable[..., Value], *arguments: Any) -> Value:
    """Run work on a worker of a cluster.

    Raise TimeoutError if it takes longer than ``limit_s``. Nothing else can end a hanging thread, so the worker's
    process ends soon after. Its nanny restarts it, and its other tasks run again.
    """
    outcome: Future[Value] = Future()

    def run() -> None:
        try:
            outcome.set_result(work(*arguments))
        except BaseException as error:
            outcome.set_exception(error)

    threading.Thread(target=run, daemon=True).start()
    try:
        return outcome.result(limit_s)
    finally:
        if not outcome.done():
            end = threading.Timer(_ANSWERED_S, os._exit, (1,))
            end.daemon = True
            end.start()
