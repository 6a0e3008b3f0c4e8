"""Every candidate column of a measurement and the sums of their products: all the data that the search needs."""

import itertools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from printmend.effects import EFFECTS, Places, Scene, Term, columns_of


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
        kept.append(replace(block, at=slice(first, first + block.at.stop - block.at.start)))
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
    """Return what the rows see [M, P] of an effect at one place with one shape."""
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
    grouped: dict[tuple[str, int, tuple[float, ...]], list[Term]] = {}
    for effect in EFFECTS.values():
        for term in effect.terms(scene):
            if kept is None or kept(term):
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


def block_of(terms: Sequence[Term]) -> Block:
    """Return the alternatives in size of an effect at one place with one shape, its columns the first."""
    one, sds_mm = terms[0], np.array([term.sd_mm for term in terms])
    log_odds = np.array([term.log_odds for term in terms])
    return Block(one.effect, one.where, one.shape, slice(0, sds_mm.shape[1]), sds_mm, log_odds, one.positive)


@dataclass(frozen=True, eq=False)
class Gram:
    """Weighted sums of products: of all columns [P, P], of each with the errors [P], and of the errors; ``count`` rows
    tell something of their own."""

    matrix: np.ndarray
    slope: np.ndarray
    square: float
    count: float


def gram_of(columns: np.ndarray, rows: Rows, weight: np.ndarray) -> Gram:
    """Return the sums of products of columns [M, P] and errors of rows with weights [M]."""
    root = np.sqrt(weight * rows.share)
    scaled, error = columns * root[:, None], rows.error_mm * root
    return Gram(scaled.T @ scaled, scaled.T @ error, float(error @ error), float(rows.share.sum()))


def extended(gram: Gram, old: np.ndarray, new: np.ndarray, rows: Rows, weight: np.ndarray) -> Gram:
    """Return the sums of products of ``old`` columns [M, P], whose own are known, and ``new`` ones [M, Q]."""
    weighed = new * (weight * rows.share)[:, None]
    crossing = old.T @ weighed
    matrix = np.block([[gram.matrix, crossing], [crossing.T, new.T @ weighed]])
    return Gram(matrix, np.concatenate([gram.slope, weighed.T @ rows.error_mm]), gram.square, gram.count)
