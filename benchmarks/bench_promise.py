"""Hold promises against the truth: is the error of a mended print within the 90 % range that was promised?

    .venv/bin/python benchmarks/bench_promise.py --seed 1 --cases 2 [--figure docs/figures/promise.png]

The printer is benchmarks/outside.py, with the faults of outside_faults.py on top; neither shares code with printmend.
Prints are judged by their shape, as promised: each homing puts all of one elsewhere.
Measured are the dots of the test print, some 600, and not the ways between them. Kinds: faults that its models have,
faults that none has, healthy printers, scans (a stretch of its own, neither place nor turn on the bed: in shape only),
settled scans (of a worse scanner, the plate scanned twice, turned by about a quarter, and one distance taken with
callipers), glimpses (a print of 12 to 30 mm, then a larger part), and, only where asked for, callipers (the first six
of the distances that `measure --callipers` asks for, then all twelve, then four), homed (the part is printed after
another homing: end stops scatter by 0.1 mm, and one motor in five stands an electrical turn aside) and shown (modelled
faults, with what dots at rest after one homing leave open: lines at speed are measured, too, as well as one scan at
600 dpi shows them, and the motors' phase corrects the end stops). With --known, learning is told which kinds of faults
there are and looks for no others: what is left then, the measurement leaves.
Seeds 900 and up are kept for the figures in docs/results.md; develop on others. A line a case, then for each kind: how
often truth lay in the range, the median of truth ÷ expected, how often the unmended print's lay in its own, the worst
harm, the largest error, and how many parts have a place that is farther off than their promised `max_mm`.
"""

import argparse
import itertools
import json
import sys
import tempfile
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from pathlib import Path
from unittest import mock

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
import outside
import outside_faults
from bench_outside import FAMILIES, PRESETS, part_gcode, walk_of
from bench_outside_scan import placed_error_mm
from printmend.errors import RefusedError
from printmend.infer import gram
from printmend.infer.distances import choose_distances
from printmend.learn.by_hand import model_by_hand
from printmend.learn.learned import learn_model
from printmend.measure.distance import scaled_by
from printmend.measure.measurement import freed_of_scanner, instrument_on_bed
from printmend.mend import check_gcode, mend_gcode
from printmend.model.model import SavedModel
from printmend.path import FLATBED, Instrument, Motion, Trace
from printmend.printer import Homing, read_printer
from printmend.probe import design_probe
from runner import run

KINDS = ("modelled", "unmodelled", "healthy", "scan", "glimpse", "settled", "callipers", "homed", "shown")
ASKED_FOR = ("callipers", "homed", "shown")  # kinds that are not run otherwise
COLOURS = {  # of the kinds, in the order of the table in docs/results.md; KINDS' own order is in the seeds
    "modelled": "#0f766e", "unmodelled": "#c2410c", "healthy": "#6b7280", "scan": "#4338ca", "settled": "#be185d",
    "glimpse": "#a16207", "callipers": "#0369a1", "homed": "#4d7c0f", "shown": "#111827",
}  # fmt: skip
TICKS_MM = (0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5)
SCATTER_MM, TURN_MM, TURN_SHARE = 0.1, 0.8, 0.2  # of end stops; a motor's electrical turn; homings with one
MOTION_SD_MM2 = 1.5e-5  # of the mean square across lines at speed, in one scan
STRETCH_SD, WORSE_STRETCH_SD = 0.001, 0.002  # of the foreign scanners: scale, difference of axes, lean
CALLIPERS_SD_MM, DOT_MM = 0.02, 1.6  # of a reading; the width of the dots whose outer edges it is taken over
WIDTH_SD_MM, READING_SD_MM, READINGS = 0.1, 0.05, (6, 12, 4)  # of the dots, of a distance across two; how many of these
SCANNED = ("scan", "settled", "callipers")
GLIMPSED = ("pulley", "play", "pulley+play")
ALWAYS = ("place", "scale")
EFFECTS_OF = {  # a family's parts
    "healthy": (), "pulley": ("pulley", "breathing"), "play": ("play",), "loose": ("play", "pulley", "breathing"),
    "set-screw": ("play",), "elastic": ("elastic",), "friction": ("friction", "play"), "frame": ("skew", "aspect"),
}  # fmt: skip


