"""Every candidate column of a measurement and the sums of their products: all the data that the search needs."""

import itertools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from printmend.effects import EFFECTS, Acts, Effect, Of, Places, Scene, Term, columns_of

HIDDEN_MM = 2.0  # of a motor's way that play may hide: the widest of any printer
MOST_SHARED = 1.25  # columns of both directions, over all: with more, one product of all rows is quicker than two


@dataclass(frozen=True, eq=False)
class Block:
    """The columns ``at`` (a slice of the dictionary's) of one effect at one place with one shape.

    ``sds_mm`` [V, P] and ``log_odds`` [V] are its alternatives in size; ``positive`` ones of one column are above 0.
    """

    effect: str
    where: int
    shape: tuple[float, ...]
    at: slice
    sds_mm: np.ndarray
    log_odds: np.ndarray
    positive: bool = False

    @property
    def slot(self) -> tuple[str, int]:
        """Of the blocks of one slot a set holds at most as many as the effect allows."""
        return self.effect, self.where


def laid_side_by_side(blocks: Iterable[Block]) -> tuple[Block, ...]:
    """Return blocks whose columns follow one another, as in a dictionary of these alone."""
    kept: list[Block] = []
    for block in blocks:
        first = kept[-1].at.stop if kept else 0
        at = slice(first, first + block.at.stop - block.at.start)
        kept.append(block if block.at == at else replace(block, at=at))
    return tuple(kept)


@dataclass(frozen=True, eq=False)
class Rows:
    """M measured numbers: ``mark`` [M] is the place that each is of, ``along`` [M, 2] the direction in which it was
    measured, ``error_mm`` [M] how far the mark lies from where it was commanded, ``weight`` [M] its relative weight.
    ``share`` [M] is how much of it is news, beside its neighbours."""

    mark: np.ndarray
    along: np.ndarray
    error_mm: np.ndarray
    weight: np.ndarray
    share: np.ndarray

    def some(self, which: slice) -> "Rows":
        """Return some of the rows."""
        return Rows(*(value[which] for value in vars(self).values()))


def seen(name: str, where: int, shape: tuple[float, ...], places: Places, rows: Rows, scene: Scene) -> np.ndarray:
    """Return the rows' columns [M, P] of an effect at one place with one shape."""
    columns = columns_of(name, places, where, shape, scene)
    return np.asarray(np.einsum("mc,mcp->mp", rows.along, columns[rows.mark]))


def narrowed(places: Places, rows: Rows) -> tuple[Places, Rows]:
    """Return the places that the rows are of, and the rows of these: the search looks at few of a long trace."""
    marks, numbers = np.unique(rows.mark, return_inverse=True)
    return places.at(marks), replace(rows, mark=numbers)


@dataclass(frozen=True, eq=False)
class Dictionary:
    """The blocks and their columns [M, P] for the rows of one measurement."""

    blocks: tuple[Block, ...]
    columns: np.ndarray

    def own(self, members: Sequence[tuple[int, int]]) -> list[slice]:
        """Return which of the sizes of a set are each member's."""
        columns = [self.blocks[b].at for b, _ in members]
        ends = itertools.accumulate((each.stop - each.start for each in columns), initial=0)
        return [slice(first, last) for first, last in itertools.pairwise(ends)]


def blocks_of(scene: Scene, kept: Callable[[Term], bool] | None = None) -> tuple[Block, ...]:
    """Return every term that the effects offer, or those that are ``kept``, side by side."""
    return _blocks_of(scene, kept, tuple(EFFECTS.values()))


@lru_cache(maxsize=16)  # of a trace's scenes, which are asked for in every pass
def _blocks_of(scene: Scene, kept: Callable[[Term], bool] | None, effects: tuple[Effect, ...]) -> tuple[Block, ...]:
    grouped: dict[tuple[str, int, tuple[float, ...]], list[Term]] = {}
    for effect in effects:
        for term in effect.terms(scene):
            if (kept is None or kept(term)) and _shows(term, scene):
                grouped.setdefault(term.key, []).append(term)
    return laid_side_by_side(map(block_of, grouped.values()))


def dictionary_of(
    places: Places, rows: Rows, scene: Scene, *, kept: Callable[[Term], bool] | None = None
) -> Dictionary:
    """Return every term that the effects offer, or those that are ``kept``, with its columns."""
    return seen_blocks(blocks_of(scene, kept), places, rows, scene)


def seen_blocks(blocks: tuple[Block, ...], places: Places, rows: Rows, scene: Scene) -> Dictionary:
    """Return blocks with their columns."""
    places, rows = narrowed(places, rows)
    columns = [seen(block.effect, block.where, block.shape, places, rows, scene) for block in blocks]
    return Dictionary(blocks, np.hstack(columns))


