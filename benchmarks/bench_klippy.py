"""Judge mending by Klipper's planner: a table over files, with time, stops, moves, the true error and the promise.

    make hosts
    .venv/bin/python benchmarks/bench_klippy.py ../shared/corpus/gcode --family pulley-play --severity realistic

Each file is mended with the exact model of a drawn fault; both files go through Kalico's Klippy, the steps through the
true printer (true_printer.py), whose bed is as large as the file needs. Columns: the distance of the plastic from the
wanted path (RMS, RMS after, largest after, mm), what `mend` promised (RMS after), the job's time [s] and its change,
places where the nozzle stops while it prints (below 1 mm/s) and where it nearly stands (below 6 mm/s; Klipper takes a
right angle at 5), motion commands after ÷ before. * misses an aim: 0.012 mm, 1 % of time, 10 % of stops.
With --bead two more, each from a run with pressure advance and an input shaper (klippy_bead.py): how uneven the bead
is, of the original on a sound printer and of the mended file on the broken one; * is more than 1.1 times as uneven.

Of several families the files take one after the other. With --results each line is kept: begun again, it goes on.
With --moves a larger file ends after so many extruding moves. With --crossing motors that cross their slack speed up
by so many mm/s².
"""

import argparse
import json
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

from bench_corpus import around
from klippy_bead import ADVANCED, SHAPED, bead_deviation
from klippy_cases import arguments, cases, drawn, text_of
from klippy_judge import Judged, Track, deposits, judge_both, wanted_path
from klippy_run import FAST, RefusedByPlanner, plan
from printmend.corruption import Corruption, corruption_toml
from printmend.errors import PrintmendError
from printmend.gcode.read import read_gcode
from printmend.printer import MotionLimits, Printer, read_printer
from printmend.saved import exact_model, write_model
from true_printer import TruePrinter

PRINTMEND = Path(sys.executable).parent / "printmend"


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


def beads(text: bytes, mended: bytes, printer: Printer, corruption: Corruption, folder: Path) -> tuple[float, float]:
    """Return how uneven the bead of a file is on a sound printer, and that of its mended form on a broken one."""
    original = plan(ADVANCED + text, printer, folder, extras=SHAPED)
    corrected = plan(ADVANCED + mended, printer, folder, extras=SHAPED, around=original)
    wanted, true = wanted_path(original), TruePrinter.of(corruption_toml(corruption), printer)
    sound = bead_deviation(original, Track(original, printer), wanted)
    return sound, bead_deviation(corrected, Track(corrected, printer, true), wanted)


def mend(source: Path, model: Path, output: Path, *more: str) -> dict:
    """Mend by the command line; return its report."""
    report = output.with_suffix(".report.json")
    command = [PRINTMEND, "mend", source, "-m", model, "-o", output, "--report", report, "--overwrite", "--force"]
    command += more
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False)  # noqa: S603 — our own program
    if done.returncode != 0:
        raise Refused(done.stderr.strip().splitlines()[-1] if done.stderr.strip() else f"ended with {done.returncode}")
    return json.loads(report.read_text())


def row(source: Path, family: str, options: argparse.Namespace, folder: Path) -> str:
    """Judge one file; return its line of the table."""
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
    top = b"M83\n" if any("put M83 at its top" in said for said in report["warnings"]) else b""
    before, after, complaints = both(top + text, top + output.read_bytes(), printer, corruption, folder / "run")
    longer = 100 * (after.job_s / before.job_s - 1)
    figures = [
        (f"{before.rms_mm:8.4f}", False), (f"{after.rms_mm:8.4f}", after.rms_mm > 0.012),
        (f"{after.max_mm:8.4f}", False),
        (f"{report['after']['rms_mm']:8.4f}", False), (f"{before.job_s:8.1f}", False), (f"{longer:7.2f}", longer > 1.0),
        (f"{before.stops:6}", False), (f"{after.stops:6}", after.stops > 1.1 * before.stops + 1),
        (f"{before.corners:6}", False), (f"{after.corners:6}", after.corners > 1.1 * before.corners + 1),
        (f"{after.moves / max(before.moves, 1):6.2f}", False),
    ]  # fmt: skip
    if options.bead:
        sound, bent = beads(top + text, top + output.read_bytes(), printer, corruption, folder / "run")
        figures += [(f"{sound:7.3f}", False), (f"{bent:7.3f}", bent > 1.1 * sound)]
    line = "".join(text + ("*" if missed else " ") for text, missed in figures)
    return line + f" {source.name} ({family})" + (f"  COMPLAINS: {'; '.join(complaints)[:200]}" if complaints else "")


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--results", type=Path, metavar="FILE.jsonl")
    parser.add_argument("--crossing", type=float, metavar="MM_S2")
    parser.add_argument("--bead", action="store_true", help="judge the bead, too")
    options = parser.parse_args()
    known = {}
    if options.results is not None and options.results.exists():
        known = dict(json.loads(line) for line in options.results.read_text().splitlines())
    bead = "  sound  mended " if options.bead else ""
    print(f"  before    after      max  promise   time s  time %  stops   after corners  after  moves {bead} file")
    with tempfile.TemporaryDirectory() as name:
        for source, family in cases(options):
            key = " ".join(map(str, (source, family, options.severity, options.seed, options.moves, options.preset)))
            key += (" bead" if options.bead else "") + (f" {options.crossing:g}" if options.crossing else "")
            if key not in known:
                try:
                    known[key] = row(source, family, options, Path(name))
                except (PrintmendError, RefusedByPlanner, Refused) as error:
                    known[key] = f"  {type(error).__name__}: {str(error)[:150]}  {source.name}"
                if options.results is not None:
                    with options.results.open("a") as out:
                        print(json.dumps([key, known[key]]), file=out)
            print(known[key], flush=True)


if __name__ == "__main__":
    main()
