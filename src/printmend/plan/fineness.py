"""How finely a path is drawn: how far it may be off, and how many moves a second the firmware takes."""

from dataclasses import dataclass

from printmend.gcode.machine import Flavour
from printmend.plan.kernels.layout import TOLERANCE_MM
from printmend.plan.kernels.lookup import COARSEST_MM, SPARE

SEGMENTS_PER_S = {
    "marlin8": 100.0,
    "marlin32": 1000.0,
    "klipper": 2000.0,
    "rrf": 1000.0,
    "prusa": 500.0,
    "bambu": 1000.0,
}
"""Moves a second that a firmware surely plans, read from its card or sent to it: cautious values of ours."""
_OF_FLAVOUR = {
    Flavour.MARLIN1: "marlin8", Flavour.MARLIN2: "marlin32", Flavour.KLIPPER: "klipper", Flavour.RRF: "rrf",
    Flavour.PRUSA: "prusa", Flavour.UNKNOWN: "marlin32",
}  # fmt: skip


@dataclass(frozen=True)
class Fineness:
    """How far the path may be off, and what reads the file.

    ``tolerance_mm``: a chord may bulge by half of it; a short chord, and one on which slack is crossed, by all of it.
    ``firmware`` is a key of `SEGMENTS_PER_S`; None guesses it from each file. ``slower`` is the largest share by which
    the print may take longer, None for no limit. To keep it, lines are drawn coarser by the factor ``ease``, each role
    up to its `SPARE`. ``crossing_mm_s2`` is the acceleration of a motor that crosses its slack; None takes that of the
    printer's file.
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
