"""The third axis of the twin: how high the screw lifts, and where it pushes the nozzle meanwhile."""

from dataclasses import dataclass

import numpy as np

from printmend.errors import InputError
from printmend.machine.mechanism import ScrewDrive
from printmend.path import frozen
from printmend.printer import Printer
from printmend.twin import kernels


@dataclass(frozen=True, eq=False)
class HeightTables:
    """A Z screw on the lattice, in full steps, anchored at a start: the height there, the nut at rest, no push.

    height ← clip(height, lower[i], upper[i]) with i = the commanded step − ``first_step``; ``push_steps`` [N, 2] is
    where the screw then pushes the nozzle, in full steps of x and y.
    """

    first_step: int
    lower_steps: np.ndarray
    upper_steps: np.ndarray
    push_steps: np.ndarray

    def __post_init__(self) -> None:
        for name in ("lower_steps", "upper_steps", "push_steps"):
            object.__setattr__(self, name, frozen(getattr(self, name)))


def height_tables(screw: ScrewDrive, printer: Printer, start: int) -> HeightTables:
    """Return a screw on the lattice, anchored at full step ``start`` of Z. Raise `InputError` where that is off Z."""
    z, table = printer.z, screw.transmission
    first = round((table.first_mm - z.min_mm) / z.mm_per_step)
    # Errors, not positions, go through the change of units: a healthy screw stays exact.
    motor_mm = table.motor_mm[:: z.microsteps]
    if not 0 <= start - first < len(motor_mm):
        raise _off_axis(printer)
    lattice = first + np.arange(len(motor_mm))
    lower, upper = ((branch[:: z.microsteps] - motor_mm) / z.mm_per_step for branch in (table.lower_mm, table.upper_mm))
    shift = -((1 - screw.rest_share) * lower[start - first] + screw.rest_share * upper[start - first])
    wobble = screw.wobble_mm[:: z.microsteps]
    push = (wobble - wobble[start - first]) / np.array(printer.mm_per_step)
    return HeightTables(first, lattice + (lower + shift), lattice + (upper + shift), push)


def run_height(
    screw: ScrewDrive | None, printer: Printer, controls: np.ndarray, start: int
) -> tuple[np.ndarray, np.ndarray]:
    """Print the Z column [T] of lattice controls from full step ``start``, its play centred.

    Returns the height [T + 1] in Z's full steps and the push [T + 1, 2] in full steps of x and y; both are as
    commanded (start, and none) at the start. Raises `InputError` where the screw would leave its tables.
    """
    nominal = start + np.concatenate([[0], np.cumsum(controls)])
    if screw is None:
        return nominal.astype(float), np.zeros((len(nominal), 2))
    tables = height_tables(screw, printer, start)
    index = nominal - tables.first_step
    if index.min() < 0 or index.max() >= len(tables.lower_steps):
        raise _off_axis(printer)
    height = np.empty(len(index))
    kernels.run_play(index, float(start), tables.lower_steps, tables.upper_steps, height)
    return height, tables.push_steps[index]


def _off_axis(printer: Printer) -> InputError:
    return InputError(
        "motor z", wanted=f"heights from {printer.z.min_mm:g} to {printer.z.max_mm:g} mm",
        came="controls that leave the axis", todo="check the start and the controls",
    )  # fmt: skip


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
