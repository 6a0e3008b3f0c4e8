"""The grey box: identify a broken machine from one trace.

Each motor's lower and upper branches of generalised play are short series (`model.branches`), fitted by iterating
contacts and robust ridge least squares (`drive.fit`), with no more parts than the trace supports (`drive.select`). Then
follow the frame, which couples the axes, and the shapes of pulleys that were seen in part. Equations: physics.md §1–4.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from printmend.measure.checks import check_follows, check_trace
from printmend.path import Trace
from printmend.printer import Printer
from printmend_lab.greybox.drive import Jump, Rows, jumped
from printmend_lab.greybox.drive.jumps import find_jumps
from printmend_lab.greybox.drive.left_out import left_out
from printmend_lab.greybox.drive.second import with_second
from printmend_lab.greybox.drive.select import Choice, Structure, fitted, folded, prune, refined
from printmend_lab.greybox.drive.sight import ALL_SEEN, GLIMPSED_TURN, seen_share
from printmend_lab.greybox.drive.turn import turned
from printmend_lab.greybox.model import GreyboxModel, model_of
from printmend_lab.greybox.pulley import outlined
from printmend_lab.greybox.rows import (
    motor_rows,
    on_micro_steps,
    ripple_harmonics,
    trial_of,
    visible_ripple,
    with_belts,
)

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
    check_trace(trace)
    check_follows(trace, printer)
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
