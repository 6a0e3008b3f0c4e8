"""`printmend bench real`: learn from the first measured traverse of each direction, predict the later ones.

Two protocols. ``first`` learns anew for every shape and speed, from two traverses. ``pooled`` learns a shape once, from
the first traverses of all its speeds: the pulley is the same one, only the phase at which it starts may differ.
``ours`` is the model of periodic.py, made for these data; ``shipped`` is what `printmend learn` makes of them.

The floor is what no predictor can pass: the scatter of the later traverses about their own mean. ``periodic`` is the
plain fit to the later traverses themselves, the best that anything can do which repeats every turn: what lies between
it and the floor repeats, but not by turns. A ``copy`` of the first traverse comes to √2 floors if the first is of the
same kind as the later ones. Places are counted from the middle of the bed (`middles_mm`), which uses the lengths of
the later traverses but never their errors; ``blind`` counts travel from each traverse's first sample instead.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
from threadpoolctl import threadpool_limits

from printmend.errors import TraceError
from printmend.executor import HERE, Executor
from printmend_lab.bench.case import Case, Result
from printmend_lab.bench.real.evidence import Trace1d, turns_mm
from printmend_lab.bench.real.mocap import read_runs, runs_digest
from printmend_lab.bench.real.periodic import Periodic, fit
from printmend_lab.bench.real.shipped import shipped_fit
from printmend_lab.bench.real.traverse import Traverse, detrended, middles_mm
from printmend_lab.bench.report import grouped
from printmend_lab.bench.run import run

RealProtocol = Literal["first", "pooled"]
Guess = Callable[[int, np.ndarray], np.ndarray]
TABLE, FLOOR = "real", "floor"
ROWS = ("raw", "copy", "plain", "shipped", "ours", "periodic", FLOOR)
BLIND = ("plain", "ours", FLOOR)
_PLAIN_HARMONICS = 8  # of a turn that the plain fit knows
_AVERAGED_SAMPLES = 2  # into one before learning: it is three times faster and no less accurate


@dataclass(frozen=True)
class RealLine:
    """One shape and speed: root mean squares [mm] over the ``later`` traverses of both directions.

    ``plain`` is the reference, a least-squares fit of eight harmonics a direction, the travel of a turn fitted too;
    ``turn_mm`` is the learned travel of a turn, ``shared`` how far the directions share their pulley (1: wholly).
    """

    shape: str
    speed_mm_s: float
    later: int
    raw_mm: float
    copy_mm: float
    plain_mm: float
    shipped_mm: float
    ours_mm: float
    periodic_mm: float
    floor_mm: float
    plain_blind_mm: float
    ours_blind_mm: float
    floor_blind_mm: float
    turn_mm: float
    shared: float


HEADER = ("pulley", "mm/s", "later", "raw mm", "raw÷copy", "raw÷plain", "raw÷shipped", "raw÷ours", "raw÷periodic",
          "raw÷floor", "blind: raw÷plain", "raw÷ours", "raw÷floor", "turn mm")  # fmt: skip


@dataclass(frozen=True, eq=False)
class _File:
    """The traverses of a shape at a speed, and from each one's first sample to the middle of the bed [mm]."""

    number: int
    items: list[Traverse]
    middles: np.ndarray

    def first(self, direction: int) -> int:
        return next(n for n, item in enumerate(self.items) if item.direction == direction)

    def place_mm(self, n: int) -> np.ndarray:
        return self.items[n].direction * (self.items[n].travel_mm - self.middles[n])

    def samples(self, n: int, shift_mm: float) -> tuple[np.ndarray, np.ndarray]:
        return _averaged(self.place_mm(n)) + shift_mm, _averaged(self.items[n].error_mm)

    def trace(self, direction: int) -> Trace1d:
        return Trace1d(direction, *self.samples(self.first(direction), 0.0), self.number)

    def shift_mm(self, model: Periodic, direction: int) -> float:
        return model.settings.shift_mm(direction, self.number)


