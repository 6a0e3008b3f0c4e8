"""Findings about a measurement itself: rows left out, places never measured, rows in random order."""

import math
from collections.abc import Iterator

import numpy as np

from printmend.effects.teeth import TOOTH_MM
from printmend.infer.fit import NEAR_SHARES
from printmend.infer.machine import Part
from printmend.infer.posterior import Posterior
from printmend.measure.checks import RANDOM_SDS, in_no_order
from printmend.messages import say
from printmend.metrics.robust import scale_of
from printmend.model.model import NOTE, REFUSAL, WARNING, Misfit
from printmend.path import Trace
from printmend.printer import Printer
from printmend.promise.scatter import Outliers

FINEST_MM = 1e-4  # tables are written no finer
LEAST_ROWS = 60  # with fewer rows nothing is tested
LOST_SIGMAS, LOST_MM = 6.0, 0.05  # a point whose residual exceeds both limits was measured wrongly
MANY_LOST, MOST_LOST = 0.08, 0.3  # shares of such points from which on they are a warning, or a refusal
UNFIT_SHARE, UNFIT_MM = 0.4, 0.3  # a model that leaves this share of the error, and as many mm, does not fit
COUNTING_SHARE = 0.1  # share of the largest wave of a turn that another one must have to say how long the turn is
TWO_VALUED = 1.65  # kurtosis below which residuals take one of two values: even chances of a range give 1.8
NOISE_KURTOSIS = 3.0  # kurtosis of Gaussian noise
LEAST_TWO_MM, LEAST_SCATTER_MM = 0.03, 0.1  # root mean square of two values, and of other residuals, worth a word
SURE_NATS = 14.0  # what is certain by counting


def said_of_rows(posterior: Posterior, trace: Trace, left_mm: np.ndarray, lost: np.ndarray) -> tuple[Misfit, ...]:
    """Return the findings about a measurement, given the model's residuals on the bed [N, 2] mm, and which of its
    points [N] are left out."""
    known = np.isfinite(left_mm).all(axis=1)
    kept, few = known & ~lost, lost.sum() <= MOST_LOST * known.sum()
    return (
        *_unfit(trace, left_mm, kept if few else known),
        *_random_order(trace, left_mm[kept]),
        *_other_turns(posterior),
        *_left_out(left_mm[lost], trace.commanded_mm[lost], int(known.sum()), by_hand=trace.instrument is None),
    )


def lost_rows(left_mm: np.ndarray, least_mm: float = FINEST_MM) -> np.ndarray:
    """Return the points [N] that a model leaves out, by their residuals [N, 2] and the least that these scatter."""
    known = np.isfinite(left_mm).all(axis=1)
    if not known.any():
        return np.zeros(len(left_mm), bool)
    sigma = np.array([scale_of(each[known], max(least_mm, FINEST_MM)) for each in left_mm.T])
    with np.errstate(invalid="ignore"):
        away = np.abs(left_mm)
        return np.asarray(known & ((away > LOST_SIGMAS * sigma) & (away > LOST_MM)).any(axis=1))


def outliers_of(left_mm: np.ndarray, lost: np.ndarray) -> Outliers:
    """Return what the points that a model leaves out [N] say of those of a print, from their residuals [N, 2]."""
    return Outliers.of(left_mm[lost], int(np.isfinite(left_mm).all(axis=1).sum()))


def skipped(trace: Trace, turned: Trace, printer: Printer) -> Iterator[Misfit]:
    """Name motors that lost steps: by how much they ``turned`` less than they were told."""
    lost_mm = np.abs(printer.to_motor(turned.commanded_mm - trace.commanded_mm)).max(axis=0)
    for name, size_mm, axis in zip(printer.motors, lost_mm, printer.axes, strict=False):
        if size_mm > 0.5 * axis.mm_per_step:
            words = say("skipped-during-test-print-part-may", name.upper(), f"{size_mm:.2f}")
            yield Misfit("jump", WARNING, float(size_mm), 0.0, words)


def _unfit(trace: Trace, left_mm: np.ndarray, kept: np.ndarray) -> list[Misfit]:
    """Return a refusal where a model leaves too much of its own measurement's errors, at the points ``kept`` [N]."""
    off_mm = (trace.measured_mm - trace.commanded_mm)[kept]
    if not len(off_mm):
        return []
    left, whole = (float(np.sqrt(np.mean(np.square(each).sum(axis=1)))) for each in (left_mm[kept], off_mm))
    if left < max(UNFIT_MM, UNFIT_SHARE * whole):
        return []
    words = say("model-leaves-mm-mm-measurement-printer", f"{left:.2f}", f"{whole:.2f}")
    return [Misfit("unfit", REFUSAL, left, SURE_NATS, words)]


