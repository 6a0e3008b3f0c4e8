"""What is believed of a machine after a measurement: machines drawn from all sets of effects, each by its weight.

The likeliest set and its neighbours, one block more, less or exchanged, are weighed by evidence and prior odds
(Bayesian model averaging: Hoeting et al. 1999). A draw is one of these sets, with sizes from its posterior.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from printmend.effects import EFFECTS, Acts, Of, Scene, columns_of
from printmend.effects.homing import lasting
from printmend.effects.sample import drawn_places
from printmend.infer.fit import Fit
from printmend.infer.part import DRAWS, Part
from printmend.infer.search import Gains, Set

LEAST_LOG_WEIGHT = -7.0  # sets less likely than e^−7 of the likeliest are left out
MOST_WORSE_SHARE = 0.05  # of the drawn machines that may print no better with what acts
MOST_SETS = 24  # neighbours that are weighed at most


@dataclass(frozen=True, eq=False)
class Posterior:
    """A machine as it is believed: its ``parts``, those of the likeliest set first (``likely`` of them), the noise of a
    measured coordinate, and how well each effect of the likeliest set is supported, in nats."""

    scene: Scene
    parts: tuple[Part, ...]
    likely: int
    noise_mm: float
    nats: tuple[float, ...]


def posterior_of(fit: Fit, rng: np.random.Generator) -> Posterior:
    """Draw machines from the sets about the likeliest one; what acts is what will still be there after a homing."""
    found = posterior_here(fit, rng)
    return replace(found, parts=tuple(after_homing(part, fit.scene) for part in found.parts))


def posterior_here(fit: Fit, rng: np.random.Generator) -> Posterior:
    """Draw machines as the measured print had them."""
    sets, weights, nats = _weighed_sets(fit)
    blocks = fit.dictionary.blocks
    order = list(dict.fromkeys([b for members in sets for b, _ in members]))
    likely = [b for b, _ in fit.state.members]
    order = [*likely, *(b for b in order if b not in likely)]
    draws = {b: np.zeros((blocks[b].at.stop - blocks[b].at.start, DRAWS)) for b in order}
    chosen = rng.choice(len(sets), DRAWS, p=weights)
    for which, members in enumerate(sets):
        state = fit.search.posterior(members, fit.state.sigma_mm, rounds=0)
        mine = np.flatnonzero(chosen == which)
        root = np.linalg.cholesky(state.covariance + 1e-14 * np.eye(len(state.columns)))
        drawn = state.mean_mm[:, None] + root @ rng.standard_normal((len(state.columns), len(mine)))
        first = 0
        for b, _ in members:
            width = blocks[b].at.stop - blocks[b].at.start
            own = drawn[first : first + width]
            draws[b][:, mine] = np.maximum(own, 0.0) if blocks[b].positive else own
            first += width
    acting = {part.key: part.sizes_mm for part in fit.parts() if EFFECTS[part.effect].acts is not Acts.NOT}
    parts = []
    for b in order:
        key = (blocks[b].effect, blocks[b].where, blocks[b].shape)
        acts_mm = acting.get(key, np.zeros(len(draws[b]))) if b in likely else np.zeros(len(draws[b]))
        parts.append(Part(*key, acts_mm, draws[b]))
    if not _gains(fit.scene, parts):
        parts = [replace(part, acts_mm=np.zeros_like(part.acts_mm)) for part in parts]
    return Posterior(fit.scene, tuple(parts), len(likely), fit.state.sigma_mm, tuple(nats))


def after_homing(part: Part, scene: Scene) -> Part:
    """Return a part that acts as far as it will still be where it was measured once the printer has homed again."""
    share = lasting(part.effect, part.where, part.shape, scene)
    return part if share is None else replace(part, acts_mm=share * part.acts_mm)


def _gains(scene: Scene, parts: Sequence[Part]) -> bool:
    """Say whether what acts makes nearly all drawn machines print better over what was measured."""
    places = drawn_places(scene)
    drawn_mm, acts_mm = np.zeros((len(places), 2, DRAWS)), np.zeros((len(places), 2, 1))
    for part in parts:
        if EFFECTS[part.effect].of is Of.MACHINE:
            columns = columns_of(part.effect, places, part.where, part.shape, scene)
            drawn_mm += np.einsum("ncp,pd->ncd", columns, part.draws_mm)
            acts_mm += np.einsum("ncp,pd->ncd", columns, part.acts_mm[:, None])
    if not scene.placed:
        drawn_mm, acts_mm = drawn_mm - drawn_mm.mean(axis=0), acts_mm - acts_mm.mean(axis=0)
    before, after = (np.square(each).sum(axis=1).mean(axis=0) for each in (drawn_mm, drawn_mm - acts_mm))
    return float(np.mean(after >= before)) <= MOST_WORSE_SHARE


def _weighed_sets(fit: Fit) -> tuple[list[Set], np.ndarray, list[float]]:
    """Return the likeliest set and its neighbours with their weights, and what each member of the likeliest gains."""
    search, state = fit.search, fit.state
    found: dict[frozenset[tuple[int, int]], tuple[Set, float]] = {frozenset(state.members): (state.members, 0.0)}

    def offer(members: Set, log_weight: float) -> None:
        if log_weight > LEAST_LOG_WEIGHT:
            found.setdefault(frozenset(members), (members, log_weight))

    def offer_each(members: Set, gains: Gains, beside: float) -> None:
        for key, gain in zip(gains.keys.tolist(), gains.values.tolist(), strict=True):
            if beside + gain > LEAST_LOG_WEIGHT:
                offer((*members, (key[0], key[1])), beside + gain)

    offer_each(state.members, search.gains(state, search.offered(state.members)), 0.0)
    nats = []
    for at, member in enumerate(state.members):
        others = (*state.members[:at], *state.members[at + 1 :])
        without = search.posterior(others, state.sigma_mm, rounds=0)
        worse = without.score - state.score
        offer(others, worse)
        offer_each(others, search.gains(without, search.offered(others)).without(member), worse)
        nats.append(-worse)
    ranked = sorted(found.values(), key=lambda each: -each[1])[:MOST_SETS]
    weights = np.exp(np.array([log_weight for _, log_weight in ranked]) - ranked[0][1])
    return [members for members, _ in ranked], weights / weights.sum(), nats