def real_cases(data: Path, traverses: Sequence[Traverse], protocol: RealProtocol) -> list[Case]:
    """Return a case for each shape and speed of what `read_runs` has read."""
    content, place = runs_digest(data), str(data.absolute())  # workers may run elsewhere
    return [
        Case(TABLE, f"{shape} {speed:g}", f"{content} {shape} {speed:g}", "", "", protocol, 0, "", source=place)
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
class _Learned:
    """What was learned from ``files``, together: the periodic model, and what printmend ships."""

    files: tuple[_File, ...]
    model: Periodic
    shipped: Guess


@dataclass(frozen=True, eq=False)
class RealStand:
    """A shape at a speed: its later traverses are predicted from what was learned."""

    file: _File
    learned: _Learned

    def measure(self, row: RealRow) -> None:
        return None

    def fit(self, measured: None, row: RealRow) -> dict[int, Callable[[int, float, str], np.ndarray]]:
        return {direction: self._predictor(direction) for direction in (1, -1)}

    def judge(self, model: dict[int, Callable[[int, float, str], np.ndarray]], row: RealRow) -> dict[str, Any]:
        sums: dict[str, list[float]] = {"mm": [], "blind_mm": []}
        for direction in (1, -1):
            first = self.file.first(direction)
            blind = np.full(len(self._later(direction)), self.file.middles[first])
            for name, middles in (("mm", self.file.middles[self._later(direction)]), ("blind_mm", blind)):
                if row.name == FLOOR:
                    items = [self.file.items[n] for n in self._later(direction)]
                    sums[name].append(scatter_mm2(items, middles))
                    continue
                for n, middle in zip(self._later(direction), middles, strict=True):
                    item = self.file.items[n]
                    guess = detrended(item.travel_mm, model[direction](n, middle, row.name))
                    sums[name].append(float(((item.error_mm - guess) ** 2).mean()))
        later = sum(len(self._later(direction)) for direction in (1, -1))
        settings = self.learned.model.settings
        means = {name: float(np.sqrt(np.mean(values))) for name, values in sums.items()}
        return {**means, "later": later, "turn_mm": settings.turn_mm, "shared": settings.share}

    def _later(self, direction: int) -> list[int]:
        first = self.file.first(direction)
        return [n for n, item in enumerate(self.file.items) if item.direction == direction and n != first]

    def _predictor(self, direction: int) -> Callable[[int, float, str], np.ndarray]:
        """Return what guesses the error [N] of traverse n, its middle at a travel, by the name of a row."""
        file, learned = self.file, self.learned
        model, first = learned.model, file.first(direction)
        plain = plain_fit([f.samples(f.first(direction), f.shift_mm(model, direction)) for f in learned.files])
        periodic = plain_fit([file.samples(n, 0.0) for n in self._later(direction)])
        own, shift = file.place_mm(first), file.shift_mm(model, direction)

        def guess(n: int, middle: float, name: str) -> np.ndarray:
            place = direction * (file.items[n].travel_mm - middle)
            if name == "copy":
                return np.interp(direction * place, direction * own, file.items[first].error_mm)
            if name == "plain":
                return plain(place + shift)
            if name == "shipped":
                return learned.shipped(direction, place + model.settings.phases_mm[file.number])
            if name == "ours":
                return model.error_mm(direction, place, file.number)
            return periodic(place) if name == "periodic" else np.zeros_like(place)

        return guess


def set_up(case: Case) -> RealStand:
    """Learn from the first traverses of a case: of its shape and speed alone, or of all speeds of the shape."""
    shape, _, speed = case.body.rpartition(" ")
    learned = _learned(case.source, shape, speed if case.protocol == "first" else "")
    (file,) = (file for file in learned.files if f"{file.items[0].speed_mm_s:g}" == speed)
    return RealStand(file, learned)


@lru_cache(maxsize=1)
def _learned(source: str, shape: str, speed: str) -> _Learned:
    """Learn a shape at one speed, or at all; kept, because the speeds of a pooled shape come one after the other."""
    items = [item for item in read_runs(Path(source)) if item.shape == shape]
    files = [_file(number, items, at) for number, at in enumerate(dict.fromkeys(item.speed_mm_s for item in items))
             if not speed or f"{at:g}" == speed]  # fmt: skip
    numbered = tuple(_File(number, file.items, file.middles) for number, file in enumerate(files))
    with threadpool_limits(1, user_api="blas"):  # small systems: a second thread only waits
        model = fit([file.trace(direction) for file in numbered for direction in (1, -1)])
        shipped = shipped_fit(
            [(direction, *file.samples(file.first(direction), model.settings.phases_mm[file.number]))
             for file in numbered for direction in (1, -1)]
        )  # fmt: skip
    return _Learned(numbered, model, shipped)


def _file(number: int, traverses: Sequence[Traverse], speed: float) -> _File:
    items = [item for item in traverses if item.speed_mm_s == speed]
    counts = [sum(item.direction == direction for item in items) for direction in (1, -1)]
    if min(counts) < 3:
        raise TraceError(
            f"{items[0].shape} {speed:g} mm/s",
            wanted="three traverses in each direction: one to learn from, two to predict",
            came=" and ".join(map(str, counts)),
            todo="leave this pulley out",
        )
    return _File(number, items, middles_mm(items))


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
    facts = {name: items[0].values[name] for name in ("later", "turn_mm", "shared")}
    return RealLine(shape=shape, speed_mm_s=float(speed), **facts, **sizes)


def _averaged(values: np.ndarray) -> np.ndarray:
    whole = len(values) // _AVERAGED_SAMPLES * _AVERAGED_SAMPLES
    return values[:whole].reshape(-1, _AVERAGED_SAMPLES).mean(axis=1)


def plain_fit(traces: Sequence[tuple[np.ndarray, np.ndarray]]) -> Callable[[np.ndarray], np.ndarray]:
    """Return the least-squares harmonics of (angle, error) [N] mm of one direction as a function of the angle [N] mm.

    Each trace has a line of its own. The travel of a turn is the best of `turns_mm`.
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

    grid = turns_mm(float(np.ptp(angle_mm)))
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
    over = (line.copy_mm, line.plain_mm, line.shipped_mm, line.ours_mm, line.periodic_mm, line.floor_mm,
            line.plain_blind_mm, line.ours_blind_mm, line.floor_blind_mm)  # fmt: skip
    return (
        line.shape,
        f"{line.speed_mm_s:g}",
        str(line.later),
        f"{line.raw_mm:.3f}",
        *(f"{line.raw_mm / size:.2f}" for size in over),
        f"{line.turn_mm:.2f}",
    )
