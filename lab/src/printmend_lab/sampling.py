"""Random corruptions by family, in the ranges of physics.md §3, and sessions drawn from the priors.

``realistic`` is what well-kept machines have; ``damaged`` is the paper's scale. ``paper`` is damaged, but for pulleys:
they are of the paper's two kinds, and so wrong that printing as if nothing were costs as much as in its Table I. Every
draw gives both motors a fault of the family, independently. The generator is an argument: equal seeds give equal
corruptions.
"""

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Literal

import numpy as np

from printmend.corruption.cause import Cause
from printmend.corruption.corruption import Corruption, Drive, Fault
from printmend.corruption.event import EVENTS
from printmend.corruption.frame import CrookedFrame, Screw
from printmend.corruption.transmission import (
    EccentricBore,
    ElasticBelt,
    Ellipse,
    FlatSpot,
    FourierHull,
    Friction,
    GainTable,
    LooseBelt,
    MissedSteps,
    Play,
    Polygon,
    PublishedHull,
    Pulley,
    Ripple,
    SetScrew,
    TabulatedHull,
    ToothSkips,
    Warp,
    WrongRadius,
)
from printmend.effects import EFFECTS, Acts, Effect, Of, Scene, Term
from printmend.effects.effect import TINY_MM, drawn_sizes
from printmend.effects.sized import Sized, belts_mm
from printmend.effects.words import PLACES
from printmend.errors import ConfigError
from printmend.infer.fit import FINER_ROUNDS, home_sd_of, turn_of, turned, worn
from printmend.infer.machine import machine_of
from printmend.machine import contacts_of
from printmend.path import Trace
from printmend.plugins import CORRUPTIONS, is_plugin, load_plugin, plugin_names
from printmend.twin.twin import added_mm
from printmend.units import TURN_RAD, radius_mm

Severity = Literal["damaged", "realistic", "paper"]
SEVERITIES: tuple[Severity, ...] = ("damaged", "realistic", "paper")
# The largest pulley of the severity `paper`, in radii: with it Naive's mean RMSE over generated bodies is the paper's
# 27.6 full steps. `tools/fit_paper_severity.py` found it.
PAPER_LARGEST = 1.72
_R0_MM = radius_mm(40.0)
_PHI = np.linspace(0.0, TURN_RAD, 1024, endpoint=False)
_LOOP_MM = 600.0  # length of a printer's belt


def _phase(rng: np.random.Generator) -> float:
    return float(rng.uniform(0, TURN_RAD))


def _pick(
    rng: np.random.Generator, severity: Severity, realistic: tuple[float, float], damaged: tuple[float, float]
) -> float:
    low, high = realistic if severity == "realistic" else damaged
    return float(rng.uniform(low, high))


def _radius(rng: np.random.Generator, severity: Severity) -> Pulley:
    if severity != "realistic":
        largest = PAPER_LARGEST if severity == "paper" else 1.3
        return WrongRadius(_R0_MM * float(rng.uniform(0.6, largest)))
    return WrongRadius(_R0_MM * (1 + float(rng.choice([-1, 1]) * rng.uniform(0.001, 0.003))))


def _eccentric(rng: np.random.Generator, severity: Severity) -> Pulley:
    return EccentricBore(_pick(rng, severity, (0.02, 0.1), (0.3, 1.5)), _phase(rng))


def _ellipse(rng: np.random.Generator, severity: Severity) -> Pulley:
    c2 = _pick(rng, severity, (0.005, 0.05), (0.3, 1.8))
    return Ellipse(_R0_MM + c2, _R0_MM - c2, _phase(rng))


def _polygon(rng: np.random.Generator, severity: Severity) -> Pulley:
    if severity != "realistic":
        corners = int(rng.integers(3, 9))
        return Polygon(tuple(_R0_MM * rng.uniform(0.95, 1.25, corners)), _phase(rng))
    corners = int(rng.integers(24, 41))
    return Polygon(tuple(_R0_MM * rng.uniform(1.0, 1.004, corners)), _phase(rng))


def _flat(rng: np.random.Generator, severity: Severity) -> Pulley:
    return FlatSpot(_pick(rng, severity, (0.01, 0.1), (0.3, 2.0)), _phase(rng))


