"""Slow, obvious planners: how long a printer takes for moves, by what firmwares publish of their look-ahead.

Klipper: its document "Kinematics" (look-ahead, smoothed look-ahead, square corner velocity). Marlin: its
documentation and Jeon's "Improving Grbl: cornering algorithm" (2011); the queue of 16 blocks is played move by move,
each new block planned backwards and forwards, as the firmware does. RepRapFirmware: its documentation of M566.
"""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from printmend.clock import Limits

REST_MM_S = 0.05


@dataclass
class Move:
    """A straight move: how far each axis goes [mm], and how fast the file wants it [mm/s]."""

    way_mm: tuple[float, float, float, float]
    feed_mm_s: float

    @property
    def head_mm(self) -> float:
        return math.hypot(*self.way_mm[:3])

    @property
    def length_mm(self) -> float:
        return self.head_mm if self.head_mm > 1e-9 else abs(self.way_mm[3])

    @property
    def unit(self) -> np.ndarray:
        way = np.array(self.way_mm)
        if self.head_mm <= 1e-9:
            way[:3] = 0.0
        return way / self.length_mm


def seconds(moves: list[Move], limits: Limits) -> float:
    """Return how long the moves take, from rest to rest."""
    moves = [move for move in moves if move.length_mm > 0]
    return _klipper_s(moves, limits) if limits.firmware == "klipper" else _blocks_s(moves, limits)


def trapezoid_s(length_mm: float, accel: float, begin: float, top: float, end: float) -> float:
    """Return how long a move takes that speeds up to ``top`` (or as far as it gets) and slows down, all [mm/s]."""
    top = min(top, math.sqrt((2 * accel * length_mm + begin**2 + end**2) / 2))
    top = max(top, begin, end)
    rest = length_mm - (top**2 - begin**2) / (2 * accel) - (top**2 - end**2) / (2 * accel)
    return (top - begin) / accel + (top - end) / accel + max(rest, 0.0) / top


def _klipper_limits(move: Move, limits: Limits) -> tuple[float, float]:
    x, y, z, e = np.abs(move.unit)
    speed, accel = min(move.feed_mm_s, limits.velocity_mm_s), limits.print_mm_s2
    if move.head_mm <= 1e-9:
        return min(speed, limits.speed_mm_s[3]), limits.accel_mm_s2[3]
    if z:
        speed, accel = min(speed, limits.speed_mm_s[2] / z), min(accel, limits.accel_mm_s2[2] / z)
    if e and (move.unit[3] < 0 or not (x or y)):
        speed, accel = min(speed, limits.speed_mm_s[3] / e), min(accel, limits.accel_mm_s2[3] / e)
    return speed, accel


def _klipper_s(moves: list[Move], limits: Limits) -> float:
    count = len(moves)
    speed, accel = np.array([_klipper_limits(move, limits) for move in moves]).reshape(-1, 2).T
    length = np.array([move.length_mm for move in moves])
    deviation = limits.corner_mm_s**2 * (math.sqrt(2) - 1) / limits.print_mm_s2
    corner = np.zeros(count + 1)
    for i in range(1, count):
        a, b = moves[i - 1], moves[i]
        if a.head_mm <= 1e-9 or b.head_mm <= 1e-9:
            continue
        corner[i] = min(speed[i - 1], speed[i])
        if (jump := abs(b.unit[3] - a.unit[3])) > 0:
            corner[i] = min(corner[i], 1.0 / jump)
        turn = math.acos(np.clip(a.unit[:3] @ b.unit[:3], -1, 1))
        inner = (math.pi - turn) / 2  # half the angle between both moves
        for j in (i - 1, i):
            if math.sin(inner) < 1:
                corner[i] = min(corner[i], math.sqrt(accel[j] * deviation * math.sin(inner) / (1 - math.sin(inner))))
            if math.cos(inner) > 1e-12:
                corner[i] = min(corner[i], math.sqrt(accel[j] * length[j] / 2 * math.tan(inner)))
    plans = []
    for braking in (accel, np.minimum(accel, limits.print_mm_s2 * (1 - limits.cruise_ratio))):
        reach, plan2 = 2 * braking * length, corner**2
        for i in range(count):
            plan2[i + 1] = min(plan2[i + 1], plan2[i] + reach[i])
        for i in range(count - 1, -1, -1):
            plan2[i] = min(plan2[i], plan2[i + 1] + reach[i])
        plans.append((reach, plan2))
    (reach, plan2), (soft_reach, soft2) = plans
    total, top2 = 0.0, math.inf
    falls = np.isclose(soft2[:-1], soft2[1:] + soft_reach, rtol=1e-12, atol=1e-12)
    for i in range(count):
        begin2, end2 = plan2[i], plan2[i + 1]
        if falls[i]:
            top2 = min(top2, begin2)
        else:
            j = i  # the move in which the soft plan is fastest before it falls
            while soft2[j] + soft_reach[j] <= soft2[j + 1] * (1 + 1e-12) and not (j + 1 < count and falls[j + 1]):
                j += 1
            hill2 = min(speed[j] ** 2, (soft2[j] + soft2[j + 1] + soft_reach[j]) / 2)
            top2 = min(hill2, speed[i] ** 2, (begin2 + end2 + reach[i]) / 2)
        begin, end, top = (math.sqrt(min(each, top2)) for each in (begin2, end2, top2))
        total += trapezoid_s(length[i], accel[i], begin, top, end)
        if not falls[i]:
            top2 = hill2
    return total


