"""Slow, obvious versions of the twin and of the corruptions, straight from the equations of physics.md."""

import numpy as np

from printmend.machine import GainMechanism, Mechanism, Transmission
from printmend.printer.printer import Axis
from printmend.twin import Twin


def play(motor: np.ndarray, start: float, lower: np.ndarray, upper: np.ndarray) -> list[float]:
    """u ← min(max(u, lower(m)), upper(m)), one step at a time (eq. 7)."""
    u = start
    positions = [u]
    for m in motor:
        if u < lower[m]:
            u = lower[m]
        if u > upper[m]:
            u = upper[m]
        positions.append(u)
    return positions


def gain_step(p: int, c: int, gains: np.ndarray) -> float:
    """One control by the rules of physics.md §8.1."""
    x = float(p)
    for _ in range(abs(c)):
        x += np.sign(c) * gains[round(x) - 1]
        x = min(max(x, 0.0), len(gains) - 1.0)
    return x - p


def gain_run(controls: np.ndarray, start: int, gains: np.ndarray, bed: int) -> list[float]:
    printed, nominal = float(start), start
    positions = [printed]
    for c in controls:
        printed = min(max(printed + gain_step(nominal, int(c), gains), 0.0), float(bed))
        nominal = min(max(nominal + int(c), 0), bed)
        positions.append(printed)
    return positions


def hull_support_mm(points_mm: np.ndarray, phi_rad: np.ndarray) -> np.ndarray:
    """h(φ) = max over hull points p of p·(cos φ, sin φ) (eq. 1)."""
    return np.array([(points_mm @ [np.cos(phi), np.sin(phi)]).max() for phi in phi_rad])


def frame_step(belts: tuple[float, float], mechanism: Mechanism) -> list[float]:
    """x' = x + Σ a_pq (x/L)^p (y/L)^q at one belt position in full steps (eq. 14)."""
    printer, frame = mechanism.printer, mechanism.frame
    low = (printer.x.min_mm, printer.y.min_mm)
    x, y = (low[i] + belts[i] * printer.mm_per_step[i] for i in range(2))
    bed = []
    for axis, place in enumerate((x, y)):
        for (p, q), a in zip(frame.exponents, frame.coefficients_mm[axis], strict=True):
            place += a * (x / frame.scale_mm) ** p * (y / frame.scale_mm) ** q
        for towards, period_mm, *sizes in frame.waves:
            along = x * np.cos(towards * np.pi / 2) + y * np.sin(towards * np.pi / 2)
            angle = 2 * np.pi * along / period_mm
            place += sizes[2 * axis] * np.cos(angle) + sizes[2 * axis + 1] * np.sin(angle)
        bed.append((place - low[axis]) / printer.mm_per_step[axis])
    return bed


