"""How often does `printmend verify` say kept, broken, or that it cannot tell, of errors whose size is known?

    .venv/bin/python benchmarks/bench_verify.py --seed 1 --printers 12 [--checks 20] [--preset ender3]

Of each drawn printer a model is learned from the marks of `printmend probe`, with noise of 0.02 mm. In its check print
the wanted places are off by one kind of error, scaled to so many times the upper end of the promise, and by noise: a
table, with ``sigma_mm`` or without, or a scan. A promise holds at 1 and below. An error is *visible* where the verdict
of the same check print without one says that it would show one of its size. Seeds 1 and 2 were looked at while this was
written.
"""

import argparse
from collections import Counter
from dataclasses import replace

import numpy as np

from printmend.learn.learned import learn_model
from printmend.mend.verify import BROKEN, KEPT, UNSURE, verify
from printmend.path import FLATBED, Trace, last_way
from printmend.printer import Printer, read_printer
from printmend.probe import design_probe
from printmend.twin import Twin
from printmend_lab.sampling import sample

LEARNED_NOISE_MM = 0.02
NOISES_MM = (0.005, 0.02, 0.05, 0.1)
SIZES = (0.0, 0.5, 1.0, 2.0, 4.0)  # of an error, in upper ends of the promise
MEASURED = ("table", "table with sigma_mm", "scan")
MARKS = (20, 60, 1000)
FAMILIES = ("eccentric", "pulley-play", "play", "ellipse", "frame", "smooth")
KINDS = ("play", "wave", "idler", "bent", "scatter")


def error_of(kind: str, printer: Printer, wanted: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return errors of marks [N, 2] of one kind, of no size yet."""
    motors = printer.to_motor(wanted)
    weights = rng.normal(size=2)
    if kind == "play":
        off = last_way(motors) * weights
    elif kind in ("wave", "idler"):
        period_mm = printer.x.mm_per_turn * (1.0 if kind == "wave" else rng.uniform(0.6, 1.6))
        off = np.sin(2 * np.pi * motors / period_mm + rng.uniform(0, 2 * np.pi, 2)) * weights
    elif kind == "bent":
        one = (wanted - wanted.mean(axis=0)) / np.ptp(wanted, axis=0)
        off = one[:, ::-1] ** 2 * weights
    else:
        return rng.normal(size=wanted.shape)
    return np.asarray(printer.from_motor(off))


def check_print(
    kind: str, wanted: np.ndarray, off: np.ndarray, size_mm: float, noise: np.ndarray, noise_mm: float
) -> Trace:
    """Return a measurement of marks whose errors are of a size."""
    off = off - off.mean(axis=0)
    off = off * (size_mm / float(np.sqrt(np.mean(np.sum(off**2, axis=1)))))
    table = Trace(wanted, wanted + off + noise, homed=True)
    if kind == "table":
        return table
    stated = replace(table, sigma_mm=np.full(len(wanted), noise_mm))
    return replace(stated, placed=False, instrument=FLATBED) if kind == "scan" else stated


def main() -> None:
    """Draw printers and check prints, and count verdicts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--printers", type=int, default=12)
    parser.add_argument("--checks", type=int, default=20)
    parser.add_argument("--preset", default="ender3")
    given = parser.parse_args()
    printer, counts = read_printer(given.preset), dict[tuple[str, float], Counter[str]]()
    plan = design_probe(printer)
    for draw in range(given.printers):
        rng = np.random.default_rng((given.seed, draw))
        twin = Twin.of(sample(str(rng.choice(FAMILIES)), rng), printer)
        marks = twin.follow(plan.waypoints_mm)[plan.rows]
        model = learn_model(plan.trace(marks + rng.normal(0, LEARNED_NOISE_MM, marks.shape)), printer)
        wanted = plan.waypoints_mm[plan.rows]
        for _ in range(given.checks):
            kind = str(rng.choice(MEASURED))
            place = wanted[:: max(1, len(wanted) // int(rng.choice(MARKS)))]
            # a table that does not say how exact it is cannot tell scatter of the printer from its own
            off = error_of(str(rng.choice(KINDS[:-1] if kind == "table" else KINDS)), printer, place, rng)
            high_mm = verify(model, Trace(place, place + 1e-6 * off, homed=True)).promised_high_mm
            noise_mm = float(rng.choice(NOISES_MM))
            noise = rng.normal(0, noise_mm, place.shape)
            shows_mm = 0.0
            for size in SIZES:
                verdict = verify(model, check_print(kind, place, off, size * high_mm, noise, noise_mm))
                shows_mm = shows_mm or verdict.shows_from_mm
                row = counts.setdefault((kind, size), Counter())
                row[verdict.result] += 1
                if size * high_mm > shows_mm:
                    row["seen"] += 1
                    row["seen broken"] += verdict.result == BROKEN
    print("measurement           error/promise     n  kept broken cannot tell   of those visible: n broken")
    for (name, size), row in sorted(counts.items()):
        n, seen = sum(row[each] for each in (KEPT, BROKEN, UNSURE)), row["seen"]
        shares = " ".join(f"{100 * row[each] / n:5.1f}%" for each in (KEPT, BROKEN, UNSURE))
        print(f"{name:22s} {size:9.1f} {n:9d} {shares}      {seen:6d} {100 * row['seen broken'] / max(seen, 1):5.1f}%")


if __name__ == "__main__":
    main()
