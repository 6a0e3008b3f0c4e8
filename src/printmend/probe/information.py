"""What marks tell about a machine: the grey box's posterior covariance before anything is measured.

With the contacts of the play known the grey box is linear (physics.md eq. 17): a mark measured with noise σ whose
row of columns is φ adds φφᵀ/σ² to the inverse covariance of each motor's parameters, whatever the measurement will
say. So the worth of marks can be told beforehand: for a part whose positions have the mean square D of their columns,
the mean square error to expect is tr(C·D) (physics.md eq. 21).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from printmend.identify.drive import Design, bed_middle
from printmend.identify.drive.fit import Prior, variances
from printmend.identify.drive.select import EVERYTHING, TRIAL_HARMONICS
from printmend.learn.greybox import Greybox
from printmend.machine.kernels import run
from printmend.path import Trace
from printmend.printer import Printer
from printmend.saved import SCALE_MM, Branches, Wave

NOISE_MM = 0.05  # of a coordinate that is expected of an owner's measurement
LEAST_NOISE_MM = 0.01  # no scan is better
PLAY_MM = 0.3  # what a printer with a fault is thought to have before anything was measured
LEAST_PLAY_MM = 0.02  # a taut belt is told from which side it is pushed, too


@dataclass(frozen=True, eq=False)
class MotorBelief:
    """What is known of one motor: its ``branches`` as far as they decide the contacts, and ``covariance`` [P, P] mm²
    of the parameters of ``design``, whose powers count from ``middle_mm``."""

    branches: Branches
    design: Design
    middle_mm: float
    covariance: np.ndarray
    sigma_mm: float

    def contacts(self, motor_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Follow the play from rest; return the motor position [N] and the side [N] of each row's last contact."""
        mean, play = self.branches.errors_mm(motor_mm)
        play = np.maximum(play, LEAST_PLAY_MM)
        lower, upper = motor_mm + mean - play / 2, motor_mm + mean + play / 2
        at, side, belt = np.empty(len(motor_mm), np.int64), np.empty(len(motor_mm)), np.empty(len(motor_mm))
        run.contacts(np.inf, lower, upper, at, side, belt)  # the first row pulls
        return motor_mm[at], side

    def columns(self, at_mm: np.ndarray, side: np.ndarray, own_mm: np.ndarray, other_mm: np.ndarray) -> np.ndarray:
        """Return the columns φ [N, P] of contacts [N], with the belts ``own_mm`` and ``other_mm`` from the middle."""
        mean, play = self.design.columns(at_mm, self.branches.period_mm, self.middle_mm)
        columns = mean + side[:, None] / 2 * play
        own, other = own_mm / SCALE_MM, other_mm / SCALE_MM
        columns[:, self.design.parts["cross"]] = np.stack([own**p * other**q for p, q in self.design.cross], axis=1)
        return columns

    def told(self, columns: np.ndarray) -> "MotorBelief":
        """Return what is known once marks with these columns [K, P] are measured."""
        information = np.linalg.inv(self.covariance) + columns.T @ columns / self.sigma_mm**2
        covariance = np.linalg.inv(information)
        return replace(self, covariance=(covariance + covariance.T) / 2)

    def fall_mm2(self, columns: np.ndarray, wanted: np.ndarray) -> float:
        """Return by how much measuring ``columns`` [K, P] lets tr(C·D) fall, D = ``wanted`` [P, P]."""
        reach = columns @ self.covariance
        spread = reach @ columns.T + self.sigma_mm**2 * np.eye(len(columns))
        return float(np.trace(np.linalg.solve(spread, reach @ wanted @ reach.T)))

    def gain_nats(self, columns: np.ndarray) -> float:
        """Return the information ½ log det(I + ΦCΦᵀ/σ²) that measuring ``columns`` [K, P] brings."""
        seen = columns @ self.covariance @ columns.T / self.sigma_mm**2
        return 0.5 * float(np.linalg.slogdet(np.eye(len(columns)) + seen)[1])


