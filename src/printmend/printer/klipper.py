"""Read a printer from the sections [stepper_x], [stepper_y], [stepper_z] and [printer] of Klipper's printer.cfg."""

import configparser
from configparser import SectionProxy

from printmend.errors import ConfigError
from printmend.messages import say
from printmend.printer.printer import KLIPPER_PAUSE, Axis, Homing, MotionLimits, Printer, Switch

# Klipper's defaults for absent keys (its Config Reference).
_FULL_STEPS, _MICROSTEPS = 200, 16
_KLIPPER_TODO = say("give-file-holds-sections-stepper-stepper")


def is_klipper(text: str) -> bool:
    """Return whether a text looks like a printer.cfg."""
    return "[stepper_x]" in text


def parse_klipper(text: str, *, name: str, subject: str) -> Printer:
    """Build a printer from the text of a printer.cfg.

    Raises `ConfigError` for kinematics other than cartesian and corexy, and for values that are missing or no numbers.
    """
    config = configparser.RawConfigParser(strict=False, delimiters=("=", ":"), inline_comment_prefixes=("#", ";"))
    try:
        config.read_string(text)
    except configparser.Error as error:
        came = str(error).splitlines()[0]
        raise ConfigError(subject, wanted=say("printer-cfg"), came=came, todo=_KLIPPER_TODO) from None
    kinematics = config.get("printer", "kinematics", fallback="none")
    if kinematics not in ("cartesian", "corexy"):
        todo = say("use-cartesian-corexy-printer-no-other")
        raise ConfigError(subject, wanted=say("kinematics-cartesian-corexy"), came=kinematics, todo=todo)
    x, y, z = (_axis(config, axis, subject) for axis in "xyz")
    return Printer(
        name,
        "corexy" if kinematics == "corexy" else "cartesian",
        x,
        y,
        z,
        pause_gcode=KLIPPER_PAUSE,
        homing=Homing(_switch(config)),
        limits=_limits(config, subject),
    )


def _limits(config: configparser.RawConfigParser, subject: str) -> MotionLimits:
    """Return the head's largest speed and acceleration, None where they are missing."""
    try:
        speed, accel = (config.getfloat("printer", key, fallback=None) for key in ("max_velocity", "max_accel"))
    except ValueError as error:
        wanted = say("numbers-max-velocity-max-accel-printer")
        raise ConfigError(subject, wanted=wanted, came=str(error), todo=_KLIPPER_TODO) from None
    return MotionLimits(speed, accel)


def _axis(config: configparser.RawConfigParser, name: str, subject: str) -> Axis:
    """Return one axis; missing keys follow the rules of Klipper's own reader."""
    section = f"stepper_{name}"
    if not config.has_section(section):
        raise ConfigError(subject, wanted=say("section", section), came=say("none"), todo=_KLIPPER_TODO)
    stepper = config[section]

    def number(key: str, otherwise: float | None = None) -> float:
        try:
            if key not in stepper and otherwise is not None:
                return otherwise
            return float(stepper[key])
        except (KeyError, ValueError):
            came = stepper.get(key, say("such-key"))
            raise ConfigError(
                subject, wanted=say("number-for-key-in-section", key, section), came=came, todo=_KLIPPER_TODO
            ) from None

    steps, microsteps = round(number("full_steps_per_rotation", _FULL_STEPS)), round(number("microsteps", _MICROSTEPS))
    if "rotation_distance" in stepper:
        mm_per_turn = number("rotation_distance") / _gear_ratio(stepper, subject)
    else:  # before 2021: millimetres a micro-step
        mm_per_turn = number("step_distance") * steps * microsteps
    low_mm, high_mm = number("position_min", 0.0), number("position_max")
    home_mm = low_mm if name != "z" else 0.0
    if "position_endstop" in stepper:
        home_mm = number("position_endstop")
    towards_max = stepper.get("homing_positive_dir", "").lower() in ("true", "1", "yes")
    if "homing_positive_dir" not in stepper:
        towards_max = home_mm > high_mm - (high_mm - low_mm) / 4
    side = "max" if towards_max else "min"
    return Axis(name, low_mm, high_mm, steps, mm_per_turn, microsteps, home_mm, "max" if side == "max" else "min")


def _gear_ratio(stepper: SectionProxy, subject: str) -> float:
    """Return motor turns for a turn of the output: 80:16 is 5, chains are multiplied."""
    ratio = 1.0
    for pair in filter(None, (part.strip() for part in stepper.get("gear_ratio", "").split(","))):
        teeth, _, motor = pair.partition(":")
        try:
            ratio *= float(teeth) / float(motor)
        except (ValueError, ZeroDivisionError):
            raise ConfigError(subject, wanted=say("gear-ratio-80-16"), came=pair, todo=_KLIPPER_TODO) from None
    return ratio


def _switch(config: configparser.RawConfigParser) -> Switch:
    """Return how X and Y find home: the worse of the two if they differ."""
    stepper = [f"stepper_{axis}" for axis in "xy"]
    if any("virtual_endstop" in config.get(name, "endstop_pin", fallback="") for name in stepper):
        return "sensorless"
    has_phase = config.has_section("endstop_phase") or all(config.has_section(f"endstop_phase {n}") for n in stepper)
    return "phase" if has_phase else "unknown"
