"""Distances by callipers as rows: each is the difference of two marks, along the line between them.

Nothing else is special about them: the effects, their priors and the drawn machines are those of every measurement.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from printmend.effects import EFFECTS, Of, Places, Scene, Term, columns_of, places_of, scene_of
from printmend.effects.effect import Key, held_mm
from printmend.infer.gram import Block, Look, Rows, blocks_of, dictionary_of
from printmend.infer.machine import Part
from printmend.infer.posterior import SWEEPS, Few, acting, drawn_sizes
from printmend.machine import contacts_of, healthy_mechanism
from printmend.measure.callipers import (
    DOUBTED_SIGMAS,
    MOST_DISTANCES,
    READING_SD_MM,
    Distances,
    distances_of,
    measurable_pairs,
)
from printmend.measure.plan import ProbePlan
from printmend.path import Instrument, Trace
from printmend.printer import Axis, Printer

PASSES = (0, SWEEPS)  # sweeps of each: a distance bends a little with the errors themselves
BOTH = 2  # "where" of a scale of both motors
MISREAD_SHARE = 0.2  # a reading that a larger share of the drawn machines doubt is worth another look


@dataclass(frozen=True, eq=False)
class ByHand:
    """Machines drawn from a few distances, their ``parts`` with what acts, and the readings that may be ``misread``:
    the number of each from 0, and by how many mm."""

    scene: Scene
    parts: tuple[Part, ...]
    misread: tuple[tuple[int, float], ...]


@dataclass(frozen=True, eq=False)
class Guess:
    """The belief about a machine: ``mean`` [P] and ``covariance`` [P, P] of its unknowns, in prior standard deviations;
    the last is the width of dots. ``features`` [K, P] say how K distances between outer edges go with them, in mm."""

    features: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray

    def row(self, one: int, *, inner: bool = False) -> np.ndarray:
        """Return how a reading goes with the unknowns: between inner edges wider dots make it smaller."""
        row = self.features[one].copy()
        row[-1] *= -1.0 if inner else 1.0
        return row

    def spread_mm(self) -> np.ndarray:
        """Return how well each distance is known [K], as a standard deviation."""
        return np.sqrt(np.maximum(np.sum((self.features @ self.covariance) * self.features, axis=1), 0.0))

    def most_telling(self, taken: Sequence[int]) -> int:
        """Return the untaken distance with most information."""
        spread = self.spread_mm()
        spread[list(taken)] = -1.0
        return int(np.argmax(spread))

    def after(self, one: int, off_mm: float = 0.0, *, inner: bool = False) -> "Guess":
        """Return the belief after a distance was read with an error."""
        row = self.row(one, inner=inner)
        pull = self.covariance @ row
        gain = pull / (READING_SD_MM**2 + row @ pull)
        mean = self.mean + gain * (off_mm - row @ self.mean)
        return replace(self, mean=mean, covariance=self.covariance - np.outer(gain, pull))


def choose_distances(plan: ProbePlan) -> Distances:
    """Choose at most twelve distances between large dots, those with most information about the machine."""
    pairs = measurable_pairs(plan)
    guess = first_guess(plan, pairs)
    chosen: list[int] = []
    for _ in range(MOST_DISTANCES):
        chosen.append(guess.most_telling(chosen))
        guess = guess.after(chosen[-1])
    return distances_of(plan, pairs[chosen])


def first_guess(plan: ProbePlan, pairs: np.ndarray) -> Guess:
    """Return the belief before any of the pairs [K, 2] of dots is read. Errors with an unknown place are left out."""
    scene = _scene(plan, printer_of(plan))
    rows = _rows(distances_of(plan, pairs), scene, np.zeros((2 * len(pairs), 2)), plain=True)
    variance = np.concatenate([block.variance_mm2 for block in rows.blocks])
    last = next(block.at.start for block in rows.blocks if block.effect == "bead")
    order = np.append(np.delete(np.arange(len(variance)), last), last)
    features = (rows.columns * np.sqrt(variance))[:, order]
    features = features[:, features.any(axis=0)]
    return Guess(features, np.zeros(features.shape[1]), np.eye(features.shape[1]))


def machines_by_hand(
    distances: Distances, readings_mm: np.ndarray, printer: Printer, rng: np.random.Generator
) -> ByHand:
    """Return the drawn machines of a printer from readings [K], NaN where none was taken."""
    known = np.isfinite(readings_mm)
    taken = distances_of(distances.plan, distances.pairs[known], distances.inner[known])
    scene = _scene(distances.plan, printer)
    off_mm = np.zeros((2 * len(taken.pairs), 2))  # of both dots of each distance, as far as known
    parts: list[Part] = []
    for sweeps in PASSES:
        rows = _rows(taken, scene, off_mm)
        few = Few(rows.blocks, rows.columns, readings_mm[known] - rows.healthy_mm, READING_SD_MM)
        sizes = drawn_sizes(few, rng, sweeps=sweeps)
        parts = _parts(rows.blocks, sizes)
        off_mm = np.zeros_like(off_mm)
        for part in parts:
            if part.effect != "bead":
                off_mm += columns_of(part.effect, rows.places, part.where, part.shape, scene) @ part.mean_mm
    missed_mm = few.error_mm[:, None] - sum(few.columns[:, few.blocks[b].at] @ each for b, each in sizes.items())
    acts = tuple(acting(scene, [_likely(part) for part in parts]))
    return ByHand(scene, acts, tuple(_misread(np.flatnonzero(known), missed_mm)))


def _misread(number: np.ndarray, missed_mm: np.ndarray) -> Iterator[tuple[int, float]]:
    """Yield each reading that enough machines miss [K, DRAWS] by more than hands do, and by how much they do."""
    for at, off_mm in zip(number.tolist(), missed_mm, strict=True):
        far = np.abs(off_mm) > DOUBTED_SIGMAS * READING_SD_MM
        if far.mean() > MISREAD_SHARE:
            yield at, float(np.median(off_mm[far]))


@dataclass(frozen=True, eq=False)
class _Rows:
    """K distances: both dots of each as ``places`` [2K], the ``columns`` [K, P] of all ``blocks``, and what each would
    be on a healthy printer, ``healthy_mm`` [K]."""

    places: Places
    blocks: tuple[Block, ...]
    columns: np.ndarray
    healthy_mm: np.ndarray


def _rows(distances: Distances, scene: Scene, off_mm: np.ndarray, *, plain: bool = False) -> _Rows:
    """Return distances as rows, linear about where the second and the first dot of each are ``off_mm`` [2K, 2].

    On a CoreXY two opposite scales are a lean and a turn, which no distance shows. So that a lean is not taken for
    them, one scale of both motors is a block of its own.
    """
    plan, count = distances.plan, len(distances.pairs)
    ends = distances.pairs[:, ::-1].T.ravel()
    moved = plan.marks_mm[ends] + off_mm
    between = moved[:count] - moved[count:]
    length = np.hypot(*between.T)
    along = np.concatenate([between, -between]) / np.tile(length, 2)[:, None]
    side = np.where(distances.inner, -1.0, 1.0)
    whole = Trace(plan.waypoints_mm, plan.waypoints_mm, homed=True, placed=False)
    contacts = contacts_of(healthy_mechanism(scene.printer), scene.printer.to_motor(plan.waypoints_mm))
    places = places_of(whole, scene, contacts.row, contacts.side, plan.waypoints_mm).at(plan.rows[ends])
    places = replace(places, normal=along * np.tile(side, 2)[:, None])
    one = np.ones(2 * count)
    rows = Rows(np.arange(2 * count), along, one, one, one)
    found = dictionary_of(blocks_of(scene, _plain if plain else _told), Look(scene, places, rows, contacts))
    columns, blocks = found.columns[:count] + found.columns[count:], list(found.blocks)
    if scene.corexy:
        first, second = (block for block in blocks if block.effect == "scale")
        end = columns.shape[1]
        blocks.append(replace(first, where=BOTH, at=slice(end, end + 1)))
        columns = np.hstack([columns, columns[:, first.at] + columns[:, second.at]])
    healthy = length + side * plan.big_dot_mm - np.sum(along * off_mm, axis=1).reshape(2, -1).sum(axis=0)
    return _Rows(places, tuple(blocks), columns, healthy)


def _told(term: Term) -> bool:
    """Tell whether distances may tell a term: callipers have no errors of a picture."""
    return EFFECTS[term.effect].of is not Of.INSTRUMENT


def _plain(term: Term) -> bool:
    """Tell whether a term needs no place or length that would have to be looked for."""
    return _told(term) and not term.shape


def _parts(blocks: Sequence[Block], sizes: Mapping[int, np.ndarray]) -> list[Part]:
    found: dict[Key, np.ndarray] = {}
    for b, draws_mm in sorted(sizes.items()):
        block = blocks[b]
        for where in (0, 1) if block.where == BOTH and block.effect == "scale" else (block.where,):
            key = (block.effect, where, block.shape)
            found[key] = found.get(key, 0.0) + draws_mm
    return [Part(*key, np.zeros(len(draws_mm)), draws_mm) for key, draws_mm in found.items()]


def _likely(part: Part) -> Part:
    """Return a part that acts as it is in the machines that have it, where most have it."""
    return replace(part, acts_mm=held_mm(EFFECTS[part.effect], part.mean_mm / part.chance)) if part.is_likely else part


def _scene(plan: ProbePlan, printer: Printer) -> Scene:
    marks = np.full(plan.waypoints_mm.shape, np.nan)
    marks[plan.rows] = plan.marks_mm
    trace = Trace(plan.waypoints_mm, marks, homed=True, placed=False, instrument=plan.seen_by(Instrument()))
    return replace(scene_of(trace, printer), walls=True)


def printer_of(plan: ProbePlan) -> Printer:
    """Return the printer of a plan as far as that tells: what distances depend on."""
    low, high = plan.waypoints_mm.min(axis=0), plan.waypoints_mm.max(axis=0)
    home = plan.waypoints_mm[0]
    x, y = (
        Axis("xy"[i], float(low[i]), float(high[i]), 200, plan.mm_per_turn[i], 16, float(home[i]),
             "min" if home[i] < (low[i] + high[i]) / 2 else "max")
        for i in range(2)
    )  # fmt: skip
    return Printer(plan.printer, "corexy" if plan.kinematics == "corexy" else "cartesian", x, y, x)
