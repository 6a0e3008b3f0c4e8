"""Test objects that excite every angle of every pulley, in both directions, with many reversals."""

from printmend.probe.gcode import cost, probe_gcode
from printmend.probe.probe import design_probe, turns_covered, write_probe

__all__ = ["cost", "design_probe", "probe_gcode", "turns_covered", "write_probe"]
