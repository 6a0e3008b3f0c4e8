"""A first machine of a trace, from a healthy one: how long the motors' turns are, and contacts that are nearly right.

First come the effects that do not turn. Then pulleys of many circumferences are tried beside them, by their first
harmonics and those of their play. A circumference that gains more than the printer's own is a rival: both are fitted,
and the likelier one stays.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from printmend.effects import Places, Scene, Term
from printmend.effects.breathing import HARMONICS as BREATHS
from printmend.effects.effect import done_of
from printmend.effects.prior import mild_shares, share_of, size_mm
from printmend.effects.pulley import HARMONICS as ROUNDS
from printmend.effects.teeth import TOOTH_MM
from printmend.infer.fit import Fit, fitted, weighed
from printmend.infer.gram import Block, Dictionary, Rows, laid_side_by_side, narrowed, seen
from printmend.infer.search import Search, Set, State, search_of
from printmend.path import Trace

# Effects that do not turn, and those that decide where a belt touches.
STILL = (
    "place", "scale", "bend", "play", "loose", "friction", "skew", "aspect", "wobble", "skip", "origin", "shift",
    "turn", "stretch",
)  # fmt: skip
FEW = (*STILL, "pulley", "breathing", "elastic", "idler", "bent")
REPEATING = ("pulley", "breathing", "elastic", "idler")  # effects whose place a turn of another length takes
TEETH = range(8, 43)  # of a pulley: no printer has others
TOOTH_STEPS, LOST_STEPS = 10, 4  # full steps of a tooth that is skipped and of a turn that a motor loses
ALIKE_MM = 0.2  # by which a skip may differ from such a number: a turn that is lost also turns the pulley
NEAR_SHARES = np.arange(-8, 9) * 0.005  # by which calibrated steps a millimetre let a turn differ from the printer's
NEAR_SPACING = 0.0025  # half the distance of lengths that are tried, as a share
ROUND_MOST, BREATH_MOST = 4, 2  # harmonics of a turn that is tried, and of its play
SHARPER_NATS = 12.0  # a length between two tried ones may gain so much
TOOTHED_NATS = 4.0  # a whole number of teeth may lose so much against a length near it
FINER_ROUNDS, FINER = 4, np.linspace(-1.0, 1.0, 5)  # lengths about one that was found, in each round


@dataclass(frozen=True)
class Turn:
    """A length of one motor's turn, and the logarithm of its odds against the printer's own."""

    motor: int
    length_mm: float
    log_odds: float = 0.0

    def of(self, scene: Scene) -> Scene:
        """Return the scene in which the motor turns by this length."""
        lengths = list(scene.turns_mm)
        lengths[self.motor] = self.length_mm
        return replace(scene, turns_mm=(lengths[0], lengths[1]))


@lru_cache  # so that what is kept by it is known again
def among(names: tuple[str, ...]) -> Callable[[Term], bool]:
    """Return which terms are of some effects."""
    return lambda term: term.effect in names


def begun(trace: Trace, scene: Scene) -> tuple[Fit, Trace]:
    """Return a fit of few effects, in whose scene the motors' turns are as long as the trace says, and the trace as the
    motors really went: where one lost steps, its pulley turned by less. Each length is judged at its own contacts, and
    so is play: a loose nozzle resembles it where belts are thought to touch everywhere."""

    def told(scene: Scene, before: Fit | None, names: tuple[str, ...] = FEW) -> Fit:
        fit = fitted(trace, scene, before, kept=among(names), quick=True)
        places, rows = narrowed(fit.places, fit.rows)
        return replace(fit, places=places, rows=rows)

    still = told(scene, None, STILL)
    if any(block.effect == "loose" for block in still.blocks):
        tight = tuple(name for name in STILL if name != "loose")
        still = max(still, told(scene, None, tight), key=lambda fit: fit.state.score)
    best, odds = told(scene, still), 0.0
    for round_, base in enumerate((still, None)):
        rivals = [rival for motor in range(2) if (rival := _rival(base or best, motor, near=round_ > 0)) is not None]
        for turn, _ in sorted(rivals, key=lambda each: -each[1]):
            other = told(turn.of(best.scene), best if round_ else still)
            if other.state.score + turn.log_odds > best.state.score + odds:
                best, odds = other, odds + turn.log_odds
    return best, _as_turned(trace, best)


def _as_turned(trace: Trace, fit: Fit) -> Trace:
    """Return a trace whose motors go as far as they turned, without the steps that they lost."""
    lost_mm = np.zeros((len(trace), 2))
    moves = np.diff(trace.commanded_mm, axis=0, prepend=trace.commanded_mm[:1])
    done = done_of(np.hypot(*moves.T), fit.scene)
    for part in fit.parts():
        axis = fit.scene.printer.axes[part.where]
        turns, teeth = (part.sizes_mm[0] / (count * axis.mm_per_step) for count in (LOST_STEPS, TOOTH_STEPS))
        off, other = (abs(each - round(each)) * count for each, count in ((turns, LOST_STEPS), (teeth, TOOTH_STEPS)))
        if part.effect == "skip" and off < other and off * axis.mm_per_step < ALIKE_MM:
            after = done > part.shape[0]
            lost_mm[after, part.where] += round(turns) * LOST_STEPS * axis.mm_per_step
    if not lost_mm.any():
        return trace
    return replace(trace, commanded_mm=trace.commanded_mm + fit.scene.printer.from_motor(lost_mm))


def _rival(fit: Fit, motor: int, *, near: bool) -> tuple[Turn, float] | None:
    """Return the turn of a motor that is likelier than the one that a fit has, and by how much; None where none is.

    ``near`` tries only those near it, where the fit's wave fades along the belt: one of another length would look so.
    """
    if near and not any(block.effect in REPEATING and block.where == motor for block in fit.blocks):
        return None
    beside = _Beside(fit, motor)
    tried = [Turn(motor, fit.scene.turns_mm[motor]), *_lengths(fit.scene, motor, near=near)]
    own, *gains = beside.gains(tried)
    best = tried[1 + int(np.argmax(gains))]
    if max(gains) < own - SHARPER_NATS:
        return None
    best, gain = _sharpened(beside, best)
    return (best, gain - own) if gain > own else None


def _lengths(scene: Scene, motor: int, *, near: bool) -> Iterator[Turn]:
    """Yield the lengths of a turn that are tried."""
    own_mm = scene.turns_mm[motor]
    teeth = [length for length in np.multiply(TOOTH_MM, TEETH).tolist() if own_mm % length]  # else a part of its turn
    close = [own_mm * (1 + share) for share in NEAR_SHARES if share]
    for lengths in (close,) if near else (teeth, close):
        log_odds = math.log(share_of("other_turn") / 2 / len(lengths))
        yield from (Turn(motor, length_mm, log_odds) for length_mm in lengths)


@dataclass(frozen=True, eq=False)
class _Beside:
    """What one motor's turn is tried beside: all of a fit but what repeats along that motor."""

    fit: Fit
    motor: int

    @cached_property
    def known(self) -> tuple[Search, State, np.ndarray]:
        """The search among the blocks that stay, the set of them all, and the rows' weights."""
        blocks, members = self.fit.dictionary.blocks, self.fit.state.members
        kept = [one for one in members if blocks[one[0]].effect not in REPEATING or blocks[one[0]].where != self.motor]
        weight = weighed(self.fit.rows, self.fit.left_mm())
        dictionary = self.fit.search.narrowed([b for b, _ in kept]).dictionary
        search = search_of(dictionary, self.fit.rows, weight)
        own: Set = tuple((at, variant) for at, (_, variant) in enumerate(kept))
        return search, search.posterior(own, self.fit.state.sigma_mm, rounds=0), weight

    @cached_property
    def marks(self) -> tuple[Places, Rows]:
        return narrowed(self.fit.places, self.fit.rows)

    def gains(self, turns: Sequence[Turn]) -> list[float]:
        """Return the score of the set with a pulley of each turn, whose play breathes or not, and its log odds."""
        search, beside, weight = self.known
        (places, rows), sizes, count = self.marks, _sizes_mm(), len(search.dictionary.blocks)
        new = [
            seen(name, turn.motor, (most,), places, rows, turn.of(self.fit.scene))
            for turn in turns
            for name, most in (("pulley", ROUND_MOST), ("breathing", BREATH_MOST))
        ]
        own = Block("pulley", self.motor, (), slice(0, sizes.shape[1]), sizes, np.zeros(len(sizes)))
        blocks = laid_side_by_side((*search.dictionary.blocks, *[own] * len(turns)))
        columns = np.hstack([search.dictionary.columns, *new])
        search = search_of(Dictionary(blocks, columns), self.fit.rows, weight)
        gains = search.gains(beside, count + np.arange(len(turns))).values.reshape(len(turns), -1)
        likeliest = enumerate(np.argmax(gains, axis=1).tolist(), start=count)
        found = [search.posterior((*beside.members, one), beside.sigma_mm).score for one in likeliest]
        return [score + turn.log_odds for score, turn in zip(found, turns, strict=True)]


