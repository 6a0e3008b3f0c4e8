"""From a trace to a model of the machine that printed it.

The names here give learners by name. `learn` searches for effects (`printmend.infer`) and needs none of them; the lab
brings its own by entry points: a grey box of each motor, and those of the paper.
"""

from printmend.learn.registry import ORACLE, check_model_name, fit, fitted, learner, learner_names, model_names

__all__ = ["ORACLE", "check_model_name", "fit", "fitted", "learner", "learner_names", "model_names"]
