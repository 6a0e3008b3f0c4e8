"""Damaged corpus files: each ends in moves, in the same bytes, or in one clear line; nothing crashes or hangs."""

import io
from pathlib import Path

import numpy as np
import pytest

from printmend.errors import GcodeError
from printmend.gcode.container import open_gcode
from printmend.gcode.read import Moves, read_gcode, straightened
from tests.test_gcode_rewrite import Bend, keep, rewritten

TOKENS = (
    *(b"G1 X1e9 Y-1e9", b"G2 X5 Y5 R0", b"G3 I0 J0", b"G91", b"G20", b"G92", b"G28", b"G53", b"M206 X1e15"),
    *(b"\0" * 9, b"\xff\xfe", b"(", b'"', b"{", b"N1 ", b"*", b"\r", b"\r\n", b"\n", b";", b"G1" * 300),
    *(b"G90.1 G2 X1 I1", b"G10 L2 P99 X1", b"T99999999999999", b"G1 X" + b"9" * 50, b"G2 X1 Y1 I1e14 P999"),
    *(b"SAVE_GCODE_STATE NAME=", b"RESTORE_GCODE_STATE MOVE=1", b"SET_GCODE_OFFSET X=1e300 MOVE=1"),
)


def mutated(data: bytes, rng: np.random.Generator) -> bytes:
    """Cut, flip, repeat and insert: a few damages anywhere."""
    for _ in range(rng.integers(1, 8)):
        at = int(rng.integers(0, len(data) + 1))
        damage = rng.integers(0, 5)
        if damage == 0:
            data = data[:at]
        elif damage == 1 and at < len(data):
            data = data[:at] + bytes([data[at] ^ int(rng.integers(1, 256))]) + data[at + 1 :]
        elif damage == 2:
            data = data[:at] + data[at + int(rng.integers(1, 200)) :]
        elif damage == 3:
            data = data[:at] + data[at : at + 300] + data[at:]
        else:
            data = data[:at] + TOKENS[int(rng.integers(len(TOKENS)))] + data[at:]
    return data


def text_files(corpus: Path) -> list[Path]:
    paths = [path for path in sorted((corpus / "gcode").rglob("*")) if path.is_file() and path.suffix != ".bgcode"]
    assert len(paths) > 40
    return paths


def window(data: bytes, rng: np.random.Generator, size: int = 20_000) -> bytes:
    start = int(rng.integers(0, max(len(data) - size, 0) + 1))
    return data[start : start + size]


def moves_or_refusal(text: bytes) -> Moves | None:
    try:
        return read_gcode(text).moves
    except GcodeError:
        return None


@pytest.mark.parametrize("seed", range(4))
def test_damaged_text_is_kept_and_its_rewriting_ends(corpus, seed):
    rng = np.random.default_rng(seed)
    for path in text_files(corpus):
        text = mutated(window(path.read_bytes(), rng), rng)
        assert rewritten(text, keep) == text, path
        output = rewritten(text, Bend(seed, feed=True))
        assert output.count(b"\n") + output.count(b"\r") >= text.count(b"\n") + text.count(b"\r") or b"(" in text
        moves = moves_or_refusal(text)
        if moves is None:
            continue
        fine = straightened(moves, 0.05) if not moves.arcs.any() or moves.arcs.sum() < 500 else moves
        for values in (fine.start_mm, fine.end_mm, fine.extrusion_mm, fine.feed_mm_s):
            assert np.isfinite(values).all()


@pytest.mark.parametrize("seed", range(3))
def test_damaged_containers_end_in_one_line(corpus, tmp_path, seed):
    rng = np.random.default_rng(seed)
    for path in sorted((corpus / "gcode").rglob("*.bgcode")):
        damaged = tmp_path / path.name
        damaged.write_bytes(mutated(path.read_bytes(), rng))
        with pytest.raises(GcodeError) as caught:  # every byte is under a CRC or in a header
            copy(damaged)
        assert "\n" not in str(caught.value)


def copy(path: Path) -> None:
    with open_gcode(path) as file:
        file.write(io.BytesIO(), lambda part: (chunk.data for chunk in part.chunks()))
