"""Judge the commands from outside: probe → a foreign broken printer → learn → mend → the same printer.

    .venv/bin/python benchmarks/bench_outside.py --seed 1 --printers 3 --noise-mm 0.05 [--trace sparse]

Only the command line of printmend is used; the printer is benchmarks/outside.py. Prints, for each family of faults, the
contour error (distance of the extruded path to the ideal one, RMS and p95 in mm) before and after mending. What is
learned from is the trace of our probe or, with --trace, one of another shape: 60 points of somebody's own print, a
million points, one with four rows of ten unmeasured, one that does not begin at home.
"""

import argparse
import itertools
import json
import math
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import shapely

sys.path.insert(0, str(Path(__file__).parent))
import outside
from runner import parsed, parser_of, rows_of, run

FAMILIES = (
    "healthy", "pulley", "play", "loose", "pulley+play", "pulley+loose",
    "set-screw", "pulley+set-screw", "pulley+elastic", "friction", "frame", "frame+pulley+play",
)  # fmt: skip
TRACES = ("probe", "sparse", "dense", "holes", "no-home")
PRESETS = {
    "ender3": ((0.0, 0.0), (-1, -1), 220.0, False),
    "ender5": ((220.0, 220.0), (1, 1), 220.0, False),
    "corexy": ((0.0, 0.0), (-1, 1), 300.0, True),
}


def part_gcode(rng: np.random.Generator, bed_mm: float) -> str:
    """Write a two-layer part: a ring, a rounded star, a hatch in two directions, holes; with travels and retraction."""
    lines = ["G21", "G90", "M83", "G28", "G1 Z0.2 F600"]
    cx, cy = rng.uniform(0.4, 0.6, 2) * bed_mm
    size = rng.uniform(25, 45)
    for layer in range(2):
        lines.append(";LAYER_CHANGE")
        lines.append(f"G1 Z{0.2 + 0.2 * layer:.3f} F600")
        t = np.linspace(0, 2 * math.pi, 181)
        rings = [(size * np.cos(t), size * np.sin(t)), (8 * np.cos(-t) + 10, 8 * np.sin(-t))]
        star = size * 0.8 * (1 + 0.15 * np.cos(5 * t))
        rings.append((star * np.cos(t), star * np.sin(t)))
        for x, y in rings:
            lines += ["G1 E-1 F2400", f"G0 X{cx + x[0]:.3f} Y{cy + y[0]:.3f} F7200", "G1 E1 F2400"]
            ends = np.hypot(np.diff(x), np.diff(y))
            lines += [
                f"G1 X{cx + a:.3f} Y{cy + b:.3f} E{0.04 * d:.5f} F1800"
                for a, b, d in zip(x[1:], y[1:], ends, strict=True)
            ]
        angle = math.radians(45 if layer else -45)
        for k, offset in enumerate(np.arange(-0.6 * size, 0.6 * size, 1.7)):
            half = math.sqrt(size**2 * 0.55 - offset**2) * (1 if k % 2 else -1)
            p = [
                (
                    s * half * math.cos(angle) - offset * math.sin(angle),
                    s * half * math.sin(angle) + offset * math.cos(angle),
                )
                for s in (-1, 1)
            ]
            lines.append(f"G0 X{cx + p[0][0]:.3f} Y{cy + p[0][1]:.3f} F7200")
            lines.append(f"G1 X{cx + p[1][0]:.3f} Y{cy + p[1][1]:.3f} E{0.08 * abs(half):.5f} F3000")
    return "\n".join(lines) + "\n"


def contour_error_mm(
    ideal: list[outside.Move], printed_moves: list[outside.Move], printed: list[np.ndarray]
) -> np.ndarray:
    """Return the distances [n] of the printed extruded path to the ideal one, layer by layer."""
    errors = []
    for z in sorted({move.z_mm for move in ideal if move.extruding}):
        lines = shapely.linestrings(
            [[m.start_mm, m.end_mm] for m in ideal if m.extruding and m.z_mm == z and m.start_mm != m.end_mm]
        )
        points = [
            way
            for m, way in zip(printed_moves, printed, strict=True)
            if m.extruding and m.z_mm == z and m.start_mm != m.end_mm
        ]
        cloud = shapely.points(np.concatenate(points))
        tree = shapely.STRtree(lines)
        errors.append(shapely.distance(cloud, lines[tree.nearest(cloud)]))
    return np.concatenate(errors)


def walk_of(
    shape: str, moves: list[outside.Move], home: tuple[float, float], bed: float, rng: np.random.Generator
) -> list:
    """Return the moves that the trace follows, from home."""
    if shape == "sparse":
        places = [tuple(map(float, rng.uniform(0.1, 0.9, 2) * bed)) for _ in range(59)]
    else:
        first = max(i for i, m in enumerate(moves) if m.z_mm == -1.0)  # rows count from the last homing
        places = [m.end_mm for m in moves[first + 1 :] if m.start_mm != m.end_mm]
    if shape == "dense":
        corners = np.array([home, *places])
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))])
        at = np.linspace(0, along[-1], 1_000_000)[1:]
        places = list(zip(*(np.interp(at, along, corners[:, k]).tolist() for k in range(2)), strict=True))
    return [outside.Move(a, b, 0.2, True) for a, b in itertools.pairwise([home, *places])]


