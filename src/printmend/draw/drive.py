"""One motor's drive as learned: its error along the axis, its play, and the pulley that it has."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle

from printmend.draw.figure import INK, PALETTE, quiet
from printmend.messages import Tell, say

WAYS = (say("moving-forwards"), say("moving-backwards"))
ENLARGED = (1, 2, 5, 10, 20, 50, 100, 200)
LEAST_UNROUND_MM = 0.02  # a pulley as round as this is drawn as it is, not enlarged into a star
LEAST_SPAN_MM = 0.05  # a healthy axis should not look wild


def draw_fit(
    axes: Axes,
    motor_mm: np.ndarray,
    error_mm: np.ndarray,
    band_mm: np.ndarray,
    points: tuple[np.ndarray, np.ndarray, np.ndarray],
    *,
    name: str,
    mm_per_turn: float,
    tell: Tell = str,
) -> Axes:
    """Draw the learned error [2, N] over the motor's position [N], one colour a direction, over the measured points.

    ``band_mm`` [2, N] is half the width in which 95 of 100 measured points should lie; ``points`` are the positions
    [M], errors [M] and directions [M] (0 forwards, 1 backwards) of the measured ones.
    """
    place, off, side = points
    for turn in np.arange(np.ceil(motor_mm[0] / mm_per_turn), np.floor(motor_mm[-1] / mm_per_turn) + 1):
        axes.axvline(turn * mm_per_turn, color="#dee2e6", linewidth=1, zorder=0)
    axes.axhline(0, color=INK, linewidth=0.6, zorder=1)
    for way in (0, 1):
        colour = PALETTE[way]
        axes.plot(place[side == way], off[side == way], ".", color=colour, markersize=2.5, alpha=0.5, zorder=2)
        low, high = error_mm[way] - band_mm[way], error_mm[way] + band_mm[way]
        axes.fill_between(motor_mm, low, high, color=colour, alpha=0.22, linewidth=0, zorder=3)
        axes.plot(motor_mm, error_mm[way], color=colour, linewidth=1.4, label=tell(WAYS[way]), zorder=4)
    low, high = float(error_mm.min()), float(error_mm.max())
    room = 0.15 * (high - low) + 2 * float(np.median(band_mm)) + LEAST_SPAN_MM / 2
    axes.set_ylim(low - room, high + room + 0.12 * (high - low + 2 * room))  # above, the legend
    axes.set_xlim(motor_mm[0], motor_mm[-1])
    axes.set_xlabel(tell(say("draw-position-turns", name)), fontsize=8)
    axes.set_ylabel(tell(say("draw-printed-commanded")), fontsize=8)
    axes.set_title(tell(say("draw-dots-lines", name)), color=INK, fontsize=10)
    axes.legend(fontsize=7, frameon=False, loc="upper left", ncols=2)
    return quiet(axes)


def draw_play(
    axes: Axes, motor_mm: np.ndarray, play_mm: np.ndarray, sd_mm: np.ndarray, *, name: str, tell: Tell = str
) -> Axes:
    """Draw the play [N] mm along the axis, with a band of two standard deviations [N]."""
    axes.fill_between(
        motor_mm, np.maximum(play_mm - 2 * sd_mm, 0), play_mm + 2 * sd_mm, color=PALETTE[2], alpha=0.25, linewidth=0
    )
    axes.plot(motor_mm, play_mm, color=PALETTE[2], linewidth=1.4)
    axes.set_xlim(motor_mm[0], motor_mm[-1])
    axes.set_ylim(0, max(1.25 * float((play_mm + 2 * sd_mm).max()), LEAST_SPAN_MM))
    axes.set_xlabel(tell(say("draw-position", name)), fontsize=8)
    axes.set_ylabel(tell(say("draw-play")), fontsize=8)
    axes.set_title(tell(say("draw-slack", name)), color=INK, fontsize=10)
    return quiet(axes)


def draw_hull(axes: Axes, outline_mm: np.ndarray, *, radius_mm: float, name: str, tell: Tell = str) -> Axes:
    """Draw a pulley's hull [N, 2] over the round one, about the shaft; small differences are enlarged."""
    reach = np.hypot(*outline_mm.T)
    most = float(np.abs(reach - radius_mm).max())
    factor = max((k for k in ENLARGED if k * most <= 0.35 * radius_mm), default=1) if most > LEAST_UNROUND_MM else 1
    drawn = outline_mm * ((radius_mm + factor * (reach - radius_mm)) / reach)[:, None]
    axes.add_patch(Circle((0, 0), radius_mm, fill=False, edgecolor=PALETTE[5], linestyle=(0, (4, 3)), linewidth=1))
    axes.fill(*drawn.T, facecolor=PALETTE[0], alpha=0.18, linewidth=0)
    axes.plot(*np.vstack([drawn, drawn[:1]]).T, color=PALETTE[0], linewidth=1.6)
    axes.plot([0], [0], "+", color=INK, markersize=9)
    span = 1.15 * max(float(np.abs(drawn).max()), radius_mm)
    axes.set_xlim(-span, span)
    axes.set_ylim(-span, span)
    axes.set_aspect("equal")
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_visible(False)
    shown = say("draw-true-to-scale") if factor == 1 else say("draw-enlarged", factor)
    axes.set_title(tell(say("draw-pulley", name)), color=INK, fontsize=10)
    axes.set_xlabel(tell(say("draw-dashed-round", shown)), fontsize=8)
    return axes
