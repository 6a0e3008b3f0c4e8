"""The continuous planner: find the motor commands that make a broken machine, as its model describes it, draw right."""

from dataclasses import dataclass, field

import numpy as np

from printmend.gcode.kernels import PIECE
from printmend.gcode.machine import Flavour
from printmend.gcode.write import PLANS_AT_ONCE
from printmend.jit import record
from printmend.machine import Mechanism, ScrewDrive, Transmission
from printmend.plan.kernels import layout as k
from printmend.plan.kernels import lookup as look
from printmend.plan.kernels.curve import CURVE
from printmend.plan.kernels.layout import TOLERANCE_MM
from printmend.plan.kernels.lookup import COARSEST_MM, SPARE
from printmend.plan.kernels.mend import mend

# How finely to draw a path: how far it may be off, and how many moves a second the firmware can plan.

SEGMENTS_PER_S = {
    "marlin8": 100.0,
    "marlin32": 1000.0,
    "klipper": 2000.0,
    "rrf": 1000.0,
    "prusa": 500.0,
    "bambu": 1000.0,
}
"""Moves a second that a firmware can surely plan, from its card or from a host; cautious values of ours."""
_OF_FLAVOUR = {
    Flavour.MARLIN1: "marlin8", Flavour.MARLIN2: "marlin32", Flavour.KLIPPER: "klipper", Flavour.RRF: "rrf",
    Flavour.PRUSA: "prusa", Flavour.UNKNOWN: "marlin32",
}  # fmt: skip


@dataclass(frozen=True)
class Fineness:
    """How far the path may be off, and which firmware reads the file.

    A chord may bulge by half of ``tolerance_mm``; a short chord, or one on which slack is crossed, by all of it.
    ``firmware`` is a key of `SEGMENTS_PER_S`; None guesses it from each file. ``slower`` is the largest share by which
    the print may take longer, None for no limit. To keep this limit, lines are drawn coarser by the factor ``ease``,
    each role up to its `SPARE`. ``crossing_mm_s2`` is the acceleration of a motor that crosses its slack; None takes
    the one in the printer's file.
    """

    tolerance_mm: float = TOLERANCE_MM
    firmware: str | None = None
    slower: float | None = None
    crossing_mm_s2: float | None = None
    ease: float = 0.0

    @property
    def most_ease(self) -> float:
        """The smallest ease at which every line is as coarse as its role allows."""
        return max(COARSEST_MM / self.tolerance_mm - 1.0, 0.0) / min(filter(None, SPARE))

    def segments_per_s(self, flavour: Flavour) -> float:
        """Return how many moves a second a file of that ``flavour`` may have."""
        return SEGMENTS_PER_S[self.firmware or _OF_FLAVOUR[flavour]]


_QUANTUM_MM = 0.001  # resolution of the written numbers
_PIECES = 49152  # pieces planned at once, besides the last record's
_SAME_MM = 1e-7  # tables that differ by less are the same: saved tables are rounded to 1e-9 mm
_RISE_LOOK_MM = 0.05  # a screw's curvature is measured over this distance
_BEND_REACH_MM = 0.05  # curvature is measured over this distance: finer structure moves nothing by a micrometre


