"""From a trace to the effects that made it: contacts, weights and search in turn, until they agree."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from printmend.effects import EFFECTS, Places, Scene, Term, columns_of, places_of
from printmend.effects.breathing import PROFILE as BREATHS
from printmend.effects.effect import SCALE_MM, TIMES_FINER, done_of
from printmend.effects.prior import mild_shares, number_of, numbers_of, share_of, size_mm
from printmend.effects.pulley import SMOOTH
from printmend.effects.sized import CHUNK_ROWS, Sized, guided
from printmend.effects.switch import STEPS_A_TURN, spread_mm
from printmend.effects.teeth import TOOTH_MM
from printmend.infer.gram import (
    Block,
    Dictionary,
    Gram,
    Look,
    Rows,
    blocks_of,
    dictionary_of,
    gram_of,
    summed,
    with_blocks,
)
from printmend.infer.machine import machine_of
from printmend.infer.search import (
    LEAST_LOG_WEIGHT,
    LEAST_SIGMA_MM,
    Search,
    Set,
    State,
    alone,
    doubted,
    rivals_of,
    search_of,
    searched,
)
from printmend.machine import Contacts, Mechanism, contacts_of, healthy_mechanism
from printmend.metrics.robust import own_share, scale_of, weights_of
from printmend.path import Trace

MOST_MARKS = 1200  # marks for the search: more take time and give the same set
FEW_MARKS = 600  # that a first look is for
PASSES = 4  # of contacts, then search, at most
SETTLED_MM = 0.02  # belts that move less from pass to pass change the columns too little to matter
WEIGHINGS = 2  # of rows in each pass
FEW_ALIKE = 30  # numbers of one axis that count as much as the variance of all: an estimate to one digit
NEWS, MOST_NEWS = 0.25, 0.99  # share of a wall's place that is news: at first, and most
FEWEST_READ = 4  # with fewer marks a coordinate may look as if it had never been measured
BEGUN_WITH = ("place", "scale")  # a search from nothing may explain a pulley's size by a skewed frame, bit by bit
MOST_LOST_SHARE = 0.5  # of the numbers of one pass that the next must still see
WORSE = 1.02  # factor by which a pass may leave more than the one before
FINER_ROUNDS = 3  # in which a shape is looked for between its neighbours


@dataclass(frozen=True, eq=False)
class Fit:
    """A search and where it ended, for the rows of one measurement.

    ``turned_rad`` is by how much the measurement was turned back, about the middle of the bed: the rows have it as
    a linear effect again.
    """

    look: Look
    search: Search
    state: State
    turned_rad: float = 0.0

    @property
    def scene(self) -> Scene:
        return self.look.scene

    @property
    def places(self) -> Places:
        return self.look.places

    @property
    def rows(self) -> Rows:
        return self.look.rows

    @property
    def dictionary(self) -> Dictionary:
        return self.search.dictionary

    @property
    def blocks(self) -> tuple[Block, ...]:
        """The members of the likeliest set."""
        return tuple(self.dictionary.blocks[b] for b, _ in self.state.members)

    def parts(self) -> list[Sized]:
        """Return the members of the likeliest set with their sizes."""
        owned = zip(self.blocks, self.dictionary.own(self.state.members), strict=True)
        return [Sized(*block.key, self.state.mean_mm[own]) for block, own in owned]

    @cached_property
    def mechanism(self) -> Mechanism:
        """The machine of the likeliest set."""
        return machine_of(self.scene, self.parts())[0]

    def places_mm(self) -> np.ndarray:
        """Return where the set puts every row [N, 2]: the measurement without noise."""
        every = np.asarray(self.scene.printer.from_motor(self.places.motor_mm)) + self.moved_mm(self.parts())
        every -= _turned_mm(self.places, self.turned_rad, self.scene)
        return turned(every, self.turned_rad, self.scene)

    def moved_mm(self, parts: Iterable[Sized]) -> np.ndarray:
        """Return how far some effects move every row [N, 2]."""
        moved, own = np.zeros((len(self.places), 2)), list(parts)
        for at in range(0, len(moved), CHUNK_ROWS):
            some = self.places.at(np.arange(at, min(at + CHUNK_ROWS, len(moved))))
            for part in own:
                columns = columns_of(part.effect, some, part.where, part.shape, self.scene)
                moved[at : at + CHUNK_ROWS] += columns @ part.sizes_mm
        return moved

    def left_by_mark_mm(self, trace: Trace) -> np.ndarray:
        """Return the residual of every dot on the bed [N, 2] under the set, NaN where none was measured or
        understood."""
        known = trace.measured_rows & ~trace.wall_rows & (self.look.contacts.row >= 0).all(axis=1)
        return np.where(known[:, None], trace.measured_mm - self.places_mm(), np.nan)

    @property
    def freedom(self) -> float:
        """The effective number of sizes that the rows determine, the others being held by the prior (MacKay 1992)."""
        _, sds_mm = self.search.prior_of(self.state.members)
        return float(np.sum(1.0 - np.diag(self.state.covariance) / sds_mm**2))

    def left_mm(self) -> np.ndarray:
        """Return the residuals of the measured numbers [M] under the set."""
        return left_of(self.rows, self.dictionary, self.state)


def fitted(
    trace: Trace, scene: Scene, first: Fit | None = None, *, kept: Callable[[Term], bool] | None = None,
    names: Sequence[str] | None = None, quick: bool = False,
) -> Fit:  # fmt: skip
    """Return the effects that a trace shows; the first contacts are those of the ``first`` fit's machine, or of a
    healthy one. ``kept`` and ``names`` limit the terms and effects to look for; a ``quick`` fit uses few marks.

    If the result has an effect that is `LIKE_PLAY`, it is compared with a fit at the contacts of a machine that has
    play instead.
    """
    fit = _fitted(trace, scene, first, kept, names, quick=quick)
    if not any(block.effect in LIKE_PLAY for block in fit.blocks):
        return fit
    tight = _fitted(trace, scene, first, kept, unlike_play(names), quick=True)
    return max(fit, _fitted(trace, scene, tight, kept, names, quick=quick), key=lambda each: each.state.score)


def unlike_play(names: Sequence[str] | None = None) -> tuple[str, ...]:
    """Return the ``names`` (by default, those of all effects) without the effects that resemble play."""
    return tuple(name for name in names or EFFECTS if name not in LIKE_PLAY)


def _fitted(
    trace: Trace, scene: Scene, first: Fit | None, kept: Callable[[Term], bool] | None, names: Sequence[str] | None, *,
    quick: bool,
) -> Fit:  # fmt: skip
    """Return the fit to which these first contacts lead."""
    most = FEW_MARKS if quick else MOST_MARKS
    mechanism = healthy_mechanism(scene.printer) if first is None else first.mechanism
    turned_rad, parts = (0.0, []) if first is None else (first.turned_rad, first.parts())
    whole, fit = trace, None
    if scene.homed:
        scene = replace(scene, home_sd_mm=home_sd_of(mechanism, scene))
    blocks = blocks_of(scene, kept, names)
    for _ in range(PASSES):
        trace = turned_back(whole, turned_rad, scene)
        is_first = first is None and fit is None
        look = _with_turn(looked(trace, scene, mechanism, most, parts, is_first=is_first), turned_rad)
        count = len(look.rows.mark)
        if fit is not None and (
            count < MOST_LOST_SHARE * len(fit.rows.mark)  # with that play hardly a belt would ever touch
            or _settled(fit, look, turned_rad)
        ):
            break
        if fit is None:
            weight = weighed(look.rows, _left_by(mechanism, trace, look))
        else:
            weight = reweighed(look.rows, fit.left_mm()) if count == len(fit.rows.mark) else look.rows.weight
        newer = _searched(look, weight, fit, blocks, doubting=not quick)
        if fit is not None and _typical_mm(newer) > WORSE * _typical_mm(fit):
            break  # its contacts are no better than the last
        fit = replace(newer, turned_rad=turned_rad)
        mechanism, parts = fit.mechanism, fit.parts()
        turned_rad = 0.0 if trace.wall_rows.any() else turn_of(parts)
    assert fit is not None
    del look  # of a long trace it takes more than all the rest
    return fit if quick else _on_all_marks(fit, turned_back(whole, fit.turned_rad, scene))


def _settled(fit: Fit, look: Look, turned_rad: float) -> bool:
    """Tell whether a fit's machine touches where the fit took it to touch: another pass would find the same."""
    turned_mm = abs(turned_rad - fit.turned_rad) * SCALE_MM
    moved_mm = np.abs(look.places.bed_mm - fit.places.bed_mm).max()
    return bool(np.array_equal(look.contacts.row, fit.look.contacts.row) and max(moved_mm, turned_mm) < SETTLED_MM)


