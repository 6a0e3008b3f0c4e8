"""Stack the learner `weighed`: find the weights of its signs on drawn machines.

    .venv/bin/python benchmarks/stack_weighed.py --rows runs/stack.csv

The machines are of the kinds and prints of bench_meta.py, from a seed of their own. The grey box and `meta` learn from
each, and a way that they have not seen is judged, a motor at a time. The weights are those with which the mixture's
mean square error over the better learner's is least: the mean of its logarithm, and a little for the weights' squares.
Last come the weights for `STACKED`, and that mean without and with them: of all places, of those that lie within the
measured way of the motor, and of those beyond.
"""

import argparse
import itertools
import sys
from pathlib import Path

import numpy as np
from scipy.optimize import minimize

sys.path.insert(0, str(Path(__file__).parent))
from bench_meta import KINDS, WAYS, drawn
from printmend.machine.printing import print_from_home
from printmend_lab.meta.weighed import OF, STACKED, learned, share, signs
from runner import options_of, rows_of

SEED = 5
EXACT_MM2 = 1e-8  # a smaller mean square is as good
PARTS = ("all", "within", "beyond")
RIDGE = 1e-3  # cost of a weight's square, its sign in standard deviations


def main() -> None:
    options = options_of(__doc__, seed=SEED, samples=3)
    cases = [(kind, *way, number) for kind, way, number in itertools.product(KINDS, WAYS, range(options.samples))]
    found = [row for _, row in rows_of(compared, cases, options) if row]
    motors = [(row, k) for row in found for k in range(2)]
    told = np.array([[row[f"sign{k}{each}"] for each in range(3)] for row, k in motors])
    products = {
        part: np.array([[row[f"{name}{k}{part}"] for name in ("own", "both", "other")] for row, k in motors])
        for part in PARTS
    }
    squares, spread = products["all"], told.std(axis=0)

    def cost(weights: np.ndarray) -> float:
        return worse(share_of(told, weights / spread), squares) + RIDGE * float(weights @ weights)

    weights = minimize(cost, np.ones(3), method="Nelder-Mead", options={"maxiter": 4000}).x / spread
    print(f"weights of {len(told)} motors: {np.round(weights, 2).tolist()}")
    for name, shares in (
        (OF[0], np.zeros(len(told))), (OF[1], np.ones(len(told))), ("STACKED", share(told)),
        ("these", share_of(told, weights)),
    ):  # fmt: skip
        for part, each in products.items():
            asked = np.isfinite(each).all(axis=1)
            off = np.exp(worse(shares[asked], each[asked]) / 2)
            print(f"{name}, {part}: {off:.3f} times the better learner's error, {asked.sum()} motors")
    print(f"STACKED is {STACKED}")


def share_of(told: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return the weight of the second learner [N] by signs [N, 3] with some weights."""
    return np.asarray(1 / (1 + np.exp(-np.clip(told @ weights, -50, 50))))


def worse(shares: np.ndarray, squares: np.ndarray) -> float:
    """Return the mean logarithm of the mixtures' mean squares over the better learners', by the products [N, 3]."""
    own, both, other = squares.T
    mixed = (1 - shares) ** 2 * own + 2 * shares * (1 - shares) * both + shares**2 * other
    return float(np.log((mixed + EXACT_MM2) / (np.minimum(own, other) + EXACT_MM2)).mean())


def compared(options: argparse.Namespace, case: tuple[str, str, int, int]) -> dict[str, float]:
    """Return both motors' signs, and the mean products of both learners' errors; nothing where one cannot learn."""
    kind, shape, points, number = case
    trace, twin, asked = drawn(kind, shape, points, (options.seed, number))
    models = learned(trace, twin.printer, (0, 0))
    if any(one is None for one in models):
        return {}
    told, truth = signs(models, trace, twin.printer, (0, 0)), twin.follow(asked)[1:]
    own, other = (print_from_home(one.mechanism, asked[1:]) - truth for one in models)
    row = {f"sign{k}{each}": float(told[k, each]) for k in range(2) for each in range(3)}
    way, places = (twin.printer.to_motor(each) for each in (trace.commanded_mm[trace.measured_rows], asked[1:]))
    within = (places >= way.min(axis=0)) & (places <= way.max(axis=0))
    for part, chosen in zip(PARTS, (within | True, within, ~within), strict=True):
        for name, product in (("own", own * own), ("both", own * other), ("other", other * other)):
            for k in range(2):
                each = product[chosen[:, k], k]
                row[f"{name}{k}{part}"] = float(each.mean()) if len(each) else np.nan
    return row


if __name__ == "__main__":
    main()