def lookup(mechanism: Mechanism, tolerance_mm: float = k.TOLERANCE_MM) -> look.Model:
    """Return a mechanism as the compiled planner reads it (`kernels.lookup` says what its numbers mean).

    The origin is used as it is: call `Mechanism.homed` first if homing defines it. ``tolerance_mm`` is how far the
    printed path may be from the target: half of it where a chord bulges, all of it where slack is crossed.
    """
    printer, frame = mechanism.printer, mechanism.frame
    head = record(look.HEAD)
    head.bed[:] = printer.x.min_mm, printer.x.max_mm, printer.y.min_mm, printer.y.max_mm
    head.shifts_only = frame.is_identity and all(map(_shifts_only, mechanism.transmissions))
    head.frame_bend = _frame_bend(mechanism)
    head.bed_map = frame.bed_map(corexy=printer.kinematics == "corexy").record
    head.home[:] = printer.home_mm
    head.home_side[:] = printer.x.home_direction, printer.y.home_direction
    head.chord = chord_mm = tolerance_mm / 2
    parts: list[np.ndarray] = []
    size, sharpest = 0, 0.0
    screw = None if mechanism.screw is None or _is_straight(mechanism.screw) else mechanism.screw
    for motor, t in enumerate((*mechanism.transmissions, *([] if screw is None else [screw.transmission]))):
        bend = _bend(t)
        if motor < 2:
            sharpest, head.bent = max(sharpest, bend.max()), max(head.bent, bend.mean())
        head.first[motor], head.rate[motor], head.last[motor] = t.first_mm, 1.0 / t.pitch_mm, len(t.lower_mm) - 1
        head.bend[motor], head.bend_last[motor], head.taut[motor] = size, len(bend) - 1, t.is_taut
        parts.append(bend)
        size += len(bend)
        for branch, table in enumerate((t.lower_mm, t.upper_mm)):
            steps = np.arange(int((table[-1] - table[0]) / t.pitch_mm) + 2)
            guide = np.searchsorted(table, table[0] + steps * t.pitch_mm)
            head.table[motor, branch], head.floor[motor, branch] = size, table[0]
            head.guide[motor, branch] = size + len(table)
            parts += [table, np.minimum(guide, len(table) - 1)]
            size += len(table) + len(guide)
    if screw is not None:
        z = printer.z
        head.screw, head.rise = 1.0, _rise_mm(screw, chord_mm)
        head.z_limits[:] = z.min_mm, z.max_mm
        head.z_home, head.z_home_side = z.home_mm, z.home_direction
        head.push[:] = size, size + len(screw.wobble_mm)
        parts += [*screw.wobble_mm.T]
    # Between two samples, a parabola of the sharpest curvature deviates by a quarter of the chord's tolerance.
    head.sample = np.clip(np.sqrt(2.0 * chord_mm / max(sharpest, 1e-12)), 0.02, 2.0)
    head.look = np.clip(5.0 * head.sample, k.FINEST_SAMPLE_MM, k.SAMPLE_MM)
    model = look.Model(head, np.concatenate(parts))
    look.set_chords(model, tolerance_mm, 0.0)
    return model


