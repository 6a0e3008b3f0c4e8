"""Faults between the motor and the carriage: pulley, set screw, ripple, belts, play, stretch, friction, jumps.

Also errors without a period, such as a belt's uneven pitch, and the gains of the paper's published simulator.

The closed loop of a belt leaves its pulley in two opposite spans that move by U1(θ) = ∫h(−t) dt and
U2(θ) = ∫h(π − t) dt. Each belt turns them into the pair (lower, upper) of a `Transmission`.
"""

import math
import tomllib
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import ClassVar, NamedTuple, NoReturn, Protocol

import numpy as np

from printmend.errors import ConfigError
from printmend.messages import say
from printmend.printer import Axis

# Check corruption values once, when they are built.


def refuse(value: object, wanted: str, came: str) -> NoReturn:
    """Raise a `ConfigError` that names the corruption's kind."""
    kind = getattr(value, "kind", type(value).__name__)
    raise ConfigError(say("subject-corruption", repr(kind)), wanted=wanted, came=came, todo=say("correct-value"))


def in_range(value: object, **limits: tuple[float, float]) -> None:
    """Check that the named fields are finite numbers (or tuples of them) within their limits; None passes."""
    for name, (low, high) in limits.items():
        field = getattr(value, name)
        if isinstance(field, list | tuple):
            object.__setattr__(value, name, tuple(field))
            items = tuple(field)
        else:
            items = () if field is None else (field,)
        for item in items:
            number = isinstance(item, int | float) and not isinstance(item, bool)
            if not number or not low <= item <= high or not math.isfinite(item):
                refuse(value, say("within", name, f"{low:g}", f"{high:g}"), repr(item))


def whole_in_range(value: object, **limits: tuple[int, int]) -> None:
    """Check that the named fields are whole numbers within their limits."""
    for name, (low, high) in limits.items():
        field = getattr(value, name)
        if not isinstance(field, int) or isinstance(field, bool) or not low <= field <= high:
            refuse(value, say("whole-number-from", name, low, high), repr(field))


# Deformed timing pulleys as support functions.
#
# A belt touches only the convex hull of a pulley. h(φ) = max over hull points p of p·(cos φ, sin φ) is the hull's
# support function about the shaft, and a taut span moves by dx/dθ = h(−θ) (physics.md eq. 1; the outward normal of the
# span is the origin of φ). Each pulley gives h [mm] at angles φ [rad]; ``radius_mm`` is that of the healthy one.


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


@dataclass(frozen=True)
class GainTable:
    """One row of the published ``all_data``: entry p − 1 is the gain of a step at nominal position p.

    The same in both directions and not conservative (physics.md §8.1).
    """

    gains: tuple[float, ...]
    kind: ClassVar[str] = "gain-table"

    def __post_init__(self) -> None:
        in_range(self, gains=(-100.0, 100.0))
        if not 2 <= len(self.gains) <= 100_000:
            refuse(self, say("2-100-000-gains-published-tables"), f"{len(self.gains)}")


@dataclass(frozen=True)
class Warp:
    """The carriage is off by e(m) = Σ_i ``bumps_mm[i]`` · exp(−(m − c_i)²/2w²), c_i = ``first_mm`` + i·w, at place m.

    w = ``spacing_mm``. The error is smooth, has no period, and is the same in both directions. The slope of e must stay
    above −0.9, so that the carriage does not run backwards.
    """

    bumps_mm: tuple[float, ...]
    spacing_mm: float
    first_mm: float = 0.0
    kind: ClassVar[str] = "warp"

    def __post_init__(self) -> None:
        in_range(self, bumps_mm=(-100.0, 100.0), spacing_mm=(1.0, 10_000.0), first_mm=(-10_000.0, 10_000.0))
        if not 1 <= len(self.bumps_mm) <= 10_000:
            refuse(self, say("1-10-000-bumps"), f"{len(self.bumps_mm)}")
        low_mm, high_mm = (
            self.first_mm - 4 * self.spacing_mm,
            self.first_mm + (len(self.bumps_mm) + 3) * self.spacing_mm,
        )
        places = np.linspace(low_mm, high_mm, 20 * (len(self.bumps_mm) + 7) + 1)
        steepest = float(np.gradient(self.error_mm(places), places).min())
        if steepest < -0.9:
            refuse(self, say("bumps-slopes-above-0-9-everywhere"), f"{steepest:.2f}")

    def error_mm(self, motor_mm: np.ndarray) -> np.ndarray:
        """Return e [mm] at nominal places [N] mm."""
        error = np.zeros(np.shape(motor_mm))
        for i, bump in enumerate(self.bumps_mm):
            away = (motor_mm - self.first_mm) / self.spacing_mm - i
            near = np.abs(away) < 8  # exp(−32) is below 1e-13
            error[near] += bump * np.exp(-(away[near] ** 2) / 2)
        return error


@dataclass(frozen=True)
class SetScrew:
    """Rotational slack β of the pulley on its shaft: play before the map (physics.md eq. 10).

    Because the pulley's map is monotone, it equals lower(θ − β/2) and upper(θ + β/2).
    """

    slack_rad: float
    kind: ClassVar[str] = "set-screw"

    def __post_init__(self) -> None:
        in_range(self, slack_rad=(0.0, math.pi))


