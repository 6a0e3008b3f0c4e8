"""Find how far the motors of a known machine have turned since it was learned: the shifts of their waves that fit a
print best.

The mean of the old machine stays. Free are place, play, those effects that every print and every measurement has, and
what the instrument may do: the waves of a scanner look like those of a motor.
All pairs of shifts are compared at once, because their errors are sums of products of the two motors' columns.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from printmend.effects import EFFECTS, Of, Scene
from printmend.effects.effect import Key
from printmend.effects.homing import shifted, waves_of
from printmend.infer.fit import looked
from printmend.infer.gram import Block, blocks_of, dictionary_of, seen
from printmend.infer.machine import Part, machine_of, those_acting
from printmend.infer.update import ALIKE_NATS, is_peak, rebased
from printmend.machine import Mechanism
from printmend.path import Trace

COARSE_MM, FINE_MM, ROUND_MM = 0.1, 0.01, 1.0  # of the shifts that are tried: over a turn, then about the best of them
PASSES = 2  # of contacts, then shifts
FREE = ("place", "play")
LOOSE = ("idler",)  # effects whose waves no motor turns: after work on the belt they stand anywhere


@dataclass(frozen=True, eq=False)
class Phase:
    """The shifts of both motors [2] and their standard deviations [2], in mm of belt; NaN where a motor has no waves.

    ``parts`` are the old machine's there, and ``mechanism`` is what they make."""

    by_mm: np.ndarray
    sd_mm: np.ndarray
    parts: tuple[Part, ...]
    mechanism: Mechanism


@dataclass(frozen=True, eq=False)
class _Rows:
    """What the rows of a print see, in standard deviations of their noise.

    ``error`` [M] is what the parts without waves leave. ``waves`` are the parts that turn with a motor, ``idlers``
    those that do not, each with its columns [M, P]. ``free`` [M, K] are columns of unit prior.
    """

    error: np.ndarray
    waves: list[tuple[Part, np.ndarray]]
    idlers: list[tuple[Part, np.ndarray]]
    free: np.ndarray
    scene: Scene

    def scores(self, grids: Sequence[np.ndarray]) -> np.ndarray:
        """Return the log likelihood of all pairs of shifts [G, H] of the motors, whatever the idlers do."""
        one, other = (self._made(motor, grid) for motor, grid in enumerate(grids))
        return self._likely(self.error[:, None] - one, other, self.idlers)

    def _likely(self, one: np.ndarray, other: np.ndarray, idlers: Sequence[tuple[Part, np.ndarray]]) -> np.ndarray:
        """Return the log likelihood [G, H] of what remains of errors [M, G] less [M, H]."""
        free = np.hstack([self.free, *(columns * np.sqrt(np.mean(part.draws_mm**2)) for part, columns in idlers)])
        root = np.linalg.cholesky(np.eye(free.shape[1]) + free.T @ free)
        free_one, free_other = (np.linalg.solve(root, free.T @ each) for each in (one, other))
        square = np.sum(one**2, axis=0) - np.sum(free_one**2, axis=0)
        beside = np.sum(other**2, axis=0) - np.sum(free_other**2, axis=0)
        return np.asarray(-0.5 * (square[:, None] + beside - 2 * (one.T @ other - free_one.T @ free_other)))

    def _made(self, motor: int, grid: np.ndarray) -> np.ndarray:
        """Return what the waves of a motor do to the rows at each of its shifts [M, G]."""
        own = [_seen_at(part, columns, grid, self.scene) for part, columns in self.waves if part.where == motor]
        return np.sum(own, axis=0) if own else np.zeros((len(self.error), len(grid)))

    def idler_shifts_mm(self, by_mm: np.ndarray) -> dict[Key, float]:
        """Return the shift of each idler, one after the other, beside those of the motors [2]."""
        left = self.error - sum(self._made(motor, by_mm[[motor]])[:, 0] for motor in range(2))
        found: dict[Key, float] = {}
        for at, (part, columns) in enumerate(self.idlers):
            grid = _turn(part.shape[0])
            made = _seen_at(part, columns, grid, self.scene)
            scores = self._likely(left[:, None], made, self.idlers[at + 1 :])[0]
            best = int(np.argmax(scores))
            found[part.key], left = float(grid[best]), left - made[:, best]
        return found


def _seen_at(part: Part, columns: np.ndarray, grid: np.ndarray, scene: Scene) -> np.ndarray:
    """Return what a part does to rows [M, G] whose columns [M, P] are given, at each of its shifts [G]."""
    waves_mm = waves_of(*part.key, scene)
    assert waves_mm is not None
    return np.asarray(columns @ shifted(part.mean_mm[:, None], waves_mm, grid))


