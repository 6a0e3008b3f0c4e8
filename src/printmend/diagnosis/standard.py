"""A learned machine by the names that metrologists use: positioning after ISO 230-2, circles after ISO 230-4.

Both standards test a machine with instruments of their own, and ISO 230-2 asks for five runs; here the learned model
runs the same paths once. So there is no repeatability R and no accuracy A, which need the scatter of runs; what is left
are the systematic parts, reversal included.
"""

from dataclasses import dataclass

import numpy as np

from printmend.machine import Mechanism
from printmend.machine.printing import print_from_home
from printmend.units import TURN_RAD

TARGETS = 45  # targets along an axis; they must not meet the same few angles of a pulley
_MARGIN_SHARE = 0.04  # share of the axis that is left free at both ends: room to turn back, wider than any play
ANGLES = 720  # places of the circle
_RADIUS_SHARE = 0.4  # radius of the circle, as a share of the shorter axis


@dataclass(frozen=True, eq=False)
class Positioning:
    """One axis along the bed's middle: the deviations at its targets, approached going up, ``up_mm`` [N], and coming
    back, ``down_mm`` [N] (ISO 230-2:2014, 3)."""

    axis: str
    up_mm: np.ndarray
    down_mm: np.ndarray

    @property
    def reversal_mm(self) -> float:
        """B, the reversal error of the axis: the largest |up − down| of all targets."""
        return float(np.abs(self.up_mm - self.down_mm).max())

    @property
    def mean_reversal_mm(self) -> float:
        """B̄, the mean reversal error: the mean of up − down."""
        return float(abs(np.mean(self.up_mm - self.down_mm)))

    @property
    def systematic_mm(self) -> float:
        """E, the bidirectional systematic positioning error: highest less lowest deviation, both ways together."""
        both = np.concatenate([self.up_mm, self.down_mm])
        return float(np.ptp(both))

    @property
    def mean_mm(self) -> float:
        """M, the mean bidirectional positioning error: the range of the mean of both ways."""
        return float(np.ptp((self.up_mm + self.down_mm) / 2))


@dataclass(frozen=True, eq=False)
class Circle:
    """A circle of ``radius_mm`` about the bed's middle, run both ways: how far outside of it the machine is, about the
    least-squares centre of both runs, at ``angle_rad`` [N]: ``clockwise_mm`` and ``counter_mm`` [N]
    (ISO 230-4:2005, 3)."""

    radius_mm: float
    angle_rad: np.ndarray
    clockwise_mm: np.ndarray
    counter_mm: np.ndarray

    @property
    def circular_mm(self) -> tuple[float, float]:
        """G, the circular error of the clockwise and of the counter-clockwise run: outermost less innermost point."""
        return float(np.ptp(self.clockwise_mm)), float(np.ptp(self.counter_mm))

    @property
    def both_mm(self) -> float:
        """G(b), the bidirectional circular error: the same of both runs together."""
        return float(np.ptp(np.concatenate([self.clockwise_mm, self.counter_mm])))

    @property
    def mean_mm(self) -> float:
        """D, the mean bidirectional radial error: by how much the radius is too large."""
        return float(np.mean(np.concatenate([self.clockwise_mm, self.counter_mm])))


def positioning(mechanism: Mechanism, axis: int) -> Positioning:
    """Run one axis (0 is x) through its targets, up and back, with the other one in its middle."""
    printer = mechanism.printer
    mine, other = (printer.x, printer.y) if axis == 0 else (printer.y, printer.x)
    target = np.linspace(
        mine.min_mm + _MARGIN_SHARE * mine.length_mm, mine.max_mm - _MARGIN_SHARE * mine.length_mm, TARGETS
    )
    along = np.concatenate([[mine.min_mm], target, [mine.max_mm], target[::-1]])
    places = np.empty((len(along), 3))
    places[:, axis], places[:, 1 - axis] = along, (other.min_mm + other.max_mm) / 2
    places[:, 2] = printer.z.home_mm
    off = (print_from_home(mechanism, places) - places)[:, axis]
    up, down = off[1 : TARGETS + 1], off[TARGETS + 2 :][::-1]
    return Positioning(mine.name, up - off[1], down - off[1])


def circle(mechanism: Mechanism) -> Circle:
    """Run a circle both ways, each after a turn that engages the belts."""
    printer = mechanism.printer
    middle = np.array(printer.middle_mm)
    radius = _RADIUS_SHARE * min(printer.x.length_mm, printer.y.length_mm)
    angle = np.arange(ANGLES) * (TURN_RAD / ANGLES)
    runs = np.concatenate([-angle, -angle, [0.0], angle, angle])
    places = np.column_stack([np.cos(runs), np.sin(runs), np.zeros(len(runs))]) * radius
    places[:, :2] += middle
    places[:, 2] = printer.z.home_mm
    printed = print_from_home(mechanism, places)[:, :2] - middle
    clockwise = np.roll(printed[ANGLES : 2 * ANGLES][::-1], 1, axis=0)  # as of growing angle
    counter = printed[-ANGLES:]
    both = np.concatenate([clockwise, counter])
    # least squares for 2 c·p + (r² − c²) = p² (Kåsa 1976), both runs together
    system = np.column_stack([2 * both, np.ones(len(both))])
    centre = np.linalg.lstsq(system, np.sum(both**2, axis=1), rcond=None)[0][:2]
    return Circle(radius, angle, *(np.hypot(*(run - centre).T) - radius for run in (clockwise, counter)))
