"""Every candidate column of a measurement and the sums of their products: all the data that the search needs."""

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from printmend.effects import EFFECTS, Acts, Effect, Of, Places, Scene, Term, columns_of
from printmend.effects.effect import Key
from printmend.effects.prior import number_of
from printmend.machine import Contacts
from printmend.metrics.robust import NORMAL_SQUARE


@dataclass(frozen=True, eq=False)
class Block:
    """The columns ``at`` (a slice of the dictionary's) of one effect at one place with one shape.

    ``sds_mm`` [V, P] and ``log_odds`` [V] are its alternatives in size. Those of one column with ``signs`` [V] of 1 are
    above 0, those with −1 below. A set with this block also has one of the effects that it ``needs``, at the same
    place. A shape between those of a grid came from a ``coarse`` one. ``own_odds`` are added in the posterior, where
    finer shapes share its odds.
    """

    effect: str
    where: int
    shape: tuple[float, ...]
    at: slice
    sds_mm: np.ndarray
    log_odds: np.ndarray
    signs: np.ndarray = field(default_factory=lambda: np.zeros(1))
    needs: tuple[str, ...] = ()
    own_odds: float = 0.0
    coarse: "Block | None" = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "signs", np.zeros(len(self.log_odds)) + self.signs)

    @property
    def key(self) -> Key:
        return self.effect, self.where, self.shape

    @property
    def width(self) -> int:
        return self.sds_mm.shape[1]

    def some(self, alternatives: list[int]) -> "Block":
        """Return the block with some of its alternatives in size."""
        sds_mm, log_odds, signs = (each[alternatives] for each in (self.sds_mm, self.log_odds, self.signs))
        return replace(self, sds_mm=sds_mm, log_odds=log_odds, signs=signs)

    @property
    def variance_mm2(self) -> np.ndarray:
        """The variance of each size [P] before anything is measured, machines without the effect included."""
        odds = np.exp(self.log_odds)
        return np.asarray(odds / (1 + odds.sum()) @ self.sds_mm**2)

    @property
    def slot(self) -> tuple[str, int]:
        """Of the blocks of one slot a set holds at most as many as the effect allows."""
        return self.effect, self.where


_Numbers = np.ndarray | slice


def _run(numbers: np.ndarray) -> _Numbers:
    """Return numbers as a slice where each is the next of the one before: it is copied faster."""
    if len(numbers) and (np.diff(numbers) == 1).all():
        return slice(int(numbers[0]), int(numbers[-1]) + 1)
    return numbers


def slices(widths: Iterable[int]) -> Iterator[slice]:
    """Yield slices of these widths, each from the end of the one before."""
    ends = itertools.accumulate(widths, initial=0)
    return (slice(first, last) for first, last in itertools.pairwise(ends))


def laid_side_by_side(blocks: Sequence[Block]) -> tuple[Block, ...]:
    """Return blocks whose columns follow one another, as in a dictionary of these alone."""
    places = zip(blocks, slices(block.width for block in blocks), strict=True)
    return tuple(block if block.at == at else replace(block, at=at) for block, at in places)


@dataclass(frozen=True, eq=False)
class Rows:
    """M measured numbers: ``mark`` [M] is the place of each, ``along`` [M, 2] the direction in which it was measured,
    ``error_mm`` [M] how far the mark is from its commanded position, ``weight`` [M] its relative weight. ``share`` [M]
    is the share of its information that its neighbours do not have. The noise is at least ``least_mm``."""

    mark: np.ndarray
    along: np.ndarray
    error_mm: np.ndarray
    weight: np.ndarray
    share: np.ndarray
    least_mm: float = 0.0

    def some(self, which: slice) -> "Rows":
        """Return some of the rows."""
        mark, along, error_mm = self.mark[which], self.along[which], self.error_mm[which]
        return Rows(mark, along, error_mm, self.weight[which], self.share[which], self.least_mm)

    @cached_property
    def by_axis(self) -> tuple[tuple[_Numbers, _Numbers], tuple[_Numbers, _Numbers], np.ndarray]:
        """The rows that were measured along X and the places that they are of, the same of Y, and all other rows."""
        x, y = (np.flatnonzero((self.along == axis).all(axis=1)) for axis in np.eye(2))
        others = np.setdiff1d(np.arange(len(self.mark)), np.concatenate([x, y]))
        return (_run(x), _run(self.mark[x])), (_run(y), _run(self.mark[y])), others

    def at_places(self, sizes_mm: np.ndarray, count: int) -> np.ndarray:
        """Return numbers [M], one for each row, as vectors at ``count`` places [count, 2]: of a wall along its normal
        alone, 0 where nothing was measured."""
        found = np.zeros((count, 2))
        np.add.at(found, self.mark, sizes_mm[:, None] * self.along)
        return found


