"""A learned machine as curves to look at, and by the names that metrologists use (ISO 230-2 and 230-4)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from printmend.diagnosis.named import gathered
from printmend.effects import Acts, Scene, columns_of
from printmend.effects.effect import STRAIGHT, belt_places
from printmend.effects.elastic import HARMONICS as ELASTIC
from printmend.effects.pulley import is_loose, wave_sizes
from printmend.effects.words import NAMED_SIGMAS, Found
from printmend.infer.fit import Fit
from printmend.infer.machine import Part
from printmend.machine import Mechanism
from printmend.machine.printing import print_from_home
from printmend.units import TURN_RAD

POINTS = 1201  # points of a curve
ANGLES = 720  # points of a hull's outline, and of a circle


@dataclass(frozen=True, eq=False)
class Portrait:
    """Curves over motor positions ``motor_mm`` [N] and the measured points in contact with them.

    ``error_mm`` [2, N] is where the carriage is beyond a healthy one, moving forwards and backwards, ``sd_mm`` [2, N]
    the posterior's standard deviation of its shape, less a straight line, ``play_mm`` [N] and ``play_sd_mm`` [N] the
    play; ``noise_mm`` is that of one measured point. ``point_*`` [M]: motor position, error and side (0 forwards, 1
    backwards) of each measured point. ``outline_mm`` [ANGLES, 2] is the pulley's hull about the shaft, ``radius_mm``
    that of the round pulley; ``scale_percent`` is the straight part of the error.
    """

    name: str
    period_mm: float
    motor_mm: np.ndarray
    error_mm: np.ndarray
    sd_mm: np.ndarray
    play_mm: np.ndarray
    play_sd_mm: np.ndarray
    noise_mm: float
    point_motor_mm: np.ndarray
    point_error_mm: np.ndarray
    point_side: np.ndarray
    outline_mm: np.ndarray
    radius_mm: float
    scale_percent: float

    def level(self, motor_mm: np.ndarray) -> np.ndarray:
        """Return the straight part [N] mm of the error, which would hide all else."""
        return self.scale_percent / 100 * (motor_mm - self.motor_mm.mean())


@dataclass(frozen=True, eq=False)
class Contacts:
    """Measured points [M] in contact with a motor's belt: where the motor was, on which side of the play (−1 forwards,
    +1 back), and what the model leaves of each along the belt."""

    motor_mm: np.ndarray
    side: np.ndarray
    left_mm: np.ndarray


def portrait(parts: Sequence[Part], scene: Scene, motor: int, contacts: Contacts, noise_mm: float) -> Portrait:
    """Return the curves of one motor by its parts that act, and the points in contact with them.

    ``noise_mm`` is that of one measured coordinate. A point is free of all that does not act: the plate's turn, a
    drift, a scanner's carriage.
    """
    drives = [each for each in gathered(parts) if each.law.acts is Acts.DRIVE and each.where == motor]
    acts = [each for each in drives if each.acts]
    at = np.linspace(*scene.motor_span_mm[motor], POINTS)
    error = np.stack([_belt_mm(acts, motor, at, side, scene)[:, 0] for side in (-1.0, 1.0)])
    error[1] = np.maximum(error[1], error[0])
    drawn = np.stack([_belt_mm(drives, motor, at, side, scene, drawn=True) for side in (-1.0, 1.0)])
    on_curve = _belt_mm(acts, motor, contacts.motor_mm, contacts.side, scene)[:, 0]
    noise_mm *= float(np.linalg.norm(scene.printer.to_motor(np.eye(2))[:, motor]))  # along the belt
    return Portrait(
        scene.printer.motors[motor].upper(), scene.turns_mm[motor], at, error, _shapes(drawn, at).std(axis=2),
        error[1] - error[0], (drawn[1] - drawn[0]).std(axis=1), noise_mm, contacts.motor_mm,
        on_curve + contacts.left_mm, (contacts.side > 0).astype(int), hull_mm(acts, motor, scene),
        scene.turns_mm[motor] / TURN_RAD, _scale_percent(acts),
    )  # fmt: skip


def contacts_of_fit(fit: Fit, motor: int) -> Contacts:
    """Return the points that a search saw this motor's belt touch; of walls, those that face along it."""
    rows, count, printer = fit.rows, len(fit.places), fit.scene.printer
    along = printer.to_motor(np.eye(2))[:, motor]
    way = along / np.linalg.norm(along)
    seen_share = rows.at_places(rows.along @ way, count) @ way
    side = fit.places.side[:, motor]
    at = np.flatnonzero((seen_share > STRAIGHT) & (side != 0))
    left_mm = rows.at_places(fit.left_mm(), count) @ along
    return Contacts(fit.places.motor_mm[at, motor], side[at], left_mm[at])


