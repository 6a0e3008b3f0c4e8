"""Curiosity: print, learn, choose the next shortest print, stop when the promise is met; beside other choices.

The promise is the error to expect anywhere on the bed for want of knowledge (physics.md eq. 21), which the loop can
tell; the true error, which only the twin can tell, is drawn beside it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from printmend.corruption import Corruption
from printmend.gcode.read import Program, read_gcode
from printmend.learn import fit
from printmend.machine.printing import print_from_home
from printmend.measure.plan import ProbePlan
from printmend.path import Trace
from printmend.printer import Printer
from printmend.probe import cost, design_probe
from printmend.probe.layout import mark_area_mm
from printmend.probe.probe import expected_error_mm, targets_mm
from printmend.probe.tiles import NOISE_MM, belief_after
from printmend.twin import Twin
from printmend_lab.body import demo_body_gcode

ACTIVE = "active"
WAYS = (ACTIVE, "fixed", "random", "longest layer")
SIZES = (16, 32, 64, 128)  # marks of the prints that are considered
ROUND_MARKS = 32  # of the others' prints
LEARNER = "greybox"
PLACES_PROMISED = 400  # places of the bed at which the promise is asked


@dataclass(frozen=True)
class Round:
    """What had been spent after a print, what was then promised, and what was true [mm RMS]."""

    marks: int
    minutes: float
    grams: float
    promised_mm: float
    error_mm: float


def run_way(
    way: str, printer: Printer, corruption: Corruption, *, promise_mm: float, rounds: int, seed: int,
    tick: Callable[[str], None] = lambda what: None,
) -> list[Round]:  # fmt: skip
    """Print, measure and learn until the promise is met, ``rounds`` times at most; return what each round gave."""
    twin, noise = Twin.of(corruption, printer), np.random.default_rng([seed, 1])
    part = read_gcode(demo_body_gcode(), printer=printer)
    asked = np.vstack([printer.home_mm, _places(printer, np.random.default_rng([seed, 2]), PLACES_PROMISED)])
    truth = twin.follow(asked)[1:]
    ways: list[np.ndarray] = []
    measured: list[np.ndarray] = []
    done: list[Round] = []
    minutes = grams = 0.0
    for number in range(rounds):
        trace = _trace(ways, measured)
        plan = _next(way, printer, part, trace, promise_mm, np.random.default_rng([seed, 3, number]))
        printed = twin.follow(np.vstack([*ways, plan.waypoints_mm]))[-len(plan.waypoints_mm) :]
        seen = np.full(printed.shape, np.nan)
        seen[plan.rows] = printed[plan.rows] + noise.normal(0.0, NOISE_MM, (len(plan), 2))
        ways.append(plan.waypoints_mm)
        measured.append(seen)
        spent = cost(plan)
        minutes, grams = minutes + spent[0], grams + spent[1]
        trace = _trace(ways, measured)
        assert trace is not None
        belief = belief_after(printer, trace)
        promised = belief.expected_mm(belief.wanted(targets_mm(printer, None)))
        model = fit(LEARNER, trace, printer, rng=np.random.default_rng(seed))
        said = print_from_home(model.mechanism, asked[1:])  # type: ignore[attr-defined]
        error = float(np.sqrt(np.mean((said - truth) ** 2)))
        marks = sum(int(np.isfinite(one[:, 0]).sum()) for one in measured)
        done.append(Round(marks, minutes, grams, promised, error))
        tick(f"{way}: print {number + 1}")
        if promised <= promise_mm:
            break
    return done


def _trace(ways: Sequence[np.ndarray], measured: Sequence[np.ndarray]) -> Trace | None:
    """Return what was measured so far as one trace."""
    return Trace(np.vstack(ways), np.vstack(measured), homed=True) if ways else None


def _next(
    way: str, printer: Printer, part: Program, trace: Trace | None, promise_mm: float, rng: np.random.Generator
) -> ProbePlan:
    """Return the next print. ``active``: the shortest that should keep the promise, else that teaches most a minute."""
    if way != ACTIVE or trace is None:
        design = "layer" if way == "longest layer" else "fixed"
        plan = design_probe(printer, design=design, part=part if design == "layer" else None, marks=ROUND_MARKS)
        return _scattered(plan, printer, rng) if way == "random" else plan
    belief = belief_after(printer, trace)
    now = belief.expected_mm(belief.wanted(targets_mm(printer, None)))
    plans = [design_probe(printer, design="active", after=trace, marks=marks) for marks in SIZES]
    expected = [expected_error_mm(printer, plan, after=trace) for plan in plans]
    enough = [plan for plan, error in zip(plans, expected, strict=True) if error <= promise_mm]
    if enough:
        return min(enough, key=lambda plan: cost(plan)[0])
    gain = [(now**2 - error**2) / cost(plan)[0] for plan, error in zip(plans, expected, strict=True)]
    return plans[int(np.argmax(gain))]


def _scattered(plan: ProbePlan, printer: Printer, rng: np.random.Generator) -> ProbePlan:
    """Return a plan with as many marks, anywhere, in any order."""
    points = np.vstack([plan.waypoints_mm[:3], _places(printer, rng, len(plan))])
    return replace(plan, waypoints_mm=points, rows=np.arange(3, 3 + len(plan)))


def _places(printer: Printer, rng: np.random.Generator, count: int) -> np.ndarray:
    """Draw places on the part of the bed that marks may take [N, 2] mm."""
    low, high = mark_area_mm(printer)
    return np.asarray(low + rng.random((count, 2)) * (high - low))


HEADER = ("way", "print", "marks", "minutes", "grams", "promised mm", "true mm")


def rows(found: dict[str, list[Round]]) -> list[tuple[str, ...]]:
    """Return the table's texts, in the order of `HEADER`."""
    return [
        (way, f"{number}", f"{one.marks}", f"{one.minutes:.1f}", f"{one.grams:.2f}", f"{one.promised_mm:.3f}",
         f"{one.error_mm:.3f}")
        for way, rounds in found.items()
        for number, one in enumerate(rounds, start=1)
    ]  # fmt: skip


