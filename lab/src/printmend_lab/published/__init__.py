"""The published learners: models without memory, from ticks on the lattice (physics.md §8).

`transitions` turns a layer's print into their rows, `increments` has their models, `ensemble` evaluates trees, and
`trees` fits them; that module alone needs LightGBM and scikit-learn, and is not imported here.
"""

from printmend_lab.published.increments import (
    AxisModel,
    Rolled,
    RolledLearner,
    Transitions,
    layer_trace,
    transitions_of,
)
from printmend_lab.published.trees import Ensemble, from_forest, from_lightgbm

__all__ = [
    "AxisModel",
    "Ensemble",
    "Rolled",
    "RolledLearner",
    "Transitions",
    "from_forest",
    "from_lightgbm",
    "layer_trace",
    "transitions_of",
]
