"""Are the measured axes those of the printer? Swapped, mirrored and turned tables are found by ranks, which wild cells
do not disturb."""

import numpy as np

from printmend.messages import say

LEAST_RANK_CORRELATION = 0.8  # Spearman's, of a measured column and the commanded one that it belongs to
LEAST_MARGIN = 0.25  # by how much less the other column must correlate
AXES_TODO = say("swap-columns-back-let-each-axis")
LEAST_SPREAD_MM = 15.0  # smallest spread of an axis that shows its direction
MOST_LOOKED_AT = 4000  # rows that are looked at: more take time and say the same


def wrong_axes(commanded_mm: np.ndarray, measured_mm: np.ndarray) -> str | None:
    """Return what is wrong with the axes of measured places [N, 2] (NaN: not measured), None where nothing surely is.

    Places along one line only, which look alike from both axes, tell nothing.
    """
    rows = np.flatnonzero(np.isfinite(measured_mm).all(axis=1))
    if len(rows) > MOST_LOOKED_AT:
        rows = rows[np.linspace(0, len(rows) - 1, MOST_LOOKED_AT).astype(np.int64)]
    commanded, measured = commanded_mm[rows], measured_mm[rows]
    if len(rows) < 10 or np.diff(np.quantile(commanded, (0.1, 0.9), axis=0), axis=0).min() < LEAST_SPREAD_MM:
        return None
    ranks = [np.argsort(np.argsort(values, axis=0), axis=0) for values in (commanded, measured)]
    together = np.atleast_2d(np.corrcoef(np.hstack(ranks).T))[:2, 2:]  # of commanded x, y with measured x, y
    own, across = np.diag(together), np.array([together[0, 1], together[1, 0]])
    if np.abs(across).min() > LEAST_RANK_CORRELATION and np.abs(own).max() < np.abs(across).min() - LEAST_MARGIN:
        if (across > 0).all():
            return say("axes-swapped")
        if (across < 0).all():
            return say("axes-swapped-mirrored")
        return say("all-turned-left" if across[0] > 0 else "all-turned-right")
    if np.abs(own).min() < LEAST_RANK_CORRELATION or np.abs(own).min() < np.abs(across).max() + LEAST_MARGIN:
        return None
    if (own < 0).all():
        return say("all-turned-half")
    return say("x-mirrored") if own[0] < 0 else say("y-mirrored") if own[1] < 0 else None
