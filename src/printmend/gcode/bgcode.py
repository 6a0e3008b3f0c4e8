"""Prusa's binary G-code: blocks of metadata, thumbnails and packed G-code, each with its checksum.

The format as published (libbgcode, specification version 1): `GCDE`, version u32, checksum type u16; then blocks of
type u16, compression u16, uncompressed size u32, compressed size u32 (absent without compression), parameters
(6 bytes for thumbnails, else the encoding u16), data, CRC-32 of all of it. All little-endian.
"""

import re
import shutil
import struct
import tempfile
import zlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import numpy as np

from printmend.errors import GcodeError
from printmend.gcode import kernels as k
from printmend.messages import say

MAGIC = b"GCDE"  # the first bytes of a binary G-code file
GCODE, THUMBNAIL = 1, 5  # kinds of blocks
_BLOCK_KINDS = 6  # number of block kinds in the format
_HEADER = struct.Struct("<4sIH")
_BLOCK = struct.Struct("<HHI")
_WINDOWS = {2: 11, 3: 12}  # heatshrink: compression → window bits; the look-ahead has 4
_MAX_BLOCK_BYTES = 64 << 20  # thumbnails are the largest blocks, and far smaller
_MAX_RATIO, _RATIO_MATTERS_BYTES = 300, 32 << 20  # deflate cannot reach 1100; real files stay below 20
_TEXT_BYTES = 65535  # G-code in a block: as much as slicers write
_TIMES = re.compile(rb"^estimated (?:first layer )?printing time[^=\r\n]*=[^\r\n]*", re.IGNORECASE | re.MULTILINE)


@dataclass(frozen=True)
class Block:
    """One block of a file. ``raw`` is the whole block with header and checksum; ``data`` is its compressed data."""

    kind: int
    compression: int
    encoding: int
    size: int
    data: bytes
    raw: bytes


def read_header(handle: IO[bytes], name: str) -> tuple[bytes, bool]:
    """Return the file header as it is, and whether blocks have a CRC-32."""
    raw = handle.read(_HEADER.size)
    if len(raw) < _HEADER.size:
        raise GcodeError(
            name, wanted=say("bgcode-header-10-bytes"), came=say("bytes", len(raw)), todo=say("slice-copy-file-again")
        )
    magic, version, checksum = _HEADER.unpack(raw)
    if magic != MAGIC or version != 1 or checksum > 1:
        came = say("version-with-checksum", version, checksum)
        raise GcodeError(name, wanted=say("bgcode-version-1-crc-32-no"), came=came, todo=say("export-plain-g-code"))
    return raw, checksum == 1


def read_blocks(handle: IO[bytes], name: str, *, checked: bool) -> Iterator[Block]:
    """Yield the blocks that follow the header; raise `GcodeError` if one is cut off, wrong or too large."""
    unpacked = packed = 0
    while head := handle.read(_BLOCK.size):
        if len(head) < _BLOCK.size:
            raise _cut_off(name)
        kind, compression, size = _BLOCK.unpack(head)
        if kind >= _BLOCK_KINDS or compression > 3 or size > _MAX_BLOCK_BYTES:
            came = say("block-of-type", kind, compression, size)
            raise GcodeError(name, wanted=say("bgcode-block"), came=came, todo=say("slice-copy-file-again"))
        length = size
        if compression:
            more = handle.read(4)
            head += more
            length = int.from_bytes(more, "little") if len(more) == 4 else _MAX_BLOCK_BYTES + 1
            if len(more) == 4 and length > _MAX_BLOCK_BYTES:
                raise GcodeError(
                    name,
                    wanted=say("bgcode-block"),
                    came=say("compressed-bytes", length),
                    todo=say("slice-copy-file-again"),
                )
        unpacked, packed = unpacked + size, packed + _BLOCK.size + length
        if unpacked > max(_RATIO_MATTERS_BYTES, _MAX_RATIO * packed):
            came = say("bytes-unpack-to", packed, unpacked)
            raise GcodeError(name, wanted=say("plain-bgcode"), came=came, todo=say("slice-copy-file-again"))
        parameters = handle.read(6 if kind == THUMBNAIL else 2)
        data = handle.read(length) if length <= _MAX_BLOCK_BYTES else b""
        crc = handle.read(4) if checked else b""
        if len(parameters) < 2 or len(data) < length or (checked and len(crc) < 4):
            raise _cut_off(name)
        if checked and zlib.crc32(head + parameters + data) != int.from_bytes(crc, "little"):
            raise GcodeError(
                name,
                wanted=say("intact-bgcode"),
                came=say("wrong-crc-block-type", kind),
                todo=say("slice-copy-file-again"),
            )
        encoding = int.from_bytes(parameters[:2], "little")
        yield Block(kind, compression, encoding, size, data, head + parameters + data + crc)


def block_text(block: Block, name: str) -> bytes:
    """Return the text of a G-code or metadata block."""
    data = _decompressed(block, name)
    if block.kind != GCODE or block.encoding == 0:
        return data
    if block.encoding > 2:
        came = say("encoding", block.encoding)
        raise GcodeError(name, wanted=say("bgcode-no-encoding-meatpack"), came=came, todo=say("export-plain-g-code"))
    packed = np.frombuffer(data, np.uint8)
    out = np.empty(2 * len(packed) + 2, np.uint8)
    return out[: k.unpack(packed, out)].tobytes()


