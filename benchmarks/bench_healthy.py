"""Does a healthy printer stay as it is? How many of its measurements change a file, or raise a false alarm.

    .venv/bin/python benchmarks/bench_healthy.py --seed 1 --traces 120 --scans 40 --callipers 40 --pictures 6 --photos 4

Any preset, at rest on its micro-steps or anywhere between. *Traces*: the marks of the probe, somebody's own lines or 60
points of them, with noise of 0.02 to 0.1 mm and now and then a few empty rows. *Scans*: the probe's marks as seen by a
foreign scanner that stretches, leans and knows no place. *Pictures* are scans drawn by outside_scan.py, which shares no
code with printmend, then measured; *photos* are of a smaller probe, by printmend's own camera. *Callipers*: twelve
distances, each read with an error. With --json a run that was cut off goes on where it ended. A case *changes* a file
where its model is not the healthy machine and a part comes out other than it went in; an *alarm* is whatever `learn`
says beyond notes of places that were not seen, or a fault.
"""

import argparse
import json
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
import cv2

import outside
import outside_scan
from bench_outside import part_gcode
from printmend.errors import RefusedError
from printmend.infer.distances import choose_distances
from printmend.learn.by_hand import model_by_hand
from printmend.learn.learned import learn_model
from printmend.measure import ProbePlan
from printmend.measure.measurement import measure_scans
from printmend.mend import mend_gcode
from printmend.mend.mend import is_healthy
from printmend.model import SavedModel
from printmend.path import Trace
from printmend.printer import Printer, preset_names, read_printer
from printmend.probe import design_probe, write_probe
from printmend_lab.camera import render_photo

KINDS = ("traces", "scans", "pictures", "photos", "callipers")
QUIET = {"unseen"}
STRETCH_SD, AXES_SD, LEAN_SD = 0.0013, 0.0007, 0.0003  # of foreign scanners


