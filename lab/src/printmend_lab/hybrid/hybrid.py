"""The hybrid: the grey box, completed by errors that no physical part of it explains.

The grey box is fitted first. Where cross-validation in blocks says that its residual can be predicted, a residual
learner (`residual`) is added to its tables. Where the trace is a layer of the published simulator, in which a step
there and back does not return, the gains of that world (`gains`) are learned instead. Else the answer is the grey box.
"""

from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from printmend.learn.mechanism_model import MachineLearned
from printmend.machine import GainMechanism, Mechanism, Transmission
from printmend.machine.kernels import run
from printmend.path import Trace
from printmend.printer import Printer
from printmend_lab.greybox import Greybox, GreyboxModel, LearnedDrive, motor_rows
from printmend_lab.greybox.drive import jumped
from printmend_lab.greybox.drive.fit import robust_sigma_mm
from printmend_lab.greybox.drive.select import PATTERN_SHARE, SELECT_LEAST_SIGMA_MM
from printmend_lab.hybrid.gains import learned_gains
from printmend_lab.hybrid.residual import (
    CONTACT_PASSES,
    REACH_MARGIN_MM,
    Residual,
    chosen_kind,
    fit_residual,
    points_in_contact,
)

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
