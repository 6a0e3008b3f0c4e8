"""Walls show one direction only: both motors, the part's turn and what all walls share, learned together.

A wall with the normal n (out of the plastic) that came to lie ``offset`` along it says n·(printed − commanded) + swell
= offset, where ``swell`` is what beads are wider than thought: elephant's foot moves every wall outwards. With the last
contacts known this is linear in the parameters of both motors (physics.md §4), and one ridge least squares with the
evidence's own prior scales (MacKay) solves all of it. What the walls cannot tell keeps its prior.
"""

from dataclasses import dataclass, replace

import numpy as np

from printmend.errors import TraceError
from printmend.identify.drive.design import Contacts, Rows, contacts
from printmend.learn.greybox.rows import INDEPENDENT_WALLS, wall_shares
from printmend.path import FLATBED, Trace
from printmend.printer import Printer
from printmend.saved import Design, bed_middle
from printmend.units import SIGMA_PER_MEDIAN

DESIGN = Design(mean_powers=2, play_powers=1, mean_harmonics=tuple(range(1, 13)), play_harmonics=(1, 3))
MOST_FITS, WEIGHINGS = 14, 3  # rounds of contacts and least squares; in each, how often places are weighed anew
# Prior standard deviations. The evidence scales those that are in a group (`_priors`).
SHIFT_SD_MM, SCALE_SD_MM, PLAY_SD_MM = 10.0, 0.4, 0.3  # of a motor's shift, its scale [mm in 100], its play
WAVE_SD_MM, WAVE_FALL = 0.1, 2.0  # of the first harmonic of a turn; the nth has 1/n to this power of it
SWELL_SD_MM = 0.25  # of what beads are too wide
TURN_SD, SKEW_SD_MM = 10.0, 0.5  # of the part's turn on the glass, and of skew [mm in 100]
NEVER_SD = 1e-6  # of what is not to be fitted
# Groups of parameters whose prior the evidence scales together; those of play and waves are one a motor.
NO_GROUP, SCALES, PLAYS, MEAN_WAVES, PLAY_WAVES, SKEW = 0, 1, 2, 4, 6, 8
SCALES_RANGE = (0.02, 100.0)  # factors by which the evidence may scale a prior's standard deviation
HUBER_SIGMAS = 2.0  # standard deviations, beyond which a place counts less
LOST_SIGMAS = 5.0  # standard deviations, beyond which a place does not count
LEAST_SIGMA_MM = 0.004  # smallest standard deviation of a wall's place: no scan is read better
LEAST_WALLS = 40  # measured places of walls; from fewer nothing is learned
LEAST_INDEPENDENT = 0.08  # least share of the places that is taken to tell something of its own


@dataclass(frozen=True, eq=False)
class WallFit:
    """What the walls say.

    ``printed_mm`` [N, 2] is where every way-point came to lie on the bed, the turn of the part taken off; ``swell_mm``
    is how far all walls stand out, ``turn`` [rad] how much farther the part lay turned, counter-clockwise, and
    ``residual_mm`` [W] what each wall lies off, NaN where one was left out; ``sigma_mm`` their standard deviation.
    ``scale_sd`` is how well the common scale of x and y is known beside the swell (a share).
    """

    printed_mm: np.ndarray
    swell_mm: float
    turn: float
    residual_mm: np.ndarray
    sigma_mm: float
    scale_sd: float