def looked(
    trace: Trace, scene: Scene, mechanism: Mechanism, most: int = MOST_MARKS, parts: Sequence[Sized] = (), *,
    is_first: bool,
) -> Look:  # fmt: skip
    """Look at a trace where the belts of a machine with these parts touch along it; a ``first`` look takes the places
    on the bed as they were measured."""
    worn_mm = worn(trace.commanded_mm, parts, scene)  # all of it is in the mechanism
    contacts = contacts_of(mechanism, scene.printer.to_motor(trace.commanded_mm), worn_mm - worn_mm[-1])
    bed_mm = first_places_mm(trace) if is_first else scene.printer.from_motor(contacts.belt_mm)
    places = guided(places_of(trace, scene, contacts.row, contacts.side, bed_mm), trace.commanded_mm, parts)
    return Look(scene, places, rows_of(trace, contacts, places, scene, most), contacts)


def worn(path_mm: np.ndarray, parts: Sequence[Sized], scene: Scene) -> np.ndarray:
    """Return how much play [N, 2] wear among some parts has added to each belt along a path [N, 2]."""
    wear_mm = [sum(part.sizes_mm[0] for part in parts if part.effect == "wear" and part.where == m) for m in (0, 1)]
    if not any(wear_mm):
        return np.broadcast_to(0.0, path_mm.shape)
    return np.outer(_done(path_mm, scene), wear_mm)


