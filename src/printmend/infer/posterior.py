"""The posterior of a machine: draws from all likely sets of effects, weighted by evidence.

Sets are weighed by evidence and prior odds (Bayesian model averaging: Hoeting et al. 1999): those that a chain from the
likeliest comes by (Madigan & York 1995). A draw is one of these sets, with sizes from its posterior. An effect of
the likeliest set acts where its mean lowers the expected square of the drawn machines' errors, and hardly any of them
gains nothing by it.
"""

from bisect import bisect
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from printmend.effects import EFFECTS, Acts, Of, Places, Scene, columns_of
from printmend.effects.homing import lasting
from printmend.effects.sample import drawn_places
from printmend.infer.fit import Fit
from printmend.infer.part import DRAWS, Part
from printmend.infer.search import LEAST_BETTER, Gains, Search, Set, State

LEAST_LOG_WEIGHT = -9.0  # the chain leaves out sets less likely than e^−9 of the likeliest
STEPS = 150  # of the chain
MOST_WORSE_SHARE = 0.05  # of the drawn machines that may print no better mended


@dataclass(frozen=True, eq=False)
class Posterior:
    """The belief about a machine: its ``parts``, those of the likeliest set first (``likely`` of them), the noise of a
    measured coordinate, and the support of each effect of the likeliest set, in nats."""

    scene: Scene
    parts: tuple[Part, ...]
    likely: int
    noise_mm: float
    nats: tuple[float, ...]


def posterior_of(fit: Fit, rng: np.random.Generator) -> Posterior:
    """Draw machines from the sets about the likeliest one; the parts that survive a homing act."""
    found = posterior_here(fit, rng)
    return replace(found, parts=tuple(after_homing(part, fit.scene) for part in found.parts))


def posterior_here(fit: Fit, rng: np.random.Generator) -> Posterior:
    """Draw machines as the measured print had them."""
    blocks = fit.dictionary.blocks
    sets = Counter(drawn_sets(fit.search, fit.state, rng))
    states = {members: fit.search.posterior(members, fit.state.sigma_mm, rounds=0) for members in sets}
    likeliest = max(states.values(), key=lambda state: state.score)
    if likeliest.score > fit.state.score + LEAST_BETTER:  # the chain may find a likelier set than the search did
        fit = replace(fit, state=likeliest)
    likely = [b for b, _ in fit.state.members]
    order = list(dict.fromkeys([*likely, *(b for members in sets for b, _ in members)]))
    draws = {b: np.zeros((blocks[b].at.stop - blocks[b].at.start, DRAWS)) for b in order}
    first_draw = 0
    for members, count in sets.items():
        state = states[members]
        mine = slice(first_draw, first_draw := first_draw + count)
        root = np.linalg.cholesky(state.covariance + 1e-14 * np.eye(len(state.columns)))
        sizes_mm = state.mean_mm[:, None] + root @ rng.standard_normal((len(state.columns), count))
        for (b, _), own in zip(members, fit.dictionary.own(members), strict=True):
            draws[b][:, mine] = np.maximum(sizes_mm[own], 0.0) if blocks[b].positive else sizes_mm[own]
    acts = {part.key: part.sizes_mm for part in fit.parts() if EFFECTS[part.effect].acts is not Acts.NOT}
    parts = []
    for b in order:
        key = (blocks[b].effect, blocks[b].where, blocks[b].shape)
        acts_mm = acts.get(key) if b in likely else None
        parts.append(Part(*key, np.zeros(len(draws[b])) if acts_mm is None else acts_mm, draws[b]))
    return Posterior(fit.scene, tuple(acting(fit.scene, parts)), len(likely), fit.state.sigma_mm, _nats(fit))


def after_homing(part: Part, scene: Scene) -> Part:
    """Return a part that acts with the share that stays in place when the printer homes again."""
    share = lasting(part.acts_mm, part.effect, part.where, part.shape, scene)
    return part if share is None else replace(part, acts_mm=share * part.acts_mm)


def acting(scene: Scene, parts: Sequence[Part]) -> Iterator[Part]:
    """Yield the parts; one acts no longer where the drawn machines' expected square error is smaller without it, and
    none does where too many of these machines would gain nothing.

    Errors count over the measured places. Parts are asked one by one, the most harmful beside the others first. Wear of
    the measured print acts beside parts of the machine alone: where a belt with new play rests at home, nobody knows.
    """
    places, machine = drawn_places(scene), np.array([EFFECTS[part.effect].of is Of.MACHINE for part in parts], bool)
    drawn_mm, acts_mm = np.zeros((len(places), 2, DRAWS)), np.zeros((len(places), 2, len(parts)))
    for at, part in enumerate(parts):
        if machine[at]:
            columns = columns_of(part.effect, places, part.where, part.shape, scene)
            drawn_mm += columns @ part.draws_mm
            acts_mm[:, :, at] = columns @ part.acts_mm
    acts, drawn = (
        (each if scene.placed else _of_shape(each, places)).reshape(2 * len(places), -1) for each in (acts_mm, drawn_mm)
    )
    products, pull = acts.T @ acts, acts.T @ drawn
    kept = machine & np.array([part.acts_mm.any() for part in parts], bool)
    while kept.any():
        gains = 2 * (pull.mean(axis=1) - products @ kept) + np.diag(products)
        worst = int(np.argmin(np.where(kept, gains, np.inf)))
        if gains[worst] >= 0:
            break
        kept[worst] = False
    kept &= np.mean(2 * kept @ pull <= kept @ products @ kept) <= MOST_WORSE_SHARE
    for part, does in zip(parts, kept | (~machine & kept.any()), strict=True):
        yield part if does else replace(part, acts_mm=np.zeros_like(part.acts_mm))


