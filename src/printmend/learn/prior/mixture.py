"""A mixture of Gaussians over pulleys, and its posterior where a trace saw part of a turn.

A shape is the vector of `pulley.shapes`. A component is N(mean, F Fᵀ + diag(noise)), at any turn of the pulley on its
shaft. What the trace says of the shape is exp(bᵀθ − θᵀAθ/2): ``A`` and ``b`` come from the grey box's normal
equations. Projected on the q directions that A settles it is y = Wθ + n, n ~ N(0, 1), so that each component at each
turn has the exact evidence N(y; W R mean, 1 + W R C Rᵀ Wᵀ) and an exact posterior; the answer mixes them by evidence.

The shipped components are of sound size and centred on the shaft. Their variants, other sizes and an eccentric bore,
only add columns to F. Two kinds of components are not learned: harmonics of the usual sizes (physics.md eq. 18), all of
them or the multiples of 2…8 alone, for shapes like nothing that was learned.
"""

from dataclasses import dataclass, replace
from functools import cache
from importlib import resources

import numpy as np

from printmend.learn.pulley.shapes import HARMONICS, turned
from printmend.units import TURN_RAD

SIZE = 1 + 2 * HARMONICS
_K = np.arange(1, HARMONICS + 1)
_BOTH = np.tile(_K, 2)
_UNIT = np.eye(SIZE)[0]  # a shape counts its radius from 1
ROUGH = np.append(1e-4, 0.001 * _BOTH**-0.5)  # radii: no pulley is like another to the micrometre
ROUGH[[1, 1 + HARMONICS]] = 0.003
ROUGHS = (1.0, 0.2)  # shares of that for the plain components, equally likely
SIZES = ((1.0, 0.0, 0.5), (0.62, 0.08, 0.125), (0.8, 0.1, 0.125), (1.0, 0.1, 0.125), (1.2, 0.1, 0.125))
BORE = 0.12
CENTRED = 0.9
PLAIN = 0.126  # 0.8 mm of a 6.37 mm pulley
COARSE, FINE = 48, 8
NEAR = 25.0  # nats below the best that the finer search still looks at
LEAST = 1e-5  # weight of a component that counts
IRREGULAR = ("polygon", "uneven", "fourier", "tabulated", "plain")
REGULAR = 100.0
MOST = 48  # places of a component, and posteriors in the answer, that are looked at
SETTLED = 0.02  # a direction in which the data say less than so much of the plain prior says nothing
_USUAL = np.append(0.25, PLAIN * _BOTH**-2.0)  # standard deviations of a damaged pulley, for that


@dataclass(frozen=True, eq=False)
class Component:
    """``weight`` of the mixture, ``mean`` [D], ``factors`` [D, Q], ``noise`` [D] (variances). ``turns``: False where
    turning changes nothing."""

    kind: str
    weight: float
    mean: np.ndarray
    factors: np.ndarray
    noise: np.ndarray
    turns: bool = True


@dataclass(frozen=True, eq=False)
class Mixture:
    """Learned ``components`` and those for shapes like none of them; ``plain`` are of the second sort."""

    components: tuple[Component, ...]
    plain: tuple[Component, ...]


@dataclass(frozen=True, eq=False)
class Believed:
    """The posterior of a shape: ``mean`` [D], ``covariance`` [D, D]; the weights of the kinds; the log evidence."""

    mean: np.ndarray
    covariance: np.ndarray
    kinds: dict[str, float]
    log_evidence: float


@dataclass(frozen=True, eq=False)
class _Place:
    """A component at turns ``angle_rad`` [G] with their log evidences [G]."""

    component: Component
    angle_rad: np.ndarray
    evidence: np.ndarray