@dataclass(frozen=True, eq=False)
class Belief:
    """What is known of both motors of a printer."""

    printer: Printer
    motors: tuple[MotorBelief, MotorBelief]

    def columns(self, waypoints_mm: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the columns [K, P] of both motors at ``rows`` [K] of a path [N, 2] mm."""
        places = self.printer.to_motor(waypoints_mm)
        centred = (places - bed_middle(self.printer))[rows]
        columns = []
        for motor, belief in enumerate(self.motors):
            at, side = belief.contacts(places[:, motor])
            columns.append(belief.columns(at[rows], side[rows], centred[:, motor], centred[:, 1 - motor]))
        return columns[0], columns[1]

    def told(self, columns: tuple[np.ndarray, np.ndarray]) -> "Belief":
        """Return what is known once marks with these columns are measured."""
        return replace(self, motors=(self.motors[0].told(columns[0]), self.motors[1].told(columns[1])))

    def wanted(self, waypoints_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return D [P, P] of both motors for a part whose path runs through ``waypoints_mm`` [N, 2]."""
        columns = self.columns(waypoints_mm, np.arange(len(waypoints_mm)))
        return columns[0].T @ columns[0] / len(waypoints_mm), columns[1].T @ columns[1] / len(waypoints_mm)

    def expected_mm(self, wanted: tuple[np.ndarray, np.ndarray]) -> float:
        """Return the RMS distance that a part with these D will be off because the machine is not known better."""
        squares = sum(float((motor.covariance * d).sum()) for motor, d in zip(self.motors, wanted, strict=True))
        # a bed coordinate of a CoreXY is half the sum of two motors
        return float(np.sqrt(max(squares, 0.0) / (2 if self.printer.kinematics == "corexy" else 1)))


def prior_belief(printer: Printer) -> Belief:
    """Return what is known of any damaged printer: the grey box's prior, with some play."""
    return Belief(printer, (_prior_motor(printer, 0), _prior_motor(printer, 1)))


def _prior_motor(printer: Printer, motor: int) -> MotorBelief:
    reach = printer.motor_range_mm(motor)
    play = Wave(powers_mm=np.array([PLAY_MM]))
    branches = Branches(printer.axes[motor].mm_per_turn, sum(reach) / 2, reach, play=play)
    design = replace(EVERYTHING, ripple=False).design(TRIAL_HARMONICS, ())
    return MotorBelief(branches, design, sum(reach) / 2, np.diag(variances(design, Prior())), NOISE_MM)


def belief_after(printer: Printer, trace: Trace) -> Belief:
    """Return what is known after a first trace: its information on top of the prior that the grey box settled on.

    Raises `TraceError` where the grey box can make nothing of it.
    """
    model = Greybox().fit(trace, printer, rng=np.random.default_rng(0))
    motors = [
        replace(
            motor,
            branches=drive.branches,
            covariance=np.diag(variances(motor.design, drive.choice.fit.posterior.prior)),
            sigma_mm=max(drive.noise_mm, LEAST_NOISE_MM),
        )
        for drive, motor in zip(model.drives, prior_belief(printer).motors, strict=True)
    ]
    belief = Belief(printer, (motors[0], motors[1]))
    columns = belief.columns(trace.commanded_mm, np.flatnonzero(trace.measured_rows))
    return belief.told(columns)


Worth = Callable[[Belief, tuple[np.ndarray, np.ndarray]], float]


def fall_of(wanted: tuple[np.ndarray, np.ndarray]) -> Worth:
    """Return the worth of marks for a part with these D: by how much its expected square error falls [mm²]."""

    def worth(belief: Belief, columns: tuple[np.ndarray, np.ndarray]) -> float:
        return sum(motor.fall_mm2(mine, d) for motor, mine, d in zip(belief.motors, columns, wanted, strict=True))

    return worth


def information(belief: Belief, columns: tuple[np.ndarray, np.ndarray]) -> float:
    """Return the worth of marks to the curious: the information that they bring [nats]."""
    return sum(motor.gain_nats(mine) for motor, mine in zip(belief.motors, columns, strict=True))


def still_unknown(belief: Belief) -> float:
    """Return the entropy of what is believed, ½ log det C of both motors [nats], up to a constant."""
    return 0.5 * sum(float(np.linalg.slogdet(motor.covariance)[1]) for motor in belief.motors)
