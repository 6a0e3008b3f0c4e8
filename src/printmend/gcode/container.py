"""Read files that hold G-code, in any container, as chunks of whole lines; write them into the same container again."""

import shutil
import sys
import tempfile
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import IO, Literal

import numpy as np

from printmend.errors import GcodeError, reason
from printmend.gcode import bgcode, threemf
from printmend.gcode.machine import Flavour, detect_flavour
from printmend.messages import say

Text = bytes | memoryview
CHUNK_BYTES = 2 << 20  # bytes read at once
MAX_LINE_BYTES = 1 << 20  # a longer line is no G-code
HINT_BYTES = 1 << 20  # bytes of a file's beginning and of its end, where slicers describe it
GZIP = b"\x1f\x8b"  # begins a compressed file
_TEXT_SHARE = 0.7  # least share of printable characters and line ends in the head of a G-code file


@dataclass(frozen=True)
class Part:
    """One G-code program in a file: the file's own, or a plate's. ``member`` names the plate in a `.gcode.3mf`."""

    source: "GcodeFile"
    member: str | None = None
    _summed: list[bool] = field(default_factory=list, init=False, repr=False, compare=False)

    @property
    def name(self) -> str:
        return self.source.name if self.member is None else f"{self.source.name}:{self.member}"

    def chunks(self) -> Iterator[np.ndarray]:
        """Yield the text in chunks [uint8] of whole lines, some `CHUNK_BYTES` each; may be called again."""
        return _whole_lines(self._pieces(), self.name)

    def hints(self) -> tuple[bytes, ...]:
        """Return the pieces of text in which slicers describe a file: its first and last MiB, and the metadata.

        Of a plate these are the first MiB and the project's settings; also the last MiB if neither names a firmware.
        Lines that only move are left out.
        """
        return self._hints

    @cached_property
    def _hints(self) -> tuple[bytes, ...]:
        return tuple(map(_without_moves, self._ends()))

    def _ends(self) -> tuple[bytes, ...]:
        path = self.source.path
        if self.source.container == "plain":
            with path.open("rb") as handle:
                head = handle.read(HINT_BYTES)
                handle.seek(max(path.stat().st_size - HINT_BYTES, handle.tell()))
                return head, handle.read()
        if self.source.container == "bgcode":
            return tuple(_bgcode_hints(path, self.name))
        with path.open("rb") as handle, threemf.open_zip(handle, self.name) as archive:
            settings = threemf.settings(archive)
        hints = (next(self._pieces(), b"")[:HINT_BYTES], settings)
        if detect_flavour(*hints) != Flavour.UNKNOWN:
            return hints
        last = b""  # to see the end of a compressed plate, all of it must be read
        for piece in self._pieces():
            last = (last + piece)[-HINT_BYTES:]
        return (*hints, last)

    def flavour(self) -> Flavour:
        return detect_flavour(*self.hints())

    @property
    def is_as_summed(self) -> bool:
        """Tell whether a plate is what its project's checksum says, by its last whole reading; other files have
        none."""
        if self.member is None:
            return True
        if not self._summed:
            deque(self._pieces(), maxlen=0)
        return self._summed[-1]

    def _pieces(self) -> Iterator[bytes]:
        if self.source.container == "plain":
            with self.source.path.open("rb") as handle:
                yield from iter(lambda: handle.read(CHUNK_BYTES), b"")
        elif self.source.container == "bgcode":
            yield from _bgcode_texts(self.source.path, self.name)
        else:
            with self.source.path.open("rb") as handle, threemf.open_zip(handle, self.name) as archive:
                self._summed.append((yield from threemf.plate_pieces(archive, str(self.member), self.name)))


Told = Callable[[Part, bytes], bytes]
"""(program, a line that states its printing time) → the line with the new time."""


def as_told(_part: Part, line: bytes) -> bytes:
    """Return a line that states a printing time unchanged."""
    return line


@dataclass(frozen=True)
class GcodeFile:
    """A file that holds G-code: its ``name`` for messages, its path, and its kind of container."""

    name: str
    path: Path
    container: Literal["plain", "bgcode", "3mf"]
    parts: tuple[Part, ...] = ()

    def write(
        self, handle: IO[bytes], texts: Callable[[Part], Iterable[Text]], told: Told = as_told,
        folder: Path | None = None,
    ) -> None:  # fmt: skip
        """Write the same container with ``texts(part)`` in place of each program; the rest is kept byte for byte.

        Only lines beside a program that state its printing time change: ``told`` rewrites them once the program is
        written. Until then the program may wait in a temporary file in ``folder``.
        """
        if self.container == "plain":
            for text in texts(self.parts[0]):
                handle.write(text)
        elif self.container == "bgcode":
            part = self.parts[0]
            bgcode.write_like(self.path, handle, texts(part), lambda line: told(part, line), folder)
        else:
            by_member = {part.member: part for part in self.parts}
            with self.path.open("rb") as source:
                threemf.write_like(
                    source, self.name, handle, lambda member: texts(by_member[member]),
                    lambda member, line: told(by_member[member], line),
                )  # fmt: skip


