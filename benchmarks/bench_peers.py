"""Ours and the methods of other trades on the same broken printers, with the same measured points and the same judge.

    .venv/bin/python benchmarks/bench_peers.py

For each family of faults, a damaged printer prints a zigzag of 2.5 turns, of which so many points are measured, with
noise. Each learner sees these and nothing else. A layer of another body is planned with what it learned, printed, and
compared with what was wanted. Models with tables are planned by `optimal`, all others by the peers' inverse, or by what
follows a `+`: the last peer is PETS, an ensemble with model predictive control. Iterative learning has no model: it
prints that same layer five times, and measures a fifth of the points each time.

Writes benchmarks/results/peers.csv (a row for every run; a run of some learners leaves the others' rows there) and
docs/figures/peers.png, and prints the tables of docs/peers.md. Seconds are of the processor.
"""

import argparse
import csv
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from printmend.errors import PrintmendError
from printmend.files import replacing
from printmend.learn import fit
from printmend.metrics import rmse
from printmend.protocols import WorldModel
from printmend.twin import Twin
from printmend_lab.bench.case import row
from printmend_lab.bench.prints import draw_print_cases, measured_print, set_up
from printmend_lab.control.check import tables_of
from printmend_lab.control.registry import controller
from printmend_lab.path import Layer
from printmend_lab.peers.ilc import iterate

ROOT = Path(__file__).resolve().parents[1]
RESULTS, FIGURE = ROOT / "benchmarks" / "results" / "peers.csv", ROOT / "docs" / "figures" / "peers.png"
SEED = 33033  # drawn from only for the page; develop with others
FAMILIES = ("pulley", "play", "pulley-play", "pulley-loose", "frame", "smooth")
BUDGETS, NOISES_MM = (30, 100, 300, 1000, 3000), (0.0, 0.05, 0.2)
COMMON_MM, COMMON_POINTS = 0.05, 300  # the noise of every budget, the budget of every noise
OURS = ("printmend", "greybox", "hybrid", "meta")
PEERS = (
    "affine", "backlash", "bilateral", "prandtl-ishlinskii", "bouc-wen", "gaussian-process",
    "printmend_lab.peers.narx:NARX", "printmend_lab.peers.network:TCN", "printmend_lab.peers.network:ENSEMBLE",
    "printmend_lab.peers.network:ENSEMBLE+printmend_lab.peers.mpc:MPC",
)  # fmt: skip
SLOW = PEERS[-1:]  # half a minute to plan a layer: with the common noise and budget alone
LEARNERS = ("naive", *PEERS, "lightgbm-axis", *OURS)
ILC, ILC_PRINTS = "ilc", 5
INVERSE = "printmend_lab.peers.inverse:INVERSE"
TICKS = 600  # of the layer that is judged


@dataclass(frozen=True)
class Run:
    """A learner on a printer: what it was shown, what its print missed, and what it cost."""

    family: str
    sample: int
    noise_mm: float
    points: int
    learner: str
    planner: str
    prints: int
    rmse_steps: float
    rmse_mm: float
    optimum_steps: float
    learn_s: float
    plan_s: float
    error: str = ""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--samples", type=int, default=1, help="printers of each family")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--learners", default=",".join((*LEARNERS, ILC)))
    parser.add_argument("--out", type=Path, default=RESULTS)
    parser.add_argument("--figure", type=Path, default=FIGURE)
    parser.add_argument("--draw-only", action="store_true", help="from the CSV that is there")
    options = parser.parse_args()
    if not options.draw_only:
        begun = time.perf_counter()
        warm(options.learners.split(","))
        names = options.learners.split(",")
        shown = [told(name) for name in names]
        runs = [run for run in (read(options.out) if options.out.exists() else []) if run.learner not in shown]
        with threadpool_limits(1):
            for more in compared(options.samples, options.seed, names):
                runs += more
                write(options.out, runs)
        spent = f"{time.perf_counter() - begun:.0f} s, {time.process_time():.0f} s of the processor"
        print(f"{len(runs)} runs in {spent}\n")
    runs = read(options.out)
    options.figure.parent.mkdir(parents=True, exist_ok=True)
    draw(options.figure, runs)
    print("\n\n".join((by_budget(runs), by_noise(runs), by_family(runs))))


def warm(names: Sequence[str]) -> None:
    """Compile and import what the learners and planners need, so that no run pays for it."""
    for _ in one_printer("pulley-play", 0, 1, names, [(COMMON_MM, 60)]):
        pass


