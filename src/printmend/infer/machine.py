"""The machine that a set of effects makes: its parts, each an effect with its sizes, as two drives and a frame."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from printmend.effects import EFFECTS, Acts, Scene
from printmend.effects.breathing import HARMONICS as BREATHS
from printmend.effects.effect import Key
from printmend.effects.elastic import HARMONICS as STRETCHES
from printmend.effects.homing import shifted, waves_of
from printmend.effects.pulley import HARMONICS as ROUNDS
from printmend.effects.sized import Sized, belts_mm, frame_of
from printmend.machine import Frame, Mechanism, Transmission, healthy_transmission
from printmend.model.branches import Branches, Wave, rising

DRAWS = 96  # machines that are drawn
SUMMED = ("place", "scale", "bend", "pulley", "play", "wear", "breathing", "friction", "elastic")  # in a series
LIKELY = 0.5  # share of the drawn machines from which on a part is likely to be there


@dataclass(frozen=True, eq=False)
class Part:
    """One effect at one place with one shape, and the posterior of its sizes.

    ``acts_mm`` [P] are the sizes that the model has: their mean in the likely set, 0 where that has none.
    ``draws_mm`` [P, D] are those of the drawn machines; ``chance`` is the share of them that have it.
    """

    effect: str
    where: int
    shape: tuple[float, ...]
    acts_mm: np.ndarray
    draws_mm: np.ndarray

    @property
    def key(self) -> Key:
        return self.effect, self.where, self.shape

    @property
    def chance(self) -> float:
        return float(self.draws_mm.any(axis=0).mean())

    @property
    def is_likely(self) -> bool:
        return self.chance >= LIKELY

    @property
    def mean_mm(self) -> np.ndarray:
        return np.asarray(self.draws_mm.mean(axis=1))

    @property
    def sd_mm(self) -> np.ndarray:
        return np.asarray(self.draws_mm.std(axis=1))

    def acting(self) -> Sized:
        return Sized(*self.key, self.acts_mm)

    def moved(self, by_mm: np.ndarray, scene: Scene) -> "Part":
        """Return the part with the waves of its draws as they are once both motors are shifted ``by_mm`` [2] or
        [2, D]."""
        waves_mm = waves_of(*self.key, scene)
        return self if waves_mm is None else replace(self, draws_mm=shifted(self.draws_mm, waves_mm, by_mm[self.where]))

    def standing(self, by_mm: float, scene: Scene) -> "Part":
        """Return the part as it acts where its motor was shifted ``by_mm`` for good."""
        both = replace(self, draws_mm=np.column_stack([self.acts_mm, self.draws_mm])).moved(np.full(2, by_mm), scene)
        return replace(self, acts_mm=both.draws_mm[:, 0], draws_mm=both.draws_mm[:, 1:])


def those_acting(parts: Sequence[Part]) -> list[Sized]:
    """Return the parts that act, with the sizes that do."""
    return [part.acting() for part in parts if part.acts_mm.any()]


def machine_of(scene: Scene, parts: Sequence[Sized]) -> tuple[Mechanism, tuple[Branches | None, Branches | None]]:
    """Return the machine whose drives and frame have these effects, and each drive as a series where it is one.

    Effects that no mechanism can represent are left out. The tables are absolute: they give positions in the frame of
    the measurement.
    """
    if scene.homed:
        return _from_home(scene, parts)
    drives = [_drive(scene, motor, [part for part in parts if is_of_drive(part, motor)]) for motor in range(2)]
    mechanism = Mechanism(scene.printer, (drives[0][0], drives[1][0]), frame_of(scene, parts))
    return mechanism, (drives[0][1], drives[1][1])


def _from_home(scene: Scene, parts: Sequence[Sized]) -> tuple[Mechanism, tuple[Branches | None, Branches | None]]:
    """Return the machine that the end stops put right, with each belt as far from there as it rests."""
    moved = [part for part in parts if not EFFECTS[part.effect].from_home]
    mechanism, series = machine_of(replace(scene, homed=False), [part for part in parts if part not in moved])
    homed = replace(mechanism, frame=frame_from_home(mechanism)).homed()
    tables, branches = [], []
    for motor, (table, one) in enumerate(zip(homed.transmissions, series, strict=True)):
        by_mm = float(table.lower_mm[0] - mechanism.transmissions[motor].lower_mm[0])
        rest_mm = sum(float(part.sizes_mm[0]) for part in moved if part.where == motor)
        tables.append(table.shifted(rest_mm) if rest_mm else table)
        branches.append(one.shifted(by_mm + rest_mm) if one is not None and by_mm + rest_mm else one)
    return replace(homed, transmissions=(tables[0], tables[1])), (branches[0], branches[1])


def frame_from_home(mechanism: Mechanism) -> Frame:
    """Return a machine's frame so that it moves nothing at home: its own shift there is no drive's."""
    home = np.array(mechanism.printer.home_mm, float)[None]
    frame, constant = mechanism.frame, Frame.exponents.index((0, 0))
    coefficients = frame.coefficients_mm.copy()
    coefficients[:, constant] -= (frame.apply(home) - home)[0]
    return replace(frame, coefficients_mm=coefficients)


def is_of_drive(part: Sized | Part, motor: int) -> bool:
    """Tell whether a part is one of a motor's drive."""
    return EFFECTS[part.effect].acts is Acts.DRIVE and part.where == motor