@contextmanager
def open_gcode(path: Path | str) -> Iterator[GcodeFile]:
    """Open a G-code file of any container; `-` is the standard input, kept in a temporary file.

    Raises `GcodeError` for a file that is missing, empty or binary, and for a broken container.
    """
    if str(path) != "-":
        yield _identify(Path(path), str(path))
        return
    with tempfile.NamedTemporaryFile(suffix=".gcode") as copy:
        shutil.copyfileobj(sys.stdin.buffer, copy)
        copy.flush()
        yield _identify(Path(copy.name), "standard input")


def _identify(path: Path, name: str) -> GcodeFile:
    try:
        with path.open("rb") as handle:
            head = handle.read(1 << 16)
    except OSError as error:
        raise GcodeError(name, wanted=say("g-code-file"), came=reason(error), todo=say("check-path")) from None
    if head.startswith(bgcode.MAGIC):
        found = GcodeFile(name, path, "bgcode")
        return GcodeFile(name, path, "bgcode", (Part(found),))
    if head.startswith(b"PK\x03\x04"):
        with path.open("rb") as handle, threemf.open_zip(handle, name) as archive:
            found = GcodeFile(name, path, "3mf")
            return GcodeFile(name, path, "3mf", tuple(Part(found, member) for member in threemf.plates(archive, name)))
    refuse_binary(head, name)
    found = GcodeFile(name, path, "plain")
    return GcodeFile(name, path, "plain", (Part(found),))


def refuse_binary(head: bytes, name: str) -> None:
    """Raise `GcodeError` for a file that is mostly not text; a few foreign bytes in comments pass."""
    if not head:
        raise GcodeError(name, wanted=say("g-code-motion"), came=say("empty-file"), todo=say("give-sliced-file"))
    codes = np.frombuffer(head, np.uint8)
    printable = ((codes >= 32) & (codes < 127)) | ((codes >= 9) & (codes <= 13))
    if printable.mean() < _TEXT_SHARE:
        raise GcodeError(
            name,
            wanted=say("g-code-text-bgcode-gcode-3mf"),
            came=say("other-binary-data"),
            todo=say("unpack-it") if head.startswith(GZIP) else say("give-sliced-file"),
        )


def _whole_lines(pieces: Iterable[bytes], name: str) -> Iterator[np.ndarray]:
    held: list[bytes] = []
    size = 0
    for piece in pieces:
        held.append(piece)
        size += len(piece)
        del piece  # here and below: free what was used before more is read
        if size < CHUNK_BYTES:
            continue
        data = b"".join(held)
        cut = data.rfind(b"\n") + 1 or data.rfind(b"\r", 0, -1) + 1
        if len(data) - cut > MAX_LINE_BYTES:
            raise endless_line(name)
        held, size = [data[cut:]], len(data) - cut
        if cut:
            yield np.frombuffer(data, np.uint8, cut)
        del data
    if size:
        yield np.frombuffer(b"".join(held), np.uint8)


def endless_line(name: str) -> GcodeError:
    """Return the error of a file that has a line too long for G-code."""
    came = say("line-of-more-bytes", MAX_LINE_BYTES)
    return GcodeError(name, wanted=say("g-code-lines"), came=came, todo=say("give-sliced-file"))


def _bgcode_texts(path: Path, name: str) -> Iterator[bytes]:
    found = False
    with path.open("rb") as handle:
        _, checked = bgcode.read_header(handle, name)
        for block in bgcode.read_blocks(handle, name, checked=checked):
            if block.kind == bgcode.GCODE:
                found = True
                yield bgcode.block_text(block, name)
    if not found:
        raise bgcode.no_gcode(name)


def _without_moves(text: bytes) -> bytes:
    """Return a text without the lines that begin with G and have no comment; these are most of a file."""
    data = np.frombuffer(text, np.uint8)
    ends = np.append(np.flatnonzero(data == ord(b"\n")), len(data) - 1) if len(data) else np.empty(0, np.int64)
    starts = np.concatenate([[0], ends[:-1] + 1])[: len(ends)]
    kept = data[np.minimum(starts, len(data) - 1)] != ord(b"G")
    for remark in b';("':
        kept[np.searchsorted(ends, np.flatnonzero(data == remark))] = True
    return data[np.repeat(kept, ends - starts + 1)].tobytes()


def _bgcode_hints(path: Path, name: str) -> Iterator[bytes]:
    text = b""
    with path.open("rb") as handle:
        _, checked = bgcode.read_header(handle, name)
        for block in bgcode.read_blocks(handle, name, checked=checked):
            if block.kind == bgcode.GCODE:
                text += bgcode.block_text(block, name)
                if len(text) >= HINT_BYTES:
                    break
            elif block.kind != bgcode.THUMBNAIL:
                yield bgcode.block_text(block, name)
    yield text
