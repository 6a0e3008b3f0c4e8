"""Count a measurement once: find rows that repeat others exactly, and tables that a model already contains.

Two measurements of one place differ by the noise of each. A second paste or export of a table does not; where the
measurement has no noise at all, a repeated row tells nothing that the first did not.
"""

import hashlib
from dataclasses import replace

import numpy as np

from printmend.path import Trace

LEAST_COPIES = 10  # rows that repeat others; fewer may be chance
LEAST_COPIES_SHARE = 0.45  # share of the measured rows: of a table that was pasted twice nearly half are copies
RANDOM_SDS = 3.0  # rows whose steps are this many standard deviations from those of chance, or fewer, are in no order
_DIGITS = 16  # hexadecimal digits of a digest
_FARTHEST_MM = 1e6  # a cell beyond this is a mistake, and counts as this


def counted_once(trace: Trace) -> tuple[Trace, int]:
    """Return the trace with copies of measured rows left unmeasured, and how many there were.

    The commanded motion stays: what was a copy is passed without being measured. A way back over places that measure
    the same is no copy, but rows that repeat others in no order at all are: no print comes back to its places so.
    Nothing is changed where fewer rows are copies than a second paste makes.
    """
    seen = np.isfinite(_measured(trace)).any(axis=1)
    columns = _everything(trace)
    # one number a row: of equal rows equal, of others not, but for one chance in 10¹²
    key = (columns * np.random.default_rng(0).standard_normal(columns.shape[1])).sum(axis=1)
    row = np.unique(key, return_inverse=True)[1]
    before, after = np.append(-1, row[:-1]), np.append(row[1:], -1)
    # a row and a neighbour of it again: on a way back over the same places the neighbours change sides
    copies = np.flatnonzero(seen & (_again(row, before) | _again(row, after) | (row == before)))
    repeating = np.flatnonzero(seen & _again(row, np.zeros_like(row)))
    if len(repeating) >= LEAST_COPIES and in_no_order(trace.commanded_mm[repeating]):
        copies = repeating
    if len(copies) < max(LEAST_COPIES, LEAST_COPIES_SHARE * seen.sum()):
        return trace, 0
    left = {}
    for name in ("measured_mm", "z_measured_mm", "normal", "offset_mm"):
        if (values := getattr(trace, name)) is not None:
            left[name] = values.copy()
            left[name][copies] = np.nan
    return replace(trace, **left), len(copies)


def in_no_order(places_mm: np.ndarray) -> bool:
    """Say whether places [N, 2] come in a random order.

    A nozzle goes from neighbour to neighbour; in a random order, neighbours in the table are as far from each other as
    any two rows (mean over n of them: to 1/√n); back and forth across the bed they are farther.
    """
    shuffled = places_mm[np.random.default_rng(0).permutation(len(places_mm))]
    step_mm, any_mm = (float(np.hypot(*np.diff(each, axis=0).T).mean()) for each in (places_mm, shuffled))
    return abs(step_mm - any_mm) <= RANDOM_SDS / np.sqrt(len(places_mm)) * any_mm


def _again(row: np.ndarray, beside: np.ndarray) -> np.ndarray:
    """Return which pairs of two numbers [N] came earlier."""
    again = np.ones(len(row), bool)
    again[np.unique(row * (len(row) + 2) + beside, return_index=True)[1]] = False
    return again


def digest_of(trace: Trace) -> str:
    """Return hexadecimal digits over what was commanded and measured, to the nanometre."""
    whole_nm = np.rint(_everything(trace) * 1e6).astype(np.int64)
    return hashlib.sha256(whole_nm.tobytes()).hexdigest()[:_DIGITS]


def _measured(trace: Trace) -> np.ndarray:
    """Return all that was measured [N, ≥ 2], NaN where nothing was."""
    return _side_by_side(trace.measured_mm, trace.z_measured_mm, trace.offset_mm)


def _everything(trace: Trace) -> np.ndarray:
    """Return commands and measurements [N, ≥ 4], −`_FARTHEST_MM` where there is none."""
    columns = _side_by_side(trace.commanded_mm, trace.z_mm, trace.layer, trace.normal, _measured(trace))
    return np.nan_to_num(columns, nan=-_FARTHEST_MM).clip(-_FARTHEST_MM, _FARTHEST_MM)


def _side_by_side(*columns: np.ndarray | None) -> np.ndarray:
    return np.column_stack([values for values in columns if values is not None])
