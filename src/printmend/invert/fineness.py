"""How finely a path is drawn: how far it may be off, and how many moves a second the firmware takes."""

from dataclasses import dataclass

from printmend.gcode.machine import Flavour
from printmend.invert.kernels.layout import TOLERANCE_MM

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

    ``tolerance_mm``: half of it where a chord bulges, all where that is short or slack is crossed. ``firmware`` is a
    key of `SEGMENTS_PER_S`, or None: guessed from each file.
    """

    tolerance_mm: float = TOLERANCE_MM
    firmware: str | None = None

    def segments_per_s(self, flavour: Flavour) -> float:
        """Return how many moves a second a file of that ``flavour`` may have."""
        return SEGMENTS_PER_S[self.firmware or _OF_FLAVOUR[flavour]]
