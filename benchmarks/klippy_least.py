"""How much a mended print costs at the least: the time to cross the slack of loose axes at corners, and the moves.

    .venv/bin/python benchmarks/klippy_least.py ../shared/corpus/gcode --severity realistic --moves 3000

At a corner where a motor turns back, and where a line begins against the way that the motor came, it goes its slack s
further than the path. At a speed F and an acceleration a, from the corner's own speed v, that costs s/F where the motor
reaches F no sooner than at the end of its slack; where it does, it may go faster than F meanwhile and brake again.
Where the path stays within the tolerance of the turn for long enough the slack costs nothing here. The files, faults
and printers are those of bench_klippy.py, whose planner has the same a and v; of each the turns and the share of its
time as printmend reads it, acceleration left out.

*straight s* is what the same crossings cost where each is one straight command along its axis, between the two lines
that it parts: Klipper brakes for both of its corners by their angles (its docs/Kinematics.md, "junction deviation").

*moves* is moves after ÷ before for whoever stays within the tolerance: each line of the file needs as many straight
commands as straight strips of that half width cover the exact command, whatever joins them, and at least two where
slack is crossed between two lines along which the belt moves: one command that crosses it, too, would leave the strip
(along the motor's own axis it does not). The frame is left out.
"""

from typing import NamedTuple

import numpy as np

from bench_corpus import around
from klippy_cases import arguments, cases, drawn, text_of
from printmend.errors import PrintmendError
from printmend.gcode.read import Moves, read_gcode, straightened
from printmend.machine import Mechanism, Transmission
from printmend.printer import read_printer

ACCELERATION_MM_S2, CORNER_MM_S, TOLERANCE_MM = 3000.0, 5.0, 0.01
_LEAST_SLACK_MM = 0.005
_LOOK_MM = 0.025  # how densely the exact command is looked at: an eighth of the finest ripple of a motor
_BEGINNINGS = 21  # of a strip's middle, across its width
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


def corner_mm_s(before_mm: np.ndarray, after_mm: np.ndarray) -> float:
    """Return how fast Klipper passes from one straight command to the next."""
    long = np.hypot(*before_mm), np.hypot(*after_mm)
    cosine = float(-(before_mm @ after_mm) / (long[0] * long[1]))
    if cosine > 1 - 1e-6:
        return 0.0
    half = np.sqrt((1 - max(cosine, 1e-6 - 1)) / 2)
    bend = half / np.sqrt(1 - half**2) / 2
    deviation2 = CORNER_MM_S**2 * (np.sqrt(2) - 1) * half / (1 - half)
    return float(np.sqrt(min(deviation2, bend * ACCELERATION_MM_S2 * min(long))))


def taken_s(ways_mm: list[np.ndarray], speeds_mm_s: list[float], begin_mm_s: float) -> float:
    """Return how long Klipper takes for straight commands in a row, at the end as fast as they allow."""
    twice, long = 2 * ACCELERATION_MM_S2, [float(np.hypot(*way)) for way in ways_mm]
    pairs = zip(ways_mm, ways_mm[1:], speeds_mm_s, speeds_mm_s[1:], strict=False)
    v = [begin_mm_s, *(min(corner_mm_s(*pair[:2]), *pair[2:]) for pair in pairs), speeds_mm_s[-1]]
    for i in range(len(long)):
        v[i + 1] = min(v[i + 1], np.sqrt(v[i] ** 2 + twice * long[i]))
    for i in reversed(range(len(long))):
        v[i] = min(v[i], np.sqrt(v[i + 1] ** 2 + twice * long[i]))
    spent = 0.0
    for way, most, begin, end in zip(long, speeds_mm_s, v, v[1:], strict=False):
        peak = min(np.sqrt((begin**2 + end**2 + twice * way) / 2), most)
        cruised = way - (2 * peak**2 - begin**2 - end**2) / twice
        spent += (2 * peak - begin - end) / ACCELERATION_MM_S2 + max(cruised, 0.0) / peak
    return spent


def straight_s(before_mm: np.ndarray | None, slack_mm: np.ndarray, after_mm: np.ndarray, speed_mm_s: float) -> float:
    """Return how much longer a line takes before which a straight command crosses the slack, at any speed.

    ``before_mm`` is the command before that, None where the nozzle stood.
    """
    if before_mm is None:
        return taken_s([slack_mm, after_mm], [np.inf, speed_mm_s], 0.0) - taken_s([after_mm], [speed_mm_s], 0.0)
    ways, speeds = [before_mm, after_mm], [speed_mm_s, speed_mm_s]
    crossed = taken_s([before_mm, slack_mm, after_mm], [speed_mm_s, np.inf, speed_mm_s], speed_mm_s)
    return crossed - taken_s(ways, speeds, speed_mm_s)


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


def _arrived(moves: Moves, first: int) -> np.ndarray | None:
    """Return the travel that leads straight to a line that prints; None where the nozzle stands before that."""
    way = moves.end_mm[first - 1] - moves.start_mm[first - 1] if first else np.zeros(3)
    return way[:2] if np.hypot(*way[:2]) > 0 and moves.line[first] == moves.line[first - 1] + 1 else None


