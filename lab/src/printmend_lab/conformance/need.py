"""What the checks are made of: how one says no, layers to try things on, and what tables mean, slowly and obviously."""

import itertools

import numpy as np

from printmend.machine import PlayTables
from printmend.printer import Printer
from printmend.protocols import IncrementTables, JointTables, Tables
from printmend_lab.path import Layer

# Imagined positions may differ by this many full steps, 0.2 µm on the presets: between one state and a batch, tables
# and `advance`, one run and the next. A network in single precision keeps it, as does one whose sums a library orders
# by the batch's size. What it costs: a plan's RMSE is off by no more than the positions it was planned by; tables of
# results show 0.001 steps, and the lattice's own rounding is 0.4.
NEAR_STEPS = 1e-3
# A printer without a fault may be made worse by so much, the RMSE of a layer [full steps]: 0.01 mm on the presets, a
# fifth of what callipers tell.
HARMLESS_STEPS = 0.05


def need(kept: object, reason: str) -> None:
    """Raise `AssertionError` with the reason unless it is kept; unlike assert, with python -O too."""
    if not kept:
        raise AssertionError(reason)


def near(found: np.ndarray, wanted: np.ndarray, what: str) -> None:
    """Raise `AssertionError` unless positions are finite and within `NEAR_STEPS` of those wanted."""
    found, wanted = np.asarray(found, float), np.asarray(wanted, float)
    need(found.shape == wanted.shape, f"{what}: expected positions {wanted.shape}, found {found.shape}")
    need(np.isfinite(found).all(), f"{what}: expected finite positions, found nan or infinity")
    most = float(np.abs(found - wanted).max(initial=0.0))
    need(most <= NEAR_STEPS, f"{what}: expected positions within {NEAR_STEPS} full steps, found {most:.2g}")


def layer_along(points_steps: np.ndarray, index: int = 0) -> Layer:
    """Return the layer that follows a polyline [N, 2] tick by tick: each tick moves each axis by at most one step."""
    controls = []
    points = np.rint(points_steps).astype(int)
    for a, b in itertools.pairwise(points):
        ticks = int(np.abs(b - a).max())
        way = np.rint(a + (b - a) * np.arange(ticks + 1)[:, None] / max(ticks, 1)).astype(int)
        controls.append(np.diff(way, axis=0))
    moves = np.concatenate(controls)
    return Layer(index, 0.2 * (index + 1), points[0], moves, np.ones(len(moves), bool))


def ring_layer(
    centre: tuple[float, float], radius: float, *, turn: float = 0.0, gap: float = 12.0, index: int = 0
) -> Layer:
    """Return two outlines of a lobed disc and its zigzag infill at 45°, then 135° on odd layers."""
    angle = np.linspace(0, 2 * np.pi, 240)
    lobes = 1 + 0.12 * np.cos(5 * angle + turn)
    outline = np.stack([np.cos(angle + turn), np.sin(angle + turn)], axis=1) * lobes[:, None]
    parts = [outline * radius, outline * (radius - 4)]
    along = np.array([1.0, 1.0 if index % 2 == 0 else -1.0]) / np.sqrt(2)
    across = np.array([-along[1], along[0]])
    inner = 0.8 * radius
    for k, offset in enumerate(np.arange(-inner, inner, gap)):
        half = np.sqrt(max(inner**2 - offset**2, 0.0))
        ends = np.array([across * offset - along * half, across * offset + along * half])
        parts.append(ends if k % 2 == 0 else ends[::-1])
    return layer_along(np.concatenate(parts) + np.asarray(centre), index)


def follow_tables(tables: Tables, printer: Printer, start: np.ndarray, controls: np.ndarray) -> np.ndarray:
    """Return the imagined positions [T + 1, 2] of controls [T, 2], straight from the tables' definitions."""
    nominal, position = np.array(start), np.array(start, float)
    belts = printer.to_motor(position).copy()
    out = [position.copy()]
    for c in controls:
        if isinstance(tables, PlayTables):
            nominal = nominal + c
            motors = printer.to_motor(nominal)
            for m, motor in enumerate(tables.motors):
                i = motors[m] - motor.first_step
                belts[m] = min(max(belts[m], motor.lower_steps[i]), motor.upper_steps[i])
            position = tables.bed.printed(belts)
        elif isinstance(tables, IncrementTables):
            step = [tables.displacement_steps[a][nominal[a], c[a] + tables.c_max] for a in range(2)]
            position = position + step
            nominal = np.clip(nominal + c, 0, printer.bed_steps)
        else:
            position = position + joint_step(tables, printer, nominal, c)
            nominal = np.clip(nominal + c, 0, printer.bed_steps)
        out.append(np.array(position))
    return np.array(out)


def joint_step(tables: JointTables, printer: Printer, nominal: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Return how far tables say that a control c [2] moves the carriage from a nominal place [2]: both axes at once."""

    def unit(n: np.ndarray, signs: np.ndarray) -> np.ndarray:
        return tables.unit_steps[tables.cells[0][n[0]], tables.cells[1][n[1]], signs[0] + 1, signs[1] + 1]

    if not tables.rolled:
        return unit(nominal, np.sign(c)) * np.abs(c)
    step = np.zeros(2)
    for tick in range(int(np.abs(c).max())):
        signs = np.sign(c) * (np.abs(c) > tick)
        step = step + unit(nominal, signs)
        nominal = np.clip(nominal + signs, 0, printer.bed_steps)
    return step
