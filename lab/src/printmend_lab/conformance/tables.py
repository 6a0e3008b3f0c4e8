"""What tables mean, slowly and obviously."""

import numpy as np

from printmend.machine import PlayTables
from printmend.printer import Printer
from printmend.protocols import IncrementTables, JointTables, Tables


def follow_tables(tables: Tables, printer: Printer, start: np.ndarray, controls: np.ndarray) -> np.ndarray:
    """Return the imagined positions [T + 1, 2] of controls [T, 2], straight from the tables' definitions."""
    nominal, position = np.array(start), np.array(start, float)
    belts = printer.to_motor(position).copy()
    out = [position.copy()]
    for c in controls:
        if isinstance(tables, PlayTables):
            nominal = nominal + c
            motors = printer.to_motor(nominal)
            for m, motor in enumerate(tables.motors):
                i = motors[m] - motor.first_step
                belts[m] = min(max(belts[m], motor.lower_steps[i]), motor.upper_steps[i])
            position = tables.bed.printed(belts)
        elif isinstance(tables, IncrementTables):
            step = [tables.displacement_steps[a][nominal[a], c[a] + tables.c_max] for a in range(2)]
            position = position + step
            nominal = np.clip(nominal + c, 0, printer.bed_steps)
        else:
            position = position + joint_step(tables, printer, nominal, c)
            nominal = np.clip(nominal + c, 0, printer.bed_steps)
        out.append(np.array(position))
    return np.array(out)


def joint_step(tables: JointTables, printer: Printer, nominal: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Return how far tables say that a control c [2] moves the carriage from a nominal place [2]: both axes at once."""

    def unit(n: np.ndarray, signs: np.ndarray) -> np.ndarray:
        return tables.unit_steps[tables.cells[0][n[0]], tables.cells[1][n[1]], signs[0] + 1, signs[1] + 1]

    if not tables.rolled:
        return unit(nominal, np.sign(c)) * np.abs(c)
    step = np.zeros(2)
    for tick in range(int(np.abs(c).max())):
        signs = np.sign(c) * (np.abs(c) > tick)
        step = step + unit(nominal, signs)
        nominal = np.clip(nominal + signs, 0, printer.bed_steps)
    return step