class Crossing(NamedTuple):
    """A crossing of slack before a line of the file, ``amid`` a path or at its beginning, ``alone`` where it needs a
    command of its own: what it costs at the least, and as one straight command [s]."""

    line: int
    amid: bool
    alone: bool
    least_s: float
    straight_s: float


def crossings(moves: Moves, machine: Mechanism) -> list[Crossing]:
    """Return the crossings of a cartesian machine."""
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
                        way, here = np.zeros(2), min(at, len(speed) - 1)
                        way[k] = np.copysign(slack, u[i] - u[at])
                        before = places[at] - places[at - 1] if at else _arrived(moves, int(run[0]))
                        straight = straight_s(before, way, places[here + 1] - places[here], speed[here])
                        line, alone = int(moves.line[run[here]]), at > 0 and _alone(places, at, k, slack)
                        found.append(Crossing(line, at > 0, alone, least_s(slack, speed[here]), straight))
                    trend, at = np.sign(u[i] - u[at]), i
            came[k] = trend
        travelled = run[-1] + 1
    return found


def _alone(places_mm: np.ndarray, at: int, k: int, slack_mm: float) -> bool:
    """Return whether no command of a line to or from node ``at`` can cross the slack of motor k as well."""
    before, after = np.abs(places_mm[at] - places_mm[at - 1]), np.abs(places_mm[at + 1] - places_mm[at])
    aside = slack_mm / (slack_mm + after[k]) * after[0] * after[1] / np.hypot(*after)
    return bool(min(aside, before[k]) > 2 * TOLERANCE_MM)


def standing(text: bytes, found: list[Crossing]) -> bytes:
    """Return a file whose nozzle stands for as long as each crossing amid a path takes at the least."""
    spent_s: dict[int, float] = {}
    for each in found:
        if each.amid:
            spent_s[each.line] = max(spent_s.get(each.line, 0.0), each.least_s)
    lines = text.splitlines(keepends=True)
    for line, s in spent_s.items():
        lines[line] = f"G4 P{1000 * s:.3f}\n".encode() + lines[line]
    return b"".join(lines)


def least_moves_times(moves: Moves, machine: Mechanism, found: list[Crossing]) -> float:
    """Return moves after ÷ before at the least, of a cartesian machine; see the head of this file."""
    alone = {each.line for each in found if each.alone}
    way = (moves.end_mm - moves.start_mm)[:, :2]
    drawn = np.flatnonzero(moves.extruding & moves.known[:, :2].all(axis=1) & (np.hypot(*way.T) > 0))
    needed = len(way) - len(drawn)
    for row in drawn:
        long = np.hypot(*way[row])
        s = np.linspace(0.0, long, 2 + int(long / _LOOK_MM))
        off = []
        for k, drive in enumerate(machine.transmissions):
            u = moves.start_mm[row, k] + way[row, k] * s / long
            off.append(np.interp(u, drive.lower_mm if way[row, k] > 0 else drive.upper_mm, drive.motor_mm) - u)
        strip = strips(s, (way[row, 0] * off[1] - way[row, 1] * off[0]) / long)
        needed += max(strip, 1 + (moves.line[row] in alone))
    return needed / len(way)


def strips(s_mm: np.ndarray, off_mm: np.ndarray) -> int:
    """Return how many straight strips of half width `TOLERANCE_MM` cover a curve at the least."""
    if np.ptp(off_mm) <= 2 * TOLERANCE_MM:
        return 1
    count, i = 0, 0
    most = TOLERANCE_MM * (1 + 1 / (_BEGINNINGS - 1))  # as the middle may lie between two beginnings
    while i < len(s_mm):
        begin = off_mm[i] + np.linspace(-TOLERANCE_MM, TOLERANCE_MM, _BEGINNINGS)
        low, high = np.full(_BEGINNINGS, -np.inf), np.full(_BEGINNINGS, np.inf)
        j = i + 1
        while j < len(s_mm):
            way = s_mm[j] - s_mm[i]
            low = np.maximum(low, (off_mm[j] - most - begin) / way)
            high = np.minimum(high, (off_mm[j] + most - begin) / way)
            if (low > high).all():
                break
            j += 1
        count, i = count + 1, j
    return count


def main() -> None:
    options = arguments(__doc__).parse_args()
    print("  turns  least s  straight s  moves  file")
    for source, family in cases(options):
        printer = read_printer(options.preset)
        try:
            text = text_of(source, printer, options)
            read = read_gcode(text, printer=printer).moves
            moves = straightened(read, TOLERANCE_MM)
        except PrintmendError as error:
            print(f"  {type(error).__name__}: {str(error)[:100]}  {source.name}")
            continue
        machine = drawn(family, options).lower(around(printer, moves))
        found = crossings(moves, machine)  # type: ignore[arg-type] — gain tables are no family here
        times = least_moves_times(read, machine, found)  # type: ignore[arg-type]
        least, straight = (sum(getattr(each, name) for each in found) for name in ("least_s", "straight_s"))
        print(f"{len(found):7} {least:8.2f} {straight:11.2f} {times:6.2f}  {source.name} ({family})", flush=True)


if __name__ == "__main__":
    main()
