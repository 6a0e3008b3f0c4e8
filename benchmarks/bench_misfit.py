"""How often is a misfit found and named, and how often is one seen where there is none?

    .venv/bin/python benchmarks/bench_misfit.py --seed 1 --draws 6 --cost-mm 0.06 [--preset ender3] [--kind wear]

The traces are those of outside_misfit.py, which shares no code with printmend: a broken printer of a drawn family, the
marks of `printmend probe`, noise of 0.02 or 0.05 mm, and one misfit, scaled to move the points by --cost-mm about their
mean (0.06 is twice what costs a print 0.03 mm). A kind is *named* where `learn` says it, *found* where it says anything
beyond notes of places that were not seen (an idler is a part of the model: its fault counts); the row "none" counts
false alarms. Play of the guides is beside sound belts: so a CoreXY looks like a printer with a motor for each axis; on
such a one it is its belts' play and a part of the model. Seed 1 was tuned on; others were not.
"""

import argparse
import itertools
import sys
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
import outside_misfit as made
from printmend.errors import TraceError
from printmend.learn.learned import learn_model
from printmend.path import Trace
from printmend.printer import read_printer
from runner import options_of, rows_of, run

# what each misfit may be called: some look the same to whom does not see the machine
NAMES = {
    "linear": {"linear", "creep"}, "creep": {"creep", "linear"}, "set-screw-creep": {"creep", "linear"},
    "idler": {"second-period", "turn"}, "racking": {"racking", "rail-racking", "racking-across"},
    "halves": {"halves"}, "reversed": {"rows-reversed"}, "shuffled": {"rows-shuffled"},
    "shifted-1": {"rows-shifted"}, "shifted-3": {"rows-shifted"}, "half-shifted-1": {"rows-shifted"},
    "table-shifted-1": {"rows-shifted"}, "swapped": {"refused"}, "mirrored": {"refused"}, "inches": {"refused"},
    "turned-1": {"turned", "moved"}, "outliers-5": {"left-out"}, "outliers-20": {"left-out"}, "half-bed": {"unseen"},
    "preset": {"printer"}, "guides": {"rail-play"},
}  # fmt: skip
OTHERS = {"ender3": "corexy", "ender5": "voron2-250", "corexy": "cr10s"}  # whose print the kind "preset" is taken for
QUIET = {"unseen", "moved"}  # true of many good traces


def said(kind: str, preset: str, probe: str, cost_mm: float, rng: np.random.Generator) -> set[str]:
    """Return what `learn` says of one drawn trace."""
    path, dots = made.probe_path(probe, preset)
    family = str(rng.choice(made.FAMILIES))
    one = made.machine(preset, "healthy" if kind == "guides" else family, rng)
    seed = int(rng.integers(2**31))
    print_of = made.sized(kind, one, path, cost_mm, seed) if kind in made.SIZED else made.printed(one, path)
    table = made.table_of(print_of, float(rng.choice([0.02, 0.05])), rng, dots)
    table = made.TABLES[kind](table, rng) if kind in made.TABLES else table
    printer = read_printer(OTHERS[preset] if kind == "preset" else preset)
    try:
        model = learn_model(
            Trace(table[:, :2], table[:, 2:], homed=bool((table[0, :2] == printer.home_mm).all())), printer
        )
    except TraceError as error:
        return {"refused", "rows-shuffled"} if "another order" in error.came else {"refused"}
    idlers = {"second-period" for each in model.document["diagnosis"] if each["kind"].startswith("period-")}
    return {each["kind"] for each in model.document["misfit"]["found"]} | idlers


def heard(options: argparse.Namespace, case: tuple[str, str, int]) -> dict[str, object]:
    """Return what `learn` says of one drawn trace."""
    kind, preset, draw = case
    with tempfile.TemporaryDirectory() as folder:
        probe = Path(folder) / "probe.gcode"
        run("probe", "--printer", preset, "-o", str(probe))
        rng = np.random.default_rng([options.seed, draw, options.preset.index(preset)])
        return {"said": sorted(said(kind, preset, probe.read_text(), options.cost_mm, rng))}


def main() -> None:
    kinds = ("none", "preset", *made.SIZED, *made.TABLES)
    options = options_of(__doc__, draws=6, cost_mm=0.06, preset=tuple(made.BEDS), kind=kinds)
    print(f"{'misfit':16} {'draws':>5} {'named':>6} {'found':>6}  said")
    for kind in options.kind:
        cases = itertools.product([kind], options.preset, range(options.draws))
        told = [set(row["said"]) for _, row in rows_of(heard, cases, options)]
        named = np.mean([bool(each & NAMES.get(kind, {kind})) for each in told])
        found = np.mean([bool(each - QUIET) for each in told])
        counts = Counter(name for each in told for name in each)
        words = ", ".join(f"{name} {count}" for name, count in sorted(counts.items())) or "nothing"
        print(f"{kind:16} {len(told):5} {100 * named:5.0f}% {100 * found:5.0f}%  {words}", flush=True)


if __name__ == "__main__":
    main()
