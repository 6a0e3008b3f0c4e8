"""The hybrid: the grey box, completed by errors that no physical part of it explains.

The grey box is fitted first. Where cross-validation in blocks says that its residual can be predicted, a residual
learner (`residual`) is added to its tables. Where the trace is a layer of the published simulator, in which a step
there and back does not return, the gains of that world (`gains`) are learned instead. Else the answer is the grey box.
"""

from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from printmend.infer.scatter import independent_share
from printmend.machine import GainMechanism, Mechanism, Transmission
from printmend.machine.kernels import run
from printmend.path import Trace
from printmend.printer import Printer
from printmend.units import TURN_RAD
from printmend_lab.greybox import Greybox, GreyboxModel, LearnedDrive, motor_rows
from printmend_lab.greybox.drive import jumped
from printmend_lab.greybox.drive.fit import robust_sigma_mm
from printmend_lab.greybox.drive.select import PATTERN_SHARE, SELECT_LEAST_SIGMA_MM
from printmend_lab.hybrid.residual import (
    CONTACT_PASSES,
    REACH_MARGIN_MM,
    Residual,
    chosen_kind,
    fit_residual,
    points_in_contact,
)
from printmend_lab.protocols import MachineLearned

# Learn the published simulator's own world: a gain for a step from every nominal position, in either direction.
#
# There a step from n moves the carriage by c·g[n], and whoever leaves a place and returns is not where he was
# (physics.md eq. 26). So positions are sums, y_t = y_0 + Σ_{i<t} c_i g[n_i], which are linear in the gains. A gain is a
# constant, harmonics of the motor's turn, and a smooth part that repeats nothing; cross-validation in blocks chooses
# how many.

HARMONICS_TRIED = (5, 16, 50)  # numbers of harmonics; the published corruptions have few
LENGTHS_TRIED_MM = (0.0, 40.0, 10.0)  # lengths of the smooth part; 0 is none
GAIN_SD, SMOOTH_SD = 0.3, 0.1  # prior standard deviations of a gain's constant and harmonics, and of its smooth part
FOLDS = 5  # of the cross-validation
BLOCK_TURNS = 1.0  # travel of a block, which is left out as a whole
LEAST_TICKS = 400  # a shorter layer does not tell the two worlds apart
NOISE_ROUNDS = 3  # updates of the noise
LEAST_SIGMA_STEPS = 1e-3  # smallest noise that is assumed
ON_LATTICE_STEPS = 1e-6  # a way-point this close to the lattice is on it


@dataclass(frozen=True, eq=False)
class LearnedGains:
    """The gains of both axes, and how well they fit.

    ``residual_mm`` is the root mean square of a coordinate's residuals over the whole trace, ``share`` the share of
    them that is independent (1 for noise), and ``known`` how many parameters the trace settled.
    """

    mechanism: GainMechanism
    residual_mm: float
    share: float
    known: float


def learned_gains(trace: Trace, printer: Printer) -> LearnedGains | None:
    """Learn gains from a layer printed tick by tick on the lattice; None for any other trace."""
    low_mm, pitch_mm = np.array([printer.x.min_mm, printer.y.min_mm]), np.array(printer.mm_per_step)
    place = (trace.commanded_mm - low_mm) / pitch_mm
    nominal = np.rint(place).astype(np.int64)
    controls = np.diff(nominal, axis=0)
    if trace.layer is not None and (np.diff(trace.layer) != 0).any():
        return None
    if len(controls) < LEAST_TICKS or np.abs(place - nominal).max() > ON_LATTICE_STEPS or np.abs(controls).max() > 1:
        return None
    measured = (trace.measured_mm - low_mm) / pitch_mm
    found = []
    for axis, bed in enumerate(printer.bed_steps):
        one = _axis(
            nominal[:, axis],
            controls[:, axis],
            measured[:, axis],
            bed,
            printer.axes[axis].steps_per_turn,
            pitch_mm[axis],
        )
        if one is None:
            return None
        found.append(one)
    x, y = found
    square = np.mean([np.mean(np.square(one[1] * pitch)) for one, pitch in zip(found, pitch_mm, strict=True)])
    share = min(independent_share(left, robust_sigma_mm(left)) for _, left, _ in found)
    return LearnedGains(GainMechanism(printer, (x[0], y[0])), float(np.sqrt(square)), share, x[2] + y[2])


