"""A picture of a print from above, for people who watch an agent; numpy alone draws it."""

import numpy as np

_SIZE_PX, _MARGIN_PX = 400, 12
_PAPER, _WANTED, _PRINTED, _HEAD = (250, 250, 248), (176, 176, 176), (214, 90, 20), (20, 60, 160)
_HEAD_PX = 3  # half the side of the square where the nozzle is


def path_picture(wanted: np.ndarray, printed: np.ndarray, bed_steps: tuple[int, int]) -> np.ndarray:
    """Return a picture [400, 400, 3] of uint8 of a wanted path [N, 2] and a printed one [M, 2], full steps.

    Shown is the square about both; y points up.
    """
    both = np.concatenate([wanted, printed])
    low, high = (
        np.maximum(both.min(axis=0), -np.array(bed_steps)),
        np.minimum(both.max(axis=0), 2 * np.array(bed_steps)),
    )
    scale = (_SIZE_PX - 1 - 2 * _MARGIN_PX) / max(float((high - low).max()), 1.0)
    picture = np.empty((_SIZE_PX, _SIZE_PX, 3), np.uint8)
    picture[:] = _PAPER

    def pixels(points: np.ndarray) -> np.ndarray:
        places = np.rint((points - (low + high) / 2) * scale) + (_SIZE_PX - 1) / 2
        return np.clip(places, 0, _SIZE_PX - 1).astype(int)

    for points, colour in ((wanted, _WANTED), (printed, _PRINTED)):
        x, y = pixels(_dense(points, 1 / scale)).T
        picture[_SIZE_PX - 1 - y, x] = colour
    x, y = pixels(printed[-1:])[0]
    row = _SIZE_PX - 1 - y
    picture[max(row - _HEAD_PX, 0) : row + _HEAD_PX + 1, max(x - _HEAD_PX, 0) : x + _HEAD_PX + 1] = _HEAD
    return picture


def _dense(points: np.ndarray, apart: float) -> np.ndarray:
    """Return a polyline with points in between, no farther than ``apart`` from each other."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    at = np.linspace(0.0, along[-1], max(int(along[-1] / apart), 1) + 1)
    return np.stack([np.interp(at, along, axis) for axis in points.T], axis=1)
