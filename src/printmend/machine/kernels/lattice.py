"""The planar motors of a machine on the lattice, as planners' kernels take them (`PlayTables.arrays`)."""

from typing import NamedTuple

import numpy as np

from printmend.jit import inner


class Lattice(NamedTuple):
    """Two motors a and b with play, full steps: where each starts in its tables, its branches, and the way to the bed.

    ``start_a`` is the entry of motor a's tables at which a layer starts, ``origin_a`` where its belt is then;
    ``lower_a`` and ``upper_a`` are its branches. ``bed`` is the record of a `BedMap`.
    """

    start_a: int
    start_b: int
    origin_a: float
    origin_b: float
    lower_a: np.ndarray
    upper_a: np.ndarray
    lower_b: np.ndarray
    upper_b: np.ndarray
    bed: np.record


@inner
def motors_reach(way, c_max):
    """Return how many steps a motor makes at most for controls of at most ``c_max``; ``way`` is a record of BED."""
    return 2 * c_max if way.corexy != 0.0 else c_max
