"""Metrics of paired points: point t of the print against point t of the target."""

import numpy as np

from printmend.errors import TraceError
from printmend.messages import say


def rmse(target: np.ndarray, printed: np.ndarray) -> float:
    """Return the paper's RMSE: the root of the mean squared Euclidean distance of paired points [T, 2].

        RMSE = √( (1/T) Σ_t ‖printed_t − target_t‖² )

    Both coordinates count in one distance, so an error of 1 on either axis alone is an RMSE of 1, not of 1/√2. A
    body's RMSE (paper §V-D, physics.md §8.1) is this over the points of all its layers together, starts included:
    `rmse(np.concatenate(targets), np.concatenate(prints))`. This is what the published evaluation prints.
    """
    target, printed = paired(target, printed)
    return float(np.sqrt(np.mean(np.sum((printed - target) ** 2, axis=1))))


def aligned(target: np.ndarray, printed: np.ndarray) -> np.ndarray:
    """Return ``printed`` [T, 2] moved rigidly onto ``target`` [T, 2] with the least RMSE.

    Rotation and translation, no reflection and no scale: Kabsch, Acta Cryst. A32 (1976) 922. In the plane the
    rotation is the angle of Σ conj(p)·q over the centred points as complex numbers.
    """
    target, printed = paired(target, printed)
    p, q = (points - points.mean(axis=0) for points in (printed, target))
    turn = np.sum((p[:, 0] - 1j * p[:, 1]) * (q[:, 0] + 1j * q[:, 1]))
    angle = float(np.angle(turn))
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return p @ rotation.T + target.mean(axis=0)


def aligned_rmse(target: np.ndarray, printed: np.ndarray) -> float:
    """Return the RMSE that is left after the best rotation and translation: the error of shape, not of placement."""
    return rmse(target, aligned(target, printed))


def paired(target: np.ndarray, printed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return both as float [T, 2]. Raise `TraceError` where they do not pair up, are empty, or are not finite."""
    target, printed = np.asarray(target, float), np.asarray(printed, float)
    if target.shape != printed.shape or target.ndim != 2 or target.shape[1:] != (2,) or not len(target):
        raise TraceError(
            say("subject-paired-points"),
            wanted=say("two-equal-shapes-t-2-t"),
            came=say("and", target.shape, printed.shape),
            todo=say("compare-print-own-target"),
        )
    if not (np.isfinite(target).all() and np.isfinite(printed).all()):
        raise TraceError(
            say("subject-paired-points"),
            wanted=say("finite-points"),
            came=say("nan-infinity"),
            todo=say("drop-unmeasured-rows"),
        )
    return target, printed