def _fourier(rng: np.random.Generator, severity: Severity) -> Pulley:
    k = np.arange(1, 5)
    size = np.array([_pick(rng, severity, (0.02, 0.1), (0.3, 1.5))])
    size = np.append(size, [_pick(rng, severity, (0.005, 0.05), (0.3, 1.8)) for _ in k[1:]])
    phase = rng.uniform(0, TURN_RAD, len(k))
    radius = _R0_MM * (rng.uniform(0.8, 1.2) if severity != "realistic" else 1 + rng.uniform(-0.003, 0.003))
    waves = size[:, None] * np.cos(k[:, None] * _PHI + phase[:, None])
    # Shrink the shape until the hull is convex (h + h″ ≥ 0) and holds the shaft, with some room.
    deepest = -((1 - k**2)[:, None] * waves).sum(axis=0).min()
    lowest = -waves.sum(axis=0).min()
    shrink = min(1.0, 0.95 * radius / max(deepest, 1e-9), 0.7 * radius / max(lowest, 1e-9))
    return FourierHull(
        float(radius),
        tuple(map(float, shrink * size * np.cos(phase))),
        tuple(map(float, -shrink * size * np.sin(phase))),
    )


def _tabulated(rng: np.random.Generator, severity: Severity) -> Pulley:
    """A round pulley bruised at random: the hull of points on a circle with random dents and bumps."""
    depth = _pick(rng, severity, (0.005, 0.05), (0.3, 1.2))
    angles = np.sort(rng.uniform(0, TURN_RAD, 48))
    radii = _R0_MM + depth * rng.uniform(-1, 1, 48)
    # The support function of points is the largest projection; 720 directions make a table of it.
    phi = np.linspace(0, TURN_RAD, 720, endpoint=False)
    return TabulatedHull(tuple(map(float, (radii * np.cos(phi[:, None] - angles)).max(axis=1))))


def _published(rng: np.random.Generator, severity: Severity) -> Pulley:
    return PublishedHull(str(rng.choice(["small", "line", "triangle", "square", "egg"])), _phase(rng))


_PULLEYS: dict[str, Callable[[np.random.Generator, Severity], Pulley]] = {
    "radius": _radius,
    "eccentric": _eccentric,
    "ellipse": _ellipse,
    "polygon": _polygon,
    "flat": _flat,
    "fourier": _fourier,
    "tabulated": _tabulated,
    "published": _published,
}


def _any_pulley(rng: np.random.Generator, severity: Severity) -> Pulley:
    if severity == "paper":  # its two kinds: a round one of another radius, and hulls that are not round
        names = ["radius", "published"]
    else:
        names = [name for name in _PULLEYS if severity == "damaged" or name != "published"]
    return _PULLEYS[str(rng.choice(names))](rng, severity)


def _play(rng: np.random.Generator, severity: Severity) -> Play:
    return Play(_pick(rng, severity, (0.02, 0.2), (0.2, 2.0)))


def _loose(rng: np.random.Generator, severity: Severity, pulley: Pulley | None) -> LooseBelt:
    """Draw the play at its tightest angle; the odd harmonics of the pulley come on top of it."""
    play = _pick(rng, severity, (0.02, 0.2), (0.2, 2.0))
    tight = 0.0
    if pulley is not None:
        drive = Drive(pulley=pulley, belt=LooseBelt(1000.0, 0.0))
        tight = drive_play_variation_mm(drive)
    share = float(rng.uniform(0.3, 0.7))
    return LooseBelt((play + tight) * share, (play + tight) * (1 - share))


def drive_play_variation_mm(drive: Drive) -> float:
    """Return max(U1 − U2) [mm] of a drive's pulley: the slack that its belt needs lest it be over-tight."""
    if drive.pulley is None:
        return 0.0
    t = np.linspace(0.0, TURN_RAD, 8193)
    odd = drive.pulley.support_mm(-t, _R0_MM) - drive.pulley.support_mm(np.pi - t, _R0_MM)
    excess = np.concatenate([[0.0], np.cumsum((odd[1:] + odd[:-1]) / 2 * (t[1] - t[0]))])
    return float(excess.max()) + 1e-6


