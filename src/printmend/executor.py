"""Where cases run: here, in processes of their own, or on the machines of a cluster.

An executor yields (item, value) in the order in which they are done; the value is a `WorkerDied` where the process that
worked on the item was killed.
"""

import contextlib
import hashlib
import logging
import multiprocessing
import os
import sys
import threading
import time
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Protocol, TypeVar

from printmend.errors import InputError
from printmend.messages import say

Item = TypeVar("Item")
Value = TypeVar("Value")

_CONNECT_S = 10.0  # until a scheduler counts as silent
_ANSWERED_S = 2.0  # by then the answer of a worker that is ended has left it
_RESTARTED_S = 60.0  # by then a worker of this machine that was lost has started again, even on a busy one
_ONE_THREAD = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True)
class WorkerDied:
    """The process that worked on an item ended without an answer: out of memory, or killed."""

    reason: str = "the worker process was killed (out of memory?)"


class Executor(Protocol):
    """Runs a function over items."""

    def map(self, work: Callable[[Item], Value], items: Iterable[Item]) -> Iterator[tuple[Item, Value | WorkerDied]]:
        """Yield each item with its value as soon as it is done."""
        ...


@dataclass(frozen=True)
class Serial:
    """One after the other, in this process."""

    def map(self, work: Callable[[Item], Value], items: Iterable[Item]) -> Iterator[tuple[Item, Value | WorkerDied]]:
        """Yield each item with its value, in order."""
        for item in items:
            yield item, work(item)


HERE = Serial()


@dataclass(frozen=True)
class Processes:
    """Fresh processes with one thread each. ``work`` and the items must be importable and picklable."""

    workers: int

    def map(self, work: Callable[[Item], Value], items: Iterable[Item]) -> Iterator[tuple[Item, Value | WorkerDied]]:
        """Yield each item with its value; an item whose worker dies is tried once more, alone."""
        suspects: list[Item] = []
        waiting = list(items)
        while waiting:
            waiting, broken = yield from self._run(work, waiting, self.workers)
            suspects += broken
        for item in suspects:
            _, broken = yield from self._run(work, [item], 1)
            if broken:
                yield item, WorkerDied()

    def _run(
        self, work: Callable[[Item], Value], items: list[Item], workers: int
    ) -> Generator[tuple[Item, Value], None, tuple[list[Item], list[Item]]]:
        """Run items on a pool until they are done or it breaks.

        Returns the items not begun and those under way when a worker died.
        """
        rest = list(reversed(items))
        under_way: dict[Future[Value], Item] = {}
        pool = ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), initializer=_one_thread)
        try:
            while rest or under_way:
                while rest and len(under_way) < workers:
                    item = rest.pop()
                    under_way[pool.submit(work, item)] = item
                done, _ = wait(under_way, return_when=FIRST_COMPLETED)
                for future in done:
                    value = future.result()
                    yield under_way.pop(future), value
        except BrokenProcessPool:
            # Which of the items under way broke it is unknown: all of them are suspects.
            return list(reversed(rest)), list(under_way.values())
        except BaseException:  # interrupted: nobody waits for the work under way
            for child in multiprocessing.active_children():
                child.terminate()
            raise
        finally:
            pool.shutdown(wait=True, cancel_futures=True)
        return [], []


