"""own-learner: what each motor does, as a sum of waves over its turn. Replace the model by yours.

A model that knows nothing but `advance` is planned, too: tables are read off it where it remembers nothing and keeps
its axes apart, and a beam of machines is moved through it where it does not.
"""

from dataclasses import dataclass

import numpy as np

from printmend.path import Trace
from printmend.printer import Printer
from printmend.protocols import IncrementTables, State
from printmend_lab.control.check import increments_by_advance
from printmend_lab.published import transitions_of

WAVES = 6  # of a motor's turn
PRIOR = 1e-4  # how much a wave of a size of 1 costs, against a squared error in full steps


@dataclass(frozen=True, eq=False)
class Model:
    """Drive k moves by 1 + waves(its place) · ``weights[k]`` full steps a step; drives are the motors, or the axes."""

    printer: Printer
    weights: np.ndarray
    by_motors: bool

    def start(self, start_steps: np.ndarray) -> State:
        """Return the state [1] of a layer that starts at the lattice point ``start_steps`` [2]."""
        return State.at(start_steps)

    def advance(self, state: State, controls: np.ndarray) -> State:
        """Return the states [K] after the controls [K, 2] are applied to ``state`` [1] or [K]."""
        controls = np.asarray(controls, np.int64)
        nominal = np.broadcast_to(state.nominal_steps, controls.shape)
        places, moves = (self.printer.to_motor(each) if self.by_motors else each for each in (nominal, controls))
        gains = [1 + waves(places[:, k], self.printer, k) @ self.weights[k] for k in range(2)]
        moved = moves * np.stack(gains, axis=1)
        moved = self.printer.from_motor(moved) if self.by_motors else moved
        return State(np.clip(nominal + controls, 0, self.printer.bed_steps), state.position_steps + moved)

    def tabulate(self, start_steps: np.ndarray, *, c_max: int = 3) -> IncrementTables | None:
        """Return the model as tables, so that planning is compiled; None on a CoreXY, whose axes are coupled."""
        return increments_by_advance(self, start_steps, c_max=c_max)


def waves(places_steps: np.ndarray, printer: Printer, drive: int) -> np.ndarray:
    """Return a constant and `WAVES` waves of a motor's turn at places [N] of a drive: [N, 1 + 2·WAVES]."""
    angle = 2 * np.pi * places_steps[:, None] / printer.axes[drive].steps_per_turn * np.arange(1, WAVES + 1)
    return np.concatenate([np.ones((len(places_steps), 1)), np.cos(angle), np.sin(angle)], axis=1)


@dataclass(frozen=True)
class Learner:
    """Least squares over the trace's ticks; ``name`` is what tables call it."""

    name: str = "own-learner"

    def fit(self, trace: Trace, printer: Printer, *, rng: np.random.Generator) -> Model:
        """Learn from a trace: commanded way-points and where they were measured."""
        ticks = transitions_of(trace, printer)  # nominal place, control and displacement of each, in full steps
        places, moves, moved = ticks.nominal_steps, ticks.controls, ticks.displacement_steps
        by_axes, axes_left = solved(places, moves, moved, printer)
        places, moves, moved = (printer.to_motor(each) for each in (places, moves, moved))
        by_motors, motors_left = solved(places, moves, moved, printer)
        return Model(printer, by_motors, True) if motors_left < axes_left else Model(printer, by_axes, False)


def solved(places: np.ndarray, moves: np.ndarray, moved: np.ndarray, printer: Printer) -> tuple[np.ndarray, float]:
    """Return the weights [2, 1 + 2·WAVES] of two drives, and the sum of squares that they leave."""
    weights, left = [], 0.0
    for k in range(2):
        rows, beyond = waves(places[:, k], printer, k) * moves[:, k : k + 1], moved[:, k] - moves[:, k]
        normal = rows.T @ rows + PRIOR * len(rows) * np.eye(rows.shape[1])
        weights.append(np.linalg.solve(normal, rows.T @ beyond))
        left += float(((rows @ weights[k] - beyond) ** 2).sum())
    return np.array(weights), left


MINE = Learner()
