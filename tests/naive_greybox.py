"""The grey box's loops, slow and obvious."""

import numpy as np

from printmend.model import Branches
from printmend_lab.greybox.drive import Design, Rows


def follow_play(rows: Rows, branches: Branches, start_mm: float) -> tuple[list[int], list[int], list[float]]:
    """Return per row the row of the last contact, its side, and the belt's place."""
    mean, play = branches.errors_mm(rows.motor_mm)
    at, side, belt = [], [], []
    row, branch, place = -1, 0, start_mm
    for t, m in enumerate(rows.motor_mm):
        if place < m + mean[t] - play[t] / 2:
            row, branch, place = t, -1, m + mean[t] - play[t] / 2
        if place > m + mean[t] + play[t] / 2:
            row, branch, place = t, 1, m + mean[t] + play[t] / 2
        at.append(row)
        side.append(branch)
        belt.append(place)
    return at, side, belt


def column_matrix(design: Design, rows: Rows, at: np.ndarray, side: np.ndarray) -> np.ndarray:
    """Return every column of the linear model, row by row [N, P]."""
    out = np.zeros((len(rows), design.size))
    for t in range(len(rows)):
        own, other = rows.own_mm[t] / 100.0, rows.other_mm[t] / 100.0
        out[t, design.parts["cross"]] = [own**p * other**q for p, q in design.cross]
        if at[t] < 0:
            out[t, design.parts["start"]] = 1.0
            continue
        m, s = rows.motor_mm[at[t]], side[t] / 2
        x, phase = (m - rows.origin_mm) / 100.0, 2 * np.pi * m / rows.period_mm
        out[t, design.parts["mean_powers"]] = [x**p for p in range(design.mean_powers)]
        out[t, design.parts["play_powers"]] = [s * x**p for p in range(design.play_powers)]
        if design.warp:
            low, high = design.warp_span_mm
            bent = np.pi * np.clip((m - low) / (high - low), 0, 1)
            out[t, design.parts["warp"]] = [np.cos(k * bent) for k in range(1, design.warp + 1)]
        for name, law in (("second_cos", np.cos), ("second_sin", np.sin)):
            out[t, design.parts[name]] = law(design.waves("second") * 2 * np.pi * m / (design.second_mm or 1.0))
        for name, factor in (("ripple", 1.0), ("mean", 1.0), ("play", s), ("elastic", x)):
            out[t, design.parts[f"{name}_cos"]] = factor * np.cos(design.waves(name) * phase)
            out[t, design.parts[f"{name}_sin"]] = factor * np.sin(design.waves(name) * phase)
    return out


def cheapest_history(cost: np.ndarray, price: float) -> tuple[float, list[tuple[int, int]]]:
    """Return the least sum of ``cost`` [N, A, B] and ``price`` for each rung climbed, and the levels (a, b) of it."""
    _, across, along = cost.shape
    levels = [(a, b) for a in range(across) for b in range(along)]
    best = {
        (a, b): (cost[0, a, b] + price / 2 * (abs(a - across // 2) + abs(b - along // 2)), [(a, b)]) for a, b in levels
    }
    for row in cost[1:]:
        after = {}
        for c, d in levels:
            ways = [(best[a, b][0] + price * (abs(c - a) + abs(d - b)), best[a, b][1]) for a, b in levels]
            least, history = min(ways, key=lambda way: way[0])
            after[c, d] = least + row[c, d], [*history, (c, d)]
        best = after
    return min(best.values(), key=lambda way: way[0])


def follow_tables_slowly(lower: np.ndarray, upper: np.ndarray, start: float) -> tuple[list, list, list]:
    """Return per row the row of the last contact, its side, and the belt's place, between two branches [N]."""
    at, side, belt = [], [], []
    row, branch, place = -1, 0, start
    for t in range(len(lower)):
        clipped = min(max(place, lower[t]), upper[t])
        if clipped != place:
            row, branch = t, -1 if clipped > place else 1
        place = clipped
        at.append(row)
        side.append(branch)
        belt.append(place)
    return at, side, belt


def unwound(outline, q, angle_rad: np.ndarray) -> np.ndarray:
    """U − θ by adding up h(−t) from 0, in many small steps."""
    total = []
    for angle in angle_rad:
        t = np.linspace(0.0, angle, 6001)
        h = outline.heights(q, -t)
        total.append(np.sum((h[1:] + h[:-1]) / 2 * np.diff(t)) - angle)
    return np.array(total)


def settled_prior(
    matrix: np.ndarray, slope: np.ndarray, square: float, count: float, usual: np.ndarray, group: np.ndarray,
    most: np.ndarray, scales: np.ndarray, sigma2: float, floor2: float, share: float, rounds: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:  # fmt: skip
    """Return the posterior's mean and covariance, the scales and σ² after MacKay's updates; no parameter is set yet."""
    scales = scales.copy()
    for turn in range(rounds + 1):
        v = usual * scales[group] ** 2
        covariance = np.linalg.inv(matrix / sigma2 + np.diag(1 / v))
        values = covariance @ slope / sigma2
        if turn == rounds:
            break
        misfit = square - 2 * slope @ values + values @ matrix @ values
        settled = 1 - np.diag(covariance) / v
        sigma2 = max(misfit / max(count - settled.sum(), 1.0) / share, floor2)
        for g in range(len(scales) - 1):
            if (group == g).any():
                ratio = ((values**2 / v)[group == g].sum() + 0.1) / (settled[group == g].sum() + 0.1)
                scales[g] = min(scales[g] * np.sqrt(ratio), most[g])
    return values, covariance, scales, sigma2


def length_left(
    length_mm: float, motor: np.ndarray, side: np.ndarray, along: np.ndarray, fixed: np.ndarray, error: np.ndarray,
    weight: np.ndarray, harmonics: int, play_harmonics: int, fading: bool,
) -> float:  # fmt: skip
    """What the kernel `lengths_left` says of one length, by numpy's least squares."""
    columns = [*fixed.T]
    for harmonic in range(1, harmonics + 1):
        angle = 2 * np.pi * harmonic * motor / length_mm
        columns += [np.cos(angle), np.sin(angle)]
        columns += [np.cos(angle) * side, np.sin(angle) * side] * (harmonic <= play_harmonics)
    angle = 2 * np.pi * motor / length_mm
    columns += [np.cos(angle) * along, np.sin(angle) * along] * fading
    design, root = np.stack(columns, axis=1), np.sqrt(weight)
    fit = np.linalg.lstsq(design * root[:, None], error * root, rcond=None)[0]
    return float(weight @ np.square(error - design @ fit))
