"""What the scripts of this folder share: options, cases on several cores, rows that are kept.

    options = options_of(__doc__, seed=1, printers=3, noise_mm=0.05, preset=("ender3", "corexy"))
    for case, row in rows_of(judged, cases, options):
        print(…)

A case is a tuple of plain values. ``judged(options, case)``, a function of the script's top level, returns its row, a
dict of plain values. Every script then takes --seed, --workers and --rows FILE.csv. The file's first line names the
command, the seed and the commit; a run that was stopped goes on where it was.
"""

import argparse
import csv
import json
import shlex
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from printmend.cli.terminal import progress
from printmend.files import replacing
from printmend_lab.executor import WorkerDied, executor

Case = tuple[Any, ...]
Row = dict[str, Any]
PRINTMEND = str(Path(sys.executable).parent / "printmend")


def parser_of(doc: str | None, *, seed: int = 1, **defaults: Any) -> argparse.ArgumentParser:
    """Return the options of a script: a number or text by its default, a switch for False, any of a tuple of texts."""
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=seed)
    parser.add_argument("--workers", type=int, default=1, help="cores to work on")
    parser.add_argument("--rows", type=Path, metavar="FILE.csv", help="keep each row, and go on from there")
    for name, default in defaults.items():
        option = "--" + name.replace("_", "-")
        if default is False:
            parser.add_argument(option, action="store_true")
        elif isinstance(default, tuple):
            parser.add_argument(option, choices=default, action="append")
        else:
            parser.add_argument(option, type=type(default), default=default)
    parser.set_defaults(every={name: default for name, default in defaults.items() if isinstance(default, tuple)})
    return parser


def options_of(doc: str | None, *, seed: int = 1, **defaults: Any) -> argparse.Namespace:
    """Parse the command line; of a tuple of texts all count where none is named."""
    return parsed(parser_of(doc, seed=seed, **defaults))


def parsed(parser: argparse.ArgumentParser) -> argparse.Namespace:
    """Parse the command line of a parser that has more options."""
    options = parser.parse_args()
    for name, every in options.every.items():
        setattr(options, name, getattr(options, name) or list(every))
    return options


def rows_of(
    work: Callable[[argparse.Namespace, Case], Row], cases: Iterable[Case], options: argparse.Namespace
) -> Iterator[tuple[Case, Row]]:
    """Yield each case with its row, in the order of the cases."""
    asked = list(cases)
    kept = _kept(options)
    todo = iter([case for case in asked if _key(case) not in kept])
    with progress(Path(sys.argv[0]).stem, len(asked)) as tick:
        found = executor(options.workers).map(partial(work, options), todo)
        for case in asked:
            while _key(case) not in kept:
                done, row = next(found)
                if isinstance(row, WorkerDied):
                    raise SystemExit(f"{done}: {row.reason}")
                kept[_key(done)] = row
                _keep(options, done, row)
            tick(" ".join(map(str, case)))
            yield case, kept[_key(case)]


def run(*arguments: str, ok: tuple[int, ...] = (0,)) -> subprocess.CompletedProcess[str]:
    """Run printmend as a user does; end with what it says where it fails."""
    done = subprocess.run([PRINTMEND, *arguments], capture_output=True, text=True, check=False)  # noqa: S603 — our own program
    if done.returncode not in ok:
        raise SystemExit(f"printmend {' '.join(arguments)} ended with {done.returncode}: {done.stderr}")
    return done


def write_results(path: Path, about: str, rows: Sequence[Row]) -> None:
    """Write a table for `benchmarks/results`: what it is, the command, the commit, and a line a row."""
    script = Path(sys.argv[0])
    words = ["-m", f"benchmarks.{script.stem}"] if script.is_absolute() else [str(script)]  # so Python gives modules
    with replacing(path) as file:
        command = shlex.join([".venv/bin/python", *words, *sys.argv[1:]])
        file.write(f"# {about}\n# command: {command}\n# commit: {commit_now()}\n")
        table = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        table.writeheader()
        table.writerows(rows)


def commit_now() -> str:
    """Return the commit of this code, marked where it was changed since."""
    return subprocess.run(  # noqa: S603 — a fixed command
        ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty"],  # noqa: S607
        capture_output=True, text=True, check=False,
    ).stdout.strip()  # fmt: skip


def _key(case: Case) -> str:
    return json.dumps(case)


def _head(options: argparse.Namespace) -> str:
    """Return what made a file of rows: the command without the options that change no row, the seed, and the commit."""
    words = [Path(sys.argv[0]).name, *sys.argv[1:]]
    for option in ("--rows", "--workers", "--figure"):
        while option in words:
            at = words.index(option)
            del words[at : at + 2]
    return f"# {shlex.join(words)}; seed {options.seed}; commit {commit_now() or 'unknown'}"


def _kept(options: argparse.Namespace) -> dict[str, Row]:
    """Return the rows that a file has already, by case; a last row that was cut short is made again."""
    if options.rows is None or not options.rows.exists():
        return {}
    text = options.rows.read_text(encoding="utf-8")
    if not text.endswith("\n"):
        text = text[: text.rfind("\n") + 1]
        options.rows.write_text(text, encoding="utf-8")
    head, *lines = text.splitlines()
    if head != _head(options):
        raise SystemExit(f"{options.rows}: made by another command, seed or commit ({head[2:]}); name another file")
    names, *rows = csv.reader(lines)
    return {row[0]: {name: json.loads(cell) for name, cell in zip(names[1:], row[1:], strict=True)} for row in rows}


def _keep(options: argparse.Namespace, case: Case, row: Row) -> None:
    """Add a row to the file of rows."""
    if options.rows is None:
        return
    is_new = not options.rows.exists()
    with options.rows.open("a", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        if is_new:
            file.write(_head(options) + "\n")
            table.writerow(["case", *row])
        table.writerow(
            [_key(case), *(json.dumps(value, default=lambda number: number.item()) for value in row.values())]
        )
