"""Measure how light the commands are: processor time, peak memory, and the instructions that a small computer counts.

    .venv/bin/python benchmarks/bench_light.py [--gcode part.gcode] [--megabytes 1.6 17 150] [--rows 5000 1000000]
        [--instructions] [--mhz 1500 --per-cycle 1.0]

Every command runs as an owner runs it, in a process of its own, twice; the second run counts, for the first one writes
Python's byte code. The model is learned from the dots of the test print of a simulated Ender-5 with pulleys and play on
both axes. With ``--instructions`` a third run counts instructions by `valgrind --tool=callgrind`, which takes a minute
for each command; files above 2 MB and traces above 5000 rows are left out. The seconds of a Pi 4 are these
instructions at its clock (``--mhz``), so many a cycle (``--per-cycle``): an estimate, not a measurement.
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench_mend import PROGRAM, timed
from bench_outside import part_gcode
from printmend.measure.table import write_trace
from printmend.path import Trace
from printmend.printer import read_printer
from printmend.probe import design_probe
from printmend.twin import Twin
from printmend_lab.sampling import sample

PRINTER = "ender5"
COUNTED_MB, COUNTED_ROWS = 2.0, 5000  # the most for which instructions are counted
_REFERENCES = re.compile(r"Collected : (\d+)")


@dataclass(frozen=True)
class Job:
    """A command, in words, with its arguments; ``counted`` where its instructions may be counted."""

    words: str
    arguments: tuple[str, ...]
    counted: bool = True


def dots(twin: Twin, rng: np.random.Generator) -> Trace:
    """Return the measured dots of the test print."""
    printer = read_printer(PRINTER)
    plan = design_probe(printer)
    path = np.concatenate([np.array(printer.home_mm)[None], plan.waypoints_mm])
    measured = np.full_like(path, np.nan)
    measured[1 + plan.rows] = twin.follow(path)[1 + plan.rows] + rng.normal(0.0, 0.02, (len(plan.rows), 2))
    return Trace(path, measured, homed=True)


def walk(twin: Twin, rng: np.random.Generator, count: int) -> Trace:
    """Return a measured walk of so many way-points in the middle of the bed."""
    wide = 100.0
    way = 60.0 + np.abs(np.cumsum(rng.normal(0.0, 2.0, (count, 2)), axis=0) % (2 * wide) - wide)
    path = np.concatenate([np.array(read_printer(PRINTER).home_mm)[None], np.round(way, 3)])
    return Trace(path, twin.follow(path) + rng.normal(0.0, 0.02, path.shape), homed=True)


def jobs(folder: Path, gcode: Path | None, megabytes: list[float], rows: list[int]) -> list[Job]:
    """Write what the commands read, and return them."""
    rng, printer = np.random.default_rng(1), read_printer(PRINTER)
    twin = Twin.of(sample("pulley-play", rng, "realistic"), printer)
    model, trace = folder / "printer.mend.json", folder / "dots.csv"
    write_trace(trace, dots(twin, rng))
    learn = ("--printer", PRINTER, "-o")
    found = [Job("learn, the test print's dots", ("learn", str(trace), *learn, str(model)))]
    for count in rows:
        path = folder / f"{count}.csv"
        write_trace(path, walk(twin, rng, count))
        found.append(
            Job(f"learn, {count} rows", ("learn", str(path), *learn, f"{path}.mend.json"), count <= COUNTED_ROWS)
        )
    body = part_gcode(rng, printer.x.length_mm).encode() if gcode is None else gcode.read_bytes()
    for size in megabytes:
        path = folder / f"{size:g}.gcode"
        path.write_bytes(body * max(1, round(size * 1e6 / len(body))))
        words, used = f"{path.stat().st_size / 1e6:.1f} MB", ("-m", str(model))
        written = ("-o", f"{path}.mended", "--force", "--overwrite")
        found.append(Job(f"mend, {words}", ("mend", str(path), *used, *written), size <= COUNTED_MB))
        if size <= COUNTED_MB:
            found.append(Job(f"check, {words}", ("check", str(path), *used)))
    return found


def instructions(job: Job) -> int:
    """Return how many instructions a command takes, in user mode."""
    valgrind = shutil.which("valgrind")
    if valgrind is None:
        raise SystemExit("--instructions needs valgrind on the path")
    with tempfile.TemporaryDirectory() as name:
        command = [valgrind, "--tool=callgrind", f"--callgrind-out-file={name}/out", sys.executable, "-m", "printmend"]
        done = subprocess.run([*command, *job.arguments], capture_output=True, text=True, check=True)  # noqa: S603
    counted = _REFERENCES.search(done.stderr)
    assert counted is not None
    return int(counted[1])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--gcode", type=Path, help="a sliced file for a 220 mm bed that homes; it is repeated")
    parser.add_argument("--megabytes", type=float, nargs="*", default=[1.6, 17.0, 150.0])
    parser.add_argument("--rows", type=int, nargs="*", default=[5000, 1_000_000])
    parser.add_argument("--instructions", action="store_true")
    parser.add_argument("--mhz", type=float, default=1500.0)
    parser.add_argument("--per-cycle", type=float, default=1.0)
    options = parser.parse_args()
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    with tempfile.TemporaryDirectory() as name:
        for job in jobs(Path(name), options.gcode, options.megabytes, options.rows):
            timed([PROGRAM, *job.arguments])
            wall_s, usage = timed([PROGRAM, *job.arguments])
            said = f"{job.words:30} {usage.ru_utime + usage.ru_stime:6.2f} s of the processor, {wall_s:6.2f} s by the "
            said += f"clock, {usage.ru_maxrss / 1024:5.0f} MiB"
            if options.instructions and job.counted:
                count = instructions(job)
                pi_s = count / (options.mhz * 1e6 * options.per_cycle)
                said += f", {count / 1e9:.2f} G instructions: some {pi_s:.1f} s on a Pi 4"
            print(said, flush=True)


if __name__ == "__main__":
    main()
