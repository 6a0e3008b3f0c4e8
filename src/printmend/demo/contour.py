"""The part and the faults of the demonstrations, the folder of their pictures, and the contour error of a file."""

from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import numpy as np

from printmend.corruption import Corruption, Drive, EccentricBore, Ellipse, Play
from printmend.errors import InputError
from printmend.gcode.read import Program
from printmend.messages import say
from printmend.metrics.shape import ContourError, stroke_distances
from printmend.twin import Twin
from printmend.twin.gcode import follow_finely
from printmend.units import TURN_RAD


def demo_body_gcode() -> bytes:
    """Return the G-code of a 60-tooth GT2 timing pulley in ABS for the Ender-5; `tools/make_demo_body.py` sliced it."""
    return (resources.files("printmend.demo") / "timing_pulley.gcode").read_bytes()


def demo_corruption(rng: np.random.Generator) -> Corruption:
    """Draw the faults of an Ender-5: an eccentric bore on X, a small and oval pulley on Y, play in both belts.

    They are visible on the part, and the machine still moves. The play stays below what one control can take up, 3
    steps at the weakest angle, because the paper's greedy planner stands still beyond (physics.md eq. 25).
    """
    bore_mm, phase_x, phase_y = rng.uniform(0.7, 1.2), rng.uniform(0, TURN_RAD), rng.uniform(0, TURN_RAD / 2)
    mean_mm, oval_mm = rng.uniform(5.7, 6.0), rng.uniform(0.5, 0.9)
    play_x, play_y = rng.uniform(0.1, 0.25, 2)
    x = Drive(pulley=EccentricBore(_mm(bore_mm), _mm(phase_x)), belt=Play(_mm(play_x)))
    y = Drive(pulley=Ellipse(_mm(mean_mm + oval_mm), _mm(mean_mm - oval_mm), _mm(phase_y)), belt=Play(_mm(play_y)))
    return Corruption((x, y))


def _mm(value: float) -> float:
    """Round to a micrometre, so that corruption.toml can be read."""
    return round(float(value), 3)


def check_out(out: Path) -> None:
    """Raise `InputError` where ``out`` cannot be a folder, before the work begins."""
    if out.exists() and not out.is_dir():
        raise InputError(out, wanted=say("folder-pictures"), came=say("file"), todo=say("terminal-name-another-out"))


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

    The part is first shifted to its best fit, because a scan of a plate does not show its position on the bed.
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
    return ContourError.of(distance), shift