def _axis(
    nominal: np.ndarray, controls: np.ndarray, measured: np.ndarray, bed: int, turn: int, pitch_mm: float
) -> tuple[np.ndarray, np.ndarray, float] | None:
    """Return an axis's gains [bed] (entry n − 1 for position n), the residuals [M] in steps, and how many parameters
    were settled; None for an axis that hardly moved."""
    travel = np.concatenate([[0.0], np.cumsum(np.abs(controls))])
    block = (travel / (BLOCK_TURNS * turn)).astype(np.int64)
    if block[-1] < 2:
        return None
    lattice = np.arange(1, bed + 1)
    known = np.flatnonzero(np.isfinite(measured))
    error = measured[known] - nominal[known]  # a gain of 1 leaves none
    best = np.inf, (HARMONICS_TRIED[0], 0.0)
    for smooth_mm in LENGTHS_TRIED_MM:
        columns = _columns(nominal[:-1], bed, turn, HARMONICS_TRIED[-1], smooth_mm / pitch_mm)
        moved = np.concatenate([np.zeros((1, columns.shape[1])), np.cumsum(columns * controls[:, None], axis=0)])[known]
        grams = _grams(moved, error, block[known])
        for harmonics in HARMONICS_TRIED:
            variance = _variances(bed, turn, harmonics, smooth_mm / pitch_mm)
            score = _cross_validated(grams, variance)
            if score < best[0] * 0.99:
                best = score, (harmonics, smooth_mm)
    harmonics, smooth_mm = best[1]
    variance = _variances(bed, turn, harmonics, smooth_mm / pitch_mm)
    columns = _columns(nominal[:-1], bed, turn, HARMONICS_TRIED[-1], smooth_mm / pitch_mm)
    moved = np.concatenate([np.zeros((1, columns.shape[1])), np.cumsum(columns * controls[:, None], axis=0)])[known]
    weights, settled = _solved(_grams(moved, error, np.zeros(len(known), np.int64)), variance)
    left = error - moved @ weights
    gains = 1.0 + _columns(lattice, bed, turn, HARMONICS_TRIED[-1], smooth_mm / pitch_mm) @ weights
    return gains, left - left.mean(), settled


def _columns(place: np.ndarray, bed: int, turn: int, harmonics: int, smooth: float) -> np.ndarray:
    """Return the columns [N, P] of gains at lattice positions [N]; ``smooth`` is the smooth part's length in steps."""
    k = np.arange(1, harmonics + 1)
    angle = np.outer(np.mod(place, turn), k) * (TURN_RAD / turn)
    waves = np.cos(np.outer(place / bed, np.pi * np.arange(1, _cosines(bed, smooth) + 1)))
    return np.concatenate([np.ones((len(place), 1)), np.cos(angle), np.sin(angle), waves], axis=1)


def _cosines(bed: int, smooth: float) -> int:
    return int(np.ceil(4.0 * bed / (np.pi * smooth))) if smooth else 0


def _variances(bed: int, turn: int, harmonics: int, smooth: float) -> np.ndarray:
    """Return the prior variance of every column [P]; it is 0 for harmonics above ``harmonics``, which switches them
    off.
    """
    k = np.arange(1, HARMONICS_TRIED[-1] + 1)
    waves = np.where((k <= harmonics) & (2 * k < turn), np.square(GAIN_SD / k), 0.0)
    rate = np.pi * np.arange(1, _cosines(bed, smooth) + 1) / bed
    rest = SMOOTH_SD**2 * 2 * smooth * np.sqrt(TURN_RAD) / bed * np.exp(-np.square(rate * smooth) / 2)
    return np.concatenate([[GAIN_SD**2], waves, waves, rest])


@dataclass(frozen=True, eq=False)
class _Grams:
    """Sums over the rows of each block [B]: columns × columns [B, P, P], columns × errors [B, P], squares, counts."""

    matrix: np.ndarray
    slope: np.ndarray
    square: np.ndarray
    count: np.ndarray

    def of(self, blocks: np.ndarray) -> "_Grams":
        return _Grams(*(part[blocks].sum(axis=0, keepdims=True) for part in vars(self).values()))


def _grams(moved: np.ndarray, error: np.ndarray, block: np.ndarray) -> _Grams:
    """Sum up blocks of rows, each about its own mean: where a block starts says nothing about the gains."""
    parts = []
    for number in np.unique(block):
        mine = block == number
        columns = moved[mine] - moved[mine].mean(axis=0)
        value = error[mine] - error[mine].mean()
        parts.append((columns.T @ columns, columns.T @ value, value @ value, float(mine.sum() - 1)))
    return _Grams(*(np.array(part) for part in zip(*parts, strict=True)))


