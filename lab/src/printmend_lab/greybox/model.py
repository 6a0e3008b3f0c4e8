"""The grey box's model of a machine: a drive for each motor and the frame, with what the trace could see of them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from printmend.machine import Frame, Mechanism
from printmend.model import Branches
from printmend.path import Trace
from printmend.printer import Printer
from printmend_lab.greybox.drive import Choice, Jump, Rows, Structure, bed_middle
from printmend_lab.greybox.drive.fit import seen_share
from printmend_lab.greybox.drive.rest import CENTRED, rest_shares
from printmend_lab.greybox.drive.select import OmittedParts
from printmend_lab.protocols import MachineLearned


@dataclass(frozen=True, eq=False)
class LearnedDrive:
    """What was learned about one motor: its ``branches``, their fit, and the share of a turn ``seen``.

    ``left_out`` is what the parts that were left out may do; None where less than a turn was seen, and all is a guess.
    """

    name: str
    branches: Branches
    choice: Choice
    seen: float
    left_out: OmittedParts | None = None

    @property
    def structure(self) -> Structure:
        return self.choice.structure

    @property
    def noise_mm(self) -> float:
        """Standard deviation of the measured points about the fit [mm]."""
        return self.choice.fit.posterior.sigma_mm

    def sd_mm(self, motor_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the standard deviations (lower, upper) [mm] of the learned branches at motor positions [N].

        They contain the posterior of the chosen parts and what the parts that were left out may do. Places that the
        trace did not visit have the prior's width.
        """
        design, post = self.choice.design, self.choice.fit.posterior
        at_mm, turn_mm, middle_mm = np.asarray(motor_mm, float), self.branches.period_mm, self.branches.middle_mm
        mean, play = design.columns(at_mm, turn_mm, middle_mm)
        widths = []
        for side in (-0.5, 0.5):
            columns = (mean + side * play)[:, post.active]
            variance = np.einsum("ij,jk,ik->i", columns, post.covariance, columns)
            if self.left_out is not None:
                rest, rest_play = self.left_out.design.columns(at_mm, turn_mm, middle_mm)
                variance += self.left_out.variances(rest + side * rest_play)
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
    drives: tuple[LearnedDrive, LearnedDrive]
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
        # on a CoreXY a motor's position is the sum of two coordinates
        return float(np.sqrt(variance / (2 if self.printer.kinematics == "corexy" else 1)))

    @property
    def periods_mm(self) -> tuple[float, float]:
        """The lengths of both motors' turns as they were learned [mm]."""
        return (self.drives[0].branches.period_mm, self.drives[1].branches.period_mm)

    @property
    def imagined(self) -> Mechanism:
        return self.mechanism


def model_of(trace: Trace, printer: Printer, rows: list[Rows], chosen: list[Choice]) -> GreyboxModel:
    """Return the machine that the choices for both motors make, with what their rows could see."""
    drives = []
    for i, (row, choice) in enumerate(zip(rows, chosen, strict=True)):
        branches = choice.design.branches(
            choice.fit.posterior.values, period_mm=row.period_mm, origin_mm=row.origin_mm, reach_mm=row.reach_mm
        )
        drives.append(LearnedDrive(printer.motors[i], branches, choice, seen_share(row, choice.fit.touch)))
    frame = frame_of(printer, chosen)
    tables = (drives[0].branches.lower(printer, 0), drives[1].branches.lower(printer, 1))
    known = trace.measured_rows
    before = np.sqrt(np.mean(np.sum((trace.measured_mm - trace.commanded_mm)[known] ** 2, axis=1)))
    residual = np.stack([choice.fit.touch.residual_mm for choice in chosen], axis=1)
    after = np.sqrt(np.nanmean(np.sum(printer.from_motor(residual)[known] ** 2, axis=1)))
    # After homing the engaged side is known, and no layer starts there.
    rests = CENTRED if trace.homed else rest_shares(rows, chosen)
    mechanism = Mechanism(printer, tables, frame, rest_share=rests)
    return GreyboxModel(mechanism, (drives[0], drives[1]), int(known.sum()), float(before), float(after))


def frame_of(printer: Printer, chosen: list[Choice]) -> Frame:
    """Return the learned cross terms as a `Frame`."""
    values = [choice.fit.posterior.values[choice.design.parts["cross"]] for choice in chosen]
    return cross_frame(printer, [(choice.design.cross, found) for choice, found in zip(chosen, values, strict=True)])


def bed_grid_mm(printer: Printer) -> np.ndarray:
    """Return places all over the bed [25, 2]: five along each axis tell all terms of a cubic frame."""
    x, y = (np.linspace(axis.min_mm, axis.max_mm, 5) for axis in (printer.x, printer.y))
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def cross_frame(printer: Printer, terms: Sequence[tuple[Sequence[tuple[int, int]], np.ndarray]]) -> Frame:
    """Return as a `Frame` what each motor adds: values [K] mm of powers of its own belt's place and of the other's, in
    100 mm from the bed's middle. Cubic in motor coordinates, hence cubic on the bed."""
    if not any(np.any(values) for _, values in terms):
        return Frame()
    bed = bed_grid_mm(printer)
    motor = printer.to_motor(bed) - bed_middle(printer)
    moved = np.zeros_like(motor)
    for i, (powers, values) in enumerate(terms):
        for (p, q), value in zip(powers, values, strict=True):
            moved[:, i] += value * (motor[:, i] / 100.0) ** p * (motor[:, 1 - i] / 100.0) ** q
    coefficients = np.linalg.lstsq(Frame().terms(bed), printer.from_motor(moved), rcond=None)[0].T
    coefficients[np.abs(coefficients) < 1e-9] = 0.0
    return Frame(coefficients)
