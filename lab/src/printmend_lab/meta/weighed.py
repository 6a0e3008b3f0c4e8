"""The learner ``weighed``: the grey box and ``meta``, each motor's by how well it foretold what it had not seen.

Measured rows are held out in blocks of consecutive ones. Both learners learn from the rest and predict them. Of n held
out rows of a motor whose mean square error is s² under a learner, the likelihood at its own best noise is s^−n, up to a
constant. The weights are these likelihoods at even odds: near one another after few points, all or nothing after many.
A motor's tables are the weighted mean of both learners' tables, so play and pulley stay what a drive can have.

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
_FEWEST = 10  # measured rows of a trace, below which nothing is held out and the grey box is taken
_MOST_ROWS = 2000  # measured rows that are held out in a block at most: more decide nothing
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
        squares, counts = _held_out(trace, printer, [int(seed) for seed in seeds])
        if all(one.frame.is_identity for one in whole if one is not None):
            weights = np.stack([_weights(squares[:, k], counts[k]) for k in range(2)])
        else:
            chosen = int(np.argmax(_weights(squares.sum(axis=1), counts.sum())))
            weights = np.tile(np.eye(len(OF))[chosen], (2, 1))
        return _model([one for one in whole if one is not None], weights)


def _learned(name: str, trace: Trace, printer: Printer, seed: int) -> Mechanism | None:
    try:
        return learner(name).fit(trace, printer, rng=np.random.default_rng(seed)).mechanism  # type: ignore[attr-defined]
    except PrintmendError:
        return None


def _held_out(trace: Trace, printer: Printer, seeds: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """Return the sums of squares [learners, motors] mm² over held-out rows, and how many there were [motors]."""
    known = np.flatnonzero(np.isfinite(trace.measured_mm).all(axis=1))
    squares, counts = np.zeros((len(OF), 2)), np.zeros(2)
    if len(known) < _FEWEST:
        squares[1:] = np.inf
        return squares, counts + 1
    for block in np.array_split(known, BLOCKS):
        measured = trace.measured_mm.copy()
        measured[block] = np.nan
        rest = replace(trace, measured_mm=measured)
        found = [_learned(name, rest, printer, seed) for name, seed in zip(OF, seeds, strict=True)]
        machines = [one for one in found if one is not None]
        if len(machines) < len(OF):
            continue  # a block without which one of them learns nothing is no comparison
        judged = block[np.unique(np.linspace(0, len(block) - 1, min(len(block), _MOST_ROWS)).astype(int))]
        for number, machine in enumerate(machines):
            left = trace.measured_mm - _printed(machine, trace)
            if not trace.placed:  # a scan has an origin of its own
                left = left - np.nanmean(np.where(np.isfinite(measured), left, np.nan), axis=0)
            squares[number] += (printer.to_motor(left[judged]) ** 2).sum(axis=0)
        counts += len(judged)
    return squares, counts


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


def _weights(squares: np.ndarray, count: float) -> np.ndarray:
    """Return the likelihoods [learners] of ``count`` rows with these sums of squares, as shares of 1."""
    mean = np.maximum(squares / max(count, 1), _EXACT_MM**2)
    log = -count / 2 * np.log(mean)
    shares = np.exp(log - log[np.isfinite(log)].max())
    return np.asarray(shares / shares.sum())


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
LEARNERS = {WEIGHED.name: WEIGHED}