def _solved(grams: _Grams, variance: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the weights [P] of ridge least squares, and how many of them the rows settle.

    The noise of a round is what the round before it left.
    """
    total, root = grams.of(np.arange(len(grams.count))), np.sqrt(variance)
    matrix, slope = total.matrix[0] * np.outer(root, root), total.slope[0] * root
    noise = max(float(total.square[0] / max(total.count[0], 1.0)), LEAST_SIGMA_STEPS**2)
    values, vectors = np.linalg.eigh(matrix)
    values, slope = np.maximum(values, 0.0), vectors.T @ slope
    weights, settled = np.zeros(len(root)), 0.0
    for _ in range(NOISE_ROUNDS):
        weights = root * (vectors @ (slope / (values + noise)))
        settled = float((values / (values + noise)).sum())
        left = total.square[0] - 2 * total.slope[0] @ weights + weights @ total.matrix[0] @ weights
        noise = max(float(left / max(total.count[0], 1.0)), LEAST_SIGMA_STEPS**2)
    return weights, settled


def _cross_validated(grams: _Grams, variance: np.ndarray) -> float:
    """Return the mean square error on blocks that were not fitted [steps²]."""
    fold = np.arange(len(grams.count)) % min(FOLDS, len(grams.count))
    left = 0.0
    for number in np.unique(fold):
        weights, _ = _solved(grams.of(np.flatnonzero(fold != number)), variance)
        held = grams.of(np.flatnonzero(fold == number))
        left += float(held.square[0] - 2 * held.slope[0] @ weights + weights @ held.matrix[0] @ weights)
    return left / float(grams.count.sum())


TABLE_PITCH_MM = 0.2  # pitch of a residual's table: a full step of the usual motors
MOST_STAGES = 3  # residuals that are learned one after the other, each of what those before it leave
WORLD_NATS = 30.0  # log evidence that the published world must have over any machine
EXACT_SHARE = 0.1  # that world explains all where it leaves less than this share of the machine's residual
GOOD_ENOUGH_MM = SELECT_LEAST_SIGMA_MM  # a machine that leaves no more than this, beside noise, is good enough


@dataclass(frozen=True, eq=False)
class HybridModel(MachineLearned):
    """A learned machine; a world model.

    ``box`` is the grey box; ``mechanism`` is its machine with the ``residuals`` of either motor added (None: nothing to
    add). In the published simulator's ``world`` no machine can say what steps do: there the model plans with the
    world's gains, and ``mechanism`` is the nearest machine. ``noise_mm`` is the standard deviation of a measured
    coordinate about the model, and ``residual_after_mm`` the RMS distance of the measured points from it.
    """

    box: GreyboxModel
    mechanism: Mechanism
    noise_mm: float
    residual_after_mm: float
    residuals: tuple[Residual | None, Residual | None] = (None, None)
    world: GainMechanism | None = None

    @property
    def imagined(self) -> Mechanism | GainMechanism:
        return self.mechanism if self.world is None else self.world


@dataclass(frozen=True)
class Hybrid:
    """The learner that ends the nested list of physics.md eq. 20: a learned remainder."""

    name: str = "hybrid"

    def fit(self, trace: Trace, printer: Printer, *, rng: np.random.Generator) -> HybridModel:
        """Learn from a trace. Raise `TraceError` where the grey box does."""
        box = Greybox().fit(trace, printer, rng=rng)
        with threadpool_limits(1, user_api="blas"):
            return with_residuals(box, trace, seed=int(rng.integers(2**31)))


def with_residuals(box: GreyboxModel, trace: Trace, *, seed: int) -> HybridModel:
    """Return a grey box with the residuals that its own trace shows, or with the published world's gains."""
    plain = HybridModel(box, box.mechanism, box.noise_mm, box.residual_after_mm)
    if trace.wall_rows.any():  # what is left of walls has the length of a bead's own wobble
        return plain
    patterned = [
        drive.choice.fit.share < PATTERN_SHARE and _left_mm2(drive) > GOOD_ENOUGH_MM**2 for drive in box.drives
    ]
    if any(patterned) and (world := _published(box, trace)) is not None:
        return replace(plain, world=world)
    x, y = (_residual(box, trace, motor, patterned=patterned[motor], seed=seed) for motor in range(2))
    first, second = (
        table if residual is None else residual.added(table)
        for residual, table in zip((x, y), box.mechanism.transmissions, strict=True)
    )
    mechanism = replace(box.mechanism, transmissions=(first, second))
    if x is None and y is None:
        return plain
    left = np.stack([_left_mm(box, trace, motor, table) for motor, table in enumerate((first, second))], axis=1)
    bed = box.printer.from_motor(left)[trace.measured_rows]
    after = float(np.sqrt(np.nanmean(np.square(bed).sum(axis=1))))
    return HybridModel(box, mechanism, robust_sigma_mm(bed[np.isfinite(bed)]), after, (x, y))


def _left_mm(box: GreyboxModel, trace: Trace, motor: int, table: Transmission) -> np.ndarray:
    """Return the residual of a motor's tables [N], NaN where nothing was measured."""
    touch = box.drives[motor].choice.fit.touch
    belt = np.empty(len(trace))
    lower, upper = table.branches_mm(
        jumped(motor_rows(trace, box.printer, box.periods_mm)[motor], box.jumps[motor]).motor_mm
    )
    run.follow(float(touch.belt_mm[0]), lower, upper, belt)
    return np.asarray(touch.belt_mm + touch.residual_mm - belt)


def _published(box: GreyboxModel, trace: Trace) -> GainMechanism | None:
    """Return the published world's gains where they explain the trace better than any machine."""
    gains = learned_gains(trace, box.printer)
    if gains is None:
        return None
    left = float(np.mean([_left_mm2(drive) for drive in box.drives]))
    if box.printer.kinematics == "corexy":  # its motors are sums of two coordinates
        left /= 2
    right = max(gains.residual_mm**2, np.finfo(float).tiny)
    # Each measured coordinate counts half its log ratio, each settled parameter costs a nat.
    better = box.measured * np.log(left / right) - gains.known
    # That world consists of gains only: what they leave must be noise, or next to nothing.
    whole = gains.share > PATTERN_SHARE or right < EXACT_SHARE**2 * left
    return gains.mechanism if better > WORLD_NATS and whole and left > right + GOOD_ENOUGH_MM**2 else None


def _left_mm2(drive: LearnedDrive) -> float:
    """Return the mean square of the grey box's residuals of a motor."""
    return float(np.nanmean(np.square(drive.choice.fit.touch.residual_mm)))


def _residual(box: GreyboxModel, trace: Trace, motor: int, *, patterned: bool, seed: int) -> Residual | None:
    """Return the residual that cross-validation in blocks adds to a motor's tables; None where it adds none."""
    drive, table = box.drives[motor], box.mechanism.transmissions[motor]
    if _left_mm2(drive) <= GOOD_ENOUGH_MM**2:
        return None
    rows = jumped(motor_rows(trace, box.printer, box.periods_mm)[motor], box.jumps[motor])
    touch = drive.choice.fit.touch
    measured = touch.belt_mm + touch.residual_mm  # without what the frame adds
    start_mm = float(touch.belt_mm[0])
    data = points_in_contact(table, rows.motor_mm, measured, rows.weight, start_mm, rows.period_mm)
    if not len(data.motor_mm):
        return None
    low, high = float(data.motor_mm.min()), float(data.motor_mm.max())
    reach = (low - REACH_MARGIN_MM, high + REACH_MARGIN_MM)
    grid = np.arange(low, high + TABLE_PITCH_MM, TABLE_PITCH_MM)
    found: Residual | None = None
    for _ in range(MOST_STAGES):
        kind = chosen_kind(data, reach, patterned=patterned, seed=seed)
        if kind is None:
            break
        before, bent, more = data, table, found
        for _ in range(CONTACT_PASSES):
            # Later passes of a stage learn what its earlier ones left.
            stage = fit_residual(kind, data, reach, grid, seed=seed)
            more = stage if more is None else more.plus(stage)
            bent = more.added(table)
            data = points_in_contact(bent, rows.motor_mm, measured, rows.weight, start_mm, rows.period_mm)
        if np.mean(np.abs(data.residual_mm)) >= np.mean(np.abs(before.residual_mm)):
            break
        found = more
    if found is None and drive.structure.warp_mm:  # beyond the grid the part that repeats nothing must not go on
        found = Residual((), grid, np.zeros(len(grid)), np.zeros(len(grid)), rows.period_mm)
    return found


LEARNERS = {"hybrid": Hybrid()}
