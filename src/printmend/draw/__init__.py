"""Pictures. Every `draw_…` function takes matplotlib Axes and returns them; matplotlib is imported nowhere else."""

from printmend.draw.body import PrintedLayer, draw_above, draw_alike, draw_solid, printed_layer
from printmend.draw.drive import draw_axis_error
from printmend.draw.errors import draw_histogram, draw_log_histogram
from printmend.draw.figure import comparison, new_figure, save

__all__ = [
    "PrintedLayer",
    "comparison",
    "draw_above",
    "draw_alike",
    "draw_axis_error",
    "draw_histogram",
    "draw_log_histogram",
    "draw_solid",
    "new_figure",
    "printed_layer",
    "save",
]
