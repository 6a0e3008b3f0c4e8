"""Where cases run: here, in processes of their own, or on the machines of a cluster.

An executor yields (item, value) in the order in which they are done; the value is a `WorkerDied` where the process that
worked on the item was killed.
"""

import hashlib
import multiprocessing
import os
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Protocol, TypeVar

import printmend
from printmend.cluster import ONE_THREAD, Cluster
from printmend.errors import InputError

Item = TypeVar("Item")
Value = TypeVar("Value")


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


class Workers(Cluster):
    """A cluster. Work that was under way on a worker that is lost goes to another; after a few lost workers it is a
    `WorkerDied`."""

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
                        raise InputError(
                            "--cluster", wanted=f"a scheduler at {self.address}", came="one that has gone",
                            todo="start it again; then the same command goes on",
                        ) from None  # fmt: skip
                    yield item, value

    def check(self) -> int:
        """Return how many items can run at once now. Raise `InputError` where no scheduler answers.

        To be asked before anything is made that the workers would work on; local:N are started only by `map`.
        """
        import distributed  # noqa: F401 (says at once which extra is missing)

        kind, _, count = self.address.partition(":")
        if kind == "local":
            return int(count)
        with self.connected() as client:
            self._compare_versions(client)
            return sum(client.nthreads().values())

    def _compare_versions(self, client: Any) -> None:
        """Raise `InputError` where a worker runs another printmend: what it made would not be what this one makes."""
        mine, found = program_version(), client.run(program_version, on_error="return")
        others = {place: said for place, said in found.items() if said != mine}
        if others:
            place, said = next(iter(others.items()))
            raise InputError(
                "--cluster", wanted=f"workers with printmend {mine}",
                came=f"{len(others)} of {len(found)} with another, {place} with {said}",
                todo="install the same there, and start its workers again",
            )  # fmt: skip


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
    return f"{printmend.__version__}+{digest.hexdigest()[:8]}"


def executor(workers: int, cluster: str | None = None) -> Executor:
    """Return what runs on so many processes: 1 is this one, 0 one a core; or on a ``cluster`` (`Cluster.at`)."""
    if cluster is not None:
        return Workers.at(cluster)
    return Serial() if workers == 1 else Processes(workers or os.cpu_count() or 1)


def _one_thread() -> None:
    """Keep the libraries of a worker to one thread; runs before any of them is imported."""
    for name in ONE_THREAD:
        os.environ[name] = "1"