def printed(printer: Printer, commanded_mm: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return where a healthy printer prints: on its micro-steps, or where it was told."""
    if rng.random() < 0.5:
        return commanded_mm
    steps = np.array([axis.mm_per_step / axis.microsteps for axis in printer.axes[:2]])
    motors = np.rint(printer.to_motor(commanded_mm) / steps) * steps
    return np.asarray(printer.from_motor(motors))


def a_trace(printer: Printer, plan: ProbePlan, rng: np.random.Generator, folder: Path) -> SavedModel:
    kind, noise = rng.integers(3), rng.uniform(0.02, 0.1)
    if kind == 0:
        places = plan.waypoints_mm
    else:
        low, high = (np.array([getattr(axis, end) for axis in printer.axes[:2]]) for end in ("min_mm", "max_mm"))
        corners = np.vstack([[printer.home_mm], low + rng.uniform(0.05, 0.95, (59, 2)) * (high - low)])
        count = 60 if kind == 1 else int(rng.integers(300, 3000))
        along = np.linspace(0, len(corners) - 1, count)
        places = np.stack([np.interp(along, np.arange(len(corners)), corners[:, k]) for k in range(2)], axis=1)
    measured = printed(printer, places, rng) + rng.normal(0, noise, places.shape)
    if kind == 0:
        dots = np.zeros(len(places), bool)
        dots[plan.rows] = True
        measured[~dots] = np.nan
    if rng.random() < 0.3:
        measured[rng.random(len(places)) < 0.1] = np.nan
    return learn_model(Trace(places, measured, homed=True), printer)


def a_scan(printer: Printer, plan: ProbePlan, rng: np.random.Generator, folder: Path) -> SavedModel:
    common, half, lean = rng.normal(0, [STRETCH_SD, AXES_SD, LEAN_SD])
    turn = rng.uniform(0, 2 * np.pi)
    spun = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    glass = spun @ np.array([[1 + common + half, 2 * lean], [0, 1 + common - half]]) @ spun.T
    places = printed(printer, plan.waypoints_mm, rng)[plan.rows]
    seen = (places - places.mean(axis=0)) @ glass.T + rng.uniform(50, 150, 2)
    return learn_model(plan.trace(seen + rng.normal(0, rng.uniform(0.005, 0.03), seen.shape)), printer)


def a_picture(printer: Printer, plan: ProbePlan, rng: np.random.Generator, folder: Path) -> SavedModel:
    home = printer.home_mm[:2]
    text = (folder / f"{printer.name}.gcode").read_text()
    moves = outside.read_moves(text, home)
    ends = printed(printer, np.array([move.end_mm for move in moves]), rng)
    look = outside_scan.Look(dpi=float(rng.choice([300, 600])), turn_deg=rng.uniform(0, 360), noise=rng.uniform(1, 6))
    picture = outside_scan.draw(outside_scan.read_beads(text, moves, list(ends[:, None])), look, rng)
    stretched = np.round(np.array(picture.shape[1::-1]) * (1 + rng.normal(0, STRETCH_SD, 2))).astype(int)
    picture = cv2.resize(picture, tuple(stretched.tolist()), interpolation=cv2.INTER_LINEAR)
    outside_scan.save(folder / "scan.png", picture, "rgb", look.dpi)
    return learn_model(measure_scans([folder / "scan.png"], plan).trace, printer)


def a_photo(printer: Printer, plan: ProbePlan, rng: np.random.Generator, folder: Path) -> SavedModel:
    photo = render_photo(printed(printer, plan.marks_mm, rng), plan, rng=rng)
    cv2.imwrite(str(folder / "photo.jpg"), photo)
    return learn_model(measure_scans([folder / "photo.jpg"], plan).trace, printer)


def by_hand(printer: Printer, plan: ProbePlan, rng: np.random.Generator, folder: Path) -> SavedModel:
    distances = choose_distances(plan)
    marks = printed(printer, plan.marks_mm, rng)
    across = np.hypot(*(marks[distances.pairs[:, 1]] - marks[distances.pairs[:, 0]]).T) + plan.big_dot_mm
    across += rng.normal(0, 0.1) + rng.normal(0, rng.uniform(0.02, 0.07), len(across))  # dots are as wide as they are
    across[rng.random(len(across)) < 0.1 * (rng.random() < 0.3)] = np.nan
    return model_by_hand(distances, across, printer)


MEASURED: dict[str, Callable[[Printer, ProbePlan, np.random.Generator, Path], SavedModel]] = {
    "traces": a_trace, "scans": a_scan, "pictures": a_picture, "photos": a_photo, "callipers": by_hand,
}  # fmt: skip


def judge(kind: str, seed: int, number: int, folder: Path) -> dict:
    """Measure one healthy printer, and mend a part by what was learned of it."""
    rng = np.random.default_rng([seed, KINDS.index(kind), number])
    preset = str(rng.choice(sorted(preset_names())))
    printer = read_printer(preset)
    plan = design_probe(printer, size_mm=150.0) if kind == "photos" else design_probe(printer)
    if kind == "pictures":
        write_probe(folder / f"{printer.name}.gcode", plan)
    model = MEASURED[kind](printer, plan, rng, folder)
    written = changed = False
    if not is_healthy(model):
        source, output = folder / "part.gcode", folder / "out.gcode"
        source.write_text(part_gcode(rng, min(printer.x.max_mm, printer.y.max_mm)))
        try:
            mend_gcode(source, model, output)
            written, changed = True, output.read_bytes() != source.read_bytes()
        except RefusedError:
            pass
    misfits = [each["kind"] for each in model.document.get("misfit", {}).get("found", ())]
    said = model.findings[0] if kind != "callipers" else ""
    faults = [f"{each['part']} {each['kind']}" for each in model.document.get("diagnosis", [])]
    return {
        "kind": kind, "number": number, "printer": preset, "healthy": is_healthy(model), "written": written,
        "changed": changed, "misfits": misfits, "faults": faults, "said": said,
        "alarm": bool(set(misfits) - QUIET or faults),
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path, help="write every case to this file, a line each; those in it are not run")
    for option in ("--traces", "--scans", "--pictures", "--photos", "--callipers"):
        parser.add_argument(option, type=int, default=0, help="how many of these")
    options = parser.parse_args()
    lines = options.json.read_text().splitlines() if options.json is not None and options.json.exists() else []
    done = {(row["seed"], row["kind"], row["number"]): row for row in map(json.loads, lines)}
    rows: list[dict] = []
    with tempfile.TemporaryDirectory() as folder:
        for kind in KINDS:
            for number in range(getattr(options, kind)):
                if (row := done.get((options.seed, kind, number))) is None:
                    row = {"seed": options.seed, **judge(kind, options.seed, number, Path(folder))}
                    if options.json is not None:
                        with options.json.open("a") as handle:
                            handle.write(json.dumps(row) + "\n")
                rows.append(row)
                if row["changed"] or row["alarm"] or not row["healthy"]:
                    about = (
                        f"{kind} {number} {row['printer']}: changed {row['changed']}, {row['misfits']}, {row['said']}"
                    )
                    print(about, flush=True)
    print(f"{'kind':10} {'cases':>6} {'changed':>8} {'refused':>8} {'false alarms':>13}")
    for kind in KINDS:
        if mine := [row for row in rows if row["kind"] == kind]:
            refused = sum(not row["healthy"] and not row["written"] for row in mine)
            print(
                f"{kind:10} {len(mine):6} {sum(row['changed'] for row in mine):8} {refused:8} "
                f"{sum(row['alarm'] for row in mine):13}"
            )


if __name__ == "__main__":
    main()
