"""Judge mending by Klipper's planner: a table over files, with time, stops, moves, the true error and the promise.

    make hosts
    .venv/bin/python benchmarks/bench_klippy.py ../shared/corpus/gcode --family pulley-play --severity realistic

Each file is mended with the exact model of a drawn fault; both files go through Kalico's Klippy, the steps through the
true printer (true_printer.py), whose bed is as large as the file needs. Columns: the distance of the plastic from the
wanted path (RMS, RMS after, largest after, mm), what `mend` promised (RMS after), the job's time [s] and its change,
that of crossing the slack at the least (klippy_least.py), places where the nozzle stops while it prints (below 1 mm/s)
and where it nearly stands (below 6 mm/s; Klipper takes a right angle at 5), motion commands after ÷ before, that at the
least (klippy_least.py), bytes after ÷ before.
* misses an aim: 0.012 mm, 1 % of time beyond the least, 10 % of stops.
With --bead five more are filled in (klippy_bead.py), how uneven the bead is: with pressure advance and an input shaper
of the original on a sound printer and of the mended file on the broken one; with pressure advance alone of both, and of
the original where a sound printer stands still for as long as its crossings take. * is more than 1.1 times as uneven as
on the sound printer.

Of several families the files take one after the other. With --results each line is kept: begun again, it goes on. With
--csv the table is written there, too. With --moves a larger file ends after so many extruding moves. With --crossing
motors that cross their slack speed up by so many mm/s².
"""

import argparse
import csv
import json
import subprocess
import sys
import tempfile
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path

from bench_corpus import around
from klippy_bead import ADVANCED, SHAPED, bead_deviation
from klippy_cases import arguments, cases, drawn, text_of
from klippy_judge import Judged, Track, deposits, judge_both, wanted_path
from klippy_least import TOLERANCE_MM, Crossing, crossings, least_moves_times, standing
from klippy_run import FAST, RefusedByPlanner, plan
from printmend.corruption import Corruption, corruption_toml
from printmend.errors import PrintmendError
from printmend.gcode.read import read_gcode, straightened
from printmend.machine import Mechanism
from printmend.model import exact_model, write_model
from printmend.printer import MotionLimits, Printer, read_printer
from true_printer import TruePrinter

PRINTMEND = Path(sys.executable).parent / "printmend"


@dataclass(frozen=True)
class Row:
    """What is known of one file: as it is, and mended."""

    file: str
    firmware: str
    fault: str
    before_mm: float
    after_mm: float
    largest_mm: float
    promised_mm: float
    time_s: float
    time_mended_s: float
    time_least_s: float
    stops: int
    stops_mended: int
    slow: int
    slow_mended: int
    moves_times: float
    moves_least_times: float
    bytes_times: float
    bead_sound: float
    bead_mended: float
    unshaped_sound: float
    unshaped_mended: float
    unshaped_standing: float
    complaints: str


class Refused(Exception):
    """There is nothing to judge: the text is the reason, that of `mend` where it refused the file."""


def both(
    text: bytes, mended: bytes, printer: Printer, corruption: Corruption, folder: Path
) -> tuple[Judged, Judged, tuple[str, ...]]:
    """Judge a file and its mended form on one broken printer; the last are complaints about the mended one alone."""
    original = plan(text, printer, folder)
    if not len(original.moves) or not len(deposits(original)[0]):
        raise Refused("nothing is extruded")
    corrected = plan(mended, printer, folder, around=original)
    true = TruePrinter.of(corruption_toml(corruption), printer)
    return judge_both(original, corrected, printer, true, text, mended)


def beads(
    text: bytes, others: list[tuple[bytes, TruePrinter | None]], printer: Printer, folder: Path, extras: str = ""
) -> list[float]:
    """Return how uneven the bead of a file is on a sound printer, and that of each other on its printer, None for the
    sound one."""
    original = plan(ADVANCED + text, printer, folder, extras=extras)
    wanted = wanted_path(original)
    found = [bead_deviation(original, Track(original, printer), wanted)]
    for other, true in others:
        planned = plan(ADVANCED + other, printer, folder, extras=extras, around=original)
        found.append(bead_deviation(planned, Track(planned, printer, true), wanted))
    return [round(each, 4) for each in found]


def mend(source: Path, model: Path, output: Path, *more: str) -> dict:
    """Mend by the command line; return its report."""
    report = output.with_suffix(".report.json")
    command = [PRINTMEND, "mend", source, "-m", model, "-o", output, "--report", report, "--overwrite", "--force"]
    command += more
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False)  # noqa: S603 — our own program
    if done.returncode != 0:
        raise Refused(done.stderr.strip().splitlines()[-1] if done.stderr.strip() else f"ended with {done.returncode}")
    return json.loads(report.read_text())


