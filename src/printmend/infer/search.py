"""Find the set of effects that explains a measurement: forward, backward and swap steps by log evidence and prior odds.

Effects that are linear in the position on the bed form a family, and so do those that shift everything. Within a
family, several effects can replace several others, so all of its sets are compared at once.

With the noise σ and a set's prior variances V given, errors are normal with covariance σ² + Φ V Φᵀ. The gain of one
more block follows from its part of the Gram matrix: with S its information and r its slope after the set's own part is
subtracted, ½ rᵀ(S + V⁻¹)⁻¹r − ½ log det(1 + V S) (MacKay 1992; Tipping & Faul 2003). A size that must have one sign
has half a normal prior: its evidence is 2 Φ(±mean ÷ standard deviation) times as large.
"""

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from printmend.effects import EFFECTS, Of
from printmend.effects.effect import LINEAR, SHIFTS
from printmend.infer import kernels
from printmend.infer.gram import Block, Dictionary, Gram, Rows, gram_of, laid_side_by_side, slices
from printmend.infer.scatter import log_below

LEAST_SIGMA_MM = 2e-3  # of any instrument; tables and G-code are written to half of it
LEAST_BETTER = 1e-6  # of the score: what rounding leaves
LEAST_LOG_WEIGHT = -9.0  # what is less likely than e^−9 of something else hardly ever happens beside it
SETTLED_SHARE = 1e-3  # of the noise's variance: a score near its maximum changes by the square
FAMILIES = (LINEAR, SHIFTS)  # effects of which several stand for several others
MOST_ALIKE = 4  # effects of a family in a set: a linear map of the bed has four numbers, and four effects shift it
Set = tuple[tuple[int, int], ...]  # (block, alternative in size) of each member


def alone(members: Set) -> Set:
    """Return a set with its blocks numbered as in a dictionary of these alone."""
    return tuple((at, variant) for at, (_, variant) in enumerate(members))


@dataclass(frozen=True, eq=False)
class State:
    """A set of blocks and its posterior: ``columns`` [A] are the numbers of its columns, ``mean_mm`` [A] their sizes,
    ``root`` [A, A] the root of their ``covariance``, ``sigma_mm`` the noise, ``score`` the log evidence plus log
    odds."""

    members: Set
    columns: np.ndarray
    mean_mm: np.ndarray
    root: np.ndarray
    sigma_mm: float
    score: float

    @cached_property
    def covariance(self) -> np.ndarray:
        """The covariance of the sizes [A, A]."""
        return np.asarray(self.root.T @ self.root)

    def laid_out_mm(self, count: int) -> np.ndarray:
        """Return the sizes of a dictionary's ``count`` columns, 0 where the set has none."""
        sizes = np.zeros(count)
        sizes[self.columns] = self.mean_mm
        return sizes


@dataclass(frozen=True, eq=False)
class Gains:
    """The gains of adding to a set: ``keys`` [K, 2], a block and its size, and what each adds to the score [K]."""

    keys: np.ndarray
    values: np.ndarray

    def without(self, key: tuple[int, int]) -> "Gains":
        return self.of((self.keys != key).any(axis=1))

    def above(self, log_weight: float) -> "Gains":
        """Return those that weigh more than e^``log_weight`` of the largest, or of adding nothing."""
        return self.of(self.values > log_weight + self.values.max(initial=0.0))

    def of(self, kept: np.ndarray) -> "Gains":
        """Return those that are ``kept`` [K]."""
        return Gains(self.keys[kept], self.values[kept])

    def best(self) -> tuple[tuple[int, int], float]:
        """Return the key that adds most, and how much; none does where there is nothing to add."""
        if not len(self.values):
            return (-1, -1), -np.inf
        at = int(np.argmax(self.values))
        return (int(self.keys[at, 0]), int(self.keys[at, 1])), float(self.values[at])


