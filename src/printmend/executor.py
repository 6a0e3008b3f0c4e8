"""Where cases run: here, or in processes of their own.

An executor yields (item, value) in the order in which they are done; the value is a `WorkerDied` where the process that
worked on the item was killed. An executor for many machines needs no more than this method.
"""

import multiprocessing
import os
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import Protocol, TypeVar

Item = TypeVar("Item")
Value = TypeVar("Value")

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
        except BaseException:  # interrupted: nobody waits for what is under way
            for child in multiprocessing.active_children():
                child.terminate()
            raise
        finally:
            pool.shutdown(wait=True, cancel_futures=True)
        return [], []


def executor(workers: int) -> Executor:
    """Return what runs on so many processes: 1 is this one, 0 one a core."""
    return Serial() if workers == 1 else Processes(workers or os.cpu_count() or 1)


def _one_thread() -> None:
    """Keep the libraries of a worker to one thread; runs before any of them is imported."""
    for name in _ONE_THREAD:
        os.environ[name] = "1"
