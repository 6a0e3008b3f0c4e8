"""Export the part of a machine's fault that a firmware can correct: scale, skew, backlash, LinuxCNC's tables.

| firmware | scale | skew | backlash | table |
|---|---|---|---|---|
| Klipper | rotation_distance | SET_SKEW | no | no |
| Marlin | M92 | M852 | M425 | no |
| RepRapFirmware | M92 | M556 | M425 | no |
| LinuxCNC | in the table | no | in the table | nominal, forward, reverse; 256 points a joint |

Everything else (pulleys off their centre, play that varies, bent guides) remains for `printmend mend`.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from printmend.machine import Mechanism, Transmission, print_path
from printmend.messages import say, together
from printmend.printer import Printer

LINUXCNC_POINTS = 256  # LinuxCNC's limit for the points of a compensation table
SKEW_SIDE_MM = 100.0  # side of the square whose diagonals M852 receives
_MOVES = 4000  # moves of the walk on which two laws are compared
_NEGLIGIBLE = 1e-5  # a smaller gain error or skew, 0.01 mm in a metre, counts as none


@dataclass(frozen=True)
class Simple:
    """The simple part of a fault: each motor's ``gain`` (mm moved per commanded mm) and mean ``play_mm``, both with the
    frame's stretch; the tangent of the frame's skew, x′ = x + skew·y."""

    gain: tuple[float, float]
    play_mm: tuple[float, float]
    skew: float


@dataclass(frozen=True)
class Export:
    """Settings for a firmware: ``files`` (name, text), and the predicted RMS error over the bed [mm] without
    (``before_mm``) and with them (``after_mm``), not counting a shift of the whole part. ``settings`` describes the
    files in words; ``left_out`` names settings that would not help by more than their uncertainty, and why.
    ``doubt_mm`` is twice the standard deviation of the error with these settings."""

    files: tuple[tuple[str, str], ...]
    before_mm: float
    after_mm: float
    settings: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()
    doubt_mm: float = 0.0


def simple_part(mechanism: Mechanism, turns_mm: tuple[float, float] | None = None, *, may_skew: bool = True) -> Simple:
    """Split scale, constant play and skew off a machine; negligible values become exactly 1 or 0.

    ``turns_mm`` are the learned lengths of both motors' turns, by default the printer's. If the frame is known to be
    square, a CoreXY's two scales are no skew: ``may_skew`` is False.
    """
    printer = mechanism.printer
    gains, plays = [], []
    for motor, table in enumerate(mechanism.transmissions):
        at = _whole_turns_mm(printer, motor, printer.axes[motor].mm_per_turn if turns_mm is None else turns_mm[motor])
        lower, upper = table.branches_mm(at)
        middle = (lower + upper) / 2
        gains.append(float(np.polyfit(at - at.mean(), middle, 1)[0]))
        play = float((upper - lower).mean())
        plays.append(play if play > 1e-4 else 0.0)
    middle_mm = np.array(printer.middle_mm)
    half_mm = 0.4 * np.diag([printer.x.length_mm, printer.y.length_mm])  # on a bent frame, use the secant
    right, up = (mechanism.frame.apply(middle_mm + e) - mechanism.frame.apply(middle_mm - e) for e in half_mm)
    skew = math.tan(math.atan2(up[0], up[1]) + math.atan2(right[1], right[0]))
    stretch = np.array([right[0] / (2 * half_mm[0, 0]), up[1] / (2 * half_mm[1, 1])])
    if printer.kinematics == "corexy":  # both motors move both axes: only their common stretch can be corrected
        stretch[:] = stretch.mean()
    gains = [1.0 if abs(gain - 1) < _NEGLIGIBLE else float(gain) for gain in np.array(gains) * stretch]
    plays = [float(play) for play in np.array(plays) * stretch]
    simple = Simple((gains[0], gains[1]), (plays[0], plays[1]), skew if may_skew and abs(skew) > _NEGLIGIBLE else 0.0)
    return _as_skew(mechanism, simple) if may_skew and printer.kinematics == "corexy" else simple


def _as_skew(mechanism: Mechanism, simple: Simple) -> Simple:
    """Replace a CoreXY's two scales by one scale and a skew, if that leaves less error.

    Motors with unequal scales lean both axes alike; a skewed frame leans only y. A print whose place is known shows it.
    """
    scale, half = sum(simple.gain) / 2, (simple.gain[0] - simple.gain[1]) / 2
    both = 1.0 if abs(scale - 1) < _NEGLIGIBLE else scale
    skewed = Simple((both, both), simple.play_mm, simple.skew + 2 * half / scale)
    return min(simple, skewed, key=lambda each: _error_mm(mechanism, _simple_drive(mechanism, each, play=False)))


def _whole_turns_mm(printer: Printer, motor: int, turn_mm: float) -> np.ndarray:
    """Return motor positions over whole turns about the bed's middle, so that harmonics do not look like scale."""
    low, high = printer.motor_range_mm(motor)
    length = max(math.floor((high - low) / turn_mm), 1) * turn_mm
    return (low + high) / 2 + length * (np.arange(4000) / 4000 - 0.5)


