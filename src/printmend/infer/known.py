"""Use an old machine as the prior of a new measurement: its drawn sizes, and how they wear."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from printmend.effects import EFFECTS, Acts, Places, Scene
from printmend.effects.breathing import HARMONICS as BREATHS
from printmend.effects.elastic import HARMONICS as STRETCHES
from printmend.effects.homing import shifted, waves_of
from printmend.effects.prior import wear_share
from printmend.effects.pulley import HARMONICS as ROUNDS
from printmend.effects.switch import drawn_shifts_mm, spread_mm
from printmend.infer.gram import Dictionary, Gram
from printmend.infer.part import DRAWS, Part

STEP_MM = 0.01  # shift of a motor by which the direction of shifts is taken
FAR_RAD = 0.3  # angle of a wave up to which that direction serves
OPEN_RAD = 0.03  # standard deviation of an angle that was found
GRID = 201  # places along a motor at which a series is taken
TURNING = {"pulley": ROUNDS, "breathing": BREATHS, "elastic": STRETCHES}  # effects that turn with a motor's pulley
Key = tuple[str, int, tuple[float, ...]]


@dataclass(frozen=True, eq=False)
class Story:
    """A story of an old machine: its remaining ``parts``, the angles ``turned_rad`` by which each motor's pulley turned
    on its shaft, and the motors with new parts (``anew``); ``whole``: nothing of it remains. Its belts were worked on
    in a ``refit``."""

    parts: tuple[Part, ...]
    turned_rad: tuple[float, float] = (0.0, 0.0)
    anew: tuple[int, ...] = ()
    whole: bool = False
    log_odds: float = 0.0
    refit: bool = False


@dataclass(frozen=True, eq=False)
class Wearing:
    """How far an old machine may have worn: ``factor`` times each effect's share in a month, and by how much (mean,
    standard deviation) the first size of an effect at a motor should have ``grown``. ``homed_mm`` [2] is the standard
    deviation of each motor's shift from one homing to the next, of which both directions come last."""

    factor: float
    grown: Mapping[tuple[str, int], tuple[float, float]]
    scene: Scene
    homed_mm: np.ndarray

    def known(self, story: Story, like: Sequence[Part]) -> tuple[np.ndarray, np.ndarray]:
        """Return the mean [P] and the directions [P, K] of unit prior of a story's parts, laid out as those ``like``
        them: the spread of the draws, what may have worn, and how exactly the angle of a turned pulley is known."""
        has = {key_of(part): part for part in story.parts}
        draws = laid_out([part.draws_mm for part in story.parts], story.parts, like)
        mean, ways = draws.mean(axis=1), [directions(draws)]
        for motor, by_rad in enumerate(story.turned_rad):
            if by_rad:
                more = turned(story.parts, motor, OPEN_RAD)
                moved = [b.draws_mm - a.draws_mm for a, b in zip(story.parts, more, strict=True)]
                ways.append(laid_out(moved, story.parts, like).mean(axis=1)[:, None])
        first = 0
        for each in like:
            width = len(each.acts_mm)
            more_mm, sd_mm = self.grown.get((each.effect, each.where), (0.0, 0.0))
            if key_of(each) in has:
                way = np.zeros((len(mean), 2))
                way[first : first + width, 0] = self.factor * wear_share(each.effect) * mean[first : first + width]
                mean[first] += more_mm * (-1.0 if mean[first] < 0 else 1.0)  # trends belong to sizes without a sign
                way[first, 1] = sd_mm
                ways.append(way[:, way.any(axis=0)])
            first += width
        return mean, np.hstack([*ways, self._homed(story, like)])

    def _homed(self, story: Story, like: Sequence[Part]) -> np.ndarray:
        """Return the directions [P, 2] in which a homing that is off by a standard deviation moves both motors."""
        ways = []
        for motor, sd_mm in enumerate(self.homed_mm.tolist()):
            moved = [moved_by(part, motor, STEP_MM, self.scene).draws_mm - part.draws_mm for part in story.parts]
            ways.append(laid_out(moved, story.parts, like).mean(axis=1) * sd_mm / STEP_MM)
        return np.stack(ways, axis=1)


def moved_by(part: Part, motor: int, by_mm: float | np.ndarray, scene: Scene) -> Part:
    """Return a part of one motor, with that motor's waves shifted ``by_mm`` [D]."""
    waves_mm = waves_of(part.effect, part.where, part.shape, scene) if part.where == motor else None
    return part if waves_mm is None else replace(part, draws_mm=shifted(part.draws_mm, waves_mm, by_mm))


def homed_again(parts: Sequence[Part], scene: Scene, rng: np.random.Generator) -> tuple[Part, ...]:
    """Return parts as another homing may have them, where that shifts their waves too far for a direction to say it."""
    by_mm, sd_mm = drawn_shifts_mm(scene, DRAWS, rng), spread_mm(scene)

    def on(part: Part) -> Part:
        waves_mm = waves_of(part.effect, part.where, part.shape, scene)
        is_far = waves_mm is not None and 2 * np.pi * sd_mm[part.where] > FAR_RAD * waves_mm.max()
        return moved_by(part, part.where, by_mm[part.where], scene) if is_far else part

    return tuple(map(on, parts))


def laid_out(draws: Sequence[np.ndarray], parts: Sequence[Part], like: Sequence[Part]) -> np.ndarray:
    """Return the draws of parts as one matrix [P, D] with the rows of those ``like`` them, 0 where one is missing."""
    has = {key_of(part): each for part, each in zip(parts, draws, strict=True)}
    return np.vstack([np.zeros((0, DRAWS)), *(has.get(key_of(each), 0.0 * each.draws_mm) for each in like)])