def _of_shape(moved_mm: np.ndarray, places: Places) -> np.ndarray:
    """Return what of errors [N, 2, D] no shift and no turn of the whole print makes, as [2, N, D]."""
    x, y = (places.bed_mm - places.bed_mm.mean(axis=0)).T
    rigid = np.stack([[np.ones_like(x), 0 * x], [0 * x, np.ones_like(x)], [-y, x]]).reshape(3, -1)
    rigid /= np.linalg.norm(rigid, axis=1, keepdims=True)
    flat = moved_mm.transpose(1, 0, 2).reshape(rigid.shape[1], -1)
    return np.asarray(flat - rigid.T @ (rigid @ flat)).reshape(2, len(x), -1)


def drawn_sets(search: Search, likeliest: State, rng: np.random.Generator) -> list[Set]:
    """Return a set for each draw, by its weight among all that a chain came by.

    A step takes one member away, or none, and chooses what comes in its place, or nothing, by what each adds to the
    score (Gibbs sampling). Members that nothing replaces stay. How often the chain is somewhere counts for nothing: it
    seldom goes where two members have to change at once, and then stays there for long.
    """
    blocks, certain = _beside(search, likeliest)
    number = {b: at for at, b in enumerate(blocks)}
    every, sure = (tuple((number[b], variant) for b, variant in some) for some in (likeliest.members, certain))
    search = search.narrowed(blocks)
    # What is above 0 is not summed out: a set may ask for less, and its score has to say so.
    staying: Set = tuple(member for member in sure if not search.dictionary.blocks[member[0]].positive)
    members: Set = tuple(member for member in every if member not in staying)
    search = search.given(staying, likeliest.sigma_mm)
    known: dict[Set, Gains] = {}
    scores: dict[Set, float] = {}
    for _ in range(STEPS):
        free = [one for one in members if one not in sure and not search.needed((*staying, *members), one)]
        taken = [*free, None][int(rng.integers(len(free) + 1))]
        others = tuple(sorted(member for member in members if member != taken))
        if others not in known:
            without = search.posterior(others, likeliest.sigma_mm, rounds=0)
            known[others] = search.gains(without, search.offered((*staying, *others))).above(LEAST_LOG_WEIGHT)
            scores[others] = without.score
            for key, gain in zip(map(tuple, known[others].keys.tolist()), known[others].values.tolist(), strict=True):
                at = bisect(others, key)
                scores[*others[:at], key, *others[at:]] = without.score + gain
        gains = np.append(known[others].values, 0.0)
        choice = int(np.argmax(gains + rng.gumbel(size=len(gains))))  # the largest is one drawn by its weight
        chosen = known[others].keys[choice : choice + 1].tolist()  # none where it is the last
        members = (*others, *((b, variant) for b, variant in chosen))
    sets, weights = list(scores), np.exp(np.array(list(scores.values())) - max(scores.values()))
    drawn = rng.choice(len(sets), DRAWS, p=weights / weights.sum())
    return [tuple(sorted((blocks[b], variant) for b, variant in (*staying, *sets[each]))) for each in drawn]


def _beside(search: Search, likeliest: State) -> tuple[list[int], Set]:
    """Return the blocks of the likeliest set, and those that may well come beside one, or in its place; and the members
    whose place none does."""
    members, beside = likeliest.members, search.beside(likeliest)
    found, sure = [b for b, _ in members], []
    found += beside.gains(search.offered(members)).above(LEAST_LOG_WEIGHT).keys[:, 0].tolist()
    for at, member in enumerate(members):
        others = (*members[:at], *members[at + 1 :])
        gains = beside.without(member).gains(search.offered(others)).above(LEAST_LOG_WEIGHT)
        found += gains.keys[:, 0].tolist()
        if set(gains.keys[:, 0]) == {member[0]} and gains.values.max() > -LEAST_LOG_WEIGHT:
            sure.append(member)
    return list(dict.fromkeys(found)), tuple(sure)


def _nats(fit: Fit) -> tuple[float, ...]:
    """Return how much the score of the likeliest set loses without each of its members."""
    members, score = fit.state.members, fit.state.score
    others = [(*members[:at], *members[at + 1 :]) for at in range(len(members))]
    return tuple(score - fit.search.posterior(each, fit.state.sigma_mm, rounds=0).score for each in others)
