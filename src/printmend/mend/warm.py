"""Compile the kernels of all commands beforehand, by running each once on a small example."""

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import cast

from printmend.corruption import Corruption, Drive, FourierHull, Play, Screw
from printmend.jit import compilations
from printmend.learn.learned import learn_model
from printmend.machine import Mechanism
from printmend.mend.mend import mend_gcode
from printmend.model import exact_model
from printmend.printer import read_printer
from printmend.probe.probe import design_probe, write_probe
from printmend.twin.gcode import print_gcode
from printmend.twin.twin import Twin

_PART = (
    "G28\nG90\nM83\nG1 Z0.2 F3000\nG1 X40 Y40\nG1 X60 Y42 E1\nG1 X40 Y60 E1\nG2 X50 Y50 I10 J0 E1\nG1 Z0.4\nG1 X40 E1\n"
)
_PULLEY = FourierHull(6.379, (-0.015, 0.017, -0.021, -0.001), (0.018, 0.023, 0.014, -0.008))
_BROKEN = {
    "pulleys and belts": Corruption((Drive(pulley=_PULLEY, belt=Play(0.13)), Drive(pulley=_PULLEY, belt=Play(0.11)))),
    "a bent Z screw": Corruption(screw=Screw(lead_error=-0.003, periodic_mm=0.005, wobble_mm=0.04, backlash_mm=0.04)),
}
# Name of each step: the action and its broken printer.
STEPS = {f"{what}: {words}": (what, broken) for words, broken in _BROKEN.items() for what in ("mend", "learn")}


def warm(done: Callable[[str], None]) -> tuple[int, float]:
    """Learn and mend on simulated printers, calling ``done`` after each of `STEPS` with its name.

    Return how many kernels this compiled, and in how many seconds; kernels compiled earlier are not compiled again.
    """
    before = compilations.entries, compilations.seconds
    for step in STEPS:
        take(step)
        done(step)
    return compilations.entries - before[0], compilations.seconds - before[1]


def take(step: str) -> None:
    """Take one of `STEPS`."""
    what, broken = STEPS[step]
    printer = read_printer("ender3")
    with tempfile.TemporaryDirectory(prefix="printmend-") as name:
        if what == "mend":
            part = Path(name) / "part.gcode"
            part.write_text(_PART, encoding="utf-8")
            model = exact_model(cast(Mechanism, broken.lower(printer)))
            mend_gcode(part, model, part.with_suffix(".mended"), force=True)
        else:
            probe = Path(name) / "probe.gcode"
            write_probe(probe, design_probe(printer))
            learn_model(print_gcode(probe, Twin.of(broken, printer), noise_mm=0.02), printer)