def _done(path_mm: np.ndarray, scene: Scene) -> np.ndarray:
    """Return how much of the measured print was done at each place [N] of a path [N, 2]."""
    return done_of(np.hypot(*np.diff(path_mm, axis=0, prepend=path_mm[:1]).T), scene)


def turned_back(trace: Trace, by_rad: float, scene: Scene) -> Trace:
    """Return a trace whose measured places are turned back about the middle of the bed: a turn is no linear effect."""
    if not by_rad or trace.wall_rows.any():
        return trace
    return replace(trace, measured_mm=turned(trace.measured_mm, -by_rad, scene))


def _turned_mm(places: Places, by_rad: float, scene: Scene) -> np.ndarray:
    """Return the linear effect of a turn on places [N, 2]."""
    return np.asarray(SCALE_MM * math.tan(by_rad) * columns_of("turn", places, 0, (), scene)[:, :, 0])


def _with_turn(look: Look, by_rad: float) -> Look:
    """Return a look at a trace that was turned back with the turn as a linear effect: sets without it are rivals."""
    rows = look.rows
    if not by_rad:
        return look
    more_mm = np.einsum("mc,mc->m", rows.along, _turned_mm(look.places.at(rows.mark), by_rad, look.scene))
    return look._replace(rows=replace(rows, error_mm=rows.error_mm + more_mm))


def turn_of(parts: Sequence[Sized]) -> float:
    """Return by how many rad the effects of a turn among some parts turn a print."""
    return math.atan(sum(part.sizes_mm[0] for part in parts if part.effect == "turn") / SCALE_MM)


def turned(places_mm: np.ndarray, by_rad: float, scene: Scene) -> np.ndarray:
    """Return places [N, 2] turned about the middle of the bed."""
    cos, sin = np.cos(by_rad), np.sin(by_rad)
    return (places_mm - scene.middle_mm) @ np.array([[cos, sin], [-sin, cos]]) + scene.middle_mm


def home_sd_of(mechanism: Mechanism, scene: Scene) -> tuple[float, float]:
    """Return how far each belt may rest from where the end stops would have it [2]."""
    first, second = np.hypot(spread_mm(scene, homings=1), mechanism.play_at_home_mm() / 2).tolist()
    return first, second


def first_places_mm(trace: Trace) -> np.ndarray:
    """Return where the marks are [N, 2] before any model says so: as measured, or else as commanded."""
    off_mm = trace.measured_mm - trace.commanded_mm
    if not trace.placed:
        off_mm = off_mm - _middle_mm(off_mm)
    return trace.commanded_mm + np.where(np.isfinite(off_mm), off_mm, 0.0)


def _middle_mm(off_mm: np.ndarray) -> np.ndarray:
    """Return the median [2] of what places are off [N, 2], 0 where walls alone were measured."""
    known = np.isfinite(off_mm).all(axis=1)
    return np.asarray(np.median(off_mm[known], axis=0)) if known.any() else np.zeros(2)


