"""Learn what the grey box leaves of one motor, without knowing its cause, as two functions of the motor's position.

The residual of a row belongs to its last contact, at position m on side s = ±1. It is learned as c(m) + s·d(m)/2, where
c is common to both branches and d is more or less play between them, by one of

    smooth    a Gaussian process of length ℓ (its cosines over the reach: ridge regression with the kernel's spectrum)
    periodic  a Gaussian process over the motor's turn: harmonics finer than the grey box has
    trees     LightGBM on (position mod turn, position, side)

or by nothing. Cross-validation in blocks of at least one turn of travel chooses: neighbouring points share their noise
and their slack, so that folds of single points would favour whatever remembers them (physics.md eq. 20). A print goes
over its places in some order, so that what drifts with time looks like a pattern of places: where a slow drift says
half as much as the best kind, a kind has to be sure beside it, and is learned beside it.
"""

import logging
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from printmend.machine import Transmission
from printmend.machine.kernels import run
from printmend.model.branches import SCALE_MM, rising
from printmend.units import SIGMA_PER_MEDIAN, TURN_RAD
from printmend_lab.greybox.drive.fit import HARMONIC_SD_MM, POWER_SD_MM
from printmend_lab.greybox.layout import warp_columns

# Continue learned tables beyond the stretch that the print showed.
#
# A weak pulley, which moves the carriage by 0.6 mm a commanded millimetre, must turn farther than any print has turned
# it. So the error that was learned within the stretch is split into a slope, what repeats every turn, and the rest:
#
# e(m) = c m + Σ_k a_k cos kφ + b_k sin kφ + r(m)
#
# Beyond the stretch slope and harmonics go on, and r stays as it was at the edge. r is thought to change by small steps
# and rarely by a large one (a spliced belt, a dent): its increments have Student's distribution. A smooth r hardly
# disturbs the fit of the rest, because every angle was seen at several places.

LEAST_TURNS = 1.25  # a shorter stretch shows too little twice to tell what repeats
SAMPLE_MM = 0.5  # places at which the error is sampled
HARMONICS = 32  # as many as the grey box has
STUDENT_FREEDOM = 4.0  # degrees of freedom of Student's distribution, the usual choice for robust fits
LEAST_INCREMENT_MM = 1e-3  # smallest scale of an increment
REWEIGHTINGS = 30  # rounds of reweighted least squares; the terms hardly change after ten


def continued(table: Transmission, reach_mm: tuple[float, float], turn_mm: float) -> Transmission:
    """Return a drive's tables, unchanged within ``reach_mm`` and continued beyond it."""
    low, high = reach_mm
    if high - low < LEAST_TURNS * turn_mm:
        return table
    motor = table.motor_mm
    mean = motor + _continued_mm(motor, (table.lower_mm + table.upper_mm) / 2 - motor, reach_mm, turn_mm, sloped=True)
    play = np.maximum(_continued_mm(motor, table.upper_mm - table.lower_mm, reach_mm, turn_mm, sloped=False), 0.0)
    inside, first = (motor >= low) & (motor <= high), int(np.searchsorted(motor, (low + high) / 2))
    lower = rising(np.where(inside, table.lower_mm, mean - play / 2), first)
    upper = rising(np.where(inside, table.upper_mm, mean + play / 2), first)
    return Transmission(table.first_mm, table.pitch_mm, lower, np.maximum(upper, lower))


def _continued_mm(
    motor_mm: np.ndarray, error_mm: np.ndarray, reach_mm: tuple[float, float], turn_mm: float, *, sloped: bool
) -> np.ndarray:
    """Return errors [N], unchanged within the reach; beyond it their slope (if ``sloped``) and harmonics go on."""
    inside = np.arange(reach_mm[0], reach_mm[1] + SAMPLE_MM / 2, SAMPLE_MM)
    terms = repeating(inside, np.interp(inside, motor_mm, error_mm), turn_mm, sloped=sloped)
    edge = np.clip(motor_mm, *reach_mm)
    errors = np.asarray(np.interp(edge, motor_mm, error_mm))
    beyond = edge != motor_mm
    for edge_mm in reach_mm:
        past = beyond & (edge == edge_mm)
        errors[past] += _evaluated(terms, motor_mm[past], turn_mm, sloped)
        errors[past] -= _evaluated(terms, np.array([edge_mm]), turn_mm, sloped)
    return errors