def _sizes_mm() -> np.ndarray:
    """Return how large the harmonics of a turn that is tried may be [V, P], with play that breathes and without."""
    pulley = size_mm("pulley") * np.tile(ROUNDS[:ROUND_MOST] ** -2.5, 2)
    play = size_mm("breathing") * np.tile(BREATHS[:BREATH_MOST] ** -2.0, 2)
    return np.array([np.concatenate([mild * pulley, mild * own]) for mild in mild_shares() for own in (0 * play, play)])


def _sharpened(beside: _Beside, turn: Turn) -> tuple[Turn, float]:
    """Return the turn between those that were tried, or with a whole number of teeth where that is as likely."""
    spacing, gain = NEAR_SPACING, -np.inf
    for _ in range(FINER_ROUNDS):
        around = [replace(turn, length_mm=turn.length_mm * (1 + spacing * each)) for each in FINER]
        gains = beside.gains(around)
        turn, gain = around[int(np.argmax(gains))], max(gains)
        spacing /= 2
    toothed = replace(turn, length_mm=TOOTH_MM * round(turn.length_mm / TOOTH_MM))
    if toothed.length_mm != beside.fit.scene.turns_mm[turn.motor]:
        (other,) = beside.gains([toothed])
        turn, gain = max((turn, gain), (toothed, other + TOOTHED_NATS), key=lambda each: each[1])
    return turn, gain
