"""A machine that follows way-points in mm: what a file's moves print, motor by motor."""

import numpy as np

from printmend.machine.kernels import run
from printmend.machine.mechanism import Mechanism


def drive_belts(mechanism: Mechanism, motors_mm: np.ndarray, belts_mm: np.ndarray) -> np.ndarray:
    """Move the motors through ``motors_mm`` [N, M]; return their belts [N, M] mm.

    M is 2, or 3 with Z. The belts begin at ``belts_mm`` [M] and may be anywhere: the first row clips them into their
    play. Without a screw the third column is returned as it is.
    """
    belts = np.array(motors_mm, float)
    for k, table in enumerate(mechanism.motors[: belts.shape[1]]):
        out = np.empty(len(belts))
        run.follow(float(belts_mm[k]), *table.branches_mm(belts[:, k]), out)
        belts[:, k] = out
    return belts


def reach_bed(mechanism: Mechanism, motors_mm: np.ndarray, belts_mm: np.ndarray) -> np.ndarray:
    """Return the places [N, M] mm that belts [N, M] give the nozzle: through the frame, and pushed by the screw.

    The screw pushes by where its motor stands, ``motors_mm`` [N, M].
    """
    places = mechanism.bed.printed(belts_mm[:, :2])
    if belts_mm.shape[1] == 2:
        return places
    if mechanism.screw is not None:
        places = places + mechanism.screw.wobble_at_mm(motors_mm[:, 2])
    return np.concatenate([places, belts_mm[:, 2:]], axis=1)


def print_path(mechanism: Mechanism, motors_mm: np.ndarray, belts_mm: np.ndarray) -> np.ndarray:
    """Return the places [N, M] mm that motor positions [N, M] mm print, from belts that begin at ``belts_mm`` [M]."""
    return reach_bed(mechanism, motors_mm, drive_belts(mechanism, motors_mm, belts_mm))


def print_from_home(mechanism: Mechanism, places_mm: np.ndarray) -> np.ndarray:
    """Return where a machine prints commanded places [N, 2] mm, with heights [N, 3], one after the other from home.

    The machine's origin is taken as it is: a learned one gives bed positions.
    """
    printer, axes = mechanism.printer, places_mm.shape[1]
    home_mm = np.array([*printer.home_mm, printer.z.home_mm])
    motors_mm = np.concatenate([home_mm[None, :axes], places_mm])
    motors_mm[:, :2] = printer.to_motor(motors_mm[:, :2])
    at_home_mm = np.array([*mechanism.bed.wanted(home_mm[:2]), home_mm[2]])
    return print_path(mechanism, motors_mm, at_home_mm[:axes])[1:]
