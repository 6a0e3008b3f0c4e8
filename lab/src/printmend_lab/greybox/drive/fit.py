"""Fit one motor's columns: find the contacts, solve robust ridge least squares, and repeat (physics.md eq. 17).

The posterior covariance is that of physics.md eq. 19. σ and the scale of each group of harmonics' priors are those that
maximise the evidence (MacKay's fixed point), so that a group without support in the data shrinks to nothing.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from printmend.infer.scatter import independent_share
from printmend.path import frozen
from printmend.units import SIGMA_PER_MEDIAN
from printmend_lab.greybox.drive import kernels
from printmend_lab.greybox.drive.design import Contacts, Design, Normal, Rows, contacts, normal_equations

# What a trace could see of one motor: which angles, and whether the other one moved by itself.

SECTORS_PER_TURN = 40  # sectors of 9° in which contacts are counted
LEAST_CROSSING_MM = 3.0  # how far the other axis must move by itself, root mean square, for a crooked frame to show
ALL_SEEN = 0.95  # a larger share of the turn counts as all of it
GLIMPSED_TURN = 0.15  # a smaller share of a turn says nothing about a pulley's shape


def crosses(rows: Rows) -> bool:
    """Say whether the other motor moved by itself, not only along with this one."""
    measured = rows.weight > 0
    own, other = rows.own_mm[measured], rows.other_mm[measured]
    own, other = own - own.mean(), other - other.mean()
    together = float(own @ other) / max(float(own @ own), 1e-300)
    return float(np.std(other - together * own)) > LEAST_CROSSING_MM


def seen_share(rows: Rows, touch: Contacts) -> float:
    """Return the share of a motor's turn in which the rows had some contact, given the contacts of its fit."""
    touched = touch.at[(rows.weight > 0) & (touch.side != 0)]
    turns = np.mod(rows.motor_mm[touched] / rows.period_mm, 1.0)
    hit = np.bincount((turns * SECTORS_PER_TURN).astype(np.int64) % SECTORS_PER_TURN, minlength=SECTORS_PER_TURN) > 0
    # The neighbours of a hit count as seen, so that a sparse trace is judged by its gaps and not by its count.
    hit |= np.roll(hit, 1) | np.roll(hit, -1)
    place = rows.motor_mm[touched[touched > 0]]
    # Whatever its neighbours, a span shorter than a turn leaves the rest of the turn unseen.
    return min(float(hit.mean()), float(np.ptp(place)) / rows.period_mm if len(place) else 0.0)


# Machines that a print of less than a turn allows: the rest of a pulley that nobody saw is no bell curve.
#
# It is mostly round and now and then has a flat, or it may be of one kind or another. So a fit of such a motor keeps
# machines, drawn from all that is possible, each as likely.

MACHINES = 48  # number of machines that are drawn
SEED = 17  # the same measurement always gives the same machines


