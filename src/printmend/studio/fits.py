"""The job that checks whether a part fits: it takes scans of its sides and its file, and returns sizes and settings."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from printmend.mend.part import PartMeasurement
    from printmend.studio.work import Job


def fit(job: "Job", path: Path, sides: Sequence[Path]) -> dict[str, Any]:
    """Return a part's sizes, from scans of its ``sides``, and settings for its slicer; keep the trace of its walls, to
    learn from."""
    from printmend.fit import SLICERS, write_profiles
    from printmend.measure import write_trace
    from printmend.measure.distance import is_asking
    from printmend.mend.fit import fits, measured_part
    from printmend.model import read_model
    from printmend.printer import read_printer
    from printmend.studio.work import MODEL, PRINTER

    printer, model_path = read_printer(job.printer_folder / PRINTER), job.printer_folder / MODEL
    model = read_model(model_path) if model_path.is_file() else None
    job.tell(0.1, "measure")
    measured = measured_part(
        sides[0], path, printer, top=sides[1] if len(sides) > 1 else None, dpi=job.params.get("dpi"),
        distances_mm=job.params["distances_mm"],
    )  # fmt: skip
    job.tell(0.8, "compare")
    found = fits(measured, path, printer, model, job.params.get("filament"))
    write_trace(job.file("trace.csv"), measured[0][1].trace)
    for written in write_profiles(job.folder, found.settings, found.file, found.json()):
        job.file(written.name)
    return {
        "numbers": found.json(), "slicers": {name: one.title for name, one in SLICERS.items()},
        "slicer": found.file.maker if found.file.maker in SLICERS else None,
        "asked": _asked(measured[0][1]) if any(map(is_asking, found.notes)) else [],
    }  # fmt: skip


def _asked(measured: "PartMeasurement") -> list[dict[str, float]]:
    """Return the widths that callipers may settle: each one's direction from X, and its approximate length."""
    import numpy as np

    from printmend.measure.distance import choose_widths

    walls = measured.walls
    edge_mm = walls.commanded_mm[walls.row] + walls.half_mm[:, None] * walls.normal
    return [
        {"degrees": round(float(np.degrees(width.angle_rad))), "about_mm": round(width.across_mm(edge_mm), 1)}
        for width in choose_widths(walls)
    ]
