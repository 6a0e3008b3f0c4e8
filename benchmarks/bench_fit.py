"""Hidden machine x hidden filament, and hidden holes, feet and widths: how well `learn --filament` and `fit` tell them.

Parts and scans are those of `tests/foreign_part.py`, which shares no code with printmend. With ``--callipers`` the two
widths that `fit` names are read to 0.02 mm and given with ``--distance``.

    python -m benchmarks.bench_fit --cases 20
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np
from benchmarks.runner import write_results
from tests import foreign_part as foreign

from printmend.gcode.read import read_gcode
from printmend.measure.distance import choose_widths
from printmend.measure.walls import read_walls
from printmend.mend.filament import learn_in, parse_travel, update_in
from printmend.mend.fit import fits, measured_part
from printmend.messages import is_one_of
from printmend.path import Instrument, Trace
from printmend.printer import read_printer
from printmend.promise.belief import parse_belief
from printmend.promise.filament import UNTOLD, known_filaments
from printmend.promise.words import axis_scales

ABOUT = (
    "What `fit` says of parts with known holes, feet and widths, in scans of a foreign renderer [mm; shrinkage in %]"
)
POLYMERS = ("pla", "petg", "abs", "asa")


def fit_case(seed, folder, callipers):
    """Errors of one part's outline, holes, foot, width and hole diameters [mm], of its shrinkage [%], and their sds."""
    rng = np.random.default_rng(seed)
    outline, foot, hole = rng.uniform(-0.05, 0.12), rng.uniform(0.0, 0.3), rng.uniform(0.0, 0.2)
    shrinks = rng.uniform(0.0, 0.008, 2)
    shape, _ = foreign.part(rng)
    (folder / "part.gcode").write_text(foreign.gcode(shape))
    upper = foreign.printed(shape, outline, hole, -shrinks, rng)
    lower = foreign.printed(shape, outline + foot, hole + foot, -shrinks, rng)
    stretch = rng.normal(0, 0.0013) + rng.normal(0, 0.001, 2) * [1, -1]
    (folder / "under.png").write_bytes(foreign.scan([(lower, 1.0, 0.03)], rng, below=True, stretch=stretch))
    (folder / "top.png").write_bytes(
        foreign.scan([(lower, 0.35, 0.25), (upper, 1.0, 0.03)], rng, below=False, stretch=stretch)
    )
    printer, read_mm = read_printer("ender3"), []
    for width in (
        choose_widths(read_walls(read_gcode(folder / "part.gcode", printer=printer), printer)) if callipers else ()
    ):
        way = [np.cos(width.angle_rad), np.sin(width.angle_rad)]
        read_mm.append(np.ptp(lower[0] @ way) + rng.normal(0, 0.02))
    measured = measured_part(
        folder / "under.png", folder / "part.gcode", printer, top=folder / "top.png", distances_mm=read_mm
    )
    found = fits(measured, folder / "part.gcode", printer, None, "pla").estimate
    first, above = found.first, found.upper
    rows = {
        "outline": (above.outline_mm - outline, above.outline_sd_mm),
        "first layer": (first.outline_mm - outline - foot, first.outline_sd_mm),
        "foot": (found.foot_mm[0] - foot, found.foot_mm[1]),
        "hole": (above.hole_mm - hole, above.hole_sd_mm),
        "width": (2 * above.outline_mm - 2 * outline, 2 * above.outline_sd_mm),
    }
    for one in above.rounds:
        true_mm = foreign.came_out(upper, (one.at.x_mm, one.at.y_mm), shape)
        rows[f"hole of {one.at.diameter_mm:.0f} mm"] = (one.diameter_mm - true_mm, one.sd_mm)
    for axis in range(2):
        rows[f"shrinkage {'XY'[axis]} [%]"] = 100 * (-found.scale[axis] - shrinks[axis]), 100 * found.scale_sd[axis]
    return rows


def walk(printer, machine, shrinks, rng, noise_mm=0.02):
    """A measured walk over the bed by a machine with wrong scales and some play, once it has shrunk."""
    far = rng.uniform(20, 200, (120, 1, 2))
    path = np.vstack([printer.home_mm, (far + rng.uniform(-4, 4, (1, 3, 2))).reshape(-1, 2)])
    at, belt = [], np.array(path[0], float)
    for point in path:
        belt = np.clip(belt, point * (1 + machine) - 0.05, point * (1 + machine) + 0.05)
        at.append(belt)
    middle = np.array(printer.middle_mm[:2])
    measured = middle + (np.array(at) - middle) * (1 - shrinks) + rng.normal(0, noise_mm, path.shape)
    return Trace(path, measured + rng.normal(0, 3, 2), homed=True, placed=False,
                 instrument=Instrument(scale_sd=0.0002, axes_sd=0.0002, lean_sd=0.0002))  # fmt: skip