def seen(key: Key, places: Places, rows: Rows, scene: Scene) -> np.ndarray:
    """Return the rows' columns [M, P] of an effect at one place with one shape."""
    name, where, shape = key
    columns = columns_of(name, places, where, shape, scene)
    (x, of_x), (y, of_y), others = rows.by_axis
    found = np.empty((len(rows.mark), columns.shape[2]), order="F")  # a search reads column by column
    found[x], found[y] = columns[of_x, 0], columns[of_y, 1]
    if len(others):
        found[others] = np.einsum("mc,mcp->mp", rows.along[others], columns[rows.mark[others]])
    return found


class Look(NamedTuple):
    """A look at a measurement with a machine: where its belts touch, and the ``places`` that the ``rows`` are of."""

    scene: Scene
    places: Places
    rows: Rows
    contacts: Contacts

    def columns(self, keys: Iterable[Key]) -> np.ndarray:
        """Return the rows' columns [M, P] of several effects, side by side."""
        few = self.narrowed()
        none = np.zeros((0, len(few.rows.mark)))
        return np.concatenate([none, *(seen(key, few.places, few.rows, few.scene).T for key in keys)]).T

    def narrowed(self) -> "Look":
        """Return the look at the places that the rows are of alone: a search looks at few of a long trace."""
        marks, numbers = np.unique(self.rows.mark, return_inverse=True)
        if len(marks) == len(self.places):
            return self
        return self._replace(places=self.places.at(marks), rows=replace(self.rows, mark=numbers))


@dataclass(frozen=True, eq=False)
class Dictionary:
    """The blocks and their columns [M, P] for the rows of one measurement."""

    blocks: tuple[Block, ...]
    columns: np.ndarray

    def own(self, members: Sequence[tuple[int, int]]) -> list[slice]:
        """Return which of the sizes of a set are each member's."""
        return list(slices(self.blocks[b].width for b, _ in members))

    def with_more(self, blocks: Sequence[Block], columns: np.ndarray) -> "Dictionary":
        """Return the dictionary with more blocks, whose columns [M, Q] come last."""
        return Dictionary(laid_side_by_side((*self.blocks, *blocks)), np.hstack([self.columns, columns]))


def blocks_of(
    scene: Scene, kept: Callable[[Term], bool] | None = None, names: Sequence[str] | None = None
) -> tuple[Block, ...]:
    """Return every term that the effects offer, or those of some ``names``, that are ``kept``, side by side."""
    return _blocks_of(scene, kept, tuple(each for name, each in EFFECTS.items() if names is None or name in names))


@lru_cache(maxsize=16)  # of a trace's scenes, which are asked for in every pass
def _blocks_of(scene: Scene, kept: Callable[[Term], bool] | None, effects: tuple[Effect, ...]) -> tuple[Block, ...]:
    grouped: dict[Key, list[Term]] = {}
    for effect in effects:
        for term in effect.terms(scene):
            if (kept is None or kept(term)) and _shows(term, scene):
                grouped.setdefault(term.key, []).append(term)
    return laid_side_by_side(
        [block_of(each, getattr(EFFECTS[each[0].effect], "needs", ())) for each in grouped.values()]
    )


