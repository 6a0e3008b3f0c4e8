"""A second simulator that shares no code with printmend: hull points, a plain G-code walker, numpy only.

It stands in for a real broken printer when the commands are judged from outside (bench_outside.py). Its conventions
differ from the twin's on purpose: pulleys are hulls of points, a belt is walked tooth-fine along every move, a freshly
homed belt may sit anywhere in its play, and the pulley may turn either way.
"""

import itertools
import math
import re
from dataclasses import dataclass

import numpy as np

MICROSTEP_MM = 0.0125
_WORD = re.compile(r"([A-Za-z])\s*([-+]?\d*\.?\d+)")


@dataclass
class Pulley:
    """A hull of points about the shaft; ``turn`` is the sense of rotation."""

    points_mm: np.ndarray
    phase_rad: float
    turn: int

    def tables(self, reach_mm: tuple[float, float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return motor positions and the unwound belt of both spans."""
        motor = np.arange(reach_mm[0], reach_mm[1], MICROSTEP_MM)
        angle = motor * (2 * math.pi / 40.0) * self.turn + self.phase_rad
        spans = []
        for side in (0.0, math.pi):
            phi = np.mod(side - angle, 2 * math.pi)
            grid = np.linspace(0, 2 * math.pi, 7201)
            corners = np.stack([np.cos(grid), np.sin(grid)])
            h = np.interp(phi, grid, np.max(self.points_mm @ corners, axis=0))
            unwound = np.concatenate([[0.0], np.cumsum((h[1:] + h[:-1]) / 2)]) * MICROSTEP_MM * 2 * math.pi / 40.0
            spans.append(unwound - np.interp(0.0, motor, unwound))
        return motor, spans[0], spans[1]


@dataclass
class Drive:
    """Branches of one axis: pushed forwards u ≥ lower, backwards u ≤ upper."""

    motor_mm: np.ndarray
    lower_mm: np.ndarray
    upper_mm: np.ndarray

    def walk(self, u: float, from_mm: float, to_mm: float, pitch_mm: float) -> tuple[np.ndarray, np.ndarray]:
        """Move the motor from one place to another; return the motor's and the belt's positions on the way."""
        count = max(1, math.ceil(abs(to_mm - from_mm) / pitch_mm))
        motor = np.linspace(from_mm, to_mm, count + 1)[1:]
        index = np.clip(np.rint((motor - self.motor_mm[0]) / MICROSTEP_MM).astype(int), 0, len(self.motor_mm) - 1)
        lower, upper = self.lower_mm[index], self.upper_mm[index]
        belt = (
            np.maximum(u, np.maximum.accumulate(lower))
            if to_mm > from_mm
            else np.minimum(u, np.minimum.accumulate(upper))
        )
        return motor, belt


def healthy_circle(radius_mm: float = 40 / (2 * math.pi)) -> np.ndarray:
    t = np.linspace(0, 2 * math.pi, 3600, endpoint=False)
    return radius_mm * np.stack([np.cos(t), np.sin(t)], axis=1)


def random_hull(rng: np.random.Generator) -> tuple[str, np.ndarray]:
    """Draw a damaged pulley as points: off its centre, squashed, cornered, with a flat, or lumpy."""
    kind = str(rng.choice(["eccentric", "ellipse", "polygon", "flat", "lumpy", "wrong size"]))
    circle = healthy_circle()
    if kind == "eccentric":
        return kind, circle + rng.uniform(0.3, 1.5) * _direction(rng)
    if kind == "ellipse":
        c = rng.uniform(0.3, 1.8)
        return kind, circle * (1 + np.array([c, -c]) / 6.366)
    if kind == "polygon":
        n = int(rng.integers(3, 9))
        t = 2 * math.pi * (np.arange(n) + rng.uniform(-0.15, 0.15, n)) / n
        return kind, (6.366 * rng.uniform(0.95, 1.2, n) * np.array([np.cos(t), np.sin(t)])).T
    if kind == "flat":
        return kind, circle[circle @ _direction(rng) < 6.366 - rng.uniform(0.3, 2.0)]
    if kind == "lumpy":
        t = np.linspace(0, 2 * math.pi, 3600, endpoint=False)
        r = 6.366 * rng.uniform(0.85, 1.15) + sum(
            rng.uniform(0.1, 0.5) / k * np.cos(k * t + rng.uniform(0, 6.28)) for k in range(2, 6)
        )
        return kind, (r * np.array([np.cos(t), np.sin(t)])).T + rng.uniform(0, 0.8) * _direction(rng)
    return kind, healthy_circle(6.366 * rng.uniform(0.8, 1.25))


def _direction(rng: np.random.Generator) -> np.ndarray:
    t = rng.uniform(0, 2 * math.pi)
    return np.array([math.cos(t), math.sin(t)])


def random_drive(
    rng: np.random.Generator, family: str, home_mm: float, home_direction: int, bed_mm: float
) -> tuple[str, Drive]:
    """Draw one axis: family is healthy, frame, friction, or of pulley, play, loose, set-screw, elastic, joined by +."""
    name, points = ("round", healthy_circle()) if "pulley" not in family else random_hull(rng)
    pulley = Pulley(points, rng.uniform(0, 2 * math.pi), int(rng.choice([-1, 1])))
    motor, span1, span2 = pulley.tables((-bed_mm, 2 * bed_mm))
    lower = upper = span1
    belt_mm = bed_mm + 80.0
    to_carriage_mm = np.clip(motor + 40.0, 0.0, belt_mm)
    if "elastic" in family:  # taut: the even part of both spans, and of the odd part what the nearer span takes
        share = (belt_mm - 2 * to_carriage_mm) / belt_mm
        odd = np.diff(span1 - span2, prepend=(span1 - span2)[0]) / 2
        stretched = (span1 + span2) / 2 + np.cumsum(share * odd)
        lower = upper = np.maximum.accumulate(stretched - np.interp(0.0, motor, stretched))
    if "friction" in family:  # lost motion that grows towards the middle of the belt
        lost = rng.uniform(0.05, 0.3) * 4 * to_carriage_mm * (belt_mm - to_carriage_mm) / belt_mm**2
        lower, upper, name = lower - lost / 2, upper + lost / 2, f"{name}, friction {lost.max():.2f}"
    if "set-screw" in family:  # slack on the shaft, before the pulley's map
        slack = rng.uniform(0.2, 1.5)
        lower, upper = np.interp(motor - slack / 2, motor, span1), np.interp(motor + slack / 2, motor, span1)
        name = f"{name}, set screw {slack:.2f}"
    if "play" in family:
        play = rng.uniform(0.2, 2.0)
        lower, upper, name = span1 - play / 2, span1 + play / 2, f"{name}, play {play:.2f}"
    if "loose" in family:
        play = rng.uniform(0.2, 2.0)
        slack = max(0.0, float((span1 - span2).max())) + play
        share = rng.uniform(0.2, 0.8)
        lower, upper, name = span1 - share * slack, span2 + (1 - share) * slack, f"{name}, loose {play:.2f}"
    # The end stop defines the carriage's place; the belt sits engaged, or anywhere in its play.
    at = round((home_mm - motor[0]) / MICROSTEP_MM)
    inside = 0.0 if rng.random() < 0.5 else rng.uniform(0, 1)
    engaged, other = (lower, upper) if home_direction > 0 else (upper, lower)
    shift = home_mm - ((1 - inside) * engaged[at] + inside * other[at])
    return name, Drive(motor, lower + shift, upper + shift)


def homed_again(drive: Drive, by_mm: float, home_mm: float) -> Drive:
    """Return a drive whose motor is ``by_mm`` further on than before once it has homed: the same wheel, at another
    angle. The end stop puts the carriage where it was."""
    lower, upper = (np.roll(table, -round(by_mm / MICROSTEP_MM)) for table in (drive.lower_mm, drive.upper_mm))
    at = round((home_mm - drive.motor_mm[0]) / MICROSTEP_MM)
    back = (drive.lower_mm[at] + drive.upper_mm[at] - lower[at] - upper[at]) / 2
    return Drive(drive.motor_mm, lower + back, upper + back)


def random_frame(rng: np.random.Generator, home_mm: tuple[float, float]) -> tuple[str, np.ndarray, np.ndarray]:
    """Draw skew and scale: the printed place is matrix·(x, y) + shift; the home position stays."""
    skew_deg, scale = rng.uniform(-3, 3), 1 + rng.uniform(-0.02, 0.02, 2)
    matrix = np.array([[scale[0], math.tan(math.radians(skew_deg))], [0.0, scale[1]]])
    home = np.array(home_mm)
    return f"skew {skew_deg:.2f}°, scale {scale[0]:.4f} {scale[1]:.4f}", matrix, home - matrix @ home


@dataclass
class Move:
    """One straight move: commanded ends, layer height, filament."""

    start_mm: tuple[float, float]
    end_mm: tuple[float, float]
    z_mm: float
    extruding: bool
    filament_mm: float = 0.0


def read_moves(text: str, home_mm: tuple[float, float]) -> list[Move]:
    """Walk plain G-code: G0 to G3, G28, G90 to G92, M82, M83."""
    x, y, z, e = *home_mm, 0.0, 0.0
    relative = relative_e = False
    moves: list[Move] = []
    for line in text.splitlines():
        words = _WORD.findall(line.split(";")[0].split("*")[0])
        if not words:
            continue
        if words[0][0].upper() == "N":
            words = words[1:]
        code = words[0][0].upper() + str(int(float(words[0][1])))
        value = {letter.upper(): float(number) for letter, number in words[1:]}
        if code in ("G0", "G1", "G2", "G3"):
            to = [
                value.get(axis, 0.0) + now if relative else value.get(axis, now)
                for axis, now in zip("XYZ", (x, y, z), strict=True)
            ]
            filament = value.get("E", 0.0 if relative_e or relative else e) - (0.0 if relative_e or relative else e)
            e += filament
            points = (
                [(x, y), (to[0], to[1])] if code in ("G0", "G1") else _arc((x, y), (to[0], to[1]), value, code == "G2")
            )
            for start, end in itertools.pairwise(points):
                moves.append(Move(start, end, to[2], filament > 0, filament / (len(points) - 1)))
            x, y, z = to
        elif code == "G28":
            named = [axis for axis in "XYZ" if axis in line.split(";")[0].upper()] or list("XYZ")
            before = (x, y)
            x = home_mm[0] if "X" in named else x
            y = home_mm[1] if "Y" in named else y
            z = 0.0 if "Z" in named else z
            moves.append(Move(before, (x, y), -1.0, False))
        elif code in ("G90", "G91"):
            relative = code == "G91"
        elif code in ("M82", "M83"):
            relative_e = code == "M83"
        elif code == "G92" and "E" in value:
            e = value["E"]
    return moves


def _arc(
    start: tuple[float, float], end: tuple[float, float], value: dict[str, float], clockwise: bool
) -> list[tuple[float, float]]:
    cx, cy = start[0] + value.get("I", 0.0), start[1] + value.get("J", 0.0)
    a0, a1 = math.atan2(start[1] - cy, start[0] - cx), math.atan2(end[1] - cy, end[0] - cx)
    sweep = (a1 - a0) % (2 * math.pi) or 2 * math.pi
    sweep = sweep - 2 * math.pi if clockwise else sweep
    if clockwise and sweep == 0.0:
        sweep = -2 * math.pi
    radius = math.hypot(start[0] - cx, start[1] - cy)
    count = max(4, math.ceil(abs(sweep) * radius / 0.1))
    return [
        (cx + radius * math.cos(a0 + sweep * i / count), cy + radius * math.sin(a0 + sweep * i / count))
        for i in range(count)
    ] + [end]


def print_moves(
    moves: list[Move],
    drives: tuple[Drive, Drive],
    home_mm: tuple[float, float],
    *,
    corexy: bool = False,
    pitch_mm: float = 0.1,
) -> list[np.ndarray]:
    """Print the moves; return for each the printed positions [n, 2], its end last."""

    def motors(point: tuple[float, float]) -> tuple[float, float]:
        return (point[0] + point[1], point[0] - point[1]) if corexy else point

    at = list(motors(home_mm))
    belts = list(motors(home_mm))
    printed = []
    for move in moves:
        if move.z_mm == -1.0:  # homing: the end stops put everything back
            fresh = motors(home_mm)
            for axis in range(2):
                if corexy or move.end_mm[axis] == home_mm[axis]:
                    at[axis], belts[axis] = fresh[axis], fresh[axis]
            printed.append(np.array([_bed(belts, corexy)]))
            continue
        to = motors(move.end_mm)
        length = max(abs(to[0] - at[0]), abs(to[1] - at[1]))
        count = max(1, math.ceil(length / pitch_mm))
        ways = []
        for axis in range(2):
            pitch = abs(to[axis] - at[axis]) / count
            if pitch == 0.0:
                ways.append(np.full(count, belts[axis]))
            else:
                ways.append(drives[axis].walk(belts[axis], at[axis], to[axis], pitch * (1 + 1e-9))[1][-count:])
            at[axis], belts[axis] = to[axis], float(ways[axis][-1])
        way = np.stack(ways, axis=1)
        printed.append(np.stack([(way[:, 0] + way[:, 1]) / 2, (way[:, 0] - way[:, 1]) / 2], axis=1) if corexy else way)
    return printed


def _bed(belts: list[float], corexy: bool) -> tuple[float, float]:
    return ((belts[0] + belts[1]) / 2, (belts[0] - belts[1]) / 2) if corexy else (belts[0], belts[1])
