"""Error along an axis: what a deformed pulley and a loose belt look like to someone with a ruler."""

import numpy as np
from matplotlib.axes import Axes

from printmend.draw.figure import INK, PALETTE


def draw_axis_error(
    axes: Axes, nominal_mm: np.ndarray, printed_mm: np.ndarray, *, axis_name: str, mm_per_turn: float = 40.0
) -> Axes:
    """Draw printed − nominal [mm] over the nominal position [N] mm of one axis, one colour a direction of motion.

    A round of the wave a turn of the motor (grey lines) is the pulley; the gap between the two colours is the play.
    """
    nominal_mm, printed_mm = np.asarray(nominal_mm, float), np.asarray(printed_mm, float)
    error, motion = printed_mm - nominal_mm, np.diff(nominal_mm, prepend=nominal_mm[0])
    for turn in np.arange(np.floor(nominal_mm.min() / mm_per_turn), np.ceil(nominal_mm.max() / mm_per_turn) + 1):
        axes.axvline(turn * mm_per_turn, color="#dee2e6", linewidth=1, zorder=0)
    axes.axhline(0, color=INK, linewidth=0.6, zorder=1)
    for sign, colour, name in ((1, PALETTE[0], "moving forwards"), (-1, PALETTE[1], "moving backwards")):
        going = np.sign(motion) == sign
        axes.plot(nominal_mm[going], error[going], ".", color=colour, markersize=2, label=name, alpha=0.6)
    span = nominal_mm.max() - nominal_mm.min() or 1.0
    axes.set_xlim(nominal_mm.min() - 0.02 * span, nominal_mm.max() + 0.02 * span)
    axes.set_xlabel(f"{axis_name} where it belongs [mm]; grey: whole turns of the motor")
    axes.set_ylabel(f"error of {axis_name} [mm]")
    axes.legend(fontsize=8, frameon=False, markerscale=4)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    return axes
