"""Learn from a second measurement of a known machine: its drawn machines are the prior, and only changes are sought.

The rows are freed of what the old machine does. What was not known of it, and what wears, are columns of unit prior
that every set has: they are summed out of the Gram matrix. The search then finds changes alone. Beside it other stories
are weighed: a pulley turned on its shaft, a motor got other parts, all of it is another machine.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from printmend.effects import EFFECTS, Acts, Of, Places, Scene
from printmend.effects.effect import SCALE_MM
from printmend.effects.prior import happens_share, wear_share
from printmend.effects.switch import spread_mm
from printmend.infer.fit import (
    FINER_ROUNDS,
    Fit,
    home_sd_of,
    looked,
    turned_back,
    weighed,
    with_finer,
)
from printmend.infer.gram import (
    Block,
    Dictionary,
    Rows,
    dictionary_of,
    gram_of,
    laid_side_by_side,
    seen,
)
from printmend.infer.known import (
    TURNING,
    Key,
    Left,
    Story,
    Sums,
    Wearing,
    homed_again,
    key_of,
    laid_out,
    rebased,
    turned,
)
from printmend.infer.machine import machine_of
from printmend.infer.part import DRAWS, Part
from printmend.infer.posterior import Posterior, after_homing, posterior_here
from printmend.infer.search import LEAST_SIGMA_MM, Search, Set, State, by_growing, searched
from printmend.machine import Contacts, Mechanism
from printmend.path import Trace

LEAST_CHANCE = 0.05  # parts that fewer of the drawn machines have say nothing: the search offers them anew
SURE_CHANCE = 0.5  # parts that more of them have are brought up to date; others stay as they were drawn
PASSES = 3  # of contacts, then search, where anything changed; the last one weighs stories
WEIGHINGS = 2  # of rows in each pass
PHASES = 72  # angles by which a pulley may have turned that are tried, then those between the best and its neighbours
SEEN_SHARE = 0.5  # of its prior deviation that a shift may keep and counts as seen
SEED = 29
ALIKE_NATS = 1.0  # of angles that fit alike to this, the smallest is told: an oval looks the same after half a turn
_Steps = Callable[[Search, Set, float], State]


@dataclass(frozen=True, eq=False)
class Renewed:
    """A machine after a second measurement: what is believed ``now`` and what of it was known ``before``, as parts of
    the same shapes where both have them; ``story`` is what happened to it, ``changes`` are the effects of the machine
    that the search found beside it, and ``fit`` is that search, on what the old machine leaves of the rows. ``shifts``
    [2, 2] are how far both motors are shifted since, and how exactly that is known, in standard deviations of homings;
    ``homed_mm`` the same of X and Y in mm, where it was seen."""

    now: Posterior
    before: tuple[Part, ...]
    story: Story
    changes: tuple[Key, ...]
    fit: Fit
    left_mm: np.ndarray
    shifts: np.ndarray
    homed_mm: tuple[tuple[float, float], ...] = ()

    @property
    def beside(self) -> tuple[Block, ...]:
        """The effects that the search found beside the old machine, of the print and of the instrument included."""
        return self.fit.blocks

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
    months: float = 1.0,
    grown: Mapping[tuple[str, int], tuple[float, float]] | None = None,
    stories: bool = True,
    refit: bool = False,
) -> Renewed:
    """Return what a trace says of a machine of which ``parts`` were believed and ``mechanism`` made.

    ``scene`` spans what both measurements saw. ``months`` are since the first one; ``grown`` is by how much (mean,
    standard deviation) the first size of an effect at a motor should have grown. Without ``stories`` the machine is the
    old one with changes; after a ``refit`` its belts were worked on.
    """
    if scene.homed:
        scene = replace(scene, home_sd_mm=home_sd_of(mechanism, scene))
    own = [each for each in parts if EFFECTS[each.effect].of is Of.MACHINE and each.chance >= LEAST_CHANCE]
    before = tuple(rebased(each, scene) for each in own)
    # machines of a homing of their own are drawn by a generator of their own: other figures stay as they are
    story, whole, turned_rad = Story(homed_again(before, scene, np.random.default_rng(SEED)), refit=refit), trace, 0.0
    wearing = Wearing(math.sqrt(max(months, 0.0)), grown or {}, scene, spread_mm(scene))
    at: _Pass | None = None
    for number in range(PASSES):
        trace = turned_back(whole, turned_rad, scene)
        contacts, places, rows = looked(trace, scene, mechanism, is_first=at is None)
        at = _weighed_stories(story, wearing, places, rows, scene, stories=stories and number == PASSES - 1)
        story = at.story
        now = _now(at, contacts, scene, rng)
        mechanism = now.fit.mechanism
        turns = [part.mean_mm[0] for part in now.now.parts if part.effect == "turn"]
        turned_rad += math.atan(sum(turns) / SCALE_MM)
        if not now.changes and not any(turns):
            break
    return replace(now, before=before, homed_mm=_homed_mm(now, scene))


@dataclass(frozen=True, eq=False)
class _Pass:
    """The likeliest story of one pass, with its search."""

    story: Story
    like: tuple[Part, ...]
    places: Places
    rows: Rows
    sums: Sums
    left: Left
    state: State
    score: float
    old_columns: np.ndarray

    def left_mm(self) -> np.ndarray:
        """Return what all of it leaves of the rows [M]."""
        changes = np.zeros((self.sums.own, 1))
        changes[self.state.columns, 0] = self.state.mean_mm
        old = self.old_columns @ self.left.sizes_mm(changes)
        return np.asarray(self.rows.error_mm - old[:, 0] - self.sums.dictionary.columns @ changes[:, 0])


def _weighed_stories(
    story: Story, wearing: Wearing, places: Places, rows: Rows, scene: Scene, *, stories: bool
) -> _Pass:
    like = story.parts
    dictionary = dictionary_of(places, rows, scene)
    dictionary = replace(  # of changes: play may become less
        dictionary, blocks=tuple(replace(block, positive=False, needs=()) for block in dictionary.blocks)
    )
    old = _columns(like, places, rows, scene)
    always: Set = tuple((b, 0) for b, block in enumerate(dictionary.blocks) if block.log_odds[0] > 0)
    weight = weighed(rows, rows.error_mm - old @ wearing.known(story, like)[0])
    best: _Pass | None = None
    members, sigma_mm = always, _sigma_mm(rows, old, weight, wearing.known(story, like)[0])
    for _ in range(WEIGHINGS):
        sums = Sums(dictionary, gram_of(np.hstack([old, dictionary.columns]), rows, weight))

        def told(each: Story, start: Set, by: _Steps = searched, sums: Sums = sums, sd_mm: float = sigma_mm) -> _Pass:
            left = sums.without(*wearing.known(each, like), sd_mm)
            state = by(_search(sums, each, left), start, sd_mm)
            left = sums.without(left.mean, left.ways, state.sigma_mm)
            state = _search(sums, each, left).posterior(state.members, state.sigma_mm, rounds=0)
            score = state.score - left.log_det / 2 + each.log_odds
            return _Pass(each, like, places, rows, sums, left, state, score, old)

        best = told(story, members)
        while stories and _changed(best):
            rough = {each: told(each, always, by_growing) for each in _others(best, always)}
            found = max(rough, key=lambda each: rough[each].score)
            newer = told(found, rough[found].state.members)
            if newer.score <= best.score:
                break
            best = newer
        story, stories = best.story, False
        best = _finer(best, places, rows, scene, weight, old)
        dictionary, members, sigma_mm = best.sums.dictionary, best.state.members, best.state.sigma_mm
        weight = weighed(rows, best.left_mm())
    assert best is not None
    return best


def _sigma_mm(rows: Rows, old: np.ndarray, weight: np.ndarray, mean: np.ndarray) -> float:
    return max(float(np.sqrt(np.average((rows.error_mm - old @ mean) ** 2, weights=weight))), LEAST_SIGMA_MM)


def _search(sums: Sums, story: Story, left: Left) -> Search:
    """Return the search for changes of a story."""
    blocks = _seldom(sums.dictionary.blocks, story.whole, story.anew, story.refit)
    return Search(Dictionary(blocks, sums.dictionary.columns), left.gram)


@lru_cache(maxsize=16)  # each story is searched more than once
def _seldom(blocks: tuple[Block, ...], whole: bool, anew: tuple[int, ...], refit: bool) -> tuple[Block, ...]:
    """Return blocks with the odds of changes: what a machine has since, it seldom has; what does not wear comes only
    with other parts. After a ``refit`` belts may well rest elsewhere at home."""

    def block(one: Block) -> Block:
        effect = EFFECTS[one.effect]
        if effect.of is not Of.MACHINE or whole or (refit and not effect.from_home):
            return one
        if effect.acts is Acts.DRIVE and one.where in anew:
            return one
        seldom = happens_share("changed" if wear_share(one.effect) else "replaced")
        return replace(one, log_odds=one.log_odds + math.log(seldom))

    return tuple(map(block, blocks))


def _changed(at: _Pass) -> bool:
    """Tell whether a story needs changes of the machine beside it."""
    return bool(_changes(at)) and not at.story.whole


def _changes(at: _Pass) -> list[Block]:
    blocks = [at.sums.dictionary.blocks[b] for b, _ in at.state.members]
    return [block for block in blocks if EFFECTS[block.effect].of is Of.MACHINE]


def _others(at: _Pass, always: Set) -> Iterator[Story]:
    """Yield the stories that tell one thing more than one does."""
    story = at.story
    other = math.log(happens_share("replaced"))
    for motor in range(2):
        own = [part for part in story.parts if _drives(part, motor)]
        if not own:
            continue
        rest = tuple(part for part in story.parts if not _drives(part, motor))
        yield replace(story, parts=rest, anew=(*story.anew, motor), log_odds=story.log_odds + other)
        if not story.turned_rad[motor] and any(part.effect in TURNING for part in own):
            by_rad = _likeliest_turn_rad(at, motor, always)
            turned_rad = (by_rad, story.turned_rad[1]) if motor == 0 else (story.turned_rad[0], by_rad)
            odds = story.log_odds + math.log(happens_share("turned"))
            yield replace(story, parts=turned(story.parts, motor, by_rad), turned_rad=turned_rad, log_odds=odds)
    yield replace(story, parts=(), anew=(0, 1), whole=True, log_odds=story.log_odds + 2 * other)


def _drives(part: Part, motor: int) -> bool:
    return EFFECTS[part.effect].acts is Acts.DRIVE and part.where == motor


def _likeliest_turn_rad(at: _Pass, motor: int, always: Set) -> float:
    """Return the angle by which a motor's pulley most likely turned."""
    blocks = at.sums.dictionary.blocks
    kept = [blocks[b] for b, _ in always] + [block for block in blocks if block.effect in ("place", "play")]
    columns = np.concatenate([np.arange(block.at.start, block.at.stop) for block in kept] or [np.zeros(0)]).astype(int)
    few = laid_side_by_side(kept)
    dictionary = Dictionary(few, np.zeros((0, len(columns))))
    members = tuple((b, 0) for b in range(len(few)))

    def score(by_rad: float) -> float:
        parts = turned(at.story.parts, motor, by_rad)
        mean = laid_out([part.draws_mm for part in parts], parts, at.like).mean(axis=1)
        left = at.sums.without(mean, np.zeros((len(mean), 0)), at.state.sigma_mm, columns)
        return Search(dictionary, left.gram).posterior(members, at.state.sigma_mm).score

    angles = np.arange(-PHASES // 2 + 1, PHASES // 2 + 1) * (2 * np.pi / PHASES)
    scores = np.array([score(float(each)) for each in angles])
    alike = angles[scores > scores.max() - ALIKE_NATS]
    best = float(alike[np.argmin(np.abs(alike))])
    around = best + 2 * np.pi / PHASES * np.linspace(-1.0, 1.0, 17)
    return float(around[np.argmax([score(float(each)) for each in around])])


def _finer(at: _Pass, places: Places, rows: Rows, scene: Scene, weight: np.ndarray, old: np.ndarray) -> _Pass:
    """Look for the shapes of the members between the neighbours of each."""
    for round_ in range(FINER_ROUNDS):
        dictionary = with_finer(at.sums.dictionary, at.state.members, round_, places, rows, scene)
        if dictionary is at.sums.dictionary:
            break
        sums = Sums(dictionary, gram_of(np.hstack([old, dictionary.columns]), rows, weight))
        left = sums.without(at.left.mean, at.left.ways, at.state.sigma_mm)
        state = searched(_search(sums, at.story, left), at.state.members, at.state.sigma_mm)
        at = replace(at, sums=sums, left=left, state=state)
    return at


def _now(at: _Pass, contacts: Contacts, scene: Scene, rng: np.random.Generator) -> Renewed:
    """Draw machines: changes as the search has them, and the old machine beside each."""
    search = _search(at.sums, at.story, at.left)
    nothing, _ = machine_of(scene, ())
    fit = Fit(scene, at.places, at.rows, contacts, search, at.state, nothing)
    found = posterior_here(fit, rng)
    where = {(b.effect, b.where, b.shape): b.at for b in at.sums.dictionary.blocks}
    changes = np.zeros((at.sums.own, DRAWS))
    for part in found.parts:
        changes[where[key_of(part)]] = part.draws_mm
    likely = np.zeros((at.sums.own, 1))
    likely[at.state.columns, 0] = at.state.mean_mm
    draws, acts = at.left.drawn_mm(changes, rng), at.left.sizes_mm(likely)[:, 0]
    kept = {key_of(part): part for part in at.story.parts}
    parts: dict[Key, Part] = {}
    first = 0
    for part in at.like:
        own = slice(first, first + len(part.acts_mm))
        first = own.stop
        if key_of(part) not in kept:
            continue
        if part.chance < SURE_CHANCE:
            parts[key_of(part)] = kept[key_of(part)]
        else:
            does = EFFECTS[part.effect].acts is not Acts.NOT
            parts[key_of(part)] = replace(part, acts_mm=acts[own] * does, draws_mm=draws[own])
    known = len(parts)
    for part in found.parts:
        had = parts.get(key_of(part))
        parts[key_of(part)] = part if had is None else replace(
            had, acts_mm=had.acts_mm + part.acts_mm, draws_mm=had.draws_mm + part.draws_mm
        )  # fmt: skip
    seldom = {key for key in kept if parts[key] is kept[key]}  # these act as they did
    now = tuple(part if key in seldom else after_homing(part, scene) for key, part in parts.items())
    posterior = Posterior(scene, now, known, found.noise_mm, found.nats)
    mechanism, _ = machine_of(scene, [part.acting() for part in posterior.parts if part.acts_mm.any()])
    told = tuple((block.effect, block.where, block.shape) for block in _changes(at))
    return Renewed(
        posterior, (), at.story, told, replace(fit, mechanism=mechanism), at.left_mm(), at.left.shifts(likely)
    )  # fmt: skip


def _homed_mm(now: Renewed, scene: Scene) -> tuple[tuple[float, float], ...]:
    """Return by how much the end stops of X and Y switched elsewhere than in the first print, where that was seen."""
    sd_mm = spread_mm(scene)
    seen = now.shifts[:, 1] < SEEN_SHARE
    if scene.corexy:
        if not seen.all():
            return ()
        at, own = scene.printer.from_motor((now.shifts[:, 0] * sd_mm)[None])[0], now.shifts[:, 1] * sd_mm
        return tuple((float(each), float(np.hypot(*own) / 2)) for each in at)
    return tuple((float(z * sd), float(own * sd)) for (z, own), sd in zip(now.shifts[seen], sd_mm[seen], strict=True))


def _columns(parts: Sequence[Part], places: Places, rows: Rows, scene: Scene) -> np.ndarray:
    """Return what the rows see [M, P] of parts."""
    own = [seen(part.effect, part.where, part.shape, places, rows, scene) for part in parts]
    return np.hstack([np.zeros((len(rows.mark), 0)), *own])


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