def believe(mixture: Mixture, matrix: np.ndarray, slope: np.ndarray) -> Believed:
    """Return the posterior of a shape for the likelihood exp(slopeᵀθ − θᵀ matrix θ/2)."""
    values, axes = np.linalg.eigh(matrix * np.outer(_USUAL, _USUAL))
    known = values > SETTLED
    project = np.sqrt(values[known])[:, None] * axes[:, known].T / _USUAL
    seen = (axes[:, known].T @ (_USUAL * slope)) / np.sqrt(values[known])
    places = [_weighed(each, np.zeros(1), project, seen, TURN_RAD) for each in mixture.plain]
    step = TURN_RAD / COARSE
    grid = step * np.arange(COARSE)
    # Each learned component stands for its variants first: the widest of them contains the others.
    coarse = [
        _weighed(_variant(each, 1.0, 0.25, True), grid if each.turns else grid[:1], project, seen, step)
        for each in mixture.components
    ]
    tried = np.sort(np.concatenate([np.full(1, -np.inf), *(each.evidence for each in coarse)]))
    least = max(tried[-1] - NEAR, tried[-min(MOST, len(tried))])
    for each, rough in zip(mixture.components, coarse, strict=True):
        near = grid[: len(rough.evidence)][rough.evidence >= least]
        if not len(near):
            continue
        fine = np.unique(np.round(np.add.outer(near, step * np.arange(-FINE // 2, FINE // 2 + 1) / FINE), 9))
        angles = fine if each.turns else near
        for size, spread, share in SIZES:
            for eccentric, likely in ((False, CENTRED), (True, 1 - CENTRED)):
                shape = _variant(each, size, spread, eccentric, share * likely)
                places.append(_weighed(shape, angles, project, seen, step / FINE))
    return _mixed(places, project, seen)


def _variant(base: Component, size: float, spread: float, eccentric: bool, share: float = 1.0) -> Component:
    whole = _UNIT + base.mean
    columns = [size * base.factors]
    if spread:
        columns.append(spread * whole[:, None])
    if eccentric:
        columns.append(BORE * np.eye(SIZE)[:, [1, 1 + HARMONICS]])
    factors = np.concatenate(columns, axis=1)
    noise = size**2 * base.noise + ROUGH**2
    return Component(base.kind, share * base.weight, size * whole - _UNIT, factors, noise, base.turns or eccentric)


def _weighed(
    component: Component, angle_rad: np.ndarray, project: np.ndarray, seen: np.ndarray, cell_rad: float
) -> _Place:
    """Return the log evidence at turns [G], each standing for the turns within ``cell_rad`` about it."""
    columns = _columns(component, cell_rad)
    count = len(seen)
    # W R v = (Rᵀ Wᵀ)ᵀ v: turning the few rows of W back serves all columns.
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
    """Return mean and factors [D, 1 + Q], the last factor the turns between those that are tried."""
    tangent = _tangent(component.mean) * (cell_rad / np.sqrt(12))
    if not component.turns or cell_rad >= TURN_RAD:
        tangent = np.zeros(SIZE)
    return np.concatenate([component.mean[:, None], component.factors, tangent[:, None]], axis=1)


def _tangent(shape: np.ndarray) -> np.ndarray:
    cos, sin = shape[1 : HARMONICS + 1], shape[HARMONICS + 1 :]
    return np.concatenate([[0.0], -_K * sin, _K * cos])


def _mixed(places: list[_Place], project: np.ndarray, seen: np.ndarray) -> Believed:
    evidence = np.concatenate([each.evidence for each in places])
    angles = np.concatenate([each.angle_rad for each in places])
    component = np.repeat(np.arange(len(places)), [len(each.evidence) for each in places])
    best = float(evidence.max())
    shares = np.exp(evidence - best)
    total = float(shares.sum())
    kinds: dict[str, float] = {}
    mean, second, sum_ = np.zeros(SIZE), np.zeros((SIZE, SIZE)), 0.0
    for i in np.argsort(-shares, kind="stable")[:MOST]:
        share, each = float(shares[i]) / total, places[component[i]].component
        if share < LEAST:
            break
        here, covariance = _posterior(each, float(angles[i]), project, seen)
        mean += share * here
        second += share * (covariance + np.outer(here, here))
        kinds[each.kind] = kinds.get(each.kind, 0.0) + share
        sum_ += share
    mean, second = mean / sum_, second / sum_
    return Believed(mean, second - np.outer(mean, mean), kinds, best + float(np.log(total)))


def _posterior(
    component: Component, angle_rad: float, project: np.ndarray, seen: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    columns = turned(_columns(component, TURN_RAD / COARSE / FINE).T, np.array(angle_rad)).T
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
                for rough in ROUGHS:
                    usual = np.append(spread, np.where(on, tau * PLAIN * _BOTH**-2.5, 0.0))
                    noise = usual**2 + (rough * ROUGH) ** 2
                    name = f"fold-{fold}" if fold else "plain"
                    found.append(Component(name, 1.0, np.zeros(SIZE), np.zeros((SIZE, 0)), noise, False))
    return tuple(found)


def mixture(learned: tuple[Component, ...]) -> Mixture:
    """Join learned components with the plain ones. Regular shapes are `REGULAR` times as likely as irregular kinds:
    machines make them, and an irregular pulley soon shows that it is none."""
    odds = {each.kind: _odds(each.kind) for each in learned}
    total = sum(odds.values()) + 2 * REGULAR
    plain = plain_components()
    weights = np.array([each.weight * _odds(each.kind) for each in plain])
    weights *= 2 * REGULAR / total / weights.sum()
    return Mixture(
        tuple(replace(each, weight=each.weight * odds[each.kind] / total) for each in learned),
        tuple(replace(each, weight=float(weight)) for each, weight in zip(plain, weights, strict=True)),
    )


def _odds(kind: str) -> float:
    return 1.0 if kind in IRREGULAR else REGULAR


@cache
def shipped() -> Mixture:
    """Return the mixture that comes with printmend (`tools/train_prior.py` makes its weights)."""
    data = (resources.files("printmend.learn.prior") / "prior.safetensors").read_bytes()
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
