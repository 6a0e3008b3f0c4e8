"""Run jobs: a queue that survives the server, and worker processes that can be stopped at any moment."""

import logging
import multiprocessing
import shutil
import threading
import time
from collections.abc import Callable
from concurrent.futures import CancelledError, Executor, Future
from concurrent.futures import TimeoutError as TooLongError
from dataclasses import dataclass
from typing import Any

from pebble import ProcessExpired, ProcessPool

from printmend.cluster import limited
from printmend.errors import RefusedError
from printmend.messages import say
from printmend.studio import work
from printmend.studio.store import Row, Store, check_bytes, check_jobs

LONGEST_S = 1800.0  # a job that takes longer is stopped
MOST_WAITING = 500  # most jobs in the queue
KEPT_DAYS = 30  # how long a job's files are kept
_WARM_AFTER_S = 8.0  # workers warm up after this time at the latest: until then, drawing the page comes first
_REST_AFTER_S = 300.0  # without jobs for this long, the workers end: each holds a hundred megabytes
_DRAWN_AFTER_S = 0.7  # time in which a browser draws the first picture from its data
_LOG = logging.getLogger("printmend.studio")


class Jobs:
    """The jobs of a `Store`, run by ``workers`` processes; jobs that a kill interrupted start again.

    With a ``cluster`` they run there instead, on workers that see the store's folders under the same names. A stopped
    job is then forgotten at once, but its worker finishes it.
    """

    def __init__(self, store: Store, *, workers: int, cluster: Executor | None = None) -> None:
        self._store, self._closing, self._warmed, self._drawn = store, False, False, False
        # spawned, not forked: a fork of a process with threads may hang
        context = multiprocessing.get_context("spawn")
        self._make = lambda: ProcessPool(workers, context=context, initializer=work.begin)
        self._pool = _Remote(cluster) if cluster else self._make()
        self._running: dict[str, Future[Any]] = {}
        self._changing = threading.Lock()  # guards the pool
        self._tidy()
        for job in store.jobs(waiting=True):
            self._schedule(job["id"], job["kind"], job["params"])
        self._warm_in(_WARM_AFTER_S)

    def _tidy(self) -> None:
        """Remove jobs and uploads after a month; measurements and check prints are a printer's history and stay."""
        jobs, uploads = self._store.forgotten(time.time() - KEPT_DAYS * 86400, kept=("learn", "verify"))
        for key in jobs:
            self.remove(key)
        for key in uploads:
            self._store.remove_upload(key)

    def submit(self, kind: str, printer: str | None, params: Row, owner: str | None = None) -> str:
        """Queue a job; return its key. Raises `RefusedError` if too many wait."""
        if len(self._running) >= MOST_WAITING:
            raise RefusedError(
                say("queue"), wanted=say("fewer-jobs", MOST_WAITING), came=f"{len(self._running)}",
                todo=say("wait-until-some-done"),
            )  # fmt: skip
        key = self._store.add_job(kind, printer, params, owner)
        self._schedule(key, kind, params)
        return key

    def cancel(self, key: str) -> bool:
        """Stop a job in any state; return False if it had ended."""
        ended = self._store.end_job(key, "cancelled")
        future = self._running.pop(key, None)
        if future is not None:
            future.cancel()
        return ended

    def look(self, key: str) -> Row:
        """Return a job with its progress: ``share`` 0–1, ``step`` in words, and the seconds that may be ``left_s``."""
        future = self._running.get(key)  # read before its row: an ending job writes its row before it leaves here
        job = self._store.job(key)
        told = work.read_progress(self._store.path("job", key)) if job["state"] == "queued" and future else {}
        if told or (future is not None and future.running() and job["state"] == "queued"):
            job["state"] = "running"
        job.update({"share": 1.0 if job["state"] == "done" else 0.0, "step": "", "left_s": None})
        return job | told

    def waiting(self) -> list[str]:
        """Return the jobs that have not ended, the first in the queue first."""
        return [job["id"] for job in self._store.jobs(waiting=True)]

    def stamp(self, key: str) -> tuple[bool, int]:
        """Return a stamp that changes whenever a job reports progress, or ends."""
        try:
            told_ns = (self._store.path("job", key) / work.PROGRESS).stat().st_mtime_ns
        except OSError:
            told_ns = 0
        return key in self._running, told_ns

    def remove(self, key: str) -> None:
        """Stop a job and remove all its files."""
        self.cancel(key)
        self._store.forget("job", key)
        for folder in {self._store.path("job", key), self._store.pictures(key)}:
            shutil.rmtree(folder, ignore_errors=True)

    def warm_soon(self) -> None:
        """Start the workers as soon as the browser has drawn the first picture, whose data is on its way."""
        if not self._drawn:
            self._drawn = True
            self._later.cancel()
            self._warm_in(_DRAWN_AFTER_S)

    def _warm_in(self, seconds: float) -> None:
        self._in(seconds, self.warm)

    def _in(self, seconds: float, then: Callable[[], None]) -> None:
        """Call a function later, and keep its timer to cancel it."""
        self._later = threading.Timer(seconds, then)
        self._later.daemon = True
        self._later.start()

    def warm(self) -> None:
        """Start the workers and let them rehearse, unless they have, before anybody waits for them."""
        if isinstance(self._pool, ProcessPool) and not (self._warmed or self._closing):
            self._warmed = True
            with self._changing:
                self._pool.schedule(work.rehearsed)
            self._in(_REST_AFTER_S, self.rest)

    def rest(self) -> None:
        """End the workers if no job runs; the next job starts new ones."""
        with self._changing:
            if self._closing or self._running or not isinstance(self._pool, ProcessPool):
                return
            before, self._pool = self._pool, self._make()
            self._warmed = self._drawn = False
        before.stop()
        before.join()

    def close(self) -> None:
        """Stop the workers; unfinished jobs start again with the next server."""
        self._closing = True
        self._later.cancel()
        self._pool.stop()
        self._pool.join()

    def _schedule(self, key: str, kind: str, params: Row) -> None:
        folder = self._store.path("job", key)
        (folder / work.PROGRESS).unlink(missing_ok=True)  # left by a killed run
        arguments = (kind, str(folder), str(self._store.places.data), params, str(self._store.pictures(key)))
        with self._changing:
            self._warmed = True
            future = self._pool.schedule(work.run, args=arguments, timeout=LONGEST_S)
            self._running[key] = future
        future.add_done_callback(lambda done: self._ended(key, done))

    def _ended(self, key: str, future: Future[Any]) -> None:
        if self._closing:
            return
        self._keep(key, future)
        self._running.pop(key, None)  # last, so that a job that no longer runs has its result in the store
        if not self._running:
            self._later.cancel()
            self._in(_REST_AFTER_S, self.rest)

    def _keep(self, key: str, future: Future[Any]) -> None:
        try:
            result: dict[str, Any] = future.result()
        except CancelledError:
            self._store.end_job(key, "cancelled")
        except (TooLongError, ProcessExpired, MemoryError) as error:
            too_long = isinstance(error, TooLongError)
            self._store.end_job(key, "failed", error=say("job-took-too-long" if too_long else "job-out-of-memory"))
        except Exception as error:
            if type(error).__name__ == "KilledWorker":  # Dask's, which need not be installed
                self._store.end_job(key, "failed", error=say("workers-died"))
                return
            _LOG.exception("job %s", key)
            self._store.end_job(key, "failed", error=say("fault-of-printmend", f"{type(error).__name__}: {error}"))
        else:
            if (error_text := result.pop("error", None)) and not result.get("may_force"):
                result = {}
            self._store.end_job(key, "failed" if error_text else "done", error=error_text, result=result or None)


class _Remote:
    """A cluster's executor with the interface of pebble's pool."""

    def __init__(self, executor: Executor) -> None:
        self._executor = executor

    def schedule(self, function: Callable[..., Any], args: tuple[Any, ...], timeout: float) -> Future[Any]:
        return self._executor.submit(limited, timeout, function, *args)

    def stop(self) -> None:
        self._executor.shutdown(wait=False)

    def join(self) -> None:
        pass


@dataclass(frozen=True, eq=False)
class StudioState:
    """The state that the routes share."""

    store: Store
    jobs: Jobs
    most_bytes: int

    def submit(self, kind: str, printer: str | None, params: Row) -> str:
        """Queue a job for the requesting user; return its key.

        Raises `RefusedError` if too many jobs wait, `InputError` if too many are one user's or too much is stored.
        """
        if kind != "send":  # sending stores nothing
            check_bytes(self.store, self.most_bytes)
        check_jobs(self.store)
        return self.jobs.submit(kind, printer, params, self.store.owner)
