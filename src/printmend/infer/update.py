"""Learn from a second measurement of a known machine: its drawn machines are the prior, and only changes are sought.

The old machine's errors are subtracted from the rows. Its uncertainty and wear are columns of unit prior in every set,
and are integrated out of the Gram matrix. The search then finds only changes. It is compared with other explanations: a
pulley turned on its shaft, another belt, an end stop that moved, a motor with other parts, another machine.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial

import numpy as np

from printmend.effects import EFFECTS, Acts, Of, Scene, scene_of
from printmend.effects.breathing import HARMONICS as BREATHS
from printmend.effects.effect import (
    ALWAYS,
    SCALE_MM,
    SEED,
    TIMES_FINER,
    TINY_MM,
    Key,
    belt_places,
    drawn_places,
    held_mm,
)
from printmend.effects.elastic import HARMONICS as STRETCHES
from printmend.effects.homing import waves_of
from printmend.effects.prior import belt_effects, number_of, wear_share
from printmend.effects.pulley import HARMONICS as ROUNDS
from printmend.effects.switch import drawn_shifts_mm, spread_mm
from printmend.effects.words import along_motor_mm
from printmend.infer.fit import (
    FINER_ROUNDS,
    LIKE_PLAY,
    WEIGHINGS,
    Fit,
    first_sigma_mm,
    home_sd_of,
    looked,
    reweighed,
    turned_back,
    unlike_play,
    weighed,
    with_finer,
)
from printmend.infer.gram import (
    Block,
    Dictionary,
    Gram,
    Look,
    Rows,
    blocks_of,
    dictionary_of,
    gram_of,
    laid_side_by_side,
    slices,
    summed,
    with_blocks,
)
from printmend.infer.machine import DRAWS, LIKELY, Part, is_of_drive, machine_of, those_acting
from printmend.infer.posterior import Posterior, after_homing, posterior_here, seen_at
from printmend.infer.search import Search, Set, State, columns_at, searched
from printmend.machine import Mechanism
from printmend.path import Trace
from printmend.units import SELDOM_SDS

# Use an old machine as the prior of a new measurement: its drawn sizes, and how they wear.

FAR_RAD = 0.3  # angle of a wave up to which that direction serves
OPEN_RAD = 0.03  # standard deviation of an angle that was found
TURNING = {"pulley": ROUNDS, "breathing": BREATHS, "elastic": STRETCHES}  # effects that turn with a motor's pulley


@dataclass(frozen=True)
class Event:
    """What happened to a machine. Its ``kind`` is ``turned`` where the pulley of a motor turned on its shaft, ``belt``
    where a belt was replaced or refitted, ``stop`` where an end stop moved. ``where`` is the motor or the axis,
    ``by_rad`` the angle of the motor."""

    kind: str
    where: int
    by_rad: float

    def shift_mm(self, by_rad: float | np.ndarray, scene: Scene) -> np.ndarray:
        """Return how far an angle shifts the waves of its motor, or its end stop."""
        return np.asarray(-by_rad * scene.turns_mm[self.where] / (2 * np.pi))

    def after(self, parts: Sequence[Part], by_rad: float, scene: Scene) -> tuple[Part, ...]:
        """Return parts after the event: an end stop moves the whole print, and all waves with it."""
        if self.kind != "stop":
            return turned(parts, self.where, by_rad)
        shift_mm = self.shift_mm(by_rad, scene) * np.eye(2)[self.where]
        motors_mm = scene.printer.to_motor(shift_mm[None])[0]

        def on(part: Part) -> Part:
            if part.effect == "shift":
                return replace(part, draws_mm=part.draws_mm + shift_mm[:, None])
            return part.standing(float(motors_mm[part.where]), scene) if part.where < 2 else part

        return tuple(map(on, parts))


@dataclass(frozen=True, eq=False)
class Story:
    """A story of an old machine: its remaining ``parts``, the ``events`` since then, and the motors with new parts
    (``anew``). ``slack`` are the motors whose belt became slack or tight, and so rests elsewhere at home. If ``whole``,
    nothing of the old machine remains. ``unseen`` are the effects that no measurement could show until now; finding one
    is not a change. After a ``refit``, somebody worked on the belts."""

    parts: tuple[Part, ...]
    events: tuple[Event, ...] = ()
    anew: tuple[int, ...] = ()
    slack: tuple[int, ...] = ()
    whole: bool = False
    unseen: frozenset[str] = frozenset()
    log_odds: float = 0.0
    refit: bool = False

    @property
    def belts(self) -> tuple[int, ...]:
        """The motors with another belt."""
        return tuple(event.where for event in self.events if event.kind == "belt")


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
        them: the spread of the draws, how exactly the angle of a turned pulley is known, what may have worn, and a
        homing of each motor that is off by a standard deviation."""
        has = {part.key for part in story.parts}
        draws = laid_out(story.parts, like)
        together = overlaps(tuple(part.key for part in like), self.scene)
        mean, ways = draws.mean(axis=1), [directions(draws, together)]
        for event in story.events:
            more = laid_out(event.after(story.parts, OPEN_RAD, self.scene), like)
            ways.append((more - draws).mean(axis=1)[:, None])
        for each, own in zip(like, slices(len(part.acts_mm) for part in like), strict=True):
            if each.key not in has:
                continue
            way, first = np.zeros((len(mean), 2)), own.start
            more_mm, sd_mm = self.grown.get((each.effect, each.where), (0.0, 0.0))
            way[own, 0] = self.factor * wear_share(each.effect) * mean[own]
            mean[first] += more_mm * (-1.0 if mean[first] < 0 else 1.0)  # trends belong to sizes without a sign
            way[first, 1] = sd_mm
            ways.append(way[:, way.any(axis=0)])
        more = laid_out([part.moved(np.full(2, TINY_MM), self.scene) for part in story.parts], like)
        where = np.array([part.where for part in like for _ in part.acts_mm], int)
        ways.append((more - draws).mean(axis=1)[:, None] * (where[:, None] == (0, 1)) * self.homed_mm / TINY_MM)
        return mean, np.hstack(ways)


