"""Traces that no model of a printer fits whole, made without any of printmend's code: see bench_misfit.py.

A machine is two drives of outside.py; a misfit is added on the way (a belt that wears, a rail of its own for each half
of the bed, an idler off its centre, …) or to the finished table (rows shifted, a plate turned). Misfits with a size are
scaled until they move the points by a given root mean square about their mean: what they cost a print.
"""

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

import outside

BEDS = {
    "ender3": ((0.0, 0.0), (-1, -1), 220.0, False),
    "ender5": ((220.0, 220.0), (1, 1), 220.0, False),
    "corexy": ((0.0, 0.0), (-1, 1), 300.0, True),
}


@dataclass
class Printed:
    """A trace in the making: commands [N, 2], places [N, 2], the share of the print that is done [N] from 0 to 1."""

    commanded_mm: np.ndarray
    printed_mm: np.ndarray
    done: np.ndarray
    bed_mm: float
    corexy: bool

    def moved(self, by_mm: np.ndarray) -> np.ndarray:
        return self.printed_mm + by_mm

    @property
    def ways(self) -> np.ndarray:
        """Which way [N, 2] each axis of the bed was last moved."""
        steps = np.sign(np.diff(self.commanded_mm, axis=0, prepend=self.commanded_mm[:1]))
        for row in range(1, len(steps)):
            steps[row] = np.where(steps[row] == 0, steps[row - 1], steps[row])
        return steps


@dataclass
class Machine:
    """Two drives, a frame, where home is."""

    drives: tuple[outside.Drive, outside.Drive]
    matrix: np.ndarray
    shift_mm: np.ndarray
    home_mm: tuple[float, float]
    bed_mm: float
    corexy: bool

    def walk(self, commanded_mm: np.ndarray, bent: Callable | None = None) -> np.ndarray:
        """Return where it prints each way-point [N, 2]; ``bent(axis, row, motor, low, high)`` may move the branches."""
        motors = commanded_mm @ np.array([[1.0, 1.0], [1.0, -1.0]]) if self.corexy else commanded_mm
        belts = np.empty_like(motors)
        for axis, drive in enumerate(self.drives):
            motor = motors[:, axis]
            low = np.interp(motor, drive.motor_mm, drive.lower_mm)
            high = np.interp(motor, drive.motor_mm, drive.upper_mm)
            if bent is not None:
                low, high = bent(axis, motors, low, high, drive)
            u = motor[0]
            for row in range(len(motor)):
                u = min(max(u, low[row]), high[row])
                belts[row, axis] = u
        if self.corexy:
            belts = np.stack([belts.sum(axis=1), belts[:, 0] - belts[:, 1]], axis=1) / 2
        return belts @ self.matrix.T + self.shift_mm


def machine(preset: str, family: str, rng: np.random.Generator) -> Machine:
    """Draw a broken printer of one of outside.py's families."""
    home, sides, bed, corexy = BEDS[preset]
    at = (home[0] + home[1], home[0] - home[1]) if corexy else home
    drives = [outside.random_drive(rng, family, h, s, bed)[1] for h, s in zip(at, sides, strict=True)]
    _, matrix, shift = outside.random_frame(rng, home) if "frame" in family else ("", np.eye(2), np.zeros(2))
    return Machine((drives[0], drives[1]), matrix, np.asarray(shift), home, bed, corexy)


def probe_path(text: str, preset: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the way-points [N, 2] of a probe's G-code from the last homing on, and which of them leave a dot."""
    home = BEDS[preset][0]
    moves = outside.read_moves(text, home)
    first = max(i for i, move in enumerate(moves) if move.z_mm == -1.0)
    points, dots = [home], [False]
    for move in moves[first + 1 :]:
        if move.start_mm != move.end_mm:
            points.append(move.end_mm)
            dots.append(False)
        elif move.extruding:
            dots[-1] = True
    return np.array(points), np.array(dots)


def printed(one: Machine, commanded_mm: np.ndarray, bent: Callable | None = None) -> Printed:
    done = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(commanded_mm, axis=0).T))])
    return Printed(commanded_mm, one.walk(commanded_mm, bent), done / done[-1], one.bed_mm, one.corexy)


# -- misfits with a size: (machine, path, amount, draws) → printed
def _by(field: Callable[[Printed, np.random.Generator], np.ndarray]) -> Callable:
    """A misfit that moves the finished places by amount × field [N, 2]."""

    def make(one: Machine, path: np.ndarray, amount: float, rng: np.random.Generator) -> Printed:
        plain = printed(one, path)
        return replace(plain, printed_mm=plain.moved(amount * field(plain, rng)))

    return make


