"""The section ``promise`` of a model file: the posterior of the printer, as drawn machines.

Each part of the section is one effect at one place: the sizes that act, and those of the drawn machines that have it.
"""

from collections.abc import Sequence
from dataclasses import asdict, astuple, dataclass
from typing import Any

import numpy as np

from printmend.effects import EFFECTS, Of, Scene, columns_of
from printmend.effects.effect import FEW_LAYERS, GONE, MOST_LAYERS, at_places
from printmend.errors import ModelError
from printmend.infer.machine import DRAWS, Part
from printmend.messages import say
from printmend.model import SavedModel
from printmend.model.branches import number, numbers, refuse, section_of
from printmend.path import Motion
from printmend.promise.filament import MOST, known_filaments, scale_cause
from printmend.promise.scatter import NO_OUTLIERS, NO_SCATTER, Outliers, Scatter

VERSION = 2  # of the model file's section
_SUBJECT = "the model [promise]"
_DIGITS = 5  # that are kept of a size


@dataclass(frozen=True, eq=False)
class Belief:
    """Machines drawn from the posterior of a measurement.

    ``scene`` is what was measured, ``parts`` the effects that any drawn machine has; ``scatter`` by how much marks
    scatter beyond what their instrument says, along one coordinate, ``outliers`` those that fit no model. ``placed``:
    the measurement says where on the bed things lie; else errors are counted from home. ``by_hand``: a few distances
    were measured, and most is assumed. ``motion`` is what lines at speed showed, None where none were measured.
    ``scale_cause`` names what leaves the scale open where no place was measured.
    """

    scene: Scene
    parts: tuple[Part, ...]
    placed: bool
    scatter: Scatter = NO_SCATTER
    outliers: Outliers = NO_OUTLIERS
    by_hand: bool = False
    motion: Motion | None = None
    scale_cause: str = "instrument"

    def of(self, effect: str, where: int | None = None) -> tuple[Part, ...]:
        """Return the parts of one effect, at one place where that is given."""
        return tuple(part for part in self.parts if part.effect == effect and where in (None, part.where))


def belief_section(
    scene: Scene,
    parts: Sequence[Part],
    *,
    scatter: Scatter = NO_SCATTER,
    outliers: Outliers = NO_OUTLIERS,
    by_hand: bool = False,
    motion: Motion | None = None,
) -> dict[str, Any]:
    """Return drawn machines as plain values; what surely an instrument did is no part of any print."""
    there = [part for part in parts if part.acts_mm.any() or part.draws_mm.any()]
    kept = [part for part in there if EFFECTS[part.effect].of is not Of.INSTRUMENT or EFFECTS[part.effect].fate != GONE]
    return {
        "version": VERSION,
        "placed": scene.placed,
        "homed": scene.homed,
        "instrument": asdict(scene.instrument),
        "scatter_mm2": [float(f"{value:.4g}") for value in astuple(scatter)],
        **({"outliers": [float(f"{value:.4g}") for value in astuple(outliers)]} if outliers.count else {}),
        **({"by_hand": True} if by_hand else {}),
        **({} if motion is None else {"motion_mm2": [float(f"{value:.4g}") for value in astuple(motion)]}),
        "turns_mm": list(scene.turns_mm),
        "motor_span_mm": [list(each) for each in scene.motor_span_mm],
        "bed_span_mm": [list(each) for each in scene.bed_span_mm],
        "way_mm": round(scene.way_mm, 3),
        **({"layers": list(scene.layers)} if scene.layers else {}),
        **({"homed_again_mm": [list(each) for each in scene.homed_again_mm]} if scene.homed_again_mm else {}),
        "parts": [_part_section(part) for part in kept],
    }


def _part_section(part: Part) -> dict[str, Any]:
    there = np.flatnonzero(part.draws_mm.any(axis=0))
    rows = part.draws_mm[:, there]
    every = len(there) == part.draws_mm.shape[1]
    return {
        "effect": part.effect,
        "where": part.where,
        "shape": [float(f"{value:.8g}") for value in part.shape],
        "acts": [float(f"{value:.9g}") for value in part.acts_mm],
        **({} if every else {"there": there.tolist()}),
        "draws": [[float(f"{value:.{_DIGITS}g}") for value in row] for row in rows],
    }


def parse_belief(model: SavedModel) -> Belief | None:
    """Return what a saved model says about its own doubt, None for one that says nothing.

    Raises `ModelError` for a section that is none of ours.
    """
    section = model.document.get("promise")
    if section is None:
        return None
    if not isinstance(section, dict) or section.get("version") != VERSION:
        refuse(_SUBJECT, say("section-version", VERSION), say("another"))
    spans = {name: _spans(section, name) for name in ("motor_span_mm", "bed_span_mm")}
    turns = numbers(section, "turns_mm", _SUBJECT, 2)
    way_mm = number(section, "way_mm", _SUBJECT, 1e9)
    if len(turns) != 2 or turns.min() <= 0 or way_mm < 0:
        refuse(_SUBJECT, say("two-positive-turns-mm-way-mm"), say("something-else"))
    placed = bool(section.get("placed"))
    scene = Scene(
        model.printer, (float(turns[0]), float(turns[1])), spans["motor_span_mm"], spans["bed_span_mm"], way_mm, placed,
        bool(section.get("homed")), homed_again_mm=_shifts(section), layers=_layers(section),
    )  # fmt: skip
    rows = section_of(section, "parts", list, _SUBJECT)
    if len(rows) > MOST:
        refuse(_SUBJECT, say("most-parts", MOST), f"{len(rows)}")
    parts = tuple(_part(row, scene) for row in rows)
    if model.filament is not None:
        parts = (*parts, *known_filaments(model)[model.filament])
    return Belief(
        scene, parts, placed, _scatter(section), _outliers(section), bool(section.get("by_hand")), _motion(section),
        scale_cause(model),
    )  # fmt: skip


