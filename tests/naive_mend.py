"""Slow, obvious versions of what mending relies on: a G-code machine, a printer with play, a distance.

They share no code with the program: words by a regular expression, one move after the other, belts by clipping.
"""

import copy
import itertools
import math
import re
from dataclasses import dataclass, field

import numpy as np

from printmend.machine import Mechanism, ScrewDrive

_WORD = re.compile(r"([A-Za-z])\s*([-+]?\d*\.?\d+)")


@dataclass
class Move:
    """A straight move of the machine, in mm: ``start`` and ``end`` (x, y, z), filament, F [mm/min], line number."""

    start: tuple[float, float, float]
    end: tuple[float, float, float]
    filament: float
    feed: float
    line: int
    homing: tuple[int, ...] = ()  # the axes

    @property
    def length(self) -> float:
        return math.dist(self.start, self.end)

    @property
    def draws(self) -> bool:
        return self.filament > 0 and self.start[:2] != self.end[:2]


@dataclass
class Machine:
    """A machine that reads G-code word by word. Klipper's rule for E: relative after M83 or G91."""

    home: tuple[float, float, float]
    position: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    shift: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    e: float = 0.0
    feed: float = 0.0
    relative: bool = False
    m83: bool = False
    unit: float = 1.0
    motion: str = "G0"
    offset: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    saved: dict[str, dict] = field(default_factory=dict)
    moves: list[Move] = field(default_factory=list)

    def read(self, text: str) -> list[Move]:
        for number, line in enumerate(text.splitlines()):
            plain = re.sub(r"\(.*?\)", "", line.split(";")[0].split("*")[0]).strip()
            if re.match(r"(SAVE|RESTORE|SET)_GCODE_", plain):
                self.klipper(plain.split()[0], dict(re.findall(r"(\w+)=(\S+)", plain)), number)
                continue
            if re.match(r"[A-Za-z_]{2}", plain) or plain.upper().startswith("M117"):
                continue  # a macro, or text
            words = [(letter.upper(), float(value)) for letter, value in _WORD.findall(plain)]
            bare = {letter.upper() for letter in re.findall(r"[A-Za-z]", plain)}
            if words and words[0][0] == "N":
                words = words[1:]
            self.statement_words(words, bare, number)
        return self.moves

    def statement_words(self, words: list[tuple[str, float]], bare: set[str], line: int) -> None:
        """Cut a line into commands: each G or M begins one; modes act at once, words go with the last motion."""
        groups: list[tuple[str, dict[str, float]]] = []
        for letter, value in words:
            if letter in "GM" or (letter == "T" and not groups):
                groups.append((f"{letter}{value:g}", {}))
            elif groups:
                groups[-1][1][letter] = value
            else:
                groups.append((self.motion, {letter: value}))
        for code, values in groups:
            self.command(code, values, bare, line)

    def klipper(self, name: str, values: dict[str, str], line: int) -> None:
        start, place = tuple(self.position), list(self.position)
        keep = ("position", "shift", "offset", "e", "feed", "relative", "m83")
        if name == "SET_GCODE_OFFSET":
            for a in range(3):
                more = float(values.get("XYZ"[a], self.offset[a])) + float(values.get(f"{'XYZ'[a]}_ADJUST", 0.0))
                self.shift[a] += more - self.offset[a]
                place[a] += more - self.offset[a]
                self.offset[a] = more
        elif name == "SAVE_GCODE_STATE":
            self.saved[values.get("NAME", "")] = {k: copy.copy(getattr(self, k)) for k in keep}
        else:
            for key, value in self.saved[values.get("NAME", "")].items():
                place = value if key == "position" else place
                if key != "position":
                    setattr(self, key, copy.copy(value))
        if values.get("MOVE") == "1":
            self.position = list(place)
            self.moves.append(Move(start, tuple(self.position), 0.0, self.feed, line))

    def command(self, code: str, values: dict[str, float], bare: set[str], line: int) -> None:
        if code in ("G0", "G1", "G2", "G3"):
            self.motion = code
            if values:
                self.move(code, values, line)
        elif code == "G5":
            self.curve(values, line)
        elif code in ("G90", "G91"):
            self.relative = code == "G91"
            if values:
                self.move(self.motion, values, line)
        elif code in ("M82", "M83"):
            self.m83 = code == "M83"
        elif code in ("G20", "G21"):
            self.unit = 25.4 if code == "G20" else 1.0
        elif code == "G28":
            axes = [a for a in range(3) if "XYZ"[a] in bare] or [0, 1, 2]
            start = tuple(self.position)
            for a in axes:
                self.position[a], self.shift[a] = self.home[a], self.offset[a]
            self.moves.append(Move(start, tuple(self.position), 0.0, self.feed, line, homing=tuple(axes)))
        elif code == "G92":
            for a in range(3) if code == "G92" else ():
                if "XYZ"[a] in values:
                    self.shift[a] = self.position[a] - values["XYZ"[a]] * self.unit
            if "E" in values:
                self.e = values["E"] * self.unit

    def curve(self, values: dict[str, float], line: int) -> None:
        """Marlin's cubic curve in 120 straight moves, by de Casteljau."""
        start = np.array(self.position)
        self.move("G1", values, line)
        whole, end = self.moves.pop(), np.array(self.position)
        i, j, p, q = (values.get(letter, 0.0) * self.unit for letter in "IJPQ")
        third = (end - start) / 3
        points = [start, start + np.array([i, j, third[2]]), end + np.array([p, q, -third[2]]), end]
        before = tuple(start)
        for t in np.arange(1, 121) / 120:
            row = points
            while len(row) > 1:
                row = [a + t * (b - a) for a, b in itertools.pairwise(row)]
            after = tuple(float(v) for v in row[0])
            self.moves.append(Move(before, after, whole.filament / 120, self.feed, line))
            before = after

    def move(self, code: str, values: dict[str, float], line: int) -> None:
        start = tuple(self.position)
        for a in range(3):
            if "XYZ"[a] in values:
                value = values["XYZ"[a]] * self.unit
                self.position[a] = self.position[a] + value if self.relative else value + self.shift[a]
        self.feed = values["F"] * self.unit if "F" in values else self.feed
        filament = 0.0
        if "E" in values:
            e = values["E"] * self.unit
            filament = e if self.relative or self.m83 else e - self.e
            self.e = self.e + e if self.relative or self.m83 else e
        end = tuple(self.position)
        points = [start, end] if code in ("G0", "G1") else self.arc(start, end, values, code == "G2")
        total = sum(math.dist(a, b) for a, b in itertools.pairwise(points)) or 1.0
        for a, b in itertools.pairwise(points):
            share = math.dist(a, b) / total if len(points) > 2 else 1.0
            self.moves.append(Move(a, b, filament * share, self.feed, line))

    def arc(self, start: tuple, end: tuple, values: dict[str, float], clockwise: bool) -> list[tuple]:
        x0, y0, z0 = start
        x1, y1, z1 = end
        if "R" in values:
            radius, d = values["R"] * self.unit, math.dist((x0, y0), (x1, y1))
            h = math.sqrt(max(radius**2 - d**2 / 4, 0.0)) * (1 if (radius > 0) != clockwise else -1)
            cx, cy = (x0 + x1) / 2 - h * (y1 - y0) / d, (y0 + y1) / 2 + h * (x1 - x0) / d
        else:
            cx, cy = x0 + values.get("I", 0.0) * self.unit, y0 + values.get("J", 0.0) * self.unit
        a0, a1 = math.atan2(y0 - cy, x0 - cx), math.atan2(y1 - cy, x1 - cx)
        sweep = (a0 - a1 if clockwise else a1 - a0) % (2 * math.pi)
        if math.dist((x0, y0), (x1, y1)) < 1e-6:
            sweep = 2 * math.pi
        r0, r1 = math.dist((x0, y0), (cx, cy)), math.dist((x1, y1), (cx, cy))
        steps = max(8, math.ceil(sweep * r0 / 0.4))
        points = []
        for i in range(steps + 1):
            s = i / steps
            phi = a0 + (-sweep if clockwise else sweep) * s
            r = r0 + (r1 - r0) * s
            points.append((cx + r * math.cos(phi), cy + r * math.sin(phi), z0 + (z1 - z0) * s))
        points[-1] = end
        return points


