"""Find how large pulleys of the severity `paper` may be: `PAPER_LARGEST` of `printmend_lab.sampling`.

    .venv/bin/python tools/fit_paper_severity.py --bodies generated:160 -o build/fit

slices the bodies, which needs PrusaSlicer, and prints up to three layers of each on a printer with pulleys of the
paper's two kinds, as `printmend bench table1 --protocol paper --severity paper --families pulley --models naive` does.
It looks for the size at which the mean RMSE over bodies is the paper's. The draws stay the same, so that it grows with
the size.
"""

import argparse
from pathlib import Path

import numpy as np

PAPER_NAIVE_STEPS = 27.6  # Table I
BETWEEN, NEAR = (1.3, 2.6), 0.01  # the radius is looked for here, so near


def main() -> None:
    from scipy.optimize import brentq

    from printmend.metrics import rmse
    from printmend.twin import Twin
    from printmend_lab import sampling
    from printmend_lab.bench.table1 import CORRUPTION, draw_cases, set_up
    from printmend_lab.dataset.bodies import body_files

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bodies", default="generated:160")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("-o", "--out", type=Path, required=True, help="A folder for bodies and their G-code.")
    options = parser.parse_args()
    files = body_files([options.bodies], made=options.out / "generated", seed=options.seed)
    sliced, families = options.out / "sliced", ("pulley",)
    cases = draw_cases(
        files, protocol="paper", families=families, severity="paper", seed=options.seed, sliced=sliced
    )  # fmt: skip

    stands = [set_up(case) for case in cases]  # their layers stay as they are

    def naive_steps(largest: float) -> np.ndarray:
        sampling.PAPER_LARGEST = largest
        errors = []
        for case, stand in zip(cases, stands, strict=True):
            twin = Twin.of(sampling.fault(case.family, case.rng(CORRUPTION), "paper"), stand.printer)
            prints = [twin.run(layer.controls, layer.start_steps) for layer in stand.layers]
            errors.append(rmse(np.concatenate([layer.nominal_steps for layer in stand.layers]), np.concatenate(prints)))
        return np.array(errors)

    found = brentq(lambda size: naive_steps(size).mean() - PAPER_NAIVE_STEPS, *BETWEEN, xtol=NEAR / 2)
    largest = round(found, 2)
    errors = naive_steps(largest)
    spread = errors.std(ddof=1) / np.sqrt(len(errors))
    print(f"largest {largest:.2f}: Naive {errors.mean():.2f} ± {spread:.2f} steps over {len(errors)} bodies")


if __name__ == "__main__":
    main()