@dataclass(frozen=True)
class Ripple:
    """Micro-step ripple: the rotor leads or lags by Σ a_i sin(2π s/p_i + φ_i) full steps at step s (eq. 16).

    The usual periods are 4, 2 and 1 full steps.
    """

    amplitude_steps: tuple[float, ...]
    period_steps: tuple[float, ...]
    phase_rad: tuple[float, ...]
    kind: ClassVar[str] = "ripple"

    def __post_init__(self) -> None:
        in_range(self, amplitude_steps=(0.0, 2.0), period_steps=(0.1, 1000.0), phase_rad=(-1e3, 1e3))
        if not len(self.amplitude_steps) == len(self.period_steps) == len(self.phase_rad):
            refuse(self, say("many-amplitudes-periods-phases"), say("lists-different-lengths"))
        slope = sum(a * 2 * math.pi / p for a, p in zip(self.amplitude_steps, self.period_steps, strict=True))
        if slope > 1:
            refuse(self, say("ripple-never-turns-motor-back-2"), f"{slope:.2f}")

    def lead_steps(self, steps: np.ndarray) -> np.ndarray:
        """Return by how many full steps the rotor leads at commanded positions [full steps]."""
        lead = np.zeros(np.shape(steps))
        for a, p, phi in zip(self.amplitude_steps, self.period_steps, self.phase_rad, strict=True):
            lead += a * np.sin(2 * np.pi * steps / p + phi)
        return lead


