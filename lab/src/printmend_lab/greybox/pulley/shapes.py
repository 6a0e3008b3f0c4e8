"""Random pulleys to learn a prior from: what printed, bored, worn and bruised pulleys look like.

A shape is a pulley's position error as a Fourier series, with lengths in radii of a sound pulley: a vector [1 + 2K] of
the mean radius less 1, then c_k/k for the cosines and for the sines of h = r + Σ c_k (k = 1…K). So all entries have the
size that they have in a print. The kinds are the twin's families, the convex hulls of equal and of unequal discs, and
outlines of arcs and flats with equal sides: most of what a lathe, a file or a 3-D printer makes. The authors' hulls
(family ``published``) are kept for the test, and none is drawn.
"""

from collections.abc import Callable

import numpy as np

from printmend.units import TURN_RAD, radius_mm
from printmend_lab.sampling import sample

HARMONICS = 32  # harmonics of a turn that a shape is known by
ANGLES = 720  # angles at which a shape is looked at: a multiple of every symmetry below
_PHI = np.linspace(0.0, TURN_RAD, ANGLES, endpoint=False)
_R0_MM = radius_mm(40.0)


def series(heights: np.ndarray) -> np.ndarray:
    """Return the shapes [N, 1 + 2K] of support functions [N, ANGLES] at equal angles, radius 1 being a sound one."""
    spectrum = np.fft.rfft(heights, axis=-1)[..., : HARMONICS + 1] / ANGLES
    k = np.arange(1, HARMONICS + 1)
    waves = 2 * spectrum[..., 1:] / k
    return np.concatenate([spectrum[..., :1].real - 1, waves.real, -waves.imag], axis=-1)


def turned(shapes: np.ndarray, angle_rad: np.ndarray) -> np.ndarray:
    """Return shapes [..., D] turned by angles [...]: h(φ − angle)."""
    k = np.arange(1, HARMONICS + 1)
    c, s = np.cos(np.multiply.outer(angle_rad, k)), np.sin(np.multiply.outer(angle_rad, k))
    a, b = shapes[..., 1 : HARMONICS + 1], shapes[..., HARMONICS + 1 :]
    radius = np.broadcast_to(shapes[..., :1], (*np.broadcast_shapes(a.shape, c.shape)[:-1], 1))
    return np.concatenate([radius, a * c - b * s, a * s + b * c], axis=-1)


def kinds() -> tuple[str, ...]:
    """Return the names that `draw` takes."""
    return tuple(_KINDS)


def draw(kind: str, count: int, rng: np.random.Generator) -> np.ndarray:
    """Draw shapes [count, 1 + 2K] of a kind, turned and mirrored at random, the mean radius near 1."""
    heights = np.stack([_KINDS[kind](rng) for _ in range(count)])
    heights = np.stack([np.roll(row, int(rng.integers(ANGLES))) for row in heights])
    mirrored = rng.random(count) < 0.5
    heights[mirrored] = heights[mirrored][:, (-np.arange(ANGLES)) % ANGLES]
    return series(heights)


def _of_twin(family: str) -> Callable[[np.random.Generator], np.ndarray]:
    def heights(rng: np.random.Generator) -> np.ndarray:
        drive = sample(family, rng).drives[0]
        assert drive.pulley is not None
        return drive.pulley.support_mm(_PHI, _R0_MM) / _R0_MM

    return heights


def _discs(centres: np.ndarray, radii: np.ndarray) -> np.ndarray:
    """Return h [ANGLES] of the convex hull of discs, max p·n + ρ, with centres p [M, 2] and radii ρ [M]."""
    return (centres @ np.stack([np.cos(_PHI), np.sin(_PHI)]) + radii[:, None]).max(axis=0)


def _rounded(corners: int) -> Callable[[np.random.Generator], np.ndarray]:
    """Return a drawer of regular polygons with more or less round corners, the hulls of equal discs."""

    def heights(rng: np.random.Generator) -> np.ndarray:
        angle, share = TURN_RAD * np.arange(corners) / corners, rng.uniform(0.1, 1.0)
        centres = share * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        heights = _discs(centres, np.full(corners, 1.0 - share))
        return heights / heights.mean()

    return heights


def _arcs(fold: int) -> Callable[[np.random.Generator], np.ndarray]:
    """Return a drawer of outlines of arcs, corners and flats with ``fold`` equal, mirror-symmetric sides.

    The radius of curvature R = h + h″ ≥ 0 is piecewise constant, and a flat is a peak of it (physics.md eq. 3); the
    Fourier coefficients follow as h_k = R_k/(1 − k²).
    """
    k = np.arange(HARMONICS * 4 + 1)
    inverse = np.where(k == 1, 0.0, 1.0 / np.where(k == 1, 1.0, 1.0 - k.astype(float) ** 2))

    def heights(rng: np.random.Generator) -> np.ndarray:
        side = np.pi / fold  # from the middle of a side to the corner between two
        away = np.abs((_PHI + side) % (2 * side) - side)
        for _ in range(200):
            breaks = np.sort(rng.uniform(0.0, 1.0, int(rng.integers(0, 3)))) * side
            levels = rng.choice([0.0, 1.0, 2.0], len(breaks) + 1) * rng.uniform(0.2, 1.5, len(breaks) + 1)
            radius = levels[np.searchsorted(breaks, away)]
            if rng.random() < 0.7:
                radius[away < 1.5 * TURN_RAD / ANGLES] += rng.uniform(0.0, 1.5) * side * ANGLES / TURN_RAD
            spectrum = np.fft.rfft(radius)[: len(k)]
            # one side alone must also close: R has no first harmonic
            closed = fold > 1 or abs(spectrum[1]) < 0.02 * abs(spectrum[0])
            if closed and spectrum[0].real > 0:
                h = np.fft.irfft(np.pad(spectrum * inverse, (0, ANGLES // 2 + 1 - len(k))), ANGLES)
                if h.min() > 0.3 * h.mean():
                    return h / h.mean()
        return np.ones(ANGLES)

    return heights


def _egg(rng: np.random.Generator) -> np.ndarray:
    """Draw the hull of a large disc about the shaft, or near it, and a small disc beside it."""
    small, apart, shaft = rng.uniform(0.2, 0.95), rng.uniform(0.2, 1.2), rng.uniform(-0.1, 0.5)
    centres = np.array([[-shaft * apart, 0.0], [(1 - shaft) * apart, 0.0]])
    heights = _discs(centres, np.array([1.0, small]))
    return heights / heights.mean()


def _uneven(rng: np.random.Generator) -> np.ndarray:
    """Draw the hull of three to six unequal discs at uneven angles."""
    count = int(rng.integers(3, 7))
    angle = TURN_RAD * (np.arange(count) + rng.uniform(-0.2, 0.2, count)) / count
    away, radii = rng.uniform(0.3, 1.0, count), rng.uniform(0.1, 0.5, count)
    heights = _discs(away[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1), radii)
    return heights / heights.mean()


_KINDS: dict[str, Callable[[np.random.Generator], np.ndarray]] = {
    "round": lambda rng: np.ones(ANGLES),
    **{family: _of_twin(family) for family in ("ellipse", "polygon", "flat", "fourier", "tabulated")},
    **{f"rounded-{n}": _rounded(n) for n in (2, 3, 4, 5, 6)},
    **{f"arcs-{n}": _arcs(n) for n in (2, 3, 4, 5, 6, 8)},
    "egg": _egg,
    "uneven": _uneven,
}
