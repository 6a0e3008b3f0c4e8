"""The grey box: identify a broken machine from one trace.

Per motor, lower and upper branches of generalised play as short series (`saved.branches`), fitted by iterating
contacts and robust ridge least squares (`drive.fit`), with no more parts than the trace supports
(`drive.select`); then the frame that couples the axes. Equations: physics.md §1–4.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from printmend.errors import TraceError
from printmend.learn.drive.design import Rows, contacts, cross_columns
from printmend.learn.drive.doubt import Doubt, doubt
from printmend.learn.drive.jumps import find_jumps
from printmend.learn.drive.kernels import columns as kernels
from printmend.learn.drive.ladder import Jump, jumped
from printmend.learn.drive.layout import TABLE, bed_middle
from printmend.learn.drive.rest import CENTRED, rest_shares
from printmend.learn.drive.select import HARMONICS, Choice, Structure, fitted, folded, prune, refined, search
from printmend.learn.drive.sight import GLIMPSED, SEEN, Sight, check_follows, sight
from printmend.learn.mechanism_model import MachineLearned
from printmend.learn.pulley.choice import outlined
from printmend.machine.mechanism import Frame, Mechanism
from printmend.path import Trace
from printmend.printer import Printer
from printmend.saved.branches import Branches
from printmend.units import TURN_RAD

MIN_MEASURED = 10
FAR_MM = 1e5
TRIAL_ROWS = 4000  # measured rows that the search for contacts and parts looks at
SIGMA_RANGE_MM = (1e-3, 10.0)
ONE_PHASE = 0.99  # the mean of unit vectors at the phases of a wave that is met at one of them only
ROUNDING_SHOWS = 2.0  # stops on micro-steps are looked for where the mean residual is below so many of them


@dataclass(frozen=True, eq=False)
class Drive:
    """What was learned of one motor: its ``branches``, the fit they come from and what the trace could see.

    ``doubt`` is what the parts that were left out may do; None where less than a turn was seen, and all is a guess.
    """

    name: str
    branches: Branches
    choice: Choice
    sight: Sight
    doubt: Doubt | None = None

    @property
    def structure(self) -> Structure:
        return self.choice.structure

    @property
    def noise_mm(self) -> float:
        """Standard deviation of the measured points about the fit [mm]."""
        return self.choice.fit.posterior.sigma_mm

    def sd_mm(self, motor_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the standard deviations (lower, upper) [mm] of the learned branches at motor positions [N].

        They rest on the posterior of the chosen parts, and on the doubt whether there are more of them. What the trace
        did not visit has the prior's width.
        """
        design, post = self.choice.design, self.choice.fit.posterior
        at_mm, turn_mm, middle_mm = np.asarray(motor_mm, float), self.branches.period_mm, self.branches.middle_mm
        mean, play = design.columns(at_mm, turn_mm, middle_mm)
        widths = []
        for side in (-0.5, 0.5):
            columns = (mean + side * play)[:, post.active]
            variance = np.einsum("ij,jk,ik->i", columns, post.covariance, columns)
            if self.doubt is not None:
                rest, rest_play = self.doubt.design.columns(at_mm, turn_mm, middle_mm)
                variance += self.doubt.variances(rest + side * rest_play)
            widths.append(np.sqrt(variance))
        return widths[0], widths[1]


@dataclass(frozen=True, eq=False)
class GreyboxModel(MachineLearned):
    """A learned machine; a world model.

    ``mechanism`` is absolute: its tables give positions in the frame of the measurement. Residuals are the RMS distance
    of the measured points from where a healthy machine (``before``) and the learned one (``after``) would put them.
    ``jumps`` happened during the print, a motor each: taken out before the fit, they are no part of the machine.
    """

    mechanism: Mechanism
    drives: tuple[Drive, Drive]
    measured: int
    residual_before_mm: float
    residual_after_mm: float
    jumps: tuple[tuple[Jump, ...], tuple[Jump, ...]] = ((), ())

    @property
    def is_healthy(self) -> bool:
        return self.mechanism.frame.is_identity and all(drive.branches.is_healthy for drive in self.drives)

    @property
    def noise_mm(self) -> float:
        """Standard deviation of a measured coordinate about the model [mm]."""
        variance = np.mean([drive.noise_mm**2 for drive in self.drives])
        # a motor of a CoreXY is the sum of two coordinates
        return float(np.sqrt(variance / (2 if self.printer.kinematics == "corexy" else 1)))

    @property
    def imagined(self) -> Mechanism:
        return self.mechanism


