"""What every event of a print must keep: it is made by name, drawn alike by one seed, and moves what it says."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from printmend.corruption import EVENTS, Cause, Corruption, Drive, EccentricBore, cause_of, corruption_toml
from printmend.corruption.toml import parse_corruption
from printmend.printer import Printer, read_printer
from printmend.twin import Twin
from printmend_lab.conformance.need import need

PRESETS = ("ender3", "corexy")
LEAST_MM = 1e-4
BENT = Drive(pulley=EccentricBore(0.4, 1.0))


@dataclass(frozen=True)
class EventCandidate:
    """An event by its name."""

    name: str

    def printed(self, printer: Printer, drive: Drive, *causes: Cause) -> np.ndarray:
        """Return where a printer with equal drives prints places over its bed [N, 2] mm, after what happened."""
        x, y = (np.linspace(axis.min_mm, axis.max_mm, 40) for axis in printer.axes[:2])
        path = np.vstack([printer.home_mm, np.column_stack([x, y]), np.column_stack([x, y[::-1]])])
        return Twin.of(Corruption((drive, drive), causes=causes), printer).follow(path)


def is_written_and_read(candidate: EventCandidate) -> None:
    """The listed example is an equal one after TOML."""
    whole = Corruption(causes=(cause_of(EVENTS[candidate.name].example), Cause(candidate.name, seed=3)))
    need(parse_corruption(corruption_toml(whole), subject=candidate.name) == whole, "expected equal causes out of TOML")


def seeds_repeat_and_differ(candidate: EventCandidate) -> None:
    """One seed prints one print on a bent pulley, some other seed another one."""
    for printer in map(read_printer, PRESETS):
        one, again, *others = (
            candidate.printed(printer, BENT, Cause(candidate.name, seed=seed)) for seed in (5, 5, *range(6, 12))
        )
        need(np.array_equal(one, again), "expected one seed to print alike")
        apart = max(float(np.abs(each - one).max()) for each in others)
        need(apart > LEAST_MM, f"expected another seed at least {LEAST_MM:g} mm elsewhere, found {apart:.2g}")


def a_healthy_machine_only_shrinks(candidate: EventCandidate) -> None:
    """On a machine without faults nothing moves but what shrinks."""
    for printer in map(read_printer, PRESETS):
        plain = candidate.printed(printer, Drive())
        moved = candidate.printed(printer, Drive(), Cause(candidate.name, seed=5)) - plain
        shift = EVENTS[candidate.name].made({}, None, printer, np.random.default_rng(5)).shift_mm
        need(not shift.any() or np.abs(moved).max() < LEAST_MM, "expected a healthy machine to print where it did")


CHECKS: dict[str, Callable[[EventCandidate], None]] = {
    "the listed example is written and read": is_written_and_read,
    "draws repeat and differ": seeds_repeat_and_differ,
    "a healthy machine only shrinks": a_healthy_machine_only_shrinks,
}