class Belt(Protocol):
    """A belt: spans in, branches of play out."""

    kind: ClassVar[str]

    def branches_mm(
        self, motor_mm: np.ndarray, span1_mm: np.ndarray, span2_mm: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return (lower, upper) [mm] over the motor positions [N]."""
        ...


@dataclass(frozen=True)
class LooseBelt:
    """Both spans slack: u ← min(max(u, U1 − s1), U2 + s2) (physics.md eq. 7).

    Odd harmonics of the pulley modulate the play: it is U2 − U1 + s1 + s2, which must stay ≥ 0 over a turn.
    """

    slack1_mm: float
    slack2_mm: float
    kind: ClassVar[str] = "loose"

    def __post_init__(self) -> None:
        in_range(self, slack1_mm=(0.0, 1000.0), slack2_mm=(0.0, 1000.0))

    def branches_mm(
        self, motor_mm: np.ndarray, span1_mm: np.ndarray, span2_mm: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        lower, upper = span1_mm - self.slack1_mm, span2_mm + self.slack2_mm
        tightest = (upper - lower).min()
        if tightest < -1e-9:
            refuse(
                self,
                say("slack1-mm-slack2-mm-least-pulley", f"{self.slack1_mm + self.slack2_mm - tightest:.3f}"),
                say("negative-play-mm", f"{self.slack1_mm + self.slack2_mm:.3f}", f"{tightest:.3f}"),
            )
        return lower, np.maximum(lower, upper)


@dataclass(frozen=True)
class Play:
    """Ordinary backlash of constant width b: lower = U1 − b/2, upper = U1 + b/2."""

    play_mm: float
    kind: ClassVar[str] = "play"

    def __post_init__(self) -> None:
        in_range(self, play_mm=(0.0, 1000.0))

    def branches_mm(
        self, motor_mm: np.ndarray, span1_mm: np.ndarray, span2_mm: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        return span1_mm - self.play_mm / 2, span1_mm + self.play_mm / 2


@dataclass(frozen=True)
class ElasticBelt:
    """A taut elastic loop: du/dθ = h_even + ((L2 − L1)/(L1 + L2))·h_odd (physics.md eq. 8).

    L1 is the span from the motor, which sits at ``motor_mm``, to the carriage; ``loop_mm`` = L1 + L2. Odd
    harmonics of the pulley fade with the distance from the motor.
    """

    loop_mm: float
    motor_mm: float = -20.0
    kind: ClassVar[str] = "elastic"

    def __post_init__(self) -> None:
        in_range(self, loop_mm=(10.0, 100_000.0), motor_mm=(-10_000.0, 10_000.0))

    def branches_mm(
        self, motor_mm: np.ndarray, span1_mm: np.ndarray, span2_mm: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        # The carriage's distance from the motor is taken at the nominal position: its own error is 1e-3 of the loop.
        middle = (motor_mm[1:] + motor_mm[:-1]) / 2
        length1 = np.clip(np.abs(middle - self.motor_mm), 0.0, self.loop_mm)
        ratio = (self.loop_mm - 2 * length1) / self.loop_mm
        step1, step2 = np.diff(span1_mm), np.diff(span2_mm)
        steps = (step1 + step2) / 2 + ratio * (step1 - step2) / 2
        position = np.concatenate([[0.0], np.cumsum(steps)])
        position += np.interp(0.0, motor_mm, span1_mm) - np.interp(0.0, motor_mm, position)
        return position, position


@dataclass(frozen=True)
class Friction:
    """Lost motion of a stretching belt against friction: B(x) = (2 F/EA)·L1 L2/(L1 + L2) (physics.md eq. 9).

    It grows with the distance from the motor, and widens any play by B/2 on either side.
    """

    force_n: float
    stiffness_n: float
    loop_mm: float
    motor_mm: float = -20.0
    kind: ClassVar[str] = "friction"

    def __post_init__(self) -> None:
        in_range(
            self,
            force_n=(0.0, 1000.0),
            stiffness_n=(1.0, 1e9),
            loop_mm=(10.0, 100_000.0),
            motor_mm=(-10_000.0, 10_000.0),
        )

    def lost_mm(self, motor_mm: np.ndarray) -> np.ndarray:
        """Return B [mm] at nominal carriage positions [mm]."""
        length1 = np.clip(np.abs(motor_mm - self.motor_mm), 0.0, self.loop_mm)
        return 2 * self.force_n / self.stiffness_n * length1 * (self.loop_mm - length1) / self.loop_mm


BELTS: tuple[type, ...] = (LooseBelt, Play, ElasticBelt)

# Sudden faults: the belt skips teeth of its pulley, the motor misses steps (physics.md eq. 11).
#
# Both happen at random places of a motor's travel, drawn from a seed: a Poisson process with ``rate_per_m`` jumps per
# metre of travel in either direction. A jump takes effect at the first tick or way-point that reaches its place. No
# planner can foresee it, so jumps are not part of a `Mechanism`: the twin adds them.


@dataclass(frozen=True)
class ToothSkips:
    """The belt jumps by a tooth: from then on the carriage is ± ``pitch_mm`` from where it was (10 full steps)."""

    rate_per_m: float
    seed: int = 0
    pitch_mm: float = 2.0
    kind: ClassVar[str] = "tooth-skips"

    def __post_init__(self) -> None:
        in_range(self, rate_per_m=(0.0, 1000.0), pitch_mm=(0.1, 20.0))
        whole_in_range(self, seed=(0, 2**63 - 1))

    def signs(self, travel_mm: np.ndarray) -> np.ndarray:
        """Return the sum of the signs of the jumps at each entry [N] of cumulative travel [N + 1, from 0] mm."""
        return _signs(self.rate_per_m, (self.seed, 0), travel_mm)


@dataclass(frozen=True)
class MissedSteps:
    """The motor falls behind or runs ahead by ``steps`` full steps (4, one electrical turn): its angle is lost."""

    rate_per_m: float
    seed: int = 0
    steps: int = 4
    kind: ClassVar[str] = "missed-steps"

    def __post_init__(self) -> None:
        in_range(self, rate_per_m=(0.0, 1000.0))
        whole_in_range(self, seed=(0, 2**63 - 1), steps=(1, 1000))

    def signs(self, travel_mm: np.ndarray) -> np.ndarray:
        """As `ToothSkips.signs`."""
        return _signs(self.rate_per_m, (self.seed, 1), travel_mm)


class Jumps(NamedTuple):
    """The jumps of one motor's drive."""

    skips: ToothSkips | None = None
    missed: MissedSteps | None = None

    def along(self, motor_mm: np.ndarray, axis: Axis) -> tuple[np.ndarray, np.ndarray]:
        """Return the offsets [N + 1] mm of the motor and of the belt along a motor's commanded path [N + 1] mm.

        The motor runs straight between the path's way-points; the sum of these moves is the travel.
        """
        travel_mm = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(motor_mm)))])
        motor, belt = np.zeros(len(motor_mm)), np.zeros(len(motor_mm))
        if self.missed is not None:
            motor[1:] = np.cumsum(self.missed.signs(travel_mm)) * (self.missed.steps * axis.mm_per_step)
        if self.skips is not None:
            belt[1:] = np.cumsum(self.skips.signs(travel_mm)) * self.skips.pitch_mm
        return motor, belt


def places_mm(rate_per_m: float, seed: tuple[int, int], travel_mm: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the places [E] mm of the jumps within a travel, and their signs [E]; a longer travel only adds jumps."""
    if rate_per_m <= 0 or travel_mm <= 0:
        return np.empty(0), np.empty(0)
    gaps, signs = np.random.default_rng((*seed, 0)), np.random.default_rng((*seed, 1))
    places = np.empty(0)
    while len(places) == 0 or places[-1] <= travel_mm:
        more = np.cumsum(gaps.exponential(1000.0 / rate_per_m, 64)) + (places[-1] if len(places) else 0.0)
        places = np.concatenate([places, more])
    return places[places <= travel_mm], signs.choice([-1.0, 1.0], len(places))[places <= travel_mm]


def _signs(rate_per_m: float, seed: tuple[int, int], travel_mm: np.ndarray) -> np.ndarray:
    places, signs = places_mm(rate_per_m, seed, float(travel_mm[-1]))
    sums = np.zeros(len(travel_mm) - 1)
    np.add.at(sums, np.searchsorted(travel_mm[1:], places, side="left"), signs)
    return sums