@dataclass(frozen=True)
class Greybox:
    """The learner: physics.md §4."""

    name: str = "greybox"

    def fit(self, trace: Trace, printer: Printer, *, rng: np.random.Generator) -> GreyboxModel:
        """Learn from a trace; ``rng`` picks the rows that the search looks at in a long one.

        Raises `TraceError` where fewer than ten points were measured or a commanded position is missing.
        """
        # Threads of the linear algebra cost more than they bring on systems of a hundred unknowns.
        with threadpool_limits(1, user_api="blas"):
            return learned(trace, printer, rng)


def learned(
    trace: Trace,
    printer: Printer,
    rng: np.random.Generator,
    *,
    complete: Callable[[Rows, Choice], Choice] = lambda rows, choice: choice,
) -> GreyboxModel:
    """Learn from a trace; ``complete`` may say more of each motor than its rows did."""
    _check(trace)
    full = motor_rows(trace, printer)
    for row, name in zip(full, printer.motors, strict=True):
        check_follows(row, name)
    keep, use = _trial(full, rng)
    rows = full if keep.all() and use.all() else _subset(full, keep, use)
    found = [search(row) for row in rows]
    rows, found, rounded = _rounded(rows, found, printer)
    jumps, found = _jumps(rows, found, printer)
    rows = [jumped(row, taken) for row, taken in zip(rows, jumps, strict=True)]
    rows = with_belts(rows, found)
    ripples = [_ripple_seen(row, ripple_harmonics(printer, motor)) for motor, row in enumerate(rows)]
    chosen = [
        fitted(row, _glimpsed(row, prune(row, start, ripple)), ripple, start, passes=6)
        for row, start, ripple in zip(rows, found, ripples, strict=True)
    ]
    chosen = [
        folded(row, choice, ripple) if GLIMPSED < sight(row, choice.fit.touch).angles < SEEN else choice
        for row, choice, ripple in zip(rows, chosen, ripples, strict=True)
    ]
    for _ in range(2 if any(choice.design.cross for choice in chosen) else 0):
        rows = with_belts(rows, chosen)
        chosen = [_again(row, choice, ripple, 2) for row, choice, ripple in zip(rows, chosen, ripples, strict=True)]
    if not (keep.all() and use.all()):
        full = _quantised(full, printer) if rounded else full
        places = np.flatnonzero(keep)
        jumps = [tuple(replace(jump, row=int(places[jump.row])) for jump in taken) for taken in jumps]
        full = [jumped(row, taken) for row, taken in zip(full, jumps, strict=True)]
        full = with_belts(full, chosen)
        chosen = [_again(row, choice, ripple, 2) for row, choice, ripple in zip(full, chosen, ripples, strict=True)]
        rows = full
    model = model_of(trace, printer, rows, [outlined(*each, complete) for each in zip(rows, chosen, strict=True)])
    drives = [
        replace(drive, doubt=doubt(row, choice, ripple)) if drive.sight.angles >= SEEN else drive
        for drive, row, choice, ripple in zip(model.drives, rows, chosen, ripples, strict=True)
    ]
    return replace(model, drives=(drives[0], drives[1]), jumps=(jumps[0], jumps[1]))


def _glimpsed(rows: Rows, structure: Structure) -> Structure:
    """Keep an offset and play of a motor that hardly moved: a pulley's waves would pass for its offset."""
    low_mm, high_mm = rows.reach_mm
    if high_mm - low_mm > GLIMPSED * rows.period_mm:
        return structure
    shifted = structure.offset or structure.scale or structure.pulley != "none"
    play = "none" if structure.play == "none" else "constant"
    return Structure(offset=shifted, scale=False, cross=0, pulley="none", play=play)


def _jumps(rows: list[Rows], found: list[Choice], printer: Printer) -> tuple[list[tuple[Jump, ...]], list[Choice]]:
    pairs = [find_jumps(row, start, printer.axes[i]) for i, (row, start) in enumerate(zip(rows, found, strict=True))]
    return [pair[0] for pair in pairs], [pair[1] for pair in pairs]


def _again(rows: Rows, choice: Choice, ripple: tuple[int, ...], passes: int) -> Choice:
    return fitted(rows, choice.structure, ripple, choice, passes=passes)


