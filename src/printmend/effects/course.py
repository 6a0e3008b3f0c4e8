"""The smooth errors of one belt, added up: its bend and its unevenness.

A measurement determines little more than the sum of these and of a wrong scale, because each can stand in for part of
another. So the sum is reported: its slope as the scale, its curvature as the bend, the rest as unevenness.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from printmend.effects.effect import Scene, belt_places
from printmend.effects.words import Found, along_motor_mm, those_of

SMOOTH = ("bend", "uneven")


def course_of(found: Found, beside: Sequence[Found], scene: Scene) -> Found:
    """Return ``found`` with the sum of the smooth errors, at N places along the measured span, in place of its sizes:
    ``sizes_mm`` [N] of what acts, ``draws_mm`` [N, D] of each drawn machine."""
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
    """Return the row [N] that gives the slope of a course [N], in mm per 100 mm."""
    return np.asarray(np.linalg.pinv(_powers(scene, motor, 1))[1])


def fit_of(scene: Scene, motor: int, degree: int) -> np.ndarray:
    """Return the matrix [N, N] that gives the best polynomial of a degree through a course [N]."""
    powers = _powers(scene, motor, degree)
    return np.asarray(powers @ np.linalg.pinv(powers))


def _powers(scene: Scene, motor: int, degree: int) -> np.ndarray:
    return np.vander(scene.motor_off_middle(motor, along_motor_mm(scene, motor)), 1 + degree, increasing=True)