def _on_all_marks(fit: Fit, trace: Trace) -> Fit:
    """Return a fit to every mark of a long trace: a search that starts at the likeliest set, among what may be beside
    it."""
    rows = rows_of(trace, fit.look.contacts, fit.places, fit.scene, len(trace))
    rows = _with_turn(fit.look._replace(rows=rows), fit.turned_rad).rows
    if len(rows.mark) <= len(fit.rows.mark):
        return fit
    rows = _by_axis(rows, _variances_mm2(fit.rows, fit.left_mm()))
    gains = fit.search.gains(fit.state, fit.search.offered(fit.state.members))
    beside = np.unique(gains.keys[gains.values > LEAST_LOG_WEIGHT, 0])
    few = fit.search.narrowed([*fit.blocks, *(fit.dictionary.blocks[b] for b in beside)])
    keys = [block.key for block in few.dictionary.blocks]
    known = slice(0, len(fit.state.columns))  # the members come first

    def gram(first: int) -> Gram:
        part = rows.some(slice(first, first + CHUNK_ROWS))
        some = fit.look._replace(rows=part).columns(keys)
        left_mm = part.error_mm - some[:, known] @ fit.state.mean_mm
        away = left_mm * np.sqrt(part.weight) / fit.state.sigma_mm
        return gram_of(some, part, part.weight * weights_of(away, 1.0))

    grams = map(gram, range(0, len(rows.mark), CHUNK_ROWS))
    search = replace(few, gram=summed(grams, few.dictionary.columns.shape[1]))
    state = searched(search, alone(fit.state.members), fit.state.sigma_mm)
    return replace(fit, search=search, state=state)


def _left_by(mechanism: Mechanism, trace: Trace, look: Look) -> np.ndarray:
    """Return what a first machine leaves of the measured numbers [M], but for what the measurement's origin may be."""
    off_mm = trace.measured_mm - mechanism.bed.printed(look.contacts.belt_mm)
    off_mm = off_mm - _middle_mm(off_mm)
    left_mm = np.einsum("mc,mc->m", look.rows.along, off_mm[look.rows.mark])
    return np.where(np.isfinite(left_mm), left_mm, 0.0)


def _typical_mm(fit: Fit) -> float:
    return float(np.median(np.abs(fit.left_mm())))


def _searched(look: Look, weight: np.ndarray, last: Fit | None, blocks: tuple[Block, ...], *, doubting: bool) -> Fit:
    """Return the likeliest set for rows. With ``doubting`` the last weighing doubts each of its members."""
    dictionary, rows = dictionary_of(blocks, look), look.rows
    members: Set = tuple(
        (b, 0) for b, block in enumerate(dictionary.blocks) if block.log_odds[0] > 0 or block.effect in BEGUN_WITH
    )
    sigma_mm = first_sigma_mm(rows.error_mm, weight)
    if last is not None:
        dictionary, members = _as_before(dictionary, last, look)
        sigma_mm = last.state.sigma_mm
    state: State | None = None
    for weighing in range(WEIGHINGS):
        search = search_of(dictionary, rows, weight)
        state = searched(search, members, sigma_mm)
        if doubting and weighing == WEIGHINGS - 1:
            state = doubted(search, state)
        search, state = _finer(search, state, look._replace(rows=rows), weight)
        dictionary, members, sigma_mm = search.dictionary, state.members, state.sigma_mm
        left_mm = left_of(rows, dictionary, state)
        weight, rows = reweighed(rows, left_mm), shared(rows, left_mm)
    assert state is not None
    return Fit(look._replace(rows=rows), search, state)


def _as_before(dictionary: Dictionary, last: Fit, look: Look) -> tuple[Dictionary, Set]:
    """Return the dictionary with the finer shapes of the last pass, and the last set in it."""
    known = {block.key for block in dictionary.blocks}
    missed = [block for block in last.blocks if block.key not in known]
    dictionary = with_blocks(dictionary, missed, look)
    numbers = {block.key: b for b, block in enumerate(dictionary.blocks)}
    members = zip(last.blocks, last.state.members, strict=True)
    return dictionary, tuple((numbers[block.key], variant) for block, (_, variant) in members)


