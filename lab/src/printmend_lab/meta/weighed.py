"""The learner ``weighed``: the grey box and ``meta``, each motor's by what tells which of them errs less.

Three signs say it, each the logarithm of the grey box's over meta's, 0 where both are alike: the misfit of the rows
that they learned from, the deviation that they state, and the error beyond what they learned from. For the last one
both learn again without the rows at one end of the motors' ways, and foretell these. The weight of ``meta`` is
1/(1 + exp(−s)), s the signs times `STACKED`. These numbers were found once, by stacking on machines of every kind
(Yao et al. 2018; weights that depend on what is seen: Yao et al. 2022): few rows cannot choose between two learners,
many machines can say what chooses. `benchmarks/stack_weighed.py` makes them.

A motor's tables are the weighted mean of both learners' tables, so play and pulley stay what a drive can have; so is
the frame, as far as it moves that motor.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from printmend.errors import PrintmendError
from printmend.learn.registry import learner
from printmend.machine import Frame, Mechanism, Transmission
from printmend.machine.printing import print_path
from printmend.path import Trace
from printmend.printer import Printer
from printmend_lab.protocols import MachineLearned

OF = ("greybox", "meta")
STACKED = (3.4, 1.3, 4.4)  # of misfit, stated deviation, error beyond
END_SHARE = 0.12  # of the rows, at either end of a motor's way, that are foretold by what was learned from the others
BEYOND_MM = 20.0  # beyond the measured way, to where the stated deviation counts
_LEAST_MM = 1e-4  # a smaller error is rounding, and no reason to prefer anyone
_MOST_LOG = 50.0  # of the logarithm of odds


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
        seeds = [int(seed) for seed in rng.integers(2**32, size=len(OF))]
        models = learned(trace, printer, seeds)
        found = [one for one in models if one is not None]
        if not found:
            return learner(OF[0]).fit(trace, printer, rng=rng)  # type: ignore[return-value] # it says why
        shares = share(signs(models, trace, printer, seeds)) if len(found) == len(OF) else np.zeros(2)
        weights = np.stack([1 - shares, shares], axis=1)[:, : len(found)]
        return _model([one.mechanism for one in found], weights)


def share(signs: np.ndarray) -> np.ndarray:
    """Return the weight of ``meta`` [2] by the signs of both motors [2, 3]."""
    return np.asarray(1 / (1 + np.exp(-np.clip(signs @ STACKED, -_MOST_LOG, _MOST_LOG))))


def signs(models: Sequence[Any], trace: Trace, printer: Printer, seeds: Sequence[int]) -> np.ndarray:
    """Return the three signs of both motors [2, 3]; the last is the mean over both ends of a way."""
    known = np.isfinite(trace.measured_mm).all(axis=1)
    motor = printer.to_motor(trace.commanded_mm)
    low, high = np.quantile(motor[known], [END_SHARE, 1 - END_SHARE], axis=0)
    misfit = _behind([_left_mm(one, trace, known) for one in models], np.stack([known, known], axis=1))
    beyond = np.zeros((2, 2))
    for number, end in enumerate((motor < low, motor > high)):
        end = end & known[:, None]
        rest = replace(trace, measured_mm=np.where(end.any(axis=1)[:, None], np.nan, trace.measured_mm))
        again = learned(rest, printer, seeds)
        if all(one is not None for one in again):
            seen = known & ~end.any(axis=1)
            beyond[number] = _behind([_left_mm(one, trace, seen) for one in again], end)
    stated = np.zeros(2)
    for k in range(2):
        way = np.linspace(motor[known, k].min() - BEYOND_MM, motor[known, k].max() + BEYOND_MM, 61)
        stated[k] = _log_ratio([np.concatenate(one.drives[k].sd_mm(way)) for one in models])
    return np.stack([misfit, stated, beyond.mean(axis=0)], axis=1)


def learned(trace: Trace, printer: Printer, seeds: Sequence[int]) -> list[Any]:
    """Return what both learners make of a trace; None of one that cannot."""
    found: list[Any] = []
    for name, seed in zip(OF, seeds, strict=True):
        try:
            found.append(learner(name).fit(trace, printer, rng=np.random.default_rng(seed)))
        except PrintmendError:
            found.append(None)
    return found


def _behind(left_mm: Sequence[np.ndarray], judged: np.ndarray) -> np.ndarray:
    """Return by which logarithm the first learner's residuals [N, 2] are larger, of the judged ones [N, 2], a motor."""
    return np.array([_log_ratio([each[judged[:, k], k] for each in left_mm]) for k in range(2)])


def _log_ratio(sizes_mm: Sequence[np.ndarray]) -> float:
    """Return the logarithm of the ratio of two root mean squares, 0 where there is nothing."""
    if not len(sizes_mm[0]):
        return 0.0
    first, second = (np.log(max(float(np.sqrt(np.mean(each**2))), _LEAST_MM)) for each in sizes_mm)
    return float(first - second)


def _left_mm(model: Any, trace: Trace, seen: np.ndarray) -> np.ndarray:
    """Return what a model did not foresee [N, 2] of both motors; ``seen`` [N] rows say where a scan's origin was."""
    left = trace.measured_mm - _printed(model.mechanism, trace)
    if not trace.placed:
        left = left - left[seen].mean(axis=0)
    return np.asarray(model.printer.to_motor(left))


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
    """Return the machine whose motors' tables, and what the frame moves of each motor, are means of theirs."""
    printer, tables = machines[0].printer, []
    for k in range(2):
        grid = machines[0].transmissions[k]
        branches = np.zeros((2, len(grid.lower_mm)))
        for machine, weight in zip(machines, weights[k], strict=True):
            if weight > 0:
                branches += weight * np.stack(machine.transmissions[k].branches_mm(grid.motor_mm))
        tables.append(Transmission(grid.first_mm, grid.pitch_mm, branches[0], branches[1]))
    motors = sum(
        weight * printer.to_motor(machine.frame.coefficients_mm.T)
        for machine, weight in zip(machines, weights.T, strict=True)
    )
    mechanism = Mechanism(printer, (tables[0], tables[1]), Frame(printer.from_motor(motors).T))
    return WeighedModel(mechanism, weights)


WEIGHED = Weighed()