def _random_order(trace: Trace, kept: np.ndarray) -> list[Misfit]:
    """Report rows in random order whose residuals ``kept`` [N, 2] are like those of play with an unknown direction: one
    of two values.

    Errors that last from row to row, as lost steps do, say that the order is the print's all the same.
    """
    if len(kept) < LEAST_ROWS or not in_no_order(trace.commanded_mm):
        return []
    freed = kept - kept.mean(axis=0)
    lasting = (freed[1:] * freed[:-1]).sum(axis=0) / np.maximum(np.square(freed).sum(axis=0), 1e-18)
    if lasting.max() > RANDOM_SDS / np.sqrt(len(kept)):
        return []
    left = float(np.sqrt(np.mean(np.square(kept).sum(axis=1))))
    size_mm = np.sqrt(np.mean(np.square(kept), axis=0))
    kurtosis = np.mean(kept**4, axis=0) / np.maximum(size_mm**4, 1e-18)
    if ((kurtosis < TWO_VALUED) & (size_mm > LEAST_TWO_MM)).any():
        words = say("rows-random-order-mm-error-go", f"{left:.2f}")
        return [Misfit("rows-random", REFUSAL, left, SURE_NATS, words)]
    as_noise = (kurtosis > NOISE_KURTOSIS - RANDOM_SDS * np.sqrt(24 / len(kept))).all()  # 24/n: its variance by chance
    if left < LEAST_SCATTER_MM or (as_noise and left <= UNFIT_MM):
        return []
    words = say("rows-random-order-mm-stay-unexplained", f"{left:.2f}")
    return [Misfit("rows-random", REFUSAL if left > UNFIT_MM else WARNING, left, SURE_NATS, words)]


def _other_turns(posterior: Posterior) -> list[Misfit]:
    """Say where an error repeats at another length than the printer's turn."""
    found, scene = [], posterior.scene
    for motor, name in enumerate(scene.printer.motors):
        period, usual = scene.turns_mm[motor], scene.printer.axes[motor].mm_per_turn
        turning = [part for part in posterior.parts if part.effect in ("pulley", "breathing") and part.where == motor]
        turning = [part for part in turning if part.acts_mm.any()]
        if period == usual or not turning:
            continue
        if (times := _times_a_turn(turning[0])) > 1:  # a wave that comes so many times in it is all that repeats
            period /= times
        teeth = round(period / TOOTH_MM)
        is_toothed = times == 1 and abs(period - teeth * TOOTH_MM) < 1e-9
        cause = say("pulley-teeth-idler", teeth) if is_toothed else say("idler-belt-own-pulley")
        if abs(period / usual - 1) < NEAR_SHARES.max():
            cause = say("steps-millimetre-calibrated-another-pulley")
        words = say("error-repeats-every-mm-every-printer", name.upper(), f"{period:.1f}", f"{usual:g}", cause)
        found.append(Misfit("turn", NOTE, 0.0, SURE_NATS, words))
    return found


def _times_a_turn(part: Part) -> int:
    """Return how often the learned turn repeats itself: the greatest divisor of its waves' orders that count."""
    sizes = np.hypot(*part.acts_mm.reshape(2, -1))
    return math.gcd(*(int(k) + 1 for k in np.flatnonzero(sizes > COUNTING_SHARE * sizes.max(initial=0.0)))) or 1


def _left_out(lost_mm: np.ndarray, commanded_mm: np.ndarray, known: int, *, by_hand: bool) -> list[Misfit]:
    """Count the points that the model leaves out, of so many that are ``known``, by their residuals [M, 2]; name the
    place of a single one. Rows of a table that is ``by_hand`` may be wrong."""
    if not len(lost_mm):
        return []
    count, share = len(lost_mm), len(lost_mm) / known
    size = float(np.sqrt(np.mean(np.square(lost_mm).sum(axis=1))))
    severity = REFUSAL if share > MOST_LOST else WARNING if share > MANY_LOST else NOTE
    many = "points-lie-mm-off-left-out" if by_hand else "points-of-picture-lie-mm-off"
    message = many if share > MANY_LOST else "points-lie-mm-off-left-out-2"
    words = say(message, count, known, f"{100 * share:.1f}", f"{size:.2f}")
    if count == 1:
        words = say("point-lies-mm-off-left-out", *(f"{mm:g}" for mm in commanded_mm[0]), known, f"{size:.2f}")
    return [Misfit("left-out", severity, size, float(count), words)]
