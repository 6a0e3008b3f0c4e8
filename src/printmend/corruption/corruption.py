"""A whole broken machine: what is wrong with each motor's drive and with the frame; composed, lowered to arrays."""

from dataclasses import dataclass, field, replace
from typing import Protocol, runtime_checkable

import numpy as np

from printmend.corruption.belt import Belt, Friction
from printmend.corruption.cause import Cause
from printmend.corruption.frame import CrookedFrame
from printmend.corruption.gain_table import GainTable
from printmend.corruption.jump import Jumps, MissedSteps, ToothSkips
from printmend.corruption.pulley import Pulley
from printmend.corruption.screw import Screw
from printmend.corruption.shaft import Ripple, SetScrew
from printmend.corruption.warp import Warp
from printmend.effects import EFFECTS, Acts
from printmend.effects.sized import Sized, belt_mm, frame_of, scene_of_printer
from printmend.errors import ConfigError
from printmend.machine import Frame, GainMechanism, Mechanism, Transmission, healthy_transmission
from printmend.machine.kernels.bed import MOST_WAVES
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
        """What no table holds: the twin adds it."""
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
            span2 = _unwound_mm(self.pulley, axis.radius_mm, np.pi, angle)
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
            "corruption 'warp'", wanted="a warp under which this drive still moves forwards",
            came="one that turns it back", todo="make the bumps smaller, or wider",
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
    """What can be wrong with a whole machine: a `Corruption`, or a value of another package."""

    @property
    def jumps(self) -> tuple[Jumps, Jumps]:
        """What no table of each motor holds: the twin adds it."""
        ...

    def lower(self, printer: Printer) -> Mechanism | GainMechanism:
        """Return this machine as arrays."""
        ...


@dataclass(frozen=True)
class Corruption:
    """The faults of a machine: one `Drive` a planar motor (x and y, or a and b on a CoreXY), the frame, the Z screw.

    ``causes`` are effects by their names, of the machine, of the print and of the measurement; all of them add up.
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
                "corruption 'gain-table'",
                wanted="gain tables on both axes and nothing else (they are the published simulator's own world)",
                came="a mixture",
                todo="remove the other sections, or the gain tables",
            )

    @property
    def jumps(self) -> tuple[Jumps, Jumps]:
        """What no table of each motor holds."""
        return self.drives[0].jumps, self.drives[1].jumps

    def lower(self, printer: Printer) -> Mechanism | GainMechanism:
        """Return this fault as arrays on that printer. Raise `ConfigError` where the two do not fit."""
        if self.drives[0].gain_table is not None and self.drives[1].gain_table is not None:
            gains = (np.array(self.drives[0].gain_table.gains), np.array(self.drives[1].gain_table.gains))
            return GainMechanism(printer, gains)
        held = [part for part in self._parts(printer) if part.is_held]
        frame = Frame() if self.frame is None else self.frame.lower(printer.middle_mm)
        screw = None if self.screw is None else self.screw.lower(printer)
        a, b = (_beside(drive.lower(printer, motor), printer, motor, held) for motor, drive in enumerate(self.drives))
        return Mechanism(printer, (a, b), _framed(frame, printer, held), screw)

    def along(self, printer: Printer) -> tuple[Sized, ...]:
        """Return the effects that no machine's tables hold: what acts along the path, and what only is measured."""
        return tuple(part for part in self._parts(printer) if not part.is_held)

    def _parts(self, printer: Printer) -> list[Sized]:
        return [cause.part(printer) for cause in self.causes]


def _beside(table: Transmission, printer: Printer, motor: int, parts: list[Sized]) -> Transmission:
    """Return a drive's tables with the effects of this motor in them. No belt has less play than none."""
    mine = [part for part in parts if EFFECTS[part.effect].acts is Acts.DRIVE and part.where == motor]
    if not mine:
        return table
    scene, grid = scene_of_printer(printer), table.motor_mm
    lower = table.lower_mm + belt_mm(scene, motor, mine, grid, -1.0)
    upper = table.upper_mm + belt_mm(scene, motor, mine, grid, 1.0)
    middle = (lower + upper) / 2
    lower, upper = np.where(lower > upper, middle, lower), np.where(lower > upper, middle, upper)
    if min(np.diff(lower).min(), np.diff(upper).min()) < -1e-9:
        raise ConfigError(
            f"effects of motor {printer.motors[motor]}", wanted="effects under which this drive still moves forwards",
            came="some that turn it back together", todo="make one of them smaller",
        )  # fmt: skip
    return replace(table, lower_mm=np.maximum.accumulate(lower), upper_mm=np.maximum.accumulate(upper))


def _framed(frame: Frame, printer: Printer, parts: list[Sized]) -> Frame:
    """Return a frame with the effects of the frame added to it."""
    mine = [part for part in parts if EFFECTS[part.effect].acts in (Acts.FRAME, Acts.WAVE)]
    if not mine:
        return frame
    waves = len(frame.waves) + sum(EFFECTS[part.effect].acts is Acts.WAVE for part in mine)
    if waves > MOST_WAVES:
        raise ConfigError(
            "effects of the frame", wanted=f"at most {MOST_WAVES} waves of guides", came=str(waves), todo="remove some"
        )
    more = frame_of(scene_of_printer(printer), mine)
    return Frame(
        frame.coefficients_mm + more.coefficients_mm, frame.scale_mm, np.concatenate([frame.waves, more.waves])
    )


HEALTHY = Corruption()
