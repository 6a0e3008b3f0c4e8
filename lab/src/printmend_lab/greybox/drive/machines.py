"""Machines that a print of less than a turn allows: the rest of a pulley that nobody saw is no bell curve.

It is mostly round and now and then has a flat, or it may be of one kind or another. So a fit of such a motor keeps
machines, drawn from all that is possible, each as likely.
"""

import numpy as np

MACHINES = 48  # number of machines that are drawn
SEED = 17  # the same measurement always gives the same machines


def drawn_about(covariance: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Draw ``count`` deviations [P, count] with a covariance [P, P]."""
    values, axes = np.linalg.eigh(covariance)
    return np.asarray((axes * np.sqrt(np.maximum(values, 0.0))) @ rng.standard_normal((len(values), count)))
