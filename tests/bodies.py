"""Small bodies for tests: circles and zigzags as layers of lattice controls, and as G-code."""

import math
from pathlib import Path

import numpy as np

from printmend_lab.path import Body, Layer


def circle_layer(index: int, radius_steps: float, centre: tuple[int, int] = (550, 550)) -> Layer:
    """A circle on the lattice, one turn, 8-connected."""
    phi = np.linspace(0, 2 * np.pi, int(8 * radius_steps))
    points = np.rint(np.array(centre) + radius_steps * np.stack([np.cos(phi), np.sin(phi)], axis=1)).astype(int)
    controls = np.diff(points, axis=0)
    controls = controls[(controls != 0).any(axis=1)]
    return Layer(index, 0.2 * (index + 1), points[0], controls, np.ones(len(controls), bool))


def circle_body(
    name: str = "vase", layers: int = 5, radius_steps: float = 60.0, centre: tuple[int, int] = (550, 550)
) -> Body:
    """A vase: circles that grow a little from layer to layer."""
    return Body(name, tuple(circle_layer(i, radius_steps + 2 * i, centre) for i in range(layers)))


def write_vase(path: Path, layers: int = 4, radius_mm: float = 12.0) -> Path:
    """Write a vase as plain G-code, 0.2 mm a layer, on the middle of a 220 mm bed."""
    lines = ["G21", "G90", "M83", "G28", "G1 F1800"]
    for layer in range(layers):
        radius = radius_mm + 0.4 * layer
        lines += [f"G1 Z{0.2 * (layer + 1):.2f}", f"G1 X{110 + radius:.3f} Y110"]
        for k in range(1, 65):
            angle = 2 * math.pi * k / 64
            lines.append(f"G1 X{110 + radius * math.cos(angle):.3f} Y{110 + radius * math.sin(angle):.3f} E0.05")
    path.write_text("\n".join(lines) + "\n")
    return path
