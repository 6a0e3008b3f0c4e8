# ruff: noqa: F403, F405 (numba needs the layout's constants as globals of this file)
"""What lines are printed for, by the comments of slicers: `;TYPE:External perimeter`, `;TYPE:WALL-OUTER`,
`; FEATURE: Outer wall`, `; feature outer perimeter`."""

import numpy as np

from printmend.gcode.kernels.layout import *
from printmend.gcode.kernels.text import starts_with
from printmend.jit import inner

_TYPE, _FEATURE = np.frombuffer(b"TYPE:", np.uint8), np.frombuffer(b"FEATURE", np.uint8)
# In this order: a word of the first that a comment has says what it names.
_WORDS = (
    np.frombuffer(b"SUPPORT SKIRT BRIM TOWER PILLAR SHIELD RAFT WIPE ", np.uint8),
    np.frombuffer(b"OUTER EXTERNAL OVERHANG SINGLE ", np.uint8),
    np.frombuffer(b"INNER PERIMETER WALL ", np.uint8),
    np.frombuffer(b"SOLID TOP BOTTOM SURFACE SKIN BRIDGE IRONING GAP ", np.uint8),
    np.frombuffer(b"FILL ", np.uint8),
)
_ROLES = (ROLE_ASIDE, ROLE_OUTER, ROLE_INNER, ROLE_SOLID, ROLE_INFILL)


@inner
def role_of(buf, p, stop, before):
    """Return the ROLE_* that a comment, whose text begins at p, names; ``before`` where it names none."""
    if starts_with(buf, p, stop, _TYPE):
        p += len(_TYPE)
    elif starts_with(buf, p, stop, _FEATURE):
        p += len(_FEATURE)
    else:
        return before
    for k in range(len(_ROLES)):
        if _has_one(buf, p, stop, _WORDS[k]):
            return np.int64(_ROLES[k])
    return np.int64(ROLE_UNKNOWN)


@inner
def _has_one(buf, p, stop, words):
    """Say whether one of some words, each with a blank behind it, stands in buf[p:stop], in either case."""
    first = 0
    for last in range(len(words)):
        if words[last] == 32:
            for q in range(p, stop):
                if starts_with(buf, q, stop, words[first:last]):
                    return True
            first = last + 1
    return False
