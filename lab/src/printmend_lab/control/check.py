"""The one check of what a controller is given and gives back, and tables read off models that have none."""

from dataclasses import dataclass

import numpy as np

from printmend.errors import InputError, ModelError
from printmend.machine import PlayTables
from printmend.printer import Printer
from printmend.protocols import IncrementTables, JointTables, State, Tables, WorldModel
from printmend_lab.path import Plan
from printmend_lab.protocols import Controller


def check_plan(
    printer: Printer, targets_steps: np.ndarray, start_steps: np.ndarray, c_max: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return targets [T, 2] float64 and start [2] int64. Raise `InputError` where they are not that."""
    targets = np.ascontiguousarray(targets_steps, float)
    start = np.asarray(start_steps)
    if targets.ndim != 2 or targets.shape[1] != 2 or start.shape != (2,):
        raise InputError(
            "plan",
            wanted="targets [T, 2] and start [2]",
            came=f"{targets.shape} and {start.shape}",
            todo="reshape them",
        )
    lattice = np.rint(start).astype(np.int64)
    if (lattice != start).any() or (lattice < 0).any() or (lattice > printer.bed_steps).any():
        raise InputError(
            "start", wanted=f"a lattice point in 0…{printer.bed_steps}", came=f"{start}", todo="move it onto the bed"
        )
    if not np.isfinite(targets).all():
        row = int(np.flatnonzero(~np.isfinite(targets).all(axis=1))[0])
        raise InputError("targets", wanted="finite positions", came=f"{targets[row]} in row {row}", todo="remove it")
    if not 1 <= c_max <= 63:
        raise InputError("c_max", wanted="1 to 63 steps a tick", came=f"{c_max}", todo="correct it")
    return targets, lattice


def tables_of(model: WorldModel, start: np.ndarray, c_max: int) -> Tables | None:
    """Return a model's tables, None where it has none. Kernels trust them: raise `ModelError` where they may not."""
    tables = model.tabulate(start, c_max=c_max)
    if tables is not None and (wrong := _wrong(tables, model.printer, start, c_max)):
        wanted, came = wrong
        raise ModelError("the model's tables", wanted=wanted, came=came, todo="correct its `tabulate`")
    return tables


def advanced(model: WorldModel, state: State, controls: np.ndarray) -> State:
    """Return the states [K] after the controls [K, 2]. Raise `ModelError` where a model's `advance` gives no such."""
    after = model.advance(state, controls)
    position = np.asarray(after.position_steps, float)
    if position.shape != controls.shape or not np.isfinite(position).all():
        came = f"{position.shape}" + ", nan or infinity among them" * (position.shape == controls.shape)
        raise ModelError(
            "the model", wanted=f"finite positions {controls.shape}", came=came, todo="correct its `advance`"
        )
    return after


def _wrong(tables: Tables, printer: Printer, start: np.ndarray, c_max: int) -> tuple[str, str] | None:
    """Return what is wanted of tables and what came, None where all is well."""
    bed = printer.bed_steps
    match tables:
        case PlayTables():
            values = tuple(table for motor in tables.motors for table in (motor.lower_steps, motor.upper_steps))
            for motor, at in zip(tables.motors, printer.to_motor(start), strict=True):
                lower, upper = motor.lower_steps, motor.upper_steps
                if lower.shape != upper.shape or lower.ndim != 1:
                    return "a lower and an upper branch of one length", f"{lower.shape} and {upper.shape}"
                if not 0 <= motor.start < len(lower) or motor.origin_steps != at:
                    came = f"{len(lower)} entries from {motor.first_step} on, the start being number {motor.start}"
                    return f"branches over the layer's start, motor position {at}", came
                if not ((np.diff(lower) >= 0).all() and (np.diff(upper) >= 0).all() and (lower <= upper).all()):
                    return "branches that never fall, lower ≤ upper", "others, or nan"
        case IncrementTables():
            values = tables.displacement_steps
            shapes = tuple((steps + 1, 2 * c_max + 1) for steps in bed)
            if tuple(table.shape for table in values) != shapes or tables.c_max != c_max:
                return f"displacements {shapes}", f"{tuple(table.shape for table in values)}"
        case JointTables():
            values = (tables.unit_steps,)
            counts = tables.unit_steps.shape[:2]
            for cells, count, steps in zip(tables.cells, counts, bed, strict=True):
                if len(cells) != steps + 1 or cells.min() < 0 or cells.max() >= count:
                    return f"a cell out of {count} for each of {steps + 1} places", f"{len(cells)} cells"
        case _:
            return "PlayTables, IncrementTables, JointTables or None", type(tables).__name__
    return None if all(np.isfinite(value).all() for value in values) else ("finite numbers", "nan or infinity")


@dataclass(frozen=True)
class Checked:
    """A controller from outside; what it plans is checked, for twins trust it."""

    controller: Controller

    @property
    def name(self) -> str:
        return self.controller.name

    def plan(self, model: WorldModel, targets_steps: np.ndarray, start_steps: np.ndarray, *, c_max: int = 3) -> Plan:
        """Plan as the controller does. Raise `InputError` where that is no plan for these targets."""
        plan = self.controller.plan(model, targets_steps, start_steps, c_max=c_max)
        controls = np.asarray(getattr(plan, "controls", None))
        imagined = np.asarray(getattr(plan, "imagined_steps", None))
        count, todo = len(targets_steps), "correct its `plan`"
        if controls.shape != (count, 2) or controls.dtype.kind != "i" or np.abs(controls).max(initial=0) > c_max:
            wanted, came = f"integer controls ({count}, 2) of −{c_max}…{c_max}", f"{controls.dtype} {controls.shape}"
            raise InputError(f"controller {self.name}", wanted=wanted, came=came, todo=todo)
        if imagined.shape != (count + 1, 2) or not np.isfinite(imagined.astype(float)).all():
            wanted, came = f"finite imagined positions ({count + 1}, 2)", f"{imagined.dtype} {imagined.shape}"
            raise InputError(f"controller {self.name}", wanted=wanted, came=came, todo=todo)
        return plan


# Read a table of increments off a model's `advance`, for models that have no tables but could have.
#
# A model without memory, whose axes know nothing of each other, is a table of one displacement for each nominal
# position and control of an axis. With it the planner's loop is compiled; without it each target costs a call of
# `advance`.

# A table and `advance` agree if a tick differs by no more than this, in full steps: single precision, far below what
# shows in a print.
_AGREES_STEPS = 1e-4


def increments_by_advance(model: WorldModel, start_steps: np.ndarray, *, c_max: int = 3) -> IncrementTables | None:
    """Return what ``model`` does at every nominal position of the bed as tables; None where it remembers or couples.

    A model's own `tabulate` may return this. It asks for (bed + 1)·(2·c_max + 1) states an axis, in one call of
    `advance` each. What depends on the carriage's position, or on the other axis elsewhere, does not show here:
    `agrees` looks at a whole plan.
    """
    begun, controls, tables = model.start(start_steps), np.arange(-c_max, c_max + 1), []
    for axis, bed in enumerate(model.printer.bed_steps):
        nominal = np.tile(np.asarray(start_steps, np.int64), ((bed + 1) * len(controls), 1))
        nominal[:, axis] = np.repeat(np.arange(bed + 1), len(controls))
        moves = np.zeros_like(nominal)
        moves[:, axis] = np.tile(controls, bed + 1)
        state = State(nominal, nominal.astype(float), _repeated(begun.memory, len(nominal)))
        after = advanced(model, state, moves)
        moved = np.asarray(after.position_steps, float) - nominal
        if np.abs(moved[:, 1 - axis]).max() > _AGREES_STEPS or not _same(after.memory, state.memory):
            return None
        tables.append(moved[:, axis].reshape(bed + 1, len(controls)))
    return IncrementTables((tables[0], tables[1]), c_max)


def agrees(model: WorldModel, start_steps: np.ndarray, controls: np.ndarray, imagined: np.ndarray) -> bool:
    """Say whether `advance` says of every tick of a plan [T, 2] what was imagined [T + 1, 2], in one call for all.

    A plan that leaves the bed is not looked at: the answer is no.
    """
    nominal = np.concatenate([np.zeros((1, 2), np.int64), np.cumsum(controls, axis=0, dtype=np.int64)]) + start_steps
    if (nominal < 0).any() or (nominal > model.printer.bed_steps).any():
        return False
    begun = model.start(start_steps)
    state = State(nominal[:-1], imagined[:-1], _repeated(begun.memory, len(controls)))
    after = advanced(model, state, controls.astype(np.int64))
    return (
        np.array_equal(after.nominal_steps, nominal[1:])
        and bool((np.abs(after.position_steps - imagined[1:]) <= _AGREES_STEPS).all())
        and _same(after.memory, state.memory)
    )


def _repeated(memory: np.ndarray | None, count: int) -> np.ndarray | None:
    return None if memory is None else np.repeat(memory, count, axis=0)


def _same(one: np.ndarray | None, other: np.ndarray | None) -> bool:
    """Say whether nothing was remembered."""
    return one is other is None or (one is not None and other is not None and np.array_equal(one, other))
