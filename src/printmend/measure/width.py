"""Settle the scale of a part's scan by its widths with callipers: choose the widths, and apply the readings.

Flat jaws touch the outermost places of a part in a direction. A width can be asked for where walls, not corners, lie
there: corners carry blobs, and no ray finds them.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from printmend.errors import TraceError
from printmend.measure.distance import LONGEST_MM, MOST_SCALE_SHARE, inches, open_scale, settled
from printmend.measure.walls import RASTER_MM, Walls
from printmend.messages import say, together
from printmend.path import Instrument

SHORTEST_MM = 25.0  # shortest width that callipers are asked for
READING_MM = 0.03  # standard deviation of a reading over walls that the jaws lie flat on
LEAST_FACING = math.cos(math.radians(12.0))  # a wall with a normal this near to the width lies flat on a jaw
OUTERMOST_MM = 0.15  # places of walls this near to the outermost one touch the jaw, too
MOST_WIDTHS = 2  # that are asked for
LEAST_TURN_SINE = math.sin(math.radians(44.0))  # two widths lie at least 44° apart, or they tell the same
ANGLES_DEG = (0, 90, 45, 135, 15, 30, 60, 75, 105, 120, 150, 165)  # directions of widths, from X


@dataclass(frozen=True, eq=False)
class Width:
    """A direction [rad] from X, and the numbers of the wall places that lie outermost on either side."""

    angle_rad: float
    ends: tuple[np.ndarray, np.ndarray]

    @property
    def words(self) -> str:
        """The direction, for the owner."""
        degrees = round(math.degrees(self.angle_rad))
        named = {0: "across-part-along-x", 90: "across-part-along-y"}
        return say(named[degrees]) if degrees in named else say("across-part-at-angle", degrees)

    def across_mm(self, edge_mm: np.ndarray) -> float:
        """Return the width between edges [S, 2] mm."""
        along = edge_mm @ _unit(self.angle_rad)
        return float(along[self.ends[0]].max() - along[self.ends[1]].min())


def choose_widths(walls: Walls) -> tuple[Width, ...]:
    """Return at most two widths that callipers can take, the longer first, along X and Y where walls lie there.

    One says nothing of the scanner's other axis.
    """
    outline, _ = cv2.findContours(walls.plastic.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    hull = cv2.convexHull(np.vstack(outline))[:, 0] * RASTER_MM + walls.corner_mm
    edge = walls.commanded_mm[walls.row] + walls.half_mm[:, None] * walls.normal
    found: list[tuple[bool, float, Width]] = []
    for degrees in ANGLES_DEG:
        unit = _unit(math.radians(degrees))
        along, facing = edge @ unit, walls.normal @ unit
        high, low = float((hull @ unit).max()), float((hull @ unit).min())
        ends = (
            np.flatnonzero((facing > LEAST_FACING) & (along > high - OUTERMOST_MM)),
            np.flatnonzero((facing < -LEAST_FACING) & (along < low + OUTERMOST_MM)),
        )
        if min(map(len, ends)) and SHORTEST_MM <= high - low <= LONGEST_MM:
            found.append((degrees in (0, 90), high - low, Width(math.radians(degrees), ends)))
    chosen: list[Width] = []
    for _, _, width in sorted(found, key=lambda one: one[:2], reverse=True):
        if all(abs(math.sin(width.angle_rad - one.angle_rad)) > LEAST_TURN_SINE for one in chosen):
            chosen.append(width)
    return tuple(chosen[:MOST_WIDTHS])


def widths_asked(widths: Sequence[Width], edge_mm: np.ndarray, scale: str, *, ruled: bool = False) -> str:
    """Say which widths would settle the ``scale``, which came from where these words say; ``edge_mm`` [S, 2] is where
    the image shows the walls."""
    said = together(" / ", [say("width-about", width.words, f"{width.across_mm(edge_mm):.0f}") for width in widths])
    return say("width-asked" if len(widths) == 1 else "widths-asked", open_scale(scale, ruled=ruled), said)


def scaled_by_widths(
    distances_mm: Sequence[float], widths: Sequence[Width], edge_mm: np.ndarray, instrument: Instrument
) -> tuple[np.ndarray, Instrument, str]:
    """Return the map [2, 2] of places of the image to the scale that callipers say, what is still open of the
    instrument, and a note.

    ``edge_mm`` [S, 2] is where the image shows the walls. Raises `TraceError` for widths of another part.
    """
    if len(distances_mm) > len(widths):
        raise TraceError(
            say("distance-option"), wanted=say("so-many-widths", len(widths)),
            came=str(len(distances_mm)), todo=say("leave-others-out-scan-own-scale"),
        )  # fmt: skip
    begun, onto, notes = edge_mm, np.eye(2), []
    for distance_mm, width in zip(distances_mm, widths, strict=False):
        seen = width.across_mm(edge_mm)
        excess = seen / distance_mm - 1.0
        if not abs(excess) <= MOST_SCALE_SHARE:
            raise TraceError(
                say("distance-option"), wanted=say("about-mm", f"{width.across_mm(begun):.2f}", width.words),
                came=together("", [f"{distance_mm:g}", inches(distance_mm, seen)]), todo=say("measure-again-in-mm"),
            )  # fmt: skip
        stretch, instrument, note = settled(excess, width.angle_rad, distance_mm, instrument, reading_mm=READING_MM)
        notes.append(together(": ", [width.words, note]))
        onto = np.linalg.inv(stretch) @ onto
        edge_mm = mapped(begun, onto)
    return onto, instrument, together("; ", notes)


def mapped(edge_mm: np.ndarray, onto: np.ndarray) -> np.ndarray:
    """Return places [S, 2] mm that a map [2, 2] has about their middle."""
    middle = edge_mm.mean(axis=0)
    return np.asarray((edge_mm - middle) @ onto.T + middle)


def _unit(angle_rad: float) -> np.ndarray:
    return np.array([math.cos(angle_rad), math.sin(angle_rad)])