def judge(
    preset: str, family: str, noise_mm: float, rng: np.random.Generator, folder: Path, part: str | None, model: str,
    shape: str = "probe",
) -> dict:  # fmt: skip
    """Break one printer, mend one part, return the figures."""
    home, sides, bed, corexy = PRESETS[preset]
    named = [
        outside.random_drive(rng, family, h, s, bed)
        for h, s in zip((home[0] + home[1], home[0] - home[1]) if corexy else home, sides, strict=True)
    ]
    drives = (named[0][1], named[1][1])
    frame, matrix, shift = outside.random_frame(rng, home) if "frame" in family else ("", np.eye(2), np.zeros(2))

    def print_moves(moves: list[outside.Move], pitch_mm: float = 0.1) -> list[np.ndarray]:
        ways = outside.print_moves(moves, drives, home, corexy=corexy, pitch_mm=pitch_mm)
        return [way @ matrix.T + shift for way in ways]

    probe = folder / "probe.gcode"
    if not probe.exists():
        run("probe", "--printer", preset, "-o", str(probe))
    moves = walk_of(shape, outside.read_moves(probe.read_text(), home), home, bed, rng)
    table = np.array(
        [(*home, *home)] + [(*m.end_mm, *way[-1]) for m, way in zip(moves, print_moves(moves, 1e9), strict=True)]
    )
    table[:, 2:] += rng.normal(0, noise_mm, (len(table), 2)) if noise_mm else 0.0
    if shape == "holes":
        table[rng.random(len(table)) < 0.4, 2:] = np.nan
    if shape == "no-home":
        table = table[len(table) // 5 :]
    trace, saved, source, mended = (
        folder / name for name in ("trace.csv", "printer.mend.json", "part.gcode", "out.gcode")
    )
    rows = "\n".join(",".join("" if v != v else f"{v:.6f}" for v in row) for row in table.tolist())
    trace.write_text("x_mm,y_mm,x_measured_mm,y_measured_mm\n" + rows + "\n")
    began = time.perf_counter()
    learned = run("learn", str(trace), "--printer", preset, "--learner", model, "-o", str(saved))
    seconds = time.perf_counter() - began
    text = part if part is not None else part_gcode(rng, bed)
    source.write_text(text)
    mended.unlink(missing_ok=True)
    done = run("mend", str(source), "-m", str(saved), "-o", str(mended), "--overwrite", ok=(0, 3))
    ideal = outside.read_moves(text, home)
    before = contour_error_mm(ideal, ideal, print_moves(ideal))
    after_moves = outside.read_moves(mended.read_text() if mended.exists() else text, home)
    after = contour_error_mm(ideal, after_moves, print_moves(after_moves))
    return {
        "printer": preset, "family": family, "fault": f"{named[0][0]} | {named[1][0]} {frame}", "noise_mm": noise_mm,
        "refused": done.returncode == 3, "rows": len(table),
        "before_rms_mm": float(np.sqrt(np.mean(before**2))), "after_rms_mm": float(np.sqrt(np.mean(after**2))),
        "seconds": seconds, "after_p95_mm": float(np.quantile(after, 0.95)), "growth": len(after_moves) / len(ideal),
        "diagnosis": " / ".join(learned.stdout.strip().splitlines()[:3]),
    }  # fmt: skip


def judged(options: argparse.Namespace, case: tuple[str, str, int]) -> dict:
    """Return the figures of one printer."""
    preset, family, number = case
    rng = np.random.default_rng([options.seed, sorted(PRESETS).index(preset), FAMILIES.index(family), number])
    part = options.part.read_text() if options.part else None
    with tempfile.TemporaryDirectory() as name:
        return judge(preset, family, options.noise_mm, rng, Path(name), part, options.model, options.trace)


def main() -> None:
    parser = parser_of(__doc__, printers=3, noise_mm=0.05, preset=("ender3", "ender5", "corexy"), family=FAMILIES,
                       model="auto", json=False)  # fmt: skip
    parser.add_argument("--part", type=Path, help="a plain G-code file for the preset's bed instead of the drawn part")
    parser.add_argument("--trace", choices=TRACES, default="probe")
    options = parsed(parser)
    if not options.json:
        print("printer  family         before RMS  after RMS  after p95  growth  fault")
    cases = itertools.product(options.preset, options.family, range(options.printers))
    for (preset, family, _), row in rows_of(judged, cases, options):
        if options.json:
            print(json.dumps(row), flush=True)
        else:
            print(
                f"{preset:8} {family:13} {row['before_rms_mm']:11.4f} {row['after_rms_mm']:10.4f} "
                f"{row['after_p95_mm']:10.4f} {row['growth']:7.2f}  {row['fault']}",
                flush=True,
            )


if __name__ == "__main__":
    main()
