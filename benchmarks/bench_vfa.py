"""Are fine patterns on walls found, named and mended, and is no healthy printer accused of one?

    .venv/bin/python benchmarks/bench_vfa.py --seed 1 [--healthy 200] [--part] [--walls [--shaper] [--live]]

Of each printer of printmend's twin the dots of `printmend probe` are measured with noise of 0.02 mm, as a scan that
knows neither place nor scale. One motor ripples by 0.016 to 0.04 mm, with a belt tooth, motor poles, pairs of full
steps or full steps; the printer has play and an eccentric pulley of usual size beside. Found is a ripple of that motor
and period. A false name is any other ripple, and on a healthy printer any. With ``--part`` a part is mended and
printed: what the ripple and all else leave of it [mm RMS], and how many moves a line becomes.

With ``--walls`` a box is mended, whose walls go along the axes. There a ripple is an error of speed, and so of how wide
a line is. Klipper's planner drives the printer (`make hosts`), with pressure advance; the width's RMS deviation [%] is
that of the box on a sound printer, of the box as it is, and of the mended one (klippy_bead.py). With ``--shaper`` an
input shaper is on, too: one of 40 Hz takes half of what mends a tooth at 50 mm/s, which is 25 Hz. With ``--live`` the
live transform, which knows the shaper, mends to 0.003 mm in place of a mended file. Walls are printed at each
``--speed`` [mm/s]. With ``--part --live`` the part is printed in the planner, too. With ``--csv`` each printer's
figures are written there; ``--rows`` keeps them, and a run that was stopped goes on.
"""

import argparse
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from bench_homing import error_mm, part_gcode
from klippy_bead import ADVANCED, SHAPED, wall_deviation
from klippy_judge import Track, judge_both, wanted_path
from klippy_run import FAST, plan
from printmend.corruption import Corruption, Drive, EccentricBore, Play, corruption_toml
from printmend.corruption.transmission import Ripple
from printmend.errors import RefusedError
from printmend.learn.learned import learn_model
from printmend.machine import Mechanism
from printmend.mend import mend_gcode
from printmend.model import SavedModel
from printmend.model.model import write_model
from printmend.path import FLATBED
from printmend.printer import Homing, MotionLimits, Printer, read_printer
from printmend.probe import design_probe
from printmend.twin import Twin
from runner import Case, Row, parsed, parser_of, rows_of, write_results
from true_printer import TruePrinter

NOISE_MM = 0.02
ABOUT = (
    "Ripple of 0.016 to 0.04 mm: what mending leaves of a part's place [mm RMS], and of a line's width along the axes "
    "[% RMS]; sound: the same box on a printer without faults"
)
PERIODS_MM = {"teeth": 2.0, "ripple-4": 0.8, "ripple-2": 0.4, "ripple-1": 0.2}


def drawn(rng: np.random.Generator, printer: Printer, kind: str | None, motor: int) -> Corruption:
    """Draw what is broken on a usual machine, whose motor ripples if a kind is given."""
    drives = [
        Drive(pulley=EccentricBore(rng.uniform(0.02, 0.1), rng.uniform(0, 6)), belt=Play(rng.uniform(0.02, 0.2)))
        for _ in range(2)
    ]
    if kind is not None:
        step = printer.axes[motor].mm_per_step
        most_mm = 0.95 * PERIODS_MM[kind] / (2 * np.pi)  # a larger one would turn the motor back
        size_mm = min(rng.uniform(0.016, 0.04), most_mm)
        ripple = Ripple((size_mm / step,), (PERIODS_MM[kind] / step,), (rng.uniform(0, 6),))
        drives[motor] = replace(drives[motor], ripple=ripple)
    return Corruption((drives[0], drives[1]))


def machine(broken: Corruption, printer: Printer) -> Mechanism:
    """Return the machine."""
    made = broken.lower(printer)
    assert isinstance(made, Mechanism)
    return made


def box_gcode(side_mm: float = 60.0, walls: int = 1, layers: int = 4, speed_mm_s: float = 50.0) -> str:
    """Return a box whose walls go along the axes."""
    rows, low, feed = ["G28", "G90", "M83"], 110.0 - side_mm / 2, 60 * speed_mm_s
    for layer in range(layers):
        rows += ["G1 E-0.8 F2400", f"G1 Z{0.2 * (layer + 1):.2f} F600"]
        for wall in range(walls):
            inside, long = low + 0.45 * wall, side_mm - 0.9 * wall
            rows += [";TYPE:" + ("External perimeter" if wall == 0 else "Perimeter")]
            rows += [f"G0 X{inside:.3f} Y{inside:.3f} F7200"] + ["G1 E0.8 F2400"] * (wall == 0)
            for x, y in ((1, 0), (1, 1), (0, 1), (0, 0)):
                rows.append(f"G1 X{inside + x * long:.3f} Y{inside + y * long:.3f} E{0.0335 * long:.5f} F{feed:g}")
    return "\n".join(rows) + "\n"


def widths_percent(
    source: Path, mended: Path, broken: Corruption, printer: Printer, extras: str, live: str = ""
) -> tuple[float, float, float]:
    """Return how far lines are from their width on a sound printer, on the broken one, and there as mended [% RMS].

    With ``live``, lines of Klipper's configuration, ``mended`` is what the live transform is to mend."""
    printer = replace(printer, limits=MotionLimits(*FAST))
    true, folder = TruePrinter.of(corruption_toml(broken), printer), source.parent / "run"
    texts = ((source, extras), (mended, extras + live))
    plans = [plan(ADVANCED + path.read_bytes(), printer, folder, extras=more) for path, more in texts]
    wanted, tracks = wanted_path(plans[0]), [Track(plans[0], printer), *(Track(one, printer, true) for one in plans)]
    sound, before, after = (
        100 * wall_deviation(one, track, wanted) for one, track in zip([plans[0], *plans], tracks, strict=True)
    )
    return sound, before, after


