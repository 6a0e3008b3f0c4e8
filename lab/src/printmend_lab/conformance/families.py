"""What every family of faults must keep, on every printer, damaged or realistic."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, lru_cache, partial

import numpy as np

from printmend.corruption import HEALTHY, Fault
from printmend.machine import Mechanism
from printmend.printer import Printer, read_printer
from printmend.twin import Twin
from printmend_lab.conformance.need import need
from printmend_lab.sampling import Severity, fault

MACHINES: tuple[tuple[Severity, str], ...] = (
    ("damaged", "ender5"),
    ("damaged", "ender3"),
    ("damaged", "corexy"),
    ("realistic", "ender5"),
)


@dataclass(frozen=True)
class FamilyCandidate:
    """A family of faults by its name or place."""

    name: str

    def drawn(self, severity: Severity, seed: int = 5) -> Fault:
        """Return a fault of the family, drawn from a seed."""
        return fault(self.name, np.random.default_rng(seed), severity)

    def twin(self, severity: Severity, preset: str) -> Twin:
        """Return a broken machine of the family."""
        return _twin(self, severity, preset)


@lru_cache(maxsize=len(MACHINES))
def _twin(candidate: FamilyCandidate, severity: Severity, preset: str) -> Twin:
    return Twin.of(candidate.drawn(severity), read_printer(preset))


def seeds_repeat_and_differ(candidate: FamilyCandidate, severity: Severity) -> None:
    """The same seed draws an equal fault, another seed another."""
    need(candidate.drawn(severity) == candidate.drawn(severity), "expected equal faults of one seed")
    need(hash(candidate.drawn(severity)) == hash(candidate.drawn(severity)), "expected equal faults to hash alike")
    need(candidate.drawn(severity, 5) != candidate.drawn(severity, 6), "expected other faults of another seed")


def tables_rise_and_are_ordered(candidate: FamilyCandidate, severity: Severity, preset: str) -> None:
    """Every transmission has finite branches that never fall, lower ≤ upper, and that nobody can write to."""
    mechanism = candidate.twin(severity, preset).mechanism
    if not isinstance(mechanism, Mechanism):
        return
    for table in [*mechanism.transmissions] + ([mechanism.screw.transmission] if mechanism.screw else []):
        for branch in (table.lower_mm, table.upper_mm):
            need(np.isfinite(branch).all(), "expected finite branches")
            need((np.diff(branch) >= 0).all(), "expected branches that never fall")
            need(not branch.flags.writeable, "expected arrays that nobody can write to")
        need((table.lower_mm <= table.upper_mm).all(), "expected lower ≤ upper everywhere")


def prints_another_path(candidate: FamilyCandidate, severity: Severity, preset: str) -> None:
    """A healthy machine prints the nominal path exactly; one with this fault does not."""
    controls, start, nominal = _printed_by_a_healthy_machine(preset)
    printed = candidate.twin(severity, preset).run(controls, start)
    need(np.isfinite(printed).all(), "expected a finite print")
    most = float(np.abs(printed - nominal).max())
    need(most > 1e-3, f"expected a print that is somewhere 0.001 steps off at least, found {most:.6f}")


@cache
def _printed_by_a_healthy_machine(preset: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return controls that go to and fro for long, where they start, and the path, which a healthy machine prints."""
    printer = read_printer(preset)
    ticks = np.arange(300_000)
    shuttle = [np.where(ticks // period % 2 == 0, 1, -1) for period in (260, 341)]
    lift = np.where(ticks % 2000 < 1000, 1, -1) * (ticks % 10 == 0)
    controls, start = np.column_stack([*shuttle, lift]), middle(printer)
    nominal = start + np.concatenate([np.zeros((1, 3)), np.cumsum(controls, axis=0)])
    np.testing.assert_array_equal(Twin.of(HEALTHY, printer).run(controls, start), nominal)
    return controls, start, nominal


def closed_paths_of_taut_machines_close(candidate: FamilyCandidate, severity: Severity, preset: str) -> None:
    """What has no play, no jumps and no gain table is a map: a path there and back ends where it began."""
    twin = candidate.twin(severity, preset)
    taut = isinstance(twin.mechanism, Mechanism) and all(table.is_taut for table in twin.mechanism.transmissions)
    if not taut or any(map(any, twin.jumps)):
        return
    out, start = walk(np.random.default_rng(8), 500, 2), middle(twin.printer)[:2]
    printed = twin.run(np.vstack([out, -out[::-1]]), start)
    np.testing.assert_allclose(printed[-1], start, rtol=0, atol=1e-9)


def walk(rng: np.random.Generator, ticks: int, axes: int) -> np.ndarray:
    """Return controls that keep a direction for a while, as prints do, and reverse often."""
    turns = rng.integers(-3, 4, (ticks // 10 + 1, axes))
    return np.repeat(turns, 10, axis=0)[:ticks]


def middle(printer: Printer) -> np.ndarray:
    """Return a lattice point [3] in the middle of the bed, some layers up."""
    return np.array([*(np.array(printer.bed_steps) // 2), 200])


CHECKS: dict[str, Callable[[FamilyCandidate], None]] = {
    **{
        f"seeds repeat and differ ({severity})": partial(seeds_repeat_and_differ, severity=severity)
        for severity in ("damaged", "realistic")
    },
    **{
        f"{name} ({severity}, {preset})": partial(check, severity=severity, preset=preset)
        for name, check in (
            ("tables rise and are ordered", tables_rise_and_are_ordered),
            ("prints another path", prints_another_path),
            ("closed paths close where nothing has play", closed_paths_of_taut_machines_close),
        )
        for severity, preset in MACHINES
    },
}