@dataclass(frozen=True)
class Cluster:
    """Workers of Dask distributed: ``address`` of a scheduler (tcp://…), or local:N for N processes on this machine.

    Work that was under way on a worker that is lost goes to another; after a few lost workers it is a `WorkerDied`.
    """

    address: str

    def map(self, work: Callable[[Item], Value], items: Iterable[Item]) -> Iterator[tuple[Item, Value | WorkerDied]]:
        """Yield each item with its value; as many items as the workers can use are under way at any time.

        Raises `InputError` where the scheduler goes away, and where a worker has other code than this program.
        """
        from distributed import KilledWorker

        with self.client() as client, client.get_executor(pure=False) as pool:
            self._compare_versions(client)
            rest = list(reversed(list(items)))
            under_way: dict[Future[Value], Item] = {}
            while rest or under_way:
                room = 2 * max(sum(client.nthreads().values()), 1)
                while rest and len(under_way) < room:
                    item = rest.pop()
                    under_way[pool.submit(work, item)] = item
                done, _ = wait(under_way, return_when=FIRST_COMPLETED)
                for future in done:
                    item = under_way.pop(future)
                    try:
                        value: Any = future.result()
                    except KilledWorker:
                        value = WorkerDied()
                    except CancelledError:
                        todo = say("start-again-then-same-command-goes")
                        raise InputError(
                            "--cluster", wanted=say("scheduler", self.address), came=say("has-gone"), todo=todo
                        ) from None
                    yield item, value

    def check(self) -> int:
        """Return how many items can run at once now. Raise `InputError` where no scheduler answers.

        To be asked before anything is made that the workers would work on; local:N are started only by `map`.
        """
        import distributed  # noqa: F401 (says at once which extra is missing)

        kind, _, count = self.address.partition(":")
        if kind == "local":
            return int(count)
        with self._connected() as client:
            self._compare_versions(client)
            return sum(client.nthreads().values())

    def _compare_versions(self, client: Any) -> None:
        """Raise `InputError` where a worker runs another printmend: what it made would not be what this one makes."""
        mine, found = program_version(), client.run(program_version, on_error="return")
        others = {place: said for place, said in found.items() if said != mine}
        if others:
            place, said = next(iter(others.items()))
            came = say("another-2", len(others), len(found), place, said)
            todo = say("install-same-there-start-workers-again")
            raise InputError("--cluster", wanted=say("workers-printmend", mine), came=came, todo=todo)

    @contextlib.contextmanager
    def client(self) -> Iterator[Any]:
        """Connect to the scheduler, or start one here; give Dask's client. Raise `InputError` where none answers."""
        from distributed import Client, LocalCluster

        kind, _, count = self.address.partition(":")
        with contextlib.ExitStack() as stack:
            if kind == "local":
                threads = dict.fromkeys(_ONE_THREAD, "1")
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
                yield stack.enter_context(self._connected())

    def _connected(self) -> Any:
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


@cache
def program_version() -> str:
    """Return the version of the program that runs here: the release, and 8 hex digits over the files of its packages.

    They are printmend and, where it is installed, printmend-lab.
    """
    digest = hashlib.sha256()
    for name in ("printmend", "printmend_lab"):
        spec = find_spec(name)
        for root in map(Path, [] if spec is None else spec.submodule_search_locations or []):
            for path in sorted(root.rglob("*")):
                if path.is_file() and not {"__pycache__", "compiled"} & set(path.relative_to(root).parts):
                    digest.update(str(path.relative_to(root)).encode() + path.read_bytes())
    return f"{sys.modules[__package__].__version__}+{digest.hexdigest()[:8]}"


def _wait_until_started(client: Any, workers: int) -> None:
    """Wait until as many workers stand: Dask cannot close a cluster in which a lost one is being started again."""
    until = time.monotonic() + _RESTARTED_S
    while len(client.nthreads()) < workers and time.monotonic() < until:
        time.sleep(0.1)


def _is_news(record: logging.LogRecord) -> bool:
    """Tell whether an error of Dask's scheduler is more than what is said of the item: that its workers died."""
    return "workers died while trying to run it" not in record.getMessage()


def executor(workers: int, cluster: str | None = None) -> Executor:
    """Return what runs on so many processes: 1 is this one, 0 one a core; or on a ``cluster`` (see `Cluster`).

    Raises `InputError` for a cluster that is neither local:N nor the address of a scheduler.
    """
    if cluster is not None:
        kind, _, rest = cluster.partition(":")
        whole = rest.isascii() and rest.isdigit() and int(rest) > 0
        if not (whole if kind == "local" else kind in ("tcp", "tls") and rest.startswith("//")):
            raise InputError("--cluster", wanted=say("tcp-host-port-local-n"), came=repr(cluster), todo=say("correct"))
        return Cluster(cluster)
    return Serial() if workers == 1 else Processes(workers or os.cpu_count() or 1)


def limited(limit_s: float, work: Callable[..., Value], *arguments: Any) -> Value:
    """Run work on a worker of a cluster. Raise TimeoutError where it takes longer than ``limit_s``.

    Nothing else ends a thread that hangs, so the worker's process ends soon after: its nanny starts it anew, and what
    else ran there runs again.
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


def _one_thread() -> None:
    """Keep the libraries of a worker to one thread; runs before any of them is imported."""
    for name in _ONE_THREAD:
        os.environ[name] = "1"