def dictionary_of(blocks: tuple[Block, ...], look: Look) -> Dictionary:
    """Return blocks with what the rows of a look see of them."""
    return Dictionary(blocks, look.columns(block.key for block in blocks))


def with_blocks(dictionary: Dictionary, more: Sequence[Block], look: Look) -> Dictionary:
    """Return the dictionary with more blocks and what the rows see of them."""
    if not more:
        return dictionary
    return dictionary.with_more(more, look.columns(block.key for block in more))


def _shows(term: Term, scene: Scene) -> bool:
    """Tell whether a machine's effect can show: play may hide all of a short way, and if nothing ties a motor to its
    end stop, only its place shows then."""
    effect = EFFECTS[term.effect]
    if scene.homed or effect.of is not Of.MACHINE or term.effect == "place":
        return True
    moved = [high - low > number_of("play", "widest") for low, high in scene.motor_span_mm]
    return moved[term.where] if effect.acts is Acts.DRIVE else all(moved)


def block_of(terms: Sequence[Term], needs: tuple[str, ...] = ()) -> Block:
    """Return the alternatives in size of an effect at one place with one shape, its columns the first."""
    one, sds_mm = terms[0], np.array([term.sd_mm for term in terms])
    log_odds, signs = np.array([term.log_odds for term in terms]), np.array([term.sign for term in terms])
    return Block(*one.key, slice(0, sds_mm.shape[1]), sds_mm, log_odds, signs, needs)


@dataclass(frozen=True, eq=False)
class Table:
    """Weighted sums of products [P, P] of columns [M, P], made where they are asked for: a search looks at few columns,
    each beside all others. Rows of ``matrix`` that are ``known`` [P] hold them; rows of numbers have ``weight`` [M]."""

    columns: np.ndarray
    weight: np.ndarray
    matrix: np.ndarray
    known: np.ndarray
    _owned: dict[tuple[int, int], np.ndarray] = field(default_factory=dict, init=False)

    def rows(self, first: np.ndarray) -> np.ndarray:
        """Return the products [A, P] of some columns with all, and keep them."""
        if not self.known[first].all():
            missing = np.unique(first[~self.known[first]])
            self.matrix[missing] = self._told(missing, slice(None))
            self.known[missing] = True
        return np.asarray(self.matrix[first])

    def among(self, first: np.ndarray, second: np.ndarray) -> np.ndarray:
        """Return the products [A, B] of some columns with others. Rows that are known are read; of all others only
        these products are summed, and they are not kept."""
        found, new = self.matrix[first[:, None], second], ~self.known[first]
        if new.any():
            other = ~self.known[second]
            found[new] = self.matrix[second, first[new, None]]
            found[np.ix_(new, other)] = self._told(first[new], second[other])
        return np.asarray(found)

    def _told(self, first: np.ndarray, second: np.ndarray | slice) -> np.ndarray:
        told = self.columns[:, first]
        seen = np.flatnonzero(told.any(axis=1))  # numbers along X come first; they see nothing of what moves Y
        some = slice(seen[0], seen[-1] + 1) if len(seen) else slice(0)
        return np.asarray((told[some] * self.weight[some, None]).T @ self.columns[some, second])

    def within(self, first: int, end: int) -> np.ndarray:
        """Return the products [P, P] of the columns from ``first`` to ``end`` among themselves."""
        if (first, end) not in self._owned:
            mine = slice(first, end)
            told = self.columns[:, mine]
            is_known = self.known[mine].all()
            self._owned[first, end] = self.matrix[mine, mine] if is_known else (told * self.weight[:, None]).T @ told
        return self._owned[first, end]


