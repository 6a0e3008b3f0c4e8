"""A mixture of Gaussians over pulleys, and its posterior where a trace saw part of a turn.

A shape θ is the vector of `pulley.shapes`. A component is N(mean, C) with C = F Fᵀ + diag(noise), at any turn R of the
pulley on its shaft. The likelihood of a shape under the trace is exp(bᵀθ − θᵀAθ/2), where A and b come from the grey
box's normal equations. On the q directions that A settles it is y = Wθ + n with n ~ N(0, 1), so that each component at
each turn has the exact evidence N(y; W R mean, 1 + W R C Rᵀ Wᵀ) and an exact posterior; the answer mixes them by
evidence.

The shipped components are of sound size and centred on the shaft. Their variants of other sizes and with an eccentric
bore only add columns to F. For shapes like nothing that was learned there are plain components, made of harmonics of
the usual sizes (physics.md eq. 18): all of them, or the multiples of 2…8 alone.
"""

from dataclasses import dataclass, replace
from functools import cache
from importlib import resources

import numpy as np

from printmend.units import TURN_RAD
from printmend_lab.greybox.drive.fit import MACHINES, SEED, drawn_about
from printmend_lab.greybox.pulley.outline import HARMONICS, turned

ENTRIES = 1 + 2 * HARMONICS
_K = np.arange(1, HARMONICS + 1)
_BOTH = np.tile(_K, 2)
_UNIT = np.eye(ENTRIES)[0]  # what to add to a shape for a radius that counts from 0, not from 1
# Lengths are in radii of a sound pulley. Standard deviations of each entry about its component: no pulley is like
# another to the micrometre, and bores are less exact than outlines.
ROUGHNESS_SD = np.append(1e-4, 0.001 * _BOTH**-0.5)
ROUGHNESS_SD[[1, 1 + HARMONICS]] = 0.003
PLAIN_ROUGHNESS = (1.0, 0.2)  # shares of it that plain components have, equally likely
# Sizes of a pulley: mean, relative standard deviation, prior weight. Half are sound, the others as on damaged printers.
SIZE_VARIANTS = ((1.0, 0.0, 0.5), (0.62, 0.08, 0.125), (0.8, 0.1, 0.125), (1.0, 0.1, 0.125), (1.2, 0.1, 0.125))
BORE_SD = 0.12  # of an eccentric bore's place, each way
CENTRED_SHARE = 0.9  # prior share of pulleys whose bore is centred
PLAIN_SD = 0.126  # 0.8 mm of a pulley of 6.37 mm (physics.md eq. 18)
COARSE_TURNS, FINE_TURNS = 48, 8  # turns that the first look tries, and steps between two of them in the second
RIVALS_NATS = 25.0  # turns whose log evidence is below the best by more are not looked at a second time
LEAST_WEIGHT = 1e-5  # posteriors with a smaller weight are left out of the answer
IRREGULAR = ("polygon", "uneven", "fourier", "tabulated", "plain")
REGULAR_ODDS = 100.0  # prior odds of a regular kind to an irregular one
MOST_PLACES = 48  # most turns that get a second look, and most posteriors in the answer
_USUAL_SD = np.append(0.25, PLAIN_SD * _BOTH**-2.0)  # standard deviations of a damaged pulley's entries
# Share of the log evidence that counts where machines are drawn for a promise: no pulley is quite like a component.
TRUST = 0.5
LEAST_SETTLED = 0.02  # directions of which the data say less than this, in units of `_USUAL_SD`, are left out


@dataclass(frozen=True, eq=False)
class Component:
    """A factor analyser: its ``weight`` in the mixture, ``mean`` [D], ``factors`` [D, Q] and ``noise`` [D] (variances).

    ``turns`` is False where turning the pulley on its shaft changes nothing.
    """

    kind: str
    weight: float
    mean: np.ndarray
    factors: np.ndarray
    noise: np.ndarray
    turns: bool = True


@dataclass(frozen=True, eq=False)
class Mixture:
    """Learned ``components``, and ``plain`` ones for shapes like none of them."""

    components: tuple[Component, ...]
    plain: tuple[Component, ...]


@dataclass(frozen=True, eq=False)
class ShapePosterior:
    """The posterior of a shape: its ``mean`` [D], ``covariance`` [D, D], weight of each kind, and log evidence.

    ``drawn`` [D, `MACHINES`] are shapes that are still possible, by odds that trust the components less.
    """

    mean: np.ndarray
    covariance: np.ndarray
    kinds: dict[str, float]
    log_evidence: float
    drawn: np.ndarray


@dataclass(frozen=True, eq=False)
class _Place:
    """A component at turns ``angle_rad`` [G] with their log evidences [G]."""

    component: Component
    angle_rad: np.ndarray
    evidence: np.ndarray


