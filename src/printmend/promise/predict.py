"""The predictive distribution of a print's error, with all uncertainties included.

Near the right parameters, the machine is linear in them. So an error along the path is that of the model plus G z, z ~
N(0, 1), plus errors that are independent at each point (the unexplained scatter, half a micro-step). A hundred machines
are drawn; the 90 % range is that of their prints (JCGM 101:2008, propagation by Monte Carlo).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from threadpoolctl import threadpool_limits

from printmend.effects import EFFECTS, Of, Places, Scene, columns_of
from printmend.effects.effect import HARDLY_ANY, LINEAR, LONG_MM, NEARLY_ALL, SEED, TINY_MM, name_of
from printmend.effects.prior import number_of, numbers_of
from printmend.effects.switch import drawn_shifts_mm
from printmend.infer.machine import DRAWS, Part
from printmend.machine import Mechanism
from printmend.path import Motion
from printmend.promise.belief import Belief

# Shift each drawn machine's waves to where the next homing may put them.


def after_homing(belief: Belief) -> Belief:
    """Return what is believed of the machine once it has homed again, each draw with a homing of its own."""
    by_mm = _homings_mm(belief.scene)
    return replace(belief, parts=tuple(part.moved(by_mm, belief.scene) for part in belief.parts))


def _homings_mm(scene: Scene, homings: int = 2) -> np.ndarray:
    """Return the same homings for a machine each time, independent of what else is drawn."""
    return drawn_shifts_mm(scene, DRAWS, np.random.default_rng(SEED).spawn(1)[0], homings=homings)


PACES = 6  # that the next print may have
MOST_PLACES = 512  # most places of a path that are evaluated: 2048 change no figure by more than another seed does
LOW, HIGH = HARDLY_ANY, NEARLY_ALL  # quantiles of the drawn machines that bound the 90 % range
UNSHOWN_MM, UNSHOWN_SD = number_of("unshown", "median"), number_of("unshown", "log_sd")  # lines at speed narrow it
CELL_MM = number_of("unshown", "length")  # over which errors are alike
LASTING = ("scatter", "motion")  # local causes whose errors are alike at neighbouring places, as rounding is not
STANDS_SHARE = 1e-3  # of a move's length that a motor may go and yet stands still: rounded coordinates move it
# Normal values, and the logarithm of minus the logarithm of the chance that one is not larger.
_NORMAL = np.linspace(8.0, -6.0, 1401)
_CHANCE_LOG = np.array([math.log(-math.log1p(-0.5 * math.erfc(each / math.sqrt(2)))) for each in _NORMAL])


def _median(values: np.ndarray) -> float:
    """Return the median; numpy's own imports masked arrays, which takes longer than the sum of a small file."""
    return float(np.quantile(values, 0.5))


@dataclass(frozen=True, eq=False)
class DrawnCause:
    """Errors of one cause at N places of a print, for D drawn machines: ``columns`` [N, K] @ ``drawn`` [K, D]."""

    columns: np.ndarray
    drawn: np.ndarray

    def beside(self, other: "DrawnCause") -> "DrawnCause":
        """Return the sum of both."""
        return DrawnCause(np.hstack([self.columns, other.columns]), np.vstack([self.drawn, other.drawn]))


@dataclass(frozen=True, eq=False)
class PathPlaces:
    """N places at even distances along an extruded path.

    ``wanted_mm`` [N, 2] are the places on the bed and ``tangent`` [N, 2] the path's unit directions. ``off_mm`` [N] is
    by how much the file as it is prints to the left of the path, ``side`` [N, 2] the side of its belt that each motor
    pushed before the move, ``weight`` [N] the length of path that a place stands for. ``z_mm`` [N] is its height, where
    known; ``gone_mm`` [N] the length of the print up to there, None where it is the sum of the weights; ``ways`` [N, 2]
    the last direction of each of the bed's axes before the move, at rest before the place; None where unknown.
    ``strokes_mm`` [N, 2, STROKES] is how far each motor has gone since it last turned round, as of `Places`.
    """

    wanted_mm: np.ndarray
    tangent: np.ndarray
    off_mm: np.ndarray
    side: np.ndarray
    weight: np.ndarray
    z_mm: np.ndarray | None = None
    gone_mm: np.ndarray | None = None
    ways: np.ndarray | None = None
    strokes_mm: np.ndarray | None = None


