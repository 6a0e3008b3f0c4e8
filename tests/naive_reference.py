"""The published evaluation, word for word after the rules in the design notes (physics.md §8.1), slow and obvious.

It shares nothing with printmend: it reads the CSV and the MATLAB file itself and loops over points and controls.
"""

from itertools import product
from pathlib import Path

import numpy as np
from scipy.io import loadmat

BED = 1100


def displacement(nominal: float, control: int, gains: np.ndarray) -> float:
    x = float(nominal)
    for _ in range(abs(int(control))):
        x = x + np.sign(control) * gains[round(x) - 1]
        x = min(max(x, 0.0), 1099.0)
    return x - nominal


def on_bed(point: np.ndarray) -> np.ndarray:
    return np.minimum(np.maximum(point, 0), BED)


def plan(targets: np.ndarray, start: np.ndarray, predict) -> list[tuple[int, int]]:
    imagined, nominal = np.array(start, float), np.array(start, float)
    chosen = []
    for target in targets:
        best, best_distance, best_point = None, np.inf, None
        for control in product(range(-3, 4), range(-3, 4)):
            point = imagined + predict(nominal, control)
            distance = (point[0] - target[0]) ** 2 + (point[1] - target[1]) ** 2
            if distance < best_distance:
                best, best_distance, best_point = control, distance, point
        chosen.append(best)
        imagined = best_point
        nominal = on_bed(nominal + np.array(best))
    return chosen


def simulate(
    controls: list[tuple[int, int]], start: np.ndarray, gains_x: np.ndarray, gains_y: np.ndarray
) -> np.ndarray:
    printed, nominal = np.array(start, float), np.array(start, float)
    points = [printed]
    for cx, cy in controls:
        moved = np.array([displacement(nominal[0], cx, gains_x), displacement(nominal[1], cy, gains_y)])
        printed = on_bed(printed + moved)
        nominal = on_bed(nominal + np.array([cx, cy]))
        points.append(printed)
    return np.array(points)


def body_rmse(csv: Path, all_data: np.ndarray, model: str) -> float:
    """Return the error of 'naive' or 'oracle' on a body with at most three layers, so that all are drawn."""
    table = np.genfromtxt(csv, delimiter=",")
    layer_ids = np.unique(table[:, 3])
    assert len(layer_ids) <= 3
    squares = []
    for layer_id in layer_ids:
        rows = table[table[:, 3] == layer_id]
        gains_x, gains_y = all_data[int(rows[0, 1]) - 1], all_data[int(rows[0, 2]) - 1]
        start, targets = rows[0, [4, 9]], rows[:, [7, 12]]

        def oracle(nominal, control, gains_x=gains_x, gains_y=gains_y):
            return np.array(
                [displacement(nominal[0], control[0], gains_x), displacement(nominal[1], control[1], gains_y)]
            )

        predict = {"naive": lambda nominal, control: np.array(control, float), "oracle": oracle}[model]
        printed = simulate(plan(targets, start, predict), start, gains_x, gains_y)
        ideal = np.vstack([start, targets])
        squares.append(((printed - ideal) ** 2).sum(axis=1))
    return float(np.sqrt(np.concatenate(squares).mean()))


def published_results(folder: Path, model: str) -> dict[str, float]:
    """Return each body's error by its CSV's name."""
    all_data = loadmat(folder / "simulation" / "add_dudw_data.mat")["all_data"]
    return {csv.stem: body_rmse(csv, all_data, model) for csv in sorted((folder / "dataset").glob("*.csv"))}