def _shows(term: Term, scene: Scene) -> bool:
    """Tell whether a machine's effect can show: play may hide all of a short way, and if nothing ties a motor to its
    end stop, only its place shows then."""
    effect = EFFECTS[term.effect]
    if scene.homed or effect.of is not Of.MACHINE or term.effect == "place":
        return True
    moved = [high - low > HIDDEN_MM for low, high in scene.motor_span_mm]
    return moved[term.where] if effect.acts is Acts.DRIVE else all(moved)


def block_of(terms: Sequence[Term]) -> Block:
    """Return the alternatives in size of an effect at one place with one shape, its columns the first."""
    one, sds_mm = terms[0], np.array([term.sd_mm for term in terms])
    log_odds = np.array([term.log_odds for term in terms])
    return Block(one.effect, one.where, one.shape, slice(0, sds_mm.shape[1]), sds_mm, log_odds, one.positive)


@dataclass(frozen=True, eq=False)
class Gram:
    """Weighted sums of products: of all columns ``matrix`` [P, P] less what was summed out, whose products ``out``
    [K, P] makes; ``slope`` [P] of each column with the errors, ``square`` of the errors; ``count`` rows tell something
    of their own."""

    matrix: np.ndarray
    slope: np.ndarray
    square: float
    count: float
    out: np.ndarray | None = None

    def between(self, first: np.ndarray, second: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Return the products [A, B] of some columns with others, or with all."""
        told = self.matrix[np.ix_(first, second)] if isinstance(second, np.ndarray) else self.matrix[first, second]
        return told if self.out is None else told - self.out[:, first].T @ self.out[:, second]

    def within(self, columns: np.ndarray) -> np.ndarray:
        """Return the products [B, P, P] of the columns [B, P] of each of some blocks among themselves."""
        told = self.matrix[columns[:, :, None], columns[:, None, :]]
        return told if self.out is None else told - products(self.out, columns)

    def some(self, columns: np.ndarray) -> "Gram":
        """Return the sums of some columns alone."""
        return replace(self, matrix=self.between(columns, columns), slope=self.slope[columns], out=None)


def products(half: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Return the sums of products [B, P, P] of the columns [B, P] of ``half`` [K, N] of each block."""
    mine = half.T[columns]
    return np.asarray(mine @ np.swapaxes(mine, 1, 2))


def gram_of(columns: np.ndarray, rows: Rows, weight: np.ndarray) -> Gram:
    """Return the sums of products of columns [M, P] and errors of rows with weights [M]."""
    count = columns.shape[1]
    nothing = Gram(np.zeros((count, count)), np.zeros(count), 0.0, 0.0)
    return reweighed(nothing, columns, rows, weight * rows.share)


def reweighed(gram: Gram, columns: np.ndarray, rows: Rows, more: np.ndarray) -> Gram:
    """Return the sums where rows count ``more`` [M] than before, or less: of most rows the weight stays."""
    matrix, slope = gram.matrix.copy(), gram.slope.copy()
    for sign in (1.0, -1.0):
        which = np.flatnonzero(sign * more > 0)
        root = np.sqrt(sign * more[which])
        some, error = columns[which] * root[:, None], rows.error_mm[which] * root
        slope += sign * (some.T @ error)
        for part, own in _apart(some, rows.along[which]):
            matrix[own] += sign * (part.T @ part)
    square = gram.square + float(more @ rows.error_mm**2)
    return replace(gram, matrix=matrix, slope=slope, square=square, count=float(rows.share.sum()))


def _apart(columns: np.ndarray, along: np.ndarray) -> list[tuple[np.ndarray, tuple[np.ndarray | slice, ...]]]:
    """Return the rows that see different columns, each with its own: those along X see nothing of what moves Y alone.

    Where the motors move both, as a CoreXY's do, all rows are left together.
    """
    of_x = along[:, 1] == 0
    own = [np.flatnonzero(columns[some].any(axis=0)) for some in (of_x, ~of_x)]
    if sum(map(len, own)) > MOST_SHARED * columns.shape[1]:
        return [(columns, (slice(None),))]
    return [(columns[some][:, each], np.ix_(each, each)) for some, each in zip((of_x, ~of_x), own, strict=True)]


def extended(gram: Gram, old: np.ndarray, new: np.ndarray, rows: Rows, weight: np.ndarray) -> Gram:
    """Return the sums of products of ``old`` columns [M, P], whose own are known, and ``new`` ones [M, Q]."""
    weighed = new * (weight * rows.share)[:, None]
    crossing = old.T @ weighed
    matrix = np.block([[gram.matrix, crossing], [crossing.T, new.T @ weighed]])
    return Gram(matrix, np.concatenate([gram.slope, weighed.T @ rows.error_mm]), gram.square, gram.count)
