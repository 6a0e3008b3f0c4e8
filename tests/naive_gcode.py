"""A slow, obvious G-code interpreter: what `printmend.gcode.kernels.interpret` must agree with.

Regular expressions, a dictionary of state, one line at a time. It yields one dictionary for each motion (G0–G3),
homing (G28) and G92, with the machine's place after it.
"""

import math
import re
from collections.abc import Iterator

_WORD = re.compile(r"([A-Z])\s*([-+]?(?:\d+\.?\d*|\.\d+))?")
_MODES = {"G90", "G91", "G20", "G21", "G17", "G18", "G19", "G90.1", "G91.1", "G53"} | {f"G{n}" for n in range(54, 60)}


class NaiveMachine:
    """``rule``: how G90/G91 act on E: "either", "follows" or "apart". ``bare_g92_zeroes``: as on Klipper."""

    def __init__(self, home=(0.0, 0.0, 0.0), rule="either", bare_g92_zeroes=True):
        self.home, self.rule, self.bare_g92_zeroes = home, rule, bare_g92_zeroes
        self.place = {"X": 0.0, "Y": 0.0, "Z": 0.0}  # machine mm
        self.known = dict.fromkeys("XYZ", False)
        self.zero_known = dict.fromkeys("XYZ", True)
        self.g92 = dict.fromkeys("XYZ", 0.0)
        self.gcode_offset = dict.fromkeys("XYZ", 0.0)
        self.work = {n: dict.fromkeys("XYZ", 0.0) for n in range(54, 60)}
        self.system, self.e, self.feed, self.flow = 54, 0.0, 0.0, 1.0
        self.relative = self.m83 = self.inch = self.arc_absolute = False
        self.plane, self.modal = 17, 0
        self.saved = {}

    def offset(self, axis):
        return self.work[self.system][axis] + self.g92[axis] + self.gcode_offset[axis]

    @property
    def e_relative(self):
        return self.m83 or (self.rule == "either" and self.relative)

    def run(self, text: str) -> Iterator[dict]:
        for number, line in enumerate(text.splitlines()):
            for event in self.line(line):
                yield {"line": number, **event}

    def line(self, line: str) -> Iterator[dict]:
        line = re.sub(r"\([^)]*\)", " ", line.split(";")[0].split("*")[0]).strip().upper()
        line = re.sub(r"^N\d+\s*", "", line)
        if re.match(r"[A-Z_]{2}", line):
            yield from self.long_command(line)
            return
        command, words = None, {}
        for letter, number in _WORD.findall(line):
            if letter in "GM" and number:
                name = f"{letter}{float(number):g}"
                if letter == "G" and name in _MODES:
                    self.mode(name)
                    if name == "G53":
                        words["G53"] = True
                    continue
                if command is not None:
                    yield from self.obey(command, words)
                    words = {}
                command = name
                if name in ("M117", "M73"):
                    return  # the rest is a message, or the progress
            else:
                words[letter] = float(number) if number else None
        if command is None and words and next(iter(words)) not in "XYZIJKEFR":
            if set("XYZEF") & {w for w in words if words[w] is not None}:  # a command that nobody knows
                self.known = dict.fromkeys("XYZ", False)
                yield self.report("event")
            return
        if command is not None or words:
            yield from self.obey(command, words)

    def mode(self, name):
        if name in ("G90", "G91"):
            self.relative = name == "G91"
            if self.rule == "follows":
                self.m83 = self.relative
        elif name in ("G20", "G21"):
            self.inch = name == "G20"
        elif name in ("G17", "G18", "G19"):
            self.plane = int(name[1:])
        elif name in ("G90.1", "G91.1"):
            self.arc_absolute = name == "G90.1"
        elif name != "G53":
            self.system = int(name[1:])

    def obey(self, command, words):
        unit = 25.4 if self.inch else 1.0
        if command in ("G0", "G1", "G2", "G3"):
            self.modal = int(command[1])
            yield self.move(self.modal, words, unit)
        elif command is None and self.modal is not None and set("XYZEF") & {w for w in words if words[w] is not None}:
            yield self.move(self.modal, words, unit)
        elif command == "G28":
            axes = [a for a in "XYZ" if a in words] or list("XYZ")
            for axis, home in zip("XYZ", self.home, strict=True):
                if axis in axes:
                    self.place[axis], self.g92[axis] = home, 0.0
                    self.known[axis] = self.zero_known[axis] = True
            yield self.report("home")
        elif command == "G92":
            given = {w: v for w, v in words.items() if v is not None and w in "XYZE"}
            if not given and self.bare_g92_zeroes:
                given = dict.fromkeys("XYZE", 0.0)
            for axis in "XYZ":
                if axis in given:
                    self.g92[axis] += self.place[axis] - given[axis] * unit - self.offset(axis)
                    self.zero_known[axis] = self.zero_known[axis] and self.known[axis]
            if "E" in given:
                self.e = given["E"] * unit
            yield self.report("set")
        elif command in ("M82", "M83"):
            self.m83 = command == "M83"
        elif command == "M221" and words.get("S") is not None:
            self.flow = words["S"] / 100.0

    def move(self, motion, words, unit):
        before, e_before = dict(self.place), self.e
        if words.get("F"):  # F0 asks for no speed
            self.feed = abs(words["F"]) * unit
        for axis in "XYZ":
            value = words.get(axis)
            if value is None:
                continue
            if "G53" in words:
                self.place[axis], self.known[axis] = value * unit, True
            elif self.relative:
                self.place[axis] += value * unit
            else:
                self.place[axis] = value * unit + self.offset(axis)
                self.known[axis] = self.zero_known[axis]
        if words.get("E") is not None:
            self.e = e_before + words["E"] * unit if self.e_relative else words["E"] * unit
        event = self.report(("linear", "linear", "cw", "ccw")[motion])
        event["advance"] = (self.e - e_before) * self.flow
        if motion > 1:
            event["centre"] = self.centre(before, words, unit, clockwise=motion == 2)
            if event["centre"] is None:
                event["kind"] = "event"
        return event

    def centre(self, before, words, unit, *, clockwise):
        a, b = {17: "XY", 18: "ZX", 19: "YZ"}[self.plane]
        letters = {"X": "I", "Y": "J", "Z": "K"}
        i, j = words.get(letters[a]), words.get(letters[b])
        if i is not None or j is not None:
            if self.arc_absolute:
                first = before[a] if i is None else i * unit + self.offset(a)
                second = before[b] if j is None else j * unit + self.offset(b)
            else:
                first, second = before[a] + (i or 0.0) * unit, before[b] + (j or 0.0) * unit
            return None if (first, second) == (before[a], before[b]) else (first, second)
        if words.get("R"):
            radius = words["R"] * unit
            start, end = complex(before[a], before[b]), complex(self.place[a], self.place[b])
            chord = end - start
            if chord == 0:
                return None
            height = math.sqrt(max(radius**2 - abs(chord) ** 2 / 4, 0.0))
            side = -1j if clockwise == (radius > 0) else 1j  # the short arc has its centre on its inner side
            centre = (start + end) / 2 + side * height * chord / abs(chord)
            return centre.real, centre.imag
        return None

    def long_command(self, line):
        name, _, rest = line.partition(" ")
        values = dict(re.findall(r"([A-Z_]+)=(\S+)", rest))
        if name == "SET_GCODE_OFFSET":
            for axis in "XYZ":
                old = self.gcode_offset[axis]
                if axis in values:
                    self.gcode_offset[axis] = float(values[axis])
                elif axis + "_ADJUST" in values:
                    self.gcode_offset[axis] += float(values[axis + "_ADJUST"])
                if values.get("MOVE") == "1":
                    self.place[axis] += self.gcode_offset[axis] - old
        elif name == "SAVE_GCODE_STATE":
            keep = ("place", "known", "g92", "gcode_offset", "zero_known")
            self.saved[values.get("NAME", "DEFAULT")] = {k: dict(getattr(self, k)) for k in keep} | {
                k: getattr(self, k) for k in ("e", "feed", "flow", "relative", "m83")
            }
        elif name == "RESTORE_GCODE_STATE":
            for key, value in self.saved.get(values.get("NAME", "DEFAULT"), {}).items():
                if key in ("place", "known") and values.get("MOVE") != "1":
                    continue
                setattr(self, key, dict(value) if isinstance(value, dict) else value)
        return iter(())

    def report(self, kind):
        return {"kind": kind, "place": tuple(self.place.values()), "known": tuple(self.known.values()), "e": self.e,
                "feed": self.feed, "advance": 0.0, "centre": None}  # fmt: skip