def belief_of(model: SavedModel) -> Belief:
    """Return what a saved model says about its own doubt. Raises `ModelError` for one that says nothing."""
    belief = parse_belief(model)
    if belief is None:
        raise says_nothing()
    return belief


def says_nothing() -> ModelError:
    """Return the refusal of a model that cannot be brought up to date."""
    return ModelError(
        say("subject-model"), wanted=say("one-says-what-does-not-know"), came=say("one-older-printmend-learner"),
        todo=say("learn-again-from-trace"),
    )  # fmt: skip


def _scatter(section: dict[str, Any]) -> Scatter:
    if "scatter_mm2" not in section:  # files of older versions have a size alone
        return Scatter(number(section, "scatter_mm", _SUBJECT) ** 2)
    values = numbers(section, "scatter_mm2", _SUBJECT, 2)
    if len(values) != 2 or values[1] < 0:
        refuse(_SUBJECT, say("scatter-mm2-square-deviation"), say("something-else"))
    return Scatter(float(values[0]), float(values[1]))


def _outliers(section: dict[str, Any]) -> Outliers:
    if "outliers" not in section:
        return NO_OUTLIERS
    values = numbers(section, "outliers", _SUBJECT, 3)
    if len(values) != 3 or values.min() < 0 or values[0] > values[1]:
        refuse(_SUBJECT, say("outliers-count-marks-square"), say("something-else"))
    return Outliers(int(values[0]), int(values[1]), float(values[2]))


def _motion(section: dict[str, Any]) -> Motion | None:
    if "motion_mm2" not in section:
        return None
    values = numbers(section, "motion_mm2", _SUBJECT, 2)
    if len(values) != 2 or values[1] <= 0:
        refuse(_SUBJECT, say("motion-mm2-square-deviation-above-0"), say("something-else"))
    return Motion(float(values[0]), float(values[1]))


def _pairs(rows: list[Any]) -> list[np.ndarray]:
    return [numbers({"row": row}, "row", _SUBJECT, 2) for row in rows]


def _spans(section: dict[str, Any], name: str) -> tuple[tuple[float, float], tuple[float, float]]:
    rows = _pairs(section_of(section, name, list, _SUBJECT))
    if len(rows) != 2 or any(len(row) != 2 or row[0] > row[1] for row in rows):
        refuse(_SUBJECT, say("two-rising-pairs", name), say("something-else"))
    return (float(rows[0][0]), float(rows[0][1])), (float(rows[1][0]), float(rows[1][1]))


def _shifts(section: dict[str, Any]) -> tuple[tuple[float, float], ...]:
    rows = _pairs(section.get("homed_again_mm", [])[:MOST])
    if any(len(row) != 2 for row in rows):
        refuse(_SUBJECT, say("homed-again-mm-pairs-shift-deviation"), say("something-else"))
    return tuple((float(row[0]), abs(float(row[1]))) for row in rows)


def _layers(section: dict[str, Any]) -> tuple[float, ...]:
    layers = numbers(section, "layers", _SUBJECT, 3) if "layers" in section else np.zeros(0)
    if len(layers) and (len(layers) != 3 or layers[0] >= layers[1] or not FEW_LAYERS <= layers[2] <= MOST_LAYERS):
        refuse(_SUBJECT, "layers as the lowest, the highest and how many", say("something-else"))
    return tuple(layers.tolist())


def _part(row: Any, scene: Scene) -> Part:
    name = str(row.get("effect")) if isinstance(row, dict) else ""
    if name not in EFFECTS:
        todo = say("install-effect-or-learn-again")
        raise ModelError(_SUBJECT, wanted=say("parts-known-effects"), came=repr(name[:40]), todo=todo)
    where = number(row, "where", _SUBJECT)
    shape = numbers(row, "shape", _SUBJECT, 8)
    acts = numbers(row, "acts", _SUBJECT, MOST)
    drawn = section_of(row, "draws", list, _SUBJECT)
    there = np.arange(DRAWS) if "there" not in row else numbers(row, "there", _SUBJECT, DRAWS).astype(int)
    if where not in (0, 1, 2, 3) or len(drawn) != len(acts) or (there < 0).any() or (there >= DRAWS).any():
        refuse(_SUBJECT, say("parts-place-sizes-each-draw"), say("something-else"))
    draws = np.zeros((len(acts), DRAWS))
    for at, each in enumerate(drawn):
        values = numbers({"row": each}, "row", _SUBJECT, DRAWS)
        if len(values) != len(there):
            refuse(_SUBJECT, say("draws-each-size", len(there)), f"{len(values)}")
        draws[at, there] = values
    part = Part(name, int(where), tuple(shape.tolist()), acts, draws)
    if _width_of(part, scene) != len(acts):
        refuse(_SUBJECT, say("sizes", part.effect), say("numbers-shape-no-printer-has", len(acts)))
    return part


def _width_of(part: Part, scene: Scene) -> int:
    """Return how many sizes an effect has at a place and with a shape, −1 where it has no such place or shape."""
    place = at_places(bed_mm=np.zeros((1, 2)))
    try:
        with np.errstate(all="raise", under="ignore"):
            columns = columns_of(part.effect, place, part.where, part.shape, scene)
    except (ArithmeticError, IndexError, TypeError, ValueError):
        return -1
    return columns.shape[2] if np.isfinite(columns).all() else -1
