"""The laws over arrays: what Python calls. Arrays and scalars in, arrays out; checks happen where they are called."""

from printmend.jit import entry
from printmend.machine.kernels import bed, play, table


@entry
def run_motor(moves, motor, index, position, lower, upper, out):
    """Follow the moves [T, M] of one motor from ``index`` in its tables; fill out[:, motor] [T + 1].

    The belt starts at ``position``. The tables are monotone, so only the end of each move matters. Return False when
    the motor leaves them.
    """
    out[0, motor] = position
    for t in range(moves.shape[0]):
        index += moves[t, motor]
        if index < 0 or index >= lower.shape[0]:
            return False
        position = play.clip(position, lower[index], upper[index])
        out[t + 1, motor] = position
    return True


@entry
def follow(position, lower, upper, out):
    """Follow a belt from ``position`` between ``lower`` and ``upper`` [N], its branches at every row; fill out [N]."""
    for t in range(lower.shape[0]):
        position = play.clip(position, lower[t], upper[t])
        out[t] = position


@entry
def contacts(position, lower, upper, at, side, out):
    """Follow a belt as `follow` does, and say which contact gave it its place.

    Fills, for each row, ``at`` (the row of the last contact, −1 while the belt is where it started) and ``side`` (the
    branch touched there: `play.PUSHED`, `play.PULLED` or `play.FREE`).
    """
    row, branch = -1, play.FREE
    for t in range(lower.shape[0]):
        position, touched = play.contact(position, lower[t], upper[t])
        if touched != play.FREE:
            row, branch = t, touched
        at[t], side[t], out[t] = row, branch, position


@entry
def clip_each(positions, lower, upper, out):
    """Fill out [N] with where belts at ``positions`` [N] are between their branches [N]."""
    for n in range(out.shape[0]):
        out[n] = play.clip(positions[n], lower[n], upper[n])


@entry
def branch_each(entries, first, rate, motors, out):
    """Fill out [N] with a branch, its table ``entries``, at motor positions [N]."""
    last = float(entries.shape[0] - 1)
    for n in range(out.shape[0]):
        out[n] = table.branch_at(entries, 0, first, rate, last, motors[n])


@entry
def push_each(entries, first, rate, motors, out):
    """Fill out [N] with a screw's push along one axis, its table ``entries``, at motor positions [N].

    It is unknown where the position is.
    """
    last = float(entries.shape[0] - 1)
    for n in range(out.shape[0]):
        m = motors[n]
        out[n] = table.push_at(entries, 0, first, rate, last, m) if m == m else m


@entry
def printed_each(way, belts, out):
    """Fill out [N, 2] with the places on the bed of motors' belts [N, 2]; ``way`` is a `BedMap`'s record."""
    for n in range(out.shape[0]):
        out[n, 0], out[n, 1] = bed.printed(way, belts[n, 0], belts[n, 1])


@entry
def wanted_each(way, places, out):
    """Fill out [N, 2] with where the motors' belts have to be for places on the bed [N, 2]."""
    for n in range(out.shape[0]):
        out[n, 0], out[n, 1] = bed.wanted(way, places[n, 0], places[n, 1])


@entry
def slopes_each(way, belts, out):
    """Fill out [N, 2, 2] with the derivatives of the places on the bed by the motors' belts, at belts [N, 2]."""
    for n in range(out.shape[0]):
        x, y = bed.from_motors(way, belts[n, 0], belts[n, 1])
        xx, xy, yx, yy = bed.slopes(way, x, y)
        # x and y follow the belts as a place follows the motors
        out[n, 0, 0], out[n, 0, 1] = bed.from_motors(way, xx, xy)
        out[n, 1, 0], out[n, 1, 1] = bed.from_motors(way, yx, yy)


@entry
def anchor(way, x, y):
    """Shift a frame's constant terms so that the place (x, y) stays where it is."""
    bed.anchor(way, x, y)


@entry
def lay_branches(lower_errors, upper_errors, first, start, share, lower, upper):
    """Fill a motor's branches on the lattice [N], for a layer that starts at entry ``start``, the belt at rest there.

    The errors [N] are the branches less the motor's position, of which entry 0 stands for ``first``; in full steps.
    """
    shift = play.anchor(play.fine(lower_errors[start]), play.fine(upper_errors[start]), share)
    for i in range(lower.shape[0]):
        lower[i] = first + i + play.fine(lower_errors[i]) + shift
        upper[i] = first + i + play.fine(upper_errors[i]) + shift