def homed_again(parts: Sequence[Part], scene: Scene, rng: np.random.Generator) -> tuple[Part, ...]:
    """Return parts as another homing may have them, where that shifts their waves too far for a direction to say it."""
    by_mm, sd_mm = drawn_shifts_mm(scene, DRAWS, rng), spread_mm(scene)

    def on(part: Part) -> Part:
        waves_mm = waves_of(*part.key, scene)
        is_far = waves_mm is not None and 2 * np.pi * sd_mm[part.where] > FAR_RAD * waves_mm.max()
        return part.moved(by_mm, scene) if is_far else part

    return tuple(map(on, parts))


def there_of(parts: Sequence[Part]) -> dict[tuple[str, int], np.ndarray]:
    """Return which drawn machines [DRAWS] have each effect at its place."""
    there = {part.key[:2]: np.zeros(DRAWS, bool) for part in parts}
    for part in parts:
        there[part.key[:2]] |= part.draws_mm.any(axis=0)
    return there


def surely_there(parts: Sequence[Part], scene: Scene) -> set[tuple[str, int]]:
    """Return the effects, by place, that are known and that most drawn machines have."""
    return {slot for slot, has in there_of(told_apart(parts, scene)[0]).items() if has.mean() >= LIKELY}


def told_apart(parts: Sequence[Part], scene: Scene) -> tuple[tuple[Part, ...], tuple[Part, ...]]:
    """Return the parts of effects that are known at their place, and those that are in doubt.

    All effects start as known. While some effect adds more variance to the sum of the known ones than its squared mean,
    the worst one becomes doubtful. That square is divided by the share of machines that have the effect, and is 0 below
    `LIKELY`. An effect that compensates for others reduces the variance, so it stays known.
    """
    there = there_of(parts)
    slots, shares = list(there), np.array([has.mean() for has in there.values()])
    at = [slots.index(part.key[:2]) for part in parts]
    of = np.eye(len(slots))[np.repeat(np.array(at, int), [len(part.draws_mm) for part in parts])]
    draws, together = laid_out(parts, parts), overlaps(tuple(part.key for part in parts), scene)
    mean = draws.mean(axis=1)
    spread = draws - mean[:, None]
    squares = np.diag(of.T @ (together * np.outer(mean, mean)) @ of)
    squares = squares * (shares >= LIKELY) / np.maximum(shares, 1 / DRAWS)
    covariance = of.T @ (together * (spread @ spread.T / DRAWS)) @ of
    known = np.ones(len(slots), bool)
    while True:
        more = np.where(known, 2 * covariance @ known - np.diag(covariance) - squares, 0.0)
        if not (more > 0).any():
            break
        known[np.argmax(more)] = False
    first, second = (
        tuple(part for part, slot in zip(parts, at, strict=True) if known[slot] == is_) for is_ in (True, False)
    )
    return first, second


@lru_cache(maxsize=16)  # of a belief's parts, which are asked for in every pass
def overlaps(keys: tuple[Key, ...], scene: Scene) -> np.ndarray:
    """Return the mean products [P, P] of what effects do to places over the measured spans, for a unit of each size."""
    places = drawn_places(scene)
    seen = (seen_at(key, places, scene).reshape(2 * len(places), -1) for key in keys)
    columns = np.hstack([np.zeros((2 * len(places), 0)), *seen])
    return np.asarray(columns.T @ columns / len(places))


def laid_out(parts: Sequence[Part], like: Sequence[Part]) -> np.ndarray:
    """Return the draws of parts as one matrix [P, D] with the rows of those ``like`` them, 0 where one is missing."""
    has = {part.key: part.draws_mm for part in parts}
    return np.vstack([np.zeros((0, DRAWS)), *(has.get(each.key, 0.0 * each.draws_mm) for each in like)])


