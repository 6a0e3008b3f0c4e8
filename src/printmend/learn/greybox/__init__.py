"""The grey box: a machine as short series with physical names, and no more of them than a trace supports.

`greybox` is the learner, `model` what it makes, `rows` a trace as either motor sees it, and `previous` a saved model as
the prior of the next one.
"""

from printmend.learn.greybox.greybox import Greybox, fit_greybox
from printmend.learn.greybox.model import GreyboxModel, LearnedDrive, model_of
from printmend.learn.greybox.previous import Drift, Remembered, aged, remember
from printmend.learn.greybox.rows import motor_rows, with_belts

__all__ = [
    "Drift",
    "Greybox",
    "GreyboxModel",
    "LearnedDrive",
    "Remembered",
    "aged",
    "fit_greybox",
    "model_of",
    "motor_rows",
    "remember",
    "with_belts",
]
