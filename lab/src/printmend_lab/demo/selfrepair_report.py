"""What came of self-repair: a table, the outlines beside the errors, and which damages converge at all."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from printmend.corruption import Corruption, Drive, EccentricBore, Play, PublishedHull, published_names
from printmend.model import SavedModel
from printmend.printer import Printer
from printmend.units import TURN_RAD
from printmend_lab.demo.pulley_part import TIP_MM
from printmend_lab.demo.selfrepair import CONVERGED_MM, MENDED, OPEN, Series, run_series

HEADER = ("way", "generation", "RMS mm", "size mm", "shape mm")
DAMAGE_HEADER = ("damage", "at first", f"{OPEN}, one pulley", f"{OPEN}, both", f"{MENDED}, one", f"{MENDED}, both")
WAYS = (OPEN, MENDED)


def hull_damage(name: str, *, both: bool = False, play_mm: float = 0.0) -> Corruption:
    """Return the machine whose first motor, or ``both``, has that published pulley, and as much play."""
    drive = Drive(pulley=PublishedHull(name), belt=Play(play_mm) if play_mm else None)
    return Corruption((drive, drive if both else Drive()))


def damages(*, both: bool) -> dict[str, Corruption]:
    """Return the damages that are compared: the published hulls, bores ever farther off, ever more play."""
    found = {name: hull_damage(name, both=both) for name in published_names() if name != "ideal"}
    for off_mm in (0.5, 2.0, 4.0, 6.0):
        drive = Drive(pulley=EccentricBore(off_mm))
        found[f"bore {off_mm:g} mm off"] = Corruption((drive, drive if both else Drive()))
    for play_mm in (0.5, 2.0, 4.0):
        found[f"egg, play {play_mm:g} mm"] = hull_damage("egg", both=both, play_mm=play_mm)
    return found


def run_both(
    printer: Printer, broken: Corruption | SavedModel, work: Path, *, generations: int, both: bool, seed: int,
    tick: Callable[[str], None] = lambda what: None,
) -> list[Series]:  # fmt: skip
    """Run self-repair as it is and with printmend, on equal draws."""
    return [
        run_series(
            printer, broken, work, mended=way == MENDED, generations=generations, both=both, seed=seed, tick=tick
        )
        for way in WAYS
    ]


def rows(series: Sequence[Series]) -> list[tuple[str, ...]]:
    """Return the table's texts, in the order of `HEADER`; size is of the mean radius, shape what is not size."""
    lines: list[tuple[str, ...]] = []
    for one in series:
        lines.append((one.way, "0", f"{one.start_mm:.3f}", "–", "–"))
        for number, pulley in enumerate(one.pulleys, start=1):
            shape = float(pulley.support_mm.std())
            lines.append((one.way, str(number), f"{pulley.rms_mm:.3f}", f"{pulley.size_mm:+.3f}", f"{shape:.3f}"))
    return lines


def closing(series: Sequence[Series]) -> list[str]:
    """Say of each way whether it converged, and why it ended."""
    return [
        f"{one.way}: {one.verdict} (below {CONVERGED_MM:g} mm RMS counts as converged)"
        + (f": {one.ended}" if one.ended else "")
        for one in series
    ]


def damage_rows(
    printer: Printer, work: Path, *, generations: int, seed: int, tick: Callable[[str], None] = lambda what: None
) -> list[tuple[str, ...]]:
    """Return a line for each of `damages`: the first error and what became of it, way by way."""
    lines = []
    for name in damages(both=False):
        of_one, of_both = (
            run_both(printer, damages(both=both)[name], work, generations=generations, both=both, seed=seed, tick=tick)
            for both in (False, True)
        )
        texts = [f"{one.errors_mm[-1]:.3f} {one.verdict}" for one in (of_one[0], of_both[0], of_one[1], of_both[1])]
        lines.append((name, f"{of_one[0].start_mm:.3f}", *texts))
    return lines


def draw(series: Sequence[Series], path: Path, *, title: str) -> Path:
    """Draw the printed outlines of each way, and the error against the generation."""
    from printmend.draw import new_figure, save
    from printmend.draw.figure import ERROR_COLOURS, INK, PALETTE, fit_view, plain, quiet

    figure, axes = new_figure(len(series) + 1, width_in=4.2, height_in=4.4)
    circle = np.linspace(0, TURN_RAD, 361)
    reach = max([np.abs(pulley.outline_mm).max() for one in series for pulley in one.pulleys] or [TIP_MM])
    for one, place in zip(series, axes, strict=False):
        for number, pulley in reversed(list(enumerate(one.pulleys))):
            shade = ERROR_COLOURS(1 - number / max(len(one.pulleys) - 1, 1))
            place.plot(*pulley.outline_mm.T, color=shade, linewidth=1.0, label=f"{number + 1}")
        place.plot(TIP_MM * np.cos(circle), TIP_MM * np.sin(circle), color=INK, linewidth=0.8, linestyle=":")
        plain(fit_view(place, np.full(2, -reach), np.full(2, reach)))
        place.set_title(f"printed pulleys, {one.way}", color=INK, fontsize=10)
        if one.pulleys:
            place.legend(title="generation", fontsize=7, title_fontsize=7, loc="center", frameon=False)
    for one, colour in zip(series, PALETTE[1::-1], strict=False):
        errors = one.errors_mm
        axes[-1].semilogy(range(len(errors)), errors, "o-", color=colour, label=one.way)
    axes[-1].axhline(CONVERGED_MM, color=INK, linewidth=0.8, linestyle=":")
    axes[-1].set_xlabel("generation (0: the broken machine)", color=INK, fontsize=9)
    axes[-1].set_title("moment arm off a good pulley's, RMS [mm]", color=INK, fontsize=10)
    axes[-1].legend(fontsize=8, frameon=False)
    quiet(axes[-1])
    figure.suptitle(title, color=INK, fontsize=12)
    figure.subplots_adjust(left=0.01, right=0.985, top=0.85, bottom=0.13, wspace=0.12)
    return save(figure, path)