def _bend(t: Transmission) -> np.ndarray:
    """Return the largest curvature [1/mm] of either branch in each block of entries."""
    reach = max(1, round(_BEND_REACH_MM / t.pitch_mm))
    curvature = np.zeros(len(t.lower_mm))
    for table in (t.lower_mm, t.upper_mm):
        if len(table) > 2 * reach:
            second = table[2 * reach :] - 2 * table[reach:-reach] + table[: -2 * reach]
            inner = np.abs(second) / (reach * t.pitch_mm) ** 2
            curvature[reach:-reach] = np.maximum(curvature[reach:-reach], inner)
    curvature[curvature < 1e-6] = 0.0  # saved tables are rounded to a nanometre
    blocks = -(-len(curvature) // look.BEND_BLOCK)
    padded = np.zeros(blocks * look.BEND_BLOCK)
    padded[: len(curvature)] = curvature
    most = padded.reshape(blocks, look.BEND_BLOCK).max(axis=1)
    # A block's border counts for the blocks on both sides.
    return np.maximum(most, np.maximum(np.append(most[1:], 0.0), np.append(0.0, most[:-1])))


def _frame_bend(mechanism: Mechanism) -> float:
    """Return the largest curvature [1/mm] of the frame's map on and around the bed."""
    x, y = mechanism.printer.x, mechanism.printer.y
    grid = np.stack(np.meshgrid(np.linspace(x.min_mm, x.max_mm, 23), np.linspace(y.min_mm, y.max_mm, 23)), axis=-1)
    most = 0.0
    for direction in (np.array([5.0, 0.0]), np.array([0.0, 5.0]), np.array([3.5, 3.5]), np.array([3.5, -3.5])):
        steps = [mechanism.frame.apply(grid + s * direction) for s in (-1, 0, 1)]
        second = np.linalg.norm(steps[0] - 2 * steps[1] + steps[2], axis=-1)
        most = max(most, float(second.max()) / float(direction @ direction))
    return most


def _shifts_only(t: Transmission) -> bool:
    return all(np.ptp(table - t.motor_mm) < _SAME_MM for table in (t.lower_mm, t.upper_mm))


def _rise_mm(screw: ScrewDrive, chord_mm: float) -> float:
    """Return the height over which a straight command keeps the nozzle within half a chord's tolerance."""
    t, most = screw.transmission, 0.0
    for table in (t.lower_mm, t.upper_mm):
        height = np.arange(table[0], table[-1], _RISE_LOOK_MM)
        motor = np.interp(height, table, t.motor_mm)
        bent = np.column_stack([motor, screw.wobble_at_mm(motor)])
        if len(bent) > 2:
            second = np.linalg.norm(bent[2:] - 2 * bent[1:-1] + bent[:-2], axis=1)
            most = max(most, float(second.max()) / _RISE_LOOK_MM**2)
    return float(np.clip(np.sqrt(4.0 * chord_mm / max(most, 1e-12)), _RISE_LOOK_MM, 1e3))


def _is_straight(screw: ScrewDrive) -> bool:
    return _is_same(screw.transmission) and bool(np.abs(screw.wobble_mm).max() < _SAME_MM)


def _is_same(t: Transmission) -> bool:
    return all(np.abs(table - t.motor_mm).max() < _SAME_MM for table in (t.lower_mm, t.upper_mm))


def is_identity(mechanism: Mechanism) -> bool:
    """Return whether a machine does what it is commanded to, so that there is nothing to mend."""
    straight = mechanism.screw is None or _is_straight(mechanism.screw)
    return straight and mechanism.frame.is_identity and all(map(_is_same, mechanism.transmissions))


@dataclass(eq=False)
class Planner:
    """A planner on its way through one file, with the belts' state and the sums so far.

    Mutable, because a file of any length streams through it; only `Planner.begin` and `Planner.plan` change it.
    """

    model: look.Model
    state: np.record
    counts: np.record
    errors: np.ndarray
    layers: np.ndarray
    samples: np.record
    _ring: list[tuple[np.ndarray, np.ndarray]]
    _curve: np.record = field(default_factory=lambda: record(CURVE))
    _moved: np.record = field(default_factory=lambda: record(CURVE))
    _run: np.record = field(default_factory=lambda: record(k.RUN))
    _turn: int = 0

    @property
    def has_screw(self) -> bool:
        """Return whether the machine has an imperfect Z screw."""
        return bool(self.model.head.screw)

    @property
    def bed_mm(self) -> np.ndarray:
        """The lower and the upper corner of the bed [2, 2]."""
        return self.model.head.bed.reshape(2, 2).T

    @property
    def tolerances_mm(self) -> np.ndarray:
        """How far lines of each role may be off."""
        return 2.0 * self.model.head.chords

    def begin(self, segments_per_s: float = np.inf, crossing_mm_s2: float = 0.0, ease: float = 0.0) -> None:
        """Begin a program at an unknown place; sums over earlier programs are kept.

        ``segments_per_s`` is how many moves a second the firmware takes: no line is cut finer. A motor that crosses its
        slack may accelerate by ``crossing_mm_s2``, where that is more than the file's own acceleration. ``ease`` is the
        factor by which lines are drawn coarser for a limit on time.
        """
        self.model.head.crossing, self.model.head.period = crossing_mm_s2, 1.0 / (60.0 * segments_per_s)
        look.set_chords(self.model, self.tolerances_mm[look.TRAVEL], ease)
        self.counts.known = self.counts.anywhere = self.counts.height = 0
        self.counts.mark = -1
        self.state.layer_z = np.inf  # whatever comes first begins a layer

    def plan(self, records: np.ndarray, begin: int = 0) -> tuple[int, np.ndarray, np.ndarray]:
        """Plan records[begin:]: return (end, first, pieces).

        Record i of records[begin:end] becomes pieces[first[i]:first[i + 1]]; both arrays are used again after
        `PLANS_AT_ONCE` further calls. ``end`` is below the number of records when the pieces of the rest did not fit.
        """
        need = int(self.counts.layer) + 2 + len(records) - begin
        if need > len(self.layers):
            self.layers = np.concatenate([self.layers, np.zeros(need, k.LAYER)])
        self._turn = (self._turn + 1) % len(self._ring)
        first, pieces = self._ring[self._turn]
        if len(records) >= len(first):
            first = np.zeros(len(records) + 1, np.int64)
            self._ring[self._turn] = (first, pieces)
        moved = self._moved if self.has_screw else None
        end = mend(
            self.model, records, begin, len(records), self.state, self.counts, self._curve, moved, first, pieces,
            self.layers, self.errors, _QUANTUM_MM, self.samples, self._run,
        )  # fmt: skip
        return end, first, pieces


def start(mechanism: Mechanism, *, tolerance_mm: float = k.TOLERANCE_MM) -> Planner:
    """Return a planner for ``mechanism`` at the beginning of a file, while the machine's position is unknown.

    ``tolerance_mm`` is how far the path may be off.
    """
    state, counts = record(k.STATE), record(k.COUNTS)
    state.low[:] = state.print_low[:] = np.inf
    state.high[:] = state.print_high[:] = -np.inf
    counts.layer = counts.mark = -1
    samples = record(k.SAMPLES)
    samples.strokes[:] = np.inf
    return Planner(
        lookup(mechanism, tolerance_mm), state, counts, np.zeros((2, k.ERROR_BINS)),
        np.zeros(256, k.LAYER), samples,
        [(np.zeros(1 << 14, np.int64), np.empty(_PIECES + k.PIECES_A_RECORD, PIECE)) for _ in range(PLANS_AT_ONCE + 1)],
    )  # fmt: skip


__all__ = ["Planner", "is_identity", "lookup", "start"]