def directions(draws: np.ndarray) -> np.ndarray:
    """Return directions [P, K] whose squares sum up to the covariance of draws [P, D], shrunk as far as that many draws
    leave it open (oracle approximating shrinkage, Chen et al. 2010)."""
    sd = draws.std(axis=1)
    moves = sd > 0
    if not moves.any():
        return np.zeros((len(sd), 0))
    together = np.atleast_2d(np.corrcoef(draws[moves]))
    size, count = len(together), draws.shape[1]
    square = float(np.sum(together**2))
    spread = (count + 1 - 2 / size) * (square - size)
    shrunk = min(1.0, ((1 - 2 / size) * square + size**2) / spread) if spread > 0 else 1.0
    together = (1 - shrunk) * together + shrunk * np.eye(size)
    out = np.zeros((len(sd), size))
    out[moves] = sd[moves, None] * np.linalg.cholesky(together + 1e-9 * np.eye(size))
    return out


@dataclass(frozen=True, eq=False)
class Sums:
    """The dictionary of changes, and the Gram matrix of the old machine's columns and of its own, which come last."""

    dictionary: Dictionary
    gram: Gram

    @property
    def own(self) -> int:
        return self.dictionary.columns.shape[1]

    def without(self, mean: np.ndarray, ways: np.ndarray, sigma_mm: float, at: np.ndarray | None = None) -> "Left":
        """Sum out an old machine; with ``at`` only these columns of the dictionary are left."""
        known = len(self.gram.slope) - self.own
        few = known + (np.arange(self.own) if at is None else at)
        gram, root, pull = self.gram.summed_out(np.arange(known), mean, ways, sigma_mm, few)
        assert gram.out is not None
        log_det = 2 * float(np.log(np.diag(root)).sum()) - 2 * len(root) * math.log(sigma_mm)
        covariance = sigma_mm**2 * np.linalg.inv(root @ root.T)
        return Left(gram, log_det, mean, ways, covariance, root @ pull / sigma_mm**2, root @ gram.out / sigma_mm**2)


@dataclass(frozen=True, eq=False)
class Left:
    """The Gram matrix of changes with the old machine summed out, and how its sizes follow from those of changes."""

    gram: Gram
    log_det: float
    mean: np.ndarray
    ways: np.ndarray
    covariance: np.ndarray
    pull: np.ndarray
    cross: np.ndarray

    def sizes_mm(self, changes: np.ndarray) -> np.ndarray:
        """Return the old machine's mean sizes [P, D] beside changes [Q, D]."""
        z = self.covariance @ (self.pull[:, None] - self.cross @ changes)
        return np.asarray(self.mean[:, None] + self.ways @ z)

    def shifts(self, changes: np.ndarray) -> np.ndarray:
        """Return both motors' shifts since the old machine homed and their deviations [2, 2], in prior deviations."""
        z = self.covariance @ (self.pull - self.cross @ changes[:, 0])
        return np.stack([z[-2:], np.sqrt(np.diag(self.covariance)[-2:])], axis=1)

    def drawn_mm(self, changes: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Return sizes [P, D] of the old machine drawn beside drawn changes [Q, D]."""
        root = np.linalg.cholesky(self.covariance + 1e-14 * np.eye(len(self.covariance)))
        spread = self.ways @ (root @ rng.standard_normal((len(root), changes.shape[1])))
        return np.asarray(self.sizes_mm(changes) + spread)


def turned(parts: Sequence[Part], motor: int, by_rad: float) -> tuple[Part, ...]:
    """Return parts with one motor's pulley turned on its shaft."""

    def on(part: Part) -> Part:
        if part.where != motor or part.effect not in TURNING:
            return part
        angle = TURNING[part.effect] * by_rad
        cos, sin = np.diag(np.cos(angle)), np.diag(np.sin(angle))
        turn = np.block([[cos, -sin], [sin, cos]])
        return replace(part, acts_mm=turn @ part.acts_mm, draws_mm=turn @ part.draws_mm)

    return tuple(on(part) for part in parts)


def key_of(part: Part) -> Key:
    return part.effect, part.where, part.shape


def rebased(part: Part, scene: Scene) -> Part:
    """Return a part of a drive whose one shape is the span that was seen as one over the span of another scene."""
    effect = EFFECTS[part.effect]
    shapes = {term.shape for term in effect.terms(scene) if term.where == part.where}
    if effect.acts is not Acts.DRIVE or len(shapes) != 1 or part.shape in shapes:
        return part
    (shape,) = shapes
    low, high = scene.motor_span_mm[part.where]
    motor, none = np.zeros((GRID, 2)), np.zeros((GRID, 2))
    motor[:, part.where] = np.linspace(low, high, GRID)

    def series(shape: tuple[float, ...], side: float) -> np.ndarray:
        places = Places(motor, np.full((GRID, 2), side), none, none, none, np.zeros(GRID), np.zeros(GRID), none)
        return np.asarray(effect.columns(places, part.where, shape, scene))

    old, new = series(part.shape, 1.0), series(shape, 1.0)
    if np.array_equal(old, series(part.shape, -1.0)):  # a shift of all is the belt's place
        old, new = old - old.mean(axis=0), new - new.mean(axis=0)
    old, new = old.reshape(2 * GRID, -1), new.reshape(2 * GRID, -1)
    onto = np.linalg.lstsq(new, old, rcond=None)[0]
    return replace(part, shape=shape, acts_mm=onto @ part.acts_mm, draws_mm=onto @ part.draws_mm)
