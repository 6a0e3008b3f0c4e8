"""The learner ``printmend``: the search over effects by which `printmend learn` learns, as a row among others."""

from dataclasses import dataclass

import numpy as np

from printmend.learn.learned import learn
from printmend.learn.mechanism_model import MechanismModel
from printmend.path import Trace
from printmend.printer import Printer


@dataclass(frozen=True)
class Engine:
    """Imagine with the likeliest machine. `learn` mends with no more of it than most of the drawn machines allow."""

    name: str = "printmend"

    def fit(self, trace: Trace, printer: Printer, *, rng: np.random.Generator) -> MechanismModel:
        """Learn from a trace. Raise `TraceError` where `printmend learn` would refuse it."""
        fit = learn(trace, printer, rng=rng).fit
        assert fit is not None  # the search makes one
        return MechanismModel(fit.mechanism)


LEARNERS = {"printmend": Engine()}
