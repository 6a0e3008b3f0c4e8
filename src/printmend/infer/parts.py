"""A drive's parameters (`saved.layout.Design`) as parts: for learners that draw machines of their own."""

import numpy as np
from numpy.polynomial import polynomial

from printmend.effects import Scene
from printmend.effects.breathing import HARMONICS as BREATHS
from printmend.effects.elastic import HARMONICS as STRETCHES
from printmend.effects.pulley import HARMONICS as ROUNDS
from printmend.effects.uneven import COUNT
from printmend.infer.part import Part
from printmend.saved import SCALE_MM, Design


def parts_of_drive(
    scene: Scene, motor: int, design: Design, origin_mm: float, values: np.ndarray, draws: np.ndarray
) -> list[Part]:
    """Return one motor's parameters [P] that act, and those of drawn machines [P, D], as parts.

    The powers of the parameters count from ``origin_mm``, those of effects from the middle of the bed.
    """
    whole = np.column_stack([values, draws])
    at = {name: whole[part] for name, part in design.parts.items()}
    low, high = scene.motor_span_mm[motor]
    shift = (scene.motor_middle_mm(motor) - origin_mm) / SCALE_MM
    found: list[Part] = []

    def add(effect: str, shape: tuple[float, ...], sizes: np.ndarray) -> None:
        if sizes.size and sizes.any():
            found.append(Part(effect, motor, shape, sizes[:, 0], sizes[:, 1:]))

    mean = _shifted(at["mean_powers"], shift, 4)
    add("place", (), mean[:1])
    add("scale", (), mean[1:2])
    add("bend", (low, high), mean[2:4])
    play = _shifted(at["play_powers"], shift, 3)
    add("play", (), play[:1])
    add("friction", (low, high), play[1:3])
    turn = _waves(design, "mean", at, ROUNDS)
    stretch = _waves(design, "elastic", at, STRETCHES)
    if stretch.any():  # x counts from the origin
        turn = turn + shift * _spread(stretch, STRETCHES, ROUNDS)
    add("pulley", (), turn)
    add("elastic", (low, high), stretch)
    add("breathing", (), _waves(design, "play", at, BREATHS))
    for order, k in enumerate(design.waves("ripple")):
        add("teeth", (scene.turns_mm[motor] / float(k),), whole[design.wave_at("ripple", order)])
    for order, k in enumerate(design.waves("second")):
        add("idler", (design.second_mm / float(k),), whole[design.wave_at("second", order)])
    warp = np.zeros((COUNT, whole.shape[1]))
    warp[: min(COUNT, design.warp)] = at["warp"][:COUNT]
    add("uneven", (float(design.warp_span_mm[0]), float(design.warp_span_mm[1])), warp)
    return found


def _shifted(powers: np.ndarray, shift: float, count: int) -> np.ndarray:
    """Return polynomials [P, D] of x as those of x − shift, with ``count`` coefficients."""
    out = np.zeros((count, powers.shape[1]))
    for power, row in enumerate(powers):
        out[: power + 1] += polynomial.polypow([shift, 1.0], power)[:, None] * row
    return out


def _waves(design: Design, name: str, at: dict[str, np.ndarray], harmonics: np.ndarray) -> np.ndarray:
    """Return cosines and sines [2K, D] of the harmonics that an effect has."""
    out = np.zeros((2, len(harmonics), at["start"].shape[1]))
    where = {int(k): place for place, k in enumerate(harmonics)}
    for which, wave in enumerate(("cos", "sin")):
        for row, k in enumerate(design.waves(name)):
            if int(k) in where:
                out[which, where[int(k)]] = at[f"{name}_{wave}"][row]
    return out.reshape(2 * len(harmonics), -1)


def _spread(sizes: np.ndarray, own: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Return the sizes of some harmonics [2K, D] among those of a longer series."""
    out = np.zeros((2, len(wanted), sizes.shape[1]))
    out[:, [int(np.flatnonzero(wanted == k)[0]) for k in own]] = sizes.reshape(2, len(own), -1)
    return out.reshape(2 * len(wanted), -1)