@dataclass(frozen=True)
class Errors:
    """What a machine that is exactly as its model says makes of a print: distances from the wanted path [mm]."""

    rms_mm: float
    p95_mm: float
    max_mm: float


@dataclass(frozen=True)
class Promise:
    """The expected distance of a print from the target path [mm].

    ``rms_mm`` with its 90 % range, ``p95_mm`` and ``max_mm`` are those of the shape; each homing shifts the whole
    print, by ``place_mm`` in the median. In 19 of 20 cases, 95 % of the path is within ``p95_mm``, and no point of the
    print is off by more than ``max_mm``. ``planning_rms_mm`` is the error if the model is exact. ``made_of`` are the
    standard uncertainties by cause: roots of mean squares over the drawn machines, in which a rare and large error
    counts more than in the median ``rms_mm``.
    """

    rms_mm: float
    p95_mm: float
    max_mm: float
    rms_low_mm: float
    rms_high_mm: float
    place_mm: float
    planning_rms_mm: float
    made_of: Mapping[str, float] = field(default_factory=dict)

    @property
    def combined_mm(self) -> float:
        """The combined standard uncertainty (JCGM 100:2008, 5.1)."""
        return math.hypot(*self.made_of.values())


def without_doubt(errors: Errors) -> Promise:
    """Return what a model that says nothing of its own doubt can say."""
    rms = errors.rms_mm
    return Promise(rms, errors.p95_mm, errors.max_mm, rms, rms, 0.0, rms, {"planning": rms})


@dataclass(frozen=True, eq=False)
class Outlook:
    """The prediction for a file as it is (``before``) and mended (``after``).

    ``gain_mm`` [DRAWS] is by how much mending lowers the RMS error of each drawn machine: the error of the shape and,
    if the measurement has positions on the bed, the known shift. The estimate is cautious: an unexplained pattern may
    be larger for the mended moves, and counts as independent of the known errors.
    """

    before: Promise
    after: Promise
    gain_mm: np.ndarray


def promised(
    mechanism: Mechanism, belief: Belief, path: PathPlaces, before: Errors, after: Errors, *, at_rest: bool = False
) -> Outlook | None:
    """Return what to expect of both files, None for an empty path.

    With ``at_rest`` the places are marks, and the sides that the motors push are those that the path states; else they
    follow from its tangents.
    """
    if not len(path.weight) or path.weight.sum() <= 0:
        return None
    with threadpool_limits(1, user_api="blas"):  # the products are small: a second thread would only be waited for
        return _outlook(mechanism, belief, _thinned(path), (before, after), at_rest)


def _outlook(
    mechanism: Mechanism, belief: Belief, path: PathPlaces, errors: tuple[Errors, Errors], at_rest: bool,
) -> Outlook:  # fmt: skip
    rng = np.random.default_rng(SEED)
    local = _local(mechanism, belief, path, rng)
    fates = rng.uniform(size=(len(belief.parts), DRAWS))
    paces = np.ones(DRAWS) if at_rest else _paces()
    both, homed = _places(mechanism, path, belief.scene, at_rest), after_homing(belief).parts
    sides = [_parts(belief, homed, path, places, fates, paces) for places in both]
    homes_mm = _homings_mm(belief.scene, homings=1)
    if not belief.placed:
        homes_mm = homes_mm + _rests_mm(mechanism, rng)
        sides = [{name: _unturned(cause, path) for name, cause in each.items()} for each in sides]
    at_mm = mechanism.printer.from_motor(homes_mm.T).T
    raw = _Side(path, path.off_mm, sides[0], local, errors[0], signed=True)
    mended = _Side(path, np.zeros_like(path.off_mm), sides[1], local, errors[1], signed=False)
    along = rng.uniform(-1.0, 1.0, DRAWS)
    (before, raw_mm), (after, mended_mm) = (
        _summed_up(each, at_mm, along, rng, placed=belief.placed) for each in (raw, mended)
    )  # fmt: skip
    strange = {"scatter", *(name for name in after.made_of if name in EFFECTS)}
    strange2 = number_of("next", "otherwise") ** 2 * sum(after.made_of[name] ** 2 for name in strange)
    return Outlook(before, after, raw_mm - np.sqrt(mended_mm**2 + strange2))


