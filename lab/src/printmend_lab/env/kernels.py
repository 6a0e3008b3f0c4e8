"""The environment's loops: N machines side by side.

``machines``, ``tasks`` and ``fleet`` are the named tuples of arrays of fleet.py.
"""

import numpy as np

from printmend.jit import entry, inner
from printmend.machine.kernels import bed
from printmend.machine.kernels.play import anchor, clip


@inner(error_model="python", _nrt=True)
def _played(machines, fleet, n, axis, motor):
    """Return the belt position of environment n after its motor ``axis`` went to lattice position ``motor``."""
    k, i = fleet.machine[n], motor - machines.first[axis]
    shift = fleet.shift[n, axis]
    return clip(fleet.position[n, axis], machines.lower[k, axis, i] + shift, machines.upper[k, axis, i] + shift)


@inner(error_model="python", _nrt=True)
def _reached(machines, axis, nominal, control):
    """Return the nominal position after a control: one bed's length beyond the bed the motors stop."""
    return min(max(nominal + control, -machines.size[axis]), 2 * machines.size[axis])


@entry
def restart(rows, machines, tasks, fleet):
    """Put the environments ``rows`` at the start of their tasks: play centred, printed = nominal = start."""
    for n in rows:
        k = fleet.machine[n]
        x, y = tasks.starts[fleet.task[n], 0], tasks.starts[fleet.task[n], 1]
        fleet.nominal[n, 0], fleet.nominal[n, 1] = x, y
        fleet.beds[n] = machines.beds[k]
        way = fleet.beds[n]
        bed.anchor(way, x, y)
        motors = bed.to_motors(way, x, y)
        for axis in range(2):
            m = motors[axis]
            i = m - machines.first[axis]
            # The pool's branches belong to a layer in the middle of the bed; a shift anchors them at this start.
            fleet.shift[n, axis] = anchor(machines.lower[k, axis, i] - m, machines.upper[k, axis, i] - m, 0.5)
            fleet.position[n, axis] = m
            fleet.last[n, axis] = 0
            fleet.direction[n, axis] = 0
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
        way = fleet.beds[n]
        motors = bed.to_motors(way, fleet.nominal[n, 0], fleet.nominal[n, 1])
        for axis in range(2):
            fleet.position[n, axis] = _played(machines, fleet, n, axis, motors[axis])
        x, y = bed.printed(way, fleet.position[n, 0], fleet.position[n, 1])
        t = fleet.tick[n]
        error_x, error_y = x - tasks.targets[job, t, 0], y - tasks.targets[job, t, 1]
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
def where(fleet, out):
    """Fill out [N, 2] with where the nozzles are."""
    for n in range(out.shape[0]):
        out[n, 0], out[n, 1] = bed.printed(fleet.beds[n], fleet.position[n, 0], fleet.position[n, 1])


@entry
def follow(rows, fleet, way):
    """Note in way[n, tick] the nominal and the printed place of each environment of the mask ``rows`` [N]."""
    for n in range(rows.shape[0]):
        if rows[n]:
            t = fleet.tick[n]
            way[n, t, 0], way[n, t, 1] = fleet.nominal[n, 0], fleet.nominal[n, 1]
            way[n, t, 2], way[n, t, 3] = bed.printed(fleet.beds[n], fleet.position[n, 0], fleet.position[n, 1])


@entry
def greedy(c_max, machines, tasks, fleet, out):
    """Fill controls [N, 2]: Algorithm 1 on the true machines, all (2 c_max + 1)² candidates, first minimum wins."""
    for n in range(out.shape[0]):
        job = fleet.task[n]
        t, way = min(fleet.tick[n], tasks.lengths[job] - 1), fleet.beds[n]
        best = np.inf
        for cx in range(-c_max, c_max + 1):
            for cy in range(-c_max, c_max + 1):
                motors = bed.to_motors(
                    way,
                    _reached(machines, 0, fleet.nominal[n, 0], cx),
                    _reached(machines, 1, fleet.nominal[n, 1], cy),
                )
                a = _played(machines, fleet, n, 0, motors[0])
                b = _played(machines, fleet, n, 1, motors[1])
                x, y = bed.printed(way, a, b)
                error_x, error_y = x - tasks.targets[job, t, 0], y - tasks.targets[job, t, 1]
                error = error_x * error_x + error_y * error_y
                if error < best:
                    best = error
                    out[n, 0], out[n, 1] = cx, cy