def with_finer(dictionary: Dictionary, members: Set, round_: int, look: Look) -> Dictionary:
    """Return the dictionary with finer shapes about those of a set's members.

    The search counts a finer shape for less than the first one. In the posterior the first one and its finer ones share
    its odds evenly. In round 0 these are the odds of the grid's shape that it came from.
    """
    blocks, more = list(dictionary.blocks), []
    for b, _ in members:
        block, coarse = blocks[b], blocks[b].coarse or blocks[b]
        finer = list(EFFECTS[block.effect].finer(block.where, block.shape, round_, look.scene))
        odds = block.own_odds if round_ else float(coarse.log_odds[0] - block.log_odds[0])
        shared = odds - math.log(len(finer) + 1)
        less = replace(block, log_odds=block.log_odds - math.log(TIMES_FINER), own_odds=shared + math.log(TIMES_FINER))
        blocks[b] = replace(block, own_odds=shared)
        more += [replace(less, coarse=coarse, shape=shape) for shape in finer]
    return with_blocks(replace(dictionary, blocks=tuple(blocks)), more, look) if more else dictionary


def _finer(search: Search, state: State, look: Look, weight: np.ndarray) -> tuple[Search, State]:
    """Look for better shapes of a set's members, between the neighbours of each on its grid: first among the members
    alone, then with all other blocks again. Where places are known, an error of the measurement is suspect, so its best
    rival of the machine takes part; a scanner does err."""
    rows, rivals = look.rows, rivals_of if look.scene.placed else lambda *_: ()
    members = list(dict.fromkeys(b for b, _ in (*state.members, *rivals(search, state))))
    among = search.narrowed([search.dictionary.blocks[b] for b in members])
    first, own, sigma_mm = len(among.gram.slope), alone(state.members), state.sigma_mm
    sought: Set = tuple((at, 0) for at in range(len(members)))
    for round_ in range(FINER_ROUNDS):
        dictionary = with_finer(among.dictionary, sought, round_, look)
        if dictionary is among.dictionary:
            break
        among = search_of(dictionary, rows, weight)
        found = searched(among, own, sigma_mm)
        own, sigma_mm = found.members, found.sigma_mm
        sought = (*own, *rivals(among, found))
    shared, blocks = among.dictionary.blocks[: len(members)], among.dictionary.blocks[len(members) :]
    if not blocks:
        return search, state
    before = _in_place_of(search.dictionary.blocks, dict(zip(members, shared, strict=True)))
    dictionary, count = replace(search.dictionary, blocks=tuple(before)), len(search.dictionary.blocks)
    search = search_of(dictionary.with_more(blocks, among.dictionary.columns[:, first:]), rows, weight)
    if own == alone(state.members):
        return search, state
    numbers = [*members, *range(count, count + len(blocks))]
    return search, searched(search, tuple((numbers[b], variant) for b, variant in own), sigma_mm)


def _in_place_of(blocks: Sequence[Block], shared: Mapping[int, Block]) -> Iterator[Block]:
    """Yield blocks of which some are ``shared`` with finer ones now: the posterior has these in place of the shapes of
    the grid that they came from, and of what was finer about others."""
    gone = {(each.coarse.slot, each.coarse.shape) for each in shared.values() if each.coarse is not None}
    for b, block in enumerate(blocks):
        if b in shared:
            yield replace(block, own_odds=shared[b].own_odds)
        elif block.coarse is not None or (block.slot, block.shape) in gone:
            yield replace(block, own_odds=-math.inf)
        else:
            yield block


def left_of(rows: Rows, dictionary: Dictionary, state: State) -> np.ndarray:
    """Return the residuals of the measured numbers [M] under a set."""
    return np.asarray(rows.error_mm - dictionary.columns[:, state.columns] @ state.mean_mm)


def first_sigma_mm(left_mm: np.ndarray, weight: np.ndarray) -> float:
    """Return a first guess of the noise from residuals [M] with weights [M]."""
    return max(float(np.sqrt(np.average(left_mm**2, weights=weight))), LEAST_SIGMA_MM)


def weighed(rows: Rows, left_mm: np.ndarray) -> np.ndarray:
    """Return the weights [M] of rows from their residuals, with a scale from the median."""
    away = np.abs(left_mm) * np.sqrt(rows.weight)
    return rows.weight * weights_of(away, scale_of(away, max(LEAST_SIGMA_MM, rows.least_mm)))


def reweighed(rows: Rows, left_mm: np.ndarray) -> np.ndarray:
    """Return the weights [M] of rows from the residuals of a set, with a scale for each axis."""
    return weighed(_by_axis(rows, _variances_mm2(rows, left_mm)), left_mm)


