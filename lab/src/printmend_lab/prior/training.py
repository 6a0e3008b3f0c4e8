"""Learn a mixture of factor analysers from random shapes, each known up to its turn on the shaft.

It is classification EM: every shape is assigned to the component and the turn under which it is most likely; then every
component is fitted to its shapes in closed form, with the largest eigenvectors of their covariance as factors and the
rest as independent noise of each harmonic. A seed gives the same weights again.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from printmend.units import TURN_RAD
from printmend_lab.greybox.pulley.outline import HARMONICS, draw, kinds, turned

TURNS_TRIED = 96  # turns of the first passes
FINE_TURNS = 8  # steps between two of them in the last passes
EM_PASSES = 24  # half of them with the first turns; assignments hardly change in the last ones
RANK = 6  # factors of a component
COMPONENTS = {
    "round": 1, "ellipse": 2, "polygon": 10, "flat": 6, "fourier": 6, "tabulated": 4, "egg": 14, "uneven": 10,
    "rounded-2": 2, "rounded-3": 2, "rounded-4": 2, "rounded-5": 2, "rounded-6": 2,
    "arcs-2": 8, "arcs-3": 8, "arcs-4": 8, "arcs-5": 4, "arcs-6": 4, "arcs-8": 4,
}  # fmt: skip
SHAPES_PER_COMPONENT = 150  # drawn for each component of the mixture
LEAST_NOISE_SD = 5e-5  # radii: 0.3 µm on a usual pulley


@dataclass(frozen=True, eq=False)
class Analysers:
    """J factor analysers: ``weight`` [J], ``mean`` [J, D], ``factors`` [J, D, Q] and ``noise`` [J, D].

    ``noise`` are variances, equal for a harmonic's cosine and sine, so that turning a shape leaves them as they are.
    """

    weight: np.ndarray
    mean: np.ndarray
    factors: np.ndarray
    noise: np.ndarray


def train_all(
    seed: int, *, without: Sequence[str] = (), tick: Callable[[str], None] = lambda kind: None
) -> dict[str, np.ndarray]:
    """Return the weights of a mixture over all kinds but those held out: KIND.weight, .mean, .factors, .noise.

    Each kind has a generator of its own, so that leaving one out changes no other.
    """
    tensors = {}
    for place, kind in enumerate(kinds()):
        if kind in without:
            continue
        components = COMPONENTS[kind]
        found = train(kind, SHAPES_PER_COMPONENT * (components + 2), components, np.random.default_rng([seed, place]))
        for part in ("weight", "mean", "factors", "noise"):
            tensors[f"{kind}.{part}"] = np.ascontiguousarray(getattr(found, part), np.float32)
        tick(kind)
    return tensors


def train(kind: str, count: int, components: int, rng: np.random.Generator) -> Analysers:
    """Fit ``components`` to ``count`` shapes of a kind."""
    shapes = draw(kind, count, rng)
    grid = TURN_RAD * np.arange(TURNS_TRIED) / TURNS_TRIED
    label, angle = _first_labels(shapes, components, rng), np.zeros(count)
    for j in range(components):
        angle[label == j] = _aligned(shapes[label == j])
    found = _fitted(shapes, angle, label, components)
    for round_ in range(EM_PASSES):
        fine = round_ >= EM_PASSES // 2
        between = TURN_RAD / TURNS_TRIED * np.linspace(-1, 1, 2 * FINE_TURNS + 1)
        offsets = angle[:, None] + (between if fine else grid[None])
        tried = turned(shapes[:, None], offsets)  # [N, G, D]
        likely = np.stack([_log_density(found, j, tried) for j in range(len(found.weight))])  # [J, N, G]
        best = likely.max(axis=2)
        label = best.argmax(axis=0)
        turn = likely[label, np.arange(count)].argmax(axis=1)
        angle = offsets[np.arange(count), turn]
        found = _fitted(shapes, angle, label, components)
    return found


def _first_labels(shapes: np.ndarray, components: int, rng: np.random.Generator) -> np.ndarray:
    """Group shapes by their harmonics' amplitudes, which turning leaves as they are: k-means from far-apart seeds."""
    size = np.hypot(shapes[:, 1 : HARMONICS + 1], shapes[:, HARMONICS + 1 :])
    size = np.concatenate([shapes[:, :1], size], axis=1)
    centres = size[rng.integers(len(size))][None]
    while len(centres) < components:
        away = ((size[:, None] - centres) ** 2).sum(axis=2).min(axis=1)
        if away.max() < 1e-12:
            break
        centres = np.vstack([centres, size[rng.choice(len(size), p=away / away.sum())]])
    for _ in range(20):
        label = ((size[:, None] - centres) ** 2).sum(axis=2).argmin(axis=1)
        for j in range(len(centres)):
            if (label == j).any():
                centres[j] = size[label == j].mean(axis=0)
    return label


def _aligned(shapes: np.ndarray) -> np.ndarray:
    """Return the angles [N] that turn shapes onto their common mean, found in five rounds from the first shape."""
    grid = TURN_RAD * np.arange(TURNS_TRIED) / TURNS_TRIED
    if not len(shapes):
        return np.zeros(0)
    mean = shapes[0]
    for _ in range(5):
        tried = turned(shapes[:, None], grid[None])
        angle = grid[(tried @ mean).argmax(axis=1)]
        mean = turned(shapes, angle).mean(axis=0)
    return angle


def _fitted(shapes: np.ndarray, angle: np.ndarray, label: np.ndarray, components: int) -> Analysers:
    lists: list[tuple] = []
    placed = turned(shapes, angle)
    for j in range(components):
        mine = placed[label == j]
        if len(mine) < 4 * RANK and len(shapes) > 4 * RANK and (label != j).any():
            continue
        mean = mine.mean(axis=0)
        centred = mine - mean
        _, size, axes = np.linalg.svd(centred / np.sqrt(len(mine)), full_matrices=False)
        factors = (axes[:RANK] * size[:RANK, None]).T
        rest = (centred**2).mean(axis=0) - (factors**2).sum(axis=1)
        wave = (rest[1 : HARMONICS + 1] + rest[HARMONICS + 1 :]) / 2
        noise = np.maximum(np.concatenate([rest[:1], wave, wave]), LEAST_NOISE_SD**2)
        lists.append((len(mine) / len(shapes), mean, factors, noise))
    weight, mean, factors, noise = (np.stack(part) for part in zip(*lists, strict=True))
    return Analysers(weight / weight.sum(), mean, factors, noise)


def _log_density(found: Analysers, j: int, shapes: np.ndarray) -> np.ndarray:
    root = np.sqrt(found.noise[j])
    scaled = found.factors[j] / root[:, None]
    away = (shapes - found.mean[j]) / root
    small = np.eye(scaled.shape[1]) + scaled.T @ scaled
    factor = np.linalg.cholesky(small)
    along = np.linalg.solve(factor, scaled.T)  # [Q, D]
    squared = (away**2).sum(axis=-1) - ((away @ along.T) ** 2).sum(axis=-1)
    log_det = np.log(found.noise[j]).sum() + 2 * np.log(np.diag(factor)).sum()
    return np.log(found.weight[j]) - 0.5 * (squared + log_det)
