"""Bodies: mesh → slicer → G-code → layers → controls on the lattice of full steps."""

from printmend.body.load import MIN_POINTS, body_of, load_body, place
from printmend.body.pulley import demo_body_gcode

__all__ = ["MIN_POINTS", "body_of", "demo_body_gcode", "load_body", "place"]
