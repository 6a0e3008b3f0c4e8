"""The files, faults and printers that Klipper's planner is asked about: what the benchmarks that ask it share."""

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from printmend.corruption import Corruption
from printmend.gcode.container import open_gcode
from printmend.gcode.read import Moves, read_gcode
from printmend.printer import Printer
from printmend_lab.sampling import sample


def arguments(description: str) -> argparse.ArgumentParser:
    """Return a parser of what names the cases; `cases` and `drawn` read it."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sources", type=Path, nargs="+", help="files, or folders of them")
    parser.add_argument("--preset", default="ender3")
    parser.add_argument("--family", default="pulley-play", help="one, or several with commas; FAMILY+screw")
    parser.add_argument("--severity", choices=["damaged", "realistic"], default="damaged")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--moves", type=int, default=10**9, help="a larger file ends after so many extruding ones")
    return parser


def cases(options: argparse.Namespace) -> Iterator[tuple[Path, str]]:
    """Yield each file with its family of faults: of several they take turns."""
    families = options.family.split(",")
    files = [p for source in options.sources for p in (sorted(source.rglob("*")) if source.is_dir() else [source])]
    for i, source in enumerate(path for path in files if path.is_file()):
        yield source, families[i % len(families)]


def drawn(family: str, options: argparse.Namespace) -> Corruption:
    """Return the fault that the seed draws of a family; FAMILY+screw has a bad Z screw, too."""
    faults = [
        sample(name, np.random.default_rng([options.seed, *name.encode()]), options.severity)
        for name in family.split("+")
    ]
    return faults[0] if len(faults) == 1 else replace(faults[0], screw=faults[1].screw)


def text_of(source: Path, printer: Printer, options: argparse.Namespace) -> bytes:
    """Return the G-code of a file, or as much of it as is asked about."""
    with open_gcode(source) as file:
        text = b"".join(bytes(chunk) for chunk in file.parts[0].chunks())
    return beginning(text, read_gcode(text, printer=printer).moves, options.moves)


def beginning(text: bytes, moves: Moves, most: int) -> bytes:
    """Return the lines of a file before its extruding move number ``most``; all of them where it has fewer."""
    extruding = np.flatnonzero(moves.extruding)
    if len(extruding) <= most:
        return text
    return b"".join(text.splitlines(keepends=True)[: int(moves.line[extruding[most]])])
