"""A whole body as one path of three axes: its layers, and the moves in Z and across between them."""

from dataclasses import dataclass

import numpy as np

from printmend.path import frozen
from printmend.printer import Printer
from printmend_lab.body.layers import follow_polyline
from printmend_lab.path import Body


@dataclass(frozen=True, eq=False)
class SpacePath:
    """Lattice controls of three axes.

    ``start_steps`` [3] int64, ``controls`` [T, 3] int8 in {−1, 0, 1}: x and y in their full steps, z in its own.
    ``extruding`` [T] bool; ``layer`` [T] int64 is the place in ``body.layers`` of each tick, −1 between layers.
    """

    start_steps: np.ndarray
    controls: np.ndarray
    extruding: np.ndarray
    layer: np.ndarray

    def __post_init__(self) -> None:
        for name, dtype in (("start_steps", np.int64), ("controls", np.int8), ("extruding", bool), ("layer", np.int64)):
            object.__setattr__(self, name, frozen(np.asarray(getattr(self, name), dtype)))

    @property
    def nominal_steps(self) -> np.ndarray:
        """The nominal positions [T + 1, 3], the start included: the ideal print."""
        steps = np.concatenate([self.start_steps[None], self.controls.astype(np.int64)])
        return np.cumsum(steps, axis=0)


def space_path(body: Body, printer: Printer, *, hop_mm: float = 0.0) -> SpacePath:
    """Return the controls of a body of one layer or more, each at its ``z_mm``.

    After a layer the nozzle rises to ``hop_mm`` above the next layer, goes straight to where that layer starts, and
    comes down the hop. Only there Z turns back and its backlash shows.
    """
    heights = [round((layer.z_mm - printer.z.min_mm) / printer.z.mm_per_step) for layer in body.layers]
    hop = round(hop_mm / printer.z.mm_per_step)
    first = body.layers[0]
    pieces: list[tuple[np.ndarray, np.ndarray, int]] = []
    here, height = first.start_steps, heights[0]
    for place, (layer, wanted) in enumerate(zip(body.layers, heights, strict=True)):
        if place > 0:
            points = np.array([here, layer.start_steps], float)
            across = follow_polyline(points, np.zeros(1, bool), subject=body.name)[1]
            travel = [_lift(wanted + hop - height), _flat(across), _lift(-hop)]
            between = np.concatenate(travel)
            pieces.append((between, np.zeros(len(between), bool), -1))
            height = wanted
        pieces.append((_flat(layer.controls), layer.extruding, place))
        here = layer.nominal_steps[-1]
    controls, extruding, places = zip(*pieces, strict=True)
    return SpacePath(
        np.array([*first.start_steps, heights[0]]),
        np.concatenate(controls),
        np.concatenate(extruding),
        np.repeat(places, [len(piece) for piece in controls]),
    )


def _flat(controls: np.ndarray) -> np.ndarray:
    return np.concatenate([controls, np.zeros((len(controls), 1), np.int8)], axis=1)


def _lift(steps: int) -> np.ndarray:
    controls = np.zeros((abs(steps), 3), np.int8)
    controls[:, 2] = np.sign(steps)
    return controls
