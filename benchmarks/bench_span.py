"""How much an axis teaches that moved only a little: error over span and noise.

    .venv/bin/python benchmarks/bench_span.py

A damaged printer moves X over a short span and Y over two turns. A learner sees that print. Then the same span is
printed again at other places. A figure is the RMS of X there [mm], of what the learner did not foresee: the median over
machines. The column `naive` has no model. Law: what was seen exactly is foreseen, however short it was, and no noise
makes a learner worse than no model.
"""

import argparse
import itertools
import sys
from pathlib import Path

import numpy as np

from printmend.errors import PrintmendError
from printmend.learn import fit
from printmend.machine.printing import print_from_home
from printmend.path import Trace
from printmend.printer import read_printer
from printmend.twin import Twin
from printmend_lab.sampling import fault

sys.path.insert(0, str(Path(__file__).parent))
from runner import options_of, rows_of

SEED = 60606
SPANS_MM, NOISES_MM = (1.0, 2.0, 4.0, 5.8, 6.2, 10.0, 20.0), (0.0, 0.02, 0.05)
FAMILIES = ("pulley", "pulley-play")
ROWS, ASKED = 400, 200


def main() -> None:
    options = options_of(__doc__, seed=SEED, learners="naive,printmend,greybox,meta", machines=3)
    names = options.learners.split(",")
    print(f"| noise, mm | span of X, mm | {' | '.join(names)} |")
    print("|---:|---:|" + "---:|" * len(names))
    for noise_mm, span_mm in itertools.product(NOISES_MM, SPANS_MM):
        cases = itertools.product(FAMILIES, [span_mm], [noise_mm], range(options.machines))
        found = [row for _, row in rows_of(missed, cases, options)]
        cells = [f"{np.median([one[name] for one in found]):.4f}" for name in names]
        print(f"| {noise_mm:g} | {span_mm:g} | {' | '.join(cells)} |", flush=True)


def missed(options: argparse.Namespace, case: tuple[str, float, float, int]) -> dict[str, float]:
    """Return what each learner did not foresee of one machine."""
    *drawn, number = case
    return missed_mm(options.learners.split(","), *drawn, (options.seed, number))


def missed_mm(
    names: list[str], family: str, span_mm: float, noise_mm: float, seed: tuple[int, int]
) -> dict[str, float]:
    """Return the RMS [mm] of X that each learner did not foresee."""
    printer = read_printer("ender5")
    rng = np.random.default_rng([*seed, FAMILIES.index(family)])
    twin = Twin.of(fault(family, rng, "damaged"), printer)
    middle = rng.uniform(80, 140)
    way, asked = (_way(rng, printer.home_mm, middle, span_mm, count) for count in (ROWS, ASKED))
    printed = twin.follow(way)
    measured = printed + rng.normal(0.0, noise_mm, printed.shape)
    measured[0] = np.nan
    trace = Trace(way, measured, homed=True)
    truth = twin.follow(asked)[1:, 0]
    found = {}
    for name in names:
        try:
            model = fit(name, trace, printer, rng=np.random.default_rng(0))
        except PrintmendError:
            found[name] = np.inf
            continue
        error = print_from_home(model.mechanism, asked[1:])[:, 0] - truth  # type: ignore[attr-defined]
        found[name] = float(np.sqrt((error**2).mean()))
    return found


def _way(rng: np.random.Generator, home: object, middle: float, span_mm: float, count: int) -> np.ndarray:
    """Return a way from home over places within the span of X and two turns of Y, [count + 1, 2] mm."""
    x = middle + rng.uniform(-span_mm / 2, span_mm / 2, count)
    y = 110 + rng.uniform(-40, 40, count)
    return np.vstack([np.asarray(home, float)[:2], np.stack([x, y], axis=1)])


if __name__ == "__main__":
    main()