def _evaluated(terms: np.ndarray, motor_mm: np.ndarray, turn_mm: float, sloped: bool) -> np.ndarray:
    """Return slope and harmonics [N] at motor positions [N], by Horner's rule: one cosine and one sine a place."""
    slope, a, b = terms[0] if sloped else 0.0, terms[-2 * HARMONICS : -HARMONICS], terms[-HARMONICS:]
    angle = np.mod(motor_mm, turn_mm) * (TURN_RAD / turn_mm)
    turn = np.exp(1j * angle)
    total = np.zeros(len(motor_mm), complex)
    for coefficient in (a - 1j * b)[::-1]:
        total = (total + coefficient) * turn
    return np.asarray(slope * motor_mm / SCALE_MM + total.real)


def repeating(motor_mm: np.ndarray, error_mm: np.ndarray, turn_mm: float, *, sloped: bool) -> np.ndarray:
    """Return the terms (c if ``sloped``, a_1 … a_K, b_1 … b_K) that fit errors [N] at motor positions [N]."""
    design, change = np.diff(_columns(motor_mm, turn_mm, sloped), axis=0), np.diff(error_mm)
    k = np.arange(1, HARMONICS + 1)
    variance = np.tile((HARMONIC_SD_MM * k**-2.5) ** 2, 2)
    if sloped:
        variance = np.concatenate([[POWER_SD_MM["mean"][1] ** 2], variance])
    square = max(float(np.median(np.abs(change))), LEAST_INCREMENT_MM) ** 2
    terms: np.ndarray = np.zeros(len(variance))
    weight = np.ones(len(change))
    for _ in range(REWEIGHTINGS):
        scaled = design.T * (weight / square)
        terms = np.linalg.solve(scaled @ design + np.diag(1 / variance), scaled @ change)
        left = np.square(change - design @ terms)
        weight = (STUDENT_FREEDOM + 1) / (STUDENT_FREEDOM + left / square)
        square = max(float(weight @ left) / len(left), LEAST_INCREMENT_MM**2)
    return terms


def _columns(motor_mm: np.ndarray, turn_mm: float, sloped: bool) -> np.ndarray:
    angle = np.outer(np.mod(motor_mm, turn_mm), np.arange(1, HARMONICS + 1)) * (TURN_RAD / turn_mm)
    waves = np.concatenate([np.cos(angle), np.sin(angle)], axis=1)
    return np.concatenate([motor_mm[:, None] / SCALE_MM, waves], axis=1) if sloped else waves


log = logging.getLogger(__name__)

PROCESS_LENGTHS_MM = (2.0, 5.0, 12.0, 30.0)  # lengths of the smooth kinds
REACH_MARGIN_MM = 20.0  # how far beyond the contacts a smooth kind's cosines span
MOST_HARMONICS = 120  # harmonics of a turn that the periodic kind has
FOLDS = 5  # of the cross-validation
LEAST_BLOCKS = 8  # fewer blocks of a turn say nothing about another one
MOST_ROWS = 4000  # rows that the cross-validation looks at
MOST_COLUMNS = 512  # a kind with more is not tried: the finest of either direction, along a CoreXY's long belts
# A kind is sure to help where what it gains on held-out blocks exceeds a share of their square error, and so many of
# the gain's own standard errors: more of them for a small gain, because the best of ten kinds gains by chance.
LEAST_SHARE_GAINED, SMALL_SHARE_GAINED = 0.02, 0.05
SURE_STANDARD_ERRORS, SMALL_STANDARD_ERRORS = 2.0, 3.5
# … and more where there are few blocks: their standard error is unsure itself (Student, Biometrika 6, 1908).
FEW_BLOCKS, FEW_BLOCKS_STANDARD_ERRORS = 12, 5.0
MOST_SIGMAS = 4.0  # residuals beyond so many robust standard deviations count as no larger
CONTACT_PASSES = 2  # how often contacts and residual are found in turn
LEAST_SIGMA_MM = 2e-4  # smallest noise that is assumed
BOOST_ROUNDS = 60  # trees that are fitted one after the other
DRIFT_WAVES, GROWTH_WAVES = 3, 2  # slow cosines of the print: of a shift, and of growth from end to end
DRIFT_SHARE = 0.5  # a drift that gains this share of what the best kind does may be all of that