def _check(trace: Trace) -> None:
    if not np.isfinite(trace.commanded_mm).all():
        raise TraceError(
            "trace", wanted="every commanded way-point", came="NaN", todo="only measured cells may be empty"
        )
    known = np.isfinite(trace.measured_mm)
    if (far := np.abs(trace.measured_mm, where=known, out=np.zeros(known.shape)).max(initial=0.0)) > FAR_MM:
        raise TraceError("trace", wanted="positions on a bed, in mm", came=f"{far:g}", todo="leave wrong cells empty")
    counts = known.sum(axis=0)
    if len(trace) < MIN_MEASURED or counts.min() < MIN_MEASURED:
        raise TraceError(
            "trace",
            wanted=f"at least {MIN_MEASURED} measured points",
            came=f"{int(counts.min())} in {len(trace)} rows",
            todo="measure more of the print; `printmend probe` makes one that is worth measuring",
        )


def motor_rows(trace: Trace, printer: Printer) -> list[Rows]:
    """Return the trace as seen by each motor."""
    measured = np.where(np.isfinite(trace.measured_mm), trace.measured_mm, np.nan)
    motor, belt = printer.to_motor(trace.commanded_mm), printer.to_motor(measured)
    weight = np.ones(len(trace))
    if trace.sigma_mm is not None and (known := np.isfinite(trace.sigma_mm) & (trace.sigma_mm > 0)).any():
        sigma = np.where(known, trace.sigma_mm, np.median(trace.sigma_mm[known]))
        sigma = np.clip(sigma, *SIGMA_RANGE_MM)
        weight = np.square(np.median(sigma) / sigma)
    middle = bed_middle(printer)
    where = np.where(np.isfinite(belt), belt, motor) - middle
    rows = []
    for i in range(2):
        known = np.isfinite(belt[:, i])
        if known.sum() < MIN_MEASURED:
            raise TraceError(
                "trace", wanted=f"{MIN_MEASURED} points for motor {printer.motors[i]}", came=f"{int(known.sum())}",
                todo="measure both coordinates of more points",
            )  # fmt: skip
        rows.append(
            Rows(
                motor_mm=np.ascontiguousarray(motor[:, i], float),
                measured_mm=np.ascontiguousarray(belt[:, i]),
                weight=np.where(known, weight, 0.0),
                own_mm=np.ascontiguousarray(where[:, i]),
                other_mm=np.ascontiguousarray(where[:, 1 - i]),
                period_mm=printer.axes[i].mm_per_turn,
                origin_mm=float(motor[0, i]),
                start_mm=float(belt[np.argmax(known), i]),
                middle_mm=(float(middle[i]), float(middle[1 - i])),
            )
        )
    return rows