def _variances_mm2(rows: Rows, left_mm: np.ndarray) -> np.ndarray:
    """Return the variances of residuals along X and Y [2], because some instruments measure one axis less exactly, such
    as a scanner whose carriage jitters. Each is a mean of the axis's own variance and that of all residuals, which
    counts as much as `FEW_ALIKE` numbers."""
    away, least_mm = np.abs(left_mm) * np.sqrt(rows.weight), max(LEAST_SIGMA_MM, rows.least_mm)
    whole_mm2, found = scale_of(away, least_mm) ** 2, []
    for own in (away[numbers] for numbers, _ in rows.by_axis[:2]):
        own_mm2 = scale_of(own, least_mm) ** 2 if len(own) else 0.0
        found.append((FEW_ALIKE * whole_mm2 + len(own) * own_mm2) / (FEW_ALIKE + len(own)))
    return np.array(found)


def _by_axis(rows: Rows, variances_mm2: np.ndarray) -> Rows:
    """Return rows weighted by variances along X and Y [2]. The mean logarithm of the weights stays as it is."""
    variance = np.square(rows.along) @ variances_mm2
    return replace(rows, weight=rows.weight * np.exp(np.log(variance).mean()) / variance)


def shared(rows: Rows, left_mm: np.ndarray) -> Rows:
    """Return rows of which walls count by how much news each is: a bead is too wide or too narrow for a while."""
    walls = rows.share < 1.0
    if not walls.any():
        return rows
    left = left_mm[walls]
    news = min(own_share(left, scale_of(left, 0.0)), MOST_NEWS)
    return replace(rows, share=np.where(walls, news, 1.0))


def rows_of(trace: Trace, contacts: Contacts, places: Places, scene: Scene, most: int) -> Rows:
    """Return the measured numbers of a trace: two for each mark that both belts had touched before, one for a wall.

    One for a mark, too, where one coordinate was read: an instrument of one axis leaves the other as commanded.
    """
    touched = (contacts.row >= 0).all(axis=1)
    nominal = np.asarray(scene.printer.from_motor(places.motor_mm))  # where healthy belts would be
    off = trace.measured_mm - nominal
    weight = np.ones(len(trace))
    if trace.sigma_mm is not None and (known := np.isfinite(trace.sigma_mm) & (trace.sigma_mm > 0)).any():
        usual = float(np.median(trace.sigma_mm[known]))
        weight = np.where(known, (usual / np.where(known, trace.sigma_mm, usual)) ** 2, 1.0)
    walls = np.flatnonzero(trace.wall_rows & touched)
    dots = np.flatnonzero(trace.measured_rows & ~trace.wall_rows & touched)
    dots = dots[np.linspace(0, len(dots) - 1, min(len(dots), most)).astype(np.int64)]  # spread over the print
    read = [dots if _was_read(trace, dots, k) else dots[:1] for k in range(2)]
    mark = np.concatenate([*read, walls])
    normal = trace.normal[walls] if trace.normal is not None else np.zeros((0, 2))
    offset = np.zeros(0)
    if trace.offset_mm is not None:
        ahead = (trace.commanded_mm - nominal)[walls]
        offset = trace.offset_mm[walls] + (normal * ahead).sum(axis=1)
    error = np.concatenate([off[read[0], 0], off[read[1], 1], offset])
    along = np.concatenate(
        [*(np.tile(axis, (len(some), 1)) for axis, some in zip(np.eye(2), read, strict=True)), normal]
    )
    share = np.concatenate([np.ones(len(mark) - len(walls)), np.full(len(walls), NEWS)])
    weight = weight[mark]
    return Rows(mark, along, error, weight, share, trace.rounding_mm)


def _was_read(trace: Trace, dots: np.ndarray, axis: int) -> bool:
    """Tell whether an instrument looked along an axis: else that neither moved nor differs at any of these marks, and
    one of them tells where it stood."""
    return len(dots) < FEWEST_READ or any(np.ptp(mm[dots, axis]) > 0 for mm in (trace.commanded_mm, trace.measured_mm))


# A first machine of a trace, from a healthy one: how long the motors' turns are, and contacts that are nearly right.
#
# First come the effects that do not turn. Then pulleys of many circumferences are tried beside them, by their first
# harmonics and those of their play. A circumference that gains more than the printer's own is a rival: both are fitted,
# and the likelier one stays.