@dataclass(frozen=True)
class Kind:
    """A kind of residual learner: ``name`` is smooth, periodic or trees.

    ``length_mm`` is that of a smooth one; with ``sides`` either direction of motion has a residual of its own. What is
    learned beside a slow drift of the print is ``timed``.
    """

    name: str
    length_mm: float = 0.0
    sides: bool = False
    timed: bool = False


PROCESSES = (
    *(Kind("smooth", length, sides) for sides in (False, True) for length in PROCESS_LENGTHS_MM),
    Kind("periodic", sides=False),
    Kind("periodic", sides=True),
)
DRIFT = Kind("drift")  # of the print, which no table can hold


@dataclass(frozen=True, eq=False)
class Points:
    """The measured rows in contact, M of them, in the order of motion.

    ``motor_mm`` and ``side`` [M] are those of the contact, ``residual_mm`` [M] what the tables leave, ``weight`` [M]
    the row's weight, ``block`` [M] its block of travel, a turn long, and ``done`` [M] the share of the motor's travel
    before it. ``turn_mm`` is the motor's turn, ``sigma_mm`` the robust standard deviation of the residuals.
    """

    motor_mm: np.ndarray
    side: np.ndarray
    residual_mm: np.ndarray
    weight: np.ndarray
    block: np.ndarray
    turn_mm: float
    sigma_mm: float
    done: np.ndarray

    def where(self, mask: np.ndarray) -> "Points":
        return replace(
            self, motor_mm=self.motor_mm[mask], side=self.side[mask], residual_mm=self.residual_mm[mask],
            weight=self.weight[mask], block=self.block[mask], done=self.done[mask],
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Residual:
    """A learned residual: c and d, ``common_mm`` and ``play_mm`` [G], at the motor positions ``grid_mm`` [G] that were
    seen.

    ``kinds`` are those of the learners that it is the sum of. Without any it is zero, and only says that the tables are
    to be continued beyond the grid by what repeats.
    """

    kinds: tuple[Kind, ...]
    grid_mm: np.ndarray
    common_mm: np.ndarray
    play_mm: np.ndarray
    turn_mm: float

    def plus(self, other: "Residual") -> "Residual":
        """Return the sum of two residuals on one grid."""
        common, play = self.common_mm + other.common_mm, self.play_mm + other.play_mm
        return Residual((*self.kinds, *other.kinds), self.grid_mm, common, play, self.turn_mm)

    def at_mm(self, motor_mm: np.ndarray, side: np.ndarray) -> np.ndarray:
        """Return the residual [N] at contacts; beyond the grid it stays as at the grid's ends."""
        common, play = (np.interp(motor_mm, self.grid_mm, part) for part in (self.common_mm, self.play_mm))
        return common + side * play / 2

    def added(self, table: Transmission) -> Transmission:
        """Return a drive's tables with this residual added, still rising and with lower ≤ upper.

        Beyond the grid the tables are continued by what repeats.
        """
        motor = table.motor_mm
        low = table.lower_mm + self.at_mm(motor, np.full(len(motor), -1.0))
        high = table.upper_mm + self.at_mm(motor, np.ones(len(motor)))
        crossed = low > high
        low[crossed] = high[crossed] = (low[crossed] + high[crossed]) / 2
        reach_mm = float(self.grid_mm[0]), float(self.grid_mm[-1])
        first = int(np.searchsorted(motor, sum(reach_mm) / 2))
        low = rising(low, first)
        bent = Transmission(table.first_mm, table.pitch_mm, low, np.maximum(rising(high, first), low))
        return continued(bent, reach_mm, self.turn_mm)


def points_in_contact(
    table: Transmission,
    motor_mm: np.ndarray,
    measured_mm: np.ndarray,
    weight: np.ndarray,
    start_mm: float,
    turn_mm: float,
) -> Points:
    """Follow a motor's path [N] through its tables; return the measured rows in contact with their residuals."""
    lower, upper = table.branches_mm(motor_mm)
    at, side = np.empty(len(motor_mm), np.int64), np.empty(len(motor_mm))
    belt = np.empty(len(motor_mm))
    run.contacts(start_mm, lower, upper, at, side, belt)
    travel = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(motor_mm)))])
    used = np.flatnonzero((weight > 0) & (at >= 0))
    residual = (measured_mm - belt)[used]
    sigma = max(SIGMA_PER_MEDIAN * float(np.median(np.abs(residual))) if len(used) else 0.0, LEAST_SIGMA_MM)
    return Points(
        motor_mm[at[used]],
        side[used],
        residual,
        weight[used],
        (travel[used] / turn_mm).astype(np.int64),
        turn_mm,
        sigma,
        travel[used] / max(float(travel[-1]), 1e-9),
    )


