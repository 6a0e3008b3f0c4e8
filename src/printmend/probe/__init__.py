"""Test prints that visit every angle of every pulley, in both directions, with many reversals."""

from printmend.probe.gcode import cost, probe_gcode
from printmend.probe.probe import (
    DESIGNS,
    PHASE_MARKS,
    design_probe,
    expected_error_mm,
    phase_size_mm,
    turns_covered,
    write_probe,
)

__all__ = [
    "DESIGNS",
    "PHASE_MARKS",
    "cost",
    "design_probe",
    "expected_error_mm",
    "phase_size_mm",
    "probe_gcode",
    "turns_covered",
    "write_probe",
]
