"""Fit one motor's columns: contacts, robust ridge least squares with priors learned from the data, repeat.

The posterior of a linear model with Gaussian noise σ² and independent priors N(0, v) has the covariance
C = (ΦᵀWΦ/σ² + V⁻¹)⁻¹. The scale of the priors of each group of harmonics and σ are those that maximise the evidence
(MacKay's fixed point), so that a group without support shrinks to nothing.
"""

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.linalg.lapack import dpotrf, dtrtri

from printmend.learn.drive.design import Contacts, Design, Normal, Rows, contacts, normal_equations
from printmend.path import frozen

NOISE_FLOOR_MM = 2e-4
HUBER = 2.0
HUBER_SHARE = 0.9545  # E[w r²] of Gaussian residuals under Huber's weights at 2 σ: what the misfit keeps of σ²
LOST = 6.0  # residuals beyond so many σ tell nothing
LOST_MM = 0.02  # but smaller ones than this are the model's own fault: corners between its harmonics
HARMONIC_MM = 0.8  # physics.md eq. 18: c_k ~ N(0, (0.8 k^−1.5 mm)²), hence c_k/k in position
POWER_MM = {"mean": (5.0, 25.0, 2.0, 1.0), "play": (1.5, 0.2, 0.2, 0.1)}
CROSS_MM = {1: 3.0, 2: 0.3, 3: 0.1}
RIPPLE_MM = 0.02
OFF_FOLD = 0.15  # a symmetric pulley whose other harmonics are larger is not symmetric
START_MM = 2.0


@dataclass(frozen=True)
class Prior:
    """The scale τ of each group of harmonics; 1 is the prior of physics.md eq. 18. The part that repeats nothing is a
    Gaussian process of standard deviation ``warp`` mm with the length ``warp_mm``. With a ``fold``, the pulley is
    thought to be symmetric: the multiples of ``fold`` (for 1, the eccentricity alone) are ``mean_on``, others
    ``mean_off``. σ is thought to be no smaller than ``floor_mm``."""

    mean_odd: float = 1.0
    mean_even: float = 1.0
    play_odd: float = 1.0
    play_even: float = 0.3
    elastic: float = 0.3
    warp: float = 0.3
    warp_mm: float = 20.0
    fold: int = 0
    mean_on: float = 1.0
    mean_off: float = 0.1
    floor_mm: float = NOISE_FLOOR_MM


@lru_cache(maxsize=256)
def groups(design: Design, fold: int) -> dict[str, np.ndarray]:
    """Return the masks [P] of the groups whose prior scale is learned; ``fold`` as in `Prior`."""
    odd = design.harmonic % 2 == 1
    mean, play = design.mask("mean"), design.mask("play")
    on = design.harmonic % fold == 0 if fold > 1 else design.harmonic == fold
    names = ("mean_on", "mean_off") if fold else ("mean_odd", "mean_even")
    first = on if fold else odd
    return {
        names[0]: mean & first,
        names[1]: mean & ~first,
        "play_odd": play & odd,
        "play_even": play & ~odd,
        "elastic": design.mask("elastic"),
        "warp": design.mask("warp"),
    }


def variances(design: Design, prior: Prior) -> np.ndarray:
    """Return the prior variance [P] mm² of every parameter."""
    v = _usual_variances(design, prior.warp_mm).copy()
    for name, mask in groups(design, prior.fold).items():
        v[mask] *= getattr(prior, name) ** 2
    return v


@lru_cache(maxsize=256)
def _usual_variances(design: Design, warp_mm: float) -> np.ndarray:
    """Return the variances [P] mm² where all scales are 1."""
    v = np.empty(design.size)
    v[design.parts["start"]] = START_MM**2
    v[design.parts["mean_powers"]] = np.square(POWER_MM["mean"][: design.mean_powers])
    v[design.parts["play_powers"]] = np.square(POWER_MM["play"][: design.play_powers])
    v[design.parts["cross"]] = [CROSS_MM[p + q] ** 2 for p, q in design.cross]
    k = design.harmonic
    wave = k > 0
    v[wave] = (HARMONIC_MM * k[wave] ** -2.5) ** 2
    v[design.mask("ripple")] = RIPPLE_MM**2
    v[design.parts["warp"]] = _warp_variances(design, warp_mm)
    return frozen(v)


