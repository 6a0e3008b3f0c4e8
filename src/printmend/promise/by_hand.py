"""What a few distances by callipers leave unknown: the section ``promise`` of a model that was learned from them.

Scale, play and the first harmonic of each motor and the skew have a standard deviation each, or their own size where
they are not corrected. Where no part is corrected, each may also be sound; a printer with one fault is not thought to
be sound elsewhere. How large a finer unevenness is, no callipers see.
"""

import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from printmend.learn.callipers import NAMES, PRIOR_SD, SKEW_AT, SKEW_SD, Estimate
from printmend.path import Instrument
from printmend.printer import Printer
from printmend.promise.budget import VERSION
from printmend.promise.section import NO_PARTS
from printmend.saved import SCALE_MM

FAULTY_SHARE = 0.4  # chance that a part has a fault, before any distance was read, where nothing is corrected
LEAST_CHANCE = 0.001  # … and the least that distances may leave of it
FINER_MM = 0.03  # standard deviation of what twelve distances do not show, as finer harmonics: most printers have less
PRIOR_OF = {**dict(zip(NAMES, PRIOR_SD, strict=True)), "skew": SKEW_SD}


def calliper_section(estimates: Sequence[Estimate], printer: Printer) -> dict[str, Any]:
    """Return the budget of a model that `learn.callipers.mechanism` made of these estimates, as plain values."""
    skew = estimates[SKEW_AT]
    is_faulty = any(each.corrected for each in estimates[: SKEW_AT + 1])
    there = 1.0 if is_faulty else _chance([skew])
    stretch = [
        {"weight": round(weight, 4), "mean": [0.0, 0.0, 0.0], "covariance": np.diag([0.0, 0.0, variance]).tolist()}
        for weight, variance in ((there, float(f"{(_doubt(skew) / 2) ** 2:.4g}")), (1 - there, 0.0))
        if weight > 0
    ]
    return {
        "version": VERSION,
        "placed": False,
        "instrument": asdict(Instrument()),
        "stretch": stretch,
        "motors": {
            name: _motor(estimates[motor * len(NAMES) : (motor + 1) * len(NAMES)], printer, motor, is_faulty)
            for motor, name in enumerate(printer.motors)
        },
    }


def _doubt(estimate: Estimate) -> float:
    """Return by how much a quantity may differ from what acts, root mean square."""
    return estimate.sd if estimate.corrected else math.hypot(estimate.value, estimate.sd)


def _chance(part: Sequence[Estimate]) -> float:
    """Return the chance that a part of which nothing is corrected has a fault, by how much likelier the distances are
    where it is sound (the density ratio of Savage and Dickey: Dickey 1971)."""
    sound_log = sum(
        math.log(PRIOR_OF[each.name.split()[-1]] / each.sd) - (each.value / each.sd) ** 2 / 2 for each in part
    )
    return max(round(1 / (1 + (1 / FAULTY_SHARE - 1) * math.exp(sound_log)), 4), LEAST_CHANCE)


def _motor(estimates: Sequence[Estimate], printer: Printer, motor: int, is_faulty: bool) -> dict[str, Any]:
    chances = [1.0 if is_faulty else _chance(part) for part in (estimates[:1], estimates[1:2], estimates[2:])]
    weights = np.sqrt(np.repeat(chances, (1, 1, 2)))  # what is there in few machines is as much larger in these
    scale, play, sine, cosine = (
        float(f"{weight * _doubt(each):.4g}") for weight, each in zip(weights, estimates, strict=True)
    )
    low_mm, high_mm = printer.motor_range_mm(motor)
    return {
        "parameters": {"mean_powers": 2, "play_powers": 1, "mean_harmonics": [1], **NO_PARTS},
        "period_mm": printer.axes[motor].mm_per_turn,
        "middle_mm": (low_mm + high_mm) / 2,
        "reach_mm": [low_mm, high_mm],
        "factor_mm": {  # a direction for each quantity; where the plate lay tells nothing
            "mean_powers": [[0.0, 0.0, 0.0, 0.0], [SCALE_MM * scale, 0.0, 0.0, 0.0]],
            "play_powers": [[0.0, play, 0.0, 0.0]],
            "mean_sin": [[0.0, 0.0, sine, 0.0]],
            "mean_cos": [[0.0, 0.0, 0.0, cosine]],
        },
        **({} if is_faulty else {"left_out": list(zip((1, 1, 2), chances, strict=True))}),
        "seen": 1.0,
        "unexplained_mm2": FINER_MM**2,
        "unexplained_sd_mm2": FINER_MM**2,
    }  # fmt: skip
