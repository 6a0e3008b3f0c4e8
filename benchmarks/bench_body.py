"""From G-code to controls: speed, and how far the lattice path strays from the line.

.venv/bin/python benchmarks/bench_body.py
"""

import time

import numpy as np
import shapely

from printmend.gcode.read import read_gcode
from printmend.printer import read_printer
from printmend_lab.body import demo_body_gcode
from printmend_lab.body.layers import follow_polyline, layers_of, strokes_of, to_steps


def seconds(function, repeats: int = 5) -> float:
    """Return the best of some runs, after one that compiles."""
    function()
    times = []
    for _ in range(repeats):
        started = time.perf_counter()
        function()
        times.append(time.perf_counter() - started)
    return min(times)


def main() -> None:
    printer, text = read_printer("ender5"), demo_body_gcode()
    program = read_gcode(text)
    strokes = strokes_of(program)
    layers = layers_of(strokes, printer)
    points = sum(layer.transitions for layer in layers)
    stray = 0.0
    for stroke, layer in zip(strokes, layers, strict=True):
        line = shapely.LineString(to_steps(stroke.points_mm, printer))
        stray = max(stray, float(shapely.distance(line, shapely.points(layer.nominal_steps)).max()))
    whole = seconds(lambda: layers_of(strokes_of(read_gcode(text)), printer))
    raster = seconds(lambda: layers_of(strokes, printer))
    print(f"shipped pulley: {len(text):,} bytes, {len(program.moves):,} moves, {points:,} controls")
    print(f"read, cut and follow {whole * 1e3:.0f} ms; follow alone {raster * 1e3:.1f} ms")
    print(f"largest distance from the line {stray:.4f} steps (law: 0.5)")
    zigzag = np.random.default_rng(0).uniform(0, 1100, (20_000, 2))
    drawing = np.ones(len(zigzag) - 1, bool)
    ticks = len(follow_polyline(zigzag, drawing)[1])
    print(f"long random lines: {ticks / seconds(lambda: follow_polyline(zigzag, drawing)) / 1e6:.0f} M controls/s")


if __name__ == "__main__":
    main()