def _shapes(drawn_mm: np.ndarray, at_mm: np.ndarray) -> np.ndarray:
    """Return drawn curves [2, N, D] less the straight line of each, which both directions share."""
    line, mean = np.vander(at_mm - at_mm.mean(), 2), drawn_mm.mean(axis=0)
    return np.asarray(drawn_mm - line @ np.linalg.lstsq(line, mean, rcond=None)[0])


def _scale_percent(acts: Sequence[Found]) -> float:
    return sum(float(each.sizes_mm[0]) for each in acts if each.effect == "scale")


def _belt_mm(
    drives: Sequence[Found], motor: int, motor_mm: np.ndarray, side: np.ndarray | float, scene: Scene, *,
    drawn: bool = False,
) -> np.ndarray:  # fmt: skip
    """Return where effects put a belt beyond a healthy one at motor positions [N] on one side of the play: what acts
    [N, 1], or each of the ``drawn`` machines [N, D]."""
    places, belt_mm = belt_places(motor, motor_mm, side), np.zeros((len(motor_mm), 1))
    for each in drives:
        moved = columns_of(each.effect, places, each.where, each.shape, scene)
        columns = scene.printer.to_motor(np.moveaxis(moved, 1, 2))[..., motor]
        belt_mm = belt_mm + columns @ (each.draws_mm if drawn else each.sizes_mm[:, None])
    return belt_mm


def hull_mm(acts: Sequence[Found], motor: int, scene: Scene) -> np.ndarray:
    """Return the outline [ANGLES, 2] of the convex hull of a motor's pulley about the shaft.

    The belt moves by dx/dθ = h(−θ) (physics.md eq. 1, the span's direction is not known and set to 0), so the slope of
    the branch is the support function h; the hull is what no tangent cuts off: r(β) = min over ψ of h(ψ)/cos(ψ − β).
    The spans of a loose belt see the pulley from both sides (eq. 6); then the forward branch is one of them. What is
    not sure is left out: a slope is k times as noisy as the error itself, and would only fray the picture.
    """
    psi = np.arange(ANGLES) * (TURN_RAD / ANGLES)
    near = float(scene.motor_off_middle(motor, scene.motor_span_mm[motor][0]))
    support = np.full(ANGLES, scene.turns_mm[motor] / TURN_RAD * (1.0 + _scale_percent(acts) / 100.0))
    for each in acts:
        share = {"pulley": 1.0, "elastic": near}.get(each.effect, 0.0)
        if each.effect == "breathing" and is_loose(each, acts, scene):
            share = -0.5
        if not share:
            continue
        orders = ELASTIC if each.effect == "elastic" else np.arange(1.0, len(each.sizes_mm) // 2 + 1)
        sizes, sds = wave_sizes(each)
        cos, sin = each.sizes_mm.reshape(2, -1) * (sizes > NAMED_SIGMAS * sds)
        # d/dθ of cos kθ and sin kθ at θ = −ψ
        support += share * (
            np.sin(np.outer(psi, orders)) @ (orders * cos) + np.cos(np.outer(psi, orders)) @ (orders * sin)
        )
    return _cut_off(support, psi)


def _cut_off(support: np.ndarray, psi: np.ndarray) -> np.ndarray:
    """Return the outline [ANGLES, 2] that no tangent of a support function cuts off."""
    facing = np.cos(psi[:, None] - psi)
    reach = np.where(facing > 1e-3, np.maximum(support, 0.0)[:, None] / np.maximum(facing, 1e-3), np.inf).min(axis=0)
    return reach[:, None] * np.stack([np.cos(psi), np.sin(psi)], axis=1)


# A learned machine by the names that metrologists use: positioning after ISO 230-2, circles after ISO 230-4.
#
# Both standards test a machine with instruments of their own, and ISO 230-2 asks for five runs; here the learned model
# runs the same paths once. So there is no repeatability R and no accuracy A, which need the scatter of runs; what is
# left are the systematic parts, reversal included.

TARGETS = 45  # targets along an axis; they must not meet the same few angles of a pulley
_MARGIN_SHARE = 0.04  # share of the axis that is left free at both ends: room to turn back, wider than any play
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