def _gain_table(rng: np.random.Generator, severity: Severity) -> GainTable:
    """Smooth gains with five harmonics of the motor's turn, as in the published data."""
    position = np.arange(1, 1101)
    size = 0.01 if severity == "realistic" else 0.1
    gains = np.ones(1100) * (1 + rng.uniform(-size, size) / 2)
    for k in range(1, 6):
        gains += size / (k + 1) * rng.uniform(-1, 1) * np.cos(k * TURN_RAD * position / 200 + _phase(rng))
    return GainTable(tuple(map(float, gains)))


def _shaft(rng: np.random.Generator, severity: Severity) -> SetScrew:
    return SetScrew(_pick(rng, severity, (0.02, 0.2), (0.2, 2.0)) / _R0_MM)


def _ripple(rng: np.random.Generator, severity: Severity) -> Ripple:
    amplitude = rng.uniform(0.02, 0.1, 3)
    amplitude *= min(1.0, 0.95 / float(2 * np.pi * (amplitude / (4.0, 2.0, 1.0)).sum()))  # never turns the motor back
    return Ripple(tuple(map(float, amplitude)), (4.0, 2.0, 1.0), tuple(float(_phase(rng)) for _ in range(3)))


def _friction(rng: np.random.Generator, severity: Severity) -> Friction:
    return Friction(float(rng.uniform(2, 8)), float(rng.uniform(1e4, 2e4)), _LOOP_MM)


def _warp(rng: np.random.Generator, severity: Severity) -> Warp:
    """A smooth error of no period: bumps 10 to 40 mm wide over every place that any preset's motors reach."""
    size, spacing = _pick(rng, severity, (0.02, 0.1), (0.3, 1.5)), float(rng.uniform(10, 40))
    bumps = rng.uniform(-1, 1, int(1200 / spacing))
    return Warp(tuple(map(float, size * bumps)), spacing, -450.0)


def _jumps(rng: np.random.Generator, severity: Severity) -> Drive:
    """Once in half a metre to two (a layer of the paper is about one), or once in twenty metres."""
    rate = float(rng.uniform(0.02, 0.1) if severity == "realistic" else rng.uniform(0.5, 2.0))
    share, seeds = float(rng.uniform(0.2, 0.8)), rng.integers(0, 2**32, 2)
    skips, missed = ToothSkips(rate * share, int(seeds[0])), MissedSteps(rate * (1 - share), int(seeds[1]))
    return Drive(skips=skips, missed=missed)


def _screw(rng: np.random.Generator, severity: Severity) -> Screw:
    return Screw(
        lead_error=float(rng.choice([-1, 1])) * _pick(rng, severity, (0.0005, 0.003), (0.01, 0.05)),
        periodic_mm=_pick(rng, severity, (0.002, 0.02), (0.02, 0.2)),
        periodic_phase_rad=_phase(rng),
        wobble_mm=_pick(rng, severity, (0.01, 0.12), (0.2, 0.5)),
        wobble_phase_rad=_phase(rng),
        backlash_mm=_pick(rng, severity, (0.01, 0.05), (0.1, 0.4)),
    )


def _frame(rng: np.random.Generator, severity: Severity) -> CrookedFrame:
    sign = float(rng.choice([-1, 1]))
    if severity != "realistic":
        scale, bow = rng.uniform(0.95, 1.05, 2), rng.uniform(-0.5, 0.5, 2)
    else:
        scale, bow = rng.uniform(0.997, 1.003, 2), rng.uniform(-0.05, 0.05, 2)
    skew = sign * _pick(rng, severity, (0.02, 0.3), (1.0, 4.0))
    return CrookedFrame(skew, float(scale[0]), float(scale[1]), float(bow[0]), float(bow[1]))


def _pulley_drive(name: str) -> Callable[[np.random.Generator, Severity], Drive]:
    return lambda rng, severity: Drive(pulley=_PULLEYS[name](rng, severity))


def _pulley_loose(rng: np.random.Generator, severity: Severity) -> Drive:
    pulley = _any_pulley(rng, severity)
    return Drive(pulley=pulley, belt=_loose(rng, severity, pulley))


def _elastic(rng: np.random.Generator, severity: Severity) -> Drive:
    pulley = _fourier(rng, severity)
    return Drive(pulley=pulley, belt=ElasticBelt(_LOOP_MM))


def _everything(rng: np.random.Generator, severity: Severity) -> Drive:
    return Drive(
        ripple=_ripple(rng, severity),
        shaft=SetScrew(_pick(rng, severity, (0.01, 0.05), (0.05, 0.3)) / _R0_MM),
        pulley=_any_pulley(rng, severity),
        belt=_play(rng, severity),
        friction=_friction(rng, severity),
    )