def live_places_mm(source: Path, broken: Corruption, printer: Printer, live: str) -> tuple[float, float]:
    """Return how far a part lies from its path in Klipper's planner, as it is and with the live transform [mm RMS]."""
    printer, text = replace(printer, limits=MotionLimits(*FAST)), source.read_bytes()
    original = plan(text, printer, source.parent / "plain")
    corrected = plan(text, printer, source.parent / "live", around=original, extras=live)
    true = TruePrinter.of(corruption_toml(broken), printer)
    before, after, _ = judge_both(original, corrected, printer, true, text, text)
    return before.rms_mm, after.rms_mm


def learned(true: Mechanism, rng: np.random.Generator) -> SavedModel:
    """Learn a printer from a scan of its test print."""
    plan = design_probe(true.printer)
    marks = Twin(true).follow(plan.waypoints_mm)[plan.rows]
    return learn_model(
        replace(plan.trace(marks + rng.normal(0, NOISE_MM, marks.shape)), instrument=FLATBED), true.printer
    )


def ripples(model: SavedModel) -> set[tuple[str, str]]:
    """Return the motors and kinds of the ripples that a model names."""
    faults = model.document.get("diagnosis", [])
    return {
        (fault["part"], fault["kind"]) for fault in faults if fault["kind"].partition("-")[0] in ("teeth", "ripple")
    }


def main() -> None:
    """Draw printers and count names."""
    parser = parser_of(
        __doc__, printers=100, healthy=0, switch="unknown", part=False, walls=False, shaper=False, live=False
    )
    parser.add_argument("--speed", type=float, action="append")
    parser.add_argument("--csv", type=Path)
    given = parsed(parser)
    broken = [(number, list(PERIODS_MM)[number % len(PERIODS_MM)]) for number in range(given.printers)]
    sound = [(1000 + number, None) for number in range(given.healthy)]
    rows = [row for _, row in rows_of(judged, [*broken, *sound], given)]
    if given.csv is not None:
        write_results(given.csv, ABOUT, rows[: given.printers])
    for kind in PERIODS_MM:
        if own := [row for row in rows if row["ripple"] == kind]:
            print(f"{kind:9s}", in_words(own))
    print(f"healthy: {sum(row['false'] > 0 for row in rows[given.printers :])} of {given.healthy} falsely named")


def judged(given: argparse.Namespace, case: Case) -> Row:
    """Learn a printer, name its ripple, and judge what mending leaves of it."""
    number, kind = case
    printer = replace(read_printer("ender3"), homing=Homing(given.switch))
    rng = np.random.default_rng([given.seed, number])
    motor = int(rng.integers(2)) if kind else 0
    broken = drawn(rng, printer, kind, motor)
    true = machine(broken, printer)
    model = learned(true, rng)
    named, right = ripples(model), {(printer.motors[motor], kind)}
    row: Row = {"printer": number, "ripple": kind, "named": right <= named, "false": len(named - right)}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_model(path := folder / "printer.mend.json", model)
        live = f"[printmend]\nmodel: {path}\nphase_x: 0\nphase_y: 0\ntolerance: 0.003\n" if given.live else ""
        if given.part and kind:
            row |= places(folder, model, broken, live, part_gcode(rng))
        for speed in (given.speed or [50.0]) if given.walls and kind else ():
            row |= widths(folder, model, broken, live, SHAPED if given.shaper else "", speed)
    return {key: round(value, 4) if isinstance(value, float) else value for key, value in row.items()}


def places(folder: Path, model: SavedModel, broken: Corruption, live: str, text: str) -> Row:
    """Return how far a part is off, as it is and mended; with ``live``, lines of Klipper's configuration, there too."""
    source, output = folder / "part.gcode", folder / "part.mended.gcode"
    source.write_text(text)
    true, ratio = machine(broken, model.printer), 1.0
    try:
        said = mend_gcode(source, model, output).prediction
        ratio = said.commands / said.moves
    except RefusedError:
        output.write_bytes(source.read_bytes())
    row = {
        "place_before_mm": error_mm(source, source, true), "place_after_mm": error_mm(source, output, true),
        "moves_for_one": ratio,
    }  # fmt: skip
    names = ("planner_before_mm", "planner_live_mm")
    return row | (dict(zip(names, live_places_mm(source, broken, model.printer, live), strict=True)) if live else {})


def widths(folder: Path, model: SavedModel, broken: Corruption, live: str, extras: str, speed: float) -> Row:
    """Return how far the lines of a box are from their width at a speed: sound, as it is, and mended."""
    source, output = folder / "box.gcode", folder / "box.mended.gcode"
    source.write_text(box_gcode(speed_mm_s=speed))
    if not live:
        mend_gcode(source, model, output, force=True)
    found = widths_percent(source, source if live else output, broken, model.printer, extras, live)
    output.unlink(missing_ok=True)
    return {
        f"width_{name}_percent_{speed:g}_mm_s": each
        for name, each in zip(("sound", "before", "after"), found, strict=True)
    }


def in_words(rows: Sequence[Row]) -> str:
    """Return how many ripples of a kind are named, and the medians of all else."""
    named, false = sum(row["named"] for row in rows), sum(row["false"] for row in rows)
    medians = [f"{key} {np.median([row[key] for row in rows]):.4f}" for key in list(rows[0])[4:]]
    return "; ".join([f"named {named} of {len(rows)}, falsely {false}", *medians])


if __name__ == "__main__":
    main()
