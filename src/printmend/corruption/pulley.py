"""Deformed timing pulleys as support functions.

A belt touches only the convex hull of a pulley. h(φ) = max over hull points p of p·(cos φ, sin φ) is the hull's
support function about the shaft, and a taut span moves by dx/dθ = h(−θ) (physics.md eq. 1; the outward normal of
the span is the origin of φ). Each pulley gives h [mm] at angles φ [rad]; ``radius_mm`` is that of the healthy one.
"""

import math
import tomllib
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import ClassVar, Protocol

import numpy as np

from printmend.corruption.check import in_range, refuse
from printmend.messages import say


class Pulley(Protocol):
    """A pulley's outline, seen by its belt."""

    kind: ClassVar[str]

    def support_mm(self, phi_rad: np.ndarray, radius_mm: float) -> np.ndarray:
        """Return h(φ) [mm], positive, 2π-periodic."""
        ...


@dataclass(frozen=True)
class WrongRadius:
    """A round pulley of another size: h constant, a scale error."""

    radius_mm: float
    kind: ClassVar[str] = "radius"

    def __post_init__(self) -> None:
        in_range(self, radius_mm=(0.1, 1000.0))

    def support_mm(self, phi_rad: np.ndarray, radius_mm: float) -> np.ndarray:
        return np.full(np.shape(phi_rad), self.radius_mm)


@dataclass(frozen=True)
class EccentricBore:
    """A round pulley on a shaft hole off its centre: h = r + e cos(φ − φe)."""

    eccentricity_mm: float
    phase_rad: float = 0.0
    radius_mm: float | None = None
    kind: ClassVar[str] = "eccentric"

    def __post_init__(self) -> None:
        in_range(self, eccentricity_mm=(0.0, 1000.0), phase_rad=(-1e3, 1e3), radius_mm=(0.1, 1000.0))
        if self.radius_mm is not None and self.eccentricity_mm >= self.radius_mm:
            refuse(self, say("eccentricity-below-radius"), say("mm-3", self.eccentricity_mm, self.radius_mm))

    def support_mm(self, phi_rad: np.ndarray, radius_mm: float) -> np.ndarray:
        radius = radius_mm if self.radius_mm is None else self.radius_mm
        return radius + self.eccentricity_mm * np.cos(phi_rad - self.phase_rad)


@dataclass(frozen=True)
class Ellipse:
    """h = √(a² cos² + b² sin²)."""

    a_mm: float
    b_mm: float
    phase_rad: float = 0.0
    kind: ClassVar[str] = "ellipse"

    def __post_init__(self) -> None:
        in_range(self, a_mm=(0.1, 1000.0), b_mm=(0.1, 1000.0), phase_rad=(-1e3, 1e3))

    def support_mm(self, phi_rad: np.ndarray, radius_mm: float) -> np.ndarray:
        phi = phi_rad - self.phase_rad
        return np.hypot(self.a_mm * np.cos(phi), self.b_mm * np.sin(phi))


@dataclass(frozen=True)
class Polygon:
    """Corners at equal angles with their own radii, three at least: h = max_i r_i cos(φ − φ_i)."""

    radii_mm: tuple[float, ...]
    phase_rad: float = 0.0
    kind: ClassVar[str] = "polygon"

    def __post_init__(self) -> None:
        in_range(self, radii_mm=(0.1, 1000.0), phase_rad=(-1e3, 1e3))
        if len(self.radii_mm) < 3:
            refuse(self, say("least-three-corners"), f"{len(self.radii_mm)}")

    def support_mm(self, phi_rad: np.ndarray, radius_mm: float) -> np.ndarray:
        corners = self.phase_rad + 2 * np.pi * np.arange(len(self.radii_mm)) / len(self.radii_mm)
        distances = [r * np.cos(phi_rad - corner) for r, corner in zip(self.radii_mm, corners, strict=True)]
        return np.max(distances, axis=0)


@dataclass(frozen=True)
class FlatSpot:
    """A round pulley with a flat of depth d: with cos β = (r − d)/r, h = r cos(β − |φ − φ0|) inside ±β, else r."""

    depth_mm: float
    phase_rad: float = 0.0
    radius_mm: float | None = None
    kind: ClassVar[str] = "flat"

    def __post_init__(self) -> None:
        in_range(self, depth_mm=(0.0, 1000.0), phase_rad=(-1e3, 1e3), radius_mm=(0.1, 1000.0))
        if self.radius_mm is not None and self.depth_mm >= self.radius_mm:
            refuse(self, say("flat-shallower-radius"), say("mm-3", self.depth_mm, self.radius_mm))

    def support_mm(self, phi_rad: np.ndarray, radius_mm: float) -> np.ndarray:
        radius = radius_mm if self.radius_mm is None else self.radius_mm
        beta = math.acos(max(-1.0, (radius - self.depth_mm) / radius))
        away = np.abs(np.angle(np.exp(1j * (phi_rad - self.phase_rad))))
        return np.where(away < beta, radius * np.cos(beta - away), radius)


