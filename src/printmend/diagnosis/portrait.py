"""One motor's learned drive as curves to look at: its error and play along the axis, and the shape of its pulley."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from printmend.diagnosis.named import gathered
from printmend.effects import Acts, Places, Scene
from printmend.effects.effect import SCALE_MM
from printmend.effects.elastic import HARMONICS as ELASTIC
from printmend.effects.pulley import is_loose, wave_sizes
from printmend.effects.words import NAMED_SIGMAS, Found
from printmend.infer.fit import Fit
from printmend.infer.posterior import Part
from printmend.learn.greybox import GreyboxModel, LearnedDrive
from printmend.path import Trace
from printmend.printer import Printer
from printmend.promise.apply import acting
from printmend.saved import Branches
from printmend.units import TURN_RAD

POINTS = 1201  # points of a curve
ANGLES = 720  # points of a hull's outline


@dataclass(frozen=True, eq=False)
class Portrait:
    """Curves over motor positions ``motor_mm`` [N] and the measured points in contact with them.

    ``error_mm`` [2, N] is where the carriage is beyond a healthy one, moving forwards and backwards, ``sd_mm`` [2, N]
    the posterior's standard deviation, ``play_mm`` [N] and ``play_sd_mm`` [N] the play; ``noise_mm`` is that of one
    measured point. ``point_*`` [M]: motor position, error and side (0 forwards, 1 backwards) of each measured point.
    ``outline_mm`` [ANGLES, 2] is the pulley's hull about the shaft, ``radius_mm`` that of the round pulley;
    ``scale_percent`` is the straight part of the error.
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


def believed_portrait(parts: Sequence[Part], motor: int, fit: Fit) -> Portrait:
    """Return the curves of one motor by its parts that act, and the points of the fit in contact with them.

    A point is free of all that does not act: the plate's turn, a drift, a scanner's carriage.
    """
    scene = fit.scene
    drives = [each for each in gathered(parts) if each.law.acts is Acts.DRIVE and each.where == motor]
    acts = [each for each in drives if each.acts]
    at = np.linspace(*scene.motor_span_mm[motor], POINTS)
    error = np.stack([_belt_mm(acts, motor, at, side, scene) for side in (-1.0, 1.0)])
    error[1] = np.maximum(error[1], error[0])
    drawn = np.stack([_drawn_mm(drives, motor, at, side, scene) for side in (-1.0, 1.0)])
    scale = sum(float(each.sizes_mm[0]) for each in acts if each.effect == "scale")
    place, off, side = _contacts(acts, motor, fit)
    return Portrait(
        scene.printer.motors[motor].upper(), scene.turns_mm[motor], at, error, drawn.std(axis=2), error[1] - error[0],
        (drawn[1] - drawn[0]).std(axis=1), fit.state.sigma_mm, place, off, side, believed_hull_mm(acts, motor, scene),
        scene.turns_mm[motor] / TURN_RAD, scale,
    )  # fmt: skip


def _columns(found: Found, motor: int, motor_mm: np.ndarray, side: np.ndarray | float, scene: Scene) -> np.ndarray:
    """Return where an effect puts a belt [N, P] beyond a healthy one, at motor positions on one side of the play."""
    count = len(motor_mm)
    at, sides, none = np.zeros((count, 2)), np.zeros((count, 2)), np.zeros((count, 2))
    at[:, motor], sides[:, motor] = motor_mm, side
    moved = found.columns(Places(at, sides, none, none, none, np.zeros(count), np.zeros(count), none), scene)
    return np.asarray(scene.printer.to_motor(np.moveaxis(moved, 1, 2))[..., motor])


def _belt_mm(
    drives: Sequence[Found], motor: int, motor_mm: np.ndarray, side: np.ndarray | float, scene: Scene
) -> np.ndarray:
    moved = (_columns(each, motor, motor_mm, side, scene) @ each.sizes_mm for each in drives)
    return np.asarray(sum(moved, np.zeros(len(motor_mm))))


def _drawn_mm(drives: Sequence[Found], motor: int, motor_mm: np.ndarray, side: float, scene: Scene) -> np.ndarray:
    """Return where each drawn machine has its belt [N, D] beyond a healthy one."""
    moved = (_columns(each, motor, motor_mm, side, scene) @ each.draws_mm for each in drives)
    return np.asarray(sum(moved, np.zeros((len(motor_mm), 1))))


def _contacts(acts: Sequence[Found], motor: int, fit: Fit) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return place, error and side [M] of the measured points that this motor's belt touched."""
    rows, left = fit.rows, fit.left_mm()
    x, y = (np.flatnonzero((rows.along == way).all(axis=1) & ~rows.at_home) for way in np.eye(2))
    if not len(x) or not np.array_equal(rows.mark[x], rows.mark[y]):  # walls have one number each
        return np.zeros(0), np.zeros(0), np.zeros(0, int)
    mark, left_mm = rows.mark[x], fit.scene.printer.to_motor(np.stack([left[x], left[y]], axis=1))[:, motor]
    place, side = fit.places.motor_mm[mark, motor], fit.places.side[mark, motor]
    used = side != 0
    error = _belt_mm(acts, motor, place[used], side[used], fit.scene) + left_mm[used]
    return place[used], error, (side[used] > 0).astype(int)


