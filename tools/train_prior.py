"""Train the prior over pulleys and write its weights, in about two minutes on one core.

    .venv/bin/python tools/train_prior.py --seed 1 -o lab/src/printmend_lab/prior/prior.safetensors

made the weights that are shipped. ``--without KIND`` holds kinds out, to see how the prior does on what it never saw.
"""

import argparse
import os
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # sums in one order: the same bytes each time


def main() -> None:
    from safetensors.numpy import save
    from threadpoolctl import threadpool_limits

    from printmend.files import replacing
    from printmend_lab.prior.training import train_all

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--without", action="append", default=[], metavar="KIND")
    parser.add_argument("-o", "--output", type=Path, required=True)
    options = parser.parse_args()
    with threadpool_limits(1):
        tensors = train_all(options.seed, without=options.without, tick=lambda kind: print(kind, flush=True))
    with replacing(options.output, "wb") as file:
        file.write(save(tensors))


if __name__ == "__main__":
    main()