@dataclass(frozen=True, eq=False)
class _Side:
    """One of the two files, and its errors across the path.

    ``off_mm`` [N] are those that the model predicts. By cause, ``doubt`` holds the errors of the drawn machines and
    ``local`` the variances of what differs from place to place. ``known`` is the model's own summary; where ``signed``,
    ``off_mm`` holds all of that but the largest error.
    """

    path: PathPlaces
    off_mm: np.ndarray
    doubt: dict[str, DrawnCause]
    local: dict[str, DrawnCause]
    known: Errors
    signed: bool


def _thinned(path: PathPlaces) -> PathPlaces:
    """Return `MOST_PLACES` of a path's places, their predicted errors scaled to the RMS of the shape's."""
    count = len(path.weight)
    if count <= MOST_PLACES:
        return path
    at = np.floor((np.arange(MOST_PLACES) + 0.5) * count / MOST_PLACES).astype(np.int64)
    edges = np.concatenate([[0], (at[1:] + at[:-1] + 1) // 2, [count]])
    weight = np.add.reduceat(path.weight, edges[:-1])
    others = (None if each is None else each[at] for each in (path.z_mm, path.gone_mm, path.ways, path.strokes_mm))
    few = PathPlaces(path.wanted_mm[at], path.tangent[at], path.off_mm[at], path.side[at], weight, *others)
    whole_mm, seen_mm = (shape_of(each) for each in (path, few))
    whole2, seen2 = np.average(whole_mm**2, weights=path.weight), np.average(seen_mm**2, weights=weight)
    return replace(few, off_mm=few.off_mm * np.sqrt(whole2 / seen2)) if seen2 > TINY_MM**2 else few


def shape_of(path: PathPlaces) -> np.ndarray:
    """Return the errors across a path [N] less the best shift of the whole part: the errors of its shape."""
    return np.asarray(path.off_mm - _normals(path.tangent) @ best_shift(path.tangent, path.off_mm, path.weight))


def best_shift(tangent: np.ndarray, off_mm: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Return the shift [2] mm of a whole part that leaves the least of its errors across the path [N]."""
    root = np.sqrt(weight)
    return np.asarray(np.linalg.lstsq(_normals(tangent) * root[:, None], off_mm * root, rcond=None)[0])


def _unturned(cause: DrawnCause, path: PathPlaces) -> DrawnCause:
    """Return a cause less what turns all of a print: where no place was measured, nobody knows how a print lay, and
    drawn machines differ in that though their shapes are alike."""
    normal, root = _normals(path.tangent), np.sqrt(path.weight)[:, None]
    arm = path.wanted_mm - np.average(path.wanted_mm, axis=0, weights=path.weight)
    turn = (normal[:, 1] * arm[:, 0] - normal[:, 0] * arm[:, 1])[:, None]
    found = np.linalg.lstsq(np.hstack([normal, turn]) * root, cause.columns * root, rcond=None)[0]
    return DrawnCause(cause.columns - turn * found[2], cause.drawn)


def _normals(tangent: np.ndarray) -> np.ndarray:
    return np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)


def _places(mechanism: Mechanism, path: PathPlaces, scene: Scene, at_rest: bool) -> tuple[Places, Places]:
    """Return the places of a path with the motors where the file as it is has them, and where the mended one does."""
    printer = mechanism.printer
    belt = printer.to_motor(mechanism.frame.invert(path.wanted_mm))
    way = printer.to_motor(path.tangent)
    side = path.side if at_rest else np.where(np.abs(way) > STANDS_SHARE, np.sign(way), path.side)
    ways = np.zeros_like(path.tangent) if path.ways is None else path.ways  # an axis that stands still went so before
    if not at_rest:
        ways = np.where(np.abs(path.tangent) > STANDS_SHARE, np.sign(path.tangent), ways)
    gone_mm = np.cumsum(path.weight) if path.gone_mm is None else path.gone_mm
    raw = Places(
        printer.to_motor(path.wanted_mm), -side, np.asarray(printer.from_motor(belt)), ways,
        gone_mm / max(scene.way_mm, 1e-9), np.full(len(belt), LONG_MM), np.zeros_like(belt), path.z_mm,
        None if at_rest else path.tangent, path.strokes_mm,
    )  # fmt: skip
    return raw, replace(raw, motor_mm=mechanism.motors_at(belt, side))


def _across(mechanism: Mechanism, path: PathPlaces) -> np.ndarray:
    """Return by how much a print moves to the left of its path for a millimetre of each belt [N, 2]."""
    return np.asarray(_normals(path.tangent) @ mechanism.printer.from_motor(np.eye(2)).T)


def _rests_mm(mechanism: Mechanism, rng: np.random.Generator) -> np.ndarray:
    """Return how far each belt [2, DRAWS] rests within its play at home, where the measurement does not show that: half
    of the drawn machines have it engaged, and the others anywhere in its play."""
    shift = np.zeros((2, DRAWS))
    for motor, play_mm in enumerate(mechanism.play_at_home_mm()):
        resting = rng.uniform(0, 1, DRAWS) * (rng.uniform(0, 1, DRAWS) < number_of("next", "loose"))
        shift[motor] = -mechanism.printer.motor_home_direction(motor) * max(play_mm, 0.0) * resting
    return shift


def _paces() -> np.ndarray:
    """Draw how long a print takes for each mm of its way [D], over the measured one: no table says how long that took,
    nor how much of an effect goes with the time and how much with the way."""
    least, most = numbers_of("pace", "factors")
    evenly = (np.arange(PACES) + 0.5) / PACES
    drawn = np.resize(least * (most / least) ** evenly, DRAWS)
    return np.random.default_rng(SEED).permutation(drawn)  # of its own: other figures stay as they are


def _parts(
    belief: Belief, homed: Sequence[Part], path: PathPlaces, now: Places, fates: np.ndarray, paces: np.ndarray
) -> dict[str, DrawnCause]:
    """Return the errors across the path that the drawn machines have beyond what acts: those of the parts that act
    together, by how much the next homing shifts these, and those of any other effect by its name. ``homed`` are the
    parts after that homing. A part's own of the ``fates`` [P, D], from 0 to 1, decides what becomes of it. What goes on
    during a print does so by its ``paces`` [D]."""
    scene, normal = belief.scene, _normals(path.tangent)
    found: dict[str, DrawnCause] = {}
    otherwise = np.random.default_rng(SEED)  # of its own: other figures stay as they are

    def add(name: str, part: Part, places: Places, drawn: np.ndarray) -> None:
        if not drawn.any():
            return
        moved = columns_of(part.effect, places, part.where, part.shape, scene)
        cause = DrawnCause(np.einsum("nc,ncp->np", normal, moved), drawn)
        found[name] = found[name].beside(cause) if name in found else cause

    for was, part, drawn in zip(belief.parts, homed, fates, strict=True):
        effect, fate, acts = EFFECTS[part.effect], EFFECTS[part.effect].fate, part.acts_mm[:, None]
        name = name_of(effect, part.draws_mm)
        if not belief.placed and not belief.by_hand and name in (*LINEAR, "shrinkage"):
            name = belief.scale_cause
        elif effect.of is Of.MACHINE and part.acts_mm.any():
            name = "parameters"
        if name == "parameters":
            add(name, part, now, was.draws_mm - acts)
            add("homing", part, now, part.draws_mm - was.draws_mm)
            continue
        if effect.of is Of.MACHINE:
            add(name, part, now, part.draws_mm - acts)
            continue
        again = part.draws_mm * otherwise.choice((-1.0, 1.0), part.draws_mm.shape) if fate.otherwise else part.draws_mm
        stays = (drawn >= fate.anew) & (drawn < fate.anew + fate.stays)
        own = paces if effect.of is Of.SESSION else np.ones(DRAWS)
        for pace in np.unique(own):
            mine, done = own == pace, pace * now.done
            add(name, part, replace(now, done=done), again * (mine & (drawn < fate.anew)))
            add(name, part, replace(now, done=done + 1.0), part.draws_mm * (mine & stays))
        add(name, part, replace(now, done=np.ones(len(normal))), np.repeat(-acts, DRAWS, axis=1))
    return found


def _local(mechanism: Mechanism, belief: Belief, path: PathPlaces, rng: np.random.Generator) -> dict[str, DrawnCause]:
    """Return the variances across the path of what differs from place to place, by cause."""
    across2 = _across(mechanism, path) ** 2
    steps = np.array([axis.mm_per_step / axis.microsteps for axis in mechanism.printer.axes[:2]])
    one = np.ones((len(across2), 1))
    evenly = (np.arange(DRAWS) + 0.5) / DRAWS  # few draws of a wide range are spread over it
    unshown = unshown_mm(rng.permutation(evenly), belief.motion)
    motion = DrawnCause(0.5 * one, unshown[None] ** 2)
    least, most = numbers_of("rounding", "factors")
    rounding = DrawnCause((across2 @ (steps**2 / 12))[:, None], rng.uniform(least, most, DRAWS)[None] ** 2)
    # What marks scatter beyond their instrument is the plastic's and the machine's, in shares that nobody knows.
    printers = rng.permutation(evenly) * belief.scatter.quantiles_mm2(rng.permutation(evenly))
    scatter = DrawnCause(one, (printers + belief.outliers.drawn_mm2(DRAWS, rng))[None])
    return {"scatter": scatter, "motion": motion, "rounding": rounding}


def unshown_mm(chance: np.ndarray, motion: Motion | None) -> np.ndarray:
    """Return the quantiles at each ``chance`` [D] of the errors of motion over both axes: of what is assumed, or of
    what is left of that after lines at speed were measured. Across a line lies half of their mean square."""
    if motion is None:
        return np.asarray(UNSHOWN_MM * np.exp(UNSHOWN_SD * _largest_of(1.0, chance)))
    normal = _NORMAL[::-1]
    found_mm = UNSHOWN_MM * np.exp(UNSHOWN_SD * normal)
    away = (motion.square_mm2 - 0.5 * found_mm**2) / motion.sd_mm2
    log_weight = -0.5 * (normal**2 + away**2)
    weight = np.cumsum(np.exp(log_weight - log_weight.max()))
    return np.asarray(np.interp(chance, weight / weight[-1], found_mm))


def _summed_up(
    side: _Side, at_mm: np.ndarray, along: np.ndarray, rng: np.random.Generator, *, placed: bool
) -> tuple[Promise, np.ndarray]:
    """Return the promise, and the RMS errors [DRAWS] that mending is judged by: unexplained errors are independent of
    the predicted ones there, and where a print is ``placed``, its known shift counts. The next homing puts all of it
    ``at_mm`` [2, DRAWS], beside what it makes of the waves.

    All of them are quadratic forms of the drawn numbers, so the products of the columns are summed along the path once.
    In a file as it is, the unexplained errors (`LASTING`) may add to the predicted ones or cancel them: ``along``
    [DRAWS] is the cosine between the two. It is drawn evenly from −1 to 1, as between two random directions in space,
    because the errors of a path are mostly combinations of three: two shifts and a change of scale.
    """
    weight = side.path.weight / side.path.weight.sum()
    columns = np.hstack(
        [_normals(side.path.tangent), side.off_mm[:, None], *(each.columns for each in side.doubt.values())]
    )
    products = (columns * weight[:, None]).T @ columns
    spread = products[:2, :2] + 1e-9 * np.eye(2)
    # by how much the whole part is shifted, for a unit of each column
    away = np.linalg.solve(spread, products[:2])
    shape = _unshifted(products, away)
    drawn = np.vstack([np.ones((1, DRAWS)), *(each.drawn for each in side.doubt.values())])
    shift = away[:, 2:] @ drawn
    known2 = 0.0 if side.signed else side.known.rms_mm**2
    places2 = {name: weight @ each.columns @ each.drawn for name, each in side.local.items()}
    beside2 = known2 + sum(places2.values())
    rms_mm = free_mm = np.sqrt(_square(shape[2:, 2:], drawn) + beside2)
    if side.signed:
        lasting2 = np.sum([places2[name] for name in LASTING if name in places2], axis=0)
        other2 = np.maximum(free_mm**2 - lasting2, 0.0)
        rms_mm = np.sqrt(np.maximum(free_mm**2 + 2 * along * np.sqrt(lasting2 * other2), 0.0))
    known_share = (max(float(shape[2, 2]), 0.0) if side.signed else 0.0) + known2
    shares = {"planning": known_share}
    first = 3
    for name, each in side.doubt.items():
        own = slice(first, first := first + len(each.drawn))
        shares[name] = float(np.mean(_square(shape[own, own], each.drawn)))
        if name == "homing":
            at_mm = at_mm + away[:, own] @ each.drawn
    shares |= {name: float(np.mean(each)) for name, each in places2.items()}
    p95, most = _extremes(side, columns, drawn, shift, rng)
    low, high = np.quantile(rms_mm, (LOW, HIGH))
    promise = Promise(
        _median(rms_mm), p95, most, float(low), float(high), _median(np.hypot(*at_mm)),
        float(np.sqrt(known_share)),
        {name: math.sqrt(share) for name, share in shares.items()},
    )  # fmt: skip
    if not placed:
        return promise, free_mm
    doubtful = np.arange(len(products)) > 2
    return promise, np.sqrt(_square(_unshifted(products, away * doubtful)[2:, 2:], drawn) + beside2)


def _unshifted(products: np.ndarray, away: np.ndarray) -> np.ndarray:
    """Return the products of columns that lose the shifts ``away`` [2, K], the first two being the shifts' own."""
    shifted = products[:, :2] @ away
    return np.asarray(products - shifted - shifted.T + away.T @ products[:2, :2] @ away)


def _square(products: np.ndarray, drawn: np.ndarray) -> np.ndarray:
    """Return zᵀ P z for each column z of what was drawn [K, D]."""
    return np.maximum(np.einsum("kd,kd->d", drawn, products @ drawn), 0.0)


def _extremes(
    side: _Side, columns: np.ndarray, drawn: np.ndarray, shift: np.ndarray, rng: np.random.Generator
) -> tuple[float, float]:
    """Return within what 95 % of the path lies, and the error that no place exceeds, each in `HIGH` of some drawn
    machines.

    ``shift``, the best one of the whole part, is taken off first. A place stands for as many independent errors as its
    length holds `CELL_MM`, and a whole path at least for one.
    """
    error = columns[:, 2:] @ drawn - columns[:, :2] @ shift
    sd2 = sum(each.columns @ each.drawn for each in side.local.values())
    if not side.signed:
        sd2 = sd2 + side.known.rms_mm**2
    sd = np.sqrt(sd2)
    found = np.abs(error + sd * rng.standard_normal(error.shape))
    p95 = float(np.quantile(_weighted_p95(found.T, side.path.weight), HIGH))
    cells = side.path.weight[:, None] / min(CELL_MM, float(side.path.weight.sum()))
    above, below = (sd * _largest_of(cells, rng.uniform(size=error.shape)) for _ in range(2))
    most = float(np.quantile(np.maximum(above + error, below - error).max(axis=0), HIGH))
    return p95, max(most, p95, 0.0 if side.signed else side.known.max_mm)


def _largest_of(count: np.ndarray | float, uniform: np.ndarray) -> np.ndarray:
    """Return the largest of ``count`` normal values: where Φ to the power of count is ``uniform``."""
    return np.interp(np.log(-np.log(uniform)) - np.log(count), _CHANCE_LOG, _NORMAL)


def _weighted_p95(values: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Return the least of each row of values [D, N] that 95 % of the ``weight`` [N] do not exceed."""
    order = np.argsort(values, axis=1)
    reached = np.cumsum(weight[order], axis=1)
    last = np.count_nonzero(reached < 0.95 * reached[:, -1:], axis=1)
    return np.asarray(values[np.arange(len(values)), order[np.arange(len(values)), last]])
