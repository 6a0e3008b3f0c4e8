"""The hybrid: the grey box, completed by what its residual shows where no physical part explains it.

`hybrid` is the learner, `residual` its learners of residuals, `gains` those of the published simulator's world, and
`continued` says how tables go on beyond what was seen.
"""

from printmend_lab.hybrid.hybrid import Hybrid, HybridModel, learned_gains, with_residuals

__all__ = ["Hybrid", "HybridModel", "learned_gains", "with_residuals"]
