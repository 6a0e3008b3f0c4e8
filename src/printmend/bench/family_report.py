"""The families table for the docs: families.md, compact enough to read, and families.csv, every number."""

import csv
from collections.abc import Sequence
from dataclasses import asdict, fields
from pathlib import Path

from printmend.bench.families import OPTIMUM, SEVERITIES, Cell
from printmend.bench.report import markdown_table
from printmend.files import replacing

MARKDOWN, CSV = "families.md", "families.csv"
NAIVE = "naive+greedy"


def family_markdown(cells: Sequence[Cell], coverages: Sequence[float], noises_mm: Sequence[float]) -> str:
    """Return a Markdown table for each row: families down, ratios to the optimum across, "damaged / realistic".

    Two more columns give the size of the errors: the optimum's and naive's RMSE in full steps, over all coverages.
    """
    found = {(c.label, c.family, c.severity, c.printer, c.coverage, c.noise_mm): c for c in cells}
    header = (
        "family", "optimum", "naive", *(f"{turns:g} turn σ {noise:g}" for turns in coverages for noise in noises_mm)
    )  # fmt: skip
    families = list(dict.fromkeys((cell.family, cell.printer) for cell in cells))
    texts = []
    for label in dict.fromkeys(cell.label for cell in cells if cell.label != OPTIMUM):
        lines = []
        for family, printer in families:

            def across(row: str, coverage: float, noise: float, place: tuple[str, str] = (family, printer)) -> str:
                pair = [found.get((row, place[0], severity, place[1], coverage, noise)) for severity in SEVERITIES]
                return " / ".join(_ratio(cell) for cell in pair if cell is not None) or "–"

            name = family + ("" if printer == "ender5" else f" @{printer}")
            sizes = [_size(cells, row, family, printer) for row in (OPTIMUM, NAIVE)]
            ratios = [across(label, float(turns), float(noise)) for turns in coverages for noise in noises_mm]
            lines.append((name, *sizes, *ratios))
        texts.append(f"**{label}**\n\n" + markdown_table(header, lines))
    return "\n".join(texts)


def write_families(folder: Path, cells: Sequence[Cell], coverages: Sequence[float], noises_mm: Sequence[float]) -> None:
    """Write families.md and families.csv into ``folder``."""
    with replacing(folder / MARKDOWN) as file:
        file.write(family_markdown(cells, coverages, noises_mm))
    with replacing(folder / CSV) as file:
        table = csv.DictWriter(file, [field.name for field in fields(Cell)], lineterminator="\n")
        table.writeheader()
        table.writerows(asdict(cell) for cell in cells)


def _ratio(cell: Cell) -> str:
    star = "*" if cell.failures else ""
    return ("–" if cell.ratio is None else f"{cell.ratio:.2f}" if cell.ratio < 99.5 else f"{cell.ratio:.0f}") + star


def _size(cells: Sequence[Cell], label: str, family: str, printer: str) -> str:
    means = []
    for severity in SEVERITIES:
        wanted = (label, family, severity, printer)
        values = [
            cell.rmse_steps
            for cell in cells
            if (cell.label, cell.family, cell.severity, cell.printer) == wanted and cell.rmse_steps is not None
        ]
        if values:
            mean = sum(values) / len(values)
            means.append(f"{mean:.2f}" if mean < 99.5 else f"{mean:.0f}")
    return " / ".join(means) or "–"
