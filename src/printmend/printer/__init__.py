"""Machine geometry as a frozen value: axes, bed, steps, homing, kinematics."""

from printmend.printer.printer import Axis, Extruder, Homing, Kinematics, MotionLimits, Printer
from printmend.printer.toml import check_preset, preset_names, printer_of, read_printer

__all__ = [
    "Axis",
    "Extruder",
    "Homing",
    "Kinematics",
    "MotionLimits",
    "Printer",
    "check_preset",
    "preset_names",
    "printer_of",
    "read_printer",
]
