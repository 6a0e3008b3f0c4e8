"""A model from distances by callipers: the acting parts, the drawn machines, and the words for each quantity."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from printmend.effects import EFFECTS, Scene
from printmend.effects.effect import SCALE_MM
from printmend.effects.pulley import HARMONICS
from printmend.errors import TraceError
from printmend.infer.distances import ByHand, machines_by_hand, printer_of
from printmend.infer.gram import block_of
from printmend.infer.machine import DRAWS, machine_of, those_acting
from printmend.measure.callipers import READING_SD_MM, Distances
from printmend.messages import say
from printmend.model import SavedModel, saved_model
from printmend.model.model import DIGESTS
from printmend.printer import Printer
from printmend.promise.belief import belief_section

SUPPORTED_SHARE = 0.5  # an estimate counts as measured if its standard deviation is below this share of the prior's
SEED = 19  # the same distances always give the same machines


class _Asked(NamedTuple):
    """A quantity in an owner's words: which of the sizes of which effect it is, and what one unit of that is."""

    words: str
    effect: str
    size: int
    unit: str
    factor: float


OF_MOTOR = (
    _Asked(say("estimate-scale"), "scale", 0, "%", 1.0),
    _Asked(say("estimate-play"), "play", 0, "mm", 1.0),
    _Asked(say("estimate-sine"), "pulley", len(HARMONICS), "mm", 1.0),
    _Asked(say("estimate-cosine"), "pulley", 0, "mm", 1.0),
)
OF_WHOLE = (
    _Asked(say("estimate-skew"), "skew", 0, "°", math.degrees(1 / SCALE_MM)),
    _Asked(say("estimate-dot"), "bead", 0, "mm", 2.0),
)


@dataclass(frozen=True)
class Estimate:
    """One quantity, ``value`` ± ``sd``; ``supported`` says that the distances tell it, and not the prior alone,
    ``corrected`` that it acts, and ``absent`` that the distances show none: among the drawn machines its root mean
    square is smaller than a reading's own error."""

    name: str
    value: float
    sd: float
    unit: str
    supported: bool
    corrected: bool
    absent: bool

    @property
    def words(self) -> str:
        """Say it in one line."""
        said = say("estimate", self.name, f"{self.value:+.3f}", f"{self.sd:.3f}", self.unit)
        if not self.supported:
            return say("these-distances-cannot-tell", said)
        if self.absent:
            return say("estimate-absent", self.name)
        return said if self.corrected else say("not-corrected", said)


def model_by_hand(distances: Distances, readings_mm: np.ndarray, printer: Printer) -> SavedModel:
    """Return what readings [K] mm of distances say of a printer, NaN where none was taken.

    Raises `TraceError` where all are NaN.
    """
    found = _machines(distances, readings_mm, printer)
    mechanism, branches = machine_of(found.scene, those_acting(found.parts))
    findings = tuple(_said(found, readings_mm))
    details = {"promise": belief_section(found.scene, found.parts, by_hand=True), DIGESTS: []}
    return saved_model(mechanism, learner="callipers", branches=branches, findings=findings, details=details)


def said_by_hand(distances: Distances, readings_mm: np.ndarray) -> list[str]:
    """Return a line for each estimate, and for each reading that may be a slip."""
    return list(_said(_machines(distances, readings_mm, printer_of(distances.plan)), readings_mm))


def _said(found: ByHand, readings_mm: np.ndarray) -> Iterator[str]:
    yield from (each.words for each in _estimates(found))
    yield from (say("reading-may-be-misread", number + 1, f"{off_mm:+.1f}") for number, off_mm in found.misread)


def _machines(distances: Distances, readings_mm: np.ndarray, printer: Printer) -> ByHand:
    if not np.isfinite(readings_mm).any():
        raise TraceError(say("distances"), wanted=say("least"), came=say("none"), todo=say("measure-few-list"))
    return machines_by_hand(distances, readings_mm, printer, np.random.default_rng(SEED))


def _estimates(by_hand: ByHand) -> list[Estimate]:
    """Return estimates of scale, play and first harmonic of each motor, of the skew, and of the dots' width."""
    scene, parts = by_hand.scene, by_hand.parts
    asked = [
        (motor, each._replace(words=say("motor-quantity", name.upper(), each.words)))
        for motor, name in enumerate(scene.printer.motors)
        for each in OF_MOTOR
    ] + [(0, each) for each in OF_WHOLE]
    found = []
    for where, each in asked:
        mine = [part for part in parts if (part.effect, part.where) == (each.effect, where)]
        drawn_mm = sum((part.draws_mm[each.size] for part in mine), np.zeros(DRAWS))
        acts = any(bool(part.acts_mm[each.size]) for part in mine)
        sd_mm = float(drawn_mm.std())
        supported = sd_mm < SUPPORTED_SHARE * _prior_sd(scene, each, where)
        absent = float(np.sqrt(np.mean(drawn_mm**2))) < READING_SD_MM
        value, sd = each.factor * float(drawn_mm.mean()), each.factor * sd_mm
        found.append(Estimate(each.words, value, sd, each.unit, supported, acts, absent))
    return found


def _prior_sd(scene: Scene, asked: _Asked, where: int) -> float:
    """Return the standard deviation of a size before anything was measured."""
    block = block_of([term for term in EFFECTS[asked.effect].terms(scene) if term.where == where])
    return float(np.sqrt(block.variance_mm2[asked.size]))
