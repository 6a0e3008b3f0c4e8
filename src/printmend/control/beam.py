"""Plans for coupled axes: a beam guided by what each motor alone would still cost (physics.md §6, cure 3)."""

from dataclasses import dataclass

import numpy as np

from printmend.control.check import check_plan
from printmend.control.greedy import Greedy, first_motors, frame_arrays
from printmend.control.kernels import beam as kernels
from printmend.control.lookahead import Lookahead
from printmend.control.window import Window, better, followed, window
from printmend.path import Plan
from printmend.protocols import PlayTables, WorldModel

# Targets whose costs to go are kept at a time, and how far beyond them those look.
_BLOCK, _HORIZON = 2048, 128


@dataclass(frozen=True)
class Beam:
    """Follow the ``width`` most promising states of both motors together, over models with play.

    Where motors couple (CoreXY: both turn for every move; a crooked frame: x depends on y) no axis can be solved
    alone. But each motor's least cost to go, alone, is a lower bound that knows when its play must be crossed: states
    are ranked by cost so far plus both bounds. Never worse than `Greedy` and `Lookahead` on the model.
    """

    width: int = 32
    name: str = "beam"

    def plan(self, model: WorldModel, targets_steps: np.ndarray, start_steps: np.ndarray, *, c_max: int = 3) -> Plan:
        """Choose controls [T, 2] for targets [T, 2] from ``start_steps`` [2]. Raise `InputError` off the bed."""
        targets, start = check_plan(model.printer, targets_steps, start_steps, c_max)
        greedy = Greedy().plan(model, targets, start, c_max=c_max)
        tables = model.tabulate(start, c_max=c_max)
        if not isinstance(tables, PlayTables) or len(targets) == 0:
            return greedy
        if _is_taut(tables) and np.abs(greedy.controls).max() < c_max:
            # Every target had the choice of all its neighbours, and nothing is remembered: nothing can be better.
            return greedy
        known = better(greedy, Lookahead().plan(model, targets, start, c_max=c_max), targets)
        motors = first_motors(model.printer, tables, start)
        origin = model.printer.to_motor(start).astype(float)
        seen = model.printer.to_motor(targets if tables.frame is None else tables.frame.invert(targets))
        reach = 2 * c_max if tables.corexy else c_max
        belts = followed(tables, motors, origin, known.controls)[1]
        windows = [window(tables, motor, seen[:, motor], origin[motor], belts[:, motor], reach) for motor in range(2)]
        found = self._search(tables, targets, seen, motors, windows, reach, c_max)
        imagined = model.printer.from_motor(followed(tables, motors, origin, found)[1])
        if tables.frame is not None:
            imagined = tables.frame.apply(imagined)
        return better(known, Plan(found, imagined), targets)

    def _search(
        self,
        tables: PlayTables,
        targets: np.ndarray,
        seen: np.ndarray,
        motors: tuple[int, int],
        windows: list[Window],
        reach: int,
        c_max: int,
    ) -> np.ndarray:
        """Return the controls [T, 2] of the best state at the end of the beam."""
        ticks = len(targets)
        a, b = windows
        beam = np.empty((self.width, 4), np.int64)
        beam[0] = a.start, motors[0] - a.offset, b.start, motors[1] - b.offset
        costs = np.zeros(self.width)
        parents = np.empty((ticks, self.width), np.int32)
        choices = np.empty((ticks, self.width, 2), np.int8)
        count = 1
        for begin in range(0, ticks, _BLOCK):
            end, ahead = min(begin + _BLOCK, ticks), min(begin + _BLOCK + _HORIZON, ticks)
            togo, edges = [], []
            for each, column in zip(windows, seen.T, strict=True):
                left, right = each.left[begin : ahead + 1], each.right[begin : ahead + 1]
                block = np.empty((ahead - begin + 1, int((right - left).max()), each.longest))
                kernels.costs_to_go(
                    np.ascontiguousarray(column[begin:ahead]), each.places, each.first, each.last, each.low, each.high,
                    left, right, reach, block,
                )  # fmt: skip
                togo.append(block)
                edges.append((left, right))
            count = kernels.search(
                targets[begin:end], beam, count, togo[0], togo[1], a.places, b.places, a.first, b.first,
                a.low, b.low, a.high, b.high, edges[0][0], edges[1][0], edges[0][1], edges[1][1],
                0.5 if tables.corexy else 1.0, c_max, tables.corexy, *frame_arrays(tables), self.width,
                parents[begin:end], choices[begin:end], costs,
            )  # fmt: skip
        controls = np.empty((ticks, 2), np.int8)
        kernels.way_back(parents, choices, int(np.argmin(costs[:count])), controls)
        return controls


def _is_taut(tables: PlayTables) -> bool:
    return all(map(np.array_equal, tables.lower_steps, tables.upper_steps))


CONTROLLERS = {"beam": Beam()}
