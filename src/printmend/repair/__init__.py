"""Mend G-code: read → interpret → invert → write → predict, in one pass over a file of any size."""

from printmend.promise.predict import Promise
from printmend.repair.mend import Mended, check_gcode, mend_gcode
from printmend.repair.prediction import Prediction

__all__ = ["Mended", "Prediction", "Promise", "check_gcode", "mend_gcode"]
