"""What a few distances by callipers leave unknown: the section ``promise`` of a model that was learned from them.

Which parts of a printer have a fault, and how large it is, a few distances seldom settle. Each choice of faulty parts
is a linear model with normal unknowns, so its posterior and its evidence are known exactly; machines are drawn from all
of them, each choice as often as its prior chance times its evidence has it (Bayesian model averaging: Hoeting et al.
1999). How uneven a machine is beyond a pulley's first harmonics, no callipers see.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from printmend.learn.callipers import (
    NAMES,
    PRIOR_SD,
    READING_SD_MM,
    SKEW_AT,
    SKEW_SD,
    WIDTH_SD_MM,
    Distances,
    Estimate,
    about,
    estimate,
    mechanism,
)
from printmend.path import Instrument
from printmend.printer import Printer
from printmend.promise.budget import VERSION
from printmend.promise.section import NO_PARTS
from printmend.saved import SCALE_MM, SavedModel, saved_model

FAULTY_SHARE = 0.4  # chance that a printer has a fault of a kind, before any distance was read
BOTH_SHARE = 0.5  # of printers with a faulty scale, play or pulley: how many have it on both motors
SIZES = (0.25, 0.5, 1.0, 2.0)  # of all faults of a machine, in prior standard deviations: each as likely
FALLS = (1, 2)  # power of their number by which a pulley's harmonics fall off: each as likely
HARMONICS = (1, 2, 3, 4)  # of a pulley
FINER_MM = 0.03  # what no distances show, as finer harmonics: half of the printers have none, few have more
MACHINES = 128  # number of machines that are kept
TRIED = 16 * MACHINES  # … of so many that are drawn, because a play below 0 is none
SEED = 19  # the same distances always give the same machines
OWN = 2 + 2 * len(HARMONICS)  # number of a motor's unknowns
PLAYS = [1, OWN + 1]  # of both motors
WAVE = np.array([*(1, 1, *np.repeat(HARMONICS, 2)) * 2, 1, 1])  # the harmonic of each unknown
UNKNOWNS_SD = np.array([*(*PRIOR_SD[:2], *[PRIOR_SD[2]] * (OWN - 2)) * 2, SKEW_SD, WIDTH_SD_MM])
PARTS = 7  # of a printer that may be faulty: scale, play and pulley of one motor, those of the other, the squareness
PART_OF = np.array([*(0, 1, *[2] * (OWN - 2)), *(3, 4, *[5] * (OWN - 2)), 6])  # of each unknown but the dots' width


def model_by_hand(distances: Distances, readings_mm: np.ndarray, printer: Printer) -> SavedModel:
    """Return what readings [K] mm of distances say of a printer, NaN where none was taken: what is known well acts."""
    estimates = estimate(distances, readings_mm)
    details = {"promise": calliper_section(distances, readings_mm, printer)}
    findings = tuple(map(str, estimates))
    return saved_model(mechanism(estimates, printer), learner="callipers", findings=findings, details=details)


def calliper_section(distances: Distances, readings_mm: np.ndarray, printer: Printer) -> dict[str, Any]:
    """Return the budget of a model that `learn.callipers.mechanism` made of these readings, as plain values."""
    estimates = estimate(distances, readings_mm)
    acts = np.array([each.value if each.corrected else 0.0 for each in estimates])
    off = machines(distances, readings_mm, estimates)
    own = [slice(motor * OWN, motor * OWN + OWN) for motor in range(2)]
    for motor in range(2):
        known = acts[motor * len(NAMES) : (motor + 1) * len(NAMES)]
        known[1] = max(known[1], 0.0)
        off[own[motor]][: len(NAMES)] -= known[:, None]
    lean = (off[2 * OWN] - acts[SKEW_AT]) / 2
    if printer.kinematics == "corexy":  # opposite scales of its motors are a skew, and a turn, which is no error
        lean += (off[0] - off[OWN]) / 2
        off[[0, OWN]] = (off[0] + off[OWN]) / 2
    return {
        "version": VERSION,
        "placed": False,
        "instrument": asdict(Instrument()),
        "stretch": [
            {"weight": 1.0, "mean": [0.0, 0.0, float(f"{each:.4g}")], "covariance": np.zeros((3, 3)).tolist()}
            for each in lean
        ],
        "together": True,
        "motors": {name: _motor(off[own[motor]], printer, motor) for motor, name in enumerate(printer.motors)},
    }


def machines(distances: Distances, readings_mm: np.ndarray, estimates: Sequence[Estimate]) -> np.ndarray:
    """Draw machines that a few readings allow [P, MACHINES]: of either motor scale, play, and sine and cosine of each
    of `HARMONICS`; the skew, and the width of dots."""
    rng = np.random.default_rng(SEED)
    features, seen_mm = about(distances, readings_mm, np.array([each.value for each in estimates]), HARMONICS)
    count = len(seen_mm)
    sds, gains, chance_log = [], [], []
    for there in itertools.product((False, True), repeat=PARTS):
        sorts = list(itertools.product(SIZES if any(there) else (1.0,), FALLS if there[2] or there[5] else (1,)))
        for size, fall in sorts:
            sd = UNKNOWNS_SD / WAVE**fall * np.append(np.array(there)[PART_OF] * size, 1.0)
            precision = np.linalg.inv((features * sd**2) @ features.T + READING_SD_MM**2 * np.eye(count))
            plays = there[1] + there[4]  # a normal value is positive in half of the cases
            evidence = (np.linalg.slogdet(precision)[1] - seen_mm @ precision @ seen_mm) / 2 + plays * math.log(2)
            chance_log.append(evidence + _prior_log(there) - math.log(len(sorts)))
            sds.append(sd)
            gains.append((features * sd**2).T @ precision)
    chance = np.exp(np.array(chance_log) - max(chance_log))
    which = rng.choice(len(chance), TRIED, p=chance / chance.sum())
    drawn = np.array(sds)[which].T * rng.standard_normal((len(UNKNOWNS_SD), TRIED))
    missed_mm = seen_mm[:, None] - features @ drawn - READING_SD_MM * rng.standard_normal((count, TRIED))
    for at in np.unique(which):  # a draw before the readings, brought to them, is one after them (Matheron's rule)
        drawn[:, which == at] += gains[at] @ missed_mm[:, which == at]
    able = np.flatnonzero((drawn[PLAYS] >= 0).all(axis=0))
    kept = drawn[:, np.resize(able if len(able) else np.arange(TRIED), MACHINES)]
    kept[PLAYS] = np.maximum(kept[PLAYS], 0.0)
    return kept


def _prior_log(there: Sequence[bool]) -> float:
    """Return the logarithm of the chance that just these parts are faulty, before any distance was read."""
    chance = FAULTY_SHARE if there[-1] else 1 - FAULTY_SHARE
    for one, other in zip(there[:3], there[3:6], strict=True):
        on = BOTH_SHARE if one and other else (1 - BOTH_SHARE) / 2
        chance *= FAULTY_SHARE * on if one or other else 1 - FAULTY_SHARE
    return math.log(chance)


def _motor(off: np.ndarray, printer: Printer, motor: int) -> dict[str, Any]:
    """Return one motor's budget: by how much it is off what acts in each machine [OWN, MACHINES]."""
    low_mm, high_mm = printer.motor_range_mm(motor)
    rows = [[float(f"{value:.4g}") for value in row] for row in off]
    return {
        "parameters": {"mean_powers": 2, "play_powers": 1, "mean_harmonics": list(HARMONICS), **NO_PARTS},
        "period_mm": printer.axes[motor].mm_per_turn,
        "middle_mm": (low_mm + high_mm) / 2,
        "reach_mm": [low_mm, high_mm],
        "factor_mm": {  # where the plate lay tells nothing
            "mean_powers": [[0.0] * MACHINES, [SCALE_MM * each for each in rows[0]]],
            "play_powers": rows[1:2],
            "mean_sin": rows[2::2],
            "mean_cos": rows[3::2],
        },
        "machines": True,
        "seen": 1.0,
        "unexplained_mm2": 0.0,
        "unexplained_sd_mm2": FINER_MM**2,
    }
