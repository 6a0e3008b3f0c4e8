"""How a printer finds home, which decides how much its motors' angles shift from print to print."""

from dataclasses import asdict, dataclass
from typing import Any, Literal, get_args

Switch = Literal["unknown", "switch", "optical", "sensorless", "phase"]
SWITCHES: tuple[str, ...] = get_args(Switch)


@dataclass(frozen=True)
class Homing:
    """The end stops of X and Y.

    ``switch`` is their kind: a micro-switch, one without contact (``optical``, also inductive and Hall), none but the
    motor's own stall (``sensorless``), or one whose place the firmware corrects by the motor's ``phase``.
    ``scatter_mm`` is the standard deviation of the place at which they switch, None where nobody measured it.
    """

    switch: Switch = "unknown"
    scatter_mm: float | None = None


def homing_section(homing: Homing) -> dict[str, Any]:
    """Return the section [homing] of a printer's table; none where nothing is known."""
    known = {key: value for key, value in asdict(homing).items() if value != getattr(Homing(), key)}
    return {"homing": known} if known else {}