def closing(found: dict[str, list[Round]], promise_mm: float) -> list[str]:
    """Say for each way when the promise was met, and whether it was kept."""
    lines = []
    for way, rounds in found.items():
        last = rounds[-1]
        met = f"promised {promise_mm:g} mm after {last.minutes:.1f} min and {last.grams:.2f} g"
        if last.promised_mm > promise_mm:
            met = f"does not reach {promise_mm:g} mm in {len(rounds)} prints ({last.minutes:.1f} min)"
        lines.append(f"{way}: {met}; the error is {last.error_mm:.3f} mm")
    return lines


def draw(found: dict[str, list[Round]], path: Path, *, promise_mm: float) -> Path:
    """Draw the error against minutes and against grams: lines are true, dotted what was promised, dashed the aim."""
    from printmend.draw import new_figure, save
    from printmend.draw.figure import INK, PALETTE, quiet

    figure, axes = new_figure(2, width_in=4.8, height_in=4.0)
    for place, value, unit in ((axes[0], "minutes", "printing [min]"), (axes[1], "grams", "plastic [g]")):
        for (way, rounds), colour in zip(found.items(), PALETTE, strict=False):
            at = [getattr(one, value) for one in rounds]
            place.semilogy(at, [one.error_mm for one in rounds], ".-", color=colour, linewidth=1.8, label=way)
            place.semilogy(at, [one.promised_mm for one in rounds], "o:", color=colour, markersize=4, linewidth=0.8)
        place.axhline(promise_mm, color=INK, linewidth=0.8, linestyle="--")
        place.set_xlabel(unit, color=INK, fontsize=9)
        quiet(place)
    said = "RMS error on the bed [mm]\nline: true; dotted: promised; dashed: asked for"
    axes[0].set_ylabel(said, color=INK, fontsize=9)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="upper center", ncols=len(found), fontsize=8, frameon=False)
    figure.subplots_adjust(left=0.09, right=0.98, top=0.92, bottom=0.13, wspace=0.16)
    return save(figure, path)