def jump_places(rate_per_m: float, seed: tuple[int, int], travel_mm: float) -> list[tuple[float, float]]:
    """(place, sign) of each jump of a Poisson process, one at a time (eq. 11)."""
    gaps, signs = np.random.default_rng((*seed, 0)), np.random.default_rng((*seed, 1))
    found, place = [], 0.0
    while rate_per_m > 0:
        place += gaps.exponential(1000.0 / rate_per_m)
        if place > travel_mm:
            break
        found.append(place)
    return list(zip(found, signs.choice([-1.0, 1.0], max(64, 64 * (len(found) // 64 + 1))), strict=False))


def jumps_due(places: list[tuple[float, float]], before_mm: float, after_mm: float) -> float:
    """The sum of the signs of the jumps in (before, after]."""
    return sum(sign for place, sign in places if before_mm < place <= after_mm)


def run(twin: Twin, controls: np.ndarray, start: np.ndarray) -> np.ndarray:
    """`Twin.run` for two or three axes, tick by tick: motors, missed steps, play, skips, frame, screw."""
    mechanism, printer = twin.mechanism, twin.printer
    if isinstance(mechanism, GainMechanism):
        columns = [gain_run(controls[:, i], int(start[i]), mechanism.gains[i], printer.bed_steps[i]) for i in range(2)]
        return np.array(columns).T
    corner = printer.to_motor(np.array([printer.x.min_mm, printer.y.min_mm]))
    belts = []
    for motor in range(2):
        axis, table, jumps = printer.axes[motor], mechanism.transmissions[motor], twin.jumps[motor]

        def branches(
            m: int, axis: Axis = axis, table: Transmission = table, corner: float = corner[motor]
        ) -> tuple[float, float]:
            """(lower, upper) in full steps at lattice motor position m, as errors from m."""
            i = round((corner + m * axis.mm_per_step - table.first_mm) / table.pitch_mm)
            place = table.first_mm + table.pitch_mm * i
            return (table.lower_mm[i] - place) / axis.mm_per_step, (table.upper_mm[i] - place) / axis.mm_per_step

        m = int(printer.to_motor(start[:2])[motor])
        shift = -(branches(m)[0] + branches(m)[1]) / 2
        u, skipped, travelled = float(m), 0.0, 0.0
        column = [u]
        moves = printer.to_motor(controls[:, :2])[:, motor]
        total = float(np.abs(moves).sum()) * axis.mm_per_step + 1.0
        skips = jump_places(jumps.skips.rate_per_m, (jumps.skips.seed, 0), total) if jumps.skips else []
        misses = jump_places(jumps.missed.rate_per_m, (jumps.missed.seed, 1), total) if jumps.missed else []
        for c in moves:
            reached = travelled + abs(int(c)) * axis.mm_per_step
            m += int(c)
            if misses and jumps.missed:
                m += int(jumps_due(misses, travelled, reached)) * jumps.missed.steps
            if skips and jumps.skips:
                skipped += jumps_due(skips, travelled, reached) * jumps.skips.pitch_mm / axis.mm_per_step
            travelled = reached
            low, high = branches(m)
            u = min(max(u, m + (low + shift)), m + (high + shift))
            column.append(u + skipped)
        belts.append(column)
    printed = [list(printer.from_motor(np.array(both))) for both in zip(*belts, strict=True)]
    if not mechanism.frame.is_identity:
        moved = frame_step((float(start[0]), float(start[1])), mechanism)
        printed = [
            [a + (s - o) for a, s, o in zip(frame_step(tuple(p), mechanism), start, moved, strict=False)]
            for p in printed
        ]
    if controls.shape[1] == 2:
        return np.array(printed)
    return np.array(_lifted(mechanism, printed, controls[:, 2], int(start[2])))


def _lifted(mechanism: Mechanism, printed: list, lifts: np.ndarray, start: int) -> list[list[float]]:
    """Add the screw's push to x and y, and z, tick by tick (eq. 15)."""
    screw, axis = mechanism.screw, mechanism.printer.z
    if screw is None:
        return [[*xy, z] for xy, z in zip(printed, start + np.concatenate([[0], np.cumsum(lifts)]), strict=True)]
    table = screw.transmission

    def entry(m: int) -> tuple[int, float]:
        i = round((axis.min_mm + m * axis.mm_per_step - table.first_mm) / table.pitch_mm)
        return i, table.first_mm + table.pitch_mm * i

    def branches(m: int) -> tuple[float, float]:
        i, place = entry(m)
        return (table.lower_mm[i] - place) / axis.mm_per_step, (table.upper_mm[i] - place) / axis.mm_per_step

    m, u = start, float(start)
    shift = -(branches(m)[0] + branches(m)[1]) / 2
    origin = screw.wobble_mm[entry(m)[0]]
    lifted = [[*printed[0], u]]
    for xy, c in zip(printed[1:], lifts, strict=True):
        m += int(c)
        low, high = branches(m)
        u = min(max(u, m + (low + shift)), m + (high + shift))
        push = (screw.wobble_mm[entry(m)[0]] - origin) / np.array(mechanism.printer.mm_per_step)
        lifted.append([xy[0] + push[0], xy[1] + push[1], u])
    return lifted


def follow(twin: Twin, waypoints_mm: np.ndarray) -> np.ndarray:
    """`Twin.follow` for two or three axes, way-point by way-point, from a homed machine."""
    assert isinstance(twin.mechanism, Mechanism)
    mechanism, printer = twin.mechanism.homed(), twin.printer
    motors = printer.to_motor(waypoints_mm[:, :2])
    columns = []
    for motor in range(2):
        axis, table, jumps = printer.axes[motor], mechanism.transmissions[motor], twin.jumps[motor]
        total = float(np.abs(np.diff(motors[:, motor])).sum()) + 1.0
        skips = jump_places(jumps.skips.rate_per_m, (jumps.skips.seed, 0), total) if jumps.skips else []
        misses = jump_places(jumps.missed.rate_per_m, (jumps.missed.seed, 1), total) if jumps.missed else []
        u, lost, skipped, travelled, column = None, 0.0, 0.0, 0.0, []
        for i, wanted in enumerate(motors[:, motor]):
            reached = travelled + (abs(wanted - motors[i - 1, motor]) if i else 0.0)
            if misses and jumps.missed:
                lost += jumps_due(misses, travelled, reached) * jumps.missed.steps * axis.mm_per_step
            if skips and jumps.skips:
                skipped += jumps_due(skips, travelled, reached) * jumps.skips.pitch_mm
            travelled = reached
            low, high = table.branches_mm(np.array(_micro(wanted + lost, table.first_mm, axis)))
            if u is None:
                u = float(low if printer.motor_home_direction(motor) > 0 else high)
            u = min(max(u, float(low)), float(high))
            column.append(u + skipped)
        columns.append(column)
    bed = mechanism.frame.apply(printer.from_motor(np.array(columns).T))
    if waypoints_mm.shape[1] == 2:
        return bed
    if mechanism.screw is None:
        return np.column_stack([bed, waypoints_mm[:, 2]])
    u, out, table = None, [], mechanism.screw.transmission
    for xy, wanted in zip(bed, waypoints_mm[:, 2], strict=True):
        at = _micro(wanted, table.first_mm, printer.z)
        low, high = table.branches_mm(np.array(at))
        if u is None:
            u = float(low if printer.z.home_direction > 0 else high)
        u = min(max(u, float(low)), float(high))
        push = mechanism.screw.wobble_at_mm(np.array([at]))[0]
        out.append([xy[0] + push[0], xy[1] + push[1], u])
    return np.array(out)


def _micro(place_mm: float, first_mm: float, axis: Axis) -> float:
    pitch_mm = axis.mm_per_step / axis.microsteps
    return first_mm + np.rint((place_mm - first_mm) / pitch_mm) * pitch_mm