def _axis(rng: np.random.Generator) -> np.ndarray:
    return np.eye(2)[int(rng.integers(2))]


def _bent(kind: str) -> Callable:
    """A misfit of one motor's branches."""

    def make(one: Machine, path: np.ndarray, amount: float, rng: np.random.Generator) -> Printed:
        which = int(rng.integers(2))
        done = printed(one, path).done

        def bent(axis: int, motors: np.ndarray, low: np.ndarray, high: np.ndarray, drive: outside.Drive) -> tuple:
            if axis != which:
                return low, high
            motor, other = motors[:, axis], motors[:, 1 - axis]
            if kind == "wear":
                return low - amount * done / 2, high + amount * done / 2
            if kind == "set-screw-creep":
                slipped = motor - amount * (1 - np.exp(-3 * done))
                return tuple(np.interp(slipped, drive.motor_mm, branch) for branch in (drive.lower_mm, drive.upper_mm))
            if kind == "halves-play":
                more = amount * (other > np.median(other)) / 2
                return low - more, high + more
            more = amount * (other - other.min()) / np.ptp(other) / 2  # racking: lost motion grows along the gantry
            return low - more, high + more

        return printed(one, path, bent)

    return make


def _idler(plain: Printed, rng: np.random.Generator) -> np.ndarray:
    motors = np.array([[1.0, 1.0], [1.0, -1.0]]) if plain.corexy else np.eye(2)
    period = float(rng.choice([18.0, 24.5, 31.4, 50.3, 56.5, 70.0]))
    wave = np.sin(2 * math.pi * (plain.commanded_mm @ motors) / period + rng.uniform(0, 6.28, 2))
    return (wave * _axis(rng)) @ np.linalg.inv(motors)


def _two_motors(plain: Printed, rng: np.random.Generator) -> np.ndarray:
    """Two motors of Y, each with an uneven pulley: what y does depends on x."""
    x, y = (plain.commanded_mm / plain.bed_mm).T
    left, right = (np.sin(2 * math.pi * y * plain.bed_mm / 40.0 + rng.uniform(0, 6.28)) for _ in range(2))
    return np.stack([np.zeros(len(x)), (1 - x) * left + x * right], axis=1) - np.stack(
        [0 * x, (left + right) / 2], axis=1
    )


def _halves(plain: Printed, rng: np.random.Generator) -> np.ndarray:
    """One part of the bed is off by a step, whichever way: its border is along either axis, about the middle."""
    axis, border, way = int(rng.integers(2)), rng.uniform(0.3, 0.7), rng.uniform(0, 2 * math.pi)
    return np.outer(plain.commanded_mm[:, axis] > border * plain.bed_mm, [math.cos(way), math.sin(way)])


