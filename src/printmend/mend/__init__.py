"""Mend G-code: read → interpret → invert → write → predict, in one pass over a file of any size."""

from printmend.mend.mend import Mended, check_gcode, mend_gcode
from printmend.mend.prediction import Prediction
from printmend.promise.predict import Promise

__all__ = ["Mended", "Prediction", "Promise", "check_gcode", "mend_gcode"]
