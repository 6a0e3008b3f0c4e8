"""From a trace to a model of the machine that printed it.

This package finds learners by name. `learn` itself searches for effects (`printmend.infer`) and needs none of them; the
lab adds the grey box and the paper's learners by entry points.
"""

from printmend.learn.registry import ORACLE, check_model_name, fit, fitted, learner, learner_names, model_names

__all__ = ["ORACLE", "check_model_name", "fit", "fitted", "learner", "learner_names", "model_names"]
