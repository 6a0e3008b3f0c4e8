"""Measure mending: accuracy and growth by family of faults, time and memory of the whole command.

    .venv/bin/python benchmarks/bench_mend.py accuracy [--preset ender3] [--severity damaged] [--seeds 3]
    .venv/bin/python benchmarks/bench_mend.py speed [--gcode part.gcode] [--megabytes 16 150]
    .venv/bin/python benchmarks/bench_mend.py promise [--gcode part.gcode] [--megabytes 0 1 16]
    .venv/bin/python benchmarks/bench_mend.py stages [--gcode part.gcode] [--megabytes 16]

`accuracy` mends a two-layer part with the exact fault known and has both files judged by `mend.against`, which reads
them again and shares nothing with the planner. `speed` repeats a sliced file until it has the size asked for, runs the
command twice (the first fills the cache) and reports wall time, processor time, memory and the error reached.
`stages` says what of the processor time is for reading, planning and writing, each of which has a thread of its own.
`promise` says what of the processor time of mending a file, the start of the program left out, is for the promise.
"""

import argparse
import math
import os
import resource
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from bench_outside import part_gcode
from printmend.errors import RefusedError
from printmend.gcode import kernels
from printmend.learn.learned import learn_model
from printmend.mend import mend, mend_gcode
from printmend.mend.against import judged
from printmend.mend.prediction import Prediction, with_doubt
from printmend.model import SavedModel, exact_model, write_model
from printmend.plan import inverse
from printmend.printer import read_printer
from printmend.probe.probe import design_probe, write_probe
from printmend.twin import Twin
from printmend.twin.gcode import print_gcode
from printmend_lab.sampling import families, sample

PROGRAM = str(Path(sys.executable).parent / "printmend")


def accuracy(preset: str, severity: str, seeds: int) -> None:
    printer = read_printer(preset)
    print(f"{preset}, {severity}: contour error [mm]")
    print("family             before RMS  after RMS  after max  moves  refused")
    with tempfile.TemporaryDirectory() as name:
        source, output = Path(name) / "part.gcode", Path(name) / "out.gcode"
        for family in families():
            if family == "gain-table":  # knows only the lattice
                continue
            rows, refused = [], 0
            for seed in range(seeds):
                rng = np.random.default_rng([seed, *family.encode()])
                source.write_text(part_gcode(rng, printer.x.length_mm))
                model = exact_model(sample(family, rng, severity).lower(printer))  # type: ignore[arg-type]
                try:
                    done = mend_gcode(source, model, output)
                except RefusedError:
                    refused += 1
                    continue
                found = judged(done.prediction, str(source), str(output), model.mechanism)
                growth = done.prediction.commands / done.prediction.moves
                rows.append((found.before.rms_mm, found.after.rms_mm, found.after.max_mm, growth))
            before, after, most, growth = np.mean(rows, axis=0) if rows else [np.nan] * 4
            print(
                f"{family:17} {before:11.4f} {after:10.4f} {most:10.4f} {growth:6.2f} {refused:4}/{seeds}", flush=True
            )


def speed(gcode: Path, megabytes: list[int]) -> None:
    printer = read_printer("ender5")
    body = gcode.read_bytes()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        model = folder / "printer.mend.json"
        write_model(model, exact_model(sample("pulley-play", np.random.default_rng(1), "realistic").lower(printer)))
        for size in megabytes:
            source, output = folder / "part.gcode", folder / "out.gcode"
            with source.open("wb") as file:
                while file.tell() < size * 1_000_000:
                    file.write(body)
            command = [PROGRAM, "mend", str(source), "-m", str(model), "-o", str(output), "--force", "--overwrite"]
            for _ in range(2):
                wall_s, usage = timed(command)
            total = source.stat().st_size / 1e6
            processor_s = usage.ru_utime + usage.ru_stime
            print(
                f"{total:6.1f} MB in {wall_s:5.2f} s wall, {processor_s:5.2f} s processor: {total / wall_s:5.1f} MB/s, "
                f"{usage.ru_maxrss / 1024:4.0f} MiB, output {output.stat().st_size / 1e6:.1f} MB",
                flush=True,
            )