@dataclass(frozen=True, eq=False)
class Search:
    """A dictionary and its Gram matrix."""

    dictionary: Dictionary
    gram: Gram

    def posterior(self, members: Set, sigma_mm: float, *, rounds: int = 3) -> State:
        """Return the posterior of a set, the noise found by ``rounds`` of expectation and maximisation."""
        columns, sds_mm = self.prior_of(members)
        odds = sum(float(self.dictionary.blocks[b].log_odds[v]) for b, v in members)
        least_mm2 = max(LEAST_SIGMA_MM, self.gram.least_mm) ** 2
        errors = self.gram.square, self.gram.count
        limits = max(sigma_mm**2, least_mm2), least_mm2, rounds, SETTLED_SHARE
        mean_mm, root = np.empty(len(columns)), np.empty((len(columns), len(columns)))
        matrix, slope = self.gram.between(columns, columns), self.gram.slope[columns]
        variance, evidence = kernels.weigh(matrix, slope, sds_mm, self.signs_of(members), errors, limits, mean_mm, root)
        return State(members, columns, mean_mm, root, math.sqrt(variance), evidence + odds)

    def gains(self, state: State, offered: np.ndarray) -> Gains:
        """Return what each alternative of the ``offered`` blocks adds to the score of a set that has none of them."""
        return self.beside(state).gains(offered)

    def beside(self, state: State) -> "Beside":
        """Return what the rows tell of all blocks beside a set."""
        crossing = self.gram.between(state.columns)
        return Beside(self, state, crossing, (self.gram.slope - state.mean_mm @ crossing) / state.sigma_mm**2)

    def given(self, members: Set, sigma_mm: float) -> "Search":
        """Return the search for the rest of a set with these members; their sizes are integrated out."""
        columns, sd = self.prior_of(members)
        gram, _, _ = self.gram.summed_out(columns, np.zeros(len(sd)), np.diag(sd), sigma_mm)
        return replace(self, gram=gram)

    def apart(self) -> "Search":
        """Return the search with the odds of each block alone, which finer shapes beside it share."""
        blocks = (replace(block, log_odds=block.log_odds + block.own_odds) for block in self.dictionary.blocks)
        return Search(replace(self.dictionary, blocks=tuple(blocks)), self.gram)

    def prior_of(self, members: Set) -> tuple[np.ndarray, np.ndarray]:
        """Return the numbers of a set's columns [A] and the standard deviations of their sizes [A]."""
        blocks = self.dictionary.blocks
        sds_mm = np.concatenate([np.zeros(0), *(blocks[b].sds_mm[variant] for b, variant in members)])
        return columns_at(blocks[b] for b, _ in members), sds_mm

    def signs_of(self, members: Set) -> np.ndarray:
        """Return the sign of each of a set's sizes [A] that has to be above 0 or below it, 0 for others."""
        chosen = [(self.dictionary.blocks[b], v) for b, v in members]
        signs = np.array([block.signs[v] for block, v in chosen], float)
        return np.repeat(signs, np.array([block.width for block, _ in chosen], int))

    @cached_property
    def families(self) -> list[list[Set]]:
        """For each family, every choice of its effects that a set may hold; a family with one choice alone is left out.
        A choice has at most one effect at a place, and those that are likely before the rows say anything."""
        every = (list(self._choices(names)) for names in FAMILIES)
        return [choices for choices in every if len(choices) > 1]

    def _choices(self, names: Sequence[str]) -> Iterator[Set]:
        """Yield the sets that a set may have of some effects."""
        blocks, slots = self.dictionary.blocks, dict[tuple[str, int], Set]()
        for b, block in enumerate(blocks):
            if block.effect in names and not block.shape:
                slots[block.slot] = (*slots.get(block.slot, ()), *((b, v) for v in range(len(block.log_odds))))
        sure = {slot for slot, ((b, variant), *_) in slots.items() if blocks[b].log_odds[variant] >= 0}
        for count in range(MOST_ALIKE + 1):
            for some in itertools.combinations(slots, count):
                if sure <= {*some}:
                    yield from itertools.product(*(slots[slot] for slot in some))

    def narrowed(self, blocks: Sequence[Block]) -> "Search":
        """Return the search among some of the blocks alone, in this order; each may have fewer alternatives in size."""
        columns = columns_at(blocks)
        some = Dictionary(laid_side_by_side(blocks), self.dictionary.columns[:, columns])
        return Search(some, self.gram.some(columns))

    @cached_property
    def order(self) -> np.ndarray:
        """The numbers of the blocks [B] as draws count them: those of one size and with the same signs side by side."""
        kinds: dict[tuple[tuple[int, ...], bytes], int] = {}
        each = [(block.sds_mm.shape, block.signs.tobytes()) for block in self.dictionary.blocks]
        return np.argsort([kinds.setdefault(kind, len(kinds)) for kind in each], kind="stable")

    @cached_property
    def alternatives(self) -> kernels.Alternatives:
        """All alternatives in size, block by block in their order."""
        blocks = [self.dictionary.blocks[b] for b in self.order.tolist()]
        laid_out = np.array([(block.at.start, block.width, len(block.signs)) for block in blocks], np.int64)
        flat = (
            np.concatenate([np.zeros(0), *(getattr(block, name).ravel() for block in blocks)])
            for name in kernels.Alternatives._fields[1:]
        )
        return kernels.Alternatives(laid_out.reshape(-1, 3), *flat)

    @cached_property
    def own(self) -> np.ndarray:
        """The products [P, P] of each block's columns among themselves, flat, one block after the other."""
        each = (self.gram.within(self.dictionary.blocks[b].at).ravel() for b in self.order.tolist())
        return np.concatenate([np.zeros(0), *each])

    @cached_property
    def keys(self) -> np.ndarray:
        """The block and the number of each alternative [K, 2]."""
        counts = self.alternatives.blocks[:, 2]
        first = np.repeat(np.cumsum(counts) - counts, counts)
        return np.stack([np.repeat(self.order, counts), np.arange(len(first)) - first], axis=1)

    def of_blocks(self, blocks: np.ndarray) -> np.ndarray:
        """Tell which of the alternatives [K] are of some blocks."""
        chosen = np.zeros(len(self.dictionary.blocks), bool)
        chosen[blocks] = True
        return np.asarray(chosen[self.keys[:, 0]])

    def columns_of(self, asked: np.ndarray) -> np.ndarray:
        """Tell which columns [P] are of the blocks of some alternatives [K]."""
        chosen = np.zeros(len(self.dictionary.blocks), bool)
        chosen[self.keys[asked, 0]] = True
        return np.repeat(chosen, self._widths)

    @cached_property
    def _widths(self) -> np.ndarray:
        return np.array([block.width for block in self.dictionary.blocks], np.int64)

    def offered(self, members: Set, without: int | None = None) -> np.ndarray:
        """Return the blocks that a set may take in, but none of the slot of the block ``without``."""
        slot, most = self._slots
        taken = [b for b, _ in members]
        free = (np.bincount(slot[taken], minlength=len(most)) < most)[slot]
        free[taken] = False
        if without is not None:
            free &= slot != slot[without]
        there = {self.dictionary.blocks[b].slot for b in taken}
        for slots, which in self._needing.items():
            if there.isdisjoint(slots):
                free[which] = False
        return np.flatnonzero(free)

    def alike(self, blocks: np.ndarray, one: int) -> np.ndarray:
        """Tell which of some blocks [B] are of the slot of the block ``one``."""
        slot, _ = self._slots
        return np.asarray(slot[blocks] == slot[one])

    def needed(self, members: Set, member: tuple[int, int]) -> bool:
        """Tell whether another member needs this one, and the set has nothing else that it needs."""
        needing = (slots for slots, which in self._needing.items() if any(b in which for b, _ in members))
        return any(
            slots.isdisjoint(self.dictionary.blocks[b].slot for b, _ in {*members} - {member}) for slots in needing
        )

    @cached_property
    def _needing(self) -> dict[frozenset[tuple[str, int]], list[int]]:
        """The blocks that need one of some slots taken, by these slots."""
        found: dict[frozenset[tuple[str, int]], list[int]] = {}
        for b, block in enumerate(self.dictionary.blocks):
            if block.needs:
                found.setdefault(frozenset((name, block.where) for name in block.needs), []).append(b)
        return found

    @cached_property
    def _slots(self) -> tuple[np.ndarray, np.ndarray]:
        """The number of each block's slot, and how many blocks of each slot a set may have."""
        slots: dict[tuple[str, int], int] = {}
        numbers = [slots.setdefault(block.slot, len(slots)) for block in self.dictionary.blocks]
        return np.array(numbers, np.int64), np.array([EFFECTS[name].most for name, _ in slots])


