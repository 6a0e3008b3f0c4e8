"""The grey box: identify a broken machine from one trace.

Each motor's lower and upper branches of generalised play are short series (`model.branches`), fitted by iterating
contacts and robust ridge least squares (`drive.fit`), with no more parts than the trace supports (`drive.select`). Then
follow the frame, which couples the axes, and the shapes of pulleys that were seen in part. Equations: physics.md §1–4.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from printmend.errors import TraceError
from printmend.learn.walls import wall_shares
from printmend.measure.checks import LEAST_MEASURED, check_trace
from printmend.path import Trace
from printmend.printer import Printer
from printmend.units import TURN_RAD
from printmend_lab.greybox.drive import Jump, jumped, kernels
from printmend_lab.greybox.drive.design import Rows, contacts, cross_columns
from printmend_lab.greybox.drive.fit import ALL_SEEN, GLIMPSED_TURN, seen_share
from printmend_lab.greybox.drive.jumps import find_jumps
from printmend_lab.greybox.drive.period import turned, with_second
from printmend_lab.greybox.drive.select import HARMONICS, Choice, Structure, fitted, folded, left_out, prune, refined
from printmend_lab.greybox.layout import TABLE_PHASES, bed_middle
from printmend_lab.greybox.model import GreyboxModel, model_of
from printmend_lab.greybox.pulley import outlined

# A trace as each motor sees it: its rows, and which of them the search for contacts and parts looks at.

TRIAL_ROWS = 4000  # measured rows that the search for contacts and parts looks at; the last fit uses all
SIGMA_RANGE_MM = (1e-3, 10.0)  # stated standard deviations beyond these are taken for these
INDEPENDENT_WALLS = 0.25  # share of a wall's places that are: a bead is too wide or narrow for some millimetres
ONE_PHASE_MEAN = 0.99  # length of the mean of e^{ikφ} above which the rows meet a wave at one phase only


def motor_rows(trace: Trace, printer: Printer, periods_mm: tuple[float, float] | None = None) -> list[Rows]:
    """Return a trace as either motor sees it, with the turns of ``periods_mm`` or else those of the printer.

    Raises `TraceError` where a motor has fewer than ten measured points.
    """
    measured = np.where(np.isfinite(trace.measured_mm), trace.measured_mm, np.nan)
    motor, belt = printer.to_motor(trace.commanded_mm), printer.to_motor(measured)
    weight = np.ones(len(trace))
    if trace.sigma_mm is not None and (known := np.isfinite(trace.sigma_mm) & (trace.sigma_mm > 0)).any():
        sigma = np.where(known, trace.sigma_mm, np.median(trace.sigma_mm[known]))
        sigma = np.clip(sigma, *SIGMA_RANGE_MM)
        weight = np.square(np.median(sigma) / sigma)
    shares = wall_shares(trace, printer)
    middle = bed_middle(printer)
    where = np.where(np.isfinite(belt), belt, motor) - middle
    rows = []
    for i in range(2):
        known = np.isfinite(belt[:, i])
        if known.sum() < LEAST_MEASURED:
            raise TraceError(
                "trace", wanted=f"{LEAST_MEASURED} points for motor {printer.motors[i]}", came=f"{int(known.sum())}",
                todo="measure both coordinates of more points",
            )  # fmt: skip
        rows.append(
            Rows(
                motor_mm=np.ascontiguousarray(motor[:, i], float),
                measured_mm=np.ascontiguousarray(belt[:, i]),
                weight=np.where(known, weight * shares[:, i], 0.0),
                own_mm=np.ascontiguousarray(where[:, i]),
                other_mm=np.ascontiguousarray(where[:, 1 - i]),
                period_mm=printer.axes[i].mm_per_turn if periods_mm is None else periods_mm[i],
                origin_mm=float(motor[0, i]),
                start_mm=float(belt[np.argmax(known), i]),
                middle_mm=(float(middle[i]), float(middle[1 - i])),
                independent=INDEPENDENT_WALLS if 2 * trace.wall_rows.sum() > trace.measured_rows.sum() else 1.0,
            )
        )
    return rows


def ripple_harmonics(printer: Printer, motor: int) -> tuple[int, ...]:
    """Return the harmonics of micro-step ripple, of periods of 4, 2 and 1 full steps (physics.md eq. 16)."""
    steps = printer.axes[motor].steps_per_turn
    return tuple(k for k in (steps // 4, steps // 2, steps) if HARMONICS < k <= TABLE_PHASES // 8)


def visible_ripple(rows: Rows, harmonics: tuple[int, ...]) -> tuple[int, ...]:
    """Return the harmonics of ripple without those that the rows meet at one phase only, as whole steps meet one
    step's.

    There such a harmonic is an offset; taken for a ripple it would bend the tables between the steps.
    """
    turns = rows.motor_mm[rows.weight > 0] / rows.period_mm
    return tuple(k for k in harmonics if abs(np.exp(1j * TURN_RAD * k * turns).mean()) < ONE_PHASE_MEAN)


@dataclass(frozen=True, eq=False)
class Trial:
    """The rows of a long trace that the search looks at; both motors have the same.

    It keeps the rows ``keep`` [N]: those whose measurement it uses, ``use`` [N], and those where a motor turned back
    between them, which the play needs.
    """

    keep: np.ndarray
    use: np.ndarray

    @property
    def is_whole(self) -> bool:
        return bool(self.keep.all() and self.use.all())

    def rows(self, full: list[Rows]) -> list[Rows]:
        """Return the trial's rows of either motor."""
        return full if self.is_whole else [row.subset(self.keep, self.use) for row in full]

    def in_full(self, jumps: Sequence[Jump]) -> tuple[Jump, ...]:
        """Return jumps at the trial's rows as jumps at the rows of the whole trace."""
        places = np.flatnonzero(self.keep)
        return tuple(replace(jump, row=int(places[jump.row])) for jump in jumps)


