"""Random G-code programs that use every state a machine keeps, in the middle of the bed."""

import random
from dataclasses import dataclass, field

OPENING = ["G21", "G90", "M83", "G28", "G1 Z0.2 F600", "G0 X100 Y100 F6000"]
ASIDE = ["PAUSE", "M600", "M486 S1", "EXCLUDE_OBJECT_START NAME=a", "EXCLUDE_OBJECT_END NAME=a"]
STILL = ["; a comment", "M106 S100", "G10", "G11", "G1 F1800", "M117 X1 E1"]


@dataclass
class Program:
    """Lines, and what a machine that reads them keeps in mind: only as much as is needed to write the next one."""

    rng: random.Random
    lines: list[str] = field(default_factory=lambda: list(OPENING))
    at: tuple[float, float] = (100.0, 100.0)
    zero: tuple[float, float] = (0.0, 0.0)
    relative: bool = False
    m82: bool = False
    e: float = 0.0
    inch: float = 1.0
    saved: tuple | None = None

    def words(self, to: tuple[float, float], filament: float) -> str:
        text = ""
        for letter, now, goal, zero in zip("XY", self.at, to, self.zero, strict=True):
            if goal != now or self.rng.random() < 0.5:
                text += f" {letter}{(goal - now if self.relative else goal - zero) / self.inch:.5f}"
        if filament:
            self.e += filament
            text += f" E{(filament if self.relative or not self.m82 else self.e) / self.inch:.5f}"
        self.at = to
        return text

    def move(self) -> None:
        near = self.rng.random() < 0.3
        x, y = (
            now + self.rng.uniform(-3, 3) if near else self.rng.uniform(60, 140) for now in self.at
        )  # fmt: skip
        to = self.rng.choice([(x, y), (x, y), (self.at[0], y), (x, self.at[1])])
        command, filament = self.rng.choice([("G1", 0.5), ("G1", 0.5), ("G1", 0.5), ("G0", 0.0)])
        self.lines.append(command + self.words(to, filament))

    def arc(self) -> None:
        radius, clockwise = self.rng.uniform(1, 9), self.rng.random() < 0.5
        up = -radius if clockwise else radius
        words = self.words((self.at[0] + radius, self.at[1] + up), 0.3)
        self.lines.append(f"{'G2' if clockwise else 'G3'}{words} J{up / self.inch:.5f}")

    def mode(self) -> None:
        self.relative = not self.relative
        self.lines.append("G91" if self.relative else "G90")

    def extruder(self) -> None:
        self.m82, self.e = not self.m82, 0.0
        self.lines += ["M82" if self.m82 else "M83", "G92 E0"]

    def unit(self) -> None:
        self.inch = 26.4 - self.inch
        self.lines += ["G20" if self.inch > 1 else "G21", f"G1 F{1800 / self.inch:.1f}", "G92 E0"]
        self.e = 0.0

    def new_zero(self) -> None:
        values = [float(f"{self.rng.uniform(-50, 50) / self.inch:.6f}") for _ in range(2)]
        self.lines.append(f"G92 X{values[0]:.6f} Y{values[1]:.6f}")
        self.zero = (self.at[0] - values[0] * self.inch, self.at[1] - values[1] * self.inch)

    def state(self) -> None:
        if self.saved is None or self.rng.random() < 0.5:
            self.lines.append("SAVE_GCODE_STATE NAME=s")
            self.saved = (self.at, self.zero, self.relative, self.m82, self.e)
            return
        move = self.rng.random() < 0.5
        self.lines.append("RESTORE_GCODE_STATE NAME=s" + " MOVE=1" * move)
        at, self.zero, self.relative, self.m82, self.e = self.saved
        self.at = at if move else self.at

    def home(self) -> None:
        axes = self.rng.choice(["X", "Y", "XY"])
        self.lines.append("G28 " + " ".join(axes))
        self.at = tuple(0.0 if name in axes else now for name, now in zip("XY", self.at, strict=True))
        self.zero = tuple(0.0 if name in axes else zero for name, zero in zip("XY", self.zero, strict=True))
        self.lines.append("G0" + self.words((self.rng.uniform(60, 140), self.rng.uniform(60, 140)), 0.0))

    def aside(self) -> None:
        self.lines.append(self.rng.choice(ASIDE))

    def still(self) -> None:
        self.lines.append(self.rng.choice(STILL))


def program(seed: int) -> bytes:
    """Return a program of some 30 lines."""
    made = Program(random.Random(seed))  # noqa: S311 — a test needs no secrets
    steps = [
        made.arc,
        made.mode,
        made.extruder,
        made.unit,
        made.new_zero,
        made.state,
        made.home,
        made.aside,
        made.still,
    ]
    for _ in range(made.rng.randint(10, 30)):
        made.rng.choice([made.move] * len(steps) + steps)()
    return "\n".join(made.lines).encode() + b"\n"
