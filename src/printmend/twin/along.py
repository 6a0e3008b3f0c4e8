"""Effects along a commanded path that no machine's tables hold: columns times sizes, row by row."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from printmend.effects import Scene, columns_of, places_of
from printmend.effects.sized import Sized, guided, scene_of_printer
from printmend.machine import Contacts, Mechanism, contacts_from
from printmend.path import Trace


def added_mm(parts: Sequence[Sized], trace: Trace, scene: Scene, contacts: Contacts, *, before: int = 0) -> np.ndarray:
    """Return what effects add [N, 2] mm to the rows of a print with these contacts, after ``before`` prints."""
    bed_mm = scene.printer.from_motor(contacts.belt_mm)
    places = places_of(trace, scene, contacts.row, contacts.side, bed_mm)
    places = guided(replace(places, done=places.done + before), trace.commanded_mm, parts)
    moved = np.zeros((len(trace), 2))
    for part in parts:
        moved = moved + columns_of(part.effect, places, part.where, part.shape, scene) @ part.sizes_mm
    return moved


def moved_mm(
    mechanism: Mechanism,
    parts: Sequence[Sized],
    path_mm: np.ndarray,
    *,
    motors_mm: np.ndarray | None = None,
    from_home: bool = False,
    before: int = 0,
) -> np.ndarray:
    """Return what effects add [N, 2] mm along a path [N, 2] mm of the whole print.

    ``motors_mm`` [N, ≥ 2] is where the motors stop; without it they stop exactly on the path. With ``from_home`` the
    path begins at the end stops, where each belt is engaged as its motor came; otherwise each belt rests in the middle
    of its play. ``before`` is the number of prints that have worn the machine.
    """
    printer = mechanism.printer
    way_mm = float(np.hypot(*np.diff(path_mm, axis=0).T).sum())
    scene = scene_of_printer(printer, max(way_mm, 1e-9))
    motors_mm = printer.to_motor(path_mm) if motors_mm is None else motors_mm[:, :2]
    ways = [printer.motor_home_direction(motor) if from_home else 0 for motor in range(2)]
    contacts = contacts_from(mechanism, motors_mm, ways)
    return added_mm(
        parts, Trace(path_mm, np.full(path_mm.shape, np.nan), homed=from_home), scene, contacts, before=before
    )
