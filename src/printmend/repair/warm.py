"""Compile beforehand what the commands would compile when they first need it: do all of it once, in the small."""

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import cast

import numpy as np

from printmend.corruption import sample
from printmend.jit import compilations
from printmend.machine import Mechanism
from printmend.printer import read_printer
from printmend.probe.probe import design_probe, write_probe
from printmend.repair.learned import learn_model
from printmend.repair.mend import mend_gcode
from printmend.saved import exact_model
from printmend.twin.gcode import print_gcode
from printmend.twin.twin import Twin

_PART = (
    "G28\nG90\nM83\nG1 Z0.2 F3000\nG1 X40 Y40\nG1 X60 Y42 E1\nG1 X40 Y60 E1\nG2 X50 Y50 I10 J0 E1\nG1 Z0.4\nG1 X40 E1\n"
)
_FAULTS = {"pulleys and belts": "pulley-play", "a bent Z screw": "screw"}
STEPS = 2 * len(_FAULTS)  # that `warm` reports


def warm(done: Callable[[str], None]) -> tuple[int, float]:
    """Learn and mend on simulated printers, calling ``done`` after each of `STEPS` steps with its name.

    Returns how many kernels that compiled, and in how many seconds; what was compiled before is not compiled again.
    """
    before = compilations.entries, compilations.seconds
    printer = read_printer("ender3")
    with tempfile.TemporaryDirectory(prefix="printmend-") as name:
        part, probe = Path(name) / "part.gcode", Path(name) / "probe.gcode"
        part.write_text(_PART)
        write_probe(probe, design_probe(printer))
        for words, family in _FAULTS.items():
            fault = sample(family, np.random.default_rng(1), "realistic")
            mend_gcode(part, exact_model(cast(Mechanism, fault.lower(printer))), part.with_name(family), force=True)
            done(f"mend: {words}")
            learn_model(print_gcode(probe, Twin.of(fault, printer), noise_mm=0.02), printer)
            done(f"learn: {words}")
    return compilations.entries - before[0], compilations.seconds - before[1]
