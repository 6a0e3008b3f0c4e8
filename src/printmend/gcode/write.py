"""Write G-code again with other motion. All rewriters share this loop; unchanged lines stay byte for byte.

Reading and interpreting run in one thread, planning in another, writing in the caller's.
"""

import queue
import threading
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from printmend.gcode import kernels as k
from printmend.gcode.machine import MachineState
from printmend.gcode.read import larger
from printmend.jit import record

Plan = Callable[[np.ndarray, int], tuple[int, np.ndarray, np.ndarray]]
"""(records [n] of RECORD, begin) → (end, first int64 [n + 1], pieces of PIECE).

Record i of records[begin:end] becomes pieces[first[i]:first[i + 1]]. Without pieces the statement stays as it is. The
last piece is written into the statement itself (its words, their order, its comment); the others become new lines. The
plan is called for each batch of records in file order, and again with begin = end until end = n. It keeps its own state
between calls (the engaged side of a belt). It may reuse the returned arrays after `PLANS_AT_ONCE` further calls.
"""

PLANS_AT_ONCE = 5  # plans in the queue, in the writer and being made
_RECORDS = 8192  # records of a batch: few enough to stay in the cache on the way through the threads
_NOTES = 1024  # notes of a batch
_MOST_TIMES = 100_000  # most places that state the time to keep
_OUT_BYTES = 1 << 20  # bytes of text written at once
_AHEAD = 2  # batches that a thread may be ahead of the next one
_Item = TypeVar("_Item")


@dataclass(frozen=True, eq=False)
class _Batch:
    """The records and notes of ``chunk[begin:end]``; ``numbered`` says whether lines so far have N words."""

    chunk: np.ndarray
    begin: int
    end: int
    records: np.ndarray
    notes: np.ndarray
    numbered: bool


@dataclass(frozen=True, eq=False)
class Planned:
    """Planned records[begin:end] of a batch; ``last`` marks the last part of the batch."""

    batch: _Batch
    begin: int
    end: int
    first: np.ndarray
    pieces: np.ndarray
    last: bool

    @property
    def records(self) -> np.ndarray:
        return self.batch.records

    @property
    def notes(self) -> np.ndarray:
        return self.batch.notes


Look = Callable[[Planned], None]
"""An observer that sees each planned part of a text, in file order."""


@dataclass(frozen=True)
class TimePlace:
    """A place in a written text that states the printing time: ``text`` begins at byte ``at``."""

    at: int
    text: bytes


def rewrite(
    chunks: Iterable[np.ndarray], state: MachineState, plan: Plan, *,
    look: Look | None = None, times: list[TimePlace] | None = None,
) -> Iterator[memoryview]:  # fmt: skip
    """Yield the text of ``chunks`` (uint8, whole lines each) with the motion that ``plan`` gives.

    ``state`` is the machine's state before the first chunk, and is advanced. Each view is valid until the next one is
    requested. ``look`` sees every part after it is planned. Places of the written text that state the printing time are
    added to ``times``, except in a text with numbered lines.
    """
    writer, written_bytes, places = initial_writer(state), 0, times
    lines = np.zeros(2, np.int64)
    out = np.empty(_OUT_BYTES, np.uint8)
    at = 0
    for part in _ahead(_planned(_ahead(_interpreted(chunks, state)), plan)):
        batch = part.batch
        if part.begin == 0:
            at = batch.begin
        writer.numbered = batch.numbered
        if look is not None:
            look(part)
        texts: list[memoryview] = []
        start = part.begin
        # once a batch is skipped, skip the rest, so that the kept places are the first ones without a gap
        places = places if places is not None and _takes_times(places, batch) else None
        told = iter(() if places is None else _telling_time(part))
        place = next(told, None)
        while True:
            while place is not None and place["record"] <= start:
                begin, end = int(place["begin"]), int(place["end"])
                if places is not None:
                    places.append(TimePlace(written_bytes + begin - at, batch.chunk[begin:end].tobytes()))
                place = next(told, None)
            if start >= part.end:
                break
            stop = part.end if place is None else min(part.end, int(place["record"]))
            done, at, written = k.emit(
                batch.chunk, at, batch.records[start:], stop - start, part.first[start:], part.pieces, writer, out
            )
            start += done
            written_bytes += written
            if done == 0 and written == 0:  # one record larger than the buffer
                out = np.empty(2 * len(out), np.uint8)
            elif batch.numbered:
                texts.append(memoryview(out[:written].tobytes()))
            elif written:
                yield out[:written].data
        if part.last and at < batch.end:
            texts.append(batch.chunk[at : batch.end].data)
            written_bytes += batch.end - at
        yield from _renumbered(b"".join(texts), lines) if batch.numbered else texts


