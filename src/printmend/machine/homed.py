"""A machine whose motors begin elsewhere: all that repeats with their turns sits at other places of the bed."""

from dataclasses import replace

import numpy as np

from printmend.machine.mechanism import Mechanism, Transmission


def homed_again(mechanism: Mechanism, by_mm: np.ndarray) -> Mechanism:
    """Return a machine whose motors [2] homed ``by_mm`` of belt further on than before."""

    def moved(table: Transmission, by: float) -> Transmission:
        lower, upper = table.branches_mm(table.motor_mm + by)
        return replace(table, lower_mm=lower, upper_mm=upper)

    a, b = (moved(table, float(by)) for table, by in zip(mechanism.transmissions, by_mm, strict=True))
    return replace(mechanism, transmissions=(a, b))