def looking_for(family: str) -> AbstractContextManager:
    """Let learning look for a family's effects and no others."""
    wanted = {*ALWAYS, *itertools.chain.from_iterable(EFFECTS_OF[part] for part in family.split("+"))}
    offered = gram._blocks_of
    return mock.patch.object(
        gram,
        "_blocks_of",
        lambda scene, kept, effects: offered(scene, kept, tuple(e for e in effects if e.name in wanted)),
    )


def glass_of(rng: np.random.Generator, stretch_sd: float) -> np.ndarray:
    """Draw how a foreign scanner stretches what lies on it [2, 2]."""
    common, half, lean = rng.normal(0, stretch_sd, 3) * [1, 0.7, 0.3]
    return np.array([[1 + common + half, 2 * lean], [0, 1 + common - half]])


def settled_scan(ends: np.ndarray, noise_mm: float, rng: np.random.Generator) -> tuple[np.ndarray, Instrument]:
    """Scan places [N, 2] twice, turned, and measure one distance between them: return what printmend makes of it."""
    glass, turn = glass_of(rng, WORSE_STRETCH_SD), rng.uniform(0, 2 * np.pi)
    turns = (turn, turn + rng.uniform(1.2, 1.9))
    ways = [np.array([[np.cos(t), -np.sin(t)], [np.sin(t), np.cos(t)]]) for t in turns]
    middle = ends.mean(axis=0)
    scans = [(ends - middle) @ way.T @ glass.T + rng.normal(0, noise_mm, ends.shape) for way in ways]
    freed = freed_of_scanner(scans, FLATBED)
    upright = [scan @ way for scan, way in zip(freed.places_mm, ways, strict=True)]
    measured = (upright[0] + upright[1]) / 2
    span = (int(np.argmin(ends.sum(axis=1))), int(np.argmax(ends.sum(axis=1))))
    distance_mm = float(np.hypot(*(ends[span[1]] - ends[span[0]]))) + DOT_MM + rng.normal(0, CALLIPERS_SD_MM)
    dots_mm = DOT_MM * np.hypot(*glass).mean() + rng.normal(0, noise_mm, 2)
    measured, instrument, _ = scaled_by(
        distance_mm, span, dots_mm, measured, instrument_on_bed(freed.instrument, [np.eye(2)], settled=True)
    )
    return measured + np.array([80.0, 95.0]), instrument


def by_callipers(number: int, preset: str, printed: Callable, rng: np.random.Generator) -> SavedModel:
    """Learn from a few distances between large dots of a probe."""
    printer = read_printer(preset)
    plan = design_probe(printer)
    distances = choose_distances(plan)
    ways = itertools.pairwise([PRESETS[preset][0], *map(tuple, plan.waypoints_mm.tolist())])
    ends = np.array([way[-1] for way in printed([outside.Move(a, b, 0.2, True) for a, b in ways], 0.0)])[plan.rows]
    across_mm = np.hypot(*(ends[distances.pairs[:, 1]] - ends[distances.pairs[:, 0]]).T) + plan.big_dot_mm
    across_mm += rng.normal(0, WIDTH_SD_MM) + rng.normal(0, READING_SD_MM, len(across_mm))
    across_mm[READINGS[number % len(READINGS)] :] = np.nan
    return model_by_hand(distances, across_mm, printer)


