"""How long a print takes as its slicer says, and how many commands a second the printer has to take in."""

import re

import numpy as np

_SPENT = (  # PrusaSlicer and its family, Bambu and Orca, Cura
    re.compile(rb"estimated printing time \(normal mode\)[ \t]*=[ \t]*(\d[\dhmsd ]*)"),
    re.compile(rb"total estimated time:[ \t]*(\d[\dhmsd ]*)"),
    re.compile(rb"^;TIME:[ \t]*(?!6666\b)(\d+)[ \t\r]*$", re.MULTILINE),  # 6666 where Cura's engine has not put it in
)
_WORDS = (b"estimated printing time", b"total estimated time", b";TIME:")
_UNITS_S = {b"d": 86400.0, b"h": 3600.0, b"m": 60.0, b"s": 1.0, b"": 1.0}


def busiest(way_mm: np.ndarray, feed_mm_s: np.ndarray) -> int:
    """Return how many of the moves [N, 3] mm at feeds [N] mm/s come at most in one second, as if the head sped up at
    once. Moves without a length or a feed take no time."""
    length_mm = np.linalg.norm(way_mm, axis=1)
    moving = (length_mm > 0) & (feed_mm_s > 0)
    ends = np.cumsum(length_mm[moving] / feed_mm_s[moving])
    within = np.searchsorted(ends, ends + 1.0) - np.arange(len(ends))
    return int(within.max(initial=0))


def slicer_s(*texts: bytes) -> float | None:
    """Return how long a print takes as its slicer says in pieces of the file (`Part.hints`); None where it does not."""
    for expression, word in zip(_SPENT, _WORDS, strict=True):
        for text in texts:
            if word in text and (found := expression.search(text)) is not None:
                return sum(int(count) * _UNITS_S[unit] for count, unit in re.findall(rb"(\d+)([dhms]?)", found[1]))
    return None
