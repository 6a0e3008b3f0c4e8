"""Small parts as G-code for these tests."""

import itertools
import math

import numpy as np


def part(layers: int = 2, *, size_mm: float = 14.0, arcs: bool = False, absolute: bool = False) -> bytes:
    """Write a ring, a square with a diagonal and a hatch, with travels and retractions, about (100, 100)."""
    lines = ["G21", "G90", "M82" if absolute else "M83", "G28", "G92 E0", "G1 Z0.2 F600"]
    state = {"e": 0.0}

    def filament(by_mm: float) -> str:
        state["e"] += by_mm
        return f"E{state['e'] if absolute else by_mm:.5f}"

    def draw(points: np.ndarray, feed: int) -> None:
        lines.append(f"G1 {filament(-0.8)} F2400")
        lines.append(f"G0 X{points[0, 0]:.3f} Y{points[0, 1]:.3f} F7200")
        lines.append(f"G1 {filament(0.8)} F2400")
        for a, b in itertools.pairwise(points):
            lines.append(f"G1 X{b[0]:.3f} Y{b[1]:.3f} {filament(0.033 * math.dist(a, b))} F{feed}")

    for layer in range(layers):
        lines += [";LAYER_CHANGE", f"G1 Z{0.2 + 0.2 * layer:.3f} F600"]
        t = np.linspace(0, 2 * math.pi, 73)
        draw(100 + size_mm * np.stack([np.cos(t), np.sin(t)], axis=1), 1800)
        half = size_mm / 2
        draw(100 + half * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1), (1, 1)]), 2400)
        rows = np.arange(-half, half, 1.5)
        zigzag = [(s * half, y) for k, y in enumerate(rows) for s in ((-1, 1) if k % 2 else (1, -1))]
        draw(100 + np.array(zigzag), 3000)
        if arcs:
            lines.append(f"G0 X{100 + size_mm:.3f} Y100 F7200")
            lines.append(f"G3 X{100 - size_mm:.3f} Y100 I{-size_mm:.3f} J0 {filament(0.033 * math.pi * size_mm)} F1800")
            lines.append(f"G2 X{100 + size_mm:.3f} Y100 I{size_mm:.3f} J0 {filament(0.033 * math.pi * size_mm)}")
            lines.append(f"G0 X{100 + half:.3f} Y100 F7200")
            lines.append(f"G2 X{100 + half:.3f} Y100 I{-half:.3f} J0 {filament(0.033 * math.tau * half)} F1800")
    return ("\n".join(lines) + "\n").encode()