# Effects that do not turn, and those that decide where a belt touches.
STILL = (
    "place", "scale", "bend", "play", "soft_play", "loose", "friction", "skew", "aspect", "wobble", "skip", "origin",
    "shift", "turn", "stretch", "paper", "digits",
)  # fmt: skip
LIKE_PLAY = ("loose", "soft_play")  # play resembles them where belts are thought to touch elsewhere
FEW = (*STILL, "pulley", "breathing", "elastic", "idler", "bent")
REPEATING = ("pulley", "breathing", "elastic", "idler")  # effects whose place a turn of another length takes
ALIKE_MM = 0.2  # by which a skip may differ from whole electrical turns: a turn that is lost also turns the pulley
NEAR_SPACING = 0.0025  # half the distance of lengths that are tried, as a share
NEAR_SHARES = 2 * NEAR_SPACING * np.arange(-8, 9)  # by which calibrated steps let a turn differ from the printer's
ROUND_MOST, BREATH_MOST = 4, 2  # harmonics of a turn that is tried, and of its play
SHARPER_NATS = 12.0  # a length between two tried ones may gain so much
LENGTH_ROUNDS, FINER = 4, np.linspace(-1.0, 1.0, 5)  # lengths about one that was found, in each round


@dataclass(frozen=True)
class Turn:
    """A length of one motor's turn, and the logarithm of its odds against the printer's own."""

    motor: int
    length_mm: float
    log_odds: float = 0.0

    def of(self, scene: Scene) -> Scene:
        """Return the scene in which the motor turns by this length."""
        lengths = list(scene.turns_mm)
        lengths[self.motor] = self.length_mm
        return replace(scene, turns_mm=(lengths[0], lengths[1]))


def begun(trace: Trace, scene: Scene) -> tuple[Fit, Trace]:
    """Return a fit of few effects, in whose scene the motors' turns are as long as the trace says, and the trace as the
    motors really went: where one lost steps, its pulley turned by less. Each length is judged at its own contacts."""

    def told(scene: Scene, before: Fit | None, names: tuple[str, ...] = FEW) -> Fit:
        fit = fitted(trace, scene, before, kept=_is_told_at_first, names=names, quick=True)
        return replace(fit, look=fit.look.narrowed())

    still = told(scene, None, STILL)
    best, odds = told(scene, still), 0.0
    for round_, base in enumerate((still, None)):
        rivals = [rival for motor in range(2) if (rival := _rival(base or best, motor, near=round_ > 0)) is not None]
        for turn, _ in sorted(rivals, key=lambda each: -each[1]):
            other = told(turn.of(best.scene), best if round_ else still)
            if other.state.score + turn.log_odds > best.state.score + odds:
                best, odds = other, odds + turn.log_odds
    return best, _as_turned(trace, best)


def _is_told_at_first(term: Term) -> bool:
    """Tell whether play does not resemble a term while contacts are unknown: what builds up over less than its width
    does."""
    return term.effect != "soft_play" or term.shape[0] >= number_of("play", "widest")


def _as_turned(trace: Trace, fit: Fit) -> Trace:
    """Return a trace whose motors go as far as they turned, without the steps that they lost."""
    lost_mm = np.zeros((len(trace), 2))
    done = _done(trace.commanded_mm, fit.scene)
    for part in fit.parts():
        if part.effect != "skip":
            continue
        size_mm, turn_mm = part.sizes_mm[0], STEPS_A_TURN * fit.scene.printer.axes[part.where].mm_per_step
        turns_mm, teeth_mm = (each * round(size_mm / each) for each in (turn_mm, TOOTH_MM))
        if abs(size_mm - turns_mm) < min(abs(size_mm - teeth_mm), ALIKE_MM):
            lost_mm[done > part.shape[0], part.where] += turns_mm
    if not lost_mm.any():
        return trace
    return replace(trace, commanded_mm=trace.commanded_mm + fit.scene.printer.from_motor(lost_mm))


