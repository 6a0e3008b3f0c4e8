"""The information of marks about a machine: the covariance of its effects' sizes, known before anything is measured.

With known contacts of the play, every effect is linear. A mark with the columns φ and noise σ adds φφᵀ/σ² to the
inverse covariance of the sizes, whatever its reading. So the worth of marks is known beforehand: if the columns at a
part's positions have the mean square D, the expected mean square error is tr(C·D) (physics.md eq. 21).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from printmend.effects import EFFECTS, Places, Scene, Term, columns_of, scene_of
from printmend.effects.sized import Sized
from printmend.infer.first import begun
from printmend.infer.machine import machine_of
from printmend.machine import Contacts, Mechanism
from printmend.machine.kernels import run
from printmend.measure.checks import check_follows, check_trace
from printmend.path import Trace, last_way
from printmend.printer import Printer

# Effects that a test print must show: those that act and depend on the place on the bed alone
WANTED = ("place", "scale", "bend", "pulley", "play", "breathing", "friction", "elastic", "skew", "aspect", "bent")
NOISE_MM = 0.05  # of a coordinate that is expected of an owner's measurement
LEAST_NOISE_MM = 0.01  # no scan is better
PLAY_MM = 0.3  # prior of a printer with a fault
LEAST_PLAY_MM = 0.02  # a taut belt is given a direction of contact, too


@dataclass(frozen=True, eq=False)
class Belief:
    """What is known about a printer: the ``covariance`` [P, P] mm² of the sizes of its effects (``terms``), and a
    ``mechanism`` that decides the contacts. ``sigma_mm`` is the noise of a measured coordinate."""

    scene: Scene
    mechanism: Mechanism
    terms: tuple[Term, ...]
    covariance: np.ndarray
    sigma_mm: float

    def contacts(self, motor_mm: np.ndarray) -> Contacts:
        """Follow motors [N, 2] through the play from rest; the first row pulls both belts."""
        count = len(motor_mm)
        at, side, belt = np.empty((count, 2), np.int64), np.empty((count, 2), np.int8), np.empty((count, 2))
        for motor, table in enumerate(self.mechanism.transmissions):
            lower, upper = table.branches_mm(motor_mm[:, motor])
            wide = np.maximum(LEAST_PLAY_MM - (upper - lower), 0.0) / 2
            found = np.empty(count, np.int64), np.empty(count, np.int8), np.empty(count)
            run.contacts(np.inf, lower - wide, upper + wide, *found)
            at[:, motor], side[:, motor], belt[:, motor] = found
        return Contacts(at, side, belt)

    def columns(self, waypoints_mm: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Return the columns [2K, P] of both coordinates at ``rows`` [K] of a path [N, 2] mm."""
        printer = self.scene.printer
        motor = printer.to_motor(waypoints_mm)
        touch, none = self.contacts(motor), np.zeros((len(rows), 2))
        bed_ways, ways = (
            np.stack([last_way(axis) for axis in each.T], axis=1)[rows].astype(float) for each in (waypoints_mm, motor)
        )
        places = Places(
            np.take_along_axis(motor, touch.row, axis=0)[rows], touch.side[rows].astype(float), waypoints_mm[rows],
            bed_ways, ways, none[:, 0], none[:, 0], none,
        )  # fmt: skip
        each = [columns_of(term.effect, places, term.where, term.shape, self.scene) for term in self.terms]
        return np.concatenate(each, axis=2).reshape(2 * len(rows), -1)

    def told(self, columns: np.ndarray) -> "Belief":
        """Return what is known once marks with these columns [M, P] are measured."""
        information = np.linalg.inv(self.covariance) + columns.T @ columns / self.sigma_mm**2
        covariance = np.linalg.inv(information)
        return replace(self, covariance=(covariance + covariance.T) / 2)

    def wanted(self, waypoints_mm: np.ndarray) -> np.ndarray:
        """Return D [P, P] for a part whose path runs through ``waypoints_mm`` [N, 2]."""
        columns = self.columns(waypoints_mm, np.arange(len(waypoints_mm)))
        return np.asarray(columns.T @ columns / len(waypoints_mm))

    def expected_mm(self, wanted: np.ndarray) -> float:
        """Return the expected RMS error of a part with this D, from the uncertainty about the machine [mm]."""
        return float(np.sqrt(max(float((self.covariance * wanted).sum()), 0.0)))