def _warp_variances(design: Design, length_mm: float) -> np.ndarray:
    """Return the variances of the cosines of a Gaussian process with the kernel exp(−d²/2ℓ²): its spectrum, sampled."""
    span_mm = design.warp_span_mm[1] - design.warp_span_mm[0]
    waves = np.pi * np.arange(1, design.warp + 1) / span_mm
    power = 2 * length_mm * np.sqrt(2 * np.pi) / span_mm * np.exp(-((waves * length_mm) ** 2) / 2)
    return np.maximum(power, 1e-12)


@dataclass(frozen=True, eq=False)
class Posterior:
    """Parameters [P] (0 where inactive), their covariance over the ``active`` ones, and the log evidence."""

    values: np.ndarray
    covariance: np.ndarray
    active: np.ndarray
    sigma_mm: float
    prior: Prior
    log_evidence: float


def solve(
    design: Design, normal: Normal, active: np.ndarray, prior: Prior, sigma_mm: float, *, rounds: int
) -> Posterior:
    """Return the posterior of the ``active`` parameters [P]; the prior's scales and σ get ``rounds`` updates."""
    matrix = normal.matrix[np.ix_(active, active)]
    # about 0 instead of about normal.values; inactive parameters leave the model, so their share returns to the data
    slope = (normal.slope + normal.matrix @ normal.values)[active]
    masks = {name: mask[active] for name, mask in groups(design, prior.fold).items()}
    sigma2 = max(sigma_mm, prior.floor_mm) ** 2
    for last in range(rounds + 1):
        v = variances(design, prior)[active]
        root = np.sqrt(v)
        scaled = matrix * (root[:, None] * (root / sigma2))
        scaled.flat[:: len(v) + 1] += 1.0
        # Cholesky's factor and its inverse; the matrix, which is its own transpose, is at least the identity.
        factor, _ = dpotrf(scaled.T, lower=1, overwrite_a=1)
        whitened, _ = dtrtri(factor, lower=1)
        values = root * (whitened.T @ (whitened @ (root * slope))) / sigma2
        misfit = _misfit(normal, active, values)
        if last == rounds:
            break
        spread = np.einsum("ij,ij->j", whitened, whitened)  # C_ii/v_i
        known = len(v) - spread.sum()
        sigma2 = max(misfit / max(normal.count - known, 1.0) / HUBER_SHARE, prior.floor_mm**2)
        prior = _rescaled(prior, masks, values, v, spread)
    log_det = 2 * np.log(np.diag(factor)).sum()
    evidence = -0.5 * (misfit / sigma2 + (values**2 / v).sum() + log_det + normal.count * np.log(sigma2))
    full = np.zeros(design.size)
    full[active] = values
    covariance = (whitened.T @ whitened) * np.outer(root, root)
    return Posterior(full, covariance, active, float(np.sqrt(sigma2)), prior, float(evidence))


def _misfit(normal: Normal, active: np.ndarray, values: np.ndarray) -> float:
    step = -normal.values.copy()
    step[active] += values
    return max(float(normal.square - 2 * normal.slope @ step + step @ normal.matrix @ step), 0.0)


def _rescaled(
    prior: Prior, masks: dict[str, np.ndarray], values: np.ndarray, v: np.ndarray, spread: np.ndarray
) -> Prior:
    """MacKay's update: τ² ← τ² Σ w²/v / γ with γ = Σ (1 − C_ii/v_i), the number of parameters that the data settle."""
    scales: dict[str, Any] = {}
    for name, mask in masks.items():
        if not mask.any():
            continue
        settled = float((1 - spread[mask]).sum())
        ratio = (float((values[mask] ** 2 / v[mask]).sum()) + 0.1) / (settled + 0.1)
        largest = OFF_FOLD if name == "mean_off" else 10.0
        scales[name] = min(max(getattr(prior, name) * math.sqrt(min(max(ratio, 0.01), 100.0)), 1e-3), largest)
    return replace(prior, **scales)


