"""Bodies: mesh → slicer → G-code → layers → controls on the lattice of full steps."""

from printmend.demo.contour import demo_body_gcode
from printmend_lab.body.layers import MIN_POINTS, body_of, load_body, place

__all__ = ["MIN_POINTS", "body_of", "demo_body_gcode", "load_body", "place"]
