# SPDX-License-Identifier: GPL-3.0-or-later
"""A model's document as the planner's kernels read it: drives, frame, rails and Z screw as numbers and tables.

As `printmend.model` and `printmend.plan.inverse` make it, without numpy.
"""

import bisect
import itertools
import math

PITCH_MM = 0.05  # of the tables, and at least 24 places a wave
BEND_REACH_MM = 0.05  # curvature is measured over this distance
RISE_LOOK_MM = 0.05
TOLERANCE_MM = 0.01
TOOTH_MM, STEPS_A_TURN = 2.0, 4  # of the waves of which a shaper takes a share: a belt tooth, a motor's electrical turn
SEGMENTS_PER_S = 2000.0  # that Klipper surely plans


class Drive:
    """One motor: the belt's place on its two branches, over the motor's, evenly spaced."""

    def __init__(self, section, low_mm, high_mm):
        span = high_mm - low_mm
        self.curved = section["kind"] != "healthy"
        if section["kind"] == "table":
            grid, lower, upper = self._table(section)
        else:
            grid, lower, upper = self._series(section, low_mm - span, high_mm + span)
        middle = len(grid) // 2
        self.grid, self.lower, self.upper = grid, rising(lower, middle), rising(upper, middle)

    @staticmethod
    def _table(section):
        lower = section["lower_error_mm"]
        upper = section.get("upper_error_mm", lower)
        grid = [section["first_mm"] + section["pitch_mm"] * i for i in range(len(lower))]
        return grid, [m + e for m, e in zip(grid, lower)], [m + e for m, e in zip(grid, upper)]

    @staticmethod
    def _series(section, low_mm, high_mm):
        if section["kind"] == "healthy":
            return [low_mm, high_mm], [low_mm, high_mm], [low_mm, high_mm]
        turn, middle, reach = section["period_mm"], section["middle_mm"], section["reach_mm"]
        waves = {name: section.get(name) for name in ("mean", "play", "elastic")}
        highest = max([1] + [k for wave in waves.values() if wave for k in wave["harmonics"]])
        count = math.ceil(turn / min(PITCH_MM, turn / highest / 24))
        pitch, first = turn / count, math.floor(low_mm / turn) * count
        grid = [(first + i) * pitch for i in range(int((high_mm - low_mm) / pitch) + 2 * count)]
        rounds = {name: fourier(wave, count) for name, wave in waves.items()}
        warp, second = section.get("warp"), section.get("second")
        lower, upper = [], []
        for i, m in enumerate(grid):
            x = (m - middle) / 100.0
            mean = (
                powers(waves["mean"], x, reach, middle) + rounds["mean"][i % count] + x * rounds["elastic"][i % count]
            )
            if warp:
                seen = min(max(m, reach[0]), reach[1])
                place = min(max((seen - warp["first_mm"]) / (warp["last_mm"] - warp["first_mm"]), 0.0), 1.0)
                mean += sum(c * math.cos(math.pi * k * place) for k, c in enumerate(warp["cos_mm"], 1))
            if second:
                mean += series(second, 2.0 * math.pi * (m % second["period_mm"]) / second["period_mm"])
            play = max(powers(waves["play"], x, reach, middle) + rounds["play"][i % count], 0.0)
            lower.append(m + mean - play / 2)
            upper.append(m + mean + play / 2)
        return grid, lower, upper

    @property
    def pitch_mm(self):
        return (self.grid[-1] - self.grid[0]) / (len(self.grid) - 1)

    def at(self, table, m):
        """Return the belt's place on a branch."""
        grid = self.grid
        if m <= grid[0]:
            return table[0] + m - grid[0]
        if m >= grid[-1]:
            return table[-1] + m - grid[-1]
        i = min(int((m - grid[0]) / (grid[-1] - grid[0]) * (len(grid) - 1)), len(grid) - 2)
        return table[i] + (table[i + 1] - table[i]) * (m - grid[i]) / (grid[i + 1] - grid[i])

    def ripple_mm(self, lengths_mm):
        """Return the one of some wave lengths at which the belt's speed ripples most, 0 where it does at none."""
        off, steepest, found = [u - m for u, m in zip(self.lower, self.grid)], 1e-3, 0.0
        for length in lengths_mm if self.curved else ():
            rate = 2.0 * math.pi / length
            count = int(int((self.grid[-1] - self.grid[0]) / length) * length / self.pitch_mm)
            a = sum(u * math.cos(rate * m) for u, m in zip(off[:count], self.grid))
            b = sum(u * math.sin(rate * m) for u, m in zip(off[:count], self.grid))
            slope = 2.0 * math.hypot(a, b) / max(count, 1) * rate
            if slope > steepest:
                steepest, found = slope, length
        return found

    def bends(self, block):
        """Return the largest curvature of either branch [1/mm] in each block of entries."""
        pitch, size = self.pitch_mm, len(self.grid)
        reach = max(1, round(BEND_REACH_MM / pitch))
        most = [0.0] * -(-size // block)
        for table in (self.lower, self.upper):
            for i in range(reach, size - reach):
                bend = abs(table[i + reach] - 2.0 * table[i] + table[i - reach]) / (reach * pitch) ** 2
                if bend > most[i // block] and bend >= 1e-6:
                    most[i // block] = bend
        return [max(most[max(i - 1, 0) : i + 2]) for i in range(len(most))]


class Screw:
    """Z: the nozzle's height on the two flanks, and where the screw pushes it, over what is commanded."""

    def __init__(self, section, axis):
        step = axis["mm_per_turn"] / axis["steps_per_turn"]
        steps = math.ceil((axis["max_mm"] - axis["min_mm"]) / step) + 2 * axis["steps_per_turn"]
        first, pitch = axis["min_mm"] - axis["mm_per_turn"], step / axis["microsteps"]
        self.grid = grid = [first + pitch * i for i in range(steps * axis["microsteps"] + 1)]
        if section["kind"] == "table":
            lower = section["lower_error_mm"]
            upper = section.get("upper_error_mm", lower)
            self.lower, self.upper = [m + e for m, e in zip(grid, lower)], [m + e for m, e in zip(grid, upper)]
            self.pushes = [section["push_x_mm"], section["push_y_mm"]]
        else:
            self._series(section)
        self.lower, self.upper = (rising(table, 0) for table in (self.lower, self.upper))
        if section["kind"] != "table":
            self._home(axis)

    def _series(self, section):
        def wave(name, turn):
            c = section[name]
            return sum(c[2 * k] * math.sin((k + 1) * turn) + c[2 * k + 1] * math.cos((k + 1) * turn)
                       for k in range(len(c) // 2))  # fmt: skip

        turns = [2.0 * math.pi * m / section["lead_mm"] for m in self.grid]
        off = [section["lead_error"] * m + wave("height_mm", turn) for m, turn in zip(self.grid, turns)]
        half = section["backlash_mm"] / 2
        middle = list(itertools.accumulate((m + by for m, by in zip(self.grid, off)), max))
        self.lower, self.upper = [u - half for u in middle], [u + half for u in middle]
        self.pushes = [[wave(name, turn) for turn in turns] for name in ("push_x_mm", "push_y_mm")]

    def _home(self, axis):
        """Shift the flank that homing engages through the end stop, where the screw pushes nowhere."""
        home, up = axis["home_mm"], axis["home_side"] == "max"
        by = home - Drive.at(self, self.lower if up else self.upper, home)
        self.lower, self.upper = [u + by for u in self.lower], [u + by for u in self.upper]
        for push in self.pushes:
            at = Drive.at(self, push, home)
            push[:] = [value - at for value in push]

    pitch_mm, bends = Drive.pitch_mm, Drive.bends

    def rise_mm(self, chord_mm):
        """Return over how much height a straight command keeps the nozzle within half a chord's tolerance."""
        most = 0.0
        for table in (self.lower, self.upper):
            count = int((table[-1] - table[0]) / RISE_LOOK_MM)
            if count < 3:
                continue
            motors = [inverse(self.grid, table, table[0] + i * RISE_LOOK_MM) for i in range(count)]
            columns = [motors] + [[Drive.at(self, push, m) for m in motors] for push in self.pushes]
            for i in range(1, count - 1):
                second = math.sqrt(sum((c[i + 1] - 2.0 * c[i] + c[i - 1]) ** 2 for c in columns))
                most = max(most, second / RISE_LOOK_MM**2)
        return min(max(math.sqrt(4.0 * chord_mm / max(most, 1e-12)), RISE_LOOK_MM), 1e3)


def inverse(grid, table, u):
    """Return the motor's place that puts a branch at u."""
    i = min(max(bisect.bisect_left(table, u), 1), len(table) - 1)
    rise = table[i] - table[i - 1]
    return grid[i - 1] + (grid[i] - grid[i - 1]) * ((u - table[i - 1]) / rise if rise > 0.0 else 1.0)


def rising(table, first):
    """Make a table non-decreasing from an entry outwards."""
    table = list(table)
    for i in range(first + 1, len(table)):
        table[i] = max(table[i], table[i - 1])
    for i in range(first - 1, -1, -1):
        table[i] = min(table[i], table[i + 1])
    return table


def series(wave, phase):
    """Return a wave's harmonics at an angle."""
    return sum(a * math.cos(k * phase) + b * math.sin(k * phase)
               for k, a, b in zip(wave["harmonics"], wave["cos_mm"], wave["sin_mm"]))  # fmt: skip


def fourier(wave, count):
    """Return one turn of a wave's harmonics."""
    return [series(wave, 2.0 * math.pi * i / count) if wave else 0.0 for i in range(count)]


def powers(wave, x, reach, middle):
    """Return a wave's polynomial; of the second degree and more it goes on as a straight line beyond what was seen."""
    if not wave or not wave["powers_mm"]:
        return 0.0
    c = wave["powers_mm"]
    inside = x if len(c) < 3 else min(max(x, (reach[0] - middle) / 100.0), (reach[1] - middle) / 100.0)
    value = sum(a * inside**k for k, a in enumerate(c))
    return value + (x - inside) * sum(k * a * inside ** (k - 1) for k, a in enumerate(c) if k)


def model_of(document, kernels, tolerance_mm):
    """Return a document's machine as the kernels' ``Model``, and the length of each motor's ripple.

    Its place of the end stops is what the document says."""
    look = kernels.load("printmend.plan.kernels.lookup")
    printer = document["printer"]
    x, y, z = printer["x"], printer["y"], printer["z"]
    head, corexy = look.HEAD.one(), printer["kinematics"] == "corexy"
    head.bed[:] = x["min_mm"], x["max_mm"], y["min_mm"], y["max_mm"]
    head.home[:] = x["home_mm"], y["home_mm"]
    head.home_side[:] = [1.0 if axis["home_side"] == "max" else -1.0 for axis in (x, y)]
    _put_frame(head.bed_map, document.get("frame"), corexy)
    corners = [(a, b) for a in head.bed[:2] for b in head.bed[2:]]
    motors = [(a + b, a - b) if corexy else (a, b) for a, b in corners]
    drives = [Drive(document["motors"][name], min(m[k] for m in motors), max(m[k] for m in motors))
              for k, name in enumerate(("a", "b") if corexy else ("x", "y"))]  # fmt: skip
    if document.get("screw") is not None:
        drives.append(Screw(document["screw"], z))
    tables, sharpest = [], 0.0
    for motor, drive in enumerate(drives):
        sharpest = max(sharpest, _put_drive(head, tables, motor, drive, look.BEND_BLOCK))
    head.chord = tolerance_mm / 2
    look.set_chords(look.Model(head, tables), tolerance_mm, 0.0)
    head.frame_bend = _frame_bend(look, head)
    head.sample = min(max(math.sqrt(2.0 * head.chord / max(sharpest, 1e-12)), 0.02), 2.0)
    head.look, head.period = 2.0, 1.0 / (60.0 * SEGMENTS_PER_S)
    if len(drives) == 3:
        screw = drives[2]
        head.screw, head.rise = 1.0, screw.rise_mm(head.chord)
        head.z_limits[:], head.z_home = (z["min_mm"], z["max_mm"]), z["home_mm"]
        head.z_home_side = 1.0 if z["home_side"] == "max" else -1.0
        head.push[:] = len(tables), len(tables) + len(screw.grid)
        tables += screw.pushes[0] + screw.pushes[1]
    return look.Model(head, tables), ripples_of(document, drives)


def ripples_of(document, drives):
    """Return the wave length of each motor that a shaper would take from a wall's speed, 0 for none."""
    turns = [STEPS_A_TURN * axis["mm_per_turn"] / axis["steps_per_turn"] for axis in map(document["printer"].get, "xy")]
    return [drive.ripple_mm((TOOTH_MM, turn)) for drive, turn in zip(drives, turns)]


def put_shaper(head, ripples, pulses):
    """Let walls' speed make up for what an input shaper takes of a ripple: pulses [s, share] of x and of y.

    Where both axes move both motors, only a shaper that both have is known for a motor.
    """
    head.ripple[:] = [0.0, 0.0]
    if not all(pulses) or (head.bed_map.corexy and pulses[0] != pulses[1]):
        return
    for motor, own in enumerate(pulses):
        whole = sum(share for _, share in own)
        middle = sum(at * share for at, share in own) / whole
        own = [(at - middle, share / whole) for at, share in own] + [(0.0, 0.0)] * len(head.pulse[motor])
        for i in range(len(head.pulse[motor])):
            head.pulse_s[motor][i], head.pulse[motor][i] = own[i]
        head.ripple[motor] = ripples[motor]


def _put_frame(way, frame, corexy):
    way.corexy, way.scale[:] = float(corexy), (1.0, 1.0)
    if frame is None:
        return
    way.framed, way.scale[:] = 1.0, (frame["scale_mm"], frame["scale_mm"])
    way.terms[0][:], way.terms[1][:] = frame["x_mm"], frame["y_mm"]
    for k, (towards, length, *sizes) in enumerate(frame.get("waves", [])):
        wave, rate = way.waves[k], 2.0 * math.pi * frame["scale_mm"] / length
        angle = towards * math.pi / 2.0  # 0 along x, 1 along y
        wave.rate[:] = 0.0 if towards == 1 else rate * math.cos(angle), 0.0 if towards == 0 else rate * math.sin(angle)
        wave.x[:], wave.y[:] = sizes[:2], sizes[2:]
        way.wave_count = k + 1


def _put_drive(head, tables, motor, drive, block):
    """Append a drive's tables; return its sharpest curvature in the plane."""
    bend, pitch = drive.bends(block), drive.pitch_mm
    head.first[motor], head.rate[motor], head.last[motor] = drive.grid[0], 1.0 / pitch, len(drive.grid) - 1
    head.bend[motor], head.bend_last[motor] = len(tables), len(bend) - 1
    head.taut[motor] = float(drive.lower == drive.upper)
    tables += bend
    for branch, table in enumerate((drive.lower, drive.upper)):
        head.table[motor][branch], head.floor[motor][branch] = len(tables), table[0]
        head.guide[motor][branch] = len(tables) + len(table)
        tables += table
        guide, at = [], 0
        for k in range(int((table[-1] - table[0]) / pitch) + 2):
            while at < len(table) - 1 and table[at] < table[0] + k * pitch:
                at += 1
            guide.append(at)
        tables += guide
    if motor == 2:
        return 0.0
    head.bent = max(head.bent, sum(bend) / len(bend))
    return max(bend)


def _frame_bend(look, head):
    """Return the largest curvature of the frame's map on the bed [1/mm]."""
    way, most = head.bed_map, 0.0
    if not way.framed:
        return 0.0
    at = look.bed.onto_bed
    for i in range(23):
        for j in range(23):
            x = head.bed[0] + (head.bed[1] - head.bed[0]) * i / 22
            y = head.bed[2] + (head.bed[3] - head.bed[2]) * j / 22
            for dx, dy in ((5.0, 0.0), (0.0, 5.0), (3.5, 3.5), (3.5, -3.5)):
                a, b, c = (at(way, x + s * dx, y + s * dy) for s in (-1, 0, 1))
                second = math.hypot(a[0] - 2 * b[0] + c[0], a[1] - 2 * b[1] + c[1])
                most = max(most, second / (dx * dx + dy * dy))
    return most
