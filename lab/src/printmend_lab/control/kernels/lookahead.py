"""Greedy choices with ties broken for the next move (physics.md eq. 25, cure 1). Checks happen in lookahead.py."""

import numpy as np

from printmend.jit import entry, inner
from printmend.machine.kernels.bed import printed, to_motors
from printmend.machine.kernels.lattice import motors_reach
from printmend.machine.kernels.play import clip
from printmend_lab.control.kernels.greedy import bed_errors, reach

_TIE = 1e-12  # of a squared error: equal but for rounding


@entry
def next_different(targets, out):
    """Fill out [T] with the index of the next target that differs, or of the last one."""
    last = targets.shape[0] - 1
    for t in range(last, -1, -1):
        if t == last:
            out[t] = last
        else:
            out[t] = t + 1 if targets[t + 1] != targets[t] else out[t + 1]


@inner(error_model="python", _nrt=True)
def direction(targets, following, t, position):
    """Return the sign of the next move that a carriage at ``position`` will have to make: to the first target, from t
    on, that is more than half a step away. Looks at a few changes of target; 0 where none of them is."""
    k = t
    for _ in range(8):
        error = targets[k] - position
        if abs(error) > 0.5:
            return 1 if error > 0 else -1
        if following[k] == k:
            break
        k = following[k]
    return 0


@entry
def plan_axis(targets, following, motor, position, lower, upper, c_max, controls, imagined):
    """Plan one motor: among the controls that leave the carriage nearest to its target, take the one that best
    engages the branch which the next move needs: lower[m] ≈ target before a move forwards, upper[m] ≈ target before
    one backwards. Fills controls [T] and imagined [T + 1]."""
    imagined[0] = position
    size = lower.shape[0]
    for t in range(targets.shape[0]):
        target = targets[t]
        least, second, best, best_q = np.inf, np.inf, 0, position
        for c in range(-c_max, c_max + 1):
            m = motor + c
            if 0 <= m < size:
                q = clip(position, lower[m], upper[m])
                error = (target - q) * (target - q)
                if error < least:
                    least, second, best, best_q = error, least, c, q
                else:
                    second = min(second, error)
        tied = second <= least + _TIE
        best_value = np.inf
        ahead = direction(targets, following, t, best_q) if tied else 0
        for step in range(2 * c_max + 1 if tied else 0):
            c = (step + 1) // 2 if step % 2 else -(step // 2)  # 0, 1, −1, 2, …: rest where nothing is gained
            m = motor + c
            if 0 <= m < size:
                q = clip(position, lower[m], upper[m])
                error = (target - q) * (target - q)
                if error <= least + _TIE:
                    value = 0.0
                    if ahead > 0:
                        value = (lower[m] - target) ** 2
                    elif ahead < 0:
                        value = (upper[m] - target) ** 2
                    if value < best_value:
                        best, best_value, best_q = c, value, q
        motor += best
        position = best_q
        controls[t] = best
        imagined[t + 1] = position


@entry
def plan_both(targets, motor_targets, following, machine, c_max, controls, imagined):
    """Plan both motors of a `Lattice` together, as `plan_axis`.

    ``motor_targets`` [T, 2] are the targets seen by the motors' belts, ``following`` [2, T] their `next_different`.
    """
    bed = machine.bed
    span = motors_reach(bed, c_max)
    width = 2 * c_max + 1
    qa, qb = np.empty(2 * span + 1), np.empty(2 * span + 1)
    x, y, errors = np.empty(width * width), np.empty(width * width), np.empty(width * width)
    ma, mb, pa, pb = machine.start_a, machine.start_b, machine.origin_a, machine.origin_b
    lower_a, upper_a, lower_b, upper_b = machine.lower_a, machine.upper_a, machine.lower_b, machine.upper_b
    imagined[0, 0], imagined[0, 1] = printed(bed, pa, pb)
    for t in range(targets.shape[0]):
        reach(pa, ma, span, lower_a, upper_a, qa)
        reach(pb, mb, span, lower_b, upper_b, qb)
        bed_errors(bed, c_max, qa, qb, targets[t, 0], targets[t, 1], x, y, errors)
        nearest, least = -1, np.inf
        for n in range(errors.shape[0]):
            if errors[n] < least:
                nearest, least = n, errors[n]
        near_a, near_b = pa, pb
        if nearest >= 0:
            ca, cb = to_motors(bed, nearest // width - c_max, nearest % width - c_max)
            near_a, near_b = qa[ca + span], qb[cb + span]
        goal_a, goal_b = motor_targets[t, 0], motor_targets[t, 1]
        ahead_a = direction(motor_targets[:, 0], following[0], t, near_a)
        ahead_b = direction(motor_targets[:, 1], following[1], t, near_b)
        best_value, best_x, best_y = np.inf, 0, 0
        for n in range(errors.shape[0]):
            if not errors[n] <= least + _TIE:
                continue
            cx, cy = n // width - c_max, n % width - c_max
            ca, cb = to_motors(bed, cx, cy)
            value = 1e-9 * (cx * cx + cy * cy)  # rest where nothing is gained
            if ahead_a != 0:
                value += ((lower_a if ahead_a > 0 else upper_a)[ma + ca] - goal_a) ** 2
            if ahead_b != 0:
                value += ((lower_b if ahead_b > 0 else upper_b)[mb + cb] - goal_b) ** 2
            if value < best_value:
                best_value, best_x, best_y = value, cx, cy
        ca, cb = to_motors(bed, best_x, best_y)
        pa, pb = qa[ca + span], qb[cb + span]
        ma += ca
        mb += cb
        controls[t, 0], controls[t, 1] = best_x, best_y
        imagined[t + 1, 0], imagined[t + 1, 1] = printed(bed, pa, pb)
