"""An effect with its sizes, and what it does to a machine: shifts of a belt, a frame."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from printmend.effects import EFFECTS, Acts, Of, Places, Scene
from printmend.machine import Frame
from printmend.path import FLATBED
from printmend.printer import Printer

GRID = 7  # places along either axis of the bed at which a frame's terms are taken


@dataclass(frozen=True, eq=False)
class Sized:
    """An effect at one place with one shape and its ``sizes_mm`` [P]."""

    effect: str
    where: int
    shape: tuple[float, ...]
    sizes_mm: np.ndarray

    @property
    def key(self) -> tuple[str, int, tuple[float, ...]]:
        return self.effect, self.where, self.shape

    @property
    def is_held(self) -> bool:
        """Say whether the tables and the frame of a machine hold it: what they do not hold acts along the path."""
        effect = EFFECTS[self.effect]
        return effect.of is Of.MACHINE and effect.acts is not Acts.NOT and effect.from_home

    def of(self, **changed: Any) -> "Sized":
        """Return this effect with another shape, or other sizes."""
        return replace(self, **changed)


def scene_of_printer(printer: Printer, way_mm: float = 1.0) -> Scene:
    """Return the scene in which an effect of a whole printer is written down: all of its bed, and any instrument."""
    spans = [printer.motor_range_mm(motor) for motor in range(2)]
    bed = [(axis.min_mm, axis.max_mm) for axis in printer.axes[:2]]
    turns = (printer.axes[0].mm_per_turn, printer.axes[1].mm_per_turn)
    return Scene(
        printer, turns, (spans[0], spans[1]), (bed[0], bed[1]), way_mm, homed=True, instrument=FLATBED, walls=True
    )


def belt_mm(scene: Scene, motor: int, parts: Sequence[Sized], motor_mm: np.ndarray, side: float) -> np.ndarray:
    """Return where parts of a drive put its belt [N] beyond a healthy one, on one side of the play."""
    count = len(motor_mm)
    motors, sides = np.zeros((count, 2)), np.zeros((count, 2))
    motors[:, motor], sides[:, motor] = motor_mm, side
    none = np.zeros((count, 2))
    places = Places(motors, sides, none, none, none, np.ones(count), np.zeros(count), none)  # as the print ended
    moved = np.zeros(count)
    for part in parts:
        on_bed = EFFECTS[part.effect].columns(places, part.where, part.shape, scene) @ part.sizes_mm
        moved = moved + np.asarray(scene.printer.to_motor(on_bed)[:, motor])
    return moved


def frame_of(scene: Scene, parts: Sequence[Sized]) -> Frame:
    """Return the frame that these parts make: its polynomials, and a row of its waves for each guide."""
    held = [part for part in parts if EFFECTS[part.effect].acts is Acts.FRAME]
    waves = [_wave(scene, part) for part in parts if EFFECTS[part.effect].acts is Acts.WAVE]
    coefficients = np.zeros((2, 10))
    if held:
        x, y = (np.linspace(axis.min_mm, axis.max_mm, GRID) for axis in scene.printer.axes[:2])
        bed = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        none = np.zeros_like(bed)
        places = Places(none, none, bed, none, none, np.zeros(len(bed)), np.zeros(len(bed)), none)
        moved = sum(
            EFFECTS[part.effect].columns(places, part.where, part.shape, scene) @ part.sizes_mm for part in held
        )
        coefficients = np.linalg.lstsq(Frame().terms(bed), np.asarray(moved), rcond=None)[0].T
        coefficients[np.abs(coefficients) < 1e-9] = 0.0
    return Frame(coefficients, waves=np.array(waves).reshape(-1, 6))


def _wave(scene: Scene, part: Sized) -> list[float]:
    """Return a guide's wave as a row of `Frame.waves`."""
    across, along = part.sizes_mm[:2], part.sizes_mm[2:] if len(part.sizes_mm) > 2 else np.zeros(2)
    x, y = (along, across) if part.where == 0 else (across, along)
    return [float(part.where), part.shape[0], *x.tolist(), *y.tolist()]