def compared(samples: int, seed: int, names: Sequence[str]) -> Iterator[list[Run]]:
    """Yield the runs of every printer: of each sample of each family, with every budget and noise."""
    settings = [(COMMON_MM, points) for points in BUDGETS]
    settings += [(noise_mm, COMMON_POINTS) for noise_mm in NOISES_MM if noise_mm != COMMON_MM]
    for family in FAMILIES:
        for sample in range(samples):
            yield list(one_printer(family, sample, seed, names, settings))


def one_printer(
    family: str, sample: int, seed: int, names: Sequence[str], settings: Sequence[tuple[float, int]]
) -> Iterator[Run]:
    case = draw_print_cases([family], samples=sample + 1, seed=seed)[sample]
    stand = set_up(case)
    twin, printer = stand.layers.twin, stand.layers.printer
    layer = cut(stand.body.layers[0])
    best = fit("oracle", None, printer, rng=case.rng(0), truth=twin.mechanism)  # type: ignore[arg-type]
    optimum, _ = missed(best, twin, layer)[:2]
    for noise_mm, points in settings:
        shown = replace(row("greybox+optimal"), test_print="zigzag", points=points, noise_mm=noise_mm)
        trace = measured_print(case, shown, printer, twin, stand.body)
        for name in names:
            if name in SLOW and (noise_mm, points) != (COMMON_MM, COMMON_POINTS):
                continue
            head = (family, sample, noise_mm, points, told(name))
            learner, _, planned_by = name.partition("+")
            try:
                if name == ILC:
                    error, seconds = iterated(twin, layer, points, noise_mm, case.rng(99, noise_mm, points))
                    planner, costs, prints = "itself", (0.0, seconds), ILC_PRINTS
                else:
                    begun = time.process_time()
                    model = fit(learner, trace, printer, rng=np.random.default_rng(0))
                    learn_s = time.process_time() - begun
                    error, planner, plan_s = missed(model, twin, layer, planned_by)
                    costs, prints = (learn_s, plan_s), 1
                yield Run(*head, planner, prints, error, error * printer.mm_per_step[0], optimum, *costs)
            except PrintmendError as problem:
                yield Run(*head, "none", 1, np.nan, np.nan, optimum, 0.0, 0.0, str(problem))
    print(f"{family} {sample}: done", flush=True)


def cut(layer: Layer) -> Layer:
    """Return the first ticks of a layer."""
    return Layer(layer.index, layer.z_mm, layer.start_steps, layer.controls[:TICKS], layer.extruding[:TICKS])


def told(name: str) -> str:
    """Return what a row is called in the tables: a place without its module."""
    return "+".join(part.rpartition(":")[2].lower() for part in name.split("+"))


def missed(model: WorldModel, twin: Twin, layer: Layer, planner: str = "") -> tuple[float, str, float]:
    """Return the RMSE [full steps] of a layer that was planned with a model, which planner did it, and its seconds."""
    planner = planner or (INVERSE if tables_of(model, layer.start_steps, 3) is None else "optimal")
    begun = time.process_time()
    plan = controller(planner).plan(model, layer.nominal_steps[1:], layer.start_steps)
    plan_s = time.process_time() - begun
    printed = twin.run(plan.controls, layer.start_steps)
    return rmse(layer.nominal_steps, printed), planner.rpartition(":")[2].lower(), plan_s


