"""Drawn machines from few numbers, where many sets of effects are equally likely: Gibbs sampling over sets.

A set makes K numbers normal, with the covariance Σ Φ V Φᵀ of its blocks and the noise. So one K × K matrix weighs it.
Each place of an effect in turn chooses among its own state and some drawn from its prior, by their evidence (Andrieu,
Doucet & Holenstein 2010). The noise is Student's t: each number has a variance of its own, which is drawn, too.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from printmend.infer.gram import Block
from printmend.infer.normal import log_below
from printmend.infer.part import DRAWS
from printmend.metrics.robust import DEGREES

OFFERED = 4  # states drawn from the prior that each place chooses among, beside its own
# Factors on the noise, sweep by sweep: they anneal towards data that no machine fits at first.
AFAR, SWEEPS = (256.0, 128.0, 64.0, 32.0, 16.0, 8.0, 4.0, 2.0, 1.0), 24
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
    """What may be at one place of an effect: nothing first, then (block, size). ``chance`` [A] and ``kernels``
    [A, K, K] are their prior chances and the covariances that they give to the numbers. ``positive`` [A, K] is what
    sizes that cannot be below 0 do to the numbers, 0 for others."""

    states: tuple[tuple[int, int], ...]
    chance: np.ndarray
    kernels: np.ndarray
    positive: np.ndarray


def _slots(few: Few) -> list[_Slot]:
    grouped: dict[tuple[str, int], list[int]] = {}
    for b, block in enumerate(few.blocks):
        grouped.setdefault(block.slot, []).append(b)
    found = []
    for members in grouped.values():
        states, odds, kernels = [(-1, -1)], [1.0], [np.zeros((len(few.columns),) * 2)]
        positive = [np.zeros(len(few.columns))]
        for b in members:
            block = few.blocks[b]
            for v, (sds, log_odds) in enumerate(zip(block.sds_mm, block.log_odds, strict=True)):
                scaled = few.columns[:, block.at] * sds
                states.append((b, v))
                odds.append(float(np.exp(log_odds)))
                kernels.append(scaled @ scaled.T)
                positive.append(scaled[:, 0] * block.positive)
        found.append(_Slot(tuple(states), np.array(odds) / sum(odds), np.array(kernels), np.array(positive)))
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
            beside = whole - slot.kernels[there[at]]
            offered = rng.choice(len(slot.chance), (DRAWS, OFFERED), p=slot.chance)
            offered = np.concatenate([there[at][:, None], offered], axis=1)
            mine = np.flatnonzero((offered != offered[:, :1]).any(axis=1))  # others have no choice
            offered = offered[mine]
            weight = _evidence_each(beside[mine], slot, offered, few.error_mm)
            noisy = weight + rng.gumbel(size=weight.shape)  # the largest is one drawn by its weight
            there[at, mine] = offered[np.arange(len(mine)), np.argmax(noisy, axis=1)]
            whole = beside + slot.kernels[there[at]]
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
    weight[draw, place] = _evidence(beside[draw] + slot.kernels[state], error_mm, slot.positive[state])
    return np.take_along_axis(weight, first, axis=1)


def _evidence(covariance: np.ndarray, error_mm: np.ndarray, positive: np.ndarray) -> np.ndarray:
    """Return the log evidence [...] of the errors [K] under covariances [..., K, K], but for a constant.

    Half a normal prior has 2 Φ(mean ÷ standard deviation) times the evidence of a whole one: of what a size of one
    standard deviation, which must be ``positive`` [..., K], does to the errors.
    """
    factor = np.linalg.cholesky(covariance)
    both = np.stack([np.broadcast_to(error_mm, positive.shape), positive], axis=-1)
    white = np.linalg.solve(factor, both)
    log_det = np.log(np.diagonal(factor, axis1=-2, axis2=-1)).sum(axis=-1)
    (square, pull), own = np.einsum("...k,...kj->j...", white[..., 0], white), np.square(white[..., 1]).sum(axis=-1)
    half, is_half = np.zeros(own.shape), own > 0
    half[is_half] = log_below(pull[is_half] / np.sqrt(np.maximum(1 - own[is_half], TINY_MM2))) + np.log(2)
    return np.asarray(half - 0.5 * square - log_det)


def _sizes(
    few: Few, slots: Sequence[_Slot], there: np.ndarray, noise: np.ndarray, rng: np.random.Generator
) -> dict[int, np.ndarray]:
    """Draw the sizes of every set, as `_noise_drawn` does the noise."""
    missed = few.error_mm - np.sqrt(np.diagonal(noise, axis1=1, axis2=2)) * rng.standard_normal(noise.shape[:2])
    sizes: dict[int, np.ndarray] = {}
    spread: dict[int, np.ndarray] = {}
    for at, slot in enumerate(slots):
        for draw in np.flatnonzero(there[at]):
            b, v = slot.states[there[at, draw]]
            block = few.blocks[b]
            sd = block.sds_mm[v]
            if b not in sizes:
                sizes[b], spread[b] = np.zeros((len(sd), DRAWS)), np.zeros((len(sd), DRAWS))
            sizes[b][:, draw], spread[b][:, draw] = sd * rng.standard_normal(len(sd)), sd
            missed[draw] -= few.columns[:, block.at] @ sizes[b][:, draw]
    pull = np.linalg.solve(noise + _sum(slots, there), missed[:, :, None])[:, :, 0]
    for b, sd in spread.items():
        sizes[b] += sd**2 * (few.columns[:, few.blocks[b].at].T @ pull.T)
    return sizes
