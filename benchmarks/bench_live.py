"""Judge Klipper's live transform against files that were mended beforehand: error, stops and time in Klipper's planner.

    make hosts
    .venv/bin/python benchmarks/bench_live.py [--families screw,frame] [--seed 5] [--arcs]

One part, of each family a fault on a cartesian printer and on a CoreXY. Columns: distance of the plastic from the
wanted path as it is (RMS, mm), mended by `printmend mend` and mended live (RMS, largest, and in height), places where
the nozzle stops while it prints, and the job's time, live ÷ mended. With --arcs the part has G2 and G3, which Klipper
cuts into chords of 1 mm before the live transform sees them.
* misses an aim: error 1.02 times, one stop more, 1.005 times as long.
"""

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "integrations" / "tests"))
from parts import part

from klippy_judge import Judged, judge_both
from klippy_run import plan
from printmend.corruption import Corruption, corruption_toml
from printmend.errors import RefusedError
from printmend.mend import mend_gcode
from printmend.model.model import exact_model, write_model
from printmend.printer import Printer, read_printer
from printmend_lab.sampling import sample
from true_printer import TruePrinter

FAMILIES = "pulley,play,pulley-play,pulley-loose,elastic,set-screw,ripple,frame,screw,everything"
PRINTERS = ("ender3", "corexy")
WALLS = b";TYPE:Outer wall\n"  # as which the live transform draws all lines: no comments come to it
BUSY = b"M106 S100\nM204 S800\n"


def drawn(family: str, seed: int = 5) -> Corruption:
    """Return the fault that a seed draws of a family."""
    return sample(family, np.random.default_rng([seed, *family.encode()]), "realistic")


def compare(
    corruption: Corruption, printer: Printer, folder: Path, *, arcs: bool
) -> tuple[Judged, Judged, Judged, tuple[str, ...]]:
    """Judge a part on a broken printer: as it is, mended beforehand, mended live; and complaints about the last.

    Raises `RefusedError` where mending does not help.
    """
    model = exact_model(corruption.lower(printer))
    write_model(path := folder / "printer.mend.json", model)
    text = WALLS + part(1, arcs=arcs) + BUSY + part(1).replace(b"G28\n", b"")
    (source := folder / "part.gcode").write_bytes(text)
    mend_gcode(source, model, output := folder / "mended.gcode")
    original = plan(text, printer, folder / "a")
    offline = plan(output.read_bytes(), printer, folder / "b", around=original)
    live = plan(text, printer, folder / "c", around=original, extras=f"[printmend]\nmodel: {path}\n")
    true = TruePrinter.of(corruption_toml(corruption), printer)
    _, mended, _ = judge_both(original, offline, printer, true, text, output.read_bytes())
    before, after, complaints = judge_both(original, live, printer, true, text, text)
    return before, mended, after, complaints


def in_words(before: Judged, mended: Judged, live: Judged) -> str:
    """Return a line of the table."""
    times = live.job_s / mended.job_s
    figures = [
        (f"{before.rms_mm:7.4f}", False), (f"{mended.rms_mm:7.4f}", False),
        (f"{live.rms_mm:7.4f}", live.rms_mm > 1.02 * mended.rms_mm), (f"{mended.max_mm:7.4f}", False),
        (f"{live.max_mm:7.4f}", False), (f"{mended.height_max_mm:7.4f}", False), (f"{live.height_max_mm:7.4f}", False),
        (f"{mended.stops:5}", False), (f"{live.stops:5}", live.stops > mended.stops), (f"{times:7.4f}", times > 1.005),
    ]  # fmt: skip
    return "".join(text + ("*" if missed else " ") for text, missed in figures)


def main() -> None:
    """Print a line for each family and printer."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--families", default=FAMILIES)
    parser.add_argument("--seed", type=int, default=5)
    parser.add_argument("--arcs", action="store_true")
    options = parser.parse_args()
    print(" before  mended    live  mended    live  height    live stops  live    time")
    for preset in PRINTERS:
        for family in options.families.split(","):
            with tempfile.TemporaryDirectory() as folder:
                fault, printer = drawn(family, options.seed), read_printer(preset)
                try:
                    before, mended, live, said = compare(fault, printer, Path(folder), arcs=options.arcs)
                except RefusedError as error:
                    print(f"  nothing to mend: {error}  {family}, {preset}", flush=True)
                    continue
            print(in_words(before, mended, live), f"{family}, {preset}", *said, flush=True)


if __name__ == "__main__":
    main()