def _guides(one: Machine, path: np.ndarray, amount: float, rng: np.random.Generator) -> Printed:
    """Play of the head in its guides along x, y or both: it stays until they push it."""
    plain = printed(one, path)
    half = amount / 2 * rng.choice([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
    places, at = plain.printed_mm.copy(), plain.printed_mm[0]
    for row, to in enumerate(plain.printed_mm):
        places[row] = at = np.clip(at, to - half, to + half)
    return replace(plain, printed_mm=places)


def _moves(plain: Printed) -> np.ndarray:
    return np.hypot(*np.diff(plain.commanded_mm, axis=0, prepend=plain.commanded_mm[:1]).T)


SIZED: dict[str, Callable] = {
    "linear": _by(lambda p, rng: np.outer(p.done, _axis(rng))),
    "step": _by(lambda p, rng: np.outer(p.done > rng.uniform(0.25, 0.75), _axis(rng))),
    "walk": _by(lambda p, rng: np.cumsum(rng.normal(size=p.printed_mm.shape), axis=0)),
    "creep": _by(lambda p, rng: np.outer(1 - np.exp(-p.done * rng.uniform(3, 8)), _axis(rng))),
    "thermal": _by(lambda p, rng: (p.commanded_mm - p.bed_mm / 2) / p.bed_mm * (1 - np.exp(-4 * p.done))[:, None]),
    "wear": _bent("wear"),
    "set-screw-creep": _bent("set-screw-creep"),
    "direction": _by(lambda p, rng: p.ways[:, ::-1] * _axis(rng)),
    "speed": _by(lambda p, rng: p.ways * np.minimum(1.0, _moves(p) / 10.0)[:, None] * _axis(rng)),
    "halves": _by(_halves),
    "halves-play": _bent("halves-play"),
    "racking": _bent("racking"),
    "two-motors": _by(_two_motors),
    "idler": _by(_idler),
    "guides": _guides,
}


def sized(kind: str, one: Machine, path: np.ndarray, cost_mm: float, seed: int) -> Printed:
    """Return the misfit at the amount that moves the points by ``cost_mm``, root mean square about their mean."""
    plain = printed(one, path).printed_mm
    amount = cost_mm * 3
    for _ in range(3):
        made = SIZED[kind](one, path, amount, np.random.default_rng(seed))
        off = made.printed_mm - plain
        amount *= cost_mm / max(math.sqrt(np.square(off - off.mean(axis=0)).sum(axis=1).mean()), 1e-9)
    return SIZED[kind](one, path, amount, np.random.default_rng(seed))


# -- misfits of the table [N, 4]: commands, measured places
def shifted(table: np.ndarray, rows: int, first: int = 0) -> np.ndarray:
    out = table.copy()
    out[first + rows :, 2:] = table[first : len(table) - rows, 2:]
    return out


def some(table: np.ndarray, share: float, rng: np.random.Generator) -> np.ndarray:
    out = table.copy()
    hit = rng.random(len(table)) < share
    out[hit, 2:] += rng.uniform(-8, 8, (hit.sum(), 2))
    return out


def turned(table: np.ndarray, degrees: float, shift_mm: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    out, t = table.copy(), math.radians(degrees)
    middle = np.nanmean(table[:, 2:], axis=0)
    out[:, 2:] = (table[:, 2:] - middle) @ np.array([[math.cos(t), math.sin(t)], [-math.sin(t), math.cos(t)]]) + middle
    out[:, 2:] += shift_mm
    return out


def rows_only(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[np.ndarray], np.ndarray]:
    """Apply a change to the measured rows alone, in their order."""

    def changed(table: np.ndarray) -> np.ndarray:
        out = table.copy()
        seen = np.isfinite(table[:, 2])
        out[seen] = change(table[seen])
        return out

    return changed


TABLES: dict[str, Callable[[np.ndarray, np.random.Generator], np.ndarray]] = {
    "reversed": lambda t, rng: rows_only(lambda m: np.hstack([m[:, :2], m[::-1, 2:]]))(t),
    "shuffled": lambda t, rng: rows_only(lambda m: np.hstack([m[:, :2], rng.permutation(m[:, 2:])]))(t),
    "shifted-1": lambda t, rng: rows_only(lambda m: shifted(m, 1))(t),
    "shifted-3": lambda t, rng: rows_only(lambda m: shifted(m, 3))(t),
    "half-shifted-1": lambda t, rng: rows_only(lambda m: shifted(m, 1, len(m) // 2))(t),
    "table-shifted-1": lambda t, rng: shifted(t, 1),
    "swapped": lambda t, rng: t[:, [0, 1, 3, 2]],
    "mirrored": lambda t, rng: t * [1, 1, -1, 1] + [0, 0, 220, 0],
    "inches": lambda t, rng: t / [1, 1, 25.4, 25.4],
    "turned-1": lambda t, rng: turned(t, rng.choice([-1.0, 1.0])),
    "moved": lambda t, rng: turned(t, 0.0, tuple(rng.uniform(0.5, 1.5, 2) * rng.choice([-1, 1], 2))),
    "outliers-5": lambda t, rng: some(t, 0.05, rng),
    "outliers-20": lambda t, rng: some(t, 0.20, rng),
    "half-bed": lambda t, rng: np.where((t[:, [0]] > np.median(t[:, 0])) & (np.arange(4) > 1), np.nan, t),
}


def table_of(made: Printed, noise_mm: float, rng: np.random.Generator, dots: np.ndarray | None = None) -> np.ndarray:
    """Return commands and measured places [N, 4], with noise; those without a dot are not measured."""
    measured = made.printed_mm + rng.normal(0, noise_mm, made.printed_mm.shape) if noise_mm else made.printed_mm
    if dots is not None:
        measured = np.where(dots[:, None], measured, np.nan)
    return np.hstack([made.commanded_mm, measured])


FAMILIES = ("healthy", "play", "pulley", "pulley+play", "loose", "friction", "set-screw", "frame")
PAIRS = tuple(itertools.product(BEDS, FAMILIES))