def _bed_scene(printer: Printer) -> Scene:
    """Return the scene of a measurement of the whole bed."""
    low, high = np.array([[axis.min_mm, axis.max_mm] for axis in printer.axes[:2]], float).T
    corners = np.array([[x, y] for x in (low[0], high[0]) for y in (low[1], high[1])])
    return scene_of(Trace(corners, corners), printer, (printer.x.mm_per_turn, printer.y.mm_per_turn))


def prior_belief(printer: Printer) -> Belief:
    """Return the belief about any damaged printer: the priors of effects, and some play."""
    scene = _bed_scene(printer)
    mechanism, _ = machine_of(scene, [Sized("play", motor, (), np.array([PLAY_MM])) for motor in range(2)])
    terms = _terms(scene)
    sd_mm = np.concatenate([term.sd_mm for term in terms])
    return Belief(scene, mechanism, terms, np.diag(sd_mm**2), NOISE_MM)


def belief_after(printer: Printer, trace: Trace) -> Belief:
    """Return the belief after a first trace: its information on top of the priors of the effects found.

    An effect that it does not show keeps the prior of its mildest term. Raises `TraceError` like `learn`.
    """
    check_trace(trace)
    check_follows(trace, printer)
    with threadpool_limits(1, user_api="blas"):
        fit, turned = begun(trace, scene_of(trace, printer, (printer.x.mm_per_turn, printer.y.mm_per_turn)))
    scene = replace(_bed_scene(printer), turns_mm=fit.scene.turns_mm)
    found = {(block.effect, block.where) for block in fit.blocks}
    terms = _terms(scene, found)
    sd_mm = np.concatenate([term.sd_mm for term in terms])
    sigma_mm = max(fit.state.sigma_mm, LEAST_NOISE_MM)
    belief = Belief(scene, fit.mechanism, terms, np.diag(sd_mm**2), sigma_mm)
    return belief.told(belief.columns(turned.commanded_mm, np.flatnonzero(turned.measured_rows)))


def _terms(scene: Scene, found: set[tuple[str, int]] | None = None) -> tuple[Term, ...]:
    """Return one term of each effect at each place: the widest, or the mildest where it was not ``found``."""
    chosen: dict[tuple[str, int], Term] = {}
    for name in WANTED:
        for term in EFFECTS[name].terms(scene):
            key, size = (name, term.where), float(np.linalg.norm(term.sd_mm))
            widest = found is None or key in found
            old = float(np.linalg.norm(chosen[key].sd_mm)) if key in chosen else (0.0 if widest else np.inf)
            if size > old if widest else size < old:
                chosen[key] = term
    return tuple(chosen.values())


Worth = Callable[[Belief, np.ndarray], float]


def fall_of(wanted: np.ndarray) -> Worth:
    """Return the worth of marks for a part with this D: the fall of its expected square error [mm²]."""

    def worth(belief: Belief, columns: np.ndarray) -> float:
        reach = columns @ belief.covariance
        spread = reach @ columns.T + belief.sigma_mm**2 * np.eye(len(columns))
        return float(np.trace(np.linalg.solve(spread, reach @ wanted @ reach.T)))

    return worth


def information(belief: Belief, columns: np.ndarray) -> float:
    """Return the information of marks, ½ log det(I + ΦCΦᵀ/σ²) [nats]."""
    seen = columns @ belief.covariance @ columns.T / belief.sigma_mm**2
    return 0.5 * float(np.linalg.slogdet(np.eye(len(columns)) + seen)[1])


def still_unknown(belief: Belief) -> float:
    """Return the entropy of what is believed, ½ log det C [nats], up to a constant."""
    return 0.5 * float(np.linalg.slogdet(belief.covariance)[1])
