"""`printmend bench real`: learn from the first measured traverse of each direction, predict the later ones.

``shipped`` is what `printmend learn` makes of them. ``plain`` is a least-squares fit of eight harmonics a direction,
the travel of a turn fitted too. The floor is what no predictor can pass: the scatter of the later traverses about
their own mean. ``periodic`` is the plain fit to the later traverses themselves, the best that anything can do which
repeats every turn: what lies between it and the floor repeats, but not by turns. A ``copy`` of the first traverse
comes to √2 floors if the first is of the same kind as the later ones. Places are counted from the middle of the bed
(`middles_mm`), which uses the lengths of the later traverses but never their errors; ``blind`` counts travel from
each traverse's first sample instead.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from printmend.errors import TraceError
from printmend.learn.learned import learn_model
from printmend.path import Trace
from printmend.printer import read_printer
from printmend_lab.bench.case import Case, Result, run
from printmend_lab.bench.report import grouped
from printmend_lab.bench.traverse import Traverse, detrended, middles_mm, read_runs, runs_digest
from printmend_lab.executor import HERE, Executor

# Traverses for `printmend learn`: the question of `bench real`, asked of what printmend ships.

# Each traverse came without its own line, and so without how far the belt is behind on the way back: any distance that
# keeps one way behind the other stands for it. Before its first sample the carriage had sped up, over this way or more.
_BEHIND_MM, _RUN_UP_MM = 2.0, 10.0


def shipped_fit(
    traces: Sequence[tuple[int, np.ndarray, np.ndarray]],
) -> Callable[[int, np.ndarray], np.ndarray]:
    """Learn from (direction, place [N], error along the way [N]) mm; predict the error of (direction, place [N]).

    The printer is a preset of 20 teeth: that its pulley turns by another length, the learner has to find.
    """
    printer = read_printer("ender5")
    turn_mm = printer.x.mm_per_turn
    turns = 1 + np.ceil(2 * max(float(np.abs(place).max()) for _, place, _ in traces) / turn_mm)
    printer = replace(printer, x=replace(printer.x, max_mm=float(turns * turn_mm)))
    middle = printer.x.max_mm / 2
    ways = [np.concatenate([[place[0] - direction * _RUN_UP_MM], place]) for direction, place, _ in traces]
    errors = [np.concatenate([[np.nan], direction * (error - _BEHIND_MM / 2)]) for direction, _, error in traces]
    commanded = np.concatenate(ways) + middle
    measured = commanded + np.concatenate(errors)
    still = np.full_like(commanded, printer.y.max_mm / 2)
    seen = np.where(np.isnan(measured), np.nan, still)
    trace = Trace(np.stack([commanded, still], axis=1), np.stack([measured, seen], axis=1))
    drive = learn_model(trace, printer, rng=np.random.default_rng(0)).mechanism.transmissions[0]

    def error_mm(direction: int, place_mm: np.ndarray) -> np.ndarray:
        lower, upper = drive.branches_mm(place_mm + middle)
        return direction * ((lower if direction > 0 else upper) - place_mm - middle)

    return error_mm


Guess = Callable[[int, np.ndarray], np.ndarray]
TABLE, FLOOR = "real", "floor"
ROWS = ("raw", "copy", "plain", "shipped", "periodic", FLOOR)
BLIND = ("plain", "shipped", FLOOR)
_PLAIN_HARMONICS = 8  # of a turn that the plain fit knows
_TURNS_MM = 20.0, 72.0  # of pulleys of 10 to 36 teeth: lengths of a turn that it tries
_GRID_TURNS = 0.05  # of a turn, by which a wave may be off at the end of the span between two of them


@dataclass(frozen=True)
class RealLine:
    """One shape and speed: root mean squares [mm] over the ``later`` traverses of both directions."""

    shape: str
    speed_mm_s: float
    later: int
    raw_mm: float
    copy_mm: float
    plain_mm: float
    shipped_mm: float
    periodic_mm: float
    floor_mm: float
    plain_blind_mm: float
    shipped_blind_mm: float
    floor_blind_mm: float


HEADER = ("pulley", "mm/s", "later", "raw mm", "raw÷copy", "raw÷plain", "raw÷shipped", "raw÷periodic",
          "raw÷floor", "blind: raw÷plain", "raw÷shipped", "raw÷floor")  # fmt: skip


def real_cases(data: Path, traverses: Sequence[Traverse]) -> list[Case]:
    """Return a case for each shape and speed of what `read_runs` has read."""
    content, place = runs_digest(data), str(data.absolute())  # workers may run elsewhere
    return [
        Case(TABLE, f"{shape} {speed:g}", f"{content} {shape} {speed:g}", "", "", "first", 0, "", source=place)
        for shape, speed in dict.fromkeys((item.shape, item.speed_mm_s) for item in traverses)
    ]


@dataclass(frozen=True)
class RealRow:
    """A predictor, by name; all learn at once."""

    name: str
    lesson = TABLE


def read_row(name: str) -> RealRow:
    """Return the row of the real data's table that a result names."""
    return RealRow(name)


