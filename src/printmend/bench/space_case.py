"""A case of three axes in the families table: a bad Z screw, alone or with broken belts.

The body is a tower as many turns of the screw high as it is turns of a motor across. Its whole print is measured; then
another tower is planned and printed. Errors are distances in space, in full steps of X.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from printmend.body.space import SpacePath, space_path
from printmend.printer import Printer
from printmend.protocols import SpaceModel

if TYPE_CHECKING:  # the twin needs numba, which workers import only after they are told to use one thread
    from printmend.twin import Twin

# Z hops over what was printed: only there does Z turn back.
HOP_MM = 0.4


@dataclass(frozen=True, eq=False)
class SpacePrints:
    """The tower to learn from, as it was printed [T + 1, 3] steps, and the tower to print."""

    printer: Printer
    twin: "Twin"
    first: SpacePath
    printed: np.ndarray
    second: SpacePath


def space_prints(twin: "Twin", coverage: float, turn_mm: float, towers: Sequence[np.random.Generator]) -> SpacePrints:
    """Draw two towers, each with its generator, and print the first; jumps spoil that one only."""
    from printmend.bench.drawn_body import drawn_tower
    from printmend.twin import Twin

    printer = twin.printer
    paths = []
    for rng in towers:
        tower = drawn_tower(rng, printer, size_mm=coverage * turn_mm, height_mm=coverage * printer.z.mm_per_turn)
        paths.append(space_path(tower, printer, hop_mm=HOP_MM))
    first, second = paths
    return SpacePrints(printer, Twin(twin.mechanism), first, twin.run(first.controls, first.start_steps), second)


def learned(
    prints: SpacePrints, learner: str, noise: np.ndarray, noise_mm: float, rng: np.random.Generator
) -> tuple[SpaceModel, float]:
    """Learn from the first tower, ``noise`` [T + 1, 3] times ``noise_mm`` added; return the model and the seconds."""
    from printmend.learn.space import fit_space, space_trace

    pitch_mm = np.array([axis.mm_per_step for axis in prints.printer.axes])
    measured = prints.printed + noise * noise_mm / pitch_mm
    trace = space_trace(prints.first.nominal_steps, measured, prints.printer)
    begun = time.perf_counter()
    model = fit_space(learner, trace, prints.printer, rng=rng, truth=prints.twin.mechanism)
    return model, time.perf_counter() - begun


def space_rmse_steps(prints: SpacePrints, printed: np.ndarray) -> float:
    """Return the RMSE in space of a print [T + 1, 3] of the second tower, in full steps of X."""
    pitch_mm = np.array([axis.mm_per_step for axis in prints.printer.axes])
    missed = (printed - prints.second.nominal_steps) * (pitch_mm / prints.printer.x.mm_per_step)
    return float(np.sqrt((missed**2).sum(axis=1).mean()))