def ripple_harmonics(printer: Printer, motor: int) -> tuple[int, ...]:
    """Return the harmonics of micro-step ripple, of periods of 4, 2 and 1 full steps (physics.md eq. 16)."""
    steps = printer.axes[motor].steps_per_turn
    return tuple(k for k in (steps // 4, steps // 2, steps) if HARMONICS < k <= TABLE // 8)


def _ripple_seen(rows: Rows, harmonics: tuple[int, ...]) -> tuple[int, ...]:
    """Leave out a harmonic that the rows meet at one phase only, as whole steps do that of one step: there it is an
    offset, and taken for a ripple it would tear the tables between the steps."""
    turns = rows.motor_mm[rows.weight > 0] / rows.period_mm
    return tuple(k for k in harmonics if abs(np.exp(1j * TURN_RAD * k * turns).mean()) < ONE_PHASE)


def _trial(rows: list[Rows], rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows [N] that the search keeps, and those whose measurement it uses; both motors keep the same."""
    count = len(rows[0])
    measured = np.flatnonzero((rows[0].weight > 0) | (rows[1].weight > 0))
    use = np.ones(count, bool)
    if len(measured) > TRIAL_ROWS:
        use[:] = False
        use[rng.choice(measured, TRIAL_ROWS, replace=False)] = True
    keep = np.zeros(count, bool)
    wanted = np.zeros(count, bool)
    wanted[measured] = use[measured]
    for row in rows:
        turning = np.zeros(count, bool)
        kernels.turning_rows(row.motor_mm, wanted, turning)
        keep |= turning
    return keep, use


def _subset(rows: list[Rows], keep: np.ndarray, use: np.ndarray) -> list[Rows]:
    return [row.subset(keep, use) for row in rows]


def _quantised(rows: list[Rows], printer: Printer) -> list[Rows]:
    quantised = []
    for i, row in enumerate(rows):
        pitch_mm = printer.axes[i].mm_per_step / printer.axes[i].microsteps
        quantised.append(replace(row, motor_mm=np.rint(row.motor_mm / pitch_mm) * pitch_mm))
    return quantised


def _rounded(rows: list[Rows], found: list[Choice], printer: Printer) -> tuple[list[Rows], list[Choice], bool]:
    """Let the motors stop on micro-steps where that explains the measurement better: it does where noise is small."""
    stopped = _quantised(rows, printer)
    if all(np.array_equal(a.motor_mm, b.motor_mm) for a, b in zip(rows, stopped, strict=True)):
        return rows, found, False
    noise = min(choice.fit.loss_mm for choice in found)
    if noise > ROUNDING_SHOWS * printer.x.mm_per_step / printer.x.microsteps:
        return rows, found, False
    again = [refined(row, choice) for row, choice in zip(stopped, found, strict=True)]
    before, after = (sum(choice.fit.loss_mm for choice in choices) for choices in (found, again))
    return (stopped, again, True) if after < 0.97 * before else (rows, found, False)


def with_belts(rows: list[Rows], choices: list[Choice]) -> list[Rows]:
    """Put the belts where the models say, for the frame's terms; the measurement was only a first guess."""
    if not any(choice.design.cross for choice in choices):
        return rows
    belts, starts = [], []
    for row, choice in zip(rows, choices, strict=True):
        values = choice.fit.posterior.values
        belts.append(contacts(choice.design, values, row).belt_mm)
        first = int(np.argmax(row.weight > 0))
        cross = cross_columns(choice.design, row, slice(first, first + 1)) @ values[choice.design.parts["cross"]]
        starts.append(float(row.measured_mm[first] - cross[0]))
    updated = []
    for i, row in enumerate(rows):
        own, other = belts[i] - row.middle_mm[0], belts[1 - i] - row.middle_mm[1]
        updated.append(replace(row, own_mm=own, other_mm=other, start_mm=starts[i]))
    return updated


def model_of(trace: Trace, printer: Printer, rows: list[Rows], chosen: list[Choice]) -> GreyboxModel:
    drives = []
    for i, (row, choice) in enumerate(zip(rows, chosen, strict=True)):
        branches = choice.design.branches(
            choice.fit.posterior.values, period_mm=row.period_mm, origin_mm=row.origin_mm, reach_mm=row.reach_mm
        )
        drives.append(Drive(printer.motors[i], branches, choice, sight(row, choice.fit.touch)))
    frame = _frame(printer, chosen)
    tables = (drives[0].branches.lower(printer, 0), drives[1].branches.lower(printer, 1))
    known = trace.measured_rows
    before = np.sqrt(np.mean(np.sum((trace.measured_mm - trace.commanded_mm)[known] ** 2, axis=1)))
    residual = np.stack([choice.fit.touch.residual_mm for choice in chosen], axis=1)
    after = np.sqrt(np.nanmean(np.sum(printer.from_motor(residual)[known] ** 2, axis=1)))
    # After homing the engaged side is known; no layer starts there.
    rests = CENTRED if trace.homed else rest_shares(rows, chosen)
    mechanism = Mechanism(printer, tables, frame, rest_share=rests)
    return GreyboxModel(mechanism, (drives[0], drives[1]), int(known.sum()), float(before), float(after))


def _frame(printer: Printer, chosen: list[Choice]) -> Frame:
    """Return the learned cross terms as a `Frame`: cubic in motor coordinates, hence cubic on the bed."""
    if not any(choice.design.cross for choice in chosen):
        return Frame()
    x = np.linspace(printer.x.min_mm, printer.x.max_mm, 5)
    y = np.linspace(printer.y.min_mm, printer.y.max_mm, 5)
    bed = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    motor = printer.to_motor(bed) - bed_middle(printer)
    moved = np.zeros_like(motor)
    for i, choice in enumerate(chosen):
        values = choice.fit.posterior.values[choice.design.parts["cross"]]
        for (p, q), value in zip(choice.design.cross, values, strict=True):
            moved[:, i] += value * (motor[:, i] / 100.0) ** p * (motor[:, 1 - i] / 100.0) ** q
    coefficients = np.linalg.lstsq(Frame().terms(bed), printer.from_motor(moved), rcond=None)[0].T
    coefficients[np.abs(coefficients) < 1e-9] = 0.0
    return Frame(coefficients)


LEARNERS = {"greybox": Greybox()}
