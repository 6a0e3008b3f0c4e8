"""The part that ships with printmend: a 60-tooth GT2 timing pulley, sliced by `tools/make_demo_body.py`."""

from importlib import resources


def demo_body_gcode() -> bytes:
    """Return the pulley's G-code as sliced for the Ender-5 in ABS."""
    return (resources.files("printmend.demo") / "timing_pulley.gcode").read_bytes()