_DRIVES: dict[str, Callable[[np.random.Generator, Severity], Drive]] = {
    **{name: _pulley_drive(name) for name in _PULLEYS},
    "pulley": lambda rng, severity: Drive(pulley=_any_pulley(rng, severity)),
    "play": lambda rng, severity: Drive(belt=_play(rng, severity)),
    "loose": lambda rng, severity: Drive(belt=_loose(rng, severity, None)),
    "pulley-play": lambda rng, severity: Drive(pulley=_any_pulley(rng, severity), belt=_play(rng, severity)),
    "pulley-loose": _pulley_loose,
    "set-screw": lambda rng, severity: Drive(shaft=_shaft(rng, severity)),
    "pulley-set-screw": lambda rng, severity: Drive(pulley=_any_pulley(rng, severity), shaft=_shaft(rng, severity)),
    "elastic": _elastic,
    "friction": lambda rng, severity: Drive(friction=_friction(rng, severity)),
    "smooth": lambda rng, severity: Drive(warp=_warp(rng, severity)),
    "jumps": _jumps,
    "ripple": lambda rng, severity: Drive(ripple=_ripple(rng, severity)),
    "gain-table": lambda rng, severity: Drive(gain_table=_gain_table(rng, severity)),
}


def families() -> tuple[str, ...]:
    """Return the names that `sample` takes."""
    return (*_DRIVES, "frame", "screw", "everything")


def check_family(family: str) -> None:
    """Raise `ConfigError` for a family that `fault` does not know; a plug-in is imported to see."""
    if family in families() or family in EFFECTS or family in EVENTS:
        return
    if not is_plugin(CORRUPTIONS, family):
        known = ", ".join(dict.fromkeys((*families(), *plugin_names(CORRUPTIONS), *EFFECTS, *EVENTS)))
        raise ConfigError("family", wanted=f"one of {known}, or module:NAME", came=repr(family), todo="correct it")
    _foreign(family)


def fault(family: str, rng: np.random.Generator, severity: Severity = "damaged") -> Fault:
    """Draw a fault of that family, or the effect or event of that name. Raise `ConfigError` where there is none.

    A family of another package is a function of ``rng`` and ``severity``; it returns a `Corruption`, or any value that
    lowers.
    """
    if family in families() or family in EFFECTS or family in EVENTS:
        return sample(family, rng, severity)
    check_family(family)
    drawn = _foreign(family)(rng, "damaged" if severity == "paper" else severity)
    if not isinstance(drawn, Fault):
        came, todo = type(drawn).__name__, "return a Corruption, or a value with lower and jumps"
        raise ConfigError(family, wanted="a function that draws a fault", came=came, todo=todo)
    return drawn


def _foreign(family: str) -> Callable[[np.random.Generator, Severity], Fault]:
    draw: Callable = load_plugin(CORRUPTIONS, family, wanted="a function of rng and severity", has=("__call__",))
    return draw


def sample(family: str, rng: np.random.Generator, severity: Severity = "damaged") -> Corruption:
    """Draw a corruption of that family, the effect of that name at one place, or the event of that name.

    Raise `ConfigError` for a family or severity that does not exist.
    """
    if severity not in SEVERITIES:
        raise ConfigError("severity", wanted="damaged, realistic or paper", came=repr(severity), todo="correct it")
    if family == "frame":
        return Corruption(frame=_frame(rng, severity))
    if family == "screw":
        return Corruption(screw=_screw(rng, severity))
    if family == "everything":
        return Corruption((_everything(rng, severity), _everything(rng, severity)), _frame(rng, severity))
    if family in EVENTS:  # a homing, a refit and a filament are what they are on any printer
        return Corruption(causes=(Cause(family, seed=int(rng.integers(2**32))),))
    if family not in _DRIVES and family in EFFECTS:
        mildness: Literal["damaged", "realistic"] = "realistic" if severity == "realistic" else "damaged"
        return Corruption(causes=(Cause(family, seed=int(rng.integers(2**32)), severity=mildness),))
    if family not in _DRIVES:
        raise ConfigError(
            "family", wanted=f"one of {', '.join(families())}, or an effect", came=repr(family), todo="correct it"
        )
    return Corruption((_DRIVES[family](rng, severity), _DRIVES[family](rng, severity)))