@dataclass(frozen=True, eq=False)
class RealStand:
    """A shape at a speed: its traverses, and from each one's first sample to the middle of the bed [mm]."""

    items: Sequence[Traverse]
    middles: np.ndarray

    def measure(self, row: RealRow) -> None:
        return None

    def fit(self, measured: None, row: RealRow) -> dict[int, Callable[[int, float, str], np.ndarray]]:
        shipped = shipped_fit([(direction, *self._samples(self._first(direction))) for direction in (1, -1)])
        return {direction: self._predictor(direction, shipped) for direction in (1, -1)}

    def judge(self, model: dict[int, Callable[[int, float, str], np.ndarray]], row: RealRow) -> dict[str, Any]:
        sums: dict[str, list[float]] = {"mm": [], "blind_mm": []}
        for direction in (1, -1):
            later = self._later(direction)
            blind = np.full(len(later), self.middles[self._first(direction)])
            for name, middles in (("mm", self.middles[later]), ("blind_mm", blind)):
                if row.name == FLOOR:
                    sums[name].append(scatter_mm2([self.items[n] for n in later], middles))
                    continue
                for n, middle in zip(later, middles, strict=True):
                    item = self.items[n]
                    guess = detrended(item.travel_mm, model[direction](n, middle, row.name))
                    sums[name].append(float(((item.error_mm - guess) ** 2).mean()))
        means = {name: float(np.sqrt(np.mean(values))) for name, values in sums.items()}
        return {**means, "later": len(self.items) - 2}

    def _first(self, direction: int) -> int:
        return next(n for n, item in enumerate(self.items) if item.direction == direction)

    def _later(self, direction: int) -> list[int]:
        first = self._first(direction)
        return [n for n, item in enumerate(self.items) if item.direction == direction and n != first]

    def _samples(self, n: int) -> tuple[np.ndarray, np.ndarray]:
        """Return places from the middle of the bed and errors [N] of a traverse."""
        item = self.items[n]
        return item.direction * (item.travel_mm - self.middles[n]), item.error_mm

    def _predictor(self, direction: int, shipped: Guess) -> Callable[[int, float, str], np.ndarray]:
        """Return what guesses the error [N] of traverse n, its middle at a travel, by the name of a row."""
        first = self._first(direction)
        plain = plain_fit([self._samples(first)])
        periodic = plain_fit([self._samples(n) for n in self._later(direction)])
        copied = self.items[first]

        def guess(n: int, middle: float, name: str) -> np.ndarray:
            way = self.items[n].travel_mm - middle
            if name == "copy":
                return np.interp(way, copied.travel_mm - self.middles[first], copied.error_mm)
            if name == "shipped":
                return shipped(direction, direction * way)
            if name in ("plain", "periodic"):
                return (plain if name == "plain" else periodic)(direction * way)
            return np.zeros_like(way)

        return guess


def set_up(case: Case) -> RealStand:
    """Read the traverses of a case's shape and speed. Raise `TraceError` where they are too few."""
    items = [item for item in read_runs(Path(case.source)) if f"{item.shape} {item.speed_mm_s:g}" == case.body]
    counts = [sum(item.direction == direction for item in items) for direction in (1, -1)]
    if min(counts) < 3:
        raise TraceError(
            f"{case.body} mm/s",
            wanted="three traverses in each direction: one to learn from, two to predict",
            came=" and ".join(map(str, counts)),
            todo="leave this pulley out",
        )
    return RealStand(items, middles_mm(items))