def read_moves(text: str | bytes, home: tuple[float, float, float]) -> list[Move]:
    """Return the moves of a G-code text on a machine that stands at its home position."""
    if isinstance(text, bytes):
        text = text.decode("utf-8", "replace").lstrip("\ufeff")
    machine = Machine(home)
    machine.position = list(home)
    return machine.read(text)


def print_moves(moves: list[Move], mechanism: Mechanism, *, pitch_mm: float = 0.3) -> list[np.ndarray]:
    """Print moves one after the other; return the places [n, 2] on the way of each, its end last.

    The mechanism's origin is taken as it is. At the start and after homing the belts rest on the side that homing
    left them on, or, where that is not at the home position, as near to it as their play lets them.
    """
    printer = mechanism.printer
    home = np.array(printer.home_mm, float)
    start = np.array(moves[0].start[:2]) if moves else home
    motors = np.asarray(printer.to_motor(start), float)
    belts = _rested(mechanism, motors, np.asarray(printer.to_motor(mechanism.frame.invert(start)), float))
    printed = []
    for move in moves:
        if move.homing:
            motors = np.asarray(printer.to_motor(np.array(move.end[:2])), float)
            at_home = _rested(
                mechanism, motors, np.asarray(printer.to_motor(mechanism.frame.invert(np.array(move.end[:2]))), float)
            )
            for motor in range(2):
                if printer.kinematics == "corexy" or motor in move.homing:
                    belts[motor] = at_home[motor]
            printed.append(np.array([move.end[:2]]))
            continue
        to = np.asarray(printer.to_motor(np.array(move.end[:2])), float)
        count = max(2, math.ceil(np.abs(to - motors).max() / pitch_mm))  # a chord strays most in its middle
        places = motors + (np.arange(1, count + 1) / count)[:, None] * (to - motors)
        way = np.empty((count, 2))
        for motor, transmission in enumerate(mechanism.transmissions):
            lower, upper = transmission.branches_mm(places[:, motor])
            belt = float(belts[motor])
            for i, (low, high) in enumerate(zip(lower.tolist(), upper.tolist(), strict=True)):
                belt = min(max(belt, low), high)
                way[i, motor] = belt
            belts[motor] = belt
        motors = to
        printed.append(mechanism.frame.apply(printer.from_motor(way)))
        if mechanism.screw is not None:
            z = move.start[2] + np.arange(1, count + 1) / count * (move.end[2] - move.start[2])
            grid = mechanism.screw.transmission.motor_mm
            for axis in range(2):
                printed[-1][:, axis] += np.interp(z, grid, mechanism.screw.wobble_mm[:, axis])
    return printed