def search_of(dictionary: Dictionary, rows: Rows, weight: np.ndarray) -> Search:
    """Return the search in a dictionary for rows of these weights [M]."""
    return Search(dictionary, gram_of(dictionary.columns, rows, weight))


@dataclass(frozen=True, eq=False)
class Beside:
    """The information of the rows about blocks to add to a state, and the gradient of all columns [P]: ``crossing`` [A,
    P] are the products of the state's columns with all."""

    search: Search
    state: State
    crossing: np.ndarray
    slope: np.ndarray

    @cached_property
    def _known(self) -> tuple[np.ndarray, np.ndarray]:
        """Which alternatives [K] were asked for, and what each of them adds to the state's score [K], 0 for others."""
        return np.zeros(len(self.search.keys), bool), np.zeros(len(self.search.keys))

    def half_of(self, columns: np.ndarray) -> np.ndarray:
        """Return what the root of the state's covariance makes of the products of some columns with its own [B, A]."""
        return np.asarray(self.crossing[:, columns].T @ (self.state.root.T / self.state.sigma_mm**2))

    @cached_property
    def _half(self) -> tuple[np.ndarray, np.ndarray]:
        """The half of all columns [P, A], and of which it was asked for [P]; it is made where it is."""
        return np.empty(self.crossing.T.shape), np.zeros(len(self.slope), bool)

    def added(self, asked: np.ndarray, freed: np.ndarray, pull: np.ndarray, out: np.ndarray) -> None:
        """Fill ``out`` [K] with what each of the ``asked`` alternatives [K] adds to the score, where members are
        ``freed`` [A, F] that ``pull`` [F] on others."""
        search, (half, known) = self.search, self._half
        new = search.columns_of(asked) & ~known
        if new.any():
            half[new] = self.half_of(new)
            known |= new
        kernels.gains(
            search.alternatives, search.own, self.state.sigma_mm**2, self.slope, half, freed, pull, asked, out
        )

    def told(self, asked: np.ndarray) -> np.ndarray:
        """Return what each of the ``asked`` alternatives [K] adds to the state's score; what it has for others counts
        for nothing."""
        known, values = self._known
        self.added(asked & ~known, np.zeros((len(self.crossing), 0)), np.zeros(0), values)
        known |= asked
        return values

    def gains(self, offered: np.ndarray) -> Gains:
        """Return what each alternative of the ``offered`` blocks adds to the state's score."""
        asked = self.search.of_blocks(offered)
        return Gains(self.search.keys[asked], self.told(asked)[asked])

    def together(self, choices: Sequence[Set]) -> np.ndarray:
        """Return what each of some sets of blocks, whose sizes may have either sign, adds to the score [C]."""
        members = list(dict.fromkeys(itertools.chain(*choices)))
        blocks = {b: self.search.dictionary.blocks[b] for b, _ in members}
        columns = columns_at(blocks.values())
        at = dict(zip(blocks, slices(block.width for block in blocks.values()), strict=True))
        own_mm = np.zeros((len(members), len(columns)))
        for number, (b, variant) in enumerate(members):
            own_mm[number, at[b]] = blocks[b].sds_mm[variant]
        numbers = {member: number for number, member in enumerate(members)}
        which = np.array([numbers[member] for member in itertools.chain(*choices)], int)
        choice = np.repeat(np.arange(len(choices)), [len(each) for each in choices])
        has, own_odds = np.zeros((len(choices), len(members))), [blocks[b].log_odds[variant] for b, variant in members]
        has[choice, which] = 1.0
        sds_mm, log_odds = has @ own_mm, np.bincount(choice, np.array(own_odds)[which], len(choices))
        laid_out, none = np.array([[0, *sds_mm.T.shape]]), np.zeros((len(self.crossing), 0))
        both = kernels.Alternatives(laid_out, sds_mm.ravel(), log_odds, np.zeros(len(choices)))
        own, variance = self.search.gram.between(columns, columns).ravel(), self.state.sigma_mm**2
        half, every, gains = self.half_of(columns), np.ones(len(choices), bool), np.zeros(len(choices))
        kernels.gains(both, own, variance, self.slope[columns], half, none, np.zeros(0), every, gains)
        return gains

    def without(self, member: tuple[int, int]) -> "Less":
        """Return the same beside the state without a member: its sizes are 0.

        How likely that was to come out, before the rows and after, is its evidence (Dickey 1971). The member is taken
        to leave the sign of others as certain as it was.
        """
        block, variant = self.search.dictionary.blocks[member[0]], member[1]
        own = self.search.dictionary.own(self.state.members)[self.state.members.index(member)]
        mine = self.state.root[:, own]
        root = np.asarray(np.linalg.qr(mine, mode="r")).T
        inverse = np.linalg.inv(root)
        pull = inverse @ self.state.mean_mm[own]
        told = float(np.log(block.sds_mm[variant] / np.abs(np.diag(root))).sum() - pull @ pull / 2)
        told -= float(block.log_odds[variant])
        if block.signs[variant]:
            sure = block.signs[variant] * self.state.mean_mm[own] / np.linalg.norm(mine)
            told -= float(log_below(sure)[0]) + np.log(2)
        return Less(self, told, told + float(pull @ pull) / 2, mine @ inverse.T, pull)


