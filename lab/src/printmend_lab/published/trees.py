"""The published tree learners, and one that knows that a pulley turns.

Features, targets and defaults are those of physics.md §8 and §8.1; a one-step prediction times |c| gives the larger
controls.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from printmend.errors import ModelError
from printmend.path import Trace, frozen
from printmend.printer import Printer
from printmend.protocols import JointTables
from printmend_lab.published import kernels
from printmend_lab.published.increments import AxisModel, JointUnits, RolledLearner, transitions_of

# Regression trees as arrays: read from LightGBM's own text or from a fitted forest, evaluated compiled.


@dataclass(frozen=True, eq=False)
class Ensemble:
    """Trees whose predictions are added in order, then divided by ``divisor`` (1 for boosting, the count for a forest).

    All trees share the arrays over nodes: ``feature`` (−1 at leaves), ``threshold`` (≤ goes left), ``left``, ``right``
    (always larger than the node itself), ``value`` [nodes, outputs]; ``roots`` [trees].
    """

    feature: np.ndarray
    threshold: np.ndarray
    left: np.ndarray
    right: np.ndarray
    value: np.ndarray
    roots: np.ndarray
    divisor: float = 1.0

    def __post_init__(self) -> None:
        for name in ("feature", "left", "right", "roots"):
            object.__setattr__(self, name, frozen(np.asarray(getattr(self, name), np.int64)))
        for name in ("threshold", "value"):
            object.__setattr__(self, name, frozen(np.asarray(getattr(self, name), float)))
        nodes = np.arange(len(self.feature))
        inner = self.feature >= 0
        for child in (self.left, self.right):
            if ((child <= nodes) | (child >= len(nodes)))[inner].any():
                raise ModelError(
                    "trees", wanted="children after their parents", came="others", todo="learn the model again"
                )

    @property
    def outputs(self) -> int:
        return self.value.shape[1]

    def predict(self, rows: np.ndarray) -> np.ndarray:
        """Return the predictions [N, outputs] at rows [N, features], equal to the library's own to the last bit."""
        rows = np.ascontiguousarray(rows, float)
        out = np.zeros((len(rows), self.outputs))
        kernels.predict(rows, self.feature, self.threshold, self.left, self.right, self.value, self.roots, out)
        return out if self.divisor == 1.0 else out / self.divisor

    def edges(self, feature: int) -> np.ndarray:
        """Return the sorted distinct thresholds of one feature: between them the prediction is constant."""
        return np.unique(self.threshold[self.feature == feature])

    def paint(self, levels: tuple[np.ndarray, ...], first_output: int, cells: np.ndarray) -> None:
        """Fill ``cells`` [Bx, By, 3, 3, ·] with the predictions at every combination of the features' ``levels``."""
        split = np.zeros(len(self.feature), np.int64)
        for feature, level in enumerate(levels):
            mine = self.feature == feature
            split[mine] = np.searchsorted(level, self.threshold[mine], side="right")
        kernels.paint(self.feature, split, self.left, self.right, self.value, self.roots, first_output, cells)
        if self.divisor != 1.0:
            cells[..., first_output : first_output + self.outputs] /= self.divisor


def constant(value: float) -> Ensemble:
    """Return the ensemble that predicts ``value`` everywhere."""
    leaf = np.array([-1])
    return Ensemble(leaf, np.zeros(1), leaf, leaf, np.array([[value]]), np.zeros(1, np.int64))


def from_lightgbm(text: str) -> Ensemble:
    """Read LightGBM's model text (``Booster.model_to_string``). Raise `ModelError` where it is not one we can follow.

    An inner node i of a tree has the index i, a leaf k the index inner nodes + k; LightGBM writes leaves as ~k.
    """
    parts: dict[str, list[np.ndarray]] = {name: [] for name in ("feature", "threshold", "left", "right", "value")}
    roots, nodes = [], 0
    for block in text.split("\nTree=")[1:]:
        fields = dict(line.split("=", 1) for line in block.split("\n\n")[0].split("\n") if "=" in line)
        try:
            leaf = _numbers(fields, "leaf_value")
            inner = len(leaf) - 1
            if int(fields["num_leaves"]) != inner + 1 or fields.get("is_linear", "0") != "0":
                raise ValueError("num_leaves")
            columns = [_numbers(fields, name)[:inner] for name in ("split_feature", "threshold", "left_child")]
            columns.append(_numbers(fields, "right_child")[:inner])
            if any(len(column) != inner for column in columns):
                raise ValueError("lengths")
            # Bit 0: a categorical split. Bits 2–3: zero as missing (1); both would need other rules than ≤.
            kinds = _numbers(fields, "decision_type").astype(int)
            if (kinds & 1).any() or (((kinds >> 2) & 3) == 1).any():
                raise ValueError("decision_type")
        except (KeyError, ValueError) as error:
            raise ModelError(
                "LightGBM model",
                wanted="plain numerical trees",
                came=f"a tree without ({error})",
                todo="learn the model again",
            ) from None
        children = [np.where(child < 0, inner + ~child, child) for child in np.asarray(columns[2:], np.int64)]
        blank = np.full(inner + 1, -1)
        parts["feature"] += [columns[0].astype(np.int64), blank]
        parts["threshold"] += [columns[1], np.zeros(inner + 1)]
        parts["left"] += [children[0] + nodes, blank]
        parts["right"] += [children[1] + nodes, blank]
        parts["value"] += [np.zeros(inner), leaf]
        roots.append(nodes)
        nodes += 2 * inner + 1
    if not roots:
        raise ModelError("LightGBM model", wanted="trees", came="none", todo="learn the model again")
    parts["value"] = [column[:, None] for column in parts["value"]]
    return _joined(parts, roots, 1.0)


def _numbers(fields: dict[str, str], name: str) -> np.ndarray:
    return np.array([float(word) for word in fields.get(name, "").split()])


def from_forest(forest: Any) -> Ensemble:
    """Read a fitted scikit-learn forest of one or more outputs."""
    parts: dict[str, list[np.ndarray]] = {name: [] for name in ("feature", "threshold", "left", "right", "value")}
    roots, nodes = [], 0
    for estimator in forest.estimators_:
        tree = estimator.tree_
        leaf = tree.children_left < 0
        parts["feature"].append(np.where(leaf, -1, tree.feature))
        parts["threshold"].append(tree.threshold)
        parts["left"].append(np.where(leaf, -1, tree.children_left + nodes))
        parts["right"].append(np.where(leaf, -1, tree.children_right + nodes))
        parts["value"].append(tree.value[:, :, 0])
        roots.append(nodes)
        nodes += tree.node_count
    return _joined(parts, roots, float(len(roots)))


def _joined(parts: dict[str, list[np.ndarray]], roots: list[int], divisor: float) -> Ensemble:
    feature, threshold, left, right, value = (
        np.concatenate(parts[name]) for name in ("feature", "threshold", "left", "right", "value")
    )
    return Ensemble(feature, threshold, left, right, value, np.array(roots), divisor)


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