# Draw printers and sessions from the priors, print and measure them: the data of the engine's calibration test.

MOST_LOG_ODDS = 50.0  # of what is always there


def drawn_parts(scene: Scene, rng: np.random.Generator) -> list[Sized]:
    """Draw the effects of a printer, its print and its measurement, each by its odds and with sizes by its prior."""
    from_home = [effect for effect in EFFECTS.values() if effect.from_home]
    while not _is_possible(parts := [part for effect in from_home for part in _drawn(effect, scene, rng)], scene):
        pass
    if scene.homed:
        mechanism, _ = machine_of(scene, [part for part in parts if EFFECTS[part.effect].of is Of.MACHINE])
        scene = replace(scene, home_sd_mm=home_sd_of(mechanism, scene))
    return [*parts, *(part for each in EFFECTS.values() if not each.from_home for part in _drawn(each, scene, rng))]


def _drawn(effect: Effect, scene: Scene, rng: np.random.Generator) -> Iterator[Sized]:
    """Draw what of one effect a printer has."""
    for terms, odds in _offered(effect.name, scene):
        if rng.uniform() < odds.sum() / (1 + odds.sum()):
            term = terms[int(rng.choice(len(terms), p=odds / odds.sum()))]
            shape = term.shape
            for round_ in range(FINER_ROUNDS):
                shapes = [shape, *effect.finer(term.where, shape, round_, scene)]
                shape = shapes[int(rng.integers(len(shapes)))]
            yield Sized(effect.name, term.where, shape, drawn_sizes(term, rng))


@lru_cache(maxsize=256)  # a calibration draws hundreds of printers of one scene
def _offered(name: str, scene: Scene) -> list[tuple[list[Term], np.ndarray]]:
    """Return an effect's terms at each place, and their odds."""
    by_place: dict[int, list[Term]] = {}
    for term in EFFECTS[name].terms(scene):
        by_place.setdefault(term.where, []).append(term)
    log_odds = [(terms, np.array([term.log_odds for term in terms])) for terms in by_place.values()]
    return [(terms, np.exp(own - max(own.max() - MOST_LOG_ODDS, 0.0))) for terms, own in log_odds]


def _is_possible(parts: Sequence[Sized], scene: Scene) -> bool:
    """Say whether a machine can have all parts: no belt has less than no play anywhere."""
    unworn = [part for part in parts if part.effect != "wear"]
    for each, (motor, span_mm) in itertools.product((parts, unworn), enumerate(scene.motor_span_mm)):
        drive = [part for part in each if EFFECTS[part.effect].acts is Acts.DRIVE and part.where == motor]
        pushed, pulled = belts_mm(scene, motor, drive, np.linspace(*span_mm, PLACES))
        if (pulled < pushed - TINY_MM).any():
            return False
    return True


def measured(
    commanded_mm: np.ndarray,
    dots: np.ndarray,
    scene: Scene,
    parts: Sequence[Sized],
    noise_mm: float,
    rng: np.random.Generator,
) -> Trace:
    """Print way-points [N, 2] on a machine with these effects, and measure its ``dots`` [N] with normal noise."""
    mechanism, _ = machine_of(scene, [part for part in parts if EFFECTS[part.effect].of is Of.MACHINE])
    contacts = contacts_of(mechanism, scene.printer.to_motor(commanded_mm), worn(commanded_mm, parts, scene))
    empty = Trace(
        commanded_mm, np.full(commanded_mm.shape, np.nan), homed=scene.homed, placed=scene.placed,
        instrument=scene.instrument,
    )  # fmt: skip
    others = [
        part for part in parts if EFFECTS[part.effect].of is not Of.MACHINE or EFFECTS[part.effect].acts is Acts.NOT
    ]
    linear = [part for part in others if part.effect not in ("turn", "wear")]
    printed = mechanism.bed.printed(contacts.belt_mm) + added_mm(linear, empty, scene, contacts)
    printed = turned(printed, turn_of(others), scene)
    printed = printed + noise_mm * rng.standard_normal(printed.shape)
    known = dots & (contacts.row >= 0).all(axis=1)
    return replace(empty, measured_mm=np.where(known[:, None], printed, np.nan))