@dataclass(frozen=True, eq=False)
class Less:
    """A state without a member, which adds ``told`` to its score.

    What is ``freed`` [A, K] in the axes of the state's root adds to what the rows tell of all columns, and ``pull`` [K]
    along it on them. Beside a block the member gains at worst nothing from the rows. So with the block in its place the
    state's score rises by what the block gains beside it and ``more``, at most.
    """

    beside: Beside
    told: float
    more: float
    freed: np.ndarray
    pull: np.ndarray

    def gains(self, offered: np.ndarray, least: float) -> Gains:
        """Return what each alternative of the ``offered`` blocks adds to the score without the member, where that may
        be ``least`` above the state's."""
        search, beside = self.beside.search, self.beside
        may = search.of_blocks(offered)
        may &= (search.alternatives.signs != 0) | (beside.told(may) + self.more > least)
        values = np.zeros(len(may))
        beside.added(may, self.freed, self.pull, values)
        return Gains(search.keys[may], values[may])


def columns_at(blocks: Iterable[Block]) -> np.ndarray:
    """Return the numbers of all columns of some blocks."""
    return np.concatenate([np.zeros(0, np.int64), *(np.arange(block.at.start, block.at.stop) for block in blocks)])


def searched(search: Search, start: Set, sigma_mm: float) -> State:
    """Return the likeliest set that steps from ``start`` reach: adding, dropping or exchanging one block at a time."""
    return _climbed(search, search.posterior(start, sigma_mm))


