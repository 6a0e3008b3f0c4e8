"""Pulleys by their outlines: a few parameters, or random ones to learn a prior from.

`outline` has the families and the belt that they unwind, `fit` fits them to measured places, `choice` decides which
to believe, and `shapes` draws pulleys at random.
"""

from printmend_lab.greybox.pulley.choice import outlined, to_parameters
from printmend_lab.greybox.pulley.outline import ANY_PULLEY, OUTLINES, Outline

__all__ = ["ANY_PULLEY", "OUTLINES", "Outline", "outlined", "to_parameters"]