@dataclass(frozen=True)
class FourierHull:
    """h = r + Σ a_k cos kφ + b_k sin kφ for k = 1…K, with h > 0 and convex: h + h″ ≥ 0."""

    radius_mm: float
    cos_mm: tuple[float, ...]
    sin_mm: tuple[float, ...]
    kind: ClassVar[str] = "fourier"

    def __post_init__(self) -> None:
        in_range(self, radius_mm=(0.1, 1000.0), cos_mm=(-1000.0, 1000.0), sin_mm=(-1000.0, 1000.0))
        if len(self.cos_mm) != len(self.sin_mm) or len(self.cos_mm) > 256:
            refuse(self, say("many-cos-mm-sin-mm-256"), say("and", len(self.cos_mm), len(self.sin_mm)))
        phi = np.linspace(0, 2 * np.pi, 4096, endpoint=False)
        if self.support_mm(phi, 1.0).min() <= 0:
            refuse(self, say("hull-around-shaft-h-0"), say("coefficients-leave-shaft-outside"))
        k = np.arange(1, len(self.cos_mm) + 1)
        curvature = self.radius_mm + _series(phi, (1 - k**2) * self.cos_mm, (1 - k**2) * self.sin_mm)
        if curvature.min() < -1e-9 * self.radius_mm:
            refuse(
                self,
                say("convex-hull-h-h-0"),
                say("smallest-radius-curvature-mm", f"{curvature.min():.3g}"),
            )

    def support_mm(self, phi_rad: np.ndarray, radius_mm: float) -> np.ndarray:
        return self.radius_mm + _series(phi_rad, np.array(self.cos_mm), np.array(self.sin_mm))


@dataclass(frozen=True)
class TabulatedHull:
    """h at equal angles from 0, interpolated linearly; convex to the table's resolution."""

    heights_mm: tuple[float, ...]
    kind: ClassVar[str] = "tabulated"

    def __post_init__(self) -> None:
        in_range(self, heights_mm=(1e-6, 1000.0))
        n = len(self.heights_mm)
        if not 16 <= n <= 100_000:
            refuse(self, say("16-100-000-heights"), f"{n}")
        h = np.array(self.heights_mm)
        # Three neighbouring support lines of a convex hull obey h(φ−δ) + h(φ+δ) ≥ 2 cos δ h(φ), exactly.
        excess = np.roll(h, 1) + np.roll(h, -1) - 2 * math.cos(2 * math.pi / n) * h
        if excess.min() < -1e-6 * h.mean():
            refuse(self, say("convex-hull"), say("dent-near", f"{360 * int(excess.argmin()) / n:.0f}"))

    def support_mm(self, phi_rad: np.ndarray, radius_mm: float) -> np.ndarray:
        h = np.array(self.heights_mm)
        at = np.mod(phi_rad, 2 * np.pi) * len(h) / (2 * np.pi)
        return np.interp(at, np.arange(len(h) + 1), np.append(h, h[0]))


@dataclass(frozen=True)
class PublishedHull:
    """A printed pulley of the paper's authors, by name (physics.md eq. 5; Fourier series of their moment arms)."""

    name: str
    phase_rad: float = 0.0
    kind: ClassVar[str] = "published"

    def __post_init__(self) -> None:
        in_range(self, phase_rad=(-1e3, 1e3))
        if self.name not in published_names():
            refuse(self, say("name-out", ", ".join(published_names())), repr(self.name))

    def support_mm(self, phi_rad: np.ndarray, radius_mm: float) -> np.ndarray:
        series = _published()[self.name]
        return series["radius_mm"] + _series(
            phi_rad - self.phase_rad, np.array(series["cos_mm"]), np.array(series["sin_mm"])
        )


PULLEYS: tuple[type, ...] = (
    WrongRadius, EccentricBore, Ellipse, Polygon, FlatSpot, FourierHull, TabulatedHull, PublishedHull,
)  # fmt: skip


def published_names() -> tuple[str, ...]:
    """Return the names of the authors' hulls."""
    return tuple(_published())


@cache
def _published() -> dict:
    text = (resources.files("printmend.corruption") / "published_hulls.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)


def _series(phi_rad: np.ndarray, cos_mm: np.ndarray, sin_mm: np.ndarray) -> np.ndarray:
    total = np.zeros(np.shape(phi_rad))
    for k, (a, b) in enumerate(zip(cos_mm, sin_mm, strict=True), start=1):
        total += a * np.cos(k * phi_rad) + b * np.sin(k * phi_rad)
    return total
