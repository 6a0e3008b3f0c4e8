"""Judge the scan commands from outside: probe → a foreign printer → a foreign scan → measure → learn → mend.

    .venv/bin/python benchmarks/bench_outside_scan.py --seed 1

The printer is benchmarks/outside.py, the scan benchmarks/outside_scan.py; neither shares code with printmend, and only
its command line is used. One line for each look of the scan: marks found, their error (place and turn taken off, the
scale not), the contour error [mm] of a part before and after mending (its place and turn on the bed taken off).
"""

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np
import shapely

sys.path.insert(0, str(Path(__file__).parent))
import outside
import outside_scan
from bench_outside import PRESETS, part_gcode
from outside_scan import Look
from runner import run

DARK = {"filament": (210, 214, 216), "bed": (30, 30, 34)}
RED = {"filament": (50, 60, 190), "bed": (235, 235, 235)}
# file name, kind of pixels, whether the file states its resolution, look, preset, family
CASES = (
    ("scan.png", "rgb", True, Look(), "ender3", "pulley+play"),
    ("scan.jpg", "rgb", True, Look(turn_deg=33, **DARK), "ender3", "pulley"),
    ("scan.png", "grey", True, Look(turn_deg=180, mirrored=True), "ender5", "pulley+play"),
    ("scan.tif", "grey16", True, Look(dpi=300, turn_deg=-90), "ender3", "play"),
    ("scan.png", "alpha", False, Look(turn_deg=91, **RED), "ender5", "pulley+loose"),
    ("scan.png", "palette", True, Look(dpi=300, turn_deg=217, mirrored=True, **DARK), "ender3", "pulley+play"),
    ("scan.tif", "cmyk", True, Look(dpi=300, turn_deg=5, **RED), "ender3", "healthy"),
    ("scan.jpg", "grey", True, Look(dpi=1200, turn_deg=2), "ender3", "pulley"),
    ("scan.png", "rgb", True, Look(dpi=400, turn_deg=122, noise=8.0, shade=0.3, blur_mm=0.06), "corexy", "pulley+play"),
)  # fmt: skip


def judge(case: tuple, seed: int, folder: Path) -> str:
    name, kind, stated, look, preset, family = case
    rng = np.random.default_rng(seed)
    home, sides, bed, corexy = PRESETS[preset]
    starts = (home[0] + home[1], home[0] - home[1]) if corexy else home
    named = [outside.random_drive(rng, family, h, s, bed) for h, s in zip(starts, sides, strict=True)]
    drives = (named[0][1], named[1][1])
    probe, scan, trace, saved = (folder / file for file in ("probe.gcode", name, "trace.csv", "printer.mend.json"))
    run("probe", "--printer", preset, "-o", str(probe))
    text = probe.read_text()
    moves = outside.read_moves(text, home)
    printed = outside.print_moves(moves, drives, home, corexy=corexy)
    picture = outside_scan.draw(outside_scan.read_beads(text, moves, printed), look, rng)
    outside_scan.save(scan, picture, kind, look.dpi if stated else None)
    measured = run("measure", str(scan), "--probe", str(probe.with_suffix(".json")), "-o", str(trace), ok=(0, 2))
    about = f"{name} {kind} {look.dpi:g} dpi {look.turn_deg:+g}°{' mirrored' * look.mirrored}, {preset} {family}"
    if measured.returncode:
        return f"{about}: refused: {measured.stderr.strip()}"
    table = np.genfromtxt(trace, delimiter=",", skip_header=1)
    error, found = mark_error_mm(table, moves, printed)
    run("learn", str(trace), "--printer", preset, "-o", str(saved))
    source, mended = folder / "part.gcode", folder / "out.gcode"
    part = part_gcode(rng, bed)
    source.write_text(part)
    mended.unlink(missing_ok=True)
    run("mend", str(source), "-m", str(saved), "-o", str(mended), "--overwrite", ok=(0, 3))
    ideal = outside.read_moves(part, home)
    ways = [outside.print_moves(ideal, drives, home, corexy=corexy)]
    after_moves = outside.read_moves(mended.read_text() if mended.exists() else part, home)
    ways.append(outside.print_moves(after_moves, drives, home, corexy=corexy))
    before, after = (
        placed_error_mm(ideal, made, way) for made, way in zip((ideal, after_moves), ways, strict=True)
    )  # fmt: skip
    return (
        f"{about} ({named[0][0]} | {named[1][0]}): {found} marks, {1000 * error:.1f} um RMS; "
        f"part {before[0]:.3f} → {after[0]:.4f} mm RMS (p95 {after[1]:.4f}), place {after[2]:.2f} mm off"
    )