def drift_columns(data: Points) -> np.ndarray:
    """Return what drifts slowly with the print at its points [M, Q]: a shift, and growth from end to end."""
    low, high = float(data.motor_mm.min()), float(data.motor_mm.max())
    own = (2 * data.motor_mm - low - high) / max(high - low, 1e-9)
    waves = np.cos(np.pi * np.outer(data.done, np.arange(1, DRIFT_WAVES + 1)))
    return np.concatenate([waves, waves[:, :GROWTH_WAVES] * own[:, None]], axis=1)


def _beside_drift(values: np.ndarray, data: Points) -> np.ndarray:
    """Return columns or residuals [M, …] without what the drift of the points explains of them."""
    root = np.sqrt(data.weight)[:, None]
    basis = np.linalg.qr(drift_columns(data) * root)[0]
    whole = values.reshape(len(values), -1)
    return np.asarray(whole - basis / root @ (basis.T @ (whole * root))).reshape(values.shape)


def _without_drift(data: Points) -> Points:
    """Return the points with residuals from which their drift is taken off."""
    return replace(data, residual_mm=_beside_drift(_clipped(data), data))


def _clipped(data: Points) -> np.ndarray:
    """Return the residuals [M], outliers no larger than `MOST_SIGMAS` standard deviations."""
    return np.clip(data.residual_mm, -MOST_SIGMAS * data.sigma_mm, MOST_SIGMAS * data.sigma_mm)


def process_columns(
    kind: Kind, motor_mm: np.ndarray, side: np.ndarray, turn_mm: float, reach_mm: tuple[float, float]
) -> np.ndarray:
    """Return the columns of a Gaussian process [N, P] at contacts."""
    if kind.name == "smooth":
        waves = warp_columns(_cosines(kind, reach_mm), reach_mm, motor_mm)
    else:
        angle = np.outer(np.mod(motor_mm, turn_mm), np.arange(1, MOST_HARMONICS + 1)) * (TURN_RAD / turn_mm)
        waves = np.concatenate([np.cos(angle), np.sin(angle)], axis=1)
    return np.concatenate([waves, waves * side[:, None] / 2], axis=1) if kind.sides else waves


def _cosines(kind: Kind, reach_mm: tuple[float, float]) -> int:
    return int(np.ceil(4.0 * (reach_mm[1] - reach_mm[0]) / (np.pi * kind.length_mm)))


def column_variances(kind: Kind, reach_mm: tuple[float, float]) -> np.ndarray:
    """Return the prior variance of every column [P], for a process of variance 1."""
    if kind.name == "smooth":
        span = reach_mm[1] - reach_mm[0]
        rate = np.pi * np.arange(1, _cosines(kind, reach_mm) + 1) / span
        power = 2 * kind.length_mm * np.sqrt(TURN_RAD) / span * np.exp(-np.square(rate * kind.length_mm) / 2)
        power = np.maximum(power, 1e-12)
    else:
        size = 1.0 / np.arange(1, MOST_HARMONICS + 1) ** 3.0  # position errors of a hull with corners fall as k⁻²
        power = np.tile(size / size.sum(), 2)
    return np.tile(power, 2) if kind.sides else power


def process(design: np.ndarray, root: np.ndarray, data: Points) -> np.ndarray:
    """Return the weights [P] of a Gaussian process by ridge regression, its variance and the noise learned, too.

    ``design`` [M, P] are its columns, ``root`` [P] the roots of their prior variances.
    """
    return root * _ridge(_gram(design * root, data))


