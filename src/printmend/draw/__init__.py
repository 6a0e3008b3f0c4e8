"""Draw pictures. Every `draw_…` function takes and returns matplotlib Axes; matplotlib is imported nowhere else."""

from printmend.draw.body import PrintedLayer, draw_above, draw_alike
from printmend.draw.figure import comparison, new_figure, save

__all__ = [
    "PrintedLayer",
    "comparison",
    "draw_above",
    "draw_alike",
    "new_figure",
    "save",
]