def mark_error_mm(table: np.ndarray, moves: list, printed: list[np.ndarray]) -> tuple[float, int]:
    """Return the RMS difference along one axis of what was measured and printed, place and turn taken off."""
    first = max(i for i, move in enumerate(moves) if move.z_mm == -1.0)
    ends = [printed[first][-1]]
    ends += [way[-1] for m, way in zip(moves[first + 1 :], printed[first + 1 :], strict=True) if m.start_mm != m.end_mm]
    known = np.isfinite(table[:, 2])
    truth, measured = np.array(ends)[known], table[known, 2:4]
    a, b = measured - measured.mean(axis=0), truth - truth.mean(axis=0)
    turn = np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum())
    c, s = np.cos(turn), np.sin(turn)
    return float(np.sqrt(((a @ np.array([[c, s], [-s, c]]) - b) ** 2).mean())), int(known.sum())


STEPS_TO_PLACE = 6  # towards the place and turn at which a part's outline is missed least
TURNS_RAD = (0.0, 0.03, -0.03, 0.06, -0.06)  # to begin at: lines that lie closely lead astray from a start far off
PLACED_MM = 0.1  # RMS error with which a start has led to the place


def placed_error_mm(ideal: list, made: list, way: list[np.ndarray]) -> tuple[float, float, float, float]:
    """Return RMS and p95 of the contour error with the part's place and turn on the bed taken off, by how much its
    middle was off, and the largest error: a scan tells neither where a plate lay nor how it was turned."""
    layers = []
    for z in sorted({move.z_mm for move in ideal if move.extruding}):
        lines = np.array([[m.start_mm, m.end_mm] for m in ideal if _draws(m) and m.z_mm == z])
        points = np.concatenate([w for m, w in zip(made, way, strict=True) if _draws(m) and m.z_mm == z])
        layers.append((lines, shapely.STRtree(shapely.linestrings(lines)), points))
    middle = bounds_middle(made, way)
    moved = bounds_middle(ideal, [np.array([m.end_mm]) for m in ideal]) - middle
    best = (np.inf, np.inf, np.inf, np.inf)
    for turn_rad in TURNS_RAD:
        best = min(best, _placed_from(layers, middle, moved, turn_rad))
        if best[0] < PLACED_MM:
            break
    return best


def _placed_from(
    layers: list, middle: np.ndarray, moved: np.ndarray, turn_rad: float
) -> tuple[float, float, float, float]:
    best = (np.inf, np.inf, np.inf, np.inf)
    for _ in range(STEPS_TO_PLACE):
        cos, sin = np.cos(turn_rad), np.sin(turn_rad)
        errors, rows = [], []
        for lines, tree, points in layers:
            placed = (points - middle) @ np.array([[cos, sin], [-sin, cos]]) + middle + moved
            start, end = lines[tree.nearest(shapely.points(placed))].swapaxes(0, 1)
            along = end - start
            share = np.clip(((placed - start) * along).sum(axis=1) / np.square(along).sum(axis=1), 0, 1)
            off = start + share[:, None] * along - placed
            normal = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.hypot(*along.T)[:, None]
            arm = placed - middle - moved
            turned = normal[:, 1] * arm[:, 0] - normal[:, 0] * arm[:, 1]
            rows.append(np.column_stack([normal, turned, (off * normal).sum(axis=1)]))
            errors.append(np.hypot(*off.T))
        error, table = np.concatenate(errors), np.concatenate(rows)
        rms_mm, p95_mm = float(np.sqrt(np.mean(error**2))), float(np.quantile(error, 0.95))
        best = min(best, (rms_mm, p95_mm, float(np.hypot(*moved)), float(error.max())))
        step = np.linalg.lstsq(table[:, :3], table[:, 3], rcond=None)[0]
        moved, turn_rad = moved + step[:2], turn_rad + float(step[2])
    return best


def _draws(move: outside.Move) -> bool:
    return move.extruding and move.start_mm != move.end_mm


def bounds_middle(moves: list, way: list[np.ndarray]) -> np.ndarray:
    points = np.concatenate([one for m, one in zip(moves, way, strict=True) if m.extruding and m.start_mm != m.end_mm])
    return (points.min(axis=0) + points.max(axis=0)) / 2


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--case", type=int, action="append", help="numbers of the looks; all without")
    options = parser.parse_args()
    for number in options.case or range(len(CASES)):
        with tempfile.TemporaryDirectory() as folder:
            print(f"{number}. {judge(CASES[number], options.seed + number, Path(folder))}", flush=True)


if __name__ == "__main__":
    main()
