"""Regression trees as arrays: read from LightGBM's own text or from a fitted forest, evaluated compiled."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from printmend.errors import ModelError
from printmend.path import frozen
from printmend_lab.published import kernels as kernels


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