def across_mm(ideal: list, made: list, ways: list[np.ndarray], *, turned: bool = False) -> tuple[float, float]:
    """Return the RMS distance of printed lines straight across the wanted ones, each by its length, as printmend has
    it, and the largest; all of it is shifted so that it fits best, and ``turned``, too.

    Which line is meant tells the filament that was used up: of lines that lie closely, the nearest is often another.
    """
    lines, drawn = ([move for move in moves if _draws(move)] for moves in (ideal, made))
    end, middle = (np.cumsum([move.filament_mm for move in moves]) for moves in (lines, drawn))
    middle = (middle - [move.filament_mm / 2 for move in drawn]) * (end[-1] / middle[-1])
    start, along = (np.array([value(move) for move in lines]) for value in (lambda m: m.start_mm, _along))
    of = np.minimum(np.searchsorted(end, middle), len(lines) - 1)
    mine = [way for move, way in zip(made, ways, strict=True) if _draws(move)]
    counts = [len(way) for way in mine]
    at = np.repeat(of, counts)
    normal = (np.stack([-along[:, 1], along[:, 0]], axis=1) / np.hypot(*along.T)[:, None])[at]
    points = np.concatenate(mine)
    error = ((points - start[at]) * normal).sum(axis=1)
    weight = np.repeat([np.hypot(*_along(move)) / count for move, count in zip(drawn, counts, strict=True)], counts)
    arm = points - points.mean(axis=0)
    turn = normal[:, [1]] * arm[:, [0]] - normal[:, [0]] * arm[:, [1]]
    table, root = np.hstack([normal, turn] if turned else [normal]), np.sqrt(weight)
    error = error - table @ np.linalg.lstsq(table * root[:, None], error * root, rcond=None)[0]
    return float(np.sqrt(np.average(error**2, weights=weight))), float(np.abs(error).max())


def _draws(move: outside.Move) -> bool:
    return move.extruding and move.start_mm != move.end_mm


def _along(move: outside.Move) -> np.ndarray:
    return np.subtract(move.end_mm, move.start_mm)


