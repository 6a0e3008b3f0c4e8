"""How far a program's extruded path lands from the path that was wanted, on a machine that is known."""

from dataclasses import dataclass

import numpy as np

from printmend.gcode.read import Program
from printmend.metrics.shape import ContourError, stroke_distances
from printmend.twin import Twin
from printmend.twin.gcode import follow_finely

CENTRING_ROUNDS = 6  # of moving a print onto its lines
JUDGED_LAYERS = 3  # of a part, at even heights


@dataclass(frozen=True, eq=False)
class Way:
    """A program as points along its motion since homing: ``wanted_mm`` [N, 2] and ``printed_mm`` [N, 2] where the
    machine put them, ``extruding`` [N − 1] for the segments between them, ``layer`` [N − 1]."""

    wanted_mm: np.ndarray
    printed_mm: np.ndarray
    extruding: np.ndarray
    layer: np.ndarray

    def strokes_mm(self, layer: int) -> np.ndarray:
        """Return the extruded segments [K, 2, 2] of one layer."""
        drawn = np.flatnonzero(self.extruding & (self.layer == layer))
        return np.stack([self.wanted_mm[drawn], self.wanted_mm[drawn + 1]], axis=1)

    def beads_mm(self, layer: int) -> np.ndarray:
        """Return the printed ends [K, 2] of the extruded segments of one layer."""
        return self.printed_mm[1:][self.extruding & (self.layer == layer)]

    @property
    def layers(self) -> list[int]:
        """The layers that are judged: a few that extrude, evenly over the height."""
        drawn = np.unique(self.layer[self.extruding])
        return drawn[np.unique(np.linspace(0, len(drawn) - 1, JUDGED_LAYERS + 2).astype(int)[1:-1])].tolist()


def run(program: Program, twin: Twin) -> Way:
    """Print a program on the twin, point by point along every move. It must home once, before it extrudes."""
    return Way(*follow_finely(program, twin))


def contour_error(ideal: Way, printed: Way) -> tuple[ContourError, np.ndarray]:
    """Measure how far the print's beads lie from the ideal strokes of their layers [mm]; also the shift [2] taken off.

    The part as a whole counts as lying where it fits: a scan of a plate does not show where on the bed the plate lay.
    """
    beads = [printed.beads_mm(layer) for layer in ideal.layers]
    strokes = [ideal.strokes_mm(layer) for layer in ideal.layers]
    # Boxes first: dense infill looks right wherever it lies, the outline does not.
    boxes = [(s.min(axis=(0, 1)) + s.max(axis=(0, 1)) - b.min(axis=0) - b.max(axis=0)) / 2
             for s, b in zip(strokes, beads, strict=True)]  # fmt: skip
    shift = np.mean(boxes, axis=0)
    for _ in range(CENTRING_ROUNDS):
        steps = np.concatenate([stroke_distances(s, b[::7] + shift)[1] for s, b in zip(strokes, beads, strict=True)])
        # Distances to lines see only the part across them: about half, for strokes in all directions.
        shift = shift + 2 * steps.mean(axis=0)
    distance = np.concatenate([stroke_distances(s, b + shift)[0] for s, b in zip(strokes, beads, strict=True)])
    error = ContourError(
        float(np.sqrt(np.mean(distance**2))), float(np.percentile(distance, 95)), float(distance.max())
    )
    return error, shift