def likely_choices(search: Search, state: State, choices: Sequence[Set]) -> tuple[Set, list[Set], np.ndarray]:
    """Return the members of a state that are of no family's ``choices``, those of the choices that are likely beside
    these, and the score of each.

    Several effects of a family may replace several others although no single exchange helps. So all of its sets are
    scored at once.
    """
    known = {b for choice in choices for b, _ in choice}
    members = tuple(member for member in state.members if member[0] not in known)
    others = search.posterior(members, state.sigma_mm, rounds=0)
    scores = others.score + search.beside(others).together(choices)
    likely = np.flatnonzero(scores > scores.max() + LEAST_LOG_WEIGHT)
    return members, [choices[at] for at in likely.tolist()], scores[likely]


def _regrouped(search: Search, state: State) -> State:
    """Return the likeliest set with other effects of each family in place of a state's."""
    for family in search.families:
        others, choices, scores = likely_choices(search, state, family)
        better = search.posterior((*others, *choices[int(np.argmax(scores))]), state.sigma_mm)
        if better.score > state.score + LEAST_BETTER:
            state = _climbed(search, better)
    return state


def doubted(search: Search, state: State) -> State:
    """Return the likeliest set that is reached from ``state`` when each member in turn is doubted.

    Several blocks may replace several others although no single exchange helps. So the steps begin again with the other
    members, without any block of the doubted slot. They drop or exchange others within their slots, then add blocks.
    Members that are likely a priori stay. The members of a family are first exchanged all at once.
    """
    state = _regrouped(search, state)
    for member in reversed(state.members):
        is_likely = search.dictionary.blocks[member[0]].log_odds[member[1]] >= 0
        if is_likely or member not in state.members or search.needed(state.members, member):
            continue
        others = tuple(each for each in state.members if each != member)
        found = _climbed(search, search.posterior(others, state.sigma_mm), without=member[0])
        if found.score > state.score + LEAST_BETTER:
            state = _climbed(search, found)
    return state