def export_klipper(mechanism: Mechanism, simple: Simple | None = None) -> Export:
    """Return printer.cfg lines and SET_SKEW: Klipper has no backlash compensation of its own."""
    simple, printer = simple or simple_part(mechanism), mechanism.printer
    lines = [
        "# Compare each value with the one in your printer.cfg and keep a copy of that file: it undoes all of this."
    ]
    for motor, name in enumerate(("stepper_x", "stepper_y")):
        if simple.gain[motor] == 1.0:
            continue
        turn_mm = printer.axes[motor].mm_per_turn
        distance = turn_mm * simple.gain[motor]
        lines += [
            f"[{name}]", f"rotation_distance: {distance:.6f}",
            f"# assumes {turn_mm:g} until now; if yours is another, multiply it by {simple.gain[motor]:.6f}",
            f"# to undo: rotation_distance: {turn_mm:.6f}", "",
        ]  # fmt: skip
    if simple.skew:
        # SET_SKEW wants three lengths of a printed square: the diagonals AC and BD, and the side AD.
        angle = math.pi / 2 - math.atan(simple.skew)
        ac = SKEW_SIDE_MM * math.sqrt(2 + 2 * math.cos(angle))
        bd = SKEW_SIDE_MM * math.sqrt(2 - 2 * math.cos(angle))
        lines += [
            "[skew_correction]",
            "",
            "# once, at the console:",
            f"# SET_SKEW XY={ac:.4f},{bd:.4f},{SKEW_SIDE_MM:.4f}",
            "# to undo: SET_SKEW CLEAR=1; only you can store it, once a print has shown that it helps",
        ]
    return _export(mechanism, (("klipper.cfg", "\n".join(lines) + "\n"),), _simple_drive(mechanism, simple, play=False))


def export_marlin(mechanism: Mechanism, simple: Simple | None = None) -> Export:
    """Return M92, M852 and M425 for values that change; backlash only if each motor moves one axis: on a CoreXY, Marlin
    compensates it only if it was compiled so."""
    simple, printer = simple or simple_part(mechanism), mechanism.printer
    play = _play_words(simple) if printer.kinematics == "cartesian" else ""
    lines = _steps(printer, simple, "M503")
    if simple.skew:
        lines.append(f"M852 I{simple.skew:.6f} ; skew")
    if play:
        lines.append(f"M425 F1 {play} ; backlash")
    lines += _undo(printer, simple, ["M852 I0"] * bool(simple.skew) + ["M425 F0"] * bool(play))
    return _export(
        mechanism, (("marlin.gcode", "\n".join(lines) + "\n"),), _simple_drive(mechanism, simple, play=bool(play))
    )


