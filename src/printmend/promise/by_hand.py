"""What a few distances by callipers leave unknown: the section ``promise`` of a model that was learned from them.

Which parts of a printer have a fault, and how large it is, a few distances seldom settle. Each choice of faulty parts
is a linear model with normal unknowns, so its posterior and its evidence are known exactly; machines are drawn from all
of them, each choice as often as its prior chance times its evidence has it (Bayesian model averaging: Hoeting et al.
1999). How uneven a machine is beyond a pulley's first harmonics, no callipers see.
"""

import itertools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from printmend.effects import Scene
from printmend.effects.pulley import HARMONICS as ROUNDS
from printmend.infer.posterior import DRAWS, Part
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
from printmend.printer import Printer
from printmend.promise.belief import belief_section
from printmend.saved import SCALE_MM, SavedModel, saved_model

FAULTY_SHARE = 0.4  # chance that a printer has a fault of a kind, before any distance was read
BOTH_SHARE = 0.5  # of printers with a faulty scale, play or pulley: how many have it on both motors
SIZES = (0.25, 0.5, 1.0, 2.0)  # of all faults of a machine, in prior standard deviations: each as likely
FALLS = (1, 2)  # power of their number by which a pulley's harmonics fall off: each as likely
HARMONICS = (1, 2, 3, 4)  # of a pulley
FINER_MM = (
    0.03  # what no distances show, as a pulley's finer harmonics: root mean square that few printers have more of
)
FINER_SHARE = 0.5  # of printers that have any of it
FEW_SDS = 1.645  # standard deviations of a normal value that 1 of 10 exceed
FAR_MM = 1e4  # length of the print that was measured: nothing that was learned so depends on it
TRIED = 16 * DRAWS  # number of machines that are drawn, because a play below 0 is none
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
    """Return the drawn machines of a model that `learn.callipers.mechanism` made of these readings, as plain values."""
    estimates = estimate(distances, readings_mm)
    acts = np.array([each.value if each.corrected else 0.0 for each in estimates])
    drawn = machines(distances, readings_mm, estimates)
    rng = np.random.default_rng(SEED)
    parts: list[Part] = []
    for motor in range(2):
        mine, known = drawn[motor * OWN : (motor + 1) * OWN], acts[motor * len(NAMES) : (motor + 1) * len(NAMES)]
        waves, acting = np.zeros((2, len(ROUNDS), DRAWS)), np.zeros((2, len(ROUNDS)))
        at = [int(np.flatnonzero(k == ROUNDS)[0]) for k in HARMONICS]
        waves[0, at], waves[1, at] = mine[3::2], mine[2::2]  # the callipers' sine comes first
        acting[:, at[0]] = known[3], known[2]
        finer = np.setdiff1d(np.arange(len(ROUNDS)), at)
        finer_mm = FINER_MM / FEW_SDS * np.abs(rng.standard_normal(DRAWS)) * (rng.uniform(size=DRAWS) < FINER_SHARE)
        waves[:, finer] = finer_mm * rng.standard_normal((2, len(finer), DRAWS)) / np.sqrt(len(finer))
        parts += [
            Part("scale", motor, (), SCALE_MM * known[:1], SCALE_MM * mine[:1]),
            Part("play", motor, (), np.maximum(known[1:2], 0.0), mine[1:2]),
            Part("pulley", motor, (), acting.ravel(), waves.reshape(-1, DRAWS)),
        ]
    lean = SCALE_MM * drawn[2 * OWN]
    parts.append(Part("skew", 0, (), SCALE_MM * acts[[SKEW_AT]], lean[None]))
    span = tuple((low, high) for low, high in map(printer.motor_range_mm, range(2)))
    bed = tuple((axis.min_mm, axis.max_mm) for axis in printer.axes[:2])
    scene = Scene(printer, (printer.x.mm_per_turn, printer.y.mm_per_turn), span, bed, FAR_MM, placed=False, homed=True)  # type: ignore[arg-type]
    return belief_section(scene, parts, by_hand=True)


def machines(distances: Distances, readings_mm: np.ndarray, estimates: Sequence[Estimate]) -> np.ndarray:
    """Draw machines that a few readings allow [P, DRAWS]: of either motor scale, play, and sine and cosine of each
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
    kept = drawn[:, np.resize(able if len(able) else np.arange(TRIED), DRAWS)]
    kept[PLAYS] = np.maximum(kept[PLAYS], 0.0)
    return kept


def _prior_log(there: Sequence[bool]) -> float:
    """Return the logarithm of the chance that just these parts are faulty, before any distance was read."""
    chance = FAULTY_SHARE if there[-1] else 1 - FAULTY_SHARE
    for one, other in zip(there[:3], there[3:6], strict=True):
        on = BOTH_SHARE if one and other else (1 - BOTH_SHARE) / 2
        chance *= FAULTY_SHARE * on if one or other else 1 - FAULTY_SHARE
    return math.log(chance)
