"""The comments that say what a file is: mended, so that it is not mended twice, or a test print of printmend's."""

import re
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

import printmend
from printmend.errors import GcodeError
from printmend.messages import say
from printmend.provenance import FORGED, MARK, MENDED, TEST_PRINT, TEST_PRINT_MARK, claimed_test_print

# Headers that must stay first; the mark follows the line that ends them.
_HEADERS = (
    (b"; HEADER_BLOCK_START", b"; HEADER_BLOCK_END"),  # Bambu, Orca
    (b";START_OF_HEADER", b";END_OF_HEADER"),  # UltiMaker
    (b";Header Start", b";Header End"),  # Snapmaker
)
_FAR_BYTES = 1 << 19  # of a file: a header that ends beyond is taken to be endless


def find_mark(*texts: bytes) -> str | None:
    """Return the model hash of the mark in pieces of a file (`Part.hints`), or None."""
    for text in texts:
        if found := _mark(text):
            return found[2].decode("ascii", "replace")
    return None


def find_e_rule(text: bytes) -> tuple[int, int] | None:
    """Return how E was read in a mended file (C_RULE, C_M83), if its mark says so."""
    found = _mark(text)
    return None if found is None or found[3] is None else (int(found[3]), int(found[4]))


def _mark(text: bytes) -> re.Match[bytes] | None:
    """Return the mark in a text. The expression is slow, so it runs only if the text contains the words."""
    return MARK.search(text) if MENDED in text else None


def find_test_print(*texts: bytes) -> str | None:
    """Return which test print of printmend's the pieces of a file are from: "probe" or "first layer".

    None for any other file. A mended test print is none either: it is the check print of `printmend verify`.
    """
    if find_mark(*texts) is not None:
        return None
    return next((found[1].decode() for text in texts if (found := TEST_PRINT_MARK.search(text))), None)


def is_test_print(path: Path) -> bool:
    """Say whether a file is an unmended test print of printmend's. Programs that mend every file must leave it
    unchanged, because it must show the printer without mending. Raises `GcodeError` for one that was changed since."""
    claim = claimed_test_print(str(path))
    if claim == FORGED:
        raise GcodeError(
            path, wanted=say("terminal-test-print-printmend-probe-wrote"), came=say("was-changed-since"),
            todo=say("write-again-take-out-comment-says"),
        )  # fmt: skip
    return claim == TEST_PRINT


def with_comment(text: bytes, comment: bytes) -> bytes:
    """Return G-code with a comment's line after its header, or after its first comment, or on top."""
    at, line_end = _place(text), _line_end(text)
    before = text[:at]
    missing = line_end if before and not before.endswith((b"\n", b"\r", b"\xef\xbb\xbf")) else b""
    closing = line_end if at < len(text) or not missing else b""
    return before + missing + comment + closing + text[at:]


def marked(
    chunks: Iterable[np.ndarray], model_hash: str, e_rule: tuple[int, int] | None = None
) -> Iterator[np.ndarray]:
    """Yield the chunks with the mark in the first, where `with_comment` puts it.

    ``e_rule`` is how E was read if that had to be guessed; the mended file must be read in the same way.
    """
    guessed = "" if e_rule is None else f" e={e_rule[0]}{e_rule[1]}"
    mark = MENDED + f"{printmend.__version__} model={model_hash}{guessed}".encode()
    first = True
    for chunk in chunks:
        if first:
            chunk = np.frombuffer(with_comment(chunk.tobytes(), mark), np.uint8)
            first = False
        yield chunk


def _line_end(text: bytes) -> bytes:
    newline = text.find(b"\n")
    if newline < 0 and b"\r" in text:
        return b"\r"
    return b"\r\n" if newline > 0 and text[newline - 1 : newline] == b"\r" else b"\n"


def _place(text: bytes) -> int:
    start = 3 if text.startswith(b"\xef\xbb\xbf") else 0
    for opening, ending in _HEADERS:
        # Where the header is endless the mark stands above its end: `find_mark` looks no further than a MiB.
        if text.startswith(opening, start) and (end := text.find(ending, start, _FAR_BYTES)) >= 0:
            return _next_line(text, end)
    line = text[start : _next_line(text, start)].strip()
    plain_comment = line.startswith(b";") and not line.lstrip(b"; ").startswith(b"thumbnail")
    return _next_line(text, start) if plain_comment or line == b"%" else start


def _next_line(text: bytes, position: int) -> int:
    newline = text.find(_line_end(text)[-1:], position)
    return len(text) if newline < 0 else newline + 1
