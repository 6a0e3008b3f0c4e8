"""An effect with its sizes, and how it changes a machine: shifts of a belt, a frame."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from printmend.effects import EFFECTS, Acts, Of, Places, Scene
from printmend.effects.effect import MOST_LAYERS, TINY_MM, Key, at_places, belt_places, held_mm
from printmend.effects.words import along_motor_mm
from printmend.errors import ConfigError
from printmend.filament import material_of
from printmend.machine import Frame, Mechanism, ScrewDrive, Transmission, share_behind, z_grid_mm
from printmend.machine.kernels.bed import MOST_WAVES, WAVE_FIELDS
from printmend.messages import say
from printmend.path import PAPER_SD, RESIZED
from printmend.printer import Printer

CHUNK_ROWS = 2048  # that are evaluated at once: their columns stay in the processor's cache


@dataclass(frozen=True, eq=False)
class Sized:
    """An effect at one place with one shape and its ``sizes_mm`` [P]."""

    effect: str
    where: int
    shape: tuple[float, ...]
    sizes_mm: np.ndarray

    @property
    def key(self) -> Key:
        return self.effect, self.where, self.shape

    @property
    def is_held(self) -> bool:
        """Say whether the tables and the frame of a machine hold it; other effects act along the path."""
        effect = EFFECTS[self.effect]
        is_held = effect.acts is not Acts.NOT and np.array_equal(held_mm(effect, self.sizes_mm), self.sizes_mm)
        return effect.of is Of.MACHINE and is_held and effect.from_home

    def moved_mm(self, places: Places, scene: Scene) -> np.ndarray:
        """Return how far it moves places [N, 2] on the bed, without subtracting the error at home."""
        return np.asarray(EFFECTS[self.effect].columns(places, self.where, self.shape, scene) @ self.sizes_mm)

    def of(self, **changed: Any) -> "Sized":
        """Return this effect with another shape, or other sizes."""
        return replace(self, **changed)


def scene_of_printer(printer: Printer, way_mm: float = 1.0) -> Scene:
    """Return the scene of a whole printer: all of its bed, and any instrument."""
    spans = [printer.motor_range_mm(motor) for motor in range(2)]
    bed = [(axis.min_mm, axis.max_mm) for axis in printer.axes[:2]]
    return Scene(
        printer, printer.mm_per_turn, (spans[0], spans[1]), (bed[0], bed[1]), way_mm, homed=True,
        instrument=replace(RESIZED, paper_sd=PAPER_SD), walls=True, shrinkage_sd=material_of("petg").sd,
        layers=(printer.z.min_mm, printer.z.max_mm, MOST_LAYERS), step_mm=0.1,
    )  # fmt: skip


def belts_mm(scene: Scene, motor: int, parts: Sequence[Sized], motor_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return how far parts of a drive move its belt [N] from a healthy one's place: pushed forwards, and pulled
    back."""
    few = along_motor_mm(scene, motor)
    if np.array_equal(_belt_mm(scene, motor, parts, few, -1.0), _belt_mm(scene, motor, parts, few, 1.0)):
        taut = _belt_mm(scene, motor, parts, motor_mm, 1.0)  # no side is read: once is enough
        return taut, taut
    return _belt_mm(scene, motor, parts, motor_mm, -1.0), _belt_mm(scene, motor, parts, motor_mm, 1.0)


def _belt_mm(scene: Scene, motor: int, parts: Sequence[Sized], motor_mm: np.ndarray, side: float) -> np.ndarray:
    moved = np.zeros(len(motor_mm))
    for first in range(0, len(motor_mm), CHUNK_ROWS):
        at = motor_mm[first : first + CHUNK_ROWS]
        places = belt_places(motor, at, side)
        for part in parts:
            moved[first : first + CHUNK_ROWS] += scene.printer.to_motor(part.moved_mm(places, scene))[:, motor]
    return moved


def frame_of(scene: Scene, parts: Sequence[Sized]) -> Frame:
    """Return the frame of these parts: its polynomials, and its waves for each guide."""
    held = [part for part in parts if EFFECTS[part.effect].acts is Acts.FRAME]
    waves = [_waves(scene, part) for part in parts if EFFECTS[part.effect].acts is Acts.WAVE]
    coefficients = np.zeros((2, 10))
    if held:
        every = np.max(Frame.exponents) + 1  # a polynomial is known by one more place than its highest power
        x, y = (np.linspace(axis.min_mm, axis.max_mm, every) for axis in scene.printer.axes[:2])
        bed = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        places = at_places(bed_mm=bed)
        moved = sum(part.moved_mm(places, scene) for part in held)
        coefficients = np.linalg.lstsq(Frame().terms(bed), np.asarray(moved), rcond=None)[0].T
        coefficients[np.abs(coefficients) < TINY_MM] = 0.0
    return Frame(coefficients, waves=few_waves(np.vstack([np.zeros((0, WAVE_FIELDS)), *waves])))


