"""Draw printers and sessions from the priors, print and measure them: the data of the engine's calibration test."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from printmend.effects import EFFECTS, Acts, Effect, Of, Scene, Term
from printmend.effects.sample import drawn_sizes
from printmend.effects.sized import Sized
from printmend.infer.fit import home_sd_of
from printmend.infer.machine import machine_of
from printmend.machine import contacts_of
from printmend.path import Trace
from printmend.twin.along import added_mm

MOST_LOG_ODDS = 50.0  # of what is always there
CHANGING = ("breathing", "friction", "uneven_play", "rub")  # effects that add to a belt's play and take away from it


def drawn_parts(scene: Scene, rng: np.random.Generator) -> list[Sized]:
    """Draw the effects of a printer, its print and its measurement, each by its odds and with sizes by its prior."""
    parts = _possible([part for effect in EFFECTS.values() if effect.from_home for part in _drawn(effect, scene, rng)])
    if scene.homed:
        mechanism, _ = machine_of(scene, [part for part in parts if EFFECTS[part.effect].of is Of.MACHINE])
        scene = replace(scene, home_sd_mm=home_sd_of(mechanism, scene))
    return [*parts, *(part for each in EFFECTS.values() if not each.from_home for part in _drawn(each, scene, rng))]


def _drawn(effect: Effect, scene: Scene, rng: np.random.Generator) -> Iterator[Sized]:
    """Draw what of one effect a printer has."""
    by_place: dict[int, list[Term]] = {}
    for term in effect.terms(scene):
        by_place.setdefault(term.where, []).append(term)
    for terms in by_place.values():
        odds = np.exp(np.minimum([term.log_odds for term in terms], MOST_LOG_ODDS))
        if rng.uniform() < odds.sum() / (1 + odds.sum()):
            term = terms[int(rng.choice(len(terms), p=odds / odds.sum()))]
            yield Sized(effect.name, term.where, term.shape, drawn_sizes(term, rng))


def _possible(parts: Sequence[Sized]) -> list[Sized]:
    """Return parts as a machine can have them: no belt has less than no play, however much of it comes and goes."""
    kept = list(parts)
    for motor in range(2):
        mine = [part for part in kept if part.where == motor]
        most_mm = sum(float(np.abs(part.sizes_mm).sum()) for part in mine if part.effect in CHANGING)
        own_mm = sum(float(part.sizes_mm[0]) for part in mine if part.effect == "play")
        kept = [part for part in kept if part.effect != "play" or part.where != motor]
        if own_mm or most_mm:
            kept.append(Sized("play", motor, (), np.array([max(own_mm, most_mm)])))
    return kept


def measured(
    commanded_mm: np.ndarray,
    dots: np.ndarray,
    scene: Scene,
    parts: Sequence[Sized],
    noise_mm: float,
    rng: np.random.Generator,
) -> Trace:
    """Print way-points [N, 2] on a machine with these effects, and measure its ``dots`` [N] with normal noise."""
    mechanism, _ = machine_of(scene, [part for part in parts if EFFECTS[part.effect].of is Of.MACHINE])
    contacts = contacts_of(mechanism, scene.printer.to_motor(commanded_mm))
    empty = Trace(commanded_mm, np.full(commanded_mm.shape, np.nan), homed=scene.homed, placed=scene.placed)
    others = [
        part for part in parts if EFFECTS[part.effect].of is not Of.MACHINE or EFFECTS[part.effect].acts is Acts.NOT
    ]
    printed = mechanism.bed.printed(contacts.belt_mm) + added_mm(others, empty, scene, contacts)
    printed = printed + noise_mm * rng.standard_normal(printed.shape)
    known = dots & (contacts.row >= 0).all(axis=1)
    return replace(empty, measured_mm=np.where(known[:, None], printed, np.nan))