@dataclass(frozen=True, eq=False)
class _Gram:
    """Weighted sums over points: columns × columns [P, P], columns × residuals [P], squared residuals, weights."""

    matrix: np.ndarray
    slope: np.ndarray
    square: float
    count: float

    def less(self, other: "_Gram") -> "_Gram":
        return _Gram(*(getattr(self, name) - getattr(other, name) for name in vars(self)))


def _gram(scaled: np.ndarray, data: Points) -> _Gram:
    clipped = _clipped(data)
    weighted = scaled * data.weight[:, None]
    return _Gram(weighted.T @ scaled, weighted.T @ clipped, float(data.weight @ clipped**2), float(data.weight.sum()))


def _ridge(gram: _Gram) -> np.ndarray:
    """Return the weights [P] of scaled columns."""
    values, vectors = np.linalg.eigh(gram.matrix)
    values, slope = np.maximum(values, 0.0), vectors.T @ gram.slope
    noise = size = max(gram.square / gram.count, LEAST_SIGMA_MM**2)
    for _ in range(12):  # MacKay's fixed point for the two variances
        weights = slope / (values + noise / size)
        known = float((values / (values + noise / size)).sum())
        left = max(gram.square - 2 * float(slope @ weights) + float(values @ weights**2), 0.0)
        noise = max(left / max(gram.count - known, 1.0), LEAST_SIGMA_MM**2)
        size = max(float(weights @ weights) / max(known, 1e-6), 1e-12)
    return np.asarray(vectors @ (slope / (values + noise / size)))


def trees(data: Points, seed: int) -> Any:
    """Fit LightGBM to (position mod turn, position, side), by its own interface, which needs no scikit-learn."""
    import lightgbm

    options = {
        "objective": "regression", "num_leaves": 15, "min_data_in_leaf": 20, "seed": seed, "num_threads": 1,
        "verbosity": -1, "deterministic": True, "force_col_wise": True,
    }  # fmt: skip
    clipped = _clipped(data)
    rows = _features(data.motor_mm, data.side, data.turn_mm)
    return lightgbm.train(options, lightgbm.Dataset(rows, clipped, weight=data.weight), num_boost_round=BOOST_ROUNDS)


@cache
def has_trees() -> bool:
    """Say whether LightGBM can be loaded: it is an extra, and wants the system's OpenMP library."""
    try:
        import lightgbm  # noqa: F401
    except ModuleNotFoundError:
        log.warning("no trees are tried on what the machine leaves over: pip install 'printmend[trees]'")
        return False
    except OSError as error:
        log.warning("no trees are tried: LightGBM cannot be loaded (%s); install libgomp (macOS: libomp)", error)
        return False
    return True


def _features(motor_mm: np.ndarray, side: np.ndarray, turn_mm: float) -> np.ndarray:
    return np.stack([np.mod(motor_mm, turn_mm), motor_mm, side], axis=1)


def held_out(kind: Kind, data: Points, fold: np.ndarray, reach_mm: tuple[float, float], seed: int) -> np.ndarray:
    """Return what a kind predicts at every point [M] when it learns from all folds but the point's ``fold`` [M]."""
    guess = np.empty(len(fold))
    masks = [fold == each for each in np.unique(fold)]
    if kind.name == "trees":
        for held in masks:
            model = trees(data.where(~held), seed)
            guess[held] = model.predict(_features(data.motor_mm[held], data.side[held], data.turn_mm), num_threads=1)
        return guess
    if kind == DRIFT:
        scaled = drift_columns(data)
    else:
        columns = process_columns(kind, data.motor_mm, data.side, data.turn_mm, reach_mm)
        scaled = columns * np.sqrt(column_variances(kind, reach_mm))
        scaled = _beside_drift(scaled, data) if kind.timed else scaled
    grams = [_gram(scaled[held], data.where(held)) for held in masks]
    whole = _Gram(*(sum(getattr(gram, name) for gram in grams) for name in vars(grams[0])))
    for held, gram in zip(masks, grams, strict=True):
        guess[held] = scaled[held] @ _ridge(whole.less(gram))
    return guess


