"""Learn how a Z screw lifts from measured heights (physics.md eq. 15).

    z = z0 + (1 + ε) m + Σ_k (a_k sin kθ + b_k cos kθ) ± backlash/2        θ = 2πm/lead

This is linear once the contacts are known: which flank of the thread carries the nut, and where it last moved it
(physics.md eq. 17). So contacts and sizes are found in turn. Evidence and prior odds decide which of the three terms
are there, and where the nut first rested in its play.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from printmend.effects.effect import FAR_MM, FEW_LAYERS, TINY_MM
from printmend.effects.prior import alternatives, lift_rests
from printmend.errors import TraceError
from printmend.infer.gram import Block, Dictionary, Rows, block_of, laid_side_by_side
from printmend.infer.search import LEAST_LOG_WEIGHT, LEAST_SIGMA_MM, Set, search_of
from printmend.machine.kernels import run
from printmend.messages import say
from printmend.metrics.robust import scale_of, weights_of
from printmend.model.branches import HARMONICS, waves_of
from printmend.printer import Printer

TERMS = ("lead", "periodic", "backlash")
FIRST_MM = 0.1  # of backlash, and of noise, with which the search for contacts begins
PASSES = 12  # of contacts, then search, at most


@dataclass(frozen=True, eq=False)
class Height:
    """How the screw lifts the nozzle: ``terms`` are (ε, a_1, b_1, a_2, …), 0 where they are not there, with standard
    deviations ``sds`` as if all were.

    ``sigma_mm`` is the noise of the measured heights; ``rest_share`` says where in its play the nut rested at row 0.
    ``score`` is the log evidence and log odds of it all.
    """

    terms: np.ndarray
    backlash_mm: float
    sigma_mm: float
    sds: np.ndarray
    backlash_sd_mm: float
    rest_share: float
    score: float


def fit_height(commanded_mm: np.ndarray, measured_mm: np.ndarray, printer: Printer, *, turns: bool = True) -> Height:
    """Learn z from commanded and measured heights [N] mm, NaN where nothing was measured.

    Lead and waves are looked for where the heights span enough ``turns``. A screw that never turns back shows its
    backlash by where the nut rested at first. Raises `TraceError` where fewer than three heights were measured.
    """
    if (count := int(np.isfinite(measured_mm).sum())) < FEW_LAYERS:
        raise TraceError(say("trace"), wanted=say("three-measured-heights"), came=f"{count}", todo=say("measure-more"))
    columns = np.column_stack([commanded_mm, waves_of(commanded_mm, printer.z.mm_per_turn, HARMONICS)])
    blocks = _blocks()
    sets = list(_sets(blocks, turns))
    every_set = _alternatives(blocks, sets)
    fits = (_fitted(columns, measured_mm, blocks, sets, every_set, rest) for rest in lift_rests())
    return max(fits, key=lambda each: each.score)


def _fitted(
    columns: np.ndarray, measured_mm: np.ndarray, blocks: tuple[Block, ...], sets: list[Set], every_set: Block,
    rest: tuple[float, float],
) -> Height:  # fmt: skip
    """Return what contacts that begin with a rest lead to; the first column is the commanded heights."""
    (rest_share, log_odds), commanded_mm, seen = rest, columns[:, 0], np.isfinite(measured_mm)
    ones = np.ones(int(seen.sum()))
    sizes, backlash_mm, sigma_mm, weight = np.zeros(columns.shape[1] + 2), FIRST_MM, FIRST_MM, ones
    for _ in range(PASSES):
        at, side = _touched(commanded_mm + columns @ sizes[1:-1], backlash_mm, rest_share)
        slack = np.where(side == 0, rest_share - 0.5, side / 2)
        design = np.column_stack([np.ones(len(at)), columns[at], slack])[seen]
        wanted_mm = (measured_mm - commanded_mm[at])[seen]
        rows = Rows(np.arange(len(ones)), np.zeros((len(ones), 2)), wanted_mm, weight, ones)
        search, rough = (search_of(Dictionary(some, design), rows, weight) for some in (blocks, (every_set,)))
        weighed = rough.gains(rough.posterior((), sigma_mm, rounds=0), np.zeros(1, int)).values
        likely = np.flatnonzero(weighed > weighed.max() + LEAST_LOG_WEIGHT)  # under the noise of the last pass
        state = max((search.posterior(sets[at], sigma_mm) for at in likely), key=lambda each: each.score)
        before, sizes = sizes, state.laid_out_mm(len(sizes))
        backlash_mm, sigma_mm = max(float(sizes[-1]), 0.0), state.sigma_mm
        left_mm = wanted_mm - design @ sizes
        weight = weights_of(left_mm, scale_of(left_mm, LEAST_SIGMA_MM))
        if np.abs(sizes - before).max() < TINY_MM:
            break
    every = search.posterior(tuple((b, 0) for b in range(len(blocks))), sigma_mm, rounds=0)
    sds = np.sqrt(np.diag(every.covariance))
    return Height(sizes[1:-1], backlash_mm, sigma_mm, sds[1:-1], float(sds[-1]), rest_share, state.score + log_odds)


def _blocks() -> tuple[Block, ...]:
    """Return the origin of the heights, and the terms of the lift with all their sizes."""
    origin = Block("origin", 0, (), slice(0, 1), np.array([[FAR_MM]]), np.zeros(1))
    terms = (alternatives(name, 0, sign=int(name == "backlash")) for name in TERMS)
    return laid_side_by_side((origin, *(block_of(list(each)) for each in terms)))


def _sets(blocks: tuple[Block, ...], turns: bool) -> Iterator[Set]:
    """Yield all sets: each term is there with one of its sizes, or not."""
    sizes = [[None, *range(len(block.log_odds))] for block in blocks[1:]]
    if not turns:
        sizes[:2] = [[None], [None]]
    for chosen in product(*sizes):
        yield ((0, 0), *((b, size) for b, size in enumerate(chosen, start=1) if size is not None))


def _alternatives(blocks: tuple[Block, ...], sets: Sequence[Set]) -> Block:
    """Return sets as alternatives in size of one block, whose columns are those of all: 0 where a set has none."""
    sds_mm = np.zeros((len(sets), blocks[-1].at.stop))
    for own, members in zip(sds_mm, sets, strict=True):
        for b, variant in members:
            own[blocks[b].at] = blocks[b].sds_mm[variant]
    log_odds = np.array([sum(blocks[b].log_odds[variant] for b, variant in members) for members in sets])
    return Block("lift", 0, (), slice(0, sds_mm.shape[1]), sds_mm, log_odds)


def _touched(centre_mm: np.ndarray, backlash_mm: float, share: float) -> tuple[np.ndarray, np.ndarray]:
    """Return for each row [N] the row where the nut last touched a flank and which, −1 pushed up, +1 let down.

    ``centre_mm`` [N] is the height in the middle of the play. Until it first touches one, the nut is where row 0 put
    it, at ``share`` of its play: row 0 and side 0.
    """
    lower_mm, upper_mm = centre_mm - backlash_mm / 2, centre_mm + backlash_mm / 2
    at, side, place_mm = np.empty(len(centre_mm), np.int64), np.empty(len(centre_mm)), np.empty(len(centre_mm))
    start_mm = float(centre_mm[0] + (share - 0.5) * backlash_mm)
    run.contacts(start_mm, lower_mm, upper_mm, at, side, place_mm)
    return np.maximum(at, 0), side
