"""A learned prior over pulleys: what the unseen part of a turn is like, from pulleys of all kinds.

`prior` is the learner, `mixture` the prior and its posterior, `training` makes the weights that are shipped.
"""

from printmend_lab.prior.mixture import Mixture, parse_weights, shape_posterior, shipped
from printmend_lab.prior.prior import PriorLearner

__all__ = ["Mixture", "PriorLearner", "parse_weights", "shape_posterior", "shipped"]