def scale_case(seed):
    """How far the scales of one machine and two filaments are off [%] by each way, and whether it was claimed."""
    rng, printer = np.random.default_rng(1000 + seed), read_printer("ender3")
    machine = rng.uniform(0, 0.005, 2) * rng.choice([-1, 1], 2)
    names = list(rng.choice(POLYMERS, 2, replace=False))
    shrinks = [rng.uniform(0, 0.008, 2) for _ in names]
    one = learn_in(walk(printer, machine, shrinks[0], rng), printer, names[0])
    two = update_in(one, walk(printer, machine, shrinks[1], rng), names[1], rng=rng).model
    rules = [
        parse_travel(f"{a}=200:{200 * (1 + m) + rng.normal(0, 0.05):.2f}") for a, m in zip("xy", machine, strict=True)
    ]
    ruled = update_in(one, None, None, rules, rng=rng).model
    both = update_in(two, None, None, rules, rng=rng).model
    paper = update_in(one, walk(printer, machine, np.zeros(2), rng), None, rng=rng).model
    ways = {
        "one filament": one,
        "two filaments": two,
        "one and a rule": ruled,
        "two and a rule": both,
        "one and paper": paper,
    }
    return {way: _errors(model, machine, dict(zip(names, shrinks, strict=True))) for way, model in ways.items()}


def _errors(model, machine, shrinks):
    belief = parse_belief(model)
    _, draws = axis_scales(belief.scene, belief.parts)
    claimed = not any(is_one_of(gap, UNTOLD) for gap in model.findings)
    known = known_filaments(model)
    own = draws.mean(axis=1) - machine
    of = [known[name][axis].draws_mm.mean() / 100 - shrinks[name][axis] for name in known for axis in range(2)]
    apart = []
    if len(known) > 1:
        a, b = list(known)
        apart = [
            (known[a][k].acts_mm[0] - known[b][k].acts_mm[0]) / 100 - (shrinks[a][k] - shrinks[b][k]) for k in range(2)
        ]
    return 100 * np.abs(own).max(), 100 * np.abs(of).max(), 100 * np.abs(apart).max(initial=0.0), claimed


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--only", choices=["fit", "scale"])
    parser.add_argument("--callipers", action="store_true")
    parser.add_argument("--csv", type=Path, help="write the accuracy of `fit` there")
    options = parser.parse_args()
    seeds = range(options.first, options.first + options.cases)
    if options.only != "scale":
        found, table = {}, []
        with tempfile.TemporaryDirectory() as folder:
            for seed in seeds:
                for name, row in fit_case(seed, Path(folder), options.callipers).items():
                    found.setdefault(name, []).append(row)
        print(f"{'':18}  median |error|  largest  in 90 % range")
        for name, rows in found.items():
            error, sd = np.abs(np.array(rows)).T
            inside = np.mean(error < 1.645 * sd)
            print(f"{name:18}  {np.median(error):14.3f}  {error.max():7.3f}  {inside:6.0%} of {len(rows)}")
            table.append({
                "what": name, "cases": len(rows), "median_error": round(float(np.median(error)), 4),
                "largest_error": round(float(error.max()), 4), "in_the_90_percent_range": round(float(inside), 3),
            })  # fmt: skip
        if options.csv is not None:
            write_results(options.csv, ABOUT, table)
    if options.only != "fit":
        ways = {}
        for seed in seeds:
            for way, row in scale_case(seed).items():
                ways.setdefault(way, []).append(row)
        print(f"\n{'':18}  machine [%]: median, largest   filaments   their difference   claimed")
        for way, rows in ways.items():
            own, of, apart, claimed = np.array(rows, float).T
            print(f"{way:18}  {np.median(own):20.3f} {own.max():7.3f}  {np.median(of):.3f} {of.max():.3f}   "
                  f"{np.median(apart):.3f} {apart.max():.3f}   {claimed.mean():.0%}")  # fmt: skip


if __name__ == "__main__":
    main()