def directions(draws: np.ndarray, together: np.ndarray) -> np.ndarray:
    """Return directions [P, K] whose outer products sum to the covariance of draws [P, D], shrunk as so few draws
    require (oracle approximating shrinkage, Chen et al. 2010).

    The shrinkage acts on correlations between the principal axes of what the sizes do ``together`` [P, P], not between
    the sizes. Otherwise the well-known sum of two similar effects would become uncertain.
    """
    sd = draws.std(axis=1)
    moves = np.ptp(draws, axis=1) > 0  # rounding gives those that are all alike a deviation
    if not moves.any():
        return np.zeros((len(sd), 0))
    axes = sd[moves, None] * np.linalg.eigh(together[np.ix_(moves, moves)] * np.outer(sd[moves], sd[moves]))[1]
    along = (axes / sd[moves, None] ** 2).T @ draws[moves]
    correlation = np.atleast_2d(np.corrcoef(along))
    size, count = len(correlation), draws.shape[1]
    square = float(np.sum(correlation**2))
    spread = (count + 1 - 2 / size) * (square - size)
    shrunk = min(1.0, ((1 - 2 / size) * square + size**2) / spread) if spread > 0 else 1.0
    correlation = (1 - shrunk) * correlation + shrunk * np.eye(size)
    out = np.zeros((len(sd), size))
    out[moves] = axes @ (along.std(axis=1)[:, None] * np.linalg.cholesky(correlation))
    return out


@dataclass(frozen=True, eq=False)
class Sums:
    """The dictionary of changes, and the Gram matrix of the columns of the old machine's parts, laid out as those
    ``like`` them, and of its own, which come last."""

    like: tuple[Part, ...]
    dictionary: Dictionary
    gram: Gram

    @property
    def own(self) -> int:
        return self.dictionary.columns.shape[1]

    @property
    def old(self) -> np.ndarray:
        """The old machine's columns [M, P]."""
        return self.gram.table.columns[:, : -self.own or None]

    def some(self, blocks: Sequence[Block]) -> "Sums":
        """Return the sums for the old machine and some of the dictionary's blocks, all made at once."""
        columns, known = columns_at(blocks), len(self.gram.slope) - self.own
        few = self.gram.some(np.append(np.arange(known), known + columns))
        dictionary = Dictionary(laid_side_by_side(blocks), self.dictionary.columns[:, columns])
        return Sums(self.like, dictionary, summed([few], len(few.slope)))

    def without(self, mean: np.ndarray, ways: np.ndarray, sigma_mm: float) -> "Left":
        """Sum out an old machine."""
        known = len(self.gram.slope) - self.own
        return Left(*self.gram.summed_out(np.arange(known), mean, ways, sigma_mm, np.arange(known, known + self.own)),
                    mean, ways, sigma_mm)  # fmt: skip


def sums_of(like: tuple[Part, ...], dictionary: Dictionary, old: np.ndarray, rows: Rows, weight: np.ndarray) -> Sums:
    """Return the sums of the columns [M, P] of an old machine's parts and of a dictionary's for rows of these weights
    [M]."""
    return Sums(like, dictionary, gram_of(np.hstack([old, dictionary.columns]), rows, weight))


