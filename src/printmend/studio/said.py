"""Describe a learned machine as plain values for a page: its faults in words, their certainty, advice, and pictures."""

from typing import Any

import numpy as np

from printmend.diagnosis.advice import URGENCY, WORK, advised
from printmend.effects.words import LEAST_SHOWN
from printmend.learn.learned import todo
from printmend.machine import Mechanism
from printmend.model import SavedModel
from printmend.model.model import misfit_words
from printmend.promise.words import scale_words
from printmend.units import TURN_RAD

_ANGLES = 180  # points of a pulley's outline
_GRID, _ALONG = 13, 61  # lines of the bed's grid in each direction, and points along a line
_CURVE = 400  # points of a curve


def said(model: SavedModel) -> dict[str, Any]:
    """Return the diagnosis of a machine: a headline, its faults with advice, and the measurement's gaps."""
    advice = []
    for fault, one in advised(model.document):
        if one.effect_mm >= LEAST_SHOWN or one.urgency in WORK:
            advice.append({**vars(one), "part": fault["part"], "kind": fault["kind"], "value": fault["value"],
                           "unit": fault["unit"]})  # fmt: skip
    order = list(URGENCY)
    advice.sort(key=lambda one: (order.index(one["urgency"]), -one["effect_mm"]))
    gaps = model.findings[1:]
    trace = model.document.get("trace", {})
    return {
        "headline": model.findings[0] if model.findings else "", "healthy": model.is_healthy, "faults": advice,
        "gaps": [*gaps, *todo(gaps)],
        "misfit": [*scale_words(model), *misfit_words(model.document)],
        "digest": model.digest,
        "measured": trace.get("measured"), "before_mm": trace.get("residual_before_mm"),
        "after_mm": trace.get("residual_after_mm"), "noise_mm": model.noise_mm, "learner": model.learner,
        "machine": drawn(model.mechanism),
    }  # fmt: skip


def drawn(mechanism: Mechanism) -> dict[str, Any]:
    """Return a machine as curves: each motor's pulley, its errors in both directions, and the distorted bed grid.

    Each grid line has ``along`` points; they lie halfway between the errors of both directions of motion.
    """
    printer = mechanism.printer
    motors = []
    for motor, (name, table) in enumerate(zip(printer.motors, mechanism.transmissions, strict=True)):
        low, high = printer.motor_range_mm(motor)
        at = np.linspace(low, high, _CURVE)
        branches = np.stack(table.branches_mm(at)) - at
        motors.append({
            "name": name.upper(), "at_mm": at.round(2).tolist(), "forwards_mm": branches[0].round(4).tolist(),
            "backwards_mm": branches[1].round(4).tolist(),
            "play_mm": round(float(np.mean(branches[1] - branches[0])), 4),
            "radius_mm": printer.axes[motor].radius_mm, "mm_per_turn": printer.axes[motor].mm_per_turn,
            "outline_mm": outline_mm(mechanism, motor).round(3).tolist(),
        })  # fmt: skip
    x, y = (np.linspace(axis.min_mm, axis.max_mm, _GRID) for axis in (printer.x, printer.y))
    fine_x, fine_y = (np.linspace(axis.min_mm, axis.max_mm, _ALONG) for axis in (printer.x, printer.y))
    net = np.concatenate([np.stack(np.meshgrid(fine_x, y), axis=-1),
                          np.stack(np.meshgrid(x, fine_y, indexing="ij"), axis=-1)])  # fmt: skip
    motors_mm = printer.to_motor(net.reshape(-1, 2))
    drives = zip(mechanism.transmissions, motors_mm.T, strict=True)
    belts_mm = np.column_stack([np.mean(table.branches_mm(at), axis=0) for table, at in drives])
    bent = mechanism.bed.printed(belts_mm)
    screw = None
    if mechanism.screw is not None:
        z = np.linspace(printer.z.min_mm, min(printer.z.max_mm, 60.0), _CURVE)
        screw = {"at_mm": z.round(2).tolist(), "push_mm": mechanism.screw.wobble_at_mm(z).round(4).tolist()}
    return {
        "kinematics": printer.kinematics, "motors": motors, "net_mm": net.reshape(-1, 2).round(2).tolist(),
        "bent_mm": bent.reshape(-1, 2).round(4).tolist(), "along": _ALONG, "screw": screw,
        "bed_mm": [printer.x.min_mm, printer.y.min_mm, printer.x.max_mm, printer.y.max_mm],
    }  # fmt: skip


def outline_mm(mechanism: Mechanism, motor: int) -> np.ndarray:
    """Return the outline [_ANGLES, 2] of a motor's pulley about its shaft, as far as its tables show one.

    The belt moves by dx/dθ = h(−θ) (physics.md eq. 1). h is the slope of the branches' middle, averaged over the turns
    on the bed. The hull lies inside all tangents, as in `diagnosis.portrait.hull_mm`.
    """
    printer, table = mechanism.printer, mechanism.transmissions[motor]
    axis, (low, high) = printer.axes[motor], printer.motor_range_mm(motor)
    turns = max(int((high - low) / axis.mm_per_turn), 1)
    psi = np.arange(_ANGLES) * (TURN_RAD / _ANGLES)
    step = axis.mm_per_turn / _ANGLES
    middle = low + (high - low - turns * axis.mm_per_turn) / 2
    at = middle + step * (np.arange(turns * _ANGLES + 1) - 0.5)
    place = np.mean(table.branches_mm(at), axis=0)
    slope = (np.diff(place) / step).reshape(turns, _ANGLES).mean(axis=0)
    angle = -(middle + step * np.arange(_ANGLES)) / axis.mm_per_turn * TURN_RAD
    order = np.argsort(np.mod(angle, TURN_RAD))
    support = np.interp(psi, np.mod(angle, TURN_RAD)[order], slope[order], period=TURN_RAD) * axis.radius_mm
    facing = np.cos(psi[:, None] - psi)
    reach = np.where(facing > 1e-3, np.maximum(support, 0.0)[:, None] / np.maximum(facing, 1e-3), np.inf).min(axis=0)
    return reach[:, None] * np.stack([np.cos(psi), np.sin(psi)], axis=1)
