"""A trace as each motor sees it: its rows, and which of them the search for contacts and parts looks at."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from printmend.errors import TraceError
from printmend.learn.walls import wall_shares
from printmend.measure.checks import LEAST_MEASURED
from printmend.path import Trace
from printmend.printer import Printer
from printmend.units import TURN_RAD
from printmend_lab.greybox.drive import Jump
from printmend_lab.greybox.drive.design import Rows, contacts, cross_columns
from printmend_lab.greybox.drive.kernels import columns as kernels
from printmend_lab.greybox.drive.select import HARMONICS, Choice
from printmend_lab.greybox.layout import TABLE_PHASES, bed_middle

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