def _drive(scene: Scene, motor: int, parts: Sequence[Sized]) -> tuple[Transmission, Branches | None]:
    series, others = _series(scene, motor, parts)
    table = series.lower(scene.printer, motor)
    if not others:
        return table, series
    healthy = healthy_transmission(scene.printer, motor)
    grid = healthy.motor_mm
    pushed, pulled = belts_mm(scene, motor, others, grid)
    lower, upper = table.lower_mm + pushed, table.upper_mm + pulled
    first = int(np.searchsorted(grid, sum(series.reach_mm) / 2))
    lower = rising(lower, first)
    return replace(healthy, lower_mm=lower, upper_mm=np.maximum(rising(upper, first), lower)), None


def _series(scene: Scene, motor: int, parts: Sequence[Sized]) -> tuple[Branches, list[Sized]]:
    """Return what of a drive is a short series, and the parts that are none."""

    def summed(count: int, *effects: str) -> np.ndarray:
        return sum((part.sizes_mm for part in parts if part.effect in effects), np.zeros(count))

    def waved(effect: str, orders: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the orders of an effect's waves, their cosines and their sines, none where it is not there."""
        cos, sin = summed(2 * len(orders), effect).reshape(2, -1)
        count = len(orders) if cos.any() or sin.any() else 0
        return orders[:count].astype(np.int64), cos[:count], sin[:count]

    mean = np.concatenate([summed(1, "place"), summed(1, "scale"), summed(2, "bend")])
    (play,), friction = summed(1, "play", "wear"), summed(2, "friction")
    warp, span, second, second_mm = np.zeros(0), (0.0, 1.0), np.zeros(2), 0.0
    teeth: dict[int, np.ndarray] = {}
    others = []
    for part in parts:
        sizes = part.sizes_mm
        if part.effect == "uneven":
            warp, span = sizes, (part.shape[0], part.shape[1])
        elif part.effect == "idler" and not second_mm:
            second, second_mm = sizes, part.shape[0]
        elif part.effect == "teeth" and _is_harmonic(scene.turns_mm[motor] / part.shape[0]):
            teeth[round(scene.turns_mm[motor] / part.shape[0])] = sizes
        elif part.effect not in SUMMED:
            others.append(part)
    high = np.array(sorted(teeth), np.int64)
    finer = (high, *np.array([teeth[k] for k in sorted(teeth)]).reshape(-1, 2).T)
    turn = (np.concatenate(each) for each in zip(waved("pulley", ROUNDS), finer, strict=True))
    played = np.array([play, *friction]) if friction.any() else np.array([play]) if play else np.zeros(0)
    powers = mean[: int(np.max(np.flatnonzero(mean), initial=-1)) + 1]
    series = Branches(
        scene.turns_mm[motor],
        scene.motor_middle_mm(motor),
        scene.motor_span_mm[motor],
        Wave(powers, *turn),
        Wave(played, *waved("breathing", BREATHS)),
        Wave(np.zeros(0), *waved("elastic", STRETCHES)),
        warp,
        span,
        Wave(np.zeros(0), np.ones(1, np.int64), second[:1], second[1:]) if second_mm else Wave(),
        second_mm,
    )
    return series, others


def _is_harmonic(turns: float) -> bool:
    return abs(turns - round(turns)) < 1e-6 and round(turns) > len(ROUNDS)
