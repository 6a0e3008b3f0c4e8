"""The published tree learners, and one that knows that a pulley turns.

Features, targets and defaults are those of physics.md §8 and §8.1; a one-step prediction times |c| gives the larger
controls.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from printmend.path import Trace
from printmend.printer import Printer
from printmend.protocols import JointTables
from printmend_lab.published.ensemble import Ensemble, constant, from_forest, from_lightgbm
from printmend_lab.published.increments import AxisModel, JointUnits, RolledLearner
from printmend_lab.published.transitions import transitions_of

_SIGNS = np.array([-1.0, 0.0, 1.0])

Regress = Callable[[np.ndarray, np.ndarray, int], Ensemble]
"""Fit rows [N, F] to values [N, outputs] with a seed."""


def lightgbm(rows: np.ndarray, values: np.ndarray, seed: int) -> Ensemble:
    """Fit what a default ``LGBMRegressor`` fits to one output; the options only silence it and make it repeatable."""
    import lightgbm  # its regressor's face for scikit-learn would need that, too

    # The histograms' layout is otherwise chosen by timing them, and with it the order of the sums.
    options = {
        "objective": "regression", "seed": seed, "num_threads": 1, "verbosity": -1, "deterministic": True,
        "force_col_wise": True,
    }  # fmt: skip
    return from_lightgbm(lightgbm.train(options, lightgbm.Dataset(rows, values[:, 0]), 100).model_to_string())


def forest(rows: np.ndarray, values: np.ndarray, seed: int) -> Ensemble:
    """Fit a default ``RandomForestRegressor`` to one or more outputs."""
    from sklearn.ensemble import RandomForestRegressor

    model = RandomForestRegressor(random_state=seed, n_jobs=1)
    return from_forest(model.fit(rows, values if values.shape[1] > 1 else values[:, 0]))


def wrapped(nominal: np.ndarray, printer: Printer) -> np.ndarray:
    """Return positions [N, 2] modulo a turn of each axis's motor."""
    return nominal % np.array([printer.x.steps_per_turn, printer.y.steps_per_turn])


@dataclass(frozen=True, eq=False)
class JointTreeModel(JointUnits):
    """Trees over (x nominal, y nominal, sign cx, sign cy); together they have two outputs, the displacements.

    ``periodic``: positions are taken modulo a motor's turn.
    """

    printer: Printer
    ensembles: tuple[Ensemble, ...]
    periodic: bool = False

    def unit_displacement(self, nominal: np.ndarray, signs: np.ndarray) -> np.ndarray:
        """Return the predicted displacement [K, 2] of one tick; an axis at rest stays."""
        nominal = wrapped(nominal, self.printer) if self.periodic else nominal
        rows = np.concatenate([nominal, signs], axis=1)
        return np.concatenate([ensemble.predict(rows) for ensemble in self.ensembles], axis=1) * np.abs(signs)

    def tabulate(self, start_steps: np.ndarray, *, c_max: int = 3) -> JointTables:
        """Return the trees painted on the cells between their thresholds; made once a model."""
        return self._tables

    @cached_property
    def _tables(self) -> JointTables:
        cells, levels = [], []
        for axis, bed in enumerate(self.printer.bed_steps):
            edges = np.unique(np.concatenate([ensemble.edges(axis) for ensemble in self.ensembles]))
            position = np.arange(bed + 1)
            if self.periodic:
                position = position % self.printer.axes[axis].steps_per_turn
            # Cells that no lattice position reaches are left out; one position stands for each cell.
            _, first, cell = np.unique(np.searchsorted(edges, position), return_index=True, return_inverse=True)
            levels.append(position[first].astype(float))
            cells.append(cell.reshape(-1).astype(np.int32))
        shape = (len(levels[0]), len(levels[1]), 3, 3, 2)
        unit, output = np.zeros(shape), 0
        for ensemble in self.ensembles:
            ensemble.paint((levels[0], levels[1], _SIGNS, _SIGNS), output, unit)
            output += ensemble.outputs
        unit[:, :, 1, :, 0] = 0.0
        unit[:, :, :, 1, 1] = 0.0
        return JointTables((cells[0], cells[1]), unit)


@dataclass(frozen=True)
class JointTreeLearner:
    """Both axes from both axes: no assumption that the axes are independent (the paper's main row)."""

    name: str
    regress: Regress
    multiple_outputs: bool
    periodic: bool = False

    def fit(self, trace: Trace, printer: Printer, *, rng: np.random.Generator) -> JointTreeModel:
        """Fit one-tick displacements to (x, y, sign cx, sign cy). Raise `TraceError` for a trace without moves."""
        data = transitions_of(trace, printer)
        position = wrapped(data.nominal_steps, printer) if self.periodic else data.nominal_steps
        rows, values = np.concatenate([position, data.controls], axis=1), data.displacement_steps
        groups = [values] if self.multiple_outputs else [values[:, :1], values[:, 1:]]
        ensembles = [self.regress(rows, group, int(rng.integers(2**31))) for group in groups]
        return JointTreeModel(printer, tuple(ensembles), self.periodic)


@dataclass(frozen=True)
class AxisTreeLearner:
    """Each axis from itself: displacement × sign(c) over the nominal position, rows in which that axis moved."""

    name: str
    regress: Regress
    periodic: bool = False

    def fit(self, trace: Trace, printer: Printer, *, rng: np.random.Generator) -> AxisModel:
        """Fit a gain for each axis; an axis that never moved is taken as healthy. Raise `TraceError` without moves."""
        data = transitions_of(trace, printer)
        gains = []
        for axis, bed in enumerate(printer.bed_steps):
            seed = int(rng.integers(2**31))
            moves = data.controls[:, axis] != 0
            position, lattice = data.nominal_steps[moves, axis, None], np.arange(bed + 1.0)[:, None]
            values = data.displacement_steps[moves, axis, None] * data.controls[moves, axis, None]
            if self.periodic:
                turn = printer.axes[axis].steps_per_turn
                position, lattice = position % turn, lattice % turn
            ensemble = self.regress(position, values, seed) if moves.any() else constant(1.0)
            gains.append(ensemble.predict(lattice)[:, 0])
        return AxisModel(printer, (gains[0], gains[1]))


_LIGHTGBM = JointTreeLearner("lightgbm", lightgbm, multiple_outputs=False)
_LIGHTGBM_AXIS = AxisTreeLearner("lightgbm-axis", lightgbm)

LEARNERS = {
    learner.name: learner
    for learner in (
        _LIGHTGBM,
        _LIGHTGBM_AXIS,
        AxisTreeLearner("lightgbm-axis-periodic", lightgbm, periodic=True),
        RolledLearner("lightgbm-rolled", _LIGHTGBM),
        RolledLearner("lightgbm-axis-rolled", _LIGHTGBM_AXIS),
        JointTreeLearner("forest", forest, multiple_outputs=True, periodic=True),
        AxisTreeLearner("forest-axis", forest),
    )
}
