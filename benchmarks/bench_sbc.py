"""Simulation-based calibration of the engine (Talts et al. 2018): are the ranks of what is true even among the draws?

    .venv/bin/python benchmarks/bench_sbc.py --seed 1 --draws 200 [--by scan] [--figure docs/figures/sbc.png]

Each draw takes a printer, a session and an instrument from the priors of the effects (the lab's `sampling`), prints the
marks of `printmend probe`, adds noise of 0.02 or 0.05 mm, learns, and draws machines. Three figures are ranked among
theirs: one random size of the effects that most printers may have (`WEIGHTS`), the shift of one random place of the bed
by the machine's effects, and the root mean square of what the acting model leaves over a part in the middle. One
flatbed scan knows neither place nor turn on the bed, so that errors count without these. Even ranks give a χ² of the
number of bins less one, and p is the chance of a larger one. Beside them stands how many of what is true lie in the
90 % range of the draws, and above it. With --rows a stopped run goes on where it was, and says at once what its draws
show.
"""

import argparse
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.stats import chi2

from printmend.effects import EFFECTS, Acts, Of, Scene, columns_of, scene_of
from printmend.effects.effect import LONG_MM, Places
from printmend.effects.sized import Sized
from printmend.infer.fit import begun, fitted
from printmend.infer.machine import DRAWS, Part, machine_of
from printmend.infer.posterior import of_shape, posterior_of
from printmend.path import FLATBED, Trace
from printmend.printer import Printer, read_printer
from printmend.probe import design_probe
from printmend_lab.sampling import drawn_parts, measured

sys.path.insert(0, str(Path(__file__).parent))
from runner import parsed, parser_of, rows_of

BINS = 12
WEIGHTS = ("play", "pulley", "skew", "aspect")  # effects whose sizes are ranked


def ranks_of(preset: str, by: str, rng: np.random.Generator) -> tuple[float, float, float] | None:
    """Return the ranks, from 0 to 1, of one drawn printer's size, of its place and of what mending leaves; None for
    another turn."""
    printer = read_printer(preset)
    plan = design_probe(printer)
    path = np.concatenate([np.array(printer.home_mm)[None], plan.waypoints_mm])
    dots = np.zeros(len(path), bool)
    dots[1 + plan.rows] = True
    known = np.where(dots[:, None], path, np.nan)
    every = Trace(path, known, homed=True, placed=by == "dots", instrument=FLATBED if by == "scan" else None)
    scene = scene_of(every, printer)
    true = drawn_parts(scene, rng)
    trace = measured(path, dots, scene, true, float(rng.choice([0.02, 0.05])), rng)
    first, turned = begun(trace, scene)
    if first.scene.turns_mm != scene.turns_mm:
        return None
    fit = fitted(turned, scene, first)
    posterior = posterior_of(fit, rng)
    places = _places(printer, rng)
    true_mm, places = _printed(true, places, scene)
    drawn_mm = _all_moved([(part, part.draws_mm) for part in posterior.parts], places, scene)
    acts_mm = _all_moved([(part, part.acts_mm[:, None]) for part in posterior.parts], places, scene)
    if not scene.placed:
        true_mm, drawn_mm, acts_mm = (
            of_shape(each, places).transpose(1, 0, 2) for each in (true_mm, drawn_mm, acts_mm)
        )
    one, axis = int(rng.integers(len(places))), int(rng.integers(2))
    left = (np.sqrt(np.mean(np.square(each - acts_mm).sum(axis=1), axis=0)) for each in (true_mm, drawn_mm))
    return (
        _weight(true, posterior.parts, scene, rng),
        _rank(true_mm[one, axis], drawn_mm[one, axis], rng),
        _rank(*left, rng),
    )


def _weight(true: Sequence[Sized], parts: Sequence[Part], scene: Scene, rng: np.random.Generator) -> float:
    """Return the rank of one size, chosen before anything is known of it; an effect that is not there has the size 0,
    and equal sizes are ranked by lot."""
    terms = {t.key: t for name in WEIGHTS for t in EFFECTS[name].terms(scene)}
    term = list(terms.values())[int(rng.integers(len(terms)))]
    at, key = int(rng.integers(len(term.sd_mm))), term.key
    here = [part.sizes_mm[at] for part in true if part.key == key]
    drawn = [part.draws_mm[at] for part in parts if part.key == key]
    return _rank(np.float64(sum(here)), np.sum(drawn, axis=0) if drawn else np.zeros(DRAWS), rng)


def ranked(options: argparse.Namespace, case: tuple[int]) -> dict[str, object]:
    """Return the ranks of one draw."""
    begun = time.process_time()
    ranks = ranks_of(options.preset, options.by, np.random.default_rng([options.seed, *case]))
    return {"ranks": ranks, "cpu_s": round(time.process_time() - begun, 2)}


