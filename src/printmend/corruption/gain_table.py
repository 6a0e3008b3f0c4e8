"""The corruption of the paper's published simulator: a gain a step, indexed by the nominal position."""

from dataclasses import dataclass
from typing import ClassVar

from printmend.corruption.check import in_range, refuse
from printmend.messages import say


@dataclass(frozen=True)
class GainTable:
    """One row of the published ``all_data``: entry p − 1 is the gain of a step at nominal position p.

    The same in both directions and not conservative (physics.md §8.1).
    """

    gains: tuple[float, ...]
    kind: ClassVar[str] = "gain-table"

    def __post_init__(self) -> None:
        in_range(self, gains=(-100.0, 100.0))
        if not 2 <= len(self.gains) <= 100_000:
            refuse(self, say("2-100-000-gains-published-tables"), f"{len(self.gains)}")