@dataclass(frozen=True, eq=False)
class Left:
    """The Gram matrix of changes with the old machine summed out along ``ways`` [P, K] about its ``mean`` [P], and how
    its sizes follow from those of changes: by the root ``told`` [K, K] and the pull ``pulled`` [K] of the values."""

    gram: Gram
    told: np.ndarray
    pulled: np.ndarray
    mean: np.ndarray
    ways: np.ndarray
    sigma_mm: float

    @property
    def log_det(self) -> float:
        """The logarithm of the determinant of the information of the values along the ways."""
        return 2 * float(np.log(np.diag(self.told) / self.sigma_mm).sum())

    @cached_property
    def covariance(self) -> np.ndarray:
        """The covariance of the values along the ways [K, K]."""
        return np.asarray(self.sigma_mm**2 * np.linalg.inv(self.told @ self.told.T))

    def values(self, changes: np.ndarray) -> np.ndarray:
        """Return the mean values along the ways [K, D] beside changes [Q, D]."""
        assert self.gram.out is not None
        pull = self.told @ (self.pulled[:, None] - self.gram.out @ changes) / self.sigma_mm**2
        return np.asarray(self.covariance @ pull)

    def sizes_mm(self, changes: np.ndarray) -> np.ndarray:
        """Return the old machine's mean sizes [P, D] beside changes [Q, D]."""
        return np.asarray(self.mean[:, None] + self.ways @ self.values(changes))

    def shifts(self, changes: np.ndarray) -> np.ndarray:
        """Return both motors' shifts since the old machine homed and their deviations [2, 2], in prior deviations."""
        return np.stack([self.values(changes)[-2:, 0], np.sqrt(np.diag(self.covariance)[-2:])], axis=1)

    @cached_property
    def root(self) -> np.ndarray:
        """The root [P, K] of the covariance of the old machine's sizes."""
        return np.asarray(self.ways @ np.linalg.cholesky(self.covariance + LEAST_SHARE * np.eye(len(self.covariance))))

    def drawn_mm(self, changes: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Return sizes [P, D] of the old machine drawn beside drawn changes [Q, D]."""
        return np.asarray(self.sizes_mm(changes) + self.root @ rng.standard_normal((len(self.covariance), DRAWS)))

    def without(self, none: np.ndarray, sizes_mm: np.ndarray) -> np.ndarray:
        """Return sizes [P, D] with those marked in ``none`` [P, D] set to 0. The remaining sizes take over their error,
        as far as the two are correlated."""
        found = np.where(none, 0.0, sizes_mm)
        kinds, which = np.unique(none, axis=1, return_inverse=True)
        for number, gone in enumerate(kinds.T):
            mine, sd_mm = which == number, np.maximum(np.linalg.norm(self.root[gone], axis=1), TINY_MM)[:, None]
            own = self.root[gone] / sd_mm
            pull = np.linalg.solve(own @ own.T + LEAST_SHARE * np.eye(len(own)), sizes_mm[np.ix_(gone, mine)] / sd_mm)
            found[np.ix_(~gone, mine)] -= self.root[~gone] @ own.T @ pull
        return found


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


def rebased(part: Part, scene: Scene) -> Part:
    """Return a part of a drive whose one shape is the span that was seen as one over the span of another scene."""
    effect = EFFECTS[part.effect]
    shapes = {term.shape for term in effect.terms(scene) if term.where == part.where}
    if effect.acts is not Acts.DRIVE or len(shapes) != 1 or part.shape in shapes:
        return part
    (shape,) = shapes
    motor_mm = along_motor_mm(scene, part.where)

    def series(shape: tuple[float, ...], side: float) -> np.ndarray:
        return np.asarray(effect.columns(belt_places(part.where, motor_mm, side), part.where, shape, scene))

    old, new = series(part.shape, 1.0), series(shape, 1.0)
    if np.array_equal(old, series(part.shape, -1.0)):  # a shift of all is the belt's place
        old, new = old - old.mean(axis=0), new - new.mean(axis=0)
    old, new = (each.reshape(2 * len(motor_mm), -1) for each in (old, new))
    onto = np.linalg.lstsq(new, old, rcond=None)[0]
    return replace(part, shape=shape, acts_mm=onto @ part.acts_mm, draws_mm=onto @ part.draws_mm)


PASSES = 3  # of contacts, then search, where anything is new; the last one weighs stories
ANGLE_NATS = math.log(OPEN_RAD / math.sqrt(2 * np.pi))  # an angle may be any; it is known by a normal OPEN_RAD
PHASES = 72  # angles by which a pulley may have turned that are tried, then those between the best and its neighbours
SEEN_SHARE = 0.5  # of its prior deviation that a shift may keep and counts as seen
ALIKE_NATS = SELDOM_SDS**2 / 2  # of turns that fit alike to this, the smallest is told: an oval repeats after half
LEAST_SHARE = 1e-9  # of variances, that keeps roots of matrices real


@dataclass(frozen=True, eq=False)
class Renewed:
    """A machine after a second measurement: its parts ``now`` and ``before``, with the same shapes where both have
    them. ``story`` is the explanation of the change, ``changes`` are the effects of the machine that the search found
    in addition. ``fit`` is that search, on the rows after the old machine is subtracted; its blocks include effects of
    the print and of the instrument. ``homed_mm`` is how far X and Y have shifted since, with the standard deviation, if
    that was seen."""

    now: Posterior
    before: tuple[Part, ...]
    story: Story
    changes: tuple[Key, ...]
    fit: Fit
    homed_mm: tuple[tuple[float, float], ...]

    def of(self, effect: str, where: int) -> tuple[tuple[Part, ...], tuple[Part, ...]]:
        """Return an effect's parts before and now."""
        before, now = (
            tuple(part for part in parts if (part.effect, part.where) == (effect, where))
            for parts in (self.before, self.now.parts)
        )
        return before, now


def renewed(
    parts: Sequence[Part],
    mechanism: Mechanism,
    trace: Trace,
    scene: Scene,
    rng: np.random.Generator,
    *,
    first: Scene,
    months: float = 1.0,
    grown: Mapping[tuple[str, int], tuple[float, float]] | None = None,
    stories: bool = True,
    refit: bool = False,
) -> Renewed:
    """Return what a trace says of a machine of which ``parts`` were believed and ``mechanism`` made.

    ``scene`` spans what both measurements saw, ``first`` what those before this one did. ``months`` are since the first
    one; ``grown`` is by how much (mean, standard deviation) the first size of an effect at a motor should have grown.
    Without ``stories`` the machine is the old one with changes; after a ``refit`` its belts were worked on.
    """
    if scene.homed:
        scene = replace(scene, home_sd_mm=home_sd_of(mechanism, scene))
    own = [each for each in parts if EFFECTS[each.effect].of is Of.MACHINE]
    before = tuple(rebased(each, scene) for each in own)
    # machines of a homing of their own are drawn by a generator of their own: other figures stay as they are
    old = homed_again(before, scene, np.random.default_rng(SEED))
    shift = [Part("shift", 0, (), np.zeros(2), np.zeros((2, DRAWS)))] if scene.placed else []  # which end stops make
    unseen = frozenset(EFFECTS) - {block.effect for block in blocks_of(first)}
    story, whole, turned_rad = Story((*old, *shift), unseen=unseen, refit=refit), trace, 0.0
    wearing = Wearing(math.sqrt(max(months, 0.0)), grown or {}, scene, spread_mm(scene))
    seen = replace(scene, bed_span_mm=scene_of(trace, scene.printer).bed_span_mm)  # no mark tells a border elsewhere
    at: _Pass | None = None
    for number in range(PASSES):
        trace = turned_back(whole, turned_rad, scene)
        look = looked(trace, scene, mechanism, is_first=at is None)
        weighed_by = partial(_weighed_stories, story, wearing, look)
        at = weighed_by(blocks_of(seen), stories=stories and number == PASSES - 1)
        found = [at.sums.dictionary.blocks[b].effect for b, _ in at.state.members]
        doubtful = number == 0 and any(effect in LIKE_PLAY for effect in found)
        if doubtful:  # the next pass knows where play lets the belts touch
            at = weighed_by(blocks_of(seen, names=unlike_play()), stories=False)
        story = at.story
        now = _now(at, before, rng)
        mechanism, _ = machine_of(scene, those_acting(now.now.parts))
        turns = [part.mean_mm[0] for part in now.now.parts if part.effect == "turn"]
        turned_rad += math.atan(sum(turns) / SCALE_MM)
        if not _news(at) and not any(turns) and not doubtful:
            break
    return now


@dataclass(frozen=True, eq=False)
class _Pass:
    """The likeliest story of one pass, with its search."""

    story: Story
    look: Look
    sums: Sums
    left: Left
    state: State
    score: float

    def left_mm(self) -> np.ndarray:
        """Return what all of it leaves of the rows [M]."""
        likely_mm = self.state.laid_out_mm(self.sums.own)[:, None]
        old = self.sums.old @ self.left.sizes_mm(likely_mm)
        return np.asarray(self.look.rows.error_mm - (old + self.sums.dictionary.columns @ likely_mm)[:, 0])


def _weighed_stories(story: Story, wearing: Wearing, look: Look, offered: Sequence[Block], *, stories: bool) -> _Pass:
    (like, doubted), rows = told_apart(story.parts, look.scene), look.rows
    changes = tuple(replace(block, signs=np.zeros(1), needs=()) for block in offered)  # play may become less
    dictionary = _with_shapes(dictionary_of(changes, look), doubted, look)
    old = look.columns(part.key for part in like)
    always: Set = tuple((b, 0) for b, block in enumerate(dictionary.blocks) if block.log_odds[0] > 0)
    left_mm = rows.error_mm - old @ wearing.known(story, like)[0]
    weight = weighed(rows, left_mm)
    best: _Pass | None = None
    members, sigma_mm = always, first_sigma_mm(left_mm, weight)
    for _ in range(WEIGHINGS):
        sums = sums_of(like, dictionary, old, rows, weight)

        def told(each: Story, start: Set, sums: Sums = sums, sd_mm: float = sigma_mm) -> _Pass:
            left = sums.without(*wearing.known(each, like), sd_mm)
            state = searched(_search(sums, each, left), start, sd_mm)
            left = sums.without(left.mean, left.ways, state.sigma_mm)
            state = _search(sums, each, left).posterior(state.members, state.sigma_mm, rounds=0)
            sure = ALWAYS * len(each.belts)  # that another belt has another pitch
            score = state.score - left.log_det / 2 + each.log_odds - sure
            return _Pass(each, look, sums, left, state, score)

        best = told(story, members)
        while stories and _news(best) and not best.story.whole:
            newer = max((told(each, always) for each in _others(best, always, wearing)), key=lambda each: each.score)
            if newer.score <= best.score:
                break
            best = newer
        story, stories = best.story, False
        best = _finer(best, weight)
        dictionary, members, sigma_mm = best.sums.dictionary, best.state.members, best.state.sigma_mm
        weight = reweighed(rows, best.left_mm())
    assert best is not None
    return best


def _with_shapes(dictionary: Dictionary, parts: Sequence[Part], look: Look) -> Dictionary:
    """Return the dictionary with the shapes of parts that lie between its own."""
    blocks = {(*block.slot, block.width): block for block in dictionary.blocks}
    known = {block.key for block in dictionary.blocks}
    missed = [(part, (part.effect, part.where, len(part.draws_mm))) for part in parts if part.key not in known]
    more = [
        replace(blocks[slot], shape=part.shape, log_odds=blocks[slot].log_odds - math.log(TIMES_FINER))
        for part, slot in missed
        if slot in blocks
    ]
    return with_blocks(dictionary, more, look)


def _search(sums: Sums, story: Story, left: Left) -> Search:
    """Return the search for changes of a story."""
    blocks = _seldom(sums.dictionary.blocks, story, sums.like)
    return Search(Dictionary(blocks, sums.dictionary.columns), left.gram)


@lru_cache(maxsize=16)  # each story is searched more than once
def _seldom(blocks: tuple[Block, ...], story: Story, known: tuple[Part, ...]) -> tuple[Block, ...]:
    """Return blocks with the odds of changes: what a machine has since, it seldom has; what does not wear comes only
    with other parts; what was never seen is as likely as on any machine. After a ``refit``, or when slack, belts may
    well rest elsewhere at home. What was in doubt at a place comes as often, and as large, as the drawn machines had
    it. Another belt has another pitch. Both are the last alternatives of their blocks."""
    parts: dict[_Slot, list[Part]] = {}
    sure = {part.key for part in known}
    for part in story.parts:
        if part.key not in sure and part.draws_mm.any():
            parts.setdefault((*part.key[:2], len(part.draws_mm)), []).append(part)
    alike: dict[_Slot, list[Block]] = {slot: [] for slot in parts}
    for block in blocks:
        if (slot := (*block.slot, block.width)) in parts:
            alike[slot].append(block)
    doubts = {slot: _Doubt(parts[slot], alike[slot]) for slot in parts}

    def seldom(one: Block) -> Block:
        effect = EFFECTS[one.effect]
        of_belt = one.where in story.belts and one.effect in belt_effects()
        is_anew = effect.acts is Acts.DRIVE and one.where in story.anew
        if effect.of is not Of.MACHINE or story.whole or is_anew or of_belt or one.effect in story.unseen:
            return one
        doubt, sds_mm, log_odds = doubts.get((*one.slot, one.width)), one.sds_mm, one.log_odds
        is_slack = one.where in story.slack and one.effect in ("play", "place")
        if not is_slack and (not story.refit or effect.from_home):
            log_odds = log_odds + math.log(number_of("since", "changed" if wear_share(one.effect) else "replaced"))
        if doubt is not None:
            more_mm, more = doubt.alternatives(one)
            sds_mm, log_odds = np.concatenate([sds_mm, more_mm]), np.concatenate([log_odds, more])
        if one.effect == "scale" and one.where in story.belts:
            pitch = np.full((1, one.width), number_of("since", "pitch"))
            sds_mm, log_odds = np.concatenate([sds_mm, pitch]), np.append(log_odds, ALWAYS)
        return replace(one, sds_mm=sds_mm, log_odds=log_odds, signs=np.zeros(1))

    return tuple(map(seldom, blocks))


_Slot = tuple[str, int, int]  # an effect, its place, and how many sizes it has


class _Doubt:
    """What is in doubt at one place of an old machine: ``parts``, of which any of the ``blocks`` may be there.

    To the draws of each shape one more is added, divided as the prior has it: few draws hold few of many shapes.
    """

    def __init__(self, parts: Sequence[Part], blocks: Sequence[Block]) -> None:
        there = np.array([part.draws_mm.any(axis=0) for part in parts])
        some, every = np.count_nonzero(there.any(axis=0)), np.count_nonzero(there)
        self._draws_mm = np.hstack([part.draws_mm[:, has] for part, has in zip(parts, there, strict=True)])
        self._counts = {part.key: np.count_nonzero(has) for part, has in zip(parts, there, strict=True)}
        self._odds = some / (DRAWS - some + 1) / (every + 1)
        self._prior = sum(float(np.exp(block.log_odds).sum()) for block in blocks)
        self._sizes: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}

    def alternatives(self, block: Block) -> tuple[np.ndarray, np.ndarray]:
        """Return the standard deviations [V, P] and the log odds [V] of a block as the old machine may have it."""
        own = self._counts.get(block.key, 0) + float(np.exp(block.log_odds).sum()) / self._prior
        if (sizes := self._sizes.get(block.sds_mm.tobytes())) is None:
            sizes = self._sizes[block.sds_mm.tobytes()] = self._drawn_from(block.sds_mm)
        return sizes[0], np.log(sizes[1] * own * self._odds)

    def _drawn_from(self, sds_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return how large the sizes are among the draws that come from each alternative in size [V, P], and the share
        of such draws [V]; alternatives without one are left out."""
        away2 = np.sum((self._draws_mm[None] / sds_mm[:, :, None]) ** 2, axis=1)
        likeliest = np.argmin(away2 / 2 + np.log(sds_mm).sum(axis=1)[:, None], axis=0)
        at, counts = np.unique(likeliest, return_counts=True)
        mean2 = np.array([away2[each, likeliest == each].mean() for each in at]) / len(self._draws_mm)
        return sds_mm[at] * np.sqrt(mean2)[:, None], counts / len(likeliest)


def _news(at: _Pass) -> list[Block]:
    """Return what is new of the machine, and of this print what few prints have; what was in doubt is not new, and is
    no alternative of the dictionary."""
    found = [(at.sums.dictionary.blocks[b], variant) for b, variant in at.state.members]
    new = [(EFFECTS[one.effect].of, one, v) for one, v in found if v < len(one.log_odds)]
    return [one for of, one, v in new if of is Of.MACHINE or (of is Of.SESSION and one.log_odds[v] < 0)]


def _others(at: _Pass, always: Set, wearing: Wearing) -> Iterator[Story]:
    """Yield the stories that tell one thing more than one does."""
    story = at.story
    other, new = math.log(number_of("since", "replaced")), {block.slot for block in _news(at)}
    for motor in range(2):
        if ("play", motor) in new and motor not in story.slack:
            changed = math.log(number_of("since", "changed"))
            yield replace(story, slack=(*story.slack, motor), log_odds=story.log_odds + changed)
        own = [part for part in story.parts if is_of_drive(part, motor)]
        if not own:
            continue
        rest = tuple(part for part in story.parts if not is_of_drive(part, motor))
        yield replace(story, parts=rest, anew=(*story.anew, motor), log_odds=story.log_odds + other)
        if motor in (each.where for each in story.events) or all(part.effect != "pulley" for part in own):
            continue
        turn, stop = (_likeliest(Event(kind, motor, 0.0), at, always, wearing) for kind in ("turned", "stop"))
        for event in (turn, replace(turn, kind="belt"), stop):
            if event.by_rad:
                anew = belt_effects() if event.kind == "belt" else ()
                parts = [part for part in story.parts if part.where != motor or part.effect not in anew]
                yield replace(
                    story,
                    parts=event.after(parts, event.by_rad, at.look.scene),
                    events=(*story.events, event),
                    log_odds=story.log_odds + math.log(number_of("since", event.kind)) + ANGLE_NATS,
                )
    screw = {part.effect for part in story.parts if EFFECTS[part.effect].acts is Acts.SCREW}
    if screw:
        rest = tuple(part for part in story.parts if part.effect not in screw)
        yield replace(story, parts=rest, unseen=story.unseen | screw, log_odds=story.log_odds + other)
    drives = 2 + bool(screw)
    yield replace(story, parts=(), anew=(0, 1), whole=True, log_odds=story.log_odds + drives * other)


def _likeliest(event: Event, at: _Pass, always: Set, wearing: Wearing) -> Event:
    """Return an event by the angle by which it most likely was; where the place is known, only an end stop moves it."""
    blocks, story = at.sums.dictionary.blocks, at.story
    free = ("place", "play") if event.kind == "stop" else ("place", "play", "shift")
    kept = [blocks[b] for b, _ in always] + [block for block in blocks if block.effect in free]
    sums, members = at.sums.some(kept), tuple((b, 0) for b in range(len(kept)))
    like = {part.key for part in sums.like}
    known = tuple(part for part in story.parts if part.key in like)  # others tell nothing of the angle

    def score(by_rad: float) -> float:
        turned = replace(story, parts=event.after(known, by_rad, at.look.scene))
        left = sums.without(*wearing.known(turned, sums.like), at.state.sigma_mm)
        return Search(sums.dictionary, left.gram).posterior(members, at.state.sigma_mm).score - left.log_det / 2

    angles = np.arange(-PHASES // 2 + 1, PHASES // 2 + 1) * (2 * np.pi / PHASES)
    scores = np.array([score(float(each)) for each in angles])
    alike = angles[is_peak(scores) & (scores > scores.max() - ALIKE_NATS)]
    best = float(alike[np.argmin(np.abs(alike))])
    around = best + 2 * np.pi / PHASES * np.linspace(-1.0, 1.0, 17)
    return replace(event, by_rad=float(around[np.argmax([score(float(each)) for each in around])]))


def is_peak(scores: np.ndarray) -> np.ndarray:
    """Tell which scores of shifts by whole turns of one motor [G] or two [G, H] are no lower than their neighbours'."""
    around = [np.roll(scores, by, axis) for axis in range(scores.ndim) for by in (-1, 1)]
    return np.all([scores >= each for each in around], axis=0)


def _finer(at: _Pass, weight: np.ndarray) -> _Pass:
    """Look for the shapes of the members between the neighbours of each."""
    for round_ in range(FINER_ROUNDS):
        dictionary = with_finer(at.sums.dictionary, at.state.members, round_, at.look)
        if dictionary is at.sums.dictionary:
            break
        sums = sums_of(at.sums.like, dictionary, at.sums.old, at.look.rows, weight)
        left = sums.without(at.left.mean, at.left.ways, at.state.sigma_mm)
        state = searched(_search(sums, at.story, left), at.state.members, at.state.sigma_mm)
        at = replace(at, sums=sums, left=left, state=state)
    return at


def _now(at: _Pass, before: tuple[Part, ...], rng: np.random.Generator) -> Renewed:
    """Draw machines: changes as the search has them, and the old machine beside each."""
    scene, search = at.look.scene, _search(at.sums, at.story, at.left)
    fit = Fit(at.look, search, at.state)
    found = posterior_here(fit, rng)
    where = {block.key: block.at for block in at.sums.dictionary.blocks}
    changes, likely_mm = np.zeros((at.sums.own, DRAWS)), found.likely.laid_out_mm(at.sums.own)
    likely = {key: likely_mm[own] for key, own in where.items()}  # a belt's place may act that is none of these
    for part in found.parts:
        if part.key in where:
            changes[where[part.key]] = part.draws_mm
    like, left = at.sums.like, at.left
    draws = left.without(_those_without(like), left.drawn_mm(changes, rng))
    idle = np.array([_is_idle(part) for part in like for _ in part.acts_mm], bool)
    acts = left.without(idle[:, None], left.sizes_mm(likely_mm[:, None]))[:, 0]
    kept = {part.key: part for part in at.story.parts if EFFECTS[part.effect].of is Of.MACHINE}

    parts = {key: part for key, part in kept.items() if key not in where}  # what nothing sees stays as it was drawn
    for part, own in zip(like, slices(len(part.acts_mm) for part in like), strict=True):
        if part.key in kept:
            parts[part.key] = replace(part, acts_mm=acts[own], draws_mm=draws[own])
    for part in found.parts:
        had = parts.get(part.key)
        parts[part.key] = part if had is None else replace(
            had, acts_mm=had.acts_mm + likely.get(part.key, 0.0), draws_mm=had.draws_mm + part.draws_mm
        )  # fmt: skip
    seldom = {key for key in kept if parts.get(key) is kept[key]}  # these act as they did
    now = tuple(part if key in seldom else after_homing(_held(part), scene) for key, part in parts.items())
    posterior = replace(found, parts=now)
    told = tuple(block.key for block in _news(at) if EFFECTS[block.effect].of is Of.MACHINE)
    homed_mm = _homed_mm(at.left.shifts(likely_mm[:, None]), scene)
    return Renewed(posterior, before, at.story, told, fit, homed_mm)


def _held(part: Part) -> Part:
    """Return a part of which no more acts than a mechanism holds."""
    return replace(part, acts_mm=held_mm(EFFECTS[part.effect], part.acts_mm))


def _is_idle(part: Part) -> bool:
    """Tell whether a part of a machine neither acts nor is likely."""
    return EFFECTS[part.effect].of is Of.MACHINE and not (part.acts_mm.any() or part.is_likely)


def _those_without(parts: Sequence[Part]) -> np.ndarray:
    """Return which drawn machines must keep a size of zero [P, DRAWS]: those with the effect in another shape, and, if
    fewer than `LIKELY` have the effect, all without it."""
    there = there_of(parts)
    few = {slot: has.mean() < LIKELY and EFFECTS[slot[0]].of is Of.MACHINE for slot, has in there.items()}
    none = [~part.draws_mm.any(axis=0) & (there[part.key[:2]] | few[part.key[:2]]) for part in parts]
    widths = [len(part.draws_mm) for part in parts]
    return np.repeat(np.array(none, bool).reshape(-1, DRAWS), widths, axis=0)


def _homed_mm(shifts: np.ndarray, scene: Scene) -> tuple[tuple[float, float], ...]:
    """Return by how much the end stops of X and Y switched elsewhere than in the first print, where the motors'
    ``shifts`` [2, 2] say that."""
    seen, (at_mm, own_mm) = shifts[:, 1] < SEEN_SHARE, shifts.T * spread_mm(scene)
    if scene.corexy:
        if not seen.all():
            return ()
        at_mm, own_mm = scene.printer.from_motor(at_mm[None])[0], np.full(2, np.hypot(*own_mm) / 2)
    return tuple(zip(at_mm[seen].tolist(), own_mm[seen].tolist(), strict=True))


def both_seen(old: Scene, new: Scene) -> Scene:
    """Return the scene of a new measurement with the spans of an old one, too."""

    def spans(name: str) -> tuple[tuple[float, float], tuple[float, float]]:
        both = zip(getattr(old, name), getattr(new, name), strict=True)
        first, second = ((min(a[0], b[0]), max(a[1], b[1])) for a, b in both)
        return first, second

    return replace(
        new, motor_span_mm=spans("motor_span_mm"), bed_span_mm=spans("bed_span_mm"), homed_again_mm=old.homed_again_mm,
        layers=new.layers or old.layers,
    )  # fmt: skip
