"""The smooth errors of one belt as one course: a scale that changes along it, and what has no pattern.

These and a wrong scale may stand for parts of each other; a measurement tells little more than their sum. So each of
them is told of that sum: its slope, its bend beside that, and what remains beside those that are told.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from printmend.effects.effect import Scene, belt_places
from printmend.effects.words import Found, along_motor_mm, those_of

SMOOTH = ("bend", "uneven")


def course_of(found: Found, beside: Sequence[Found], scene: Scene) -> Found:
    """Return an effect with the smooth course of its belt along what was seen [N] as its sizes: of what acts, and of
    each drawn machine."""
    motor = found.where
    places = belt_places(motor, along_motor_mm(scene, motor), 1.0)
    acts_mm, draws_mm = np.zeros(len(places)), np.zeros((len(places), found.draws_mm.shape[1]))
    for each in (each for name in SMOOTH for each in those_of(name, beside, motor, acts=False)):
        moved = np.moveaxis(each.columns(places, scene), 2, 1)
        belt = np.asarray(scene.printer.to_motor(moved)[:, :, motor])
        acts_mm = acts_mm + belt @ each.sizes_mm * each.acts
        draws_mm = draws_mm + belt @ each.draws_mm
    return replace(found, sizes_mm=acts_mm, draws_mm=draws_mm)


def slope_of(scene: Scene, motor: int) -> np.ndarray:
    """Return what makes of a course [N] its slope, in mm per 100 mm."""
    return np.asarray(np.linalg.pinv(_powers(scene, motor, 1))[1])


def fit_of(scene: Scene, motor: int, degree: int) -> np.ndarray:
    """Return what makes of a course [N] its best polynomial of a degree [N, N]."""
    powers = _powers(scene, motor, degree)
    return np.asarray(powers @ np.linalg.pinv(powers))


def _powers(scene: Scene, motor: int, degree: int) -> np.ndarray:
    return np.vander(scene.motor_off_middle(motor, along_motor_mm(scene, motor)), 1 + degree, increasing=True)