def found_phase(parts: Sequence[Part], mechanism: Mechanism, trace: Trace, scene: Scene, sigma_mm: float) -> Phase:
    """Return where the motors of a machine stand in a print, measured with a noise of ``sigma_mm``."""
    old = tuple(rebased(part, scene) for part in parts)
    by_mm, sd_mm, now = np.zeros(2), np.full(2, np.nan), old
    around = np.arange(-ROUND_MM, ROUND_MM + FINE_MM / 2, FINE_MM)
    for number in range(PASSES):
        rows = _rows(old, mechanism, trace, scene, sigma_mm, is_first=number == 0)
        turning = [any(part.where == motor for part, _ in rows.waves) for motor in range(2)]
        turns = [_turn(scene.turns_mm[motor]) if turning[motor] else np.zeros(1) for motor in range(2)]
        found = _smallest(rows.scores(turns), turns)
        grids = [at + around if is_there else np.zeros(1) for at, is_there in zip(found, turning, strict=True)]
        scores = rows.scores(grids)
        likely = np.exp(scores - scores.max())
        for motor in range(2):
            share = likely.sum(axis=1 - motor) / likely.sum()
            by_mm[motor] = share @ grids[motor]
            sd_mm[motor] = np.sqrt(share @ (grids[motor] - by_mm[motor]) ** 2) if turning[motor] else np.nan
        own = rows.idler_shifts_mm(by_mm)
        now = tuple(part.standing(_shift_of(part, own, by_mm), scene) if part.where < 2 else part for part in old)
        mechanism, _ = machine_of(scene, those_acting(now))
    return Phase(by_mm, sd_mm, now, mechanism)


def _rows(
    parts: Sequence[Part], mechanism: Mechanism, trace: Trace, scene: Scene, sigma_mm: float, *, is_first: bool
) -> _Rows:
    look = looked(trace, scene, mechanism, is_first=is_first)
    rows = look.rows
    scale = np.sqrt(rows.weight) / sigma_mm
    dictionary = dictionary_of(blocks_of(scene), look)
    free = [
        dictionary.columns[:, block.at] * _free_mm(block) * scale[:, None]
        for block in dictionary.blocks
        if block.log_odds[0] > 0 or block.effect in FREE or EFFECTS[block.effect].of is Of.INSTRUMENT
    ]
    error = rows.error_mm * scale
    waves: list[tuple[Part, np.ndarray]] = []
    for part in parts:
        told = seen(part.key, look.places, rows, scene) * scale[:, None]
        if waves_of(*part.key, scene) is None:
            error = error - told @ part.mean_mm
        elif part.mean_mm.any():
            waves.append((part, told))
    # machines that have another period near a likely one go with that one
    idlers = [(_surely(part), told) for part, told in waves if part.effect in LOOSE and part.is_likely]
    turning = [one for one in waves if one[0].effect not in LOOSE]
    return _Rows(error, turning, idlers, np.hstack([np.zeros((len(error), 0)), *free]), scene)


def _free_mm(block: Block) -> float | np.ndarray:
    """Return the standard deviation of a block's sizes before anything is measured, machines without it included; that
    of place, play and what is always there is as large as it may be."""
    if block.log_odds[0] > 0 or block.effect in FREE:
        return float(block.sds_mm[:, :1].max())
    return np.asarray(np.sqrt(block.variance_mm2))


def _surely(part: Part) -> Part:
    """Return a part as the drawn machines have it that have it."""
    return replace(part, draws_mm=part.draws_mm[:, part.draws_mm.any(axis=0)])


def _shift_of(part: Part, idlers: Mapping[Key, float], by_mm: np.ndarray) -> float:
    """Return the shift of a part: that of its motor, or of the idler that is most like it."""
    like = [key for key in idlers if (part.effect, part.where) == key[:2]]
    if not like:
        return float(by_mm[part.where])
    return idlers[min(like, key=lambda key: abs(key[2][0] - part.shape[0]))]


def _turn(turn_mm: float) -> np.ndarray:
    return np.arange(0.0, turn_mm, COARSE_MM) - COARSE_MM * (round(turn_mm / COARSE_MM) // 2)


def _smallest(scores: np.ndarray, grids: Sequence[np.ndarray]) -> np.ndarray:
    """Return the smallest pair of shifts [2] of the peaks that fit as well as the best."""
    size = np.hypot(grids[0][:, None], grids[1][None])
    best = np.argmin(np.where(is_peak(scores) & (scores >= scores.max() - ALIKE_NATS), size, np.inf))
    i, j = np.unravel_index(best, scores.shape)
    return np.array([grids[0][i], grids[1][j]])
