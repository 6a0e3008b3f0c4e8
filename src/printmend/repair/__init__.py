"""Mend G-code: read → interpret → invert → write → predict, in one pass over a file of any size."""

from printmend.repair.mend import Mended, check_gcode, mend_gcode
from printmend.repair.prediction import Errors, Prediction

__all__ = ["Errors", "Mended", "Prediction", "check_gcode", "mend_gcode"]
