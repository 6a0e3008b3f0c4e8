"""How much longer a mended print takes at the least: what it costs to cross the slack of loose axes at corners.

    .venv/bin/python benchmarks/klippy_least.py ../shared/corpus/gcode --severity realistic --moves 3000

At a corner where a motor turns back, and where a line begins against the way that the motor came, it goes its slack s
further than the path. At a speed F and an acceleration a, from the corner's own speed v, that costs s/F where the motor
reaches F no sooner than at the end of its slack; where it does, it may go faster than F meanwhile and brake again.
Where the path stays within the tolerance of the turn for long enough the slack costs nothing here. The files, faults
and printers are those of bench_klippy.py, whose planner has the same a and v; of each the turns and the share of its
time as printmend reads it, acceleration left out.
"""

import numpy as np

from bench_corpus import around
from klippy_cases import arguments, cases, drawn, text_of
from printmend.errors import PrintmendError
from printmend.gcode.arcs import straightened
from printmend.gcode.read import Moves, read_gcode
from printmend.machine import Mechanism, Transmission
from printmend.printer import read_printer

ACCELERATION_MM_S2, CORNER_MM_S, TOLERANCE_MM = 3000.0, 5.0, 0.01
_LEAST_SLACK_MM = 0.005
_ROOM = 0.75  # mm of slack a mm of path that cost nothing, as printmend crosses them


def least_s(slack_mm: float, speed_mm_s: float) -> float:
    """Return how much longer a line takes whose motor has to cross its slack first."""
    slow = min(CORNER_MM_S, speed_mm_s)
    square, twice = speed_mm_s**2 - slow**2, 2 * ACCELERATION_MM_S2
    if twice * slack_mm <= square:
        return slack_mm / speed_mm_s
    peak = np.sqrt((twice * slack_mm + slow**2 + speed_mm_s**2) / 2)
    spared = (speed_mm_s - slow) / ACCELERATION_MM_S2 - square / (twice * speed_mm_s)
    return float((2 * peak - slow - speed_mm_s) / ACCELERATION_MM_S2 - spared)


def _slack_mm(drive: Transmission, belt_mm: float) -> float:
    lower, upper = (np.interp(belt_mm, table, drive.motor_mm) for table in (drive.lower_mm, drive.upper_mm))
    return abs(float(lower - upper))


def _within(s_mm: np.ndarray, belt_mm: np.ndarray, at: int, way: int) -> float:
    """Return how much path from node ``at`` on the belt stays within the tolerance."""
    i = at
    while 0 <= i + way < len(s_mm):
        before, after = (abs(belt_mm[j] - belt_mm[at]) for j in (i, i + way))
        if after > TOLERANCE_MM:
            part = (TOLERANCE_MM - before) / (after - before)
            return abs(s_mm[i] + part * (s_mm[i + way] - s_mm[i]) - s_mm[at])
        i += way
    return abs(s_mm[i] - s_mm[at])


def crossings(moves: Moves, machine: Mechanism) -> list[float]:
    """Return what each crossing costs at the least [s], of a cartesian machine."""
    start, end, found = moves.start_mm[:, :2], moves.end_mm[:, :2], []
    length = np.linalg.norm(end - start, axis=1)
    drawn = np.flatnonzero(moves.extruding & moves.known[:, :2].all(axis=1) & (length > 0))
    if not len(drawn):
        return []
    apart = (np.diff(drawn) != 1) | (np.abs(start[drawn[1:]] - end[drawn[:-1]]).max(axis=1) > 1e-9)
    came, travelled = [0.0, 0.0], 0
    for run in np.split(drawn, np.flatnonzero(apart) + 1):
        places = np.vstack([start[run[:1]], end[run]])
        s = np.concatenate([[0.0], np.cumsum(length[run])])
        speed = np.maximum(moves.feed_mm_s[run], 1.0)
        for k, drive in enumerate(machine.transmissions):
            for step in end[travelled : run[0], k] - start[travelled : run[0], k]:
                came[k] = np.sign(step) if abs(step) > TOLERANCE_MM else came[k]
            u, trend, at = places[:, k], came[k], 0
            for i in range(1, len(u)):
                if trend * (u[i] - u[at]) >= 0 and trend:
                    at = i
                elif abs(u[i] - u[at]) > TOLERANCE_MM:
                    slack = _slack_mm(drive, u[at])
                    room = _within(s, u, at, 1) + _within(s, u, at, -1)
                    if trend and slack > max(_LEAST_SLACK_MM, _ROOM * room):
                        found.append(least_s(slack, speed[min(at, len(speed) - 1)]))
                    trend, at = np.sign(u[i] - u[at]), i
            came[k] = trend
        travelled = run[-1] + 1
    return found


def main() -> None:
    options = arguments(__doc__).parse_args()
    print("  turns  least s  file")
    for source, family in cases(options):
        printer = read_printer(options.preset)
        try:
            text = text_of(source, printer, options)
            moves = straightened(read_gcode(text, printer=printer).moves, TOLERANCE_MM)
        except PrintmendError as error:
            print(f"  {type(error).__name__}: {str(error)[:100]}  {source.name}")
            continue
        found = crossings(moves, drawn(family, options).lower(around(printer, moves)))  # type: ignore[arg-type] — gain tables are no family here
        print(f"{len(found):7} {sum(found):8.2f}  {source.name} ({family})", flush=True)


if __name__ == "__main__":
    main()
