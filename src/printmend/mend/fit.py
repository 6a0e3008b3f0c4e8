"""Do the work of `printmend fit`: from scans of a part and its file to sizes and slicer settings."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from printmend.effects.effect import SCALE_MM
from printmend.filament import material_of
from printmend.fit import (
    SLICERS,
    Estimate,
    Known,
    Layer,
    Setting,
    estimated,
    fit_json,
    fit_sizes,
    fit_words,
    outline_of,
    settings_for,
)
from printmend.fit.setting import Wanted, wanted
from printmend.gcode.container import open_gcode
from printmend.gcode.read import read_gcode
from printmend.gcode.sliced import Sliced, sliced
from printmend.mend.part import PartMeasurement, measure_part
from printmend.messages import Tell, say
from printmend.model import SavedModel
from printmend.printer import Printer
from printmend.promise.belief import parse_belief
from printmend.promise.filament import known_filaments
from printmend.promise.words import axis_scales
from printmend.twin import Twin

LEAST_TALL_MM = 8.0  # the foot of a part this tall lies in the dark while its top is scanned
LOW = "part-is-low"  # message: the foot may show beside the top


@dataclass(frozen=True, eq=False)
class Fits:
    """The result for a part: the estimate, the file's own settings, the corrections, and each slicer's settings."""

    estimate: Estimate
    file: Sliced
    corrections: Wanted
    settings: dict[str, tuple[Setting, ...]]
    filament: str | None
    height_mm: float
    notes: tuple[str, ...]

    def words(self, slicers: Sequence[str] | None = None) -> list[str]:
        """Return the report for a terminal."""
        return fit_words(
            self.estimate, self.file, self.corrections, self.settings, filament=self.filament,
            height_mm=self.height_mm, slicers=slicers,
        )  # fmt: skip

    def sizes(self) -> list[str]:
        """Return lines about sizes that came out too small or too large, and how to see the rest."""
        return fit_sizes(self.estimate, self.file, self.corrections)

    def json(self) -> dict[str, Any]:
        """Return all numbers for programs."""
        return fit_json(self.estimate, self.file, self.corrections, self.settings, self.filament)


Measured = Sequence[tuple[int, PartMeasurement]]  # layers of a part, each with its number, from 1


def measured_part(
    scan: str | Path, path: str | Path, printer: Printer, *, layer: int = 1, top: str | Path | None = None,
    dpi: float | None = None, distances_mm: Sequence[float] = (), overlay: Path | None = None,
    tell: Tell = str,
) -> Measured:  # fmt: skip
    """Measure a part from a scan of its underside (or of the side that shows ``layer``), and from one of its ``top``.
    Raises like `measure_part`."""
    program = read_gcode(path, printer=printer)
    first = measure_part(
        scan, program, printer, layer=layer, dpi=dpi, distances_mm=distances_mm, overlay=overlay, tell=tell
    )
    if top is None:
        return [(layer, first)]
    last = first.walls.layers
    above = measure_part(top, program, printer, layer=last, dpi=dpi)
    return [(layer, first), (last, above.also_mapped(first.onto))]


def fits(
    measured: Measured, path: str | Path, printer: Printer, model: SavedModel | None, filament: str | None
) -> Fits:
    """Return the sizes and settings that a file's measured layers suggest. Raises `ConfigError` for a filament of an
    unknown polymer."""
    with open_gcode(path) as opened:
        file = sliced(*opened.parts[0].hints())
    twin = None if model is None else Twin(model.mechanism)
    layers = []
    for number, each in measured:
        path_mm = each.walls.commanded_mm
        off_mm = None if twin is None else twin.follow(path_mm) - path_mm
        layers.append(Layer(number, each.walls, outline_of(each.walls), each.stands_mm, off_mm))
    estimate = estimated(layers, printer, measured[0][1].trace.instrument, _known(model, filament))
    corrections = wanted(estimate, file)
    settings = {name: settings_for(slicer, corrections, file) for name, slicer in SLICERS.items()}
    notes = list(measured[0][1].notes)
    if len(layers) > 1 and layers[1].walls.tall_mm < LEAST_TALL_MM:
        notes.append(say(LOW, f"{layers[1].walls.tall_mm:.1f}"))
    return Fits(estimate, file, corrections, settings, filament, layers[0].walls.height_mm, tuple(notes))


def _known(model: SavedModel | None, filament: str | None) -> Known:
    """Return the prior for a part's scale, beyond the scale error of the model's machine."""
    plain = Known()
    machine_sd = np.full(2, 0.002)
    if model is not None:
        belief = parse_belief(model)
        machine_sd = (
            np.zeros(2) if belief is None else axis_scales(belief.scene, belief.parts)[1].std(axis=-1) + np.zeros(2)
        )
        if filament in (known := known_filaments(model)):
            parts = known[filament]
            means = [-float(part.acts_mm[0]) / SCALE_MM for part in parts]
            sds = [float(part.draws_mm.std()) / SCALE_MM for part in parts]
            return Known((means[0], means[1]), (sds[0], sds[1]))
    mean, own = (plain.mean[0], 0.004) if filament is None else (-material_of(filament).mean, material_of(filament).sd)
    sd = np.hypot(own, machine_sd)
    return Known((mean, mean), (float(sd[0]), float(sd[1])))
