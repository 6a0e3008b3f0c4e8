"""What a few distances by callipers leave unknown: the section ``promise`` of a model that was learned from them.

Scale, play and the first harmonic of each motor and the skew have a standard deviation each, or their own size where
they are not corrected; how large a finer unevenness is, no callipers see.
"""

import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from printmend.learn.callipers import NAMES, Estimate
from printmend.path import Instrument
from printmend.printer import Printer
from printmend.promise.budget import VERSION
from printmend.promise.section import NO_PARTS
from printmend.saved import SCALE_MM

FINER_MM = 0.03  # standard deviation of what twelve distances do not show, as finer harmonics: most printers have less


def calliper_section(estimates: Sequence[Estimate], printer: Printer) -> dict[str, Any]:
    """Return the budget of a model that `learn.callipers.mechanism` made of these estimates, as plain values."""
    doubt = [_doubt(each) for each in estimates]
    skew = doubt[2 * len(NAMES)] / 2
    covariance = [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, float(f"{skew**2:.4g}")]]
    return {
        "version": VERSION,
        "placed": False,
        "instrument": asdict(Instrument()),
        "stretch": [{"weight": 1.0, "mean": [0.0, 0.0, 0.0], "covariance": covariance}],
        "motors": {
            name: _motor(doubt[motor * len(NAMES) : (motor + 1) * len(NAMES)], printer, motor)
            for motor, name in enumerate(printer.motors)
        },
    }


def _doubt(estimate: Estimate) -> float:
    """Return by how much a quantity may differ from what acts, root mean square."""
    return estimate.sd if estimate.corrected else math.hypot(estimate.value, estimate.sd)


def _motor(doubt: Sequence[float], printer: Printer, motor: int) -> dict[str, Any]:
    scale, play, sine, cosine = (float(f"{each:.4g}") for each in doubt)
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
        "seen": 1.0,
        "unexplained_mm2": FINER_MM**2,
        "unexplained_sd_mm2": FINER_MM**2,
    }  # fmt: skip
