"""The environment's loops: N machines side by side.

``machines``, ``tasks`` and ``fleet`` are the named tuples of arrays of fleet.py.
"""

import numpy as np

from printmend.jit import entry


@entry
def _on_bed(machines, k, belt_x, belt_y):
    """Return where belt (motor) positions [full steps] put the nozzle of machine k (mechanism.Frame)."""
    x, y = belt_x, belt_y
    if machines.corexy:
        x, y = (belt_x + belt_y) / 2, (belt_x - belt_y) / 2
    if not machines.has_frame:
        return x, y
    u = (machines.low_mm[0] + x * machines.pitch_mm[0]) / machines.frame_scale_mm
    v = (machines.low_mm[1] + y * machines.pitch_mm[1]) / machines.frame_scale_mm
    a, b = machines.frames[k, 0], machines.frames[k, 1]
    u2, uv, v2 = u * u, u * v, v * v
    dx = a[0] + a[1] * u + a[2] * v + a[3] * u2 + a[4] * uv + a[5] * v2
    dx += a[6] * u2 * u + a[7] * u2 * v + a[8] * u * v2 + a[9] * v2 * v
    dy = b[0] + b[1] * u + b[2] * v + b[3] * u2 + b[4] * uv + b[5] * v2
    dy += b[6] * u2 * u + b[7] * u2 * v + b[8] * u * v2 + b[9] * v2 * v
    return x + dx / machines.pitch_mm[0], y + dy / machines.pitch_mm[1]


@entry
def _played(machines, fleet, n, axis, motor):
    """Return the belt position of environment n after its motor ``axis`` went to lattice position ``motor``."""
    k = fleet.machine[n]
    i = motor - machines.first[axis]
    low = machines.lower[k, axis, i] - fleet.origin[n, axis]
    high = machines.upper[k, axis, i] - fleet.origin[n, axis]
    return min(max(fleet.position[n, axis], low), high)


@entry
def _motors(machines, x, y):
    if machines.corexy:
        return x + y, x - y
    return x, y


@entry
def _reached(machines, axis, nominal, control):
    """Return the nominal position after a control: one bed's length beyond the bed the motors stop."""
    return min(max(nominal + control, -machines.bed[axis]), 2 * machines.bed[axis])


@entry
def restart(rows, machines, tasks, fleet):
    """Put the environments ``rows`` at the start of their tasks: play centred, printed = nominal = start."""
    for n in rows:
        k = fleet.machine[n]
        x, y = tasks.starts[fleet.task[n], 0], tasks.starts[fleet.task[n], 1]
        fleet.nominal[n, 0], fleet.nominal[n, 1] = x, y
        motors = _motors(machines, x, y)
        for axis in range(2):
            m = motors[axis]
            i = m - machines.first[axis]
            fleet.origin[n, axis] = (machines.lower[k, axis, i] + machines.upper[k, axis, i]) / 2 - m
            fleet.position[n, axis] = m
            fleet.last[n, axis] = 0
            fleet.direction[n, axis] = 0
        bed_x, bed_y = _on_bed(machines, k, fleet.position[n, 0], fleet.position[n, 1])
        fleet.anchor[n, 0], fleet.anchor[n, 1] = x - bed_x, y - bed_y
        fleet.tick[n] = 0
        fleet.squares[n] = 0.0


@entry
def advance(controls, skip, machines, tasks, fleet, dense, reward, done):
    """Apply controls [N, 2] to the environments that are not in ``skip`` [N]; fill reward and done [N]."""
    for n in range(controls.shape[0]):
        reward[n] = 0.0
        done[n] = False
        if skip[n]:
            continue
        job = fleet.task[n]
        for axis in range(2):
            reached = _reached(machines, axis, fleet.nominal[n, axis], controls[n, axis])
            moved = reached - fleet.nominal[n, axis]
            fleet.last[n, axis] = moved
            if moved != 0:
                fleet.direction[n, axis] = 1 if moved > 0 else -1
            fleet.nominal[n, axis] = reached
        motors = _motors(machines, fleet.nominal[n, 0], fleet.nominal[n, 1])
        for axis in range(2):
            fleet.position[n, axis] = _played(machines, fleet, n, axis, motors[axis])
        x, y = _on_bed(machines, fleet.machine[n], fleet.position[n, 0], fleet.position[n, 1])
        t = fleet.tick[n]
        error_x = x + fleet.anchor[n, 0] - tasks.targets[job, t, 0]
        error_y = y + fleet.anchor[n, 1] - tasks.targets[job, t, 1]
        points = tasks.lengths[job] + 1.0  # the start counts, as in the published evaluation
        before = np.sqrt(fleet.squares[n] / points)
        fleet.squares[n] += error_x * error_x + error_y * error_y
        after = np.sqrt(fleet.squares[n] / points)
        fleet.tick[n] = t + 1
        done[n] = t + 1 == tasks.lengths[job]
        if dense:
            reward[n] = before - after  # telescopes: the return is −RMSE either way
        elif done[n]:
            reward[n] = -after


@entry
def observe(tasks, fleet, lookahead, out):
    """Fill the observations [N, 8 + 2·lookahead]."""
    for n in range(out.shape[0]):
        job = fleet.task[n]
        for axis in range(2):
            out[n, axis] = tasks.starts[job, axis]
            out[n, 2 + axis] = fleet.nominal[n, axis] - tasks.starts[job, axis]
            out[n, 4 + axis] = fleet.last[n, axis]
            out[n, 6 + axis] = fleet.direction[n, axis]
            for h in range(lookahead):
                t = min(fleet.tick[n] + h, tasks.lengths[job] - 1)  # the last target repeats past the end
                out[n, 8 + 2 * h + axis] = tasks.targets[job, t, axis] - fleet.nominal[n, axis]


@entry
def greedy(c_max, machines, tasks, fleet, out):
    """Fill controls [N, 2]: Algorithm 1 on the true machines, all (2 c_max + 1)² candidates, first minimum wins."""
    for n in range(out.shape[0]):
        job = fleet.task[n]
        t = min(fleet.tick[n], tasks.lengths[job] - 1)
        best = np.inf
        for cx in range(-c_max, c_max + 1):
            for cy in range(-c_max, c_max + 1):
                motors = _motors(
                    machines,
                    _reached(machines, 0, fleet.nominal[n, 0], cx),
                    _reached(machines, 1, fleet.nominal[n, 1], cy),
                )
                a = _played(machines, fleet, n, 0, motors[0])
                b = _played(machines, fleet, n, 1, motors[1])
                x, y = _on_bed(machines, fleet.machine[n], a, b)
                error_x = x + fleet.anchor[n, 0] - tasks.targets[job, t, 0]
                error_y = y + fleet.anchor[n, 1] - tasks.targets[job, t, 1]
                error = error_x * error_x + error_y * error_y
                if error < best:
                    best = error
                    out[n, 0], out[n, 1] = cx, cy