def _climbed(search: Search, state: State, without: int | None = None) -> State:
    better: State | None = state
    while better is not None:
        state, beside = better, search.beside(better)
        if without is None:
            better = _more(search, state, beside) or _exchanged(search, state, beside, own=False)
        else:  # one block may stand for the one in doubt and another: before more comes, it takes that one's place
            better = _exchanged(search, state, beside, own=True) or _more(search, state, beside, without)
    return state


def rivals_of(search: Search, state: State) -> Set:
    """Return, for each error of the measurement in a state, the effect of the machine that would replace it best.
    Errors that every measurement has are left out."""
    blocks, found, beside = search.dictionary.blocks, [], search.beside(state)
    machine = np.array([EFFECTS[block.effect].of is Of.MACHINE for block in blocks], bool)
    for at, member in enumerate(state.members):
        block = blocks[member[0]]
        if EFFECTS[block.effect].of is Of.INSTRUMENT and block.log_odds[0] < 0:
            offered = search.offered((*state.members[:at], *state.members[at + 1 :]))
            rival, _ = beside.without(member).gains(offered[machine[offered]], -np.inf).best()
            found += [rival] * (rival[0] >= 0)
    return tuple(dict.fromkeys(found))


def _more(search: Search, state: State, beside: Beside, without: int | None = None) -> State | None:
    best, gain = beside.gains(search.offered(state.members, without)).best()
    if gain <= 0:
        return None
    more = search.posterior((*state.members, best), state.sigma_mm)
    return more if more.score > state.score else None


def _exchanged(search: Search, state: State, beside: Beside, *, own: bool) -> State | None:
    """Return a better set with one member dropped or replaced, the last that came tried first; None for none. With
    ``own`` only blocks of its slot replace it."""
    for at, member in reversed(list(enumerate(state.members))):
        others = (*state.members[:at], *state.members[at + 1 :])
        less = beside.without(member)
        stays = search.needed(state.members, member)  # in one size or another
        offered = np.array([member[0]]) if stays else search.offered(others)
        offered = offered[search.alike(offered, member[0])] if own else offered
        choice, gain = less.gains(offered, LEAST_BETTER).without(member).best()
        members = (*others, choice) if stays or gain > 0 else others
        if less.told + (gain if stays else max(gain, 0.0)) > LEAST_BETTER:
            tried = search.posterior(members, state.sigma_mm)
            if tried.score > state.score + LEAST_BETTER:
                return tried
    return None