@dataclass(frozen=True, eq=False)
class Gram:
    """Weighted sums of products: of a ``table``'s columns [P] or those ``at`` some places, less what was summed out,
    whose products ``out`` [K, P] makes; ``slope`` [P] of each column with the errors, ``square`` of the errors;
    ``count`` rows tell something of their own, and none scatters less than ``least_mm``."""

    table: Table
    slope: np.ndarray
    square: float
    count: float
    at: np.ndarray | None = None
    out: np.ndarray | None = None
    least_mm: float = 0.0

    def between(self, first: np.ndarray, second: np.ndarray | None = None) -> np.ndarray:
        """Return the products [A, B] of some columns with others, or with all."""
        if second is not None:
            told = self.table.among(self._of(first), self._of(second))
        else:
            told = self.table.rows(self._of(first))
            told = told if self.at is None else told[:, self.at]
        if self.out is None:
            return told
        return told - self.out[:, first].T @ (self.out if second is None else self.out[:, second])

    def _of(self, columns: np.ndarray) -> np.ndarray:
        return columns if self.at is None else self.at[columns]

    def within(self, own: slice) -> np.ndarray:
        """Return the products [P, P] of a block's columns among themselves."""
        first, last = (own.start, own.stop - 1) if self.at is None else self.at[[own.start, own.stop - 1]].tolist()
        told = self.table.within(first, last + 1)
        return told if self.out is None else told - self.out[:, own].T @ self.out[:, own]

    def some(self, columns: np.ndarray) -> "Gram":
        """Return the sums of some columns alone."""
        out = None if self.out is None else self.out[:, columns]
        return replace(self, at=self._of(columns), slope=self.slope[columns], out=out)

    def summed_out(
        self, old: np.ndarray, mean: np.ndarray, ways: np.ndarray, sigma_mm: float, few: np.ndarray | None = None
    ) -> tuple["Gram", np.ndarray, np.ndarray]:
        """Sum out what moves the sizes of columns ``old`` [P] off their ``mean`` [P], along ``ways`` [P, K], each by a
        standard normal value.

        Return the sums of the ``few`` columns, or all; the root [K, K] of what the noise and the rows make of the
        values' information, and how the rows pull [K] on them, both in the root's axes.
        """
        few = np.arange(len(self.slope)) if few is None else few
        cross = self.between(old)
        inner, cross = cross[:, old], cross[:, few].T
        left = self.slope[old] - inner @ mean
        told, wanted = sigma_mm**2 * np.eye(ways.shape[1]) + ways.T @ inner @ ways, ways.T @ left
        root = np.linalg.cholesky(told)
        inverse = np.linalg.inv(root)
        half, values = inverse @ (cross @ ways).T, inverse.T @ (inverse @ wanted)
        values += inverse.T @ (inverse @ (wanted - told @ values))  # rounding of errors of mm beside noise of um
        square = self.square - mean @ (self.slope[old] + left) - values @ (2 * wanted - told @ values)
        few_slope = self.slope[few] - cross @ (mean + ways @ values)
        pull = root.T @ values
        out = half if self.out is None else np.vstack([self.out[:, few], half])
        return replace(self, at=self._of(few), slope=few_slope, square=float(square), out=out), root, pull


def gram_of(columns: np.ndarray, rows: Rows, weight: np.ndarray) -> Gram:
    """Return the sums of products of columns [M, P] and errors of rows with weights [M]."""
    weight, width = weight * rows.share, columns.shape[1]
    table = Table(columns, weight, np.empty((width, width)), np.zeros(width, bool))
    pull = weight * rows.error_mm
    count = NORMAL_SQUARE * float(rows.share.sum())
    return Gram(table, columns.T @ pull, float(pull @ rows.error_mm), count, least_mm=rows.least_mm)


def summed(grams: Iterable[Gram], width: int) -> Gram:
    """Return the sums of the same ``width`` columns over all rows of some, one after the other: a trace may be long."""
    every = np.arange(width)
    whole = Gram(_told(np.zeros((width, width))), np.zeros(width), 0.0, 0.0)
    for each in grams:
        table = _told(whole.table.matrix + each.between(every, every))
        slope, square, count = whole.slope + each.slope, whole.square + each.square, whole.count + each.count
        whole = Gram(table, slope, square, count, least_mm=each.least_mm)
    return whole


def _told(matrix: np.ndarray) -> Table:
    """Return the table of sums of products that are all known."""
    return Table(np.zeros((0, len(matrix))), np.zeros(0), matrix, np.ones(len(matrix), bool))
