"""Write G-code again with other motion: one loop for every rewriter, every line that need not change byte for byte.

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

Record i of records[begin:end] becomes pieces[first[i]:first[i + 1]]. No pieces: the statement stays as it is. The last
piece is written into the statement itself (its words, their order, its comment), the pieces before it become new lines.
Called for each batch of records in the order of the file, again with begin = end until end = n: what the plan carries
from one call to the next (the engaged side of a belt) is its own. What it returns may be used again after
`PLANS_AT_ONCE` further calls.
"""

PLANS_AT_ONCE = 5  # in the queue, in the writer and being made
_RECORDS = 8192  # a batch: small enough to stay in the cache on its way through the threads
_NOTES = 1024  # of a batch
_MOST_TIMES = 100_000  # places that tell the time which are kept
_OUT_BYTES = 1 << 20  # of text written at once
_AHEAD = 2  # batches that a thread may be ahead of the next one
_Item = TypeVar("_Item")


@dataclass(frozen=True, eq=False)
class _Batch:
    """Interpreted text: what ``chunk[begin:end]`` says; ``numbered`` tells whether lines have N words so far."""

    chunk: np.ndarray
    begin: int
    end: int
    records: np.ndarray
    notes: np.ndarray
    numbered: bool


@dataclass(frozen=True, eq=False)
class Planned:
    """Planned records[begin:end] of a batch; ``last`` says that no more of it follows."""

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
"""What looks on while a text is planned, part by part, in the order of the file."""


@dataclass(frozen=True)
class TimePlace:
    """A place in a written text that tells the time: ``text`` begins at byte ``at``."""

    at: int
    text: bytes


def rewrite(
    chunks: Iterable[np.ndarray], state: MachineState, plan: Plan, *,
    look: Look | None = None, times: list[TimePlace] | None = None,
) -> Iterator[memoryview]:  # fmt: skip
    """Yield the text of ``chunks`` (uint8, whole lines each) with the motion that ``plan`` gives.

    ``state`` is the machine's before the first chunk and is advanced. Each view is valid until the next one is asked
    for. ``look`` sees every part after it is planned. Places of the written text that tell the time are added to
    ``times``, except in a text with numbered lines.
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
        # the first of them and no others, else none could be told from another
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
    """Say whether places of a batch are noted: never of lines that are renumbered, and only up to a number."""
    return not batch.numbered and len(places) + len(batch.notes) <= _MOST_TIMES


def _telling_time(part: Planned) -> np.ndarray:
    """Return the notes of a planned part that tell the time."""
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
    # A batch is in use here, in two queues, in the planner and in the writer. The caller's thread allocates them: the C
    # library gives what another thread allocates a heap of its own, beside what lies free in this one.
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
    """Iterate over ``items`` in a thread of their own, a few ahead; errors come out here."""
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
