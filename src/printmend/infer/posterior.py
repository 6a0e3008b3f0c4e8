"""The posterior of a machine: draws from all likely sets of effects, weighted by evidence.

Sets are weighed by evidence and prior odds (Bayesian model averaging: Hoeting et al. 1999). Chains that begin with the
likeliest set draw them (Madigan & York 1995). A draw is one set, with sizes from its posterior. An effect of the
likeliest set, or of most draws, acts if its mean lowers the drawn machines' expected square error, and nearly all of
them gain by it.
"""

import itertools
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from printmend.effects import EFFECTS, Of, Places, Scene, columns_of
from printmend.effects.effect import HARDLY_ANY, Key, drawn_places, held_mm
from printmend.effects.homing import lasting
from printmend.infer.fit import Fit
from printmend.infer.gram import Block, Dictionary, summed
from printmend.infer.machine import DRAWS, Part
from printmend.infer.scatter import log_below
from printmend.infer.search import LEAST_BETTER, LEAST_LOG_WEIGHT, Gains, Search, Set, State, likely_choices
from printmend.metrics.robust import DEGREES
from printmend.units import SELDOM_SDS

# Drawn machines from few numbers, where many sets of effects are equally likely: Gibbs sampling over sets.
#
# A set makes K numbers normal, with the covariance Σ Φ V Φᵀ of its blocks and the noise. So one K × K matrix weighs it.
# Each place of an effect in turn chooses among its own state and some drawn from its prior, by their evidence (Andrieu,
# Doucet & Holenstein 2010). The noise is Student's t: each number has a variance of its own, which is drawn, too.

OFFERED = 4  # states drawn from the prior that each place chooses among, beside its own
# Factors on the noise, sweep by sweep: they anneal towards data that no machine fits at first.
AFAR, SWEEPS = 2.0 ** np.arange(8, -1, -1), 24
TINY_MM2 = 1e-9  # variance that keeps sums of squares positive


@dataclass(frozen=True, eq=False)
class Few:
    """K measured numbers: ``columns`` [K, P] of the ``blocks``, ``error_mm`` [K], and its noise ``sigma_mm``."""

    blocks: Sequence[Block]
    columns: np.ndarray
    error_mm: np.ndarray
    sigma_mm: float


