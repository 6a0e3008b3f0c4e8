"""Outlines of pulleys with few parameters, and the belt that they unwind: physics.md eq. 4.

Lengths are in radii of a sound pulley. At the motor's angle θ a belt has unwound U(θ) = ∫ h(−t) dt (eq. 1). An outline
gives U and its derivatives exactly, so that a print without noise settles its parameters to the last digit, and with
them the part of the pulley that was not seen. Parameters are a vector q [P] with the prior mean ``centre`` and the
prior standard deviation ``spread``.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from printmend.units import TURN_RAD, radius_mm
from printmend_lab.greybox.pulley import kernels
from printmend_lab.sampling import sample

# Lengths are in radii of a sound pulley; pairs are a prior mean and its standard deviation.
ELLIPSE_ANGLES = 512  # samples of an ellipse's h: its series ends far below their Nyquist limit
HULL_ANGLES = 1024  # angles at which a hull is looked at: a corner seen by none of them is lost
ANY_ANGLE_SD_RAD = 1.8  # standard deviation of an angle of which nothing is known: 2π/√12
SIZE_SD = 0.25  # of an outline's size
BORE_SD = 0.15  # of the shaft hole's place, each way
HALF_FLAT_RAD = (0.5, 0.25)  # half the angle of a flat
CORNER_RADII = (1.1, 0.1)  # distance of a polygon's corners
DISC_RADII = (0.6, 0.5)  # radius of a rounded polygon's discs, distance of their centres: the prior means of both
_GRID = np.linspace(0.0, TURN_RAD, ELLIPSE_ANGLES, endpoint=False)
_HULL_PHI = TURN_RAD / HULL_ANGLES * np.arange(HULL_ANGLES)
_HULL_WAVES = np.stack([np.ones(HULL_ANGLES), np.cos(_HULL_PHI), -np.sin(_HULL_PHI)])


class Outline(Protocol):
    """A family of outlines."""

    @property
    def kind(self) -> str: ...

    @property
    def centre(self) -> np.ndarray:
        """The prior mean of the parameters [P]; NaN for an angle, of which nothing is known."""
        ...

    @property
    def spread(self) -> np.ndarray:
        """The prior standard deviations [P] of the parameters."""
        ...

    def heights(self, q: np.ndarray, phi_rad: np.ndarray) -> np.ndarray:
        """Return h [N] at angles [N]."""
        ...

    def unwound(self, q: np.ndarray, angle_rad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return U − θ [N], but for a constant, at the motor's angles θ [N], and its derivatives [N, P]."""
        ...

    def starts(self) -> np.ndarray:
        """Return first guesses [S, P], one of which is near the truth."""
        ...