def trial_of(rows: list[Rows], rng: np.random.Generator) -> Trial:
    """Pick the rows that the search looks at: all of a short trace, `TRIAL_ROWS` measured ones of a long one."""
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
    return Trial(keep, use)


def on_micro_steps(rows: list[Rows], printer: Printer) -> list[Rows]:
    """Return the rows with every commanded position on the nearest micro-step."""
    quantised = []
    for i, row in enumerate(rows):
        pitch_mm = printer.axes[i].mm_per_step / printer.axes[i].microsteps
        quantised.append(replace(row, motor_mm=np.rint(row.motor_mm / pitch_mm) * pitch_mm))
    return quantised


def with_belts(rows: list[Rows], choices: list[Choice]) -> list[Rows]:
    """Return the rows with the belts where the fits put them, for the frame's terms; at first they are as measured."""
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


ROUNDING_SHOWS = 2.0  # micro-steps: with a larger mean residual the rounding of stops to micro-steps does not show
ROUNDING_GAIN = 0.97  # rounding is believed where it lowers the mean residual to less than this share
SEARCH_PASSES, LATER_PASSES = 6, 2  # of contacts and least squares: with parts just chosen, and from a settled fit

Ripple = tuple[int, ...]
Complete = Callable[[Rows, Choice], Choice]


@dataclass(frozen=True)
class Greybox:
    """The learner of physics.md §4."""

    name: str = "greybox"

    def fit(self, trace: Trace, printer: Printer, *, rng: np.random.Generator) -> GreyboxModel:
        """Learn from a trace; ``rng`` picks the rows that the search looks at in a long one.

        Raises `TraceError` where fewer than ten points were measured or a commanded position is missing.
        """
        # Threads of the linear algebra cost more than they bring on systems of a hundred unknowns.
        with threadpool_limits(1, user_api="blas"):
            return fit_greybox(trace, printer, rng)


def fit_greybox(
    trace: Trace, printer: Printer, rng: np.random.Generator, *, complete: Complete = lambda rows, choice: choice
) -> GreyboxModel:
    """Learn from a trace; ``complete`` may say more about each motor than its rows did."""
    check_trace(trace, printer)
    full = motor_rows(trace, printer)
    trial = trial_of(full, rng)
    absolute = trace.instrument_doubt.is_exact
    found = [turned(*each, absolute=absolute) for each in zip(full, trial.rows(full), strict=True)]
    full = [replace(row, period_mm=period_mm) for row, (period_mm, _) in zip(full, found, strict=True)]
    searched, rounded = _rounded(Stage(trial.rows(full), [choice for _, choice in found]), printer)
    without_jumps, jumps = _without_jumps(searched, printer)
    ripples = [visible_ripple(row, ripple_harmonics(printer, motor)) for motor, row in enumerate(without_jumps.rows)]
    chosen = _with_frame(_with_parts(without_jumps, ripples, scaled=not absolute), ripples)
    if not trial.is_whole:
        jumps = tuple(trial.in_full(taken) for taken in jumps)
        chosen = _on_all_rows(on_micro_steps(full, printer) if rounded else full, jumps, chosen, ripples)
    model = model_of(trace, printer, chosen.rows, [outlined(*each, complete) for each in chosen])
    drives = [
        replace(drive, left_out=left_out(row, choice, ripple)) if drive.seen >= ALL_SEEN else drive
        for drive, (row, choice), ripple in zip(model.drives, chosen, ripples, strict=True)
    ]
    return replace(model, drives=(drives[0], drives[1]), jumps=(jumps[0], jumps[1]))


