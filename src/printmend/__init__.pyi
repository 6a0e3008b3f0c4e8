"""The public names and where they live; `printmend/__init__.py` imports each when it is first used."""

from .corruption.toml import read_corruption
from .errors import PrintmendError
from .learn.learned import learn_model
from .measure.measurement import measure_scans
from .measure.table import read_trace
from .mend.against import judge_gcode
from .mend.mend import check_gcode, mend_gcode
from .model.model import read_model, write_model
from .path import Trace
from .printer.toml import read_printer
from .probe.probe import design_probe, write_probe
from .twin.gcode import print_gcode
from .twin.twin import Twin

__all__ = [
    "PrintmendError",
    "Trace",
    "Twin",
    "check_gcode",
    "design_probe",
    "judge_gcode",
    "learn_model",
    "measure_scans",
    "mend_gcode",
    "print_gcode",
    "read_corruption",
    "read_model",
    "read_printer",
    "read_trace",
    "write_model",
    "write_probe",
]

__version__: str
