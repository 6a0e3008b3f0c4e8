"""The grey box: a machine as short series with physical names, and no more of them than a trace supports.

`greybox` is the learner, `model` what it makes, and `rows` a trace as either motor sees it.
"""

from printmend_lab.greybox.greybox import Greybox, fit_greybox, motor_rows, with_belts
from printmend_lab.greybox.model import GreyboxModel, LearnedDrive, model_of

__all__ = [
    "Greybox",
    "GreyboxModel",
    "LearnedDrive",
    "fit_greybox",
    "model_of",
    "motor_rows",
    "with_belts",
]