def judge(
    kind: str, preset: str, family: str, number: int, seed: int, noise_mm: float, folder: Path,
    scanner_error: float | None = None,
) -> dict:  # fmt: skip
    """Break one printer, learn and mend; return what was promised and what came."""
    home, sides, bed, corexy = PRESETS[preset]
    names = (*FAMILIES, *outside_faults.FAULTS)
    rng = np.random.default_rng([seed, KINDS.index(kind), sorted(PRESETS).index(preset), names.index(family), number])
    base = family
    if kind == "unmodelled":
        base = ("healthy", "pulley+play")[number % 2]
    starts = (home[0] + home[1], home[0] - home[1]) if corexy else home
    named = [outside.random_drive(rng, base, h, s, bed) for h, s in zip(starts, sides, strict=True)]
    drives = (named[0][1], named[1][1])
    frame, matrix, shift = outside.random_frame(rng, home) if "frame" in base else ("", np.eye(2), np.zeros(2))
    fault = outside_faults.FAULTS[family](rng) if kind == "unmodelled" else None

    def printed(moves: list, before_mm: float) -> list:
        ways = [way @ matrix.T + shift for way in outside.print_moves(moves, drives, home, corexy=corexy)]
        return ways if fault is None else fault(moves, ways, before_mm)

    probe = folder / f"{preset}.gcode"
    if not probe.exists():
        run("probe", "--printer", preset, "-o", str(probe))
    moves = walk_of("probe", outside.read_moves(probe.read_text(), home), home, bed, rng)
    if kind == "glimpse":
        window = rng.uniform(0.4, 0.6, 2) * bed + rng.uniform(-0.5, 0.5, (300, 2)) * rng.uniform(12, 30)
        ends_mm = [home, *map(tuple, window.tolist())]
        moves = [outside.Move(a, b, 0.2, True) for a, b in itertools.pairwise(ends_mm)]
    ends = np.array([home, *(way[-1] for way in printed(moves, 0.0))])
    wanted = np.array([home, *(move.end_mm for move in moves)])
    travelled = float(np.hypot(*np.diff(wanted, axis=0).T).sum())
    measured = ends + rng.normal(0, noise_mm, ends.shape)
    if kind != "glimpse":  # an owner can measure dots alone
        plan = json.loads(probe.with_suffix(".json").read_text())
        between = np.ones(len(ends), dtype=bool)
        between[[0, *(mark["row"] for mark in plan["marks"])]] = False
        measured[between] = np.nan
    instrument = None
    if kind == "scan":
        measured = (measured - 90) @ glass_of(rng, scanner_error or STRETCH_SD).T + [80, 95]
        instrument = None if scanner_error is None else FLATBED.known(scanner_error)
    elif kind == "settled":
        measured, instrument = settled_scan(ends, noise_mm, rng)
    placed = kind not in SCANNED
    trace = Trace(wanted, measured, homed=True, placed=placed, instrument=instrument)
    by_hand = kind == "callipers"
    printer = read_printer(preset)
    if kind == "shown":
        trace = replace(trace, motion=Motion(rng.normal(0, MOTION_SD_MM2), MOTION_SD_MM2))
        printer = replace(printer, homing=Homing("phase"))
    model = by_callipers(number, preset, printed, rng) if by_hand else learn_model(trace, printer)
    source, output = folder / "part.gcode", folder / "out.gcode"
    source.write_text(part_gcode(rng, bed))
    if kind == "homed":
        aside_mm = TURN_MM * rng.choice((-1, 1), 2) * (rng.random(2) < TURN_SHARE)
        by_mm = aside_mm + np.sqrt(2) * rng.normal(0, SCATTER_MM, 2)  # that of the measured print and of this one
        one, two = itertools.starmap(outside.homed_again, zip(drives, by_mm, starts, strict=True))
        drives = (one, two)
    output.unlink(missing_ok=True)
    try:
        said = mend_gcode(source, model, output).prediction
    except RefusedError:
        said = check_gcode(source, model)
    ideal = outside.read_moves(source.read_text(), home)
    made = outside.read_moves((output if output.exists() else source).read_text(), home)
    true = []
    for commands in (ideal, made):
        way = printed(commands, travelled)
        if commands is ideal:
            turn = np.arctan2(matrix[1, 0], matrix[0, 0])  # no scan tells it: x keeps its direction
            back = np.eye(2) if placed else np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
            as_it_is_mm = across_mm(ideal, ideal, [each @ back for each in way])[0]
        if placed or by_hand:  # by hand errors are large: another line is often the nearest
            rms_mm, most_mm = across_mm(ideal, commands, way, turned=by_hand and corexy)
        else:
            rms_mm, _, _, most_mm = placed_error_mm(ideal, commands, way)
        true.append(rms_mm)
    promise = said.after if output.exists() else said.before
    return {
        "kind": kind, "printer": preset, "family": family, "base": base, "number": number,
        "written": output.exists(), "changed": output.exists() and output.read_bytes() != source.read_bytes(),
        "before_mm": true[0], "after_mm": true[1], "expected_mm": promise.rms_mm, "low_mm": promise.rms_low_mm,
        "high_mm": promise.rms_high_mm, "made_of": promise.made_of,
        "most_mm": most_mm, "most_said_mm": promise.max_mm,
        "as_it_is_mm": as_it_is_mm,
        "as_it_is_said_mm": [said.before.rms_low_mm, said.before.rms_mm, said.before.rms_high_mm],
        "fault": f"{named[0][0]} | {named[1][0]} {frame}",
    }  # fmt: skip


def told(row: dict) -> str:
    """Say one case in a line."""
    outside_range = "" if row["low_mm"] <= row["after_mm"] <= row["high_mm"] else " outside the range"
    return (
        f"{row['kind']:11} {row['printer']:7} {row['family']:16} {row['before_mm']:.4f} → {row['after_mm']:.4f}, "
        f"promised {row['expected_mm']:.4f} ({row['low_mm']:.4f}–{row['high_mm']:.4f}){outside_range}"
        f"{'' if row['written'] else ', refused'}; {row['fault']}"
    )


