"""Parts to be shown: a herringbone gear with a hub and five windows, sliced by PrusaSlicer as owners slice theirs, and
a vase of half a million segments, written without a slicer."""

import math
from functools import lru_cache

import manifold3d
import numpy as np

from printmend.printer import read_printer
from printmend_lab.body.slicer import slice_solid
from printmend_lab.body.solid import Solid

TEETH, TWIST_DEG, DIVISIONS = 32, 9.0, 12
_FORM = ((0.0, 0.93), (0.26, 0.935), (0.38, 1.0), (0.62, 1.0), (0.74, 0.935))  # of a tooth: share of it, of the radius


@lru_cache(maxsize=2)
def gear_gcode(radius_mm: float = 46.0, height_mm: float = 22.0) -> bytes:
    """Return the sliced gear; 7 MB at the default size."""
    return slice_solid(gear(radius_mm, height_mm), read_printer("ender5"))


def vase_gcode(layers: int = 125, rings: int = 8, segments: int = 500) -> bytes:
    """Return rings with 24 waves on each of many layers: 500 000 extruding segments, 15 MB, at the default size."""
    text = ["; a vase of wavy rings", "G21", "G90", "M83", "G28"]
    turn = np.linspace(0, 2 * math.pi, segments + 1)
    for layer in range(layers):
        text += [";LAYER_CHANGE", f"G1 Z{0.2 * (layer + 1):.2f} F9000"]
        for ring in range(rings):
            radius = (60 - 0.45 * ring) * (1 + 0.05 * np.sin(24 * turn + 0.02 * layer))
            x, y = 110 + radius * np.cos(turn), 110 + radius * np.sin(turn)
            extruded = 0.0333 * np.hypot(np.diff(x), np.diff(y))
            text += ["G1 E-0.8 F2100", f"G1 X{x[0]:.3f} Y{y[0]:.3f} F9000", "G1 E0.8 F2100", "G1 F1800"]
            text += [f"G1 X{a:.3f} Y{b:.3f} E{e:.5f}" for a, b, e in zip(x[1:], y[1:], extruded, strict=True)]
    return ("\n".join(text) + "\n").encode()


def gear(radius_mm: float, height_mm: float) -> Solid:
    """Return the gear as a closed surface standing on the bed."""
    turns = [(tooth + share) / TEETH * 2 * math.pi for tooth in range(TEETH) for share, _ in _FORM]
    reach = radius_mm * np.array([part for _ in range(TEETH) for _, part in _FORM])
    outline = np.stack([reach * np.cos(turns), reach * np.sin(turns)], axis=1)
    rim = height_mm * 0.7
    half = manifold3d.CrossSection([outline]).extrude(rim / 2, DIVISIONS, TWIST_DEG)
    body = half + half.mirror([0, 0, 1]).translate([0, 0, rim])
    disc = manifold3d.Manifold.cylinder(rim, radius_mm * 0.8, circular_segments=180)
    body -= disc.translate([0, 0, rim * 0.45])
    hub = manifold3d.Manifold.cylinder(height_mm, radius_mm * 0.28, radius_mm * 0.24, circular_segments=90)
    window = manifold3d.Manifold.cylinder(height_mm, radius_mm * 0.19, circular_segments=60)
    for number in range(5):
        angle = 2 * math.pi * number / 5
        place = [0.54 * radius_mm * math.cos(angle), 0.54 * radius_mm * math.sin(angle), -1.0]
        body -= window.translate(place)
    body += hub
    body -= manifold3d.Manifold.cylinder(2 * height_mm, radius_mm * 0.12, circular_segments=60).translate([0, 0, -1.0])
    mesh = body.to_mesh()
    return Solid("gear", np.asarray(mesh.vert_properties)[:, :3], np.asarray(mesh.tri_verts))
