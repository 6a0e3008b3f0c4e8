"""From a trace to a model of the machine that printed it.

The names here give learners by name. Each learner is a package of its own: `greybox` is a machine as short physical
series, put together from what `identify` finds of its parts; `prior` completes a pulley of which less than a turn was
seen, `hybrid` adds what no part explains, `meta` was taught to learn; `space` adds the Z screw. The paper's learners
have a room of their own, `published`.
"""

from printmend.learn.registry import ORACLE, check_model_name, fit, fitted, learner, learner_names, model_names

__all__ = ["ORACLE", "check_model_name", "fit", "fitted", "learner", "learner_names", "model_names"]