@dataclass(frozen=True, eq=False)
class Fit:
    """A fit of one motor: the posterior, the normal equations it came from, the contacts and the mean |residual|.

    ``share`` is how many of the rows were independent: 1 for white residuals, less where the model leaves a pattern.
    """

    posterior: Posterior
    normal: Normal
    touch: Contacts
    loss_mm: float
    share: float


def robust_sigma_mm(residual_mm: np.ndarray) -> float:
    """Return 1.4826 times the median |residual|."""
    return max(1.4826 * float(np.median(np.abs(residual_mm))), NOISE_FLOOR_MM)


def robust_weights(rows: Rows, residual_mm: np.ndarray, sigma_mm: float, *, drop: bool) -> np.ndarray:
    """Return Huber's weights [N] times the rows' own; with ``drop``, 0 for outliers."""
    with np.errstate(invalid="ignore", divide="ignore"):
        away = np.abs(residual_mm) * (np.sqrt(rows.weight) / sigma_mm)
        weight = rows.weight * np.minimum(1.0, HUBER / away)
        lost = drop & (away > LOST) & (np.abs(residual_mm) > LOST_MM)
    weight[~(rows.weight > 0) | lost] = 0.0
    return weight


def independent_share(residual_mm: np.ndarray, sigma_mm: float) -> float:
    """Return which share of residuals [M], in the order of motion, is independent: variance/(length × block variance).

    Residuals that keep their sign for many rows are a pattern that the model lacks; taken for noise they would
    make every part of a model look certain.
    """
    clipped = np.clip(residual_mm, -3 * sigma_mm, 3 * sigma_mm)
    variance = float(np.mean(clipped**2)) + 1e-18
    worst = 1.0
    for length in (4, 16, 64):
        count = len(clipped) // length
        if count >= 8:
            blocks = clipped[: count * length].reshape(count, length).mean(axis=1)
            # the mean square of block means has a relative error of √(2/count): allow for two of them
            excess = float(np.mean(blocks**2)) * length / variance / (1 + 2 * np.sqrt(2 / count))
            worst = max(worst, excess)
    return 1.0 / worst


def refine(
    design: Design,
    rows: Rows,
    values: np.ndarray,
    active: np.ndarray,
    *,
    prior: Prior,
    passes: int,
    rounds: int,
    patience: int = 3,
    drop: bool = True,
) -> Fit:
    """Iterate contacts and least squares from ``values`` [P]; return the pass with the smallest mean |residual|.

    A pass: simulate the play, weigh the rows, solve for the ``active`` parameters. Ends after ``patience`` passes that
    bring nothing. ``drop`` outliers only once the contacts are known: before, they are most of what there is to learn.
    """
    measured = rows.weight > 0
    best: Fit | None = None
    still = 0
    for _ in range(passes + 1):
        touch = contacts(design, values, rows)
        residual = touch.residual_mm[measured]
        size = np.abs(residual)
        loss, sigma = float(size.mean()), robust_sigma_mm(size)
        still = 0 if best is None or loss < best.loss_mm * (1 - 1e-3) else still + 1
        if best is not None and still >= patience:
            break
        share = independent_share(residual, sigma)
        weight = robust_weights(rows, touch.residual_mm, sigma, drop=drop)
        normal = normal_equations(design, values, rows, touch, weight)
        post = solve(design, normal.tempered(share), active, prior, sigma, rounds=rounds)
        if best is None or loss <= best.loss_mm:
            best = Fit(post, normal, touch, loss, share)
        values, prior = post.values, post.prior
    assert best is not None
    return best
