"""Write down what a fit leaves unknown: the section ``promise`` of a saved model, which `budget` reads."""

from dataclasses import asdict, replace
from typing import Any

import numpy as np

from printmend.identify.drive import ALL_SEEN, Design, bed_middle
from printmend.learn.greybox import LearnedDrive, motor_rows
from printmend.machine import Mechanism
from printmend.path import Trace
from printmend.printer import Printer
from printmend.promise.apply import Acting
from printmend.promise.budget import DIRECTIONS, LAYOUT, VERSION, MotorBudget
from printmend.promise.unexplained import unexplained
from printmend.twin import Twin

KEPT_VARIANCE_SHARE = 0.998  # share of the variance on the bed that the kept directions have
LEAST_CHANCE = 0.003  # that a part which was left out is there: fewer than one drawn machine of `predict.DRAWS` has it
NO_PARTS: dict[str, Any] = {"cross": 0, "warp": 0, "warp_span_mm": [0.0, 1.0]}
# Share of the variance that only a learned remainder explains which counts as not known: the remainder may differ in
# another print.
DOUBTED_SHARE = 0.05
PLACES_COMPARED = 400  # number of places along a motor's way at which the kept directions are compared


def promise_section(
    acts: Acting,
    trace: Trace,
    explained_mm: np.ndarray | None = None,
    left_mm: np.ndarray | None = None,
    doubt_mm2: tuple[float, float] = (0.0, 0.0),
) -> dict[str, Any]:
    """Return the budget of what acts of a learned machine as plain values: the section ``promise`` of its file.

    ``explained_mm`` [N, 2] is the effect of the misfits that were found on each row of both motors; it is no part of
    what stays unexplained. ``left_mm`` [N, 2] are the residuals where a remainder was learned beyond the parts of
    ``acts``, None where none was. ``doubt_mm2`` is the variance of that remainder by the scatter of its points.
    """
    fit = acts.fit
    rows = motor_rows(trace, fit.printer, fit.periods_mm)
    if (scatter_mm := instrument_scatter_mm(trace)) is not None:
        scatter_mm *= float(np.linalg.norm(fit.printer.to_motor(np.eye(2))[:, 0]))  # of a motor for either axis's
    motors = {}
    for motor, drive in enumerate(fit.drives):
        touch = drive.choice.fit.touch
        known = 0.0 if explained_mm is None else explained_mm[:, motor]
        # by commanded places: where a tower comes again and again, measured ones are in the order of their own noise
        seen = replace(rows[motor], own_mm=rows[motor].motor_mm, other_mm=rows[1 - motor].motor_mm)
        left = unexplained(seen, touch.residual_mm - known, touch.side, scatter_mm)
        if left_mm is not None:
            more = unexplained(seen, left_mm[:, motor] - known, touch.side, scatter_mm)
            if (less_mm2 := left.variance_mm2 - more.variance_mm2) > 0:
                left = replace(more, variance_mm2=more.variance_mm2 + DOUBTED_SHARE * less_mm2)
            left = replace(left, variance_mm2=left.variance_mm2 + doubt_mm2[motor])
        variance_mm2 = left.variance_mm2 + acts.still_mm2[motor]
        sd_mm2 = float(np.hypot(left.sd_mm2, acts.still_sd_mm2[motor]))
        motors[drive.name] = motor_section(drive, fit.printer, motor, variance_mm2, sd_mm2)
    section: dict[str, Any] = {"version": VERSION, "placed": trace.placed, "instrument": asdict(trace.instrument_doubt)}
    if acts.believed is not None:
        section["stretch"] = acts.believed.json()
    if acts.left_out:
        section["left_out"] = [asdict(each) for each in acts.left_out]
    return {**section, "motors": motors}