def _waves(scene: Scene, part: Sized) -> np.ndarray:
    """Return an effect's waves as rows [K, 6] of `Frame.waves`; that of a guide is one."""
    effect = EFFECTS[part.effect]
    if hasattr(effect, "rows"):
        return np.asarray(effect.rows(part.where, part.shape, part.sizes_mm))
    across, along = part.sizes_mm[:2], part.sizes_mm[2:] if len(part.sizes_mm) > 2 else np.zeros(2)
    x, y = (along, across) if part.where == 0 else (across, along)
    return np.array([[float(part.where), part.shape[0], *x, *y]])


def few_waves(rows: np.ndarray) -> np.ndarray:
    """Return rows of waves [K, 6], equal ones merged; if a frame has no room for all, the largest.

    Waves too short for the process are left out: over a short span its cosines are shorter than any that it can have.
    """
    rows = rows[np.abs(rows[:, 2:]).max(axis=1, initial=0.0) > TINY_MM]
    kinds, which = np.unique(rows[:, :2], axis=0, return_inverse=True)
    if len(kinds) < len(rows) > MOST_WAVES:
        sizes = np.zeros((len(kinds), 4))
        np.add.at(sizes, which.ravel(), rows[:, 2:])
        rows = np.hstack([kinds, sizes])
    largest = np.argsort(-np.square(rows[:, 2:]).sum(axis=1), kind="stable")[:MOST_WAVES]
    return rows[np.sort(largest)]


def with_effects(mechanism: Mechanism, parts: Sequence[Sized]) -> Mechanism:
    """Return a machine with those of the parts that its tables and its frame hold.

    Play is never negative. Raises `ConfigError` if the parts together turn a drive back.
    """
    held = [part for part in parts if part.is_held]
    a, b = (_beside(table, mechanism.printer, motor, held) for motor, table in enumerate(mechanism.transmissions))
    frame, screw = _framed(mechanism.frame, mechanism.printer, held), _pushing(mechanism, held)
    return replace(mechanism, transmissions=(a, b), frame=frame, screw=screw)


def _pushing(mechanism: Mechanism, parts: list[Sized]) -> ScrewDrive | None:
    """Return the Z screw with the effects that push the layers aside."""
    mine = [part for part in parts if EFFECTS[part.effect].acts is Acts.SCREW]
    if not mine:
        return mechanism.screw
    grid, first_mm, pitch_mm = z_grid_mm(mechanism.printer)
    screw = mechanism.screw or ScrewDrive(Transmission(first_mm, pitch_mm, grid, grid), np.zeros((len(grid), 2)))
    return replace(screw, wobble_mm=screw.wobble_mm + pushed_mm(scene_of_printer(mechanism.printer), mine, grid))


def pushed_mm(scene: Scene, parts: Sequence[Sized], z_mm: np.ndarray) -> np.ndarray:
    """Return how far effects of the Z screw push the nozzle [N, 2] at heights [N]."""
    places = at_places(z_mm=z_mm)
    return sum((each.moved_mm(places, scene) for each in parts), np.zeros((len(z_mm), 2)))


def _beside(table: Transmission, printer: Printer, motor: int, parts: list[Sized]) -> Transmission:
    """Return a drive's tables with the effects of this motor in them. Play is never negative."""
    mine = [part for part in parts if EFFECTS[part.effect].acts is Acts.DRIVE and part.where == motor]
    if not mine:
        return table
    scene, grid = scene_of_printer(printer), table.motor_mm
    pushed, pulled = belts_mm(scene, motor, mine, grid)
    lower, upper = table.lower_mm + pushed, table.upper_mm + pulled
    middle = (lower + upper) / 2
    lower, upper = np.where(lower > upper, middle, lower), np.where(lower > upper, middle, upper)
    if min(np.diff(lower).min(), np.diff(upper).min()) < -1e-9:
        raise ConfigError(
            say("subject-effects-of-motor", printer.motors[motor]), wanted=say("effects-under-which-drive-still-moves"),
            came=say("some-turn-back-together"), todo=say("make-them-smaller"),
        )  # fmt: skip
    return replace(table, lower_mm=np.maximum.accumulate(lower), upper_mm=np.maximum.accumulate(upper))


def _framed(frame: Frame, printer: Printer, parts: list[Sized]) -> Frame:
    """Return a frame with the effects of the frame added to it."""
    mine = [part for part in parts if EFFECTS[part.effect].acts in (Acts.FRAME, Acts.WAVE)]
    if not mine:
        return frame
    more = frame_of(scene_of_printer(printer), mine)
    coefficients, home = frame.coefficients_mm + more.coefficients_mm, np.array([printer.home_mm], float)
    coefficients[:, Frame.exponents.index((0, 0))] -= (more.apply(home) - home)[0]  # the end stops put it right
    return Frame(coefficients, frame.scale_mm, few_waves(np.concatenate([frame.waves, more.waves])))


def guided(places: Places, path_mm: np.ndarray, parts: Sequence[Sized]) -> Places:
    """Return the places of a path [N, 2] whose ways are those of the head: where a guide has play, a short move back
    does not turn its way round."""
    lags = [part for part in parts if part.effect == "lag" and part.sizes_mm[0] > 0]
    if not lags:
        return places
    ways = places.ways.astype(float)
    for part in lags:
        ways[:, part.where] = share_behind(path_mm[:, part.where], float(part.sizes_mm[0]))
    return replace(places, ways=ways)
