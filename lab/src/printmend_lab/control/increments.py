"""Read a table of increments off a model's `advance`, for models that have no tables but could have.

A model without memory, whose axes know nothing of each other, is a table of one displacement for each nominal position
and control of an axis. With it the planner's loop is compiled; without it each target costs a call of `advance`.
"""

import numpy as np

from printmend.protocols import IncrementTables, State, WorldModel
from printmend_lab.control.check import advanced

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