def _axes_limits(move: Move, limits: Limits) -> tuple[float, float]:
    accel = limits.print_mm_s2 if move.unit[3] else limits.travel_mm_s2
    if move.head_mm <= 1e-9:
        accel = limits.retract_mm_s2
    speed = move.feed_mm_s
    for share, fastest, most in zip(np.abs(move.unit), limits.speed_mm_s, limits.accel_mm_s2, strict=True):
        if share:
            speed, accel = min(speed, fastest / share), min(accel, most / share)
    return speed, accel


def _corner(last: "Block | None", move: Move, speed: float, accel: float, limits: Limits) -> float:
    """Return how fast a block may begin."""
    unit = move.unit

    def at_once(along: np.ndarray, most: float) -> float:
        return min([most, *(jump / abs(s) for jump, s in zip(limits.jump_mm_s, along, strict=True) if s)])

    if limits.firmware == "marlin":
        if last is None:
            return at_once(unit, speed)
        together = min(speed, last.speed)
        jumps = [abs(b - a) if a * b >= 0 else max(abs(a), abs(b)) for a, b in zip(last.move.unit, unit, strict=True)]
        most = at_once(np.array(jumps), together)
        safe, safe_before = at_once(unit, speed), at_once(last.move.unit, last.speed)
        return safe if min(safe, safe_before) > 0.99 * most else most
    if last is None:
        return REST_MM_S
    together = min(speed, last.speed)
    if limits.firmware == "rrf":
        alike = (last.move.unit[3] > 0) == (unit[3] > 0) and (last.move.head_mm > 1e-9) == (move.head_mm > 1e-9)
        return at_once(unit - last.move.unit, together) if alike else REST_MM_S
    turn = math.acos(np.clip(last.move.unit @ unit, -1, 1))
    sine = math.cos(turn / 2)
    if sine < 1:
        together = min(together, math.sqrt(accel * limits.deviation_mm * sine / (1 - sine)))
    if move.length_mm < 1 and 1e-12 < turn < math.pi / 4:
        together = min(together, math.sqrt(accel * move.length_mm / turn))
    return together


@dataclass
class Block:
    """A move in the firmware's queue: how fast it may go and begin at most, and how fast it will begin."""

    move: Move
    speed: float
    accel: float
    most_entry: float
    entry: float = 0.0


def _blocks_s(moves: list[Move], limits: Limits) -> float:
    size = 40 if limits.firmware == "rrf" else 16
    queue: list[Block] = []
    waiting = list(moves)
    last: Block | None = None
    total, running = 0.0, None
    while waiting or queue:
        while waiting and len(queue) < size:
            speed, accel = _axes_limits(waiting[0], limits)
            most = max(_corner(last, waiting[0], speed, accel, limits), REST_MM_S)
            last = Block(waiting.pop(0), speed, accel, most)
            queue.append(last)
        # backwards: from each block one must be able to brake to the next one's entry; forwards: to reach it
        entry = REST_MM_S
        for block in reversed(queue):
            entry = block.entry = min(block.most_entry, math.sqrt(entry**2 + 2 * block.accel * block.move.length_mm))
        if running is not None:
            queue[0].entry = running
        for block, following in pairwise(queue):
            reach = math.sqrt(block.entry**2 + 2 * block.accel * block.move.length_mm)
            following.entry = min(following.entry, reach)
        block = queue.pop(0)
        running = queue[0].entry if queue else REST_MM_S
        total += trapezoid_s(block.move.length_mm, block.accel, block.entry, block.speed, running)
    return total
