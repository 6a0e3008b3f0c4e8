"""Can residuals tell a printer that lays each dot anew from an instrument that scatters?

    .venv/bin/python benchmarks/bench_scatter.py --draws 20

Foreign printers with eccentric pulleys and play (benchmarks/outside.py): as they are, sticking and slipping, with a
loose nozzle (benchmarks/outside_faults.py); their probe read into a table with 0.05 mm of noise. For each axis'
residuals of the learned model: tails (excess kurtosis), what lasts from dot to dot (correlation with the next), what
goes with the way that the motor came (correlation); and whether the model tells of a misfit itself. One line a kind:
in how many prints each of these is beyond what chance makes in one of a hundred, and the share of the residuals'
variance that the fault made.
"""

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
import outside
import outside_faults
from bench_outside import PRESETS, walk_of
from printmend.learn.learned import learn
from printmend.path import Trace, last_way
from printmend.printer import read_printer
from runner import options_of, rows_of, run

KINDS = ("none", "stick_slip", "jitter")
TESTS = ("tails", "lasting", "way", "misfit")
CHANCE_SDS = 2.81  # standard deviations: 1 % for the two motors together, either side


def tested(kind: str, seed: int, noise_mm: float, probe: Path) -> tuple[dict[str, bool], float]:
    """Return which tests tell something of one printer, and the share of its residuals that the fault made."""
    home, sides, bed, _ = PRESETS["ender3"]
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    drives = [outside.random_drive(rng, "pulley+play", h, s, bed)[1] for h, s in zip(home, sides, strict=True)]
    fault = None if kind == "none" else outside_faults.FAULTS[kind](rng)
    moves = walk_of("probe", outside.read_moves(probe.read_text(), home), home, bed, rng)
    plain = outside.print_moves(moves, (drives[0], drives[1]), home, corexy=False)
    ways = plain if fault is None else fault(moves, plain, 0.0)
    ends, wanted = np.array([home, *(way[-1] for way in ways)]), np.array([home, *(move.end_mm for move in moves)])
    trace = Trace(wanted, ends + rng.normal(0, noise_mm, ends.shape), homed=True)
    learned = learn(trace, read_printer("ender3"), rng=rng)
    assert learned.fit is not None  # a probe shows each motor's whole turn
    left_mm = learned.fit.left_by_mark_mm(learned.trace)
    told = dict.fromkeys(TESTS, False)
    told["misfit"] = bool(learned.saved.document["misfit"]["found"])
    squares = 0.0
    for axis, left in enumerate((left_mm - np.nanmean(left_mm, axis=0)).T):
        known = np.isfinite(left)
        scaled, way = left[known] / left[known].std(), last_way(learned.trace.commanded_mm[:, axis])[known]
        count = len(scaled)
        told["tails"] |= abs(np.mean(scaled**4) - 3) > CHANCE_SDS * np.sqrt(24 / count)
        told["lasting"] |= abs(np.mean(scaled[1:] * scaled[:-1])) > CHANCE_SDS / np.sqrt(count)
        told["way"] |= abs(np.mean(scaled * (way - way.mean())) / way.std()) > CHANCE_SDS / np.sqrt(count)
        squares += float(np.mean(left[known] ** 2)) / 2
    return told, max(1 - noise_mm**2 / squares, 0.0)


def told_of(options: argparse.Namespace, case: tuple[str, int]) -> dict[str, object]:
    """Return the tests that tell something of one printer, and the share of its residuals that the fault made."""
    kind, draw = case
    with tempfile.TemporaryDirectory() as folder:
        probe = Path(folder) / "probe.gcode"
        run("probe", "--printer", "ender3", "-o", str(probe))
        told, share = tested(kind, 1000 * options.seed + draw, options.noise_mm, probe)
    return {"told": [each for each in TESTS if told[each]], "share": share}


def main() -> None:
    options = options_of(__doc__, draws=20, noise_mm=0.05)
    print(f"{'kind':12} prints  " + "  ".join(f"{each:>8}" for each in TESTS) + "  share of the variance, median")
    for kind in KINDS:
        found = [row for _, row in rows_of(told_of, [(kind, draw) for draw in range(options.draws)], options)]
        counts = "  ".join(f"{sum(each in row['told'] for row in found):8}" for each in TESTS)
        print(f"{kind:12} {len(found):6}  {counts}  {np.median([row['share'] for row in found]):.2f}", flush=True)


if __name__ == "__main__":
    main()