@dataclass(frozen=True, eq=False)
class Stage:
    """How far a fit has come: the rows of either motor, and the best choice of parts for them."""

    rows: list[Rows]
    choices: list[Choice]

    def __iter__(self) -> Iterator[tuple[Rows, Choice]]:
        return zip(self.rows, self.choices, strict=True)

    def placed(self) -> "Stage":
        """Return the stage with the belts put where its own fits say, for the frame's terms."""
        return Stage(with_belts(self.rows, self.choices), self.choices)

    def refitted(self, ripples: list[Ripple]) -> "Stage":
        """Return the stage with the chosen parts fitted again, from the values that they have."""
        again = [
            fitted(row, choice.structure, ripple, choice, passes=LATER_PASSES)
            for (row, choice), ripple in zip(self, ripples, strict=True)
        ]
        return Stage(self.rows, again)


def _rounded(stage: Stage, printer: Printer) -> tuple[Stage, bool]:
    """Let the motors stop on micro-steps where that explains the measurement better; say whether it does.

    It does where the motors can stop nowhere else and the noise is small.
    """
    stopped = on_micro_steps(stage.rows, printer)
    if all(np.array_equal(a.motor_mm, b.motor_mm) for a, b in zip(stage.rows, stopped, strict=True)):
        return stage, False
    noise = min(choice.fit.loss_mm for choice in stage.choices)
    if noise > ROUNDING_SHOWS * printer.x.mm_per_step / printer.x.microsteps:
        return stage, False
    again = [refined(row, choice) for row, choice in zip(stopped, stage.choices, strict=True)]
    before, after = (sum(choice.fit.loss_mm for choice in choices) for choices in (stage.choices, again))
    return (Stage(stopped, again), True) if after < ROUNDING_GAIN * before else (stage, False)


def _without_jumps(stage: Stage, printer: Printer) -> tuple[Stage, tuple[tuple[Jump, ...], ...]]:
    """Take skipped teeth and missed steps out of the rows; return the jumps of either motor, too."""
    pairs = [find_jumps(row, found, printer.axes[motor]) for motor, (row, found) in enumerate(stage)]
    rows = [jumped(row, jumps) for row, (jumps, _) in zip(stage.rows, pairs, strict=True)]
    return Stage(rows, [choice for _, choice in pairs]).placed(), tuple(jumps for jumps, _ in pairs)


def _with_parts(stage: Stage, ripples: list[Ripple], *, scaled: bool) -> Stage:
    """Choose the parts of either drive, and fit them with all harmonics; ``scaled`` is that of `prune`."""
    chosen = []
    for (row, found), ripple in zip(stage, ripples, strict=True):
        structure = _glimpsed(row, prune(row, found, ripple, scaled=scaled))
        choice = with_second(row, fitted(row, structure, ripple, found, passes=SEARCH_PASSES), ripple)
        seen_in_part = GLIMPSED_TURN < seen_share(row, choice.fit.touch) < ALL_SEEN
        chosen.append(folded(row, choice, ripple) if seen_in_part else choice)
    return Stage(stage.rows, chosen)


def _glimpsed(rows: Rows, structure: Structure) -> Structure:
    """Keep no more than an offset and play where a motor hardly moved: a pulley's waves would look like its offset."""
    low_mm, high_mm = rows.reach_mm
    if high_mm - low_mm > GLIMPSED_TURN * rows.period_mm:
        return structure
    shifted = structure.offset or structure.scale or structure.pulley != "none"
    play = "none" if structure.play == "none" else "constant"
    return Structure(offset=shifted, scale=False, cross=0, pulley="none", play=play)


def _with_frame(stage: Stage, ripples: list[Ripple]) -> Stage:
    """Settle the frame's terms: they depend on where both belts are, and the belts' places on them."""
    for _ in range(2 if any(choice.design.cross for choice in stage.choices) else 0):
        stage = stage.placed().refitted(ripples)
    return stage


def _on_all_rows(full: list[Rows], jumps: tuple[tuple[Jump, ...], ...], chosen: Stage, ripples: list[Ripple]) -> Stage:
    """Fit the parts that were chosen on a trial's rows to all rows."""
    rows = [jumped(row, taken) for row, taken in zip(full, jumps, strict=True)]
    return Stage(rows, chosen.choices).placed().refitted(ripples)


LEARNERS = {"greybox": Greybox()}
