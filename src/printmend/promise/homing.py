"""Shift each drawn machine's waves to where the next homing may put them."""

from dataclasses import replace

import numpy as np

from printmend.effects.homing import shifted, waves_of
from printmend.effects.switch import drawn_shifts_mm
from printmend.infer.part import DRAWS
from printmend.promise.belief import Belief

SEED = 17  # the same model always gets the same homings


def after_homing(belief: Belief) -> Belief:
    """Return what is believed of the machine once it has homed again, each draw with a homing of its own."""
    by_mm = drawn_shifts_mm(belief.scene, DRAWS, np.random.default_rng(SEED))
    parts = []
    for part in belief.parts:
        waves_mm = waves_of(part.effect, part.where, part.shape, belief.scene)
        if waves_mm is not None:
            part = replace(part, draws_mm=shifted(part.draws_mm, waves_mm, by_mm[part.where]))
        parts.append(part)
    return replace(belief, parts=tuple(parts))
