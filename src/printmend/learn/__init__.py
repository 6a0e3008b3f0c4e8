"""From a trace to a model of the machine that printed it.

The names here give learners by name. Each learner is a package of its own: `drive` learns one motor, `greybox` a
machine as short physical series, `pulley` and `prior` complete a pulley of which less than a turn was seen, `hybrid`
adds what no part explains, `meta` was taught to learn, `published` are the paper's; `space` adds the Z screw.
"""

from printmend.learn.registry import ORACLE, check_model_name, fit, fitted, learner, learner_names, model_names

__all__ = ["ORACLE", "check_model_name", "fit", "fitted", "learner", "learner_names", "model_names"]