def chosen_kind(data: Points, reach_mm: tuple[float, float], *, patterned: bool, seed: int) -> Kind | None:
    """Return the kind that predicts held-out blocks of travel best; None where no kind is sure to help.

    Trees are tried only where the residual is ``patterned``, or where a process helped. Where a slow drift of the print
    says nearly as much, the kind is the best beside that drift, and has to be sure beside it.
    """
    blocks = np.unique(data.block)
    if len(blocks) < LEAST_BLOCKS or len(data.motor_mm) < 10 * LEAST_BLOCKS:
        return None
    if len(data.motor_mm) > MOST_ROWS:
        data = data.where(np.linspace(0, len(data.motor_mm) - 1, MOST_ROWS).astype(np.int64))
    number = np.searchsorted(blocks, data.block)
    # Blocks go to the folds in turn, each block as a whole.
    fold = number % min(FOLDS, len(blocks))
    # what has more columns than there are points finds some pattern in any noise
    most = min(len(data.motor_mm), MOST_COLUMNS)
    offered = [kind for kind in PROCESSES if len(column_variances(kind, reach_mm)) <= most]

    def square(data: Points, guess: float | np.ndarray = 0.0) -> np.ndarray:
        off2 = np.minimum(np.square(data.residual_mm - guess), (MOST_SIGMAS * data.sigma_mm) ** 2)
        return np.bincount(number, data.weight * off2)

    def gained(kind: Kind, data: Points) -> np.ndarray:
        return square(data) - square(data, held_out(kind, data, fold, reach_mm, seed))

    def best(data: Points, offered: list[Kind]) -> tuple[Kind, float] | None:
        before = square(data)
        gains = {kind: gained(kind, data) for kind in offered}
        found = max(gains, key=lambda kind: gains[kind].sum())
        if (patterned or is_sure(gains[found], before)) and has_trees():
            both = replace(found, name="trees", length_mm=0.0, sides=True)
            gains[both] = gained(both, data)
            # Trees make staircases, which must be worth their steps.
            found = both if gains[both].sum() > gains[found].sum() + LEAST_SHARE_GAINED * before.sum() else found
        return (found, float(gains[found].sum())) if is_sure(gains[found], before) else None

    if not offered or (found := best(data, offered)) is None:
        return None
    if gained(DRIFT, data).sum() > DRIFT_SHARE * found[1]:
        found = best(_without_drift(data), [replace(kind, timed=True) for kind in offered])
    return None if found is None else found[0]


def is_sure(gain: np.ndarray, before: np.ndarray) -> bool:
    """Say whether a kind helps that takes ``gain`` [B] mm² off the square errors ``before`` [B] of held-out blocks."""
    error, whole = float(np.std(gain, ddof=1)) * np.sqrt(len(gain)), before.sum()
    least = SMALL_STANDARD_ERRORS if gain.sum() < SMALL_SHARE_GAINED * whole else SURE_STANDARD_ERRORS
    if len(gain) < FEW_BLOCKS:
        least = FEW_BLOCKS_STANDARD_ERRORS
    return bool(gain.sum() > least * error and gain.sum() > LEAST_SHARE_GAINED * whole)


def fit_residual(
    kind: Kind, data: Points, reach_mm: tuple[float, float], grid_mm: np.ndarray, *, seed: int
) -> Residual:
    """Fit a kind to all points; return it as a table at motor positions ``grid_mm`` [G]."""
    branches = []
    data = _without_drift(data) if kind.timed else data
    for side in (-1.0, 1.0):
        none, sides = np.zeros(0), np.full(len(grid_mm), side)
        where = Points(grid_mm, sides, none, none, none, data.turn_mm, data.sigma_mm, none)
        branches.append(where)
    if kind.name == "trees":
        model = trees(data, seed)
        low, high = (
            np.asarray(model.predict(_features(b.motor_mm, b.side, b.turn_mm), num_threads=1)) for b in branches
        )
    else:
        design = process_columns(kind, data.motor_mm, data.side, data.turn_mm, reach_mm)
        design, root = _beside_drift(design, data) if kind.timed else design, np.sqrt(column_variances(kind, reach_mm))
        weights = process(design, root, data)
        low, high = (process_columns(kind, b.motor_mm, b.side, b.turn_mm, reach_mm) @ weights for b in branches)
    return Residual((kind,), grid_mm, (low + high) / 2, high - low, data.turn_mm)
