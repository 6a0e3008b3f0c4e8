"""The third axis of the twin: how high the screw lifts, and where it pushes the nozzle meanwhile."""

import numpy as np

from printmend.errors import InputError
from printmend.mechanism import ScrewDrive
from printmend.printer import Printer
from printmend.twin import kernels


def run_height(
    screw: ScrewDrive | None, printer: Printer, controls: np.ndarray, start: int
) -> tuple[np.ndarray, np.ndarray]:
    """Print the Z column [T] of lattice controls from full step ``start``, its play centred.

    Returns the height [T + 1] in Z's full steps and the push [T + 1, 2] in full steps of x and y; both are as
    commanded (start, and none) at the start. Raises `InputError` where the screw would leave its tables.
    """
    z = printer.z
    nominal = start + np.concatenate([[0], np.cumsum(controls)])
    if screw is None:
        return nominal.astype(float), np.zeros((len(nominal), 2))
    table = screw.transmission
    first = round((table.first_mm - z.min_mm) / z.mm_per_step)
    index = nominal - first
    entries = (len(table.lower_mm) - 1) // z.microsteps + 1
    if index.min() < 0 or index.max() >= entries:
        raise InputError(
            "motor z", wanted=f"heights from {z.min_mm:g} to {z.max_mm:g} mm", came="controls that leave the axis",
            todo="check the start and the controls",
        )  # fmt: skip
    # Errors, not positions, go through the change of units: a healthy screw stays exact.
    motor_mm = table.motor_mm[:: z.microsteps]
    lattice = first + np.arange(entries)
    lower, upper = ((branch[:: z.microsteps] - motor_mm) / z.mm_per_step for branch in (table.lower_mm, table.upper_mm))
    shift = -(lower[index[0]] + upper[index[0]]) / 2
    height = np.empty(len(index))
    kernels.run_play(index, float(start), lattice + (lower + shift), lattice + (upper + shift), height)
    wobble = screw.wobble_mm[:: z.microsteps][index]
    return height, (wobble - wobble[0]) / np.array(printer.mm_per_step)


def follow_height(
    screw: ScrewDrive | None, printer: Printer, waypoints_mm: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Follow heights [N] mm with a homed screw; return the height [N] and the push [N, 2], mm."""
    if screw is None:
        return waypoints_mm, np.zeros((len(waypoints_mm), 2))
    z, first_mm = printer.z, screw.transmission.first_mm
    microstep_mm = z.mm_per_step / z.microsteps
    at_mm = first_mm + np.rint((waypoints_mm - first_mm) / microstep_mm) * microstep_mm
    lower, upper = screw.transmission.branches_mm(at_mm)
    home = lower if z.home_direction > 0 else upper
    height = np.empty(len(at_mm))
    kernels.run_play(np.arange(len(at_mm)), home[0], lower, upper, height)
    return height, screw.wobble_at_mm(at_mm)
