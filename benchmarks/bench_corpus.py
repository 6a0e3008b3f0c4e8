"""Mend every file of a corpus for a broken printer and execute both files on it.

    .venv/bin/python benchmarks/bench_corpus.py ../shared/corpus/gcode [--family pulley-play] [--seed 1]

For each file: the contour error before and after (RMS, p95, max; `mend.against`, which reads both files again and
shares nothing with the planner), the largest change of a layer's filament, how far commands leave the bed further than
the file's own, the change of the time that printing takes (length ÷ feed of the extruding moves), moves after ÷ before,
and the prediction's error. The printer is the preset, its bed made as large as the file needs. Figures that miss the
aim are marked *.
"""

import argparse
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from printmend.errors import PrintmendError, RefusedError
from printmend.gcode.read import Moves, read_gcode, straightened
from printmend.mend import mend_gcode
from printmend.mend.against import judged
from printmend.model import exact_model
from printmend.printer import Printer, read_printer
from printmend_lab.sampling import sample

_MARGIN_MM = 5.0


def around(printer: Printer, moves: Moves) -> Printer:
    """Return a printer whose bed holds what the file extrudes."""
    drawn = moves.end_mm[moves.extruding & moves.known[:, :2].all(axis=1), :2]
    if not len(drawn):
        return printer
    axes = []
    for axis, low, high in zip((printer.x, printer.y), drawn.min(axis=0), drawn.max(axis=0), strict=True):
        low, high = min(axis.min_mm, np.floor(low - _MARGIN_MM)), max(axis.max_mm, np.ceil(high + _MARGIN_MM))
        if (low, high) != (axis.min_mm, axis.max_mm):
            home = low if axis.home_side == "min" else high
            axis = replace(axis, min_mm=float(low), max_mm=float(high), home_mm=float(home))
        axes.append(axis)
    return replace(printer, x=axes[0], y=axes[1])


def by_layer(moves: Moves, values: np.ndarray) -> np.ndarray:
    return np.bincount(moves.layer + 1, values, minlength=int(moves.layer.max(initial=-1)) + 2)


def seconds(moves: Moves) -> np.ndarray:
    """Return the times of the extruding moves, arcs as chords; 0 where the file names no feed."""
    moves = straightened(moves, 0.002)
    length = np.linalg.norm(moves.end_mm - moves.start_mm, axis=1)
    return np.where(moves.extruding & (moves.feed_mm_s > 0), length / np.maximum(moves.feed_mm_s, 1e-9), 0.0)


def outside_mm(printer: Printer, moves: Moves) -> float:
    """Return how far the known ends lie beyond the bed."""
    ends = moves.end_mm[moves.known[:, :2].all(axis=1), :2]
    low, high = (np.array([getattr(axis, name) for axis in (printer.x, printer.y)]) for name in ("min_mm", "max_mm"))
    return float(np.maximum(low - ends, ends - high).max(initial=0.0))


def row_of(source: Path, printer: Printer, family: str, severity: str, seed: int, output: Path) -> str:
    before = read_gcode(source, printer=printer).moves
    printer = around(printer, before)
    before = read_gcode(source, printer=printer).moves
    if not before.extruding.any():
        raise RefusedError(source, wanted="a print", came="moves that extrude nothing", todo="give a sliced file")
    model = exact_model(sample(family, np.random.default_rng([seed, *family.encode()]), severity).lower(printer))  # type: ignore[arg-type]
    done = mend_gcode(source, model, output, force=True)  # whatever printer the file names: the bed is made for it
    found = judged(done.prediction, str(source), str(output), model.mechanism)
    after = read_gcode(output, printer=printer).moves
    filament = np.abs(by_layer(after, after.extrusion_mm) - by_layer(before, before.extrusion_mm)).max()
    time = seconds(after).sum() / seconds(before).sum() - 1 if seconds(before).any() else 0.0
    further = max(0.0, outside_mm(printer, after) - outside_mm(printer, before))
    p = done.prediction
    figures = [
        (f"{found.before.rms_mm:8.4f}", False),
        (f"{found.after.rms_mm:8.4f}", found.after.rms_mm > 0.01),
        (f"{found.after.p95_mm:8.4f}", False),
        (f"{found.after.max_mm:8.4f}", found.after.max_mm > 0.05),
        (f"{filament:9.1e}", filament > 1e-4),
        (f"{further:7.3f}", further > 0.001),
        (f"{100 * time:7.2f}", abs(time) > 0.02),
        (f"{p.commands / p.moves:6.2f}", False),
        (f"{p.before.rms_mm:8.4f}", False),
        (f"{p.after.rms_mm:8.4f}", abs(p.after.rms_mm - found.after.rms_mm) > 0.002),
        (f"{p.unknown:6}", False), (f"{p.anchors:6}", False), (f"{p.clamped_extruding:6}", False),
    ]  # fmt: skip
    return "".join(text + ("*" if missed else " ") for text, missed in figures)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("corpus", type=Path)
    parser.add_argument("--preset", default="ender3")
    parser.add_argument("--family", default="pulley-play")
    parser.add_argument("--severity", choices=["damaged", "realistic"], default="damaged")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    files = (
        sorted(path for path in options.corpus.rglob("*") if path.is_file())
        if options.corpus.is_dir()
        else [options.corpus]
    )
    print("   before    after      p95      max  filament  beyond  time %  moves  ", end="")
    print("pred. b  pred. a unknown anchor clamped file")
    with tempfile.TemporaryDirectory() as name:
        for source in files:
            output = Path(name) / ("out" + source.suffix)
            output.unlink(missing_ok=True)
            try:
                text = row_of(
                    source, read_printer(options.preset), options.family, options.severity, options.seed, output
                )
            except PrintmendError as error:
                text = f"   {type(error).__name__}: {error}"
            print(f"{text}  {source.name}", flush=True)


if __name__ == "__main__":
    sys.exit(main())