def shape_posterior(mixture: Mixture, matrix: np.ndarray, slope: np.ndarray) -> ShapePosterior:
    """Return the posterior of a shape for the likelihood exp(slopeᵀθ − θᵀ matrix θ/2)."""
    values, axes = np.linalg.eigh(matrix * np.outer(_USUAL_SD, _USUAL_SD))
    known = values > LEAST_SETTLED
    project = np.sqrt(values[known])[:, None] * axes[:, known].T / _USUAL_SD
    seen = (axes[:, known].T @ (_USUAL_SD * slope)) / np.sqrt(values[known])
    places = [_weighed(each, np.zeros(1), project, seen, TURN_RAD) for each in mixture.plain]
    step = TURN_RAD / COARSE_TURNS
    grid = step * np.arange(COARSE_TURNS)
    # In the first look the widest variant of a component stands for all of them, because it contains them.
    coarse = [
        _weighed(_variant(each, 1.0, 0.25, True), grid if each.turns else grid[:1], project, seen, step)
        for each in mixture.components
    ]
    tried = np.sort(np.concatenate([np.full(1, -np.inf), *(each.evidence for each in coarse)]))
    least = max(tried[-1] - RIVALS_NATS, tried[-min(MOST_PLACES, len(tried))])
    for each, rough in zip(mixture.components, coarse, strict=True):
        near = grid[: len(rough.evidence)][rough.evidence >= least]
        if not len(near):
            continue
        about = step * np.arange(-FINE_TURNS // 2, FINE_TURNS // 2 + 1) / FINE_TURNS
        fine = np.unique(np.round(np.add.outer(near, about), 9))
        angles = fine if each.turns else near
        for size, spread, share in SIZE_VARIANTS:
            for eccentric, likely in ((False, CENTRED_SHARE), (True, 1 - CENTRED_SHARE)):
                shape = _variant(each, size, spread, eccentric, share * likely)
                places.append(_weighed(shape, angles, project, seen, step / FINE_TURNS))
    return _mixed(places, project, seen)


def _variant(base: Component, size: float, spread: float, eccentric: bool, share: float = 1.0) -> Component:
    """Return a component of another ``size``, known to within ``spread``, with or without an ``eccentric`` bore."""
    whole = _UNIT + base.mean
    columns = [size * base.factors]
    if spread:
        columns.append(spread * whole[:, None])
    if eccentric:
        columns.append(BORE_SD * np.eye(ENTRIES)[:, [1, 1 + HARMONICS]])
    factors = np.concatenate(columns, axis=1)
    noise = size**2 * base.noise + ROUGHNESS_SD**2
    return Component(base.kind, share * base.weight, size * whole - _UNIT, factors, noise, base.turns or eccentric)


def _weighed(
    component: Component, angle_rad: np.ndarray, project: np.ndarray, seen: np.ndarray, cell_rad: float
) -> _Place:
    """Return the log evidence of a component at turns [G]; each stands for its cell of ``cell_rad``."""
    columns = _columns(component, cell_rad)
    count = len(seen)
    # W R v = (Rᵀ Wᵀ)ᵀ v: the few rows of W are turned back instead of all the columns.
    at = turned(project[None], -angle_rad[:, None]) @ columns  # [G, q, 1 + Q]
    factor = np.linalg.cholesky(np.eye(count) + (project * component.noise) @ project.T)
    whiten = np.linalg.inv(factor)
    at = whiten @ at
    away = whiten @ seen - at[:, :, 0]
    wide = at[:, :, 1:]
    small = np.linalg.cholesky(np.eye(wide.shape[2]) + np.swapaxes(wide, 1, 2) @ wide)
    along = np.linalg.solve(small, np.swapaxes(wide, 1, 2) @ away[:, :, None])[:, :, 0]
    log_det = np.log(np.diag(factor)).sum() + np.log(np.diagonal(small, axis1=1, axis2=2)).sum(axis=1)
    share = min(cell_rad / TURN_RAD, 1.0)
    evidence = np.log(component.weight * share) - log_det - 0.5 * ((away**2).sum(axis=1) - (along**2).sum(axis=1))
    return _Place(component, angle_rad, evidence)


def _columns(component: Component, cell_rad: float) -> np.ndarray:
    """Return mean and factors [D, 1 + Q] of a component; its last factor is the spread of turns within a cell."""
    tangent = _tangent(component.mean) * (cell_rad / np.sqrt(12))
    if not component.turns or cell_rad >= TURN_RAD:
        tangent = np.zeros(ENTRIES)
    return np.concatenate([component.mean[:, None], component.factors, tangent[:, None]], axis=1)


def _tangent(shape: np.ndarray) -> np.ndarray:
    """Return the derivative [D] of a shape by its turn on the shaft."""
    cos, sin = shape[1 : HARMONICS + 1], shape[HARMONICS + 1 :]
    return np.concatenate([[0.0], -_K * sin, _K * cos])


def _mixed(places: list[_Place], project: np.ndarray, seen: np.ndarray) -> ShapePosterior:
    evidence = np.concatenate([each.evidence for each in places])
    angles = np.concatenate([each.angle_rad for each in places])
    component = np.repeat(np.arange(len(places)), [len(each.evidence) for each in places])
    best = float(evidence.max())
    shares = np.exp(evidence - best)
    total = float(shares.sum())
    kinds: dict[str, float] = {}
    mean, second, sum_ = np.zeros(ENTRIES), np.zeros((ENTRIES, ENTRIES)), 0.0
    for i in np.argsort(-shares, kind="stable")[:MOST_PLACES]:
        share, each = float(shares[i]) / total, places[component[i]].component
        if share < LEAST_WEIGHT:
            break
        here, covariance = _posterior(each, float(angles[i]), project, seen)
        mean += share * here
        second += share * (covariance + np.outer(here, here))
        kinds[each.kind] = kinds.get(each.kind, 0.0) + share
        sum_ += share
    mean, second = mean / sum_, second / sum_
    drawn = _drawn([places[i].component for i in component], angles, evidence, project, seen)
    return ShapePosterior(mean, second - np.outer(mean, mean), kinds, best + float(np.log(total)), drawn)


def _drawn(
    components: list[Component], angle_rad: np.ndarray, evidence: np.ndarray, project: np.ndarray, seen: np.ndarray
) -> np.ndarray:
    """Draw shapes [D, `MACHINES`] from components at turns with these log evidences, each [G]."""
    rng = np.random.default_rng(SEED)
    odds = np.array([REGULAR_ODDS / _odds(each.kind) for each in components])
    doubted = TRUST * (evidence + np.log(odds))
    order = np.argsort(-doubted, kind="stable")
    shares = np.cumsum(np.exp(doubted - doubted.max())[order])
    picked = order[np.searchsorted(shares, shares[-1] * (np.arange(MACHINES) + rng.uniform()) / MACHINES)]
    found = np.empty((ENTRIES, MACHINES))
    for i in np.unique(picked):
        mean, covariance = _posterior(components[i], float(angle_rad[i]), project, seen)
        mine = picked == i
        found[:, mine] = mean[:, None] + drawn_about(covariance, int(mine.sum()), rng)
    return found


def _posterior(
    component: Component, angle_rad: float, project: np.ndarray, seen: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    columns = turned(_columns(component, TURN_RAD / COARSE_TURNS / FINE_TURNS).T, np.array(angle_rad)).T
    middle, factors = columns[:, 0], columns[:, 1:]
    covariance = np.diag(component.noise) + factors @ factors.T
    narrowed = project @ covariance
    gain = np.linalg.solve(np.eye(len(seen)) + narrowed @ project.T, narrowed).T
    return middle + gain @ (seen - project @ middle), covariance - gain @ narrowed


def plain_components() -> tuple[Component, ...]:
    """Return the components that are not learned: all harmonics, the eccentricity alone, or one symmetry."""
    found = []
    for fold in (0, 1, 2, 3, 4, 5, 6, 7, 8):
        on = _BOTH % fold == 0 if fold > 1 else (_BOTH == 1 if fold else _BOTH > 0)
        for tau in (4.0, 2.0, 1.0, 0.3, 0.1, 0.03):
            for spread in (0.003, 0.25):
                for rough in PLAIN_ROUGHNESS:
                    usual = np.append(spread, np.where(on, tau * PLAIN_SD * _BOTH**-2.5, 0.0))
                    noise = usual**2 + (rough * ROUGHNESS_SD) ** 2
                    name = f"fold-{fold}" if fold else "plain"
                    found.append(Component(name, 1.0, np.zeros(ENTRIES), np.zeros((ENTRIES, 0)), noise, False))
    return tuple(found)


def mixture(learned: tuple[Component, ...]) -> Mixture:
    """Join learned components with the plain ones.

    Regular kinds are `REGULAR_ODDS` times as likely as irregular ones: machines make regular pulleys, and an irregular
    one soon shows that it is none.
    """
    odds = {each.kind: _odds(each.kind) for each in learned}
    total = sum(odds.values()) + 2 * REGULAR_ODDS
    plain = plain_components()
    weights = np.array([each.weight * _odds(each.kind) for each in plain])
    weights *= 2 * REGULAR_ODDS / total / weights.sum()
    return Mixture(
        tuple(replace(each, weight=each.weight * odds[each.kind] / total) for each in learned),
        tuple(replace(each, weight=float(weight)) for each, weight in zip(plain, weights, strict=True)),
    )


def _odds(kind: str) -> float:
    return 1.0 if kind in IRREGULAR else REGULAR_ODDS


@cache
def shipped() -> Mixture:
    """Return the mixture that comes with printmend (`tools/train_prior.py` makes its weights)."""
    data = (resources.files("printmend_lab.prior") / "prior.safetensors").read_bytes()
    return mixture(parse_weights(data))


def parse_weights(data: bytes) -> tuple[Component, ...]:
    """Read components from safetensors bytes: for each KIND, KIND.weight [J], .mean, .factors, .noise."""
    from safetensors.numpy import load

    tensors = load(data)
    found = []
    for kind in sorted({name.rpartition(".")[0] for name in tensors}):
        weight, mean, factors, noise = (
            tensors[f"{kind}.{part}"].astype(float) for part in ("weight", "mean", "factors", "noise")
        )
        turns = kind != "round"
        found += [Component(kind, float(weight[j]), mean[j], factors[j], noise[j], turns) for j in range(len(weight))]
    return tuple(found)