def fit_walls(trace: Trace, printer: Printer, *, turned: bool = True, harmonics: int = 12) -> WallFit:
    """Fit the walls of a trace. ``turned`` lets the part lie turned; fewer ``harmonics`` are steadier at first.

    Raises `TraceError` for fewer than forty walls.
    """
    walls = np.flatnonzero(trace.wall_rows)
    if len(walls) < LEAST_WALLS or trace.normal is None or trace.offset_mm is None:
        raise TraceError(
            "trace", wanted=f"at least {LEAST_WALLS} measured places of walls", came=f"{len(walls)}",
            todo="measure more of the part",
        )  # fmt: skip
    design = replace(DESIGN, mean_harmonics=DESIGN.mean_harmonics[:harmonics])
    normal, offset = trace.normal[walls], trace.offset_mm[walls]
    share = printer.to_motor(normal) / (2.0 if printer.kinematics == "corexy" else 1.0)
    motor = np.asarray(printer.to_motor(trace.commanded_mm), float)
    rows = [_rows(motor[:, i], printer, i) for i in range(2)]
    frame = _frame(trace.commanded_mm[walls], normal, printer, turned=turned)
    group, sd = _priors(design, frame.shape[1])
    sd[-1] = TURN_SD if turned else NEVER_SD
    values, scale, sigma = np.zeros(len(sd)), np.ones(group.max() + 1), 0.05
    weight = np.full(len(walls), INDEPENDENT_WALLS)
    best: tuple[float, WallFit] | None = None
    for passed in range(MOST_FITS):
        touches = [contacts(design, _own(values, design, i), one) for i, one in enumerate(rows)]
        fitted, base = _columns(design, touches, rows, walls, share, frame)
        wanted = offset - base
        for _ in range(WEIGHINGS):
            values, covariance, scale = _solved(fitted, wanted, weight, sd, group, scale, sigma)
            residual = wanted - fitted @ values
            sigma = max(SIGMA_PER_MEDIAN * float(np.median(np.abs(residual))), LEAST_SIGMA_MM)
            away = np.abs(residual) / sigma
            weight = (
                _independent(residual, sigma)
                * np.minimum(1.0, HUBER_SIGMAS / np.maximum(away, 1e-9))
                * (away < LOST_SIGMAS)
            )
        touches = [contacts(design, _own(values, design, i), one) for i, one in enumerate(rows)]
        after, base = _columns(design, touches, rows, walls, share, frame)
        left = offset - base - after @ values
        loss = float(np.abs(left).mean())
        if best is None or loss < best[0] * (1 - 1e-4):
            best = loss, _found(design, values, covariance, touches, left, sigma, motor, trace, printer)
        elif passed > MOST_FITS // 2:
            break
    assert best is not None
    return best[1]


def _independent(residual: np.ndarray, sigma: float) -> float:
    """Return the share of walls [W], in their order, that tell something of their own.

    Where neighbours are correlated by ρ at a distance, 1 + 2 Σ ρ of them tell the same.
    """
    clipped = np.clip(residual, -3 * sigma, 3 * sigma)
    square = float(clipped @ clipped) + 1e-12
    alike = [max(float(clipped[:-lag] @ clipped[lag:]) / square, 0.0) for lag in range(1, 9)]
    return float(np.clip(1 / (1 + 2 * sum(alike)), LEAST_INDEPENDENT, INDEPENDENT_WALLS))


def _own(values: np.ndarray, design: Design, motor: int) -> np.ndarray:
    """Return the parameters of one motor among those of both and of the frame."""
    return values[motor * design.size : (motor + 1) * design.size]


def _rows(motor_mm: np.ndarray, printer: Printer, motor: int) -> Rows:
    """Return the commanded rows of one motor, of which none is measured: contacts are all that is asked of them."""
    nothing = np.full(len(motor_mm), np.nan)
    middle = bed_middle(printer)
    return Rows(
        np.ascontiguousarray(motor_mm), nothing, np.zeros(len(motor_mm)), nothing, nothing,
        printer.axes[motor].mm_per_turn, float(middle[motor]), float(motor_mm[0]),
        (float(middle[motor]), float(middle[1 - motor])),
    )  # fmt: skip


def _frame(commanded: np.ndarray, normal: np.ndarray, printer: Printer, *, turned: bool) -> np.ndarray:
    """Return the columns [W, 3] of skew (a CoreXY's: x and y scaled apart), of the swell, and of a turn by 0.01 rad."""
    middle = printer.from_motor(bed_middle(printer))
    x, y = ((commanded - middle) / 100.0).T
    skew = normal[:, 0] * y if printer.kinematics == "cartesian" else normal[:, 0] * x - normal[:, 1] * y
    turn = normal[:, 1] * x - normal[:, 0] * y
    return np.stack([skew, np.ones(len(x)), turn], axis=1)