def export_rrf(mechanism: Mechanism, simple: Simple | None = None) -> Export:
    """Return config.g lines for RepRapFirmware: M92, M556 and M425.

    M556 is added, x + tan·y, where Marlin subtracts: an acute angle between the axes is negative. M425 takes motors,
    so X and Y are A and B of a CoreXY. It spreads the backlash over S times itself, ten times by default; S1 takes it
    up at once.
    """
    simple, printer = simple or simple_part(mechanism), mechanism.printer
    play = _play_words(simple)
    lines = _steps(printer, simple, "M92 alone")
    if simple.skew:
        lines.append(f"M556 S{SKEW_SIDE_MM:.0f} X{-SKEW_SIDE_MM * simple.skew:.4f} ; skew")
    if play:
        of = "" if printer.kinematics == "cartesian" else " of motors A (X) and B (Y)"
        lines.append(f"M425 {play} S1 ; backlash{of}")
    none = " ".join(f"{word[0]}0" for word in play.split())
    lines += _undo(printer, simple, ["M556 S100 X0"] * bool(simple.skew) + [f"M425 {none}"] * bool(play))
    return _export(
        mechanism, (("config.g", "\n".join(lines) + "\n"),), _simple_drive(mechanism, simple, play=bool(play))
    )


def export_linuxcnc(mechanism: Mechanism) -> Export:
    """Return a nominal-forward-reverse compensation file for each joint, and the lines for the INI file.

    LinuxCNC adds nominal − forward (or − reverse) at the nominal position to the motor's command. With nominal minus
    the exact correction in the table, this is the exact inverse of the branch, whatever its slope.
    """
    printer = mechanism.printer
    files, places, trims = [], [], []
    ini = []
    for motor, table in enumerate(mechanism.transmissions):
        low, high = printer.motor_range_mm(motor)
        nominal = np.linspace(low, high, LINUXCNC_POINTS)
        forward = _inverse(table, table.lower_mm, nominal) - nominal
        reverse = _inverse(table, table.upper_mm, nominal) - nominal
        rows = zip(nominal, nominal - forward, nominal - reverse, strict=True)
        name = f"joint{motor}.comp"
        files.append((name, "".join(f"{n:.5f} {f:.5f} {r:.5f}\n" for n, f, r in rows)))
        ini += [f"[JOINT_{motor}]", f"COMP_FILE = {name}", "COMP_FILE_TYPE = 0", "BACKLASH = 0", ""]
        places.append(nominal)
        trims.append((forward, reverse))

    def drive(motors: np.ndarray, direction: np.ndarray) -> np.ndarray:
        commands = np.empty_like(motors)
        for i in range(2):
            forward, reverse = (np.interp(motors[:, i], places[i], trim) for trim in trims[i])
            commands[:, i] = motors[:, i] + np.where(direction[:, i] > 0, forward, reverse)
        return commands

    return _export(mechanism, (("joints.ini", "\n".join(ini)), *files), drive)


EXPORTS: dict[str, Callable[..., Export]] = {
    "klipper": export_klipper,
    "marlin": export_marlin,
    "rrf": export_rrf,
    "linuxcnc": export_linuxcnc,
}


NO_BACKLASH = {"klipper": "no-backlash-klipper", "marlin": "no-backlash-marlin"}


def remainder(export: Export) -> str:
    """Say which error the firmware corrects, which remains, and which settings are left out."""
    without_mm, with_mm = (np.hypot(each, export.doubt_mm) for each in (export.before_mm, export.after_mm))
    expected_mm = (without_mm, with_mm, export.before_mm, export.after_mm)
    said = say("export-remainder", *(f"{each:.3f}" for each in expected_mm))
    return together("\n", [said, *(say("export-left-out", each) for each in export.left_out)])


def _undo(printer: Printer, simple: Simple, more: list[str]) -> list[str]:
    """Return comments that say how to undo the settings, and that nothing stores them."""
    healthy = [f"M92 {steps}" for steps in [_steps_words(printer, simple.gain, (1.0, 1.0))] if steps]
    return [
        "; these hold until the printer restarts: nothing here stores them in the firmware",
        f"; to undo now: {', '.join([*healthy, *more])} (or the values that your firmware had)",
    ]