def lift_moves(moves: list[Move], mechanism: Mechanism) -> list[float]:
    """Return how high the nozzle is after each move: the nut follows its screw by clipping, homing puts it to rest."""
    screw, z = mechanism.screw, mechanism.printer.z
    if screw is None:
        return [move.end[2] for move in moves]
    heights = []
    nut = _branch_mm(screw, z.home_mm, z.home_direction > 0)
    for move in moves:
        if 2 in move.homing:
            nut = _branch_mm(screw, move.end[2], z.home_direction > 0)
        elif not move.homing:
            nut = min(max(nut, _branch_mm(screw, move.end[2], True)), _branch_mm(screw, move.end[2], False))
        heights.append(nut)
    return heights


def _branch_mm(screw: ScrewDrive, z_mm: float, forwards: bool) -> float:
    lower, upper = screw.transmission.branches_mm(np.array(z_mm))
    return float(lower if forwards else upper)


def _rested(mechanism: Mechanism, motors: np.ndarray, belts: np.ndarray) -> np.ndarray:
    rested = belts.copy()
    for motor, transmission in enumerate(mechanism.transmissions):
        lower, upper = transmission.branches_mm(motors[motor])
        rested[motor] = min(max(belts[motor], float(lower)), float(upper))
    return rested


def contour_errors_mm(
    wanted: list[Move], given: list[Move], printed: list[np.ndarray], heights: list[float] | None = None
) -> np.ndarray:
    """Return the distance of every printed place of a drawing move to the nearest wanted line at its height.

    ``heights`` are those after each given move, by default the commanded ones.
    """
    errors, at_height = [np.empty(0)], {}
    for number, (move, way) in enumerate(zip(given, printed, strict=True)):
        if not move.draws:
            continue
        height = move.end[2] if heights is None else heights[number]
        if height not in at_height:
            at_height[height] = np.array(
                [
                    (w.start[:2], w.end[:2])
                    for w in wanted
                    if w.draws and min(w.start[2], w.end[2]) - 0.06 <= height <= max(w.start[2], w.end[2]) + 0.06
                ]
            )
        a, d = at_height[height][:, 0], np.diff(at_height[height], axis=1)[:, 0]
        off = way[:, None] - a
        t = np.clip((off * d).sum(2) / (d * d).sum(1), 0, 1)
        errors.append(np.sqrt(((off - t[:, :, None] * d) ** 2).sum(2)).min(1))
    return np.concatenate(errors)


def rms(errors: np.ndarray) -> float:
    return float(np.sqrt(np.mean(errors**2)))
