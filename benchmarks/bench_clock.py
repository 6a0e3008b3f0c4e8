"""Hold the clock against Klipper's own planner: seconds of files as they are and mended, and what the clock costs.

    make hosts
    .venv/bin/python benchmarks/bench_clock.py ../shared/corpus/gcode --moves 20000 --family pulley-play
    .venv/bin/python benchmarks/bench_clock.py ../shared/corpus/gcode --slicer

Each file is mended with the exact model of a drawn fault; both files go through Kalico's Klippy and through the clock,
with the same limits. Columns: seconds by Klippy and by how much the clock is off [%], of the file as it is and mended;
by how much mending makes it longer [%], by Klippy and by the clock; processor time of the clock for a million moves.
Nothing is heated. A second G28 is driven by Klippy, and not counted by the clock. * is off by more than 1 %. Files of
less than a second are left out, and those of which Klippy does not understand all moves (lines without G1, a mill's).

With --slicer each whole file is held against its slicer's own estimate instead, where that stands in it together with
the limits of the machine: PrusaSlicer and its kin reckon as Marlin plans, Cura likewise.
"""

import argparse
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from bench_corpus import around
from klippy_cases import arguments, cases, drawn, text_of
from klippy_run import FAST, Planned, RefusedByPlanner, plan
from printmend.clock import Limits, klipper, limits_of, start_clock
from printmend.errors import PrintmendError
from printmend.gcode.container import open_gcode
from printmend.gcode.kernels import PIECE
from printmend.gcode.read import Program, read_gcode, starting_state, straightened
from printmend.gcode.write import Planned as Part
from printmend.gcode.write import follow
from printmend.mend import mend_gcode
from printmend.model import exact_model
from printmend.printer import Printer, read_printer
from printmend.studio.scene import slicer_s

_LEAST_S = 1.0  # of a file that is asked about
_SAME_SHARE = 0.01  # by which two lengths of one path may differ: travels to home, chords of arcs
LIMITS = replace(klipper(*FAST, 25.0, 300.0), arc_mm=0.1)
"""As `klippy_run.config` sets them."""


def clocked(path: Path, printer: Printer, limits: Limits = LIMITS) -> tuple[float, float]:
    """Return how long a file takes by the clock [s], and the processor time of that [s]."""
    clock, spent_s = start_clock(limits), 0.0

    def look(planned: Part) -> None:
        nonlocal spent_s
        began = time.thread_time()
        clock.advance(planned, mended=False)
        spent_s += time.thread_time() - began

    with open_gcode(path) as file:
        part = file.parts[0]
        follow(part.chunks(), starting_state(part, printer=printer), _as_it_is, look=look)
    clock.finish()
    return clock.seconds, spent_s


def _as_it_is(records: np.ndarray, begin: int) -> tuple[int, np.ndarray, np.ndarray]:
    return len(records), np.zeros(len(records) + 1, np.int64), np.empty(0, PIECE)


def row(source: Path, family: str, options: argparse.Namespace, folder: Path) -> tuple[str, float] | None:
    """Return a file's line of the table, and by how much the clock is off at the most [%]; None for one too short."""
    printer = read_printer(options.preset)
    plain, output = folder / "part.gcode", folder / "out.gcode"
    # Klippy's time ends with the last move, also where the file waits after it: so the last thing is a move.
    plain.write_bytes(text_of(source, printer, options) + b"\nM83\nG1 E0.01 F600\n")
    printer = around(printer, read_gcode(plain, printer=printer).moves)
    model = exact_model(drawn(family, options).lower(printer))  # type: ignore[arg-type] — gain tables are no family here
    said = mend_gcode(plain, model, output, force=True).prediction.warnings
    # What `mend` says of a file that leaves M83 to a macro of its printer's, this printer has to be told.
    top = b"M83\n" if any("put M83 at its top" in each for each in said) else b""
    original = plan(top + plain.read_bytes(), printer, folder / "run")
    if original.job_s < _LEAST_S or _is_read_otherwise(original, read_gcode(top + plain.read_bytes(), printer=printer)):
        return None
    corrected = plan(top + output.read_bytes(), printer, folder / "run", around=original)
    figures, moves, spent_s = [], 0, 0.0
    for path, planned in ((plain, original), (output, corrected)):
        seconds, took_s = clocked(path, printer)
        figures.append((planned.job_s, seconds))
        moves, spent_s = moves + len(planned.moves), spent_s + took_s
    off = [100 * (ours / theirs - 1) for theirs, ours in figures]
    longer = [100 * (figures[1][side] / figures[0][side] - 1) for side in (0, 1)]
    line = "".join(
        f"{theirs:10.1f} {each:8.3f}{'*' if abs(each) > 1 else ' '}"
        for (theirs, _), each in zip(figures, off, strict=True)
    )
    line += f"{longer[0]:8.2f} {longer[1]:8.2f} {1e6 * spent_s / max(moves, 1):9.2f}  {source.name} ({family})"
    return line, max(map(abs, off))


def _is_read_otherwise(planned: Planned, program: Program) -> bool:
    """Say whether Klippy's path has another length than the file's."""
    moves = straightened(program.moves, 0.01)
    lengths = [
        float(np.linalg.norm((ends - starts)[:, :2], axis=1).sum())
        for starts, ends in ((planned.start_mm, planned.end_mm), (moves.start_mm, moves.end_mm))
    ]
    return abs(lengths[0] - lengths[1]) > _SAME_SHARE * lengths[1]


def slicer_row(source: Path, printer: Printer) -> tuple[str, float] | None:
    """Return the line of a file whose slicer says how long it takes, and by how much the clock is off [%]."""
    with open_gcode(source) as file:
        part = file.parts[0]
        told_s, limits = slicer_s(*part.hints()), limits_of(part.flavour(), part.hints())
    if told_s is None or limits.said == Limits().said:
        return None
    seconds, _ = clocked(source, printer, limits)
    if seconds < _LEAST_S:
        return None
    off = 100 * (seconds / told_s - 1)
    return f"{told_s:10.0f} {seconds:10.0f} {off:8.2f}  {source.name} ({limits.firmware})", off


def beside_slicers(options: argparse.Namespace) -> None:
    """Print the table of --slicer."""
    print("  slicer s    clock s    off %  file")
    off: list[float] = []
    for source, _ in cases(options):
        try:
            found = slicer_row(source, read_printer(options.preset))
        except PrintmendError:
            continue
        if found is not None:
            print(found[0], flush=True)
            off.append(found[1])
    if off:
        size = np.abs(off)
        print(f"{len(off)} files: off by {np.median(size):.2f} % in the median, {size.max():.1f} % at most")


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--slicer", action="store_true", help="hold the clock against the slicers' own estimates")
    options = parser.parse_args()
    if options.slicer:
        beside_slicers(options)
        return
    print("  Klippy s    off %   mended s    off %  longer %  clocked   s/1e6  file")
    worst: list[float] = []
    with tempfile.TemporaryDirectory() as name:
        for source, family in cases(options):
            try:
                found = row(source, family, options, Path(name))
            except (PrintmendError, RefusedByPlanner) as error:
                found = None
                print(f"  {type(error).__name__}: {str(error)[:150]}  {source.name}", flush=True)
            if found is not None:
                print(found[0], flush=True)
                worst.append(found[1])
    if worst:
        print(f"{len(worst)} files: off by at most {max(worst):.3f} %, in the median {np.median(worst):.4f} %")


if __name__ == "__main__":
    main()