@dataclass(frozen=True, eq=False)
class SeriesOutline:
    """A Fourier series: h = 1 + q₀ + Σ k (A_k cos kφ + B_k sin kφ) over the ``harmonics`` k, with q = (q₀, A, B)."""

    kind: str
    harmonics: np.ndarray
    spread: np.ndarray

    @property
    def centre(self) -> np.ndarray:
        return np.zeros(len(self.spread))

    def heights(self, q: np.ndarray, phi_rad: np.ndarray) -> np.ndarray:
        k, count = self.harmonics, len(self.harmonics)
        wave = np.multiply.outer(phi_rad, k)
        return 1 + q[0] + np.cos(wave) @ (k * q[1 : 1 + count]) + np.sin(wave) @ (k * q[1 + count :])

    def unwound(self, q: np.ndarray, angle_rad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        wave = np.multiply.outer(angle_rad, self.harmonics)
        columns = np.concatenate([angle_rad[:, None], np.sin(wave), np.cos(wave)], axis=1)
        return columns @ q, columns

    def starts(self) -> np.ndarray:
        return np.zeros((1, len(self.spread)))


def cut_series(harmonics: int) -> SeriesOutline:
    """Return the series of the first ``harmonics``, of the sizes that a convex hull allows (physics.md eq. 3)."""
    k = np.arange(1, harmonics + 1)
    wave = np.minimum(0.3, 2.0 / np.maximum(k**2 - 1, 1)) / k / 2
    return SeriesOutline(f"fourier-{harmonics}", k, np.concatenate([[SIZE_SD], wave, wave]))


@dataclass(frozen=True)
class EllipseOutline:
    """An ellipse: h = √(a² cos² + b² sin²) about φ₀; q = (a, b, φ₀), and the bore's (x, y) where ``bored``."""

    bored: bool

    @property
    def kind(self) -> str:
        return "bored ellipse" if self.bored else "ellipse"

    @property
    def centre(self) -> np.ndarray:
        return np.array([1.0, 1.0, np.nan, 0.0, 0.0][: 5 if self.bored else 3])

    @property
    def spread(self) -> np.ndarray:
        return np.array([SIZE_SD, SIZE_SD, ANY_ANGLE_SD_RAD, BORE_SD, BORE_SD][: 5 if self.bored else 3])

    def heights(self, q: np.ndarray, phi_rad: np.ndarray) -> np.ndarray:
        a, b, turn = q[:3]
        return np.hypot(a * np.cos(phi_rad - turn), b * np.sin(phi_rad - turn)) + _bore_heights(q[3:], phi_rad)

    def unwound(self, q: np.ndarray, angle_rad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        a, b, turn = q[:3]
        c, s = np.cos(_GRID), np.sin(_GRID)
        h = np.hypot(a * c, b * s)
        # h and its derivatives have even harmonics only; U = −∫ h dφ from 0 to −θ
        rows = np.stack([h, a * c**2 / h, b * s**2 / h])
        spectrum = np.fft.rfft(rows)[:, : ELLIPSE_ANGLES // 4 : 2] / ELLIPSE_ANGLES
        last = max(4, int((np.abs(spectrum[0]) > 1e-14).sum()))
        k = np.arange(2, 2 * last, 2)
        wave = np.multiply.outer(-angle_rad - turn, k)
        cosines = (2 * spectrum[:, 1:last].real / k).T
        moved = np.outer(angle_rad + turn, spectrum[:, 0].real) - np.sin(wave) @ cosines
        # Turning the outline by δ adds ∫ h over δ to U: its derivative is h at the span, up to a constant.
        turned = np.hypot(a * np.cos(angle_rad + turn), b * np.sin(angle_rad + turn))
        value, derivatives = moved[:, 0] - angle_rad, np.column_stack([moved[:, 1:], turned])
        return _with_bore(value, derivatives, q[3:], angle_rad)

    def starts(self) -> np.ndarray:
        return np.array(
            [[1 + c, 1 - c, turn, 0, 0][: len(self.spread)] for turn in np.pi * np.arange(8) / 8 for c in (0.05, 0.2)]
        )


@dataclass(frozen=True)
class FlatOutline:
    """A disc of radius r with a flat of angle 2β at φ₀ (physics.md eq. 4); q = (r, φ₀, β), and the bore's (x, y)."""

    bored: bool

    @property
    def kind(self) -> str:
        return "bored flat" if self.bored else "flat"

    @property
    def centre(self) -> np.ndarray:
        return np.array([1.0, np.nan, HALF_FLAT_RAD[0], 0.0, 0.0][: 5 if self.bored else 3])

    @property
    def spread(self) -> np.ndarray:
        return np.array([SIZE_SD, ANY_ANGLE_SD_RAD, HALF_FLAT_RAD[1], BORE_SD, BORE_SD][: 5 if self.bored else 3])

    def heights(self, q: np.ndarray, phi_rad: np.ndarray) -> np.ndarray:
        r, turn, half = q[:3]
        away = np.abs(np.mod(phi_rad - turn + np.pi, TURN_RAD) - np.pi)
        return r * np.where(away < half, np.cos(half - away), 1.0) + _bore_heights(q[3:], phi_rad)

    def unwound(self, q: np.ndarray, angle_rad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        r, turn, half = q[0], q[1], min(max(q[2], 1e-3), 1.5)
        low, high = turn - half, turn + half
        discs = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(low), np.sin(low)], [0.0, np.cos(high), np.sin(high)]])
        slopes = np.zeros((3, 3, 3))
        slopes[:, :, 0] = discs
        for i, corner, spread in ((1, low, -r), (2, high, r)):
            tangent = np.array([0.0, -np.sin(corner), np.cos(corner)])
            slopes[i, :, 1], slopes[i, :, 2] = r * tangent, spread * tangent
        # in t = −φ the flat's corners come in the other order
        edges, which = np.array([-high, -turn, -low, -high + TURN_RAD]), np.array([2, 1, 0])
        value, derivatives = _unwound(edges, which, r * discs, slopes, angle_rad)
        return _with_bore(value, derivatives, q[3:], angle_rad)

    def starts(self) -> np.ndarray:
        turn = TURN_RAD * np.arange(24) / 24
        return np.array([[1.0, a, half, 0.0, 0.0][: len(self.spread)] for a in turn for half in (0.35, 0.65)])


@dataclass(frozen=True)
class PolygonOutline:
    """A polygon with corners at equal angles: h = max r_i cos(φ − φ₀ − 2πi/n), with q = (φ₀, r₁ … r_n)."""

    corners: int

    @property
    def kind(self) -> str:
        return f"polygon-{self.corners}"

    @property
    def centre(self) -> np.ndarray:
        return np.append(np.nan, np.full(self.corners, CORNER_RADII[0]))

    @property
    def spread(self) -> np.ndarray:
        return np.append(ANY_ANGLE_SD_RAD, np.full(self.corners, CORNER_RADII[1]))

    def heights(self, q: np.ndarray, phi_rad: np.ndarray) -> np.ndarray:
        return (self._discs(q)[0] @ _waves(phi_rad)).max(axis=0)

    def unwound(self, q: np.ndarray, angle_rad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return _hull_unwound(*self._discs(q), angle_rad)

    def starts(self) -> np.ndarray:
        count = max(3, 36 // self.corners)
        turn = TURN_RAD / self.corners * np.arange(count) / count
        return np.column_stack([turn, np.full((count, self.corners), CORNER_RADII[0])])

    def _discs(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        towards, across = _spokes(self.corners, q[0])
        discs = q[1:, None] * towards
        return discs, np.concatenate(
            [(q[1:, None] * across)[:, :, None], towards[:, :, None] * np.eye(self.corners)[:, None]], axis=2
        )


@dataclass(frozen=True)
class RoundedOutline:
    """The hull of equal discs at equal angles: h = ρ + R max cos(φ − φ₀ − 2πi/n), with q = (ρ, R, φ₀)."""

    corners: int

    @property
    def kind(self) -> str:
        return f"rounded-{self.corners}"

    @property
    def centre(self) -> np.ndarray:
        return np.array([*DISC_RADII, np.nan])

    @property
    def spread(self) -> np.ndarray:
        return np.array([SIZE_SD, SIZE_SD, ANY_ANGLE_SD_RAD])

    def heights(self, q: np.ndarray, phi_rad: np.ndarray) -> np.ndarray:
        return (self._discs(q)[0] @ _waves(phi_rad)).max(axis=0)

    def unwound(self, q: np.ndarray, angle_rad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return _hull_unwound(*self._discs(q), angle_rad)

    def starts(self) -> np.ndarray:
        count = max(4, 24 // self.corners)
        return np.array([[*DISC_RADII, TURN_RAD / self.corners * i / count] for i in range(count)])

    def _discs(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        towards, across = _spokes(self.corners, q[2])
        discs = q[1] * towards + [q[0], 0.0, 0.0]
        disc = np.tile([1.0, 0.0, 0.0], (self.corners, 1))
        return discs, np.stack([disc, towards, q[1] * across], axis=2)


@dataclass(frozen=True)
class EggOutline:
    """The hull of two discs anywhere: q = (ρ₁, x₁, y₁, ρ₂, x₂, y₂)."""

    kind: str = "egg"

    @property
    def centre(self) -> np.ndarray:
        return np.array([0.8, 0.0, 0.0] * 2)

    @property
    def spread(self) -> np.ndarray:
        return np.array([0.4, 0.4, 0.4] * 2)

    def heights(self, q: np.ndarray, phi_rad: np.ndarray) -> np.ndarray:
        return (q.reshape(2, 3) @ _waves(phi_rad)).max(axis=0)

    def unwound(self, q: np.ndarray, angle_rad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return _hull_unwound(q.reshape(2, 3), np.eye(6).reshape(2, 3, 6), angle_rad)

    def starts(self) -> np.ndarray:
        turns = TURN_RAD * np.arange(16) / 16
        small = [(0.9, 0.5, 0.7), (0.6, 0.6, 0.6)]
        return np.array(
            [[big, 0.1 - away * np.cos(a), -away * np.sin(a), little, away * np.cos(a), away * np.sin(a)]
             for a in turns for big, little, away in small]
        )  # fmt: skip


def _spokes(count: int, turn: float) -> tuple[np.ndarray, np.ndarray]:
    """Return (0, cos, sin) [M, 3] of equal angles, and their derivatives by the first one."""
    at = turn + TURN_RAD * np.arange(count) / count
    return np.stack([0 * at, np.cos(at), np.sin(at)], axis=1), np.stack([0 * at, -np.sin(at), np.cos(at)], axis=1)


def _hull_unwound(discs: np.ndarray, slopes: np.ndarray, angle_rad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return U − θ [N] and its derivatives [N, P] for a hull of discs [M, 3] (ρ, x, y), which have the derivatives
    ``slopes`` [M, 3, P]: h = max ρ_i + x_i cos φ + y_i sin φ."""
    edges, which = np.empty(HULL_ANGLES + 1), np.zeros(HULL_ANGLES, np.int64)
    count = kernels.hull_edges(discs, _HULL_WAVES, edges, which)
    if count == 0:
        edges[0], count = 0.0, 1
    edges[count] = edges[0] + TURN_RAD
    return _unwound(edges[: count + 1], which[:count], discs, slopes, angle_rad)


def _unwound(
    edges: np.ndarray, which: np.ndarray, discs: np.ndarray, slopes: np.ndarray, angle_rad: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the same, given the disc ``which`` [E] that is touched between ``edges`` [E + 1], a whole turn of t = −φ.

    Where two discs meet they are equally high, so that an edge may move without changing any integral of h.
    """
    value, derivatives = np.empty(len(angle_rad)), np.empty((len(angle_rad), slopes.shape[2]))
    kernels.unwind(edges, which, discs, slopes, angle_rad, value, derivatives)
    return value, derivatives


def _with_bore(
    value: np.ndarray, derivatives: np.ndarray, bore: np.ndarray, angle_rad: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    if not len(bore):
        return value, derivatives
    waves = np.column_stack([np.sin(angle_rad), np.cos(angle_rad)])
    return value + waves @ bore, np.concatenate([derivatives, waves], axis=1)


def _bore_heights(bore: np.ndarray, phi_rad: np.ndarray) -> np.ndarray:
    return bore @ np.stack([np.cos(phi_rad), np.sin(phi_rad)]) if len(bore) else np.zeros(np.shape(phi_rad))


def _waves(phi_rad: np.ndarray) -> np.ndarray:
    return np.stack([np.ones_like(phi_rad), np.cos(phi_rad), np.sin(phi_rad)])


ROUND: tuple[Outline, ...] = (cut_series(0), cut_series(1))
OUTLINES: tuple[Outline, ...] = (
    *ROUND,
    *(cut_series(k) for k in range(2, 9)),
    *(shape(bored) for shape in (EllipseOutline, FlatOutline) for bored in (False, True)),
    *(PolygonOutline(n) for n in range(3, 9)),
    *(RoundedOutline(n) for n in range(2, 7)),
    EggOutline(),
)


def _any_pulley(fold: int, size: float) -> SeriesOutline:
    """Return a series of 32 harmonics of usual sizes (physics.md eq. 18), which fits any pulley.

    With a ``fold`` above 1 its multiples have these sizes, with 1 the eccentricity alone, and the others 3 % of them.
    """
    k = np.arange(1, 33)
    on = k % fold == 0 if fold > 1 else k == 1
    wave = 0.126 * size * k**-2.5 * np.where(on | (fold == 0), 1.0, 0.03)
    return SeriesOutline(f"plain-{fold}", k, np.concatenate([[SIZE_SD], wave, wave]))


ANY_PULLEY: tuple[SeriesOutline, ...] = tuple(_any_pulley(fold, size) for fold in range(9) for size in (4.0, 1.0, 0.3))

# Random pulleys to learn a prior from: what printed, bored, worn and bruised pulleys look like.
#
# A shape is a pulley's position error as a Fourier series, with lengths in radii of a sound pulley: a vector [1 + 2K]
# of the mean radius less 1, then c_k/k for the cosines and for the sines of h = r + Σ c_k (k = 1…K). So all entries
# have the size that they have in a print. The kinds are the twin's families, the convex hulls of equal and of unequal
# discs, and outlines of arcs and flats with equal sides: most of what a lathe, a file or a 3-D printer makes. The
# authors' hulls (family ``published``) are kept for the test, and none is drawn.

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