def follow(chunks: Iterable[np.ndarray], state: MachineState, plan: Plan, *, look: Look | None = None) -> None:
    """Give ``plan`` the text of ``chunks``, and ``look`` each planned part; write nothing."""
    for part in _planned(_ahead(_interpreted(chunks, state)), plan):
        if look is not None:
            look(part)


def _takes_times(places: list[TimePlace], batch: _Batch) -> bool:
    """Return whether to note a batch's places: not if its lines are renumbered, nor beyond `_MOST_TIMES`."""
    return not batch.numbered and len(places) + len(batch.notes) <= _MOST_TIMES


def _telling_time(part: Planned) -> np.ndarray:
    """Return a planned part's notes about lines that state the printing time."""
    notes = part.notes
    mine = (notes["what"] == k.NOTE_TIME) & (notes["record"] >= part.begin)
    return notes[mine if part.last else mine & (notes["record"] < part.end)]


def initial_writer(state: MachineState) -> np.record:
    """Return the writer's state for a file that starts in ``state``."""
    writer = record(k.WRITER)
    writer.place[:] = state.numbers.pos
    writer.feed, writer.modal = state.numbers.feed, state.counts.modal
    return writer


def _interpreted(chunks: Iterable[np.ndarray], state: MachineState) -> Iterator[_Batch]:
    # Batches are in use here, in two queues, in the planner and in the writer. The caller's thread allocates them:
    # another thread's allocations would get their own heap in the C library, although this one has free memory.
    ring = [np.empty(_RECORDS, k.RECORD) for _ in range(2 * _AHEAD + 4)]
    return _batches(chunks, state, ring, [np.empty(_NOTES, k.NOTE) for _ in ring])


def _batches(
    chunks: Iterable[np.ndarray], state: MachineState, ring: list[np.ndarray], notes: list[np.ndarray]
) -> Iterator[_Batch]:
    turn = 0
    for chunk in chunks:
        position = 0
        while position < len(chunk):
            records = ring[turn]
            count, after = k.interpret(chunk, position, len(chunk), state.numbers, state.counts, records, notes[turn])
            if after == position:  # one line with more statements than fit
                ring[turn] = np.empty(larger(len(records)), k.RECORD)
                continue
            numbered = bool(state.counts.numbered + state.counts.checksums > 0)
            noted = notes[turn][: int(state.counts.noted)]
            yield _Batch(chunk, position, after, records[:count], noted, numbered)
            turn = (turn + 1) % len(ring)
            position = after


def _planned(batches: Iterable[_Batch], plan: Plan) -> Iterator[Planned]:
    for batch in batches:
        begin, last = 0, False
        while not last:
            end, first, pieces = plan(batch.records, begin)
            last = end == len(batch.records)
            yield Planned(batch, begin, end, first, pieces, last)
            begin = end


def _renumbered(text: bytes, lines: np.ndarray) -> Iterator[memoryview]:
    buffer = np.frombuffer(text, np.uint8)
    out = np.empty(2 * len(buffer) + 4096, np.uint8)
    position = 0
    while position < len(buffer):
        position, written = k.renumber(buffer, position, len(buffer), lines, out)
        yield out[:written].data


def _ahead(items: Iterable[_Item]) -> Iterator[_Item]:
    """Iterate over ``items`` in their own thread, a few ahead; errors are raised here."""
    ready: queue.Queue = queue.Queue(_AHEAD)
    stop = threading.Event()

    def put(item: object) -> bool:
        while not stop.is_set():
            try:
                ready.put(item, timeout=0.1)
            except queue.Full:
                continue
            return True
        return False

    def work() -> None:
        try:
            for item in items:
                if not put((item, None)):
                    return
            put((None, StopIteration()))
        except BaseException as error:
            put((None, error))

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    try:
        while True:
            item, error = ready.get()
            if isinstance(error, StopIteration):
                return
            if error is not None:
                raise error
            yield item
    finally:
        stop.set()
        thread.join()