def _steps(printer: Printer, simple: Simple, asked: str) -> list[str]:
    """Return the steps per mm, and their assumptions; ``asked`` is the command that shows the printer's own."""
    if not (steps := _steps_words(printer, simple.gain)):
        return []
    healthy = _steps_words(printer, simple.gain, (1.0, 1.0))
    shares = [f"{letter} by {1 / gain:.6f}" for letter, gain in zip("XY", simple.gain, strict=True) if gain != 1.0]
    return [
        f"M92 {steps} ; steps a millimetre",
        f"; assumes {healthy} until now; if {asked} shows other values, multiply those: {' and '.join(shares)}",
    ]


def _steps_words(printer: Printer, gain: tuple[float, float], new: tuple[float, float] | None = None) -> str:
    """Return the steps per mm of the motors whose gain is not 1, at the gains ``new`` (default: ``gain``)."""
    return " ".join(
        f"{letter}{axis.steps_per_turn * axis.microsteps / (axis.mm_per_turn * value):.5f}"
        for letter, axis, old, value in zip("XY", printer.axes[:2], gain, new or gain, strict=True)
        if old != 1.0
    )


def _play_words(simple: Simple) -> str:
    """Return the backlash of each motor that has any."""
    return " ".join(f"{letter}{play:.4f}" for letter, play in zip("XY", simple.play_mm, strict=True) if play)


def _inverse(table: Transmission, branch: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Return the motor positions at which a non-decreasing branch has the wanted values."""
    rising = np.concatenate([[True], np.diff(branch) > 0])
    return np.interp(wanted, branch[rising], table.motor_mm[rising])


Drive = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""A firmware: it maps wanted motor positions [N, 2] and directions [N, 2] to commanded positions [N, 2]."""


def _simple_drive(mechanism: Mechanism, simple: Simple, *, play: bool) -> Drive:
    """Return a firmware that corrects scale, skew and, with ``play``, constant backlash, all relative to home."""
    printer = mechanism.printer
    home = printer.to_motor(np.array(printer.home_mm))

    def drive(motors: np.ndarray, direction: np.ndarray) -> np.ndarray:
        bed = printer.from_motor(motors)
        bed = np.stack([bed[:, 0] - simple.skew * bed[:, 1], bed[:, 1]], axis=1)
        commands = home + (printer.to_motor(bed) - home) / np.array(simple.gain)
        if play:
            commands = commands + np.where(direction > 0, 0.5, -0.5) * np.array(simple.play_mm) / np.array(simple.gain)
        return np.asarray(commands)

    return drive


def _export(mechanism: Mechanism, files: tuple[tuple[str, str], ...], drive: Drive) -> Export:
    """Return the files with the expected errors without and with them."""
    before = _error_mm(mechanism, lambda motors, direction: motors)
    return Export(files, before, _error_mm(mechanism, drive))


def _error_mm(mechanism: Mechanism, drive: Drive) -> float:
    """Return the RMS error [mm] of a firmware over moves across the bed, without the mean shift."""
    printer = mechanism.printer
    low, high = np.array([printer.x.min_mm, printer.y.min_mm]), np.array([printer.x.max_mm, printer.y.max_mm])
    # A fixed low-discrepancy walk over the middle 80 % of the bed makes the figure reproducible.
    steps = np.arange(1, _MOVES + 1)[:, None] * np.array([math.sqrt(2), math.sqrt(3)])
    targets = low + (high - low) * (0.1 + 0.8 * np.mod(steps, 1.0))
    motors = printer.to_motor(targets)
    direction = np.sign(np.diff(motors, axis=0, prepend=motors[:1] - 1.0))
    commands = drive(motors, direction)
    # The belts begin where the first move pushes them.
    error = print_path(mechanism, commands, np.full(2, -np.inf)) - targets
    error = error - error.mean(axis=0)
    return float(np.sqrt(np.mean(np.sum(error**2, axis=1))))