def instrument_scatter_mm(trace: Trace) -> float | None:
    """Return the standard deviation of a coordinate that the instrument states, None where it states none.

    None for walls, too: their stated deviation was estimated from their own scatter, the printer's included.
    """
    stated = np.zeros(0) if trace.sigma_mm is None else trace.sigma_mm[trace.measured_rows]
    stated = stated[np.isfinite(stated) & (stated > 0)]
    if not len(stated) or trace.wall_rows.any():
        return None
    return float(np.hypot(np.median(stated), trace.instrument_doubt.wave_mm))


def residual_section(mechanism: Mechanism, trace: Trace) -> dict[str, Any]:
    """Return the budget of a machine whose learner states no doubt: all of its residuals count as unexplained.

    The measurement's noise is included, so the promise is rather too cautious than too good.
    """
    printer = mechanism.printer
    known = trace.measured_rows
    left = printer.to_motor((trace.measured_mm - Twin(mechanism).follow(trace.commanded_mm))[known])
    if not trace.placed:
        left = left - left.mean(axis=0)
    motors = {}
    for motor, name in enumerate(printer.motors):
        low_mm, high_mm = printer.motor_range_mm(motor)
        variance = float(np.mean(left[:, motor] ** 2))
        motors[name] = {
            "parameters": {"mean_powers": 0, "play_powers": 0, **NO_PARTS}, "factor_mm": {},
            "period_mm": printer.axes[motor].mm_per_turn, "middle_mm": (low_mm + high_mm) / 2,
            "reach_mm": [low_mm, high_mm], "unexplained_mm2": float(f"{variance:.4g}"),
            "unexplained_sd_mm2": float(f"{variance * np.sqrt(2 / len(left)):.4g}"),
        }  # fmt: skip
    return {
        "version": VERSION, "placed": trace.placed, "instrument": asdict(trace.instrument_doubt), "motors": motors
    }  # fmt: skip


def motor_section(
    drive: LearnedDrive, printer: Printer, motor: int, unexplained_mm2: float, sd_mm2: float
) -> dict[str, Any]:
    """Return one motor's budget as plain values."""
    kind: dict[str, Any]
    if (machines := drive.choice.machines) is not None and drive.sight.angles < ALL_SEEN:
        design, factor, kind = drive.choice.design, machines, {"machines": True}
    else:
        design, factor, left_out = _kept(drive, printer, motor)
        kind = {"left_out": left_out} if left_out else {}
    layout = {name: list(map(int, getattr(design, name))) for name in LAYOUT if getattr(design, name)}
    powers = {"mean_powers": design.mean_powers, "play_powers": design.play_powers, "cross": len(design.cross)}
    return {
        "parameters": {
            **powers,
            **layout,
            "warp": design.warp,
            "warp_span_mm": list(design.warp_span_mm),
            **({"second_mm": design.second_mm} if design.second_harmonics else {}),
        },
        "period_mm": drive.branches.period_mm,
        "middle_mm": drive.branches.middle_mm,
        "reach_mm": [round(float(value), 6) for value in drive.branches.reach_mm],
        "factor_mm": {
            name: [[float(f"{value:.4g}") for value in row] for row in factor[part]]
            for name, part in design.parts.items()
            if part.stop > part.start and name != "start"
        },
        **kind,
        "seen": round(drive.sight.angles, 3),
        "unexplained_mm2": float(f"{unexplained_mm2:.4g}"),
        "unexplained_sd_mm2": float(f"{sd_mm2:.4g}"),
    }


