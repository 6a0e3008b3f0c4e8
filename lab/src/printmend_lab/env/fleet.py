"""What the environments run on: drawn scenes, pools of machines and tasks, and the state of N prints side by side."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from printmend.corruption import Fault
from printmend.errors import ConfigError, InputError
from printmend.learn.mechanism_model import MechanismModel
from printmend.machine import Mechanism, lattice_bed, lattice_tables
from printmend.machine.kernels.bed import BED
from printmend.metrics import rmse
from printmend.printer import Printer
from printmend.twin import Twin
from printmend.units import TURN_RAD
from printmend_lab.control.optimal import Optimal
from printmend_lab.path import Layer
from printmend_lab.sampling import Severity, fault

# What the one-print environments draw: a broken machine and a path on which knowing the fault pays.

# A scene is drawn again unless the optimum is this much better than Naive: below it the score would divide by nothing.
# Half the published lattice's rounding, 0.02 mm on the presets.
LEAST_GAIN_STEPS = 0.1
_DRAWS = 300  # after which a family counts as one with nothing to gain

_BOTH = (
    "radius", "eccentric", "fourier", "tabulated", "published", "pulley", "pulley-play", "pulley-loose",
    "pulley-set-screw", "elastic", "smooth", "frame", "everything",
)  # fmt: skip
# Families with something to gain on the lattice of full steps. Other faults of a well-kept machine are below its
# rounding, and so are friction and ripple even when damaged. Jumps cannot be foreseen; a screw moves no planar print.
SCENES: dict[Severity, tuple[str, ...]] = {
    "damaged": (*_BOTH, "ellipse", "polygon", "flat", "play", "loose", "set-screw"),
    "realistic": _BOTH,
}


@dataclass(frozen=True, eq=False)
class Scene:
    """A broken machine, the path to print on it, and the RMSE [full steps] there of two plans.

    The path commanded as it is scores 0, the best plan that the true machine allows scores 1.
    """

    mechanism: Mechanism
    layer: Layer
    naive_steps: float
    optimum_steps: float

    @property
    def gain_steps(self) -> float:
        """By how much the best plan beats Naive."""
        return self.naive_steps - self.optimum_steps


def scene_of(mechanism: Mechanism, layer: Layer) -> Scene:
    """Print a path as it is and as well as can be, and return the scene."""
    twin, nominal, start = Twin(mechanism), layer.nominal_steps, layer.start_steps
    plan = Optimal().plan(MechanismModel(mechanism), nominal[1:], start)
    naive, best = (rmse(nominal, twin.run(controls, start)) for controls in (layer.controls, plan.controls))
    return Scene(mechanism, layer, naive, min(naive, best))


def draw_scene(rng: np.random.Generator, printer: Printer, family: str, severity: Severity, ticks: int) -> Scene:
    """Draw a fault of a family and a path of ``ticks`` until there is something to gain.

    Raises `ConfigError` for a family that does not exist, has no hidden mechanics, or nothing to gain.
    """
    for _ in range(_DRAWS):
        (mechanism,) = mechanisms_of([fault(family, rng, severity)], printer)
        scene = scene_of(mechanism, random_layer(rng, printer, ticks))
        if scene.gain_steps >= LEAST_GAIN_STEPS:
            return scene
    raise ConfigError(
        "environment", wanted=f"a family with {LEAST_GAIN_STEPS} full steps to gain", came=f"{family}, {severity}",
        todo="choose another family, or damaged",
    )  # fmt: skip


class Machines(NamedTuple):
    """K broken machines of one printer as arrays.

    ``lower`` and ``upper`` [K, 2, M] full steps: the branches of each motor's play, entry i at motor position
    ``first[motor] + i``. ``beds`` [K] of `BED`: how the belts of each machine reach the bed. ``size`` [2]: the bed's
    full steps.
    """

    lower: np.ndarray
    upper: np.ndarray
    first: np.ndarray
    beds: np.ndarray
    size: np.ndarray


class Tasks(NamedTuple):
    """P paths to print: ``starts`` [P, 2], ``targets`` [P, T, 2] and ``lengths`` [P], integer full steps."""

    starts: np.ndarray
    targets: np.ndarray
    lengths: np.ndarray


class Fleet(NamedTuple):
    """The hidden state of N prints: which machine and task, the tick, and where everything is.

    ``nominal`` [N, 2] is the sum of the controls, hence the motors' angles; ``position`` [N, 2] is where each
    motor's belt holds its carriage, the memory of the play [full steps]; ``last`` and ``direction`` [N, 2] are
    the last control and the sign of the last motion; ``squares`` [N] the sum of squared errors so far. What anchors a
    machine where its print starts: ``shift`` [N, 2] is added to its branches, ``beds`` [N] of `BED` are its way to
    the bed.
    """

    machine: np.ndarray
    task: np.ndarray
    tick: np.ndarray
    nominal: np.ndarray
    position: np.ndarray
    shift: np.ndarray
    beds: np.ndarray
    last: np.ndarray
    direction: np.ndarray
    squares: np.ndarray


def mechanisms_of(corruptions: Sequence[Fault], printer: Printer) -> tuple[Mechanism, ...]:
    """Lower corruptions. Raise `ConfigError` for gain tables, which have no hidden mechanics."""
    mechanisms = [corruption.lower(printer) for corruption in corruptions]
    whole = tuple(mechanism for mechanism in mechanisms if isinstance(mechanism, Mechanism))
    if len(whole) < len(mechanisms):
        raise ConfigError(
            "environment", wanted="conservative corruptions", came="a gain table", todo="choose another family"
        )
    return whole


def machines_of(mechanisms: Sequence[Mechanism], printer: Printer) -> Machines:
    """Return a pool of machines as the kernels take it."""
    middle = np.array(printer.bed_steps) // 2
    tables = [lattice_tables(mechanism, middle) for mechanism in mechanisms]
    entries = max(len(motor.lower_steps) for motor in tables[0].motors)

    def padded(rows: Iterable[np.ndarray]) -> np.ndarray:
        return np.stack([np.pad(row, (0, entries - len(row)), mode="edge") for row in rows])

    return Machines(
        lower=np.stack([padded(motor.lower_steps for motor in table.motors) for table in tables]),
        upper=np.stack([padded(motor.upper_steps for motor in table.motors) for table in tables]),
        first=np.array([motor.first_step for motor in tables[0].motors], np.int64),
        beds=np.array([lattice_bed(mechanism).record for mechanism in mechanisms], BED),
        size=np.array(printer.bed_steps, np.int64),
    )


def tasks_of(layers: Sequence[Layer]) -> Tasks:
    """Make a task of every layer: its nominal positions are the targets. Raise `InputError` where none moves."""
    if not layers or min(layer.transitions for layer in layers) == 0:
        raise InputError("tasks", wanted="layers with motion", came="none, or an empty one", todo="drop it")
    lengths = np.array([layer.transitions for layer in layers], np.int64)
    targets = np.empty((len(layers), int(lengths.max()), 2), np.int64)
    for row, layer in zip(targets, layers, strict=True):
        nominal = layer.nominal_steps[1:]
        row[: len(nominal)], row[len(nominal) :] = nominal, nominal[-1]
    return Tasks(np.array([layer.start_steps for layer in layers], np.int64), targets, lengths)


def random_layer(rng: np.random.Generator, printer: Printer, ticks: int) -> Layer:
    """Draw a layer of ``ticks`` controls: perimeters of a random smooth shape, two steps (a bead) apart."""
    bed = np.array(printer.bed_steps)
    size = float(rng.uniform(25.0, 0.25 * bed.min()))
    centre = rng.uniform(1.5 * size, bed - 1.5 * size)
    amplitude = rng.uniform(-0.12, 0.12, 4) / np.arange(1, 5)
    phase = rng.uniform(0, TURN_RAD, 4)
    angle = np.linspace(0, TURN_RAD, 361)
    shape = 1 + np.cos(np.outer(angle, np.arange(1, 5)) + phase) @ amplitude
    outline = shape[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    radii = np.arange(size, 12.0, -2.0)
    once = np.vstack([centre + radius * outline for radius in radii])
    # One loop's chords are at least as long as its lattice path's ticks over √2; rounds until that is enough.
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(once, axis=0).T))])
    rounds = 1 + int(2 * ticks / length[-1])
    path = np.vstack([once] * rounds)
    travelled = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    # Samples 0.4 steps apart move each rounded coordinate by one step at most.
    at = np.arange(0.0, travelled[-1], 0.4)
    points = np.rint(np.stack([np.interp(at, travelled, path[:, i]) for i in range(2)], axis=1)).astype(int)
    moved = np.concatenate([[True], np.any(np.diff(points, axis=0) != 0, axis=1)])
    points = points[moved][: ticks + 1]
    return Layer(0, 0.2, points[0], np.diff(points, axis=0), np.ones(ticks, bool))


def fleet_of(count: int) -> Fleet:
    """Allocate the state of ``count`` prints; `kernels.restart` fills it."""

    def whole() -> np.ndarray:
        return np.zeros((count, 2), np.int64)

    def real() -> np.ndarray:
        return np.zeros((count, 2))

    return Fleet(
        machine=np.zeros(count, np.int64),
        task=np.zeros(count, np.int64),
        tick=np.zeros(count, np.int64),
        nominal=whole(),
        position=real(),
        shift=real(),
        beds=np.zeros(count, BED),
        last=whole(),
        direction=whole(),
        squares=np.zeros(count),
    )
