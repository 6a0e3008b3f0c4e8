"""Read G-code with LinuxCNC's interpreter and compare: arcs, planes, offsets and units as another program takes them.

    make hosts
    .venv/bin/python benchmarks/bench_rs274.py ../shared/corpus/gcode

Both readers get the lines that both know (G0–G3, G17–G21, G90–G92; filament and M-codes left out). For each file: the
motions, the arcs among them, and the largest difference of an end or a centre [mm]. `rs274` prints four decimals.
"""

import argparse
import os
import re
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from klippy_run import HOSTS
from printmend.errors import PrintmendError
from printmend.gcode.container import open_gcode
from printmend.gcode.kernels import KIND_CCW, KIND_LINEAR
from printmend.gcode.read import read_gcode

_WORD = re.compile(r"([A-Za-z])\s*([-+]?(?:\d+\.?\d*|\.\d+))")
_CALL = re.compile(r"([A-Z_0-9]+)\(([^)]*)\)")
_KNOWN = {0, 1, 2, 3, 17, 18, 19, 20, 21, 90, 91, 92}
_INCH_MM = 25.4


class RefusedByInterpreter(Exception):
    """LinuxCNC does not take the file; the text is its reason."""


@dataclass(frozen=True, eq=False)
class Reading:
    """Motions in their order: ``end_mm`` [M, 3]; ``way`` [M] 0 straight, 1 anticlockwise, −1 clockwise, with the full
    turns; ``center_mm`` [M, 2] in the axes' order of the plane (x y, z x, y z), NaN for straight moves."""

    end_mm: np.ndarray
    way: np.ndarray
    center_mm: np.ndarray


def plain(text: str) -> str:
    """Return what both readers know of a program."""
    lines = ["G21 G90 G17", "F600"]
    for line in text.splitlines():
        words = _WORD.findall(re.sub(r"\([^)]*\)", "", line.split(";")[0].split("*")[0]))
        if words and words[0][0] in "Nn":
            words = words[1:]
        if not words or words[0][0] not in "Gg" or any(
            letter in "Gg" and float(number) not in _KNOWN for letter, number in words
        ):  # fmt: skip
            continue
        kept = [letter.upper() + number for letter, number in words if letter.upper() in "GXYZIJKRP"]
        axes = any(word[0] in "XYZIJKR" for word in kept)
        if axes or not {float(word[1:]) for word in kept if word[0] == "G"} & {0, 1, 2, 3, 92}:
            lines.append(" ".join(kept))
    return "\n".join(lines) + "\n"


def interpreted(text: str, folder: Path) -> Reading:
    """Read a program as `plain` gives it with LinuxCNC's rs274, in machine millimetres."""
    root = HOSTS / "linuxcnc"
    if not (root / "usr/bin/rs274").exists():
        raise FileNotFoundError("LinuxCNC's interpreter is not there: run `make hosts`")
    for name, content in (("in.ngc", text + "M2\n"), ("tool.tbl", "T1 P1 D0.1\n"), ("any.var", "")):
        (folder / name).write_text(content)
    libraries = os.pathsep.join(map(str, (root / "usr/lib", *root.glob("usr/lib/*-linux-gnu"))))
    done = subprocess.run(  # noqa: S603 — the program that `make hosts` unpacked
        [str(root / "usr/bin/rs274"), "-g", "-t", "tool.tbl", "-v", "any.var", "in.ngc"],
        capture_output=True, text=True, check=False, cwd=folder, timeout=600,
        env={"PATH": os.defpath, "LD_LIBRARY_PATH": libraries},
    )  # fmt: skip
    if "PROGRAM_END" not in done.stdout:
        reason = [line for line in done.stderr.splitlines() if line.strip() != "executing"]
        raise RefusedByInterpreter(" · ".join(reason)[:200] or f"ended with {done.returncode}")
    return _reading(done.stdout)


def _reading(calls: str) -> Reading:
    unit, plane, offset_mm = 1.0, 0, np.zeros(3)
    at_mm, rows = np.zeros(3), []
    for name, values in _CALL.findall(calls):
        if name == "USE_LENGTH_UNITS":
            unit = _INCH_MM if values.endswith("INCHES") else 1.0
        elif name == "SELECT_PLANE":
            plane = {"XY": 0, "XZ": 1, "YZ": 2}[values[-2:]]
        elif name == "SET_G92_OFFSET":
            offset_mm = unit * np.array(values.split(",")[:3], float)
        elif name in ("STRAIGHT_TRAVERSE", "STRAIGHT_FEED"):
            at_mm = unit * np.array(values.split(",")[:3], float) + offset_mm
            rows.append((at_mm, 0, (np.nan, np.nan)))
        elif name == "ARC_FEED":
            first, second, center1, center2, turns, along = map(float, values.split(",")[:6])
            axes = ((0, 1, 2), (2, 0, 1), (1, 2, 0))[plane]
            at_mm = np.empty(3)
            at_mm[list(axes)] = unit * np.array([first, second, along])
            at_mm += offset_mm
            center = unit * np.array([center1, center2]) + offset_mm[list(axes[:2])]
            rows.append((at_mm, int(turns), tuple(center)))
    end, way, center = zip(*rows, strict=True) if rows else ((), (), ())
    return Reading(np.array(end).reshape(-1, 3), np.array(way, int), np.array(center).reshape(-1, 2))


def ours(text: str) -> Reading:
    """Read the same with printmend."""
    moves = read_gcode(text.encode()).moves
    sign = np.where(moves.kind == KIND_LINEAR, 0, np.where(moves.kind == KIND_CCW, 1, -1))
    return Reading(moves.end_mm, sign * (moves.turns + 1), moves.center_mm)


def difference_mm(one: Reading, other: Reading) -> tuple[float, int, int]:
    """Return the largest difference of two readings, and how many motions and arcs were compared.

    Straight moves that go nowhere are left out. Readings of different shape are infinitely different.
    """
    kept = []
    for reading in (one, other):
        start = np.concatenate([np.zeros((1, 3)), reading.end_mm[:-1]])
        moves = (np.abs(reading.end_mm - start).max(axis=1, initial=0.0) > 1e-3) | (reading.way != 0)
        kept.append(Reading(reading.end_mm[moves], reading.way[moves], reading.center_mm[moves]))
    a, b = kept
    if len(a.way) != len(b.way) or not np.array_equal(a.way, b.way):
        return float("inf"), len(a.way), int((a.way != 0).sum())
    off = max(np.abs(a.end_mm - b.end_mm).max(initial=0.0), np.nanmax(np.abs(a.center_mm - b.center_mm), initial=0.0))
    return float(off), len(a.way), int((a.way != 0).sum())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sources", type=Path, nargs="+", help="files, or folders of them")
    options = parser.parse_args()
    files = [p for source in options.sources for p in (sorted(source.rglob("*")) if source.is_dir() else [source])]
    print(" motions    arcs  difference mm  file")
    with tempfile.TemporaryDirectory() as name:
        for source in (path for path in files if path.is_file()):
            try:
                with open_gcode(source) as file:
                    text = b"".join(bytes(chunk) for chunk in file.parts[0].chunks()).decode("latin-1")
                common = plain(text)
                off, motions, arcs = difference_mm(ours(common), interpreted(common, Path(name)))
                line = f"{motions:8} {arcs:7} {off:14.4f}"
            except (PrintmendError, RefusedByInterpreter) as error:
                line = f"  {type(error).__name__}: {str(error)[:150]}"
            print(f"{line}  {source.name}", flush=True)


if __name__ == "__main__":
    sys.exit(main())
