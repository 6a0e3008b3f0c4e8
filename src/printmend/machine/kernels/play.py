"""Play between a motor and what it drives: u ← min(max(u, lower), upper) (physics.md eq. 7).

``lower`` and ``upper`` are what the two branches of a transmission say at the motor's position; `table` looks them up.
"""

import numpy as np

from printmend.jit import inner

PUSHED, FREE, PULLED = -1, 0, 1  # the branch that holds the belt: lower, none, upper
# Places on the lattice are multiples of 2^-36 of a full step, 1.5e-11: then sums, differences and halves of them are
# exact up to 2^15 steps, in whatever order they are taken.
RESOLUTION = 2.0**36


@inner
def clip(position, lower, upper):
    """Return where a belt at ``position`` is once its motor has arrived."""
    return min(max(position, lower), upper)


@inner
def contact(position, lower, upper):
    """Return what `clip` returns, and which branch moved the belt: `PUSHED`, `PULLED`, or `FREE` where none did."""
    after = clip(position, lower, upper)
    return after, PULLED if after < position else PUSHED if after > position else FREE


@inner
def rest(lower, upper, share):
    """Return where a belt that nothing has moved yet rests: at ``share`` of its play, 0 pushed, 1 pulled."""
    return (1 - share) * lower + share * upper


@inner
def fine(steps):
    """Round a number of full steps to the lattice's resolution."""
    return np.rint(steps * RESOLUTION) / RESOLUTION


@inner
def anchor(lower, upper, share):
    """Return what to add to both branches so that a belt at rest between them is at its nominal position.

    ``lower`` and ``upper`` are the branches at the start less the nominal position, in full steps of the lattice's
    resolution.
    """
    return -fine(2 * rest(lower, upper, share)) / 2  # the middle of two multiples is half of a multiple
