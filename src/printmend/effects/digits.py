"""A table whose numbers are rounded: the rounding error is a sawtooth of the true position."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import ALWAYS, GONE, Of, Places, Scene, Term, Usual, along, waves
from printmend.effects.words import Found, Told, Whole
from printmend.messages import say

FINEST_MM = 0.05  # no motor or belt ripples finer: a shorter wave is the noise of the table


class Digits(Usual):
    """The first harmonics of a sawtooth of either axis; its shape is the step of the rounding.

    If positions scatter little, rounding to a step q moves them by Σ ±q/(πk) sin(2πkx/q).
    """

    name = "digits"
    of = Of.INSTRUMENT
    fate = GONE
    keys = Whole()

    def terms(self, scene: Scene) -> Iterator[Term]:
        if len(orders := harmonics(scene.step_mm)):  # every table that is rounded has it
            each_mm = np.tile(scene.step_mm / (np.pi * orders * 2**0.5), 4)  # cosines and sines of both axes
            yield Term(self.name, 0, (scene.step_mm,), tuple(each_mm.tolist()), ALWAYS)

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        step_mm, orders = shape[0], harmonics(shape[0])
        of_axes = [along(axis, waves(places.bed_mm[:, axis], step_mm, orders)) for axis in range(2)]
        return np.concatenate(of_axes, axis=2)

    def told(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
        yield Told("digits", say("table-rounded", f"{found.shape[0]:g}"), is_harmless=True)


def harmonics(step_mm: float) -> np.ndarray:
    """Return the orders of a sawtooth's waves that a printer's ripples may resemble."""
    return np.arange(1, round(step_mm / FINEST_MM) + 1)