def summary(rows: list[dict]) -> str:
    lines = [
        "kind         cases  in the range  true ÷ expected (median)  as it is in its range  refused  changed  "
        "worst harm  largest error  above its largest  upper ÷ lower (median)"
    ]
    for kind in COLOURS:
        mine = [row for row in rows if row["kind"] == kind]
        if not mine:
            continue
        inside = np.mean([row["low_mm"] <= row["after_mm"] <= row["high_mm"] for row in mine])
        ratio = np.median([row["after_mm"] / max(row["expected_mm"], 1e-9) for row in mine])
        as_it_is = [
            low <= row.get("as_it_is_mm", np.nan) <= high
            for row in mine
            for low, _, high in [row.get("as_it_is_said_mm", [np.nan] * 3)]
        ]
        above = [row["most_mm"] > row["most_said_mm"] for row in mine if "most_mm" in row]
        harm = max(row["after_mm"] - row["before_mm"] for row in mine)
        lines.append(
            f"{kind:12} {len(mine):5} {100 * inside:11.0f} % {ratio:25.2f} {100 * np.mean(as_it_is):20.0f} % "
            f"{sum(not row['written'] for row in mine):8} "
            f"{sum(row['changed'] for row in mine):8} {harm:11.4f} {max(row['after_mm'] for row in mine):14.4f} "
            f"{sum(above):11} of {len(above):2} "
            f"{np.median([row['high_mm'] / max(row['low_mm'], 1e-9) for row in mine]):22.1f}"
        )
    return "\n".join(lines)


def draw(rows: list[dict], path: Path) -> None:
    """Draw expected against true, each with its range."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(7.2, 6.6), layout="constrained")
    for kind, colour in COLOURS.items():
        mine = [row for row in rows if row["kind"] == kind]
        if not mine:
            continue
        true, expected, low, high = (
            np.array([row[key] for row in mine]) for key in ("after_mm", "expected_mm", "low_mm", "high_mm")
        )
        axes.errorbar(
            true, expected, [np.maximum(expected - low, 0), np.maximum(high - expected, 0)], fmt="o", ms=4, lw=0.8,
            color=colour, label=f"{kind} ({len(mine)})", alpha=0.8,
        )  # fmt: skip
    ends = (0.0015, 1.3 * max(max(row["after_mm"], row["high_mm"]) for row in rows))
    axes.plot(ends, ends, color="#a8a29e", lw=1, label="expected = true", zorder=0)
    axes.set(xscale="log", yscale="log", xlim=ends, ylim=ends)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_ticks(TICKS_MM, [f"{each:g}" for each in TICKS_MM])
        axis.set_minor_locator(plt.NullLocator())
    axes.grid(color="#e7e5e4", lw=0.6, zorder=0)
    axes.set_xlabel("true error of the mended print, mm RMS")
    axes.set_ylabel("expected error with its 90 % range, mm RMS")
    axes.legend(title="kind (prints)", alignment="left", frameon=False)
    figure.savefig(path, dpi=130)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--cases", type=int, default=1, help="a family and printer")
    parser.add_argument("--noise-mm", type=float, default=0.05)
    parser.add_argument("--scanner-error", type=float, help="share by which `scan` stretches, and says so")
    parser.add_argument(
        "--known", action="store_true", help="look for a family's faults only; for kinds whose faults are modelled"
    )
    parser.add_argument("--kind", choices=KINDS, action="append")
    parser.add_argument("--printer", choices=sorted(PRESETS), action="append")
    parser.add_argument("--figure", type=Path)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--rows", type=Path, action="append", help="sum up and draw what runs with --json wrote")
    options = parser.parse_args()
    rows = [
        json.loads(line) for path in options.rows or () for line in path.read_text().splitlines() if line[:1] == "{"
    ]
    if rows:
        print(summary(rows))
        if options.figure is not None:
            draw(rows, options.figure)
        return
    with tempfile.TemporaryDirectory() as folder:
        for kind in options.kind or [each for each in KINDS if each not in ASKED_FOR]:
            families = {
                "unmodelled": tuple(outside_faults.FAULTS),
                "healthy": ("healthy",),
                "glimpse": GLIMPSED,
                "callipers": FAMILIES,
            }.get(kind, FAMILIES[1:])
            for preset in options.printer or ("ender3", "corexy"):
                for family in families:
                    for number in range(options.cases):
                        noise = 0.02 if kind in SCANNED else options.noise_mm
                        with looking_for(family) if options.known else nullcontext():
                            row = judge(
                                kind, preset, family, number, options.seed, noise, Path(folder), options.scanner_error
                            )
                        rows.append(row)
                        print(json.dumps(row) if options.json else told(row), flush=True)
    print(summary(rows))
    if options.figure is not None:
        draw(rows, options.figure)


if __name__ == "__main__":
    main()