def gcode_blocks(text: bytes, like: Block, *, checked: bool) -> bytes:
    """Return G-code blocks that hold ``text`` (whole lines) with the compression and encoding of ``like``."""
    blocks, start = [], 0
    while start < len(text):
        stop = min(start + _TEXT_BYTES, len(text))
        if stop < len(text) and (line_end := text.rfind(b"\n", start, stop)) >= 0:
            stop = line_end + 1
        blocks.append(_gcode_block(text[start:stop], like, checked))
        start = stop
    return b"".join(blocks)


def write_like(
    source: Path, handle: IO[bytes], texts: Iterable[bytes | memoryview],
    told: Callable[[bytes], bytes], folder: Path | None = None,
) -> None:  # fmt: skip
    """Write ``source`` again with other G-code: its first blocks, the new text in whole lines, its last blocks.

    Metadata before the G-code states the printing time. Once ``texts`` are through, ``told`` returns each such line
    with the new time. Until then the G-code waits in a temporary file in ``folder``.
    """
    name = str(source)
    with source.open("rb") as original:
        raw, checked = read_header(original, name)
        handle.write(raw)
        like, before, after = None, list[Block](), list[Block]()
        for block in read_blocks(original, name, checked=checked):
            if block.kind == GCODE:
                like = like or block
            else:
                (before if like is None else after).append(block)
    if like is None:
        raise no_gcode(name)
    with tempfile.TemporaryFile(dir=folder) as spool:
        pending = bytearray()
        for text in texts:
            pending += text
            if len(pending) > 16 * _TEXT_BYTES and (line_end := pending.rfind(b"\n")) >= 0:
                spool.write(gcode_blocks(bytes(pending[: line_end + 1]), like, checked=checked))
                del pending[: line_end + 1]
        spool.write(gcode_blocks(bytes(pending), like, checked=checked))
        for block in before:
            handle.write(_retold(block, told, name, checked))
        spool.seek(0)
        shutil.copyfileobj(spool, handle, 1 << 20)
    for block in after:
        handle.write(_retold(block, told, name, checked))


def no_gcode(name: str) -> GcodeError:
    """Return the error of a binary file that holds no G-code."""
    return GcodeError(name, wanted=say("bgcode-g-code-block"), came=say("none"), todo=say("give-sliced-file"))


def _cut_off(name: str) -> GcodeError:
    return GcodeError(name, wanted=say("whole-bgcode-block"), came=say("end-file"), todo=say("slice-copy-file-again"))


def _retold(block: Block, told: Callable[[bytes], bytes], name: str, checked: bool) -> bytes:
    """Return a block of metadata, or a thumbnail, with the new printing times."""
    if block.kind == THUMBNAIL:
        return block.raw
    old = block_text(block, name)
    text = _TIMES.sub(lambda found: told(found[0]), old)
    return block.raw if text == old else _packed(block.kind, text, block, checked)


def _gcode_block(text: bytes, like: Block, checked: bool) -> bytes:
    data = text
    if like.encoding:
        if b"\xff" in text:  # MeatPack would read it as the start of a command
            came = say("byte-0xff")
            raise GcodeError("bgcode", wanted=say("text-meatpack-can-hold"), came=came, todo=say("export-plain-g-code"))
        out = np.empty(2 * len(text) + 6 * text.count(b"\n") + 16, np.uint8)
        data = out[: k.pack(np.frombuffer(text, np.uint8), True, out)].tobytes()
    return _packed(GCODE, data, like, checked)


def _packed(kind: int, data: bytes, like: Block, checked: bool) -> bytes:
    """Return a whole block that holds encoded ``data``, compressed as ``like`` is."""
    size = len(data)
    if like.compression == 1:
        data = zlib.compress(data, 9)
    elif like.compression:
        import heatshrink2

        data = heatshrink2.compress(data, window_sz2=_WINDOWS[like.compression], lookahead_sz2=4)
    head = _BLOCK.pack(kind, like.compression, size)
    if like.compression:
        head += len(data).to_bytes(4, "little")
    block = head + like.encoding.to_bytes(2, "little") + data
    return block + (zlib.crc32(block).to_bytes(4, "little") if checked else b"")


def _decompressed(block: Block, name: str) -> bytes:
    try:
        if block.compression == 0:
            data = block.data
        elif block.compression == 1:
            data = zlib.decompressobj().decompress(block.data, block.size + 1)
        else:
            import heatshrink2

            data = heatshrink2.decompress(block.data, window_sz2=_WINDOWS[block.compression], lookahead_sz2=4)
    except (zlib.error, RuntimeError, ValueError) as error:
        raise GcodeError(
            name, wanted=say("compressed-bgcode"), came=say("broken-data", error), todo=say("slice-copy-file-again")
        ) from None
    # The last bits of heatshrink's last byte can decode to one more byte.
    if len(data) < block.size or (block.compression < 2 and len(data) > block.size):
        raise GcodeError(
            name, wanted=say("block-bytes", block.size), came=f"{len(data)}", todo=say("slice-copy-file-again")
        )
    return data[: block.size]
