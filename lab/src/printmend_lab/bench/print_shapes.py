"""Test prints to compare: the designs of `printmend probe`, and the shapes of physics.md §5.

A test print is a path in mm from home and the rows of it that are measured. The designs are measured at their marks, a
shape at points evenly along its path.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from printmend.gcode.read import Program, read_gcode
from printmend.printer import Printer
from printmend.probe import design_probe
from printmend.units import TURN_RAD
from printmend_lab.path import Body, Layer

TURNS_MM = 100.0  # 2.5 turns of a pulley with 40 mm
HALF_TURN_MM, CIRCLE_RADIUS_MM = 20.0, 20.0
REVERSALS_MM = tuple(0.2 * steps for steps in (40, 30, 22, 16, 12, 9, 7, 5, 4, 3, 2))  # at each end of the zigzag
WALK_SD_MM, WALK_STEPS = 2.0, 400  # of the random walk: a step along an axis, and how many


@dataclass(frozen=True, eq=False)
class MeasuredPath:
    """Way-points [N, 2] mm, the first the home position, and which rows [K] are measured."""

    waypoints_mm: np.ndarray
    rows: np.ndarray


def path_print(printer: Printer, path_mm: np.ndarray, points: int) -> MeasuredPath:
    """Return the print of a path [N, 2] that is measured at ``points`` points, evenly along it."""
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path_mm, axis=0).T))])
    measured = np.linspace(0.0, length[-1], points)
    # corners stay: the nozzle must go where the path does
    at = np.union1d(length, measured)
    way = np.stack([np.interp(at, length, path_mm[:, axis]) for axis in range(2)], axis=1)
    return MeasuredPath(np.vstack([printer.home_mm, way]), 1 + np.searchsorted(at, measured))


def designed(design: str, printer: Printer, part: Program | None, points: int) -> MeasuredPath:
    """Return a design of `printmend probe` with that many marks."""
    plan = design_probe(printer, design=design, part=part, marks=points)
    return MeasuredPath(plan.waypoints_mm, plan.rows)


def layer_mm(layer: Layer, printer: Printer) -> np.ndarray:
    """Return the way-points [N, 2] of a layer: where its controls change."""
    nominal = layer.nominal_steps * np.array(printer.mm_per_step) + [printer.x.min_mm, printer.y.min_mm]
    turns = np.concatenate([[True], (np.diff(layer.controls, axis=0) != 0).any(axis=1), [True]])
    return nominal[turns]


def body_program(body: Body, printer: Printer) -> Program:
    """Return a drawn body as the G-code that a slicer would write for it."""
    lines = ["G28", "G90", "M83"]
    for layer in body.layers:
        first, *rest = layer_mm(layer, printer).tolist()
        lines += [f"G1 Z{layer.z_mm:g} F600", f"G0 X{first[0]:g} Y{first[1]:g} F6000"]
        lines += [f"G1 X{x:g} Y{y:g} E0.02" for x, y in rest]
    return read_gcode("\n".join(lines).encode(), printer=printer)


def _diagonal(span_mm: float, *, back: bool) -> Callable[[Printer, np.random.Generator], np.ndarray]:
    """Return the path along a diagonal of that span about the middle, and ``back``."""

    def path(printer: Printer, rng: np.random.Generator) -> np.ndarray:
        ends = np.array([[-0.5, -0.5], [0.5, 0.5]] + [[-0.5, -0.5]] * back)
        return np.array(printer.middle_mm) + span_mm * ends

    return path


def _zigzag(printer: Printer, rng: np.random.Generator) -> np.ndarray:
    """Both diagonals there and back, a staircase of shrinking reversals at each end."""
    points = []
    for side in (1.0, -1.0):
        along = np.array([1.0, side])
        for end in (-0.5, 0.5, -0.5):
            here = end * TURNS_MM * along
            inwards = -np.sign(end) * along
            points.append(here)
            for reversal in REVERSALS_MM:
                points += [here + reversal * inwards, here]
    return np.array(printer.middle_mm) + np.array(points)


def _curve(x_waves: int, y_waves: int, radius_mm: float, shift: float) -> Callable:
    """Return a Lissajous figure: how often it goes to and fro along each axis, its reach, and its shift in x."""

    def path(printer: Printer, rng: np.random.Generator) -> np.ndarray:
        angle = np.linspace(0.0, TURN_RAD, 721)
        return np.array(printer.middle_mm) + radius_mm * np.stack(
            [np.sin(x_waves * angle + shift), np.sin(y_waves * angle)], 1
        )

    return path


def _random_walk(printer: Printer, rng: np.random.Generator) -> np.ndarray:
    """Return a random walk about the middle."""
    return np.array(printer.middle_mm) + np.cumsum(rng.normal(0.0, WALK_SD_MM, (WALK_STEPS, 2)), axis=0).clip(
        -TURNS_MM, TURNS_MM
    )


SHAPES: dict[str, Callable[[Printer, np.random.Generator], np.ndarray]] = {
    "diagonal-and-back": _diagonal(TURNS_MM, back=True),
    "zigzag": _zigzag,
    "lissajous": _curve(2, 3, TURNS_MM / 2, TURN_RAD / 4),
    "circle": _curve(1, 1, CIRCLE_RADIUS_MM, TURN_RAD / 4),
    "diagonal": _diagonal(TURNS_MM, back=False),
    "half-turn": _diagonal(HALF_TURN_MM, back=True),
    "random-walk": _random_walk,
}
