"""Write G-code again with other motion: one loop for every rewriter, every line that need not change byte for byte."""

from collections.abc import Callable, Iterable, Iterator

import numpy as np

from printmend.gcode import kernels as k
from printmend.gcode.machine import MachineState
from printmend.gcode.read import RECORDS, larger

Plan = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""records [n] of RECORD → (first int64 [n + 1], pieces of PIECE): record i becomes pieces[first[i]:first[i + 1]].

No pieces: the statement stays as it is. The last piece is written into the statement itself (its words, their order,
its comment), the pieces before it become new lines. Called once for each batch of records, in the order of the file:
what the plan carries from one to the next (the engaged side of a belt) is its own.
"""

_OUT_BYTES = 4 << 20


def rewrite(chunks: Iterable[np.ndarray], state: MachineState, plan: Plan) -> Iterator[memoryview]:
    """Yield the text of ``chunks`` (uint8, whole lines each) with the motion that ``plan`` wants.

    ``state`` is the machine's before the first chunk and is advanced. Each view is valid until the next is asked for.
    """
    writer = initial_writer(state)
    lines = np.zeros(2, np.int64)
    records = np.empty(RECORDS, k.RECORD)
    out = np.empty(_OUT_BYTES, np.uint8)
    for chunk in chunks:
        position = 0
        while position < len(chunk):
            count, after = k.interpret(chunk, position, len(chunk), state.numbers, state.counts, records)
            if after == position:  # one line may hold more statements than fit
                records = np.empty(larger(len(records)), k.RECORD)
                continue
            first, pieces = plan(records[:count])
            numbered = state.counts[k.C_NUMBERED] + state.counts[k.C_CHECKSUMS] > 0
            writer[k.W_NUMBERED] = numbered
            texts = _emit(chunk, position, after, records[:count], first, pieces, writer, out)
            yield from _renumbered(b"".join(texts), lines) if numbered else texts
            position = after


def initial_writer(state: MachineState) -> np.ndarray:
    """Return the writer's state for a file that starts in ``state``."""
    writer = np.zeros(k.WRITER)
    writer[k.W_PLACE : k.W_PLACE + 3] = state.numbers[k.N_POS : k.N_POS + 3]
    writer[k.W_FEED] = state.numbers[k.N_FEED]
    writer[k.W_MODAL] = state.counts[k.C_MODAL]
    return writer


def _emit(
    chunk: np.ndarray, begin: int, end: int, records: np.ndarray, first: np.ndarray, pieces: np.ndarray,
    writer: np.ndarray, out: np.ndarray,
) -> Iterator[memoryview]:  # fmt: skip
    """Yield the text of one batch of records and of what stands between and after them."""
    start = 0
    while start < len(records):
        rest = len(records) - start
        done, begin, written = k.emit(chunk, begin, records[start:], rest, first[start:], pieces, writer, out)
        if done == 0 and written == 0:  # one record larger than the buffer
            out = np.empty(2 * len(out), np.uint8)
        start += done
        if written:
            yield out[:written].data
    if begin < end:
        yield chunk[begin:end].data


def _renumbered(text: bytes, lines: np.ndarray) -> Iterator[memoryview]:
    buffer = np.frombuffer(text, np.uint8)
    out = np.empty(max(_OUT_BYTES, 2 * len(buffer)), np.uint8)
    position = 0
    while position < len(buffer):
        position, written = k.renumber(buffer, position, len(buffer), lines, out)
        yield out[:written].data