def _kept(drive: LearnedDrive, printer: Printer, motor: int) -> tuple[Design, np.ndarray, list[list[float]]]:
    """Return the columns of a motor's parts, the directions [P, R] in which its parameters may be off, and how many of
    the last of them belong to each part that was left out, with its chance."""
    design, parts = _joined(drive)
    low, high = printer.motor_range_mm(motor)
    motor_mm = np.linspace(low, high, PLACES_COMPARED)
    own = motor_mm - bed_middle(printer)[motor]
    step = np.mod(np.arange(PLACES_COMPARED) * 0.7548776662, 1.0)  # a fixed, even walk over the other axis
    low, high = printer.motor_range_mm(1 - motor)
    other = low + (high - low) * step - bed_middle(printer)[1 - motor]
    side = np.where(np.arange(PLACES_COMPARED) % 2, 1.0, -1.0)
    turned, spreads = [], []
    for _, covariance in parts:
        values, axes = np.linalg.eigh(covariance)
        root = axes * np.sqrt(np.maximum(values, 0.0))
        plain = MotorBudget(
            design, root, drive.branches.period_mm, drive.branches.middle_mm, drive.branches.reach_mm, 0.0, 0.0
        )
        _, spread, axes = np.linalg.svd(plain.columns(motor_mm, own, other, side), full_matrices=False)
        turned.append(root @ axes.T)
        spreads.append(spread**2)
    counts = kept_directions(spreads)
    factor = np.hstack([each[:, :count] for each, count in zip(turned, counts, strict=True)])
    left_out = [[count, round(chance, 4)] for (chance, _), count in zip(parts[1:], counts[1:], strict=True) if count]
    return design, factor, left_out


def kept_directions(spreads: list[np.ndarray]) -> list[int]:
    """Return how many leading directions of each part are kept, from the variances of each part's, largest first.

    The first of the first part, of what was chosen, is in any case, and after it the largest of all up to
    `KEPT_VARIANCE_SHARE` of the sum, at most `DIRECTIONS` in all.
    """
    variances = np.concatenate(spreads)
    owner = np.repeat(np.arange(len(spreads)), [len(each) for each in spreads])
    order = np.concatenate([[0], 1 + np.argsort(-variances[1:], kind="stable")])
    share = np.cumsum(variances[order]) / max(float(variances.sum()), 1e-300)
    kept = min(int(np.searchsorted(share, KEPT_VARIANCE_SHARE)) + 1, DIRECTIONS)
    return np.bincount(owner[order[:kept]], minlength=len(spreads)).tolist()


def _joined(drive: LearnedDrive) -> tuple[Design, list[tuple[float, np.ndarray]]]:
    """Return the columns of the chosen parts and of those left out, and a list of chances and covariances [P, P].

    The first is the covariance of the chosen parts, with chance 1; each further one is what a part that was left out
    adds to it, with the chance that the part is there.
    """
    chosen = drive.choice.design
    post = drive.choice.fit.posterior
    own = np.zeros((chosen.size, chosen.size))
    own[np.ix_(post.active, post.active)] = post.covariance
    terms = [(1.0, chosen, own)]
    if drive.left_out is not None:
        likely = [each for each in drive.left_out.parts if each[0] > LEAST_CHANCE]
        terms += [(chance, drive.left_out.design, chance * covariance) for chance, covariance in likely]
    designs = [design for _, design, _ in terms]

    def waves(name: str) -> tuple[int, ...]:
        return tuple(sorted({k for each in designs for k in getattr(each, name)}))

    warped = max(designs, key=lambda each: each.warp)
    joined = Design(
        mean_powers=max(each.mean_powers for each in designs),
        play_powers=max(each.play_powers for each in designs),
        cross=max((each.cross for each in designs), key=len),
        ripple=waves("ripple"),
        mean_harmonics=waves("mean_harmonics"),
        play_harmonics=waves("play_harmonics"),
        elastic_harmonics=waves("elastic_harmonics"),
        warp=warped.warp,
        warp_span_mm=warped.warp_span_mm,
        second_harmonics=waves("second_harmonics"),
        second_mm=chosen.second_mm,
    )
    found = []
    for chance, design, covariance in terms:
        place = joined.moved(np.eye(design.size), design)  # [own, joined]
        total = place.T @ covariance @ place
        start = joined.parts["start"]
        total[start], total[:, start] = 0.0, 0.0
        found.append((chance, total))
    return joined, found
