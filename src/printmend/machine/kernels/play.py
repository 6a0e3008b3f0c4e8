"""Play between a motor and what it drives: u ← min(max(u, lower), upper) (physics.md eq. 7).

``lower`` and ``upper`` are what the two branches of a transmission say at the motor's position; `table` looks them up.
"""

from printmend.jit import inner

PUSHED, FREE, PULLED = -1, 0, 1  # the branch that holds the belt: lower, none, upper


@inner(error_model="numpy", _nrt=False)
def clip(position, lower, upper):
    """Return where a belt at ``position`` is once its motor has arrived."""
    return min(max(position, lower), upper)


@inner(error_model="numpy", _nrt=False)
def contact(position, lower, upper):
    """Return what `clip` returns, and which branch moved the belt: `PUSHED`, `PULLED`, or `FREE` where none did."""
    after = clip(position, lower, upper)
    return after, PULLED if after < position else PUSHED if after > position else FREE


@inner(error_model="numpy", _nrt=False)
def rest(lower, upper, share):
    """Return where a belt rests that nothing has moved yet: at ``share`` of its play, 0 pushed, 1 pulled."""
    return (1 - share) * lower + share * upper