def real_table(
    cases: Sequence[Case],
    out: Path,
    *,
    executor: Executor = HERE,
    tick: Callable[[str], None] = lambda name: None,
) -> tuple[list[RealLine], list[Result]]:
    """Evaluate every shape and speed; keep results in ``out``/real.jsonl."""
    results = run(cases, ROWS, out, executor, tick=tick)
    groups = grouped([item for item in results if item.error is None], lambda item: item.case)
    return [_line(items) for items in groups.values()], results


def _line(items: Sequence[Result]) -> RealLine:
    shape, _, speed = items[0].case.body.rpartition(" ")
    sizes = {f"{item.row}_mm": item.values["mm"] for item in items}
    sizes |= {f"{item.row}_blind_mm": item.values["blind_mm"] for item in items if item.row in BLIND}
    return RealLine(shape=shape, speed_mm_s=float(speed), later=items[0].values["later"], **sizes)


def plain_fit(traces: Sequence[tuple[np.ndarray, np.ndarray]]) -> Callable[[np.ndarray], np.ndarray]:
    """Return the least-squares harmonics of (angle, error) [N] mm of one direction as a function of the angle [N] mm.

    Each trace has a line of its own. The length of a turn is the best of a grid, and then of a finer one.
    """
    angle_mm, error_mm = (np.concatenate(values) for values in zip(*traces, strict=True))
    of = np.repeat(np.arange(len(traces)), [len(angle) for angle, _ in traces])
    lines = np.concatenate([(of == n)[:, None] * np.stack([np.ones_like(angle_mm), angle_mm], axis=1)
                            for n in range(len(traces))], axis=1)  # fmt: skip

    def columns(angle_mm: np.ndarray, turn_mm: float) -> np.ndarray:
        angle = np.outer(angle_mm, np.arange(1, _PLAIN_HARMONICS + 1)) * (2 * np.pi / turn_mm)
        return np.concatenate([np.cos(angle), np.sin(angle)], axis=1)

    def fitted(turn_mm: float) -> tuple[float, float, np.ndarray]:
        design = np.concatenate([columns(angle_mm, turn_mm), lines], axis=1)
        weights = np.linalg.lstsq(design, error_mm, rcond=None)[0]
        return float(((error_mm - design @ weights) ** 2).sum()), turn_mm, weights[: 2 * _PLAIN_HARMONICS]

    grid = 1 / np.arange(1 / _TURNS_MM[1], 1 / _TURNS_MM[0], _GRID_TURNS / float(np.ptp(angle_mm)))
    at = int(np.argmin([fitted(turn)[0] for turn in grid]))
    finer = np.linspace(grid[max(at - 1, 0)], grid[min(at + 1, len(grid) - 1)], 25)
    _, turn, weights = min((fitted(turn) for turn in finer), key=lambda found: found[0])
    return lambda at: columns(at, turn) @ weights


def scatter_mm2(traverses: Sequence[Traverse], middles: np.ndarray) -> float:
    """Return the unbiased variance [mm²] of full traverses of a direction about their mean, over what they share."""
    longest = max(item.length_mm for item in traverses)
    full = [(t, middle) for t, middle in zip(traverses, middles, strict=True) if t.length_mm > 0.95 * longest]
    ends = max(-middle for _, middle in full), min(item.length_mm - middle for item, middle in full)
    place = np.arange(ends[0], ends[1] + 1e-9, 0.5)
    errors = [detrended(place, np.interp(place, item.travel_mm - middle, item.error_mm)) for item, middle in full]
    return float(np.var(errors, axis=0, ddof=1).mean())


def cells(line: RealLine) -> tuple[str, ...]:
    """Return a line as the table's texts, in the order of `HEADER`."""
    over = (line.copy_mm, line.plain_mm, line.shipped_mm, line.periodic_mm, line.floor_mm,
            line.plain_blind_mm, line.shipped_blind_mm, line.floor_blind_mm)  # fmt: skip
    return (
        line.shape,
        f"{line.speed_mm_s:g}",
        str(line.later),
        f"{line.raw_mm:.3f}",
        *(f"{line.raw_mm / size:.2f}" for size in over),
    )