def believed_hull_mm(acts: Sequence[Found], motor: int, scene: Scene) -> np.ndarray:
    """Return the outline [ANGLES, 2] of the convex hull of a motor's pulley about the shaft, as in `hull_mm`.

    What is not sure is left out: a slope is k times as noisy as the error itself, and would only fray the picture.
    """
    psi = np.arange(ANGLES) * (TURN_RAD / ANGLES)
    near = (scene.motor_span_mm[motor][0] - scene.motor_middle_mm(motor)) / SCALE_MM
    scale = sum(float(each.sizes_mm[0]) for each in acts if each.effect == "scale")
    support = np.full(ANGLES, scene.turns_mm[motor] / TURN_RAD * (1.0 + scale / 100.0))
    for each in acts:
        share = {"pulley": 1.0, "elastic": near}.get(each.effect, 0.0)
        if each.effect == "breathing" and is_loose(each):
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


def portrait(model: GreyboxModel, motor: int, trace: Trace) -> Portrait:
    """Return the curves of one motor, and the points of the trace that it was learned from.

    Of its waves and its play only what acts is drawn; its line is the learned one, as the points have it.
    """
    drive, printer = model.drives[motor], model.printer
    acts = acting(model, trace).fit.drives[motor]
    at = np.linspace(*drive.branches.reach_mm, POINTS)
    powers = acts.branches.mean.powers_mm.copy()
    powers[:2] = drive.branches.mean.powers_mm[:2]
    error, play = _errors_mm(replace(acts.branches, mean=replace(acts.branches.mean, powers_mm=powers)), at)
    design, post = drive.choice.design, drive.choice.fit.posterior
    columns = design.columns(at, drive.branches.period_mm, drive.branches.middle_mm)[1][:, post.active]
    play_sd = np.sqrt(np.einsum("ij,jk,ik->i", columns, post.covariance, columns))
    place, off, side = _points(drive, printer, motor, trace)
    return Portrait(
        drive.name.upper(), drive.branches.period_mm, at, error, np.stack(drive.sd_mm(at)), play, play_sd,
        drive.noise_mm, place, off, side, hull_mm(acts), drive.branches.period_mm / TURN_RAD,
        _scale_percent(drive),
    )  # fmt: skip


def _scale_percent(drive: LearnedDrive) -> float:
    powers = drive.branches.mean.powers_mm
    return float(powers[1]) if len(powers) > 1 else 0.0


def _errors_mm(branches: Branches, motor_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    mean, play = branches.errors_mm(motor_mm)
    return np.stack([mean - play / 2, mean + play / 2]), play


def _points(
    drive: LearnedDrive, printer: Printer, motor: int, trace: Trace
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    touch = drive.choice.fit.touch
    used = np.flatnonzero(np.isfinite(touch.residual_mm) & (touch.side != 0))
    # A point says something about the place of its last contact, which play may have left behind.
    place = printer.to_motor(trace.commanded_mm)[touch.at[used], motor]
    side = (touch.side[used] > 0).astype(int)
    error, _ = _errors_mm(drive.branches, place)
    return place, error[side, np.arange(len(used))] + touch.residual_mm[used], side


def hull_mm(drive: LearnedDrive) -> np.ndarray:
    """Return the outline [ANGLES, 2] of the pulley's convex hull about the shaft.

    The belt moves by dx/dθ = h(−θ) (physics.md eq. 1, the span's direction is not known and set to 0), so the slope of
    the branch is the support function h; the hull is what no tangent cuts off: r(β) = min over ψ of h(ψ)/cos(ψ − β).
    The spans of a loose belt see the pulley from both sides (eq. 6); then the forward branch is one of them.
    """
    branches, design, values = drive.branches, drive.choice.design, drive.choice.fit.posterior.values
    sds = drive.choice.fit.posterior.sds
    psi = np.arange(ANGLES) * (TURN_RAD / ANGLES)
    support = np.full(ANGLES, branches.period_mm / TURN_RAD * (1.0 + _scale_percent(drive) / 100.0))
    near = (branches.reach_mm[0] - branches.middle_mm) / 100.0  # an elastic belt shows most where the motor is near
    shares = {"mean": 1.0, "play": -0.5 if drive.structure.play == "loose" else 0.0, "elastic": near}
    for wave, share in shares.items():
        for i, k in enumerate(design.waves(wave)):
            at = design.wave_at(wave, i)
            # A slope is k times as noisy as the error itself: what is not sure would only fray the picture.
            if np.hypot(*values[at]) > NAMED_SIGMAS * np.sqrt(np.mean(sds[at] ** 2)):
                # d/dθ of cos kθ and sin kθ at θ = −ψ
                support += share * k * (values[at[0]] * np.sin(k * psi) + values[at[1]] * np.cos(k * psi))
    return _cut_off(support, psi)


def _cut_off(support: np.ndarray, psi: np.ndarray) -> np.ndarray:
    """Return the outline [ANGLES, 2] that no tangent of a support function cuts off."""
    facing = np.cos(psi[:, None] - psi)
    reach = np.where(facing > 1e-3, np.maximum(support, 0.0)[:, None] / np.maximum(facing, 1e-3), np.inf).min(axis=0)
    return reach[:, None] * np.stack([np.cos(psi), np.sin(psi)], axis=1)