def judged(source: Path, family: str, options: argparse.Namespace, folder: Path) -> Row:
    """Judge one file."""
    for old in folder.glob("*.gcode"):
        old.unlink()
    plain, model, output = folder / "part.gcode", folder / "m.mend.json", folder / "out.gcode"
    printer = read_printer(options.preset)
    text = text_of(source, printer, options)
    plain.write_bytes(text)
    printer = replace(around(printer, read_gcode(plain, printer=printer).moves), limits=MotionLimits(*FAST))
    corruption = drawn(family, options)
    write_model(model, exact_model(corruption.lower(printer)))  # type: ignore[arg-type] — gain tables are no family here
    more = () if options.crossing is None else ("--crossing", str(options.crossing), "--firmware", "klipper")
    report = mend(plain, model, output, *more)
    # What `mend` says of a file that leaves M83 to a macro of its printer's, this printer has to be told.
    top = b"M83\n" if any("put M83 at" in said for said in report["warnings"]) else b""
    before, after, complaints = both(top + text, top + output.read_bytes(), printer, corruption, folder / "run")
    machine = corruption.lower(printer)
    found: list[Crossing] = []
    least_times = 1.0
    if isinstance(machine, Mechanism):
        moves = read_gcode(plain, printer=printer).moves
        found = crossings(straightened(moves, TOLERANCE_MM), machine)
        least_times = least_moves_times(moves, machine, found)
    uneven = [float("nan")] * 5
    if options.bead:
        true = TruePrinter.of(corruption_toml(corruption), printer)
        mended, still = top + output.read_bytes(), top + standing(text, found)
        uneven = beads(top + text, [(mended, true)], printer, folder / "run", SHAPED)
        uneven += beads(top + text, [(mended, true), (still, None)], printer, folder / "run")
    return Row(
        source.name, report["duration"]["firmware"], family, round(before.rms_mm, 4), round(after.rms_mm, 4),
        round(after.max_mm, 4), round(report["after"]["rms_mm"], 4), round(before.job_s, 1), round(after.job_s, 1),
        round(before.job_s + sum(each.least_s for each in found), 1), before.stops, after.stops,
        before.corners, after.corners, round(after.moves / max(before.moves, 1), 2), round(least_times, 2),
        round(len(output.read_bytes()) / len(text), 2), *uneven, "; ".join(complaints)[:200],
    )  # fmt: skip


def in_words(row: Row) -> str:
    """Return a line of the table."""
    longer, least = (100 * (s / row.time_s - 1) for s in (row.time_mended_s, row.time_least_s))
    figures = [
        (f"{row.before_mm:8.4f}", False), (f"{row.after_mm:8.4f}", row.after_mm > 0.012),
        (f"{row.largest_mm:8.4f}", False), (f"{row.promised_mm:8.4f}", False), (f"{row.time_s:8.1f}", False),
        (f"{longer:7.2f}", longer > max(least, 0.0) + 1.0), (f"{least:7.2f}", False), (f"{row.stops:6}", False),
        (f"{row.stops_mended:6}", row.stops_mended > 1.1 * row.stops + 1), (f"{row.slow:6}", False),
        (f"{row.slow_mended:6}", row.slow_mended > 1.1 * row.slow + 1), (f"{row.moves_times:6.2f}", False),
        (f"{row.moves_least_times:6.2f}", False), (f"{row.bytes_times:6.2f}", False), (f"{row.bead_sound:7.3f}", False),
        (f"{row.bead_mended:7.3f}", row.bead_mended > 1.1 * row.bead_sound),
        (f"{row.unshaped_sound:7.3f}", False),
        (f"{row.unshaped_mended:7.3f}", row.unshaped_mended > 1.1 * row.unshaped_sound),
        (f"{row.unshaped_standing:7.3f}", False),
    ]  # fmt: skip
    line = "".join(text + ("*" if missed else " ") for text, missed in figures)
    return f"{line} {row.file} ({row.fault})" + (f"  COMPLAINS: {row.complaints}" if row.complaints else "")


def write_csv(path: Path, rows: list[Row]) -> None:
    """Write a table with what made it above its head line."""
    with path.open("w", newline="") as out:
        out.write("# Mended files judged by Klipper's planner (Kalico's Klippy, 300 mm/s, 3000 mm/s2, an Ender-3); ")
        out.write("errors in mm, 0.0036 of which is the micro-step.\n")
        out.write("# time_least_s: what crossing the slack costs whoever mends, acceleration left out ")
        out.write("(benchmarks/klippy_least.py). stops, slow: places below 1 and 6 mm/s within an extruded path.\n")
        out.write("# moves_least_times: moves_times for whoever stays within 0.01 mm (benchmarks/klippy_least.py).\n")
        out.write(f"# command: .venv/bin/python benchmarks/{' '.join([Path(sys.argv[0]).name, *sys.argv[1:]])}\n")
        writer = csv.DictWriter(out, [field.name for field in fields(Row)], lineterminator="\n")
        writer.writeheader()
        writer.writerows(asdict(row) for row in rows)


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--results", type=Path, metavar="FILE.jsonl")
    parser.add_argument("--csv", type=Path, help="write the table there")
    parser.add_argument("--crossing", type=float, metavar="MM_S2")
    parser.add_argument("--bead", action="store_true", help="judge the bead, too")
    options = parser.parse_args()
    known = {}
    if options.results is not None and options.results.exists():
        known = dict(json.loads(line) for line in options.results.read_text().splitlines())
    rows = []
    print("  before    after      max  promise   time s  time %   least  stops   after corners  after", end="")
    print("  moves  least  bytes   sound  mended   sound  mended   stops  file")
    with tempfile.TemporaryDirectory() as name:
        for source, family in cases(options):
            key = " ".join(map(str, (source, family, options.severity, options.seed, options.moves, options.preset)))
            key += (" bead" if options.bead else "") + (f" {options.crossing:g}" if options.crossing else "")
            if key not in known:
                try:
                    known[key] = asdict(judged(source, family, options, Path(name)))
                except (PrintmendError, RefusedByPlanner, Refused) as error:
                    known[key] = f"  {type(error).__name__}: {str(error)[:150]}  {source.name}"
                if options.results is not None:
                    with options.results.open("a") as out:
                        print(json.dumps([key, known[key]]), file=out)
            if isinstance(known[key], dict):
                rows.append(Row(**known[key]))
            print(known[key] if isinstance(known[key], str) else in_words(rows[-1]), flush=True)
    if options.csv is not None:
        write_csv(options.csv, rows)


if __name__ == "__main__":
    main()