def _rank(true: np.ndarray, drawn: np.ndarray, rng: np.random.Generator) -> float:
    below, same = (drawn < true - 1e-9).sum(), (np.abs(drawn - true) <= 1e-9).sum()
    return float((below + rng.uniform() * (same + 1)) / (len(drawn) + 1))


def _places(printer: Printer, rng: np.random.Generator, count: int = 200) -> Places:
    low = np.array([axis.min_mm + 0.3 * axis.length_mm for axis in printer.axes[:2]])
    bed = low + rng.uniform(0, 0.4, (count, 2)) * [axis.length_mm for axis in printer.axes[:2]]
    side, ways = rng.choice([-1.0, 1.0], (2, count, 2))
    none = np.zeros((count, 2))
    return Places(printer.to_motor(bed), side, bed, ways, np.ones(count), np.full(count, LONG_MM), none)


def _printed(parts: Sequence[Sized], places: Places, scene: Scene) -> tuple[np.ndarray, Places]:
    """Return where the machine itself puts places [N, 2, 1] from where they are wanted, and the places with those on
    the bed to which its belts move. No belt has less play than none, so this is not just the sum of its effects."""
    machine = [part for part in parts if EFFECTS[part.effect].of is Of.MACHINE]
    mechanism, _ = machine_of(scene, machine)
    branches = [
        table.branches_mm(motor) for table, motor in zip(mechanism.transmissions, places.motor_mm.T, strict=True)
    ]
    belts = np.where(places.side < 0, *(np.stack(each, axis=1) for each in zip(*branches, strict=True)))
    moved_mm = mechanism.bed.printed(belts) - scene.printer.from_motor(places.motor_mm)
    places = replace(places, bed_mm=scene.printer.from_motor(belts))
    rest = [(part, part.sizes_mm[:, None]) for part in machine if EFFECTS[part.effect].acts is Acts.NOT]
    return moved_mm[:, :, None] + _all_moved(rest, places, scene), places


def _all_moved(parts: list[tuple[Sized | Part, np.ndarray]], places: Places, scene: Scene) -> np.ndarray:
    """Return what the machine's effects with sizes [P, D] do to places [N, 2, D]."""
    moved = np.zeros((len(places), 2, 1))
    for part, sizes in parts:
        if EFFECTS[part.effect].of is Of.MACHINE:
            columns = columns_of(part.effect, places, part.where, part.shape, scene)
            moved = moved + np.einsum("ncp,pd->ncd", columns, sizes)
    return moved


def main() -> None:
    parser = parser_of(__doc__, draws=200)
    parser.add_argument("--preset", choices=("ender3", "corexy"), default="ender3")
    parser.add_argument("--by", choices=("dots", "scan"), default="dots", help="what was measured")
    parser.add_argument("--figure", type=Path)
    options = parsed(parser)
    rows = []
    with suppress(KeyboardInterrupt):
        for _, row in rows_of(ranked, [(draw,) for draw in range(options.draws)], options):
            rows.append(row)
    found, minutes = [row["ranks"] for row in rows], sum(row["cpu_s"] for row in rows) / 60
    ranks = np.array([each for each in found if each is not None])
    print(f"{'rank of':12} draws  χ²    p     in range  above  counts in {BINS} bins")
    for name, column in zip(("a size", "a place", "what is left"), ranks.T, strict=True):
        counts = np.bincount(np.minimum((column * BINS).astype(int), BINS - 1), minlength=BINS)
        even = len(column) / BINS
        square = float(np.sum((counts - even) ** 2 / even))
        chance, inside, above = chi2.sf(square, BINS - 1), np.mean(np.abs(column - 0.5) < 0.45), np.mean(column > 0.95)
        told = f"{len(column):5} {square:5.1f} {chance:.3f} {inside:9.0%} {above:6.0%}"
        print(f"{name:12} {told}  {' '.join(map(str, counts))}")
    print(f"{minutes:.1f} min of processor time for {len(rows)} draws: {1000 * minutes / len(rows):.0f} min for 1000")
    if options.figure is not None:
        import matplotlib.pyplot as plt

        figure, axes = plt.subplots(1, 3, figsize=(10, 2.6), layout="constrained")
        names = ("the size of a fault", "the error at one point on the bed", "the error after mending")
        for axis, name, column in zip(axes, names, ranks.T, strict=True):
            even = len(column) / BINS
            chance = 1.96 * np.sqrt(even * (1 - 1 / BINS))  # of a binomial count, for 95 in 100 bars
            axis.axhspan(even - chance, even + chance, color="#e7e5e4", zorder=0)
            axis.hist(column, bins=BINS, range=(0, 1), color="#0f766e", edgecolor="white")
            axis.axhline(even, color="#444", lw=1)
            axis.set(xlabel=f"rank of {name}", ylabel="printers")
        figure.savefig(options.figure, dpi=110)


if __name__ == "__main__":
    main()