def drawn_about(covariance: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Draw ``count`` deviations [P, count] with a covariance [P, P]."""
    values, axes = np.linalg.eigh(covariance)
    return np.asarray((axes * np.sqrt(np.maximum(values, 0.0))) @ rng.standard_normal((len(values), count)))


LEAST_SIGMA_MM = 2e-4  # smallest σ that is believed: tables and G-code are written no finer
HUBER_SIGMAS = 2.0  # residuals beyond so many σ are weighted down (Huber)
HUBER_VARIANCE_SHARE = 0.9545  # share of σ² that Huber's weights at 2 σ leave of Gaussian residuals, E[w r²]/σ²
OUTLIER_SIGMAS = 6.0  # residuals beyond so many σ are left out
LEAST_OUTLIER_MM = 0.02  # smaller residuals are never left out: they are the model's own, at corners between harmonics
# Prior standard deviations. A harmonic's is physics.md eq. 18; those of powers are of (m/100 mm)^0…3, sized by the
# damaged printers of physics.md §3; those of the frame's terms are by their order.
HARMONIC_SD_MM = 0.8
POWER_SD_MM = {"mean": (5.0, 25.0, 2.0, 1.0), "play": (1.5, 0.2, 0.2, 0.1)}
CROSS_SD_MM = {1: 3.0, 2: 0.3, 3: 0.1}
RIPPLE_SD_MM = 0.02  # a tenth of a full step
START_SD_MM = 2.0  # of the belt's place in its play at the start
MOST_SCALE = 10.0  # largest scale of a group's prior
MOST_OFF_FOLD = 0.15  # largest scale of the harmonics off a symmetry: a pulley with larger ones is not symmetric


@dataclass(frozen=True)
class Prior:
    """The scale τ of the prior of each group of harmonics; 1 is physics.md eq. 18.

    The part that repeats nothing is a Gaussian process with the standard deviation ``warp`` mm and the length
    ``warp_mm``. With a ``fold`` the pulley is believed to be symmetric: the harmonics that are multiples of ``fold``
    (with fold 1 the eccentricity alone) have the scale ``mean_on``, the others ``mean_off``. ``floor_mm`` is the
    smallest σ.
    """

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
    floor_mm: float = LEAST_SIGMA_MM


@lru_cache(maxsize=256)
def groups(design: Design, fold: int) -> tuple[tuple[str, ...], np.ndarray]:
    """Return the groups whose prior scale is learned, and each parameter's group [P], their number for one of none.

    ``fold`` is as in `Prior`.
    """
    odd = design.harmonic % 2 == 1
    mean, play = design.mask("mean"), design.mask("play")
    on = design.harmonic % fold == 0 if fold > 1 else design.harmonic == fold
    names = ("mean_on", "mean_off") if fold else ("mean_odd", "mean_even")
    first = on if fold else odd
    masks = (mean & first, mean & ~first, play & odd, play & ~odd, design.mask("elastic"), design.mask("warp"))
    group = np.full(design.size, len(masks))
    for number, mask in enumerate(masks):
        group[mask] = number
    return (*names, "play_odd", "play_even", "elastic", "warp"), frozen(group)


def variances(design: Design, prior: Prior) -> np.ndarray:
    """Return the prior variance [P] mm² of every parameter."""
    names, group = groups(design, prior.fold)
    scales = np.array([*(getattr(prior, name) for name in names), 1.0])
    return np.asarray(_usual_variances(design, prior.warp_mm) * np.square(scales)[group])


@lru_cache(maxsize=256)
def _usual_variances(design: Design, warp_mm: float) -> np.ndarray:
    """Return the prior variances [P] mm² of the parameters with all scales 1."""
    v = np.empty(design.size)
    v[design.parts["start"]] = START_SD_MM**2
    v[design.parts["mean_powers"]] = np.square(POWER_SD_MM["mean"][: design.mean_powers])
    v[design.parts["play_powers"]] = np.square(POWER_SD_MM["play"][: design.play_powers])
    v[design.parts["cross"]] = [CROSS_SD_MM[p + q] ** 2 for p, q in design.cross]
    k = design.harmonic
    wave = k > 0
    v[wave] = (HARMONIC_SD_MM * k[wave] ** -2.5) ** 2
    v[design.mask("ripple")] = RIPPLE_SD_MM**2
    v[design.parts["warp"]] = _warp_variances(design, warp_mm)
    return frozen(v)


def _warp_variances(design: Design, length_mm: float) -> np.ndarray:
    """Return the variances [W] of the cosines that make a Gaussian process of kernel exp(−d²/2ℓ²): its spectrum."""
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

    @property
    def sds(self) -> np.ndarray:
        """The standard deviation of every parameter [P], 0 where inactive."""
        sds = np.zeros(len(self.values))
        sds[self.active] = np.sqrt(np.diag(self.covariance))
        return sds


def solve(
    design: Design, normal: Normal, active: np.ndarray, prior: Prior, sigma_mm: float, *, rounds: int
) -> Posterior:
    """Return the posterior of the ``active`` parameters [P] after ``rounds`` updates of the prior's scales and of σ."""
    known, rest = np.flatnonzero(active), np.flatnonzero(~active)
    matrix = normal.matrix[np.ix_(known, known)]
    # The equations are moved from about normal.values to about 0: what inactive parameters explained is data again.
    slope = (normal.slope + normal.matrix @ normal.values)[known]
    gone, away = normal.values[rest], normal.slope[rest]
    pull = normal.slope[known] + normal.matrix[np.ix_(known, rest)] @ gone
    square = normal.square + 2 * away @ gone + gone @ normal.matrix[np.ix_(rest, rest)] @ gone
    names, group = groups(design, prior.fold)
    scales = np.array([*(getattr(prior, name) for name in names), 1.0])
    most = np.array([MOST_OFF_FOLD if name == "mean_off" else MOST_SCALE for name in names])
    usual, floor2 = _usual_variances(design, prior.warp_mm)[known], prior.floor_mm**2
    values, root, whitened = np.empty(len(known)), np.empty(len(known)), np.empty((len(known), len(known)))
    sigma2, misfit, log_det = kernels.settle(
        matrix, slope, pull, normal.values[known], square, float(normal.count), usual, group[known], most, scales,
        max(sigma_mm**2, floor2), floor2, HUBER_VARIANCE_SHARE, rounds, values, root, whitened,
    )  # fmt: skip
    prior = replace(prior, **dict(zip(names, scales.tolist(), strict=False)))
    surprise = misfit / sigma2 + np.square(values / root).sum() + log_det + normal.count * np.log(sigma2)
    full = np.zeros(design.size)
    full[known] = values
    covariance = (whitened.T @ whitened) * np.outer(root, root)
    return Posterior(full, covariance, active, float(np.sqrt(sigma2)), prior, -0.5 * float(surprise))


def lower_inverse(factor: np.ndarray) -> np.ndarray:
    """Return the inverse of a lower triangular matrix [N, N]."""
    out = np.zeros_like(factor)
    kernels.lower_inverse(factor, out)
    return out


@dataclass(frozen=True, eq=False)
class Fit:
    """A fit of one motor: the posterior, the normal equations that it solves, and the contacts.

    ``loss_mm`` is the mean absolute residual. ``share`` is the share of rows that are independent: 1 for white
    residuals, less where the model leaves a pattern.
    """

    posterior: Posterior
    normal: Normal
    touch: Contacts
    loss_mm: float
    share: float


def robust_sigma_mm(residual_mm: np.ndarray) -> float:
    """Return the standard deviation of Gaussian residuals with this median absolute value."""
    size = np.abs(residual_mm)
    half = len(size) // 2
    size.partition((half - 1, half) if half else half)  # np.median takes ten times as long around it
    median_mm = size[half] if len(size) % 2 else (size[half - 1] + size[half]) / 2
    return max(SIGMA_PER_MEDIAN * float(median_mm), LEAST_SIGMA_MM)


def robust_weights(rows: Rows, residual_mm: np.ndarray, sigma_mm: float, *, drop: bool) -> np.ndarray:
    """Return Huber's weights [N] times the rows' own; with ``drop`` outliers get 0."""
    with np.errstate(invalid="ignore", divide="ignore"):
        away = np.abs(residual_mm) * (np.sqrt(rows.weight) / sigma_mm)
        weight = rows.weight * np.minimum(1.0, HUBER_SIGMAS / away)
        lost = drop & (away > OUTLIER_SIGMAS) & (np.abs(residual_mm) > LEAST_OUTLIER_MM)
    weight[~(rows.weight > 0) | lost] = 0.0
    return weight


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
    """Iterate contacts and least squares from ``values`` [P]; return the pass with the smallest mean absolute residual.

    A pass simulates the play, weighs the rows and solves for the ``active`` parameters, with ``rounds`` updates of the
    prior. The iteration ends after ``passes``, or after ``patience`` passes without gain. ``drop`` leaves outliers out;
    it is only right once the contacts are known, for before that large residuals are what there is to learn.
    """
    measured = rows.weight > 0
    best: Fit | None = None
    still = 0
    for _ in range(passes + 1):
        touch = contacts(design, values, rows)
        residual = touch.residual_mm[measured] * np.sqrt(rows.weight[measured])
        size = np.abs(residual)
        loss, sigma = float(size.mean()), robust_sigma_mm(size)
        still = 0 if best is None or loss < best.loss_mm * (1 - 1e-3) else still + 1
        if best is not None and still >= patience:
            break
        share = min(independent_share(residual, sigma), rows.independent)
        weight = robust_weights(rows, touch.residual_mm, sigma, drop=drop)
        normal = normal_equations(design, values, rows, touch, weight)
        post = solve(design, normal.tempered(share), active, prior, sigma, rounds=rounds)
        if best is None or loss <= best.loss_mm:
            best = Fit(post, normal, touch, loss, share)
        values, prior = post.values, post.prior
    assert best is not None
    return best