def iterated(twin: Twin, layer: Layer, points: int, noise_mm: float, rng: np.random.Generator) -> tuple[float, float]:
    """Return the RMSE [full steps] of the print after those that iterative learning measured, and its seconds."""
    targets, sigma = layer.nominal_steps, noise_mm / twin.printer.mm_per_step[0]
    seen = np.unique(np.linspace(0, len(targets) - 1, max(points // ILC_PRINTS, 2)).astype(int))

    def print_layer(controls: np.ndarray) -> np.ndarray:
        out = np.full(targets.shape, np.nan)
        printed = twin.run(controls, layer.start_steps)
        out[seen] = printed[seen] + rng.normal(0.0, 1.0, (len(seen), 2)) * sigma
        return out

    begun = time.process_time()
    last = iterate(print_layer, targets, prints=ILC_PRINTS + 1)[-1]
    return rmse(targets, twin.run(last.controls, layer.start_steps)), time.process_time() - begun


def head_of(path: Path) -> list[str]:
    """Return the lines that say how a table was made; they stand above its columns, and are kept."""
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True) if path.exists() else []
    return [line for line in lines if line.startswith("#")]


def write(path: Path, runs: Sequence[Run]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    head = head_of(path)
    with replacing(path) as file:
        file.writelines(head)
        table = csv.writer(file, lineterminator="\n")
        table.writerow([field.name for field in fields(Run)])
        for run in runs:
            table.writerow([f"{v:.5g}" if isinstance(v, float) else v for v in asdict(run).values()])


def read(path: Path) -> list[Run]:
    with open(path, newline="", encoding="utf-8") as file:
        rows = (line for line in file if not line.startswith("#"))
        return [Run(**{field.name: field.type(record[field.name]) for field in fields(Run)})  # type: ignore[operator]
                for record in csv.DictReader(rows)]  # fmt: skip


def ratio(runs: Sequence[Run]) -> float:
    """Return the geometric mean of the errors over the optimum's, NaN where a learner failed."""
    values = [run.rmse_steps / run.optimum_steps for run in runs]
    return float(np.exp(np.mean(np.log(values)))) if values and np.isfinite(values).all() else float("nan")


def learners_of(runs: Sequence[Run]) -> list[str]:
    """Return the learners' names, in the order of `LEARNERS`."""
    order = [told(name) for name in (*LEARNERS, ILC)]
    return sorted(
        {run.learner for run in runs}, key=lambda name: (order.index(name) if name in order else len(order), name)
    )


def table(corner: str, names: Sequence[str], columns: Sequence[str], cells: Sequence[Sequence[float]]) -> str:
    """Return a Markdown table; the least figure of each column but the last is bold."""
    least = np.nanmin(np.array(cells)[[n for n, name in enumerate(names) if name != "naive"]], axis=0)
    lines = [f"| {corner} | {' | '.join(columns)} |", "|---|" + "---:|" * len(columns)]
    for name, values in zip(names, cells, strict=True):
        texts = ["–" if np.isnan(v) else f"**{v:.2f}**" if v == least[k] and columns[k] != "s" else f"{v:.2f}"
                 for k, v in enumerate(values)]  # fmt: skip
        lines.append(f"| {name} | {' | '.join(texts)} |")
    return "\n".join(lines)


def by_budget(runs: Sequence[Run]) -> str:
    names = learners_of(runs)
    cells = []
    for name in names:
        mine = [run for run in runs if run.learner == name and run.noise_mm == COMMON_MM]
        figures = [ratio([run for run in mine if run.points == points]) for points in BUDGETS]
        cells.append([*figures, float(np.mean([run.learn_s + run.plan_s for run in mine]))])
    return table("learner", names, [*(f"{points} points" for points in BUDGETS), "s"], cells)


def by_noise(runs: Sequence[Run]) -> str:
    names = learners_of(runs)
    mine = [run for run in runs if run.points == COMMON_POINTS]
    cells = [[ratio([run for run in mine if run.learner == name and run.noise_mm == noise]) for noise in NOISES_MM]
             for name in names]  # fmt: skip
    return table("learner", names, [f"{noise:g} mm" for noise in NOISES_MM], cells)


def by_family(runs: Sequence[Run]) -> str:
    names, families = learners_of(runs), list(dict.fromkeys(run.family for run in runs))
    mine = [run for run in runs if run.points == COMMON_POINTS and run.noise_mm == COMMON_MM]
    cells = [[ratio([run for run in mine if run.learner == name and run.family == family]) for family in families]
             for name in names]  # fmt: skip
    return table("learner", names, families, cells)


def draw(path: Path, runs: Sequence[Run]) -> None:
    """Draw the error over the number of measured points."""
    from printmend.draw.figure import INK, PALETTE, new_figure, save

    figure, (axes,) = new_figure(width_in=8.4, height_in=5.2)
    figure.subplots_adjust(left=0.09, right=0.7, top=0.95, bottom=0.11)
    names, plain = learners_of(runs), 0
    for name in names:
        mine = [run for run in runs if run.learner == name and run.noise_mm == COMMON_MM]
        values = [ratio([run for run in mine if run.points == points]) for points in BUDGETS]
        if np.isnan(values).any():
            continue
        if name in OURS:
            style = {"color": PALETTE[OURS.index(name)], "linewidth": 2.6, "marker": "o"}
        elif name == "naive":
            style = {"color": INK, "linewidth": 1.2, "linestyle": ":"}
        else:
            style = {"color": PALETTE[4 + plain % 3], "linewidth": 1.1, "marker": "svD^<>x+*"[plain % 9],
                     "linestyle": "-" if plain < 4 else "--" if plain < 8 else "-."}  # fmt: skip
            plain += 1
        axes.plot(BUDGETS, values, label=name, markersize=5, **style)  # type: ignore[arg-type]
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xticks(BUDGETS, [str(points) for points in BUDGETS])
    axes.minorticks_off()
    axes.set_xlabel(f"measured points ({COMMON_MM:g} mm of noise)", color=INK)
    axes.set_ylabel("RMSE of another layer ÷ the optimum's", color=INK)
    axes.grid(alpha=0.25)
    axes.legend(loc="center left", bbox_to_anchor=(1.02, 0.5), frameon=False, fontsize=9)
    save(figure, path)


if __name__ == "__main__":
    main()