@dataclass(frozen=True, eq=False)
class _Slot:
    """What may be at one place of an effect: nothing first, then (block, size). ``chances`` [A] are the prior chances
    of each and all before it, ``kernels`` [A, K, K] the covariances that they give to the numbers. ``halved`` [A, K] is
    what sizes of one sign do to the numbers, 0 for others."""

    states: tuple[tuple[int, int], ...]
    chances: np.ndarray
    kernels: np.ndarray
    halved: np.ndarray

    def drawn(self, shape: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
        """Draw states by their chances, as `rng.choice` does, which checks these every time."""
        return self.chances.searchsorted(rng.random(shape), side="right")


def _slots(few: Few) -> list[_Slot]:
    grouped: dict[tuple[str, int], list[int]] = {}
    for b, block in enumerate(few.blocks):
        grouped.setdefault(block.slot, []).append(b)
    found = []
    for members in grouped.values():
        states, odds, kernels = [(-1, -1)], [1.0], [np.zeros((len(few.columns),) * 2)]
        halved = [np.zeros(len(few.columns))]
        for b in members:
            block = few.blocks[b]
            for v, (sds, log_odds) in enumerate(zip(block.sds_mm, block.log_odds, strict=True)):
                scaled = few.columns[:, block.at] * sds
                states.append((b, v))
                odds.append(float(np.exp(log_odds)))
                kernels.append(scaled @ scaled.T)
                halved.append(scaled[:, 0] * block.signs[v])
        chances = np.cumsum(np.array(odds) / sum(odds))
        found.append(_Slot(tuple(states), chances / chances[-1], np.array(kernels), np.array(halved)))
    return found


def drawn_sizes(few: Few, rng: np.random.Generator, *, sweeps: int = SWEEPS) -> dict[int, np.ndarray]:
    """Return the sizes [P, DRAWS] of each block that any of `DRAWS` drawn machines has, 0 in those without it."""
    slots = _slots(few)
    there = np.zeros((len(slots), DRAWS), np.int64)
    own = np.ones((DRAWS, len(few.error_mm)))  # variance of each number, over the usual one
    for number, factor in enumerate((*AFAR, *[1.0] * sweeps)):
        noise = own[:, :, None] * (factor * few.sigma_mm) ** 2 * np.eye(len(few.error_mm))
        whole = noise + _sum(slots, there)
        for at, slot in enumerate(slots):
            its = slot.kernels[there[at]]
            whole -= its
            offered = np.concatenate([there[at][:, None], slot.drawn((DRAWS, OFFERED), rng)], axis=1)
            mine = np.flatnonzero((offered != offered[:, :1]).any(axis=1))  # others have no choice
            offered = offered[mine]
            weight = _evidence_each(whole[mine], slot, offered, few.error_mm)
            noisy = weight + rng.gumbel(size=weight.shape)  # the largest is one drawn by its weight
            there[at, mine] = offered[np.arange(len(mine)), np.argmax(noisy, axis=1)]
            its[mine] = slot.kernels[there[at, mine]]
            whole += its
        if number >= len(AFAR):  # a number far off counts as a slip only in the last sweeps
            away2 = (_noise_drawn(few, noise, whole, rng) / few.sigma_mm) ** 2
            own = (DEGREES + away2) / (2 * rng.gamma((DEGREES + 1) / 2, size=away2.shape))
    return _sizes(few, slots, there, noise, rng)


def _noise_drawn(few: Few, noise: np.ndarray, whole: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Draw the noise of the numbers [DRAWS, K] under the covariances of all, of which ``noise`` [DRAWS, K, K] is its
    own: one before the numbers, brought to them, is one after them (Matheron's rule)."""
    factors = np.linalg.cholesky(np.stack([noise, whole - noise + TINY_MM2 * np.eye(len(few.error_mm))]))
    mine, rest = (factors @ rng.standard_normal((*factors.shape[:3], 1)))[..., 0]
    return np.asarray(mine + (noise @ np.linalg.solve(whole, (few.error_mm - mine - rest)[:, :, None]))[:, :, 0])


def _sum(slots: Sequence[_Slot], there: np.ndarray) -> np.ndarray:
    return np.asarray(sum(slot.kernels[there[at]] for at, slot in enumerate(slots)))


def _evidence_each(beside: np.ndarray, slot: _Slot, offered: np.ndarray, error_mm: np.ndarray) -> np.ndarray:
    """Return the log evidence [N, A] of the states ``offered`` [N, A] to N draws, each weighed once a draw."""
    first = np.argmax(offered[:, :, None] == offered[:, None, :], axis=2)
    draw, place = np.nonzero(first == np.arange(offered.shape[1]))
    state, weight = offered[draw, place], np.empty(offered.shape)
    weight[draw, place] = _evidence(beside[draw] + slot.kernels[state], error_mm, slot.halved[state])
    return weight[np.arange(len(first))[:, None], first]


def _evidence(covariance: np.ndarray, error_mm: np.ndarray, halved: np.ndarray) -> np.ndarray:
    """Return the log evidence [...] of the errors [K] under covariances [..., K, K], but for a constant.

    Half a normal prior has 2 Φ(mean ÷ standard deviation) times the evidence of a whole one: of what a size of one
    standard deviation, ``halved`` [..., K] as it must be of one sign, does to the errors.
    """
    factor = np.linalg.cholesky(covariance)
    both = np.empty((*halved.shape, 2))
    both[..., 0], both[..., 1] = error_mm, halved
    white = np.linalg.solve(factor, both)
    log_det = np.log(np.diagonal(factor, axis1=-2, axis2=-1)).sum(axis=-1)
    (square, pull), own = np.einsum("...k,...kj->j...", white[..., 0], white), np.square(white[..., 1]).sum(axis=-1)
    half, is_half = np.zeros(own.shape), own > 0
    half[is_half] = log_below(pull[is_half] / np.sqrt(np.maximum(1 - own[is_half], TINY_MM2))) + np.log(2)
    return np.asarray(half - 0.5 * square - log_det)


def _sizes(
    few: Few, slots: Sequence[_Slot], there: np.ndarray, noise: np.ndarray, rng: np.random.Generator
) -> dict[int, np.ndarray]:
    """Draw the sizes of every set, as `_noise_drawn` does the noise; those of the other sign than they must be are cut
    at 0."""
    missed = few.error_mm - np.sqrt(np.diagonal(noise, axis1=1, axis2=2)) * rng.standard_normal(noise.shape[:2])
    sizes: dict[int, np.ndarray] = {}
    spread: dict[int, np.ndarray] = {}
    signs: dict[int, np.ndarray] = {}
    for at, slot in enumerate(slots):
        for draw in np.flatnonzero(there[at]):
            b, v = slot.states[there[at, draw]]
            block = few.blocks[b]
            sd = block.sds_mm[v]
            if b not in sizes:
                sizes[b], spread[b], signs[b] = np.zeros((len(sd), DRAWS)), np.zeros((len(sd), DRAWS)), np.zeros(DRAWS)
            sizes[b][:, draw], spread[b][:, draw] = sd * rng.standard_normal(len(sd)), sd
            signs[b][draw] = block.signs[v]
            missed[draw] -= few.columns[:, block.at] @ sizes[b][:, draw]
    pull = np.linalg.solve(noise + _sum(slots, there), missed[:, :, None])[:, :, 0]
    for b, sd in spread.items():
        sizes[b] += sd**2 * (few.columns[:, few.blocks[b].at].T @ pull.T)
        sizes[b] *= signs[b] * sizes[b] >= 0
    return sizes


ROUNDS = 3  # of the chain of each draw
TRIES = 64  # draws for each one whose sizes have to be of one sign


@dataclass(frozen=True, eq=False)
class Posterior:
    """The belief about a machine: its ``parts``, those of the ``likely`` set first, and the support of each effect of
    that set, in nats."""

    scene: Scene
    parts: tuple[Part, ...]
    likely: State
    nats: tuple[float, ...]

    @property
    def noise_mm(self) -> float:
        """The noise of a measured coordinate."""
        return self.likely.sigma_mm


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
    likely = likely_set(fit.search, fit.state, sets)
    order = dict.fromkeys(b for members in (likely.members, *sets) for b, _ in members)
    draws = {b: np.zeros((blocks[b].width, DRAWS)) for b in order}
    first_draw = 0
    for members, count in sets.items():
        state = states[members]
        mine = slice(first_draw, first_draw := first_draw + count)
        sizes_mm = drawn_of(state, fit.search.signs_of(members), count, rng)
        for (b, _), own in zip(members, fit.dictionary.own(members), strict=True):
            draws[b][:, mine] = sizes_mm[own]
    drawn = {b: Part(*blocks[b].key, np.zeros(len(each)), each) for b, each in draws.items()}
    fit = replace(fit, state=central(fit, drawn, [likely, *sorted(states.values(), key=lambda each: -each.score)]))
    acting_mm = _acting_mm(fit.dictionary, [fit.state])[:, 0]
    order = dict.fromkeys([*(b for b, _ in fit.state.members), *drawn])
    parts = [replace(drawn[b], acts_mm=acting_mm[blocks[b].at]) for b in order]
    return Posterior(fit.scene, tuple(acting(fit.scene, parts)), fit.state, _nats(fit))


def likely_set(search: Search, likeliest: State, sets: Counter[Set]) -> State:
    """Return the likeliest set, with the effects that most draws have where the set has none.

    A cause of many shapes or sizes may be in most sets but not in the likeliest one, and an effect that is more likely
    than not belongs to a prediction (Barbieri & Berger 2004). Nothing is removed, because each of several rivals may be
    in fewer than half of the draws.
    """
    blocks, state = search.dictionary.blocks, likeliest
    drawn, there = {b for members in sets for b, _ in members}, {blocks[b].slot for b, _ in likeliest.members}
    draws = Counter(slot for members in sets.elements() for slot in {blocks[b].slot for b, _ in members})
    for slot in (slot for slot, count in draws.most_common() if 2 * count > DRAWS and slot not in there):
        alike = [b for b in search.offered(state.members).tolist() if b in drawn and blocks[b].slot == slot]
        if alike:  # else it needs what is not there
            more, _ = search.gains(state, np.array(alike)).best()
            state = search.posterior((*state.members, more), state.sigma_mm, rounds=0)
    return state


def central(fit: Fit, drawn: Mapping[int, Part], states: Sequence[State]) -> State:
    """Return the first of some states whose machine is closest to the drawn machines.

    The distance is the mean square over the measured places; a difference within twice its error does not count. Causes
    that look alike in a scan may be mended very differently, and the likeliest of three may be the farthest from the
    other two. If positions on the bed are known, causes that look alike print alike. Then the likeliest one is as close
    as any, and the only one at whose contacts the rows were fitted.
    """
    if fit.scene.placed:
        return states[0]
    places, sizes_mm = drawn_places(fit.scene), _acting_mm(fit.dictionary, states)
    machines, prints = np.zeros((2 * len(places), len(states))), np.zeros((2 * len(places), DRAWS))
    for b, part in drawn.items():
        if EFFECTS[part.effect].of is Of.MACHINE:
            columns = seen_at(part.key, places, fit.scene).reshape(2 * len(places), -1)
            machines += columns @ sizes_mm[fit.dictionary.blocks[b].at]
            prints += columns @ part.draws_mm
    loss = np.square(machines).sum(axis=0) - 2 * prints.T @ machines  # [D, S], but for what all states share
    more = loss - loss[:, [int(np.argmin(loss.mean(axis=0)))]]
    return states[int(np.argmax(more.mean(axis=0) <= SELDOM_SDS * more.std(axis=0) / np.sqrt(DRAWS)))]


def _acting_mm(dictionary: Dictionary, states: Sequence[State]) -> np.ndarray:
    """Return the sizes [P, S] of a dictionary's columns in the machines of some states: 0 where none holds them."""
    sizes_mm = np.stack([state.laid_out_mm(dictionary.columns.shape[1]) for state in states], axis=1)
    for block in dictionary.blocks:
        sizes_mm[block.at] = held_mm(EFFECTS[block.effect], sizes_mm[block.at])
    return sizes_mm


def seen_at(key: Key, places: Places, scene: Scene) -> np.ndarray:
    """Return how far an effect moves places [2, N, P] for one unit of each size. If the pose of the print is unknown, a
    shift and a turn of the whole print are subtracted."""
    name, where, shape = key
    columns = columns_of(name, places, where, shape, scene)
    return columns.transpose(1, 0, 2) if scene.placed else of_shape(columns, places)


def drawn_of(state: State, signs: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Draw sizes [P, count] of a set. Those with ``signs`` [P] of 1 or −1 are drawn until all have these; after `TRIES`
    they are cut at 0. The others follow by their covariance."""
    halved = np.flatnonzero(signs)
    sizes_mm = state.mean_mm[:, None] + state.root.T @ rng.standard_normal((len(state.columns), count))
    covariance, mean_mm = state.root.T @ state.root[:, halved], state.mean_mm[halved, None]
    tried = mean_mm + np.linalg.cholesky(covariance[halved]) @ rng.standard_normal((len(mean_mm), TRIES * count))
    sign = signs[halved, None]
    right = np.concatenate([tried[:, (sign * tried >= 0).all(axis=0)], sign * np.maximum(sign * tried, 0.0)], axis=1)
    moved_mm = right[:, :count] - sizes_mm[halved]
    return np.asarray(sizes_mm + covariance @ np.linalg.solve(covariance[halved], moved_mm))


def after_homing(part: Part, scene: Scene) -> Part:
    """Return a part that acts with the share that stays in place when the printer homes again."""
    share = lasting(part.acts_mm, *part.key, scene)
    return part if share is None else replace(part, acts_mm=share * part.acts_mm)


def acting(scene: Scene, parts: Sequence[Part]) -> list[Part]:
    """Return the parts. A part no longer acts if the drawn machines' expected square error is smaller without it, or if
    too many of these machines gain nothing from it.

    Errors count over the measured places, less any shift of the whole print; where the place is known, the belts'
    places then give the print the shift of the drawn machines. Parts are added and removed one by one, the most useful
    first, starting once with all and once with none, because some help only together with others. Then the part without
    which most machines gain is left out. Wear of the measured print acts only together with parts of the machine,
    because the position of a belt in its new play at home is unknown.
    """
    places, machine = drawn_places(scene), np.array([EFFECTS[part.effect].of is Of.MACHINE for part in parts], bool)
    acts, drawn = np.zeros((2, len(places), len(parts))), np.zeros((2, len(places), DRAWS))
    for at, part in enumerate(parts):
        if machine[at]:
            columns = seen_at(part.key, places, scene)
            acts[..., at] = columns @ part.acts_mm
            drawn += columns @ part.draws_mm
    shift_mm, drawn_mm = acts.mean(axis=1), np.median(drawn.mean(axis=1), axis=1)
    acts, drawn = ((each - each.mean(axis=1, keepdims=True)).reshape(2 * len(places), -1) for each in (acts, drawn))
    products, pull = acts.T @ acts, acts.T @ drawn
    mine = machine & np.array([part.acts_mm.any() and part.effect != "place" for part in parts], bool)

    def worse(kept: np.ndarray) -> tuple[float, float]:
        gained = 2 * kept @ pull - kept @ products @ kept
        return float(np.mean(gained <= 0)), -float(gained.mean())

    def helpful(kept: np.ndarray) -> np.ndarray:
        while mine.any():
            more = np.where(kept, -2, 2) * (pull.mean(axis=1) - products @ kept) - np.diag(products)
            best = int(np.argmax(np.where(mine, more, -np.inf)))
            if more[best] <= 0:
                break
            kept = kept ^ (np.arange(len(parts)) == best)
        return kept

    kept = min((helpful(mine), helpful(np.zeros_like(mine))), key=lambda each: worse(each)[1])
    while kept.any() and worse(kept)[0] > HARDLY_ANY:
        kept = min((kept & (np.arange(len(parts)) != at) for at in np.flatnonzero(kept)), key=worse)
    is_any = kept.any() or any(part.effect == "place" and part.is_likely for part in parts)
    found = [
        part if does else replace(part, acts_mm=np.zeros_like(part.acts_mm))
        for part, does in zip(parts, kept | (~machine & is_any), strict=True)
    ]
    return _shifted(scene, found, drawn_mm - shift_mm @ kept) if scene.placed else found


def _shifted(scene: Scene, parts: Sequence[Part], by_mm: np.ndarray) -> list[Part]:
    """Return the parts, with places of the belts that shift all of the print by another ``by_mm`` [2]. Where nothing
    else acts, only those act that most of the drawn machines have."""
    found, is_any = list(parts), any(part.acts_mm.any() for part in parts)
    for motor, belt_mm in enumerate(scene.printer.to_motor(by_mm)):
        at = next((at for at, part in enumerate(found) if part.key[:2] == ("place", motor)), len(found))
        place = found[at] if at < len(found) else Part("place", motor, (), np.zeros(1), np.zeros((1, DRAWS)))
        found[at : at + 1] = [replace(place, acts_mm=np.array([belt_mm * (is_any or place.is_likely)]))]
    return found


def of_shape(moved_mm: np.ndarray, places: Places) -> np.ndarray:
    """Return what of errors [N, 2, D] no shift and no turn of the whole print makes, as [2, N, D]."""
    x, y = (places.bed_mm - places.bed_mm.mean(axis=0)).T
    rigid = np.stack([[np.ones_like(x), 0 * x], [0 * x, np.ones_like(x)], [-y, x]]).reshape(3, -1)
    rigid /= np.linalg.norm(rigid, axis=1, keepdims=True)
    flat = moved_mm.transpose(1, 0, 2).reshape(rigid.shape[1], -1)
    return np.asarray(flat - rigid.T @ (rigid @ flat)).reshape(2, len(x), -1)


def drawn_sets(search: Search, likeliest: State, rng: np.random.Generator) -> list[Set]:
    """Return a set for each draw: the end of its own chain, which began with the likeliest set.

    Members that nothing can replace stay, and only their alternative in size is drawn. The effects of a family are also
    exchanged all at once. Blocks that can only be added to the likeliest set are not part of the chains: each of them
    may be added to any set, independently of the others.
    """
    search = search.apart()
    families = [choices for family in search.families if (choices := _rivals(search, likeliest, family))]
    rivals, sizes, more = _beside(search, likeliest, families)
    alternatives: dict[int, list[int]] = {}
    for b, variant in dict.fromkeys([*likeliest.members, *itertools.chain(*rivals)]):
        alternatives.setdefault(b, []).append(variant)
    few = search.narrowed([search.dictionary.blocks[b].some(own) for b, own in alternatives.items()])
    number = {(b, v): (at, n) for at, (b, some) in enumerate(alternatives.items()) for n, v in enumerate(some)}
    key = {own: each for each, own in number.items()}
    every, sure = (tuple(number[member] for member in some) for some in (likeliest.members, sizes))
    # What is of one sign is not summed out: a set may ask for another, and its score has to say so.
    staying: Set = tuple((b, variant) for b, variant in sure if not few.dictionary.blocks[b].signs[variant])
    few = few.given(staying, likeliest.sigma_mm)
    few = replace(few, gram=summed([few.gram], len(few.gram.slope)))  # every chain asks for the same products
    numbered = [[tuple(sorted(number[member] for member in choice)) for choice in choices] for choices in families]
    grouped = [(frozenset(b for choice in choices for b, _ in choice), choices) for choices in numbered]
    chain = _Chain(few, staying, likeliest.sigma_mm)
    sets: list[Set] = [tuple(member for member in every if member not in staying)] * DRAWS
    for some in rivals * ROUNDS:
        mine = frozenset(number[each][0] for each in some)
        for _ in range(1 + len(set(likeliest.members).intersection(some))):  # a step takes one of them away, or none
            alike = Counter(sets).items()
            sets = [each for members, count in alike for each in chain.stepped(members, count, mine, rng)]
        for blocks, choices in grouped:
            if not mine.isdisjoint(blocks):
                alike = Counter(sets).items()
                sets = [
                    each for members, count in alike for each in chain.regrouped(members, blocks, choices, count, rng)
                ]
    chained = [tuple(key[member] for member in (*staying, *members)) for members in sets]
    return [tuple(sorted(each)) for each in _with_more(search, _resized(chained, sizes, rng), more, rng)]


@dataclass(frozen=True, eq=False)
class _Chain:
    """Steps among sets beside members that are ``staying``. ``known`` is what may come to sets that were asked for."""

    search: Search
    staying: Set
    sigma_mm: float
    known: dict[tuple[Set, frozenset[int]], Gains] = field(default_factory=dict, init=False)

    def stepped(self, members: Set, count: int, rivals: frozenset[int], rng: np.random.Generator) -> Iterator[Set]:
        """Remove one member that is among the blocks ``rivals``, or none, and choose one of them in its place, or
        nothing, by what each adds to the score (Gibbs sampling), for ``count`` draws that have a set.

        Each of n members is removed with the chance 1 ÷ (n + 1), so the step from the larger set is the rarer one.
        """
        whole = (*self.staying, *members)
        free = [one for one in members if one[0] in rivals and not self.search.needed(whole, one)]
        for at, often in Counter(drawn_by(np.ones(len(free) + 1), count, rng).tolist()).items():
            others = tuple(sorted(member for member in members if member not in free[at : at + 1]))
            gains, most = self._gains(others, rivals), len(free) + (at == len(free))
            odds = _chances(np.append(gains.values + np.log(most / (most + 1)), 0.0))
            for choice in drawn_by(odds, often, rng).tolist():
                chosen = gains.keys[choice : choice + 1].tolist()  # none where it is the last
                yield (*others, *((b, variant) for b, variant in chosen))

    def regrouped(
        self, members: Set, blocks: frozenset[int], choices: Sequence[Set], count: int, rng: np.random.Generator
    ) -> Iterator[Set]:
        """Draw the effects of one family again, as a set of its ``blocks``, by what each set adds to the score (Gibbs
        sampling), for ``count`` draws that have a set."""
        others = tuple(member for member in members if member[0] not in blocks)
        own = tuple(sorted(member for member in members if member[0] in blocks))
        every = list(dict.fromkeys([own, *choices]))
        state = self.search.posterior(others, self.sigma_mm, rounds=0)
        odds = _chances(self.search.beside(state).together(every))
        for choice in drawn_by(odds, count, rng).tolist():
            yield tuple(sorted((*others, *every[choice])))

    def _gains(self, others: Set, rivals: frozenset[int]) -> Gains:
        if (others, rivals) not in self.known:
            state = self.search.posterior(others, self.sigma_mm, rounds=0)
            offered = [b for b in self.search.offered((*self.staying, *others)).tolist() if b in rivals]
            gains = self.search.gains(state, np.array(offered, int))
            self.known[others, rivals] = gains.above(LEAST_LOG_WEIGHT)
        return self.known[others, rivals]


def _chances(scores: np.ndarray) -> np.ndarray:
    """Return the chances of alternatives by their scores."""
    odds = np.exp(scores - scores.max())
    return np.asarray(odds / odds.sum())


def drawn_by(odds: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Draw ``count`` indices of alternatives, each as often as its ``odds`` say, to within one draw (systematic
    sampling: Madow & Madow 1944)."""
    ends = np.cumsum(odds)
    evenly = (np.arange(count) + rng.random()) * (ends[-1] / count)
    return rng.permutation(ends[:-1].searchsorted(evenly, side="right"))


def _resized(sets: list[Set], sizes: dict[tuple[int, int], Gains], rng: np.random.Generator) -> list[Set]:
    """Return the sets with each member that nothing replaces in one of the alternatives in size that it may have."""
    for member, gains in sizes.items():
        chosen = map(tuple, gains.keys[drawn_by(_chances(gains.values), len(sets), rng)].tolist())
        sets = [tuple(own if each == member else each for each in some) for some, own in zip(sets, chosen, strict=True)]
    return sets


def _with_more(search: Search, sets: list[Set], more: Gains, rng: np.random.Generator) -> Iterator[Set]:
    """Yield sets with what may come to them, of each slot one block at most, as often as it is there."""
    slots: dict[tuple[str, int], list[int]] = {}
    for at, b in enumerate(more.keys[:, 0].tolist()):
        slots.setdefault(search.dictionary.blocks[b].slot, []).append(at)
    chosen = [
        np.array([-1, *own])[drawn_by(_chances(np.append(0.0, more.values[own])), len(sets), rng)]  # −1: none
        for own in slots.values()
    ]
    for members, some in zip(sets, np.array(chosen, np.int64).reshape(-1, len(sets)).T, strict=True):
        for b, variant in more.keys[some[some >= 0]].tolist():
            if b in search.offered(members):
                members = (*members, (b, variant))
        yield members


def _rivals(search: Search, likeliest: State, family: Sequence[Set]) -> list[Set]:
    """Return the sets of a family's effects that may take the place of the likeliest set's; none where all of them are
    the same effects, or where it has none."""
    others, choices, _ = likely_choices(search, likeliest, family)
    there = frozenset(b for b, _ in set(likeliest.members).difference(others))
    return choices if there and {frozenset(dict(choice)) for choice in choices} != {there} else []


def _beside(
    search: Search, likeliest: State, families: Sequence[Sequence[Set]]
) -> tuple[list[Set], dict[tuple[int, int], Gains], Gains]:
    """Return each group of members of the likeliest set with what may come in their place; the members whose place
    nothing does, with their alternatives in size; and what all other blocks add beside the set. Sets of each of some
    ``families`` may take each other's place."""
    members, beside = likeliest.members, search.beside(likeliest)
    rivals: list[Set] = [tuple(dict.fromkeys(itertools.chain(*choices))) for choices in families]
    exchanged = {b for some in rivals for b, _ in some}
    sure, more = {}, beside.gains(search.offered(members))
    for at, member in enumerate(members):
        others = (*members[:at], *members[at + 1 :])
        gains = beside.without(member).gains(search.offered(others), LEAST_LOG_WEIGHT).above(LEAST_LOG_WEIGHT)
        blocks = {member[0], *gains.keys[:, 0].tolist()}
        alone = blocks == {member[0]} and member[0] not in exchanged
        if alone and gains.values.max() > -LEAST_LOG_WEIGHT:
            sure[member] = gains
            continue
        alike = [each for each in rivals if not blocks.isdisjoint(b for b, _ in each)]
        group = (member, *map(tuple, gains.keys.tolist()), *itertools.chain(*alike))
        rivals = [*(each for each in rivals if each not in alike), group]
    found = [b for b, _ in (*members, *itertools.chain(*rivals))]
    return rivals, sure, more.of(~np.isin(more.keys[:, 0], found))


def _nats(fit: Fit) -> tuple[float, ...]:
    """Return how much the score of the likely set loses without each of its members."""
    members, score = fit.state.members, fit.state.score
    others = [(*members[:at], *members[at + 1 :]) for at in range(len(members))]
    return tuple(score - fit.search.posterior(each, fit.state.sigma_mm, rounds=0).score for each in others)
