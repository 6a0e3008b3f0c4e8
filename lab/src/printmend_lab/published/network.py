"""The paper's model M as a plain neural network: inputs and outputs are those of the joint trees.

It learns what a tick does beyond what was commanded, as a line would do that alone: a network that must also learn
that a step is a step drifts by more than the fault. A row of a table by its place,
`printmend_lab.published.network:NETWORK`.
"""

import warnings

import numpy as np
from threadpoolctl import threadpool_limits

from printmend_lab.published.neighbours import JointLearner, Predict

WIDTHS = (64, 64)
UPDATES, BATCH, RATE = 4000, 256, 3e-3


def network(rows: np.ndarray, values: np.ndarray) -> Predict:
    """Fit hidden layers of ``WIDTHS`` (tanh) by Adam to rows [N, 4] and displacements [N, 2]; all standardised."""
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.neural_network import MLPRegressor

    beyond = values - rows[:, 2:]
    middle, spread = rows.mean(axis=0), np.maximum(rows.std(axis=0), 1e-9)
    centre, size = beyond.mean(axis=0), beyond.std(axis=0)
    model = MLPRegressor(
        hidden_layer_sizes=WIDTHS, activation="tanh", batch_size=min(BATCH, len(rows)), learning_rate_init=RATE,
        max_iter=max(1, UPDATES * BATCH // len(rows)), n_iter_no_change=UPDATES, random_state=0,
    )  # fmt: skip
    with warnings.catch_warnings(), threadpool_limits(1, user_api="blas"):
        warnings.simplefilter("ignore", ConvergenceWarning)  # it ends after its updates
        model.fit((rows - middle) / spread, (beyond - centre) / np.maximum(size, 1e-12))
    weights, offsets = model.coefs_, model.intercepts_

    def predict(asked: np.ndarray) -> np.ndarray:
        hidden = (asked - middle) / spread
        for weight, offset in zip(weights[:-1], offsets[:-1], strict=True):
            hidden = np.tanh(hidden @ weight + offset)
        return np.asarray(asked[:, 2:] + centre + size * (hidden @ weights[-1] + offsets[-1]))

    return predict


NETWORK = JointLearner("network", network)
