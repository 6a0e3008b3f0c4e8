"""Cut a file's moves into layers: by the slicer's comments where it wrote them, else by height."""

import numpy as np

_SAME_Z_MM = 1e-3  # lower steps in height begin no layer
_SLOPED_LAYER_MM = 0.05  # on a rising path (vase mode) a new layer begins this far above the last one's start


def layers_of(marks: np.ndarray, z0_mm: np.ndarray, z1_mm: np.ndarray, extruding: np.ndarray) -> np.ndarray:
    """Return the layer [M] of each move, −1 before the first extruding layer.

    ``marks`` [M] counts the layer comments before each move. Comments without an extruding move after them open no
    layer (headers, double comments). Without comments a layer is a run of extruding moves at one height, so that
    z-hops, which extrude nothing, do not cut; the travel between two layers belongs to the later one.
    """
    if len(marks) == 0:
        return np.empty(0, np.int64)
    used = np.unique(marks[extruding & (marks > 0)])
    if len(used):
        # A comment that opens nothing belongs to the layer before it.
        return np.searchsorted(used, marks, side="right").astype(np.int64) - 1
    printing = np.flatnonzero(extruding)
    layer = np.full(len(marks), -1, np.int64)
    if len(printing) == 0:
        return layer
    number = _by_height(z0_mm[printing], z1_mm[printing])
    # A travel goes to the layer of the next extruding move, what follows the last one to the last.
    following = np.searchsorted(printing, np.arange(len(marks)))
    layer[:] = number[np.minimum(following, len(printing) - 1)]
    return layer


def _by_height(z0_mm: np.ndarray, z1_mm: np.ndarray) -> np.ndarray:
    """Number the layers of extruding moves [N] from 0."""
    flat = np.abs(z1_mm - z0_mm) <= _SAME_Z_MM
    if flat.all():
        changed = np.abs(np.diff(z1_mm)) > _SAME_Z_MM
        return np.concatenate([[0], np.cumsum(changed)])
    number = np.empty(len(z1_mm), np.int64)
    current, base = 0, z1_mm[0]
    for i in range(len(z1_mm)):
        threshold = _SAME_Z_MM if flat[i] else _SLOPED_LAYER_MM
        if i and abs(z1_mm[i] - base) > threshold:
            current, base = current + 1, z1_mm[i]
        number[i] = current
    return number
