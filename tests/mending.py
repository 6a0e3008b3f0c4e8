"""What the tests of mending share: mend a text in memory, print it on the naive printer, measure."""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from printmend.corruption import Corruption, Drive
from printmend.corruption.transmission import EccentricBore, Play
from printmend.gcode.kernels import ROLE_UNKNOWN
from printmend.gcode.machine import Flavour, initial_state
from printmend.gcode.write import rewrite
from printmend.machine import Mechanism, Transmission
from printmend.mend.prediction import Prediction, prediction_of
from printmend.model import SavedModel, exact_model
from printmend.model.model import model_text
from printmend.plan import start
from printmend.printer import Printer, read_printer
from printmend.twin import Twin
from tests import naive_mend

ENDER3, ENDER5, COREXY = read_printer("ender3"), read_printer("ender5"), read_printer("corexy")
COARSER = 16  # rows of a machine's tables for one of ours: a row for each micro-step makes a file of megabytes


def coarsely(corruption: Corruption, printer: Printer = ENDER3) -> Mechanism:
    """Return a machine with a corruption after homing, straight between the rows of its tables."""
    fine = Twin.of(corruption, printer).homed()
    sides = (
        Transmission(side.first_mm, COARSER * side.pitch_mm, side.lower_mm[::COARSER], side.upper_mm[::COARSER])
        for side in fine.transmissions
    )
    return replace(fine, transmissions=tuple(sides))


PLAY = coarsely(Corruption((Drive(belt=Play(0.4)), Drive(belt=Play(0.7)))))
BENT = coarsely(
    Corruption(
        (Drive(pulley=EccentricBore(0.5, 1.0), belt=Play(0.4)), Drive(pulley=EccentricBore(0.3), belt=Play(0.6)))
    )
)
START = b"G21\nG90\nM83\nG28\nG1 Z0.2 F600\nG0 X60 Y60 F6000\n"
SQUARE = START + b"G1 X80 Y60 E1 F1800\nG1 X80 Y80 E1\nG1 X60 Y80 E1\nG1 X60 Y60 E1\n"


@cache
def exactly(mechanism: Mechanism) -> SavedModel:
    """The model of a mechanism that is known exactly, made once."""
    return exact_model(mechanism)


@cache
def text_of(mechanism: Mechanism) -> str:
    """The model file of a mechanism that is known exactly, written once: its tables are long."""
    return model_text(exactly(mechanism))


@cache
def tolerance_mm(mechanism: Mechanism) -> float:
    """Return how far lines without a type may be off on a machine."""
    return float(start(mechanism).tolerances_mm[ROLE_UNKNOWN])


def mended(
    text: bytes, mechanism: Mechanism, flavour: Flavour = Flavour.KLIPPER, **options: float
) -> tuple[bytes, Prediction]:
    """Mend a text in memory, without the mark."""
    planner = start(mechanism, **options)
    state = initial_state(mechanism.printer, flavour)
    chunk = np.frombuffer(text, np.uint8)
    written = b"".join(bytes(view) for view in rewrite([chunk], state, planner.plan))
    return written, prediction_of(planner)


@dataclass(frozen=True, eq=False)
class Judged:
    """A mended text and how far its print is from the wanted path [mm]."""

    text: bytes
    prediction: Prediction
    before: np.ndarray
    after: np.ndarray
    wanted: list[naive_mend.Move]
    given: list[naive_mend.Move]

    @property
    def rms_mm(self) -> float:
        return naive_mend.rms(self.after)


def judge(text: bytes, mechanism: Mechanism, **options: float) -> Judged:
    """Mend a text, print the original and the mended one on the naive printer."""
    written, prediction = mended(text, mechanism, **options)
    home = tuple(axis.home_mm for axis in mechanism.printer.axes)
    wanted, given = naive_mend.read_moves(text, home), naive_mend.read_moves(written, home)
    before = naive_mend.contour_errors_mm(wanted, wanted, naive_mend.print_moves(wanted, mechanism))
    # where the screw is bad the file's own heights are not where the mended nozzle is
    lifted = None if mechanism.screw is None else naive_mend.lift_moves(given, mechanism)
    after = naive_mend.contour_errors_mm(wanted, given, naive_mend.print_moves(given, mechanism), lifted)
    return Judged(written, prediction, before, after, wanted, given)
