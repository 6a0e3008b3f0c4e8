"""Traverses for `printmend learn`: the question of `bench real`, asked of what printmend ships."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from printmend.learn.learned import learn_model
from printmend.path import Trace
from printmend.printer import read_printer

# Each traverse came without its own line, and so without how far the belt is behind on the way back: any distance that
# keeps one way behind the other stands for it. Before its first sample the carriage had sped up, over this way or more.
_BEHIND_MM, _RUN_UP_MM = 2.0, 10.0


def shipped_fit(
    traces: Sequence[tuple[int, np.ndarray, np.ndarray]],
) -> Callable[[int, np.ndarray], np.ndarray]:
    """Learn from (direction, place [N], error along the way [N]) mm; predict the error of (direction, place [N]).

    The printer is a preset of 20 teeth: that its pulley turns by another length, the learner has to find.
    """
    printer = read_printer("ender5")
    turn_mm = printer.x.mm_per_turn
    turns = 1 + np.ceil(2 * max(float(np.abs(place).max()) for _, place, _ in traces) / turn_mm)
    printer = replace(printer, x=replace(printer.x, max_mm=float(turns * turn_mm)))
    middle = printer.x.max_mm / 2
    ways = [np.concatenate([[place[0] - direction * _RUN_UP_MM], place]) for direction, place, _ in traces]
    errors = [np.concatenate([[np.nan], direction * (error - _BEHIND_MM / 2)]) for direction, _, error in traces]
    commanded = np.concatenate(ways) + middle
    measured = commanded + np.concatenate(errors)
    still = np.full_like(commanded, printer.y.max_mm / 2)
    seen = np.where(np.isnan(measured), np.nan, still)
    trace = Trace(np.stack([commanded, still], axis=1), np.stack([measured, seen], axis=1))
    drive = learn_model(trace, printer, rng=np.random.default_rng(0)).mechanism.transmissions[0]

    def error_mm(direction: int, place_mm: np.ndarray) -> np.ndarray:
        lower, upper = drive.branches_mm(place_mm + middle)
        return direction * ((lower if direction > 0 else upper) - place_mm - middle)

    return error_mm
