"""The learner ``weighed``: the grey box and ``meta``, each motor's by how well it foretold what it had not seen.

Measured rows are held out in blocks of consecutive ones. Both learners learn from the rest and predict them. For each
block and motor, the logarithm of the ratio of their mean square errors is one vote. The weight of ``meta`` is
1/(1 + exp(−2t − c)) with the votes' mean over its standard error, t, and the odds exp(c) before any was counted: the
grey box is right about most printers, so meta must be clearly ahead. A motor's tables are the weighted mean of both
learners' tables, so play and pulley stay what a drive can have.

Where a learner says that the frame couples the axes, tables of different learners do not fit together. Then both motors
take the learner whose whole machine foretold more.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from printmend.errors import PrintmendError
from printmend.learn.mechanism_model import MachineLearned
from printmend.learn.registry import learner
from printmend.machine import Mechanism, Transmission
from printmend.machine.printing import print_path
from printmend.path import Trace
from printmend.printer import Printer

OF = ("greybox", "meta")
BLOCKS = 5  # of consecutive measured rows; each is held out once
LOG_ODDS = -4.0  # of meta before any vote; with -4 the geometric mean of errors was least on the seed developed on
_FEWEST = 10  # measured rows of a trace, below which nothing is held out and the grey box is taken
_MOST_ROWS = 2000  # measured rows that are held out in a block at most: more decide nothing
_ALIKE, _MOST_LOG = 1e-6, 50.0  # of votes: the least standard error; of a logarithm of odds: the most
_EXACT_MM = 1e-4  # a smaller error is rounding, and no reason to prefer anyone


@dataclass(frozen=True, eq=False)
class WeighedModel(MachineLearned):
    """A machine whose motors are means of learned ones; ``weights`` [2, learners] are those of each motor's tables."""

    mechanism: Mechanism
    weights: np.ndarray

    @property
    def imagined(self) -> Mechanism:
        return self.mechanism


@dataclass(frozen=True)
class Weighed:
    """The learner ``weighed``."""

    name: str = "weighed"

    def fit(self, trace: Trace, printer: Printer, *, rng: np.random.Generator) -> MachineLearned:
        """Learn with both. Raise `TraceError` where neither can; where one cannot, the other's is the machine."""
        seeds = rng.integers(2**32, size=len(OF))
        whole = [_learned(name, trace, printer, int(seed)) for name, seed in zip(OF, seeds, strict=True)]
        if whole[0] is None or whole[1] is None:
            only = whole[0] if whole[1] is None else whole[1]
            if only is None:
                return learner(OF[0]).fit(trace, printer, rng=rng)  # type: ignore[return-value] # it says why
            return _model([only], np.ones((2, 1)))
        squares = _held_out(trace, printer, [int(seed) for seed in seeds])
        if all(one.frame.is_identity for one in whole if one is not None):
            shares = np.array([share(squares[:, :, k]) for k in range(2)])
        else:
            shares = np.full(2, float(share(squares.sum(axis=2)) > 0.5))
        weights = np.stack([1 - shares, shares], axis=1)
        return _model([one for one in whole if one is not None], weights)


def _learned(name: str, trace: Trace, printer: Printer, seed: int) -> Mechanism | None:
    try:
        return learner(name).fit(trace, printer, rng=np.random.default_rng(seed)).mechanism  # type: ignore[attr-defined]
    except PrintmendError:
        return None


def _held_out(trace: Trace, printer: Printer, seeds: Sequence[int]) -> np.ndarray:
    """Return the mean squares [blocks, learners, motors] mm² of held-out blocks, of those that both can do without."""
    known = np.flatnonzero(np.isfinite(trace.measured_mm).all(axis=1))
    found = []
    for block in np.array_split(known, BLOCKS) if len(known) >= _FEWEST else ():
        measured = trace.measured_mm.copy()
        measured[block] = np.nan
        rest = replace(trace, measured_mm=measured)
        machines = [_learned(name, rest, printer, seed) for name, seed in zip(OF, seeds, strict=True)]
        judged = block[np.unique(np.linspace(0, len(block) - 1, min(len(block), _MOST_ROWS)).astype(int))]
        squares = []
        for machine in machines:
            if machine is None:
                break
            left = trace.measured_mm - _printed(machine, trace)
            if not trace.placed:  # a scan has an origin of its own
                left = left - np.nanmean(np.where(np.isfinite(measured), left, np.nan), axis=0)
            squares.append((printer.to_motor(left[judged]) ** 2).mean(axis=0))
        if len(squares) == len(OF):
            found.append(squares)
    return np.array(found).reshape(-1, len(OF), 2)


def share(squares: np.ndarray) -> float:
    """Return the weight of ``meta`` by mean squares [blocks, learners]."""
    if len(squares) < 2:
        return 0.0
    votes = np.log(np.maximum(squares[:, 0], _EXACT_MM**2) / np.maximum(squares[:, 1], _EXACT_MM**2))
    doubt = max(float(votes.std(ddof=1)) / np.sqrt(len(votes)), _ALIKE)
    return float(1 / (1 + np.exp(-np.clip(2 * votes.mean() / doubt + LOG_ODDS, -_MOST_LOG, _MOST_LOG))))


def _printed(machine: Mechanism, trace: Trace) -> np.ndarray:
    """Return where a machine prints a trace [N, 2] mm; each layer begins at rest in the middle of its play."""
    layer = np.zeros(len(trace), np.int64) if trace.layer is None else trace.layer
    motors = machine.printer.to_motor(trace.commanded_mm)
    out = np.empty_like(motors)
    for rows in np.split(np.arange(len(layer)), np.flatnonzero(np.diff(layer)) + 1):
        first = motors[rows[0]]
        if trace.homed and rows[0] == 0:
            begin = machine.bed.wanted(trace.commanded_mm[0])
        else:
            pairs = [one.branches_mm(first[k : k + 1]) for k, one in enumerate(machine.transmissions)]
            begin = np.array([float(lower[0] + upper[0]) / 2 for lower, upper in pairs])
        out[rows] = print_path(machine, motors[rows], begin)
    return out


def _model(machines: Sequence[Mechanism], weights: np.ndarray) -> WeighedModel:
    """Return the machine whose motors' tables are means of theirs, with the frame of the one that weighs most."""
    first = machines[int(np.argmax(weights.sum(axis=0)))]
    tables = []
    for k in range(2):
        grid = first.transmissions[k]
        branches = np.zeros((2, len(grid.lower_mm)))
        for machine, weight in zip(machines, weights[k], strict=True):
            if weight > 0:
                branches += weight * np.stack(machine.transmissions[k].branches_mm(grid.motor_mm))
        tables.append(Transmission(grid.first_mm, grid.pitch_mm, branches[0], branches[1]))
    mechanism = Mechanism(first.printer, (tables[0], tables[1]), first.frame)
    return WeighedModel(mechanism, weights)


WEIGHED = Weighed()