def _rival(fit: Fit, motor: int, *, near: bool) -> tuple[Turn, float] | None:
    """Return the turn of a motor that is likelier than the one that a fit has, and by how much; None where none is.

    ``near`` tries only those near it, where the fit's wave fades along the belt: one of another length would look so.
    """
    if near and not any(_repeats(block, motor) for block in fit.blocks):
        return None
    beside = _beside(fit, motor)
    tried = [Turn(motor, fit.scene.turns_mm[motor]), *_lengths(fit.scene, motor, near=near)]
    own, *gains = beside(tried)
    best = tried[1 + int(np.argmax(gains))]
    if max(gains) < own - SHARPER_NATS:
        return None
    best, gain = _sharpened(best, fit.scene, beside)
    return (best, gain - own) if gain > own else None


def _lengths(scene: Scene, motor: int, *, near: bool) -> Iterator[Turn]:
    """Yield the lengths of a turn that are tried."""
    own_mm = scene.turns_mm[motor]
    fewest, most = numbers_of("other_turn", "teeth")
    whole = np.multiply(TOOTH_MM, np.arange(fewest, most + 1)).tolist()
    teeth = [length for length in whole if own_mm % length]  # else a part of its turn
    close = [own_mm * (1 + share) for share in NEAR_SHARES if share]
    for lengths in (close,) if near else (teeth, close):
        log_odds = math.log(share_of("other_turn") / 2 / len(lengths))
        yield from (Turn(motor, length_mm, log_odds) for length_mm in lengths)


def _beside(fit: Fit, motor: int) -> Callable[[Sequence[Turn]], list[float]]:
    """Return the function that tells how likely each of some turns of a motor is, beside all of a fit but what repeats
    along that motor: the score of the set with a pulley of that turn, whose play breathes or not, and its log odds."""
    blocks, members, rows = fit.dictionary.blocks, fit.state.members, fit.rows
    kept: Set = tuple(one for one in members if not _repeats(blocks[one[0]], motor))
    weight = reweighed(rows, fit.left_mm())
    dictionary = fit.search.narrowed([blocks[b] for b, _ in kept]).dictionary
    beside = search_of(dictionary, rows, weight).posterior(alone(kept), fit.state.sigma_mm, rounds=0)
    keys = ("pulley", motor, (ROUND_MOST,)), ("breathing", motor, (BREATH_MOST,))
    sizes, count = _sizes_mm(), len(kept)
    own = Block("pulley", motor, (), slice(0, sizes.shape[1]), sizes, np.zeros(len(sizes)))

    def scores(turns: Sequence[Turn]) -> list[float]:
        new = [fit.look._replace(scene=turn.of(fit.scene)).columns(keys) for turn in turns]
        search = search_of(dictionary.with_more([own] * len(turns), np.hstack(new)), rows, weight)
        gains = search.gains(beside, count + np.arange(len(turns))).values.reshape(len(turns), -1)
        likeliest = enumerate(np.argmax(gains, axis=1).tolist(), start=count)
        found = [search.posterior((*beside.members, one), beside.sigma_mm).score for one in likeliest]
        return [score + turn.log_odds for score, turn in zip(found, turns, strict=True)]

    return scores


def _repeats(block: Block, motor: int) -> bool:
    """Tell whether an effect repeats along a motor."""
    return block.effect in REPEATING and block.where == motor


def _sizes_mm() -> np.ndarray:
    """Return how large the harmonics of a turn that is tried may be [V, P], with play that breathes and without."""
    pulley = size_mm("pulley") * np.tile(SMOOTH[:ROUND_MOST], 2)
    play = size_mm("breathing") * np.tile(BREATHS[:BREATH_MOST], 2)
    return np.array([np.concatenate([mild * pulley, mild * own]) for mild in mild_shares() for own in (0 * play, play)])


def _sharpened(turn: Turn, scene: Scene, beside: Callable[[Sequence[Turn]], list[float]]) -> tuple[Turn, float]:
    """Return the turn between those that were tried, or with a whole number of teeth where that is as likely."""
    spacing, gain = NEAR_SPACING, -np.inf
    for _ in range(LENGTH_ROUNDS):
        around = [replace(turn, length_mm=turn.length_mm * (1 + spacing * each)) for each in FINER]
        gains = beside(around)
        turn, gain = around[int(np.argmax(gains))], max(gains)
        spacing /= 2
    toothed = replace(turn, length_mm=TOOTH_MM * round(turn.length_mm / TOOTH_MM))
    if toothed.length_mm != scene.turns_mm[turn.motor]:
        (other,) = beside([toothed])
        turn, gain = max((turn, gain), (toothed, other + number_of("other_turn", "toothed")), key=lambda each: each[1])
    return turn, gain