def promise(gcode: Path, megabytes: list[int]) -> None:
    """Learn a model from a measured print, which has a budget of doubt, and mend with it."""
    printer = read_printer("ender5")
    fault = sample("pulley-play", np.random.default_rng(1), "realistic")
    body, spent = gcode.read_bytes(), []

    def counted(planned: Prediction, model: SavedModel) -> Prediction:
        began = time.process_time()
        found = with_doubt(planned, model)
        spent.append(time.process_time() - began)
        return found

    mend.with_doubt = counted
    with tempfile.TemporaryDirectory() as name:
        source, output = Path(name) / "part.gcode", Path(name) / "out.gcode"
        write_probe(source, design_probe(printer))
        model = learn_model(print_gcode(source, Twin.of(fault, printer), noise_mm=0.05), printer)
        for size in megabytes:
            source.write_bytes(body * max(1, math.ceil(size * 1_000_000 / len(body))))
            runs = []
            for _ in range(6):
                began = time.process_time()
                said = mend.mend_gcode(source, model, output, force=True).prediction.after
                runs.append((time.process_time() - began, spent[-1]))
            whole, mine = np.min(runs[1:], axis=0)
            print(
                f"{source.stat().st_size / 1e6:6.2f} MB: {whole:.3f} s of the processor, {mine:.3f} s of it for the "
                f"promise, {100 * mine / (whole - mine):.0f} % more; promised {said.rms_mm:.4f} mm, "
                f"{said.rms_low_mm:.4f}–{said.rms_high_mm:.4f}",
                flush=True,
            )


def stages(gcode: Path, megabytes: list[int]) -> None:
    spent: Counter[str] = Counter()

    def counted(name: str, kernel: Callable) -> Callable:
        def run(*arguments: object) -> object:
            began = time.thread_time()
            try:
                return kernel(*arguments)
            finally:
                spent[name] += time.thread_time() - began

        return run

    kernels.interpret = counted("reading", kernels.interpret)
    kernels.emit = counted("writing", kernels.emit)
    inverse.mend = counted("planning", inverse.mend)
    model = exact_model(sample("pulley-play", np.random.default_rng(1), "realistic").lower(read_printer("ender5")))
    text = gcode.read_bytes()
    with tempfile.TemporaryDirectory() as name:
        for size in megabytes:
            source = Path(name) / "part.gcode"
            source.write_bytes(text * max(1, round(size * 1e6 / len(text))))
            for turn in range(2):  # the first compiles
                spent.clear()
                began = time.process_time()
                mend_gcode(source, model, Path(name) / f"{size}-{turn}.gcode", force=True)
                total = time.process_time() - began
            shares = ", ".join(f"{stage} {taken:.2f} s" for stage, taken in spent.items())
            print(f"{source.stat().st_size / 1e6:.1f} MB: {total:.2f} s of processor time: {shares}")


def timed(command: list[str]) -> tuple[float, resource.struct_rusage]:
    """Run a command; return its wall time and what it used."""
    began = time.perf_counter()
    silent = [(os.POSIX_SPAWN_OPEN, 1, os.devnull, os.O_WRONLY, 0)]
    process = os.posix_spawn(command[0], command, os.environ, file_actions=silent)
    _, status, usage = os.wait4(process, 0)
    if status:
        raise SystemExit(f"{' '.join(command)} ended with {os.waitstatus_to_exitcode(status)}")
    return time.perf_counter() - began, usage


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["accuracy", "speed", "promise", "stages"])
    parser.add_argument("--preset", default="ender3")
    parser.add_argument("--severity", choices=["damaged", "realistic"], default="damaged")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--gcode", type=Path, help="a sliced file for a 220 mm bed that homes")
    parser.add_argument("--megabytes", type=int, nargs="+", default=[16, 150])
    options = parser.parse_args()
    if options.what == "accuracy":
        accuracy(options.preset, options.severity, options.seeds)
        return
    with tempfile.TemporaryDirectory() as name:
        gcode = options.gcode
        if gcode is None:
            gcode = Path(name) / "part.gcode"
            gcode.write_text(part_gcode(np.random.default_rng(1), 220.0))
        {"speed": speed, "promise": promise, "stages": stages}[options.what](gcode, options.megabytes)


if __name__ == "__main__":
    main()
