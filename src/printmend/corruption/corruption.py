"""A whole broken machine: the faults of each motor's drive and of the frame, composed and lowered to arrays."""

from dataclasses import dataclass, field, replace
from typing import Protocol, runtime_checkable

import numpy as np

from printmend.corruption.cause import Cause
from printmend.corruption.event import Beads, Made
from printmend.corruption.frame import CrookedFrame, Screw
from printmend.corruption.transmission import (
    Belt,
    Friction,
    GainTable,
    Jumps,
    MissedSteps,
    Pulley,
    Ripple,
    SetScrew,
    ToothSkips,
    Warp,
)
from printmend.effects.sized import Sized, with_effects
from printmend.errors import ConfigError
from printmend.machine import Frame, GainMechanism, Mechanism, Transmission, healthy_transmission, homed_again
from printmend.messages import say
from printmend.printer import Printer
from printmend.units import TURN_RAD

_SAMPLES_PER_TURN = 16384  # places of a turn at which a pulley is tabulated


@dataclass(frozen=True)
class Drive:
    """The faults of one motor's drive, from the rotor to the carriage; None is healthy."""

    ripple: Ripple | None = None
    shaft: SetScrew | None = None
    pulley: Pulley | None = None
    belt: Belt | None = None
    friction: Friction | None = None
    warp: Warp | None = None
    skips: ToothSkips | None = None
    missed: MissedSteps | None = None
    gain_table: GainTable | None = None

    @property
    def jumps(self) -> Jumps:
        """The drive's jumps, which no table can hold: the twin adds them."""
        return Jumps(self.skips, self.missed)

    def lower(self, printer: Printer, motor: int) -> Transmission:
        """Return the transmission of this drive on ``printer``'s motor 0 or 1; a healthy drive is the identity."""
        healthy = healthy_transmission(printer, motor)
        axis = printer.axes[motor]
        grid = healthy.motor_mm
        rotor = grid
        if self.ripple is not None:
            rotor = grid + axis.mm_per_step * self.ripple.lead_steps(grid / axis.mm_per_step)
        span1 = span2 = rotor
        if self.pulley is not None:
            angle = rotor * (TURN_RAD / axis.mm_per_turn)
            span1 = _unwound_mm(self.pulley, axis.radius_mm, 0.0, angle)
            span2 = span1 if self.belt is None else _unwound_mm(self.pulley, axis.radius_mm, np.pi, angle)
        lower, upper = (span1, span1) if self.belt is None else self.belt.branches_mm(grid, span1, span2)
        if self.shaft is not None:
            slack_mm = self.shaft.slack_rad * axis.mm_per_turn / TURN_RAD
            slack = replace(healthy, lower_mm=lower, upper_mm=upper)
            lower, upper = (
                slack.branches_mm(grid - slack_mm / 2)[0],
                slack.branches_mm(grid + slack_mm / 2)[1],
            )
        if self.friction is not None:
            lost = self.friction.lost_mm(grid)
            lower, upper = lower - lost / 2, upper + lost / 2
        if self.warp is not None:
            off = self.warp.error_mm(grid)
            lower, upper = _rising(lower + off), _rising(upper + off)
        return replace(healthy, lower_mm=lower, upper_mm=upper)


def _rising(branch_mm: np.ndarray) -> np.ndarray:
    if np.diff(branch_mm).min() < -1e-9:
        raise ConfigError(
            say("subject-corruption", "'warp'"), wanted=say("warp-under-which-drive-still-moves"),
            came=say("turns-back"), todo=say("make-bumps-smaller-wider"),
        )  # fmt: skip
    return np.maximum.accumulate(branch_mm)


def _unwound_mm(pulley: Pulley, radius_mm: float, span_rad: float, angle_rad: np.ndarray) -> np.ndarray:
    """Integrate h(span − t) from 0 to each angle: the belt that a span has unwound [mm] (physics.md eq. 1)."""
    t = np.linspace(0.0, TURN_RAD, _SAMPLES_PER_TURN + 1)
    h = pulley.support_mm(span_rad - t, radius_mm)
    turn = np.concatenate([[0.0], np.cumsum((h[1:] + h[:-1]) / 2 * (t[1] - t[0]))])
    turns, rest = np.divmod(angle_rad, TURN_RAD)
    return turns * turn[-1] + np.interp(rest, t, turn)


@runtime_checkable
class Fault(Protocol):
    """A fault of a whole machine: a `Corruption`, or a value of another package."""

    @property
    def jumps(self) -> tuple[Jumps, Jumps]:
        """Each motor's jumps, which no table can hold: the twin adds them."""
        ...

    def lower(self, printer: Printer) -> Mechanism | GainMechanism:
        """Return this machine as arrays."""
        ...


@dataclass(frozen=True)
class Corruption:
    """The faults of a machine: a `Drive` for each planar motor (x, y, or a, b on a CoreXY), the frame, the Z screw.

    ``causes`` name effects of the machine, of the print and of the measurement, and events of the print. All of them
    add up, except that only the last filament's beads count.
    """

    drives: tuple[Drive, Drive] = field(default_factory=lambda: (Drive(), Drive()))
    frame: CrookedFrame | None = None
    screw: Screw | None = None
    causes: tuple[Cause, ...] = ()

    def __post_init__(self) -> None:
        tables = [drive.gain_table is not None for drive in self.drives]
        if not any(tables):
            return
        mixed = any(drive != Drive(gain_table=drive.gain_table) for drive in self.drives)
        others = self.frame is not None or self.screw is not None or bool(self.causes)
        if not all(tables) or mixed or others:
            raise ConfigError(
                say("subject-corruption", "'gain-table'"),
                wanted=say("gain-tables-both-axes-nothing-else"),
                came=say("mixture"),
                todo=say("remove-other-sections-gain-tables"),
            )

    @property
    def jumps(self) -> tuple[Jumps, Jumps]:
        """Each motor's jumps, which no table can hold."""
        return self.drives[0].jumps, self.drives[1].jumps

    def lower(self, printer: Printer) -> Mechanism | GainMechanism:
        """Return this fault as arrays on a printer. Raise `ConfigError` if the two do not fit."""
        if self.drives[0].gain_table is not None and self.drives[1].gain_table is not None:
            gains = (np.array(self.drives[0].gain_table.gains), np.array(self.drives[1].gain_table.gains))
            return GainMechanism(printer, gains)
        frame = Frame() if self.frame is None else self.frame.lower(printer)
        screw = None if self.screw is None else self.screw.lower(printer)
        drives = (self.drives[0].lower(printer, 0), self.drives[1].lower(printer, 1))
        mechanism = with_effects(Mechanism(printer, drives, frame, screw), self._parts(printer))
        shift_mm = sum((made.shift_mm for made in self._made(printer)), np.zeros(2))
        return homed_again(mechanism, shift_mm) if shift_mm.any() else mechanism

    def beads(self, printer: Printer) -> Beads:
        """Return how far beads stand out, beyond the effects' own widths."""
        found = [made.beads for made in self._made(printer) if made.beads is not None]
        return found[-1] if found else Beads()

    def along(self, printer: Printer) -> tuple[Sized, ...]:
        """Return the effects that no machine's tables hold: those along the path, and those of the measurement."""
        return tuple(part for part in self._parts(printer) if not part.is_held)

    def _parts(self, printer: Printer) -> list[Sized]:
        return [part for made in self._made(printer) for part in made.parts]

    def _made(self, printer: Printer) -> list[Made]:
        return [cause.made(printer) for cause in self.causes]


HEALTHY = Corruption()
