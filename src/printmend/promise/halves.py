"""Two halves of the bed that differ by a step, as where two sheets were measured as one.

No drive and no frame makes a step, but their parts can follow one between the dots: an uneven belt, a pulley's
harmonics, a bent or skewed frame. So a step is tried beside what a fit has, and in place of such parts (the criterion
of Schwarz 1978). Both motors share its border.
"""

from dataclasses import replace

import numpy as np

from printmend.identify.drive.design import Design
from printmend.identify.drive.fit import independent_share, robust_sigma_mm
from printmend.learn.greybox.model import GreyboxModel
from printmend.learn.greybox.rows import motor_rows
from printmend.path import Trace
from printmend.promise.effects import LEARNED, STAYS, Effect
from printmend.promise.misfit_columns import Candidate
from printmend.promise.misfit_tests import LEAST_COST_MM, LEAST_OWN_SHARE, SURE_NATS, Cause, effect_of
from printmend.promise.rails import BORDERS, Seen, can_be_told, nothing, seen_without

NOISE_SHARE = 0.5  # least share of a motor's residuals that is independent, where they are noise
BESIDE = np.linspace(-0.05, 0.05, 21)  # of the likeliest of the borders, where it is looked for once more


def halves_of(box: GreyboxModel, trace: Trace) -> tuple[Cause, ...]:
    """Return the step between two halves of the bed, each motor's share of it, where surely there is one."""
    if not can_be_told(box, trace):
        return ()
    rows = motor_rows(trace, box.printer, box.periods_mm)
    seen = [
        [seen_without(box, trace, rows, motor, parts) for parts in (nothing, _shape, _with_turn)] for motor in range(2)
    ]
    about = _best(seen, BORDERS)[0].candidate
    best = _best(seen, tuple(replace(about, place=about.place + beside) for beside in BESIDE))
    shares = tuple(cause for cause in best if cause.nats > 0 and cause.size_mm > LEAST_COST_MM / 4)
    is_sure = sum(cause.nats for cause in shares) - np.log(len(BORDERS)) > SURE_NATS
    return shares if is_sure and max(cause.size_mm for cause in shares) > LEAST_COST_MM else ()


def is_belts(box: GreyboxModel, step: tuple[Cause, ...]) -> bool:
    """Say whether the belt alone may make a step, and the model's uneven belt does: it is along one motor's own axis,
    and the other motor has none."""
    if box.printer.kinematics == "corexy" or len(step) != 1:
        return False
    motor = step[0].motor
    return step[0].candidate.detail == motor and bool(box.drives[motor].structure.warp_mm)


def leaves_noise(box: GreyboxModel) -> bool:
    """Say whether a model leaves mere noise: beside a pattern, a step is one more part that follows it."""
    left = [touch.residual_mm[touch.at >= 0] for touch in (drive.choice.fit.touch for drive in box.drives)]
    left = [each[np.isfinite(each)] for each in left]
    return all(independent_share(each, robust_sigma_mm(each)) > NOISE_SHARE for each in left)


def step_effects(box: GreyboxModel, trace: Trace, step: tuple[Cause, ...]) -> tuple[Effect, ...]:
    """Return what a step may do to new prints: all of it, but for what a belt's model has."""
    rows = motor_rows(trace, box.printer, box.periods_mm)
    state = LEARNED if is_belts(box, step) else STAYS
    return tuple(effect_of(share, rows, trace, state, np.zeros(3)) for share in step)


def _shape(design: Design) -> np.ndarray:
    """Mark the parameters [P] of an uneven belt, a second period and a bent or skewed frame."""
    marked = design.mask("warp", "second", "cross")
    marked[design.parts["mean_powers"]] = np.arange(design.mean_powers) > 1
    return marked


def _with_turn(design: Design) -> np.ndarray:
    """Mark the same and the harmonics of the turn."""
    return _shape(design) | design.mask("mean")


def _best(seen: list[list[Seen]], borders: tuple[Candidate, ...]) -> tuple[Cause, ...]:
    """Return both motors' shares of the likeliest step at one of the borders."""
    tried = [_tried(motor, *of_one, borders=borders) for motor, of_one in enumerate(seen)]
    return max(zip(*tried, strict=True), key=lambda both: sum(max(cause.nats, 0.0) for cause in both))


def _tried(motor: int, as_it_is: Seen, *without: Seen, borders: tuple[Candidate, ...]) -> list[Cause]:
    """Return a step at each border as a cause of one motor, with the log likelihood that it gains over what the fit has
    (the criterion of Schwarz 1978) beside that or in place of some parts, and at least on what is left without them."""
    steps = np.column_stack([border.columns(as_it_is.one) for border in borders])
    apart2 = np.square(steps - steps.mean(axis=0)).sum(axis=0)
    count, parameters = as_it_is.basis.shape
    whole2 = _squares(as_it_is.left_mm)
    share = independent_share(as_it_is.left_mm, robust_sigma_mm(as_it_is.left_mm))
    nats, weights = np.full(len(borders), -np.inf), np.zeros(len(borders))
    for seen in (as_it_is, *without):
        freed = seen.freed(steps)
        own2 = np.square(freed).sum(axis=0)
        weight = (seen.left_mm @ freed) / np.maximum(own2, 1e-18)
        before2 = _squares(seen.left_mm)
        after2 = np.maximum(before2 - weight**2 * own2, 1e-18)
        spared = (parameters - seen.basis.shape[1] - 1) / 2 * np.log(count)
        rows = share * (count - parameters) / 2
        gained = np.minimum(rows * np.log(whole2 / after2) + spared, rows * np.log(before2 / after2))
        better = (own2 > LEAST_OWN_SHARE * apart2) & (gained > nats)
        nats, weights = np.where(better, gained, nats), np.where(better, weight, weights)
    sizes_mm = np.abs(weights) * np.std(steps, axis=0)
    return [
        Cause(motor, border, np.array([weight]), float(size_mm), float(gained))
        for border, weight, size_mm, gained in zip(borders, weights, sizes_mm, nats, strict=True)
    ]


def _squares(left_mm: np.ndarray) -> float:
    return max(float(left_mm @ left_mm), 1e-18)
