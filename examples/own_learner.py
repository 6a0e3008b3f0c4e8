r"""A learner of one's own in twenty lines: each motor's scale and play, by least squares.

printmend conformance own_learner:MINE          # in this folder: does it keep what a learner must?
printmend bench table1 --bodies generated:4 --families pulley-play \
    --models naive,greybox+optimal,own_learner:MINE+optimal

Without +optimal a row is planned by the paper's Algorithm 1, which stands still where play swallows a step.
"""

from dataclasses import dataclass, replace

import numpy as np

from printmend.learn.mechanism_model import MechanismModel
from printmend.machine.mechanism import Mechanism, healthy_mechanism


@dataclass(frozen=True)
class ScaleAndPlay:
    """measured = scale · commanded − half the play · direction + offset, in each motor's own coordinate."""

    name: str = "scale and play"

    def fit(self, trace, printer, *, rng):
        commanded_mm, measured_mm = printer.to_motor(trace.commanded_mm), printer.to_motor(trace.measured_mm)
        known, tables = trace.measured_rows, []
        for motor, healthy in enumerate(healthy_mechanism(printer).transmissions):
            m = commanded_mm[:, motor]
            direction = np.sign(np.diff(m, prepend=m[0]))
            moved = np.maximum.accumulate(np.where(direction != 0, np.arange(len(m)), 0))  # the row of the last motion
            columns = np.column_stack([m, -direction[moved], np.ones(len(m))])[known]
            scale, half_mm, offset_mm = np.linalg.lstsq(columns, measured_mm[known, motor], rcond=None)[0]
            middle_mm = scale * healthy.motor_mm + offset_mm
            half_mm = max(half_mm, 0.0)
            tables.append(replace(healthy, lower_mm=middle_mm - half_mm, upper_mm=middle_mm + half_mm))
        return MechanismModel(Mechanism(printer, (tables[0], tables[1])))


MINE = ScaleAndPlay()
