"""How alike a print and its target are.

`pointwise` compares paired points, as the paper does; `shape` compares what was drawn, whatever the timing, and is the
one place that needs shapely. Every metric is in the unit of its inputs (full steps or mm).
"""

from printmend.metrics.pointwise import aligned, aligned_rmse, rmse

__all__ = ["aligned", "aligned_rmse", "rmse"]
