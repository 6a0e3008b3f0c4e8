"""What one motor's drive may be made of, as columns whose weights are learned.

With the last contact of a row at motor position m on side s (−1 pushed, +1 pulled), and the other motor at q, the
belt is off its command by Σ w_c φ_c(m, s, q): a line, waves of the motor's turn, bumps 10 and 30 mm wide that repeat
nothing, waves that change along the bed, the frame's terms; and s/2 times the play: constant, waves, bumps, a slope
(physics.md eq. 7–10, 17). Columns of one group share what is believed of them.
"""

from functools import lru_cache

import numpy as np

from printmend.path import frozen
from printmend.units import TURN_RAD
from printmend_lab.meta import kernels

HARMONICS, PLAY_HARMONICS = 12, 6  # waves of a turn: those of the belt's place, and those of the play
ELASTIC_HARMONICS = (1, 3, 5)  # waves that change along the bed, as a belt's stretch and a loose pulley make them
NARROW_MM, WIDE_MM = 10.0, 30.0  # spacing and standard deviation of the bumps
SCALE_MM = 100.0  # distance from the bed's middle at which a slope or a term of the frame is as large as its weight
CROSS = 5  # terms of the frame
# The groups in order; those of `FIXED` are believed to be anything, whatever the network says.
GROUPS = (
    "offset", "slope", *(f"wave {k}" for k in range(1, HARMONICS + 1)), "narrow bumps", "wide bumps", "elastic",
    "cross", "play", "play wave 1", "play waves", "play bumps", "play slope",
)  # fmt: skip
FIXED = 2  # the first groups: offset and slope
FIXED_SD_MM = (100.0, 30.0)  # standard deviations of what is believed of them, wider than any machine


@lru_cache(maxsize=8)
def groups(reach_mm: tuple[float, float]) -> np.ndarray:
    """Return the group [C] of each column for a motor that goes from reach_mm[0] to reach_mm[1] about the middle."""
    narrow, wide = len(_places(reach_mm, NARROW_MM)), len(_places(reach_mm, WIDE_MM))
    sizes = [1, 1, *[2] * HARMONICS, narrow, wide, 2 * len(ELASTIC_HARMONICS), CROSS, 1, 2, 2 * (PLAY_HARMONICS - 1),
             wide, 2]  # fmt: skip
    return frozen(np.repeat(np.arange(len(GROUPS)), sizes))


def columns(
    at_mm: np.ndarray, side: np.ndarray, other_mm: np.ndarray, turn_mm: float, reach_mm: tuple[float, float]
) -> np.ndarray:
    """Return the columns [N, C] at contacts ``at_mm`` [N] on ``side`` [N]; places count from the bed's middle."""
    places = [_places(reach_mm, apart_mm) for apart_mm in (NARROW_MM, WIDE_MM)]
    bells = np.array([[found[0], found[1] - found[0], len(found)] for found in places])
    out = np.empty((len(at_mm), len(groups(reach_mm))))
    kernels.fill_columns(
        *(np.ascontiguousarray(values, float) for values in (at_mm, side, other_mm)), TURN_RAD / turn_mm, SCALE_MM,
        HARMONICS, PLAY_HARMONICS, np.array(ELASTIC_HARMONICS), bells, out,
    )  # fmt: skip
    return out


def _places(reach_mm: tuple[float, float], spacing_mm: float) -> np.ndarray:
    first, last = np.floor(reach_mm[0] / spacing_mm), np.ceil(reach_mm[1] / spacing_mm)
    return spacing_mm * np.arange(first, last + 1)