def _priors(design: Design, frame: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the group of every parameter [P] and the prior standard deviations [P]."""
    count = design.size
    group, sd = np.zeros(2 * count + frame, np.int64), np.empty(2 * count + frame)
    for motor in range(2):
        at = {name: slice(part.start + motor * count, part.stop + motor * count) for name, part in design.parts.items()}
        sd[at["start"]] = NEVER_SD
        sd[at["mean_powers"]] = (SHIFT_SD_MM, SCALE_SD_MM)
        group[at["mean_powers"]] = (NO_GROUP, SCALES)
        sd[at["play_powers"]], group[at["play_powers"]] = PLAY_SD_MM, PLAYS + motor
        for kind, first in (("mean", MEAN_WAVES), ("play", PLAY_WAVES)):
            for half in ("cos", "sin"):
                part = at[f"{kind}_{half}"]
                sd[part] = WAVE_SD_MM * design.waves(kind).astype(float) ** -WAVE_FALL
                group[part] = first + motor
    sd[2 * count :] = (SKEW_SD_MM, SWELL_SD_MM, TURN_SD)
    group[2 * count] = SKEW
    return group, sd


def _columns(
    design: Design, touches: list[Contacts], rows: list[Rows], walls: np.ndarray, share: np.ndarray, frame: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the columns [W, P] of all parameters and what is there without any [W]: play that was never touched."""
    parts, base = [], np.zeros(len(walls))
    for motor, (touch, one) in enumerate(zip(touches, rows, strict=True)):
        at = np.maximum(touch.at[walls], 0)
        mean, play = design.columns(one.motor_mm[at], one.period_mm, one.origin_mm)
        parts.append((mean + touch.side[walls, None] / 2 * play) * share[:, [motor]])
        base += share[:, motor] * (one.motor_mm[at] - one.motor_mm[walls])
    return np.hstack([*parts, frame]), base


def _solved(
    columns: np.ndarray,
    wanted: np.ndarray,
    weight: np.ndarray,
    sd: np.ndarray,
    group: np.ndarray,
    scale: np.ndarray,
    sigma: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the values [P], their covariance, and the priors' scales after MacKay's update."""
    root = sd * scale[group]
    scaled = columns * root
    matrix = scaled.T @ (weight[:, None] * scaled) / sigma**2 + np.eye(len(root))
    inverse = np.linalg.inv(matrix)
    white = inverse @ (scaled.T @ (weight * wanted)) / sigma**2
    settled = 1 - np.diag(inverse)
    updated = scale.copy()
    for one in range(1, len(scale)):
        mine = group == one
        ratio = (float(np.square(white[mine]).sum()) + 0.1) / (float(settled[mine].sum()) + 0.1)
        updated[one] = np.clip(scale[one] * np.sqrt(np.clip(ratio, 0.05, 20.0)), *SCALES_RANGE)
    return root * white, inverse * np.outer(root, root), updated


def _found(
    design: Design, values: np.ndarray, covariance: np.ndarray, touches: list[Contacts], left: np.ndarray,
    sigma: float, motor: np.ndarray, trace: Trace, printer: Printer,
) -> WallFit:  # fmt: skip
    belt = np.stack([touch.belt_mm for touch in touches], axis=1)
    printed = np.array(printer.from_motor(belt), float)
    x, y = ((trace.commanded_mm - printer.from_motor(bed_middle(printer))) / 100.0).T
    skew, swell, turn = values[2 * design.size :]
    printed += np.stack([y, np.zeros_like(y)] if printer.kinematics == "cartesian" else [x, -y], axis=1) * skew
    gains = [motor * design.size + design.scale_at for motor in range(2)]
    scale_sd = float(np.sqrt(covariance[np.ix_(gains, gains)].sum())) / 2 / 100.0
    residual = np.where(np.abs(left) < LOST_SIGMAS * sigma, left, np.nan)
    return WallFit(printed, float(swell), float(turn) / 100.0, residual, sigma, scale_sd)


def completed(trace: Trace, printer: Printer, printed_mm: np.ndarray, residual_mm: np.ndarray) -> Trace:
    """Return the trace with both coordinates of every wall, for learners that see each motor by itself.

    The wall's residual [W] is added to where the fit ``printed_mm`` [N, 2] has the place, as if the motor that it goes
    to (`wall_shares`) had to explain all of it.
    """
    walls = np.flatnonzero(trace.wall_rows)
    assert trace.normal is not None
    share = printer.to_motor(trace.normal[walls]) / (2.0 if printer.kinematics == "corexy" else 1.0)
    belt = np.array(printer.to_motor(printed_mm[walls]), float)
    full = wall_shares(trace, printer)[walls] > 0
    step = np.where(full, residual_mm[:, None] / np.where(full, share, 1.0), 0.0)
    measured = np.array(trace.measured_mm)
    measured[walls] = printer.from_motor(belt + step)
    return replace(trace, measured_mm=measured)


def with_walls(trace: Trace, printer: Printer) -> Trace:
    """Return a trace that every learner can read: its walls completed to places. One without walls comes back as it is.

    How well the walls tell a scale of both axes from the width of beads is added to the instrument's doubt.
    """
    if not trace.wall_rows.any():
        return trace
    fit = fit_walls(trace, printer, turned=not trace.placed)
    instrument = trace.instrument or FLATBED
    instrument = replace(instrument, scale_sd=float(np.hypot(instrument.scale_sd, fit.scale_sd)))
    return replace(completed(trace, printer, fit.printed_mm, fit.residual_mm), instrument=instrument)
