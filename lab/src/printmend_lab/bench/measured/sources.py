"""Where measured sets come from: licence, the command that fetches them, the file, and the split.

The splits were fixed before any learner was judged on them; `tests/test_bench_measured.py` keeps their digest. Files
are looked for below the folder that is given to `printmend bench measured`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from printmend_lab.bench.measured import forms
from printmend_lab.bench.measured.tracks import MeasuredSet

_NONLINEAR = (
    "pip install nonlinear_benchmarks && python -c 'import nonlinear_benchmarks as n;"
    " print(n.{call}(data_file_locations=True))'"
)


@dataclass(frozen=True)
class Source:
    """A file of measured data, or a folder, at ``place`` below the given folder."""

    name: str
    place: str
    licence: str
    origin: str
    fetch: str
    split: str
    read: Callable[[Path], list[MeasuredSet]]


SOURCES = (
    Source(
        "pulleys", "noncircular_pulleys_mocap", "MIT",
        "RenzoCab/Non-Circular-Pulleys: motion capture of a belt printer with printed non-circular pulleys",
        "git clone https://github.com/RenzoCab/Non-Circular-Pulleys noncircular_pulleys_mocap",
        "each shape and speed: the first traverse of either direction is learned from, the later ones are judged",
        forms.read_pulleys,
    ),
    Source(
        "encoder", "stepper_encoder_lut", "CC-BY-SA-4.0",
        "Kaiwol1990/Mechaduino: the calibration of one real stepper motor's magnetic encoder",
        "git clone https://github.com/Kaiwol1990/Mechaduino stepper_encoder_lut"
        " && git -C stepper_encoder_lut checkout 6907156ce7fb9cb83bddf756bd1a21a9b9e1e544",
        "every 64th count is learned from, the counts half-way between are judged",
        forms.read_encoder,
    ),
    Source(
        "servo", "servo/motor_telemetry_nocomp2.csv", "CC-BY-4.0",
        "B. Kotov: backlash of Feetech STS3215 servos over UART",
        "git clone https://github.com/roboninecom/Measuring-Backlash-in-Popular-UART-Servos servo"
        " && cp servo/logs/*.csv servo/",
        "settled rows of each motor that moved: the first half in time is learned from, the second is judged",
        forms.read_servo,
    ),
    Source(
        "damper", "friction_damper/0.5Hz20lbtension.json", "CC-BY-SA-4.0",
        "D. Coble et al.: a banded rotary friction damper with backlash, force over displacement",
        "git clone https://github.com/ARTS-Laboratory/Dataset-Friction-Damper-with-Backlash friction_damper"
        " && cp friction_damper/data/dataset-1/'characterization datasets'/*.json friction_damper/",
        "every 8th sample of the first half is learned from, of the second half is judged",
        forms.read_damper,
    ),
    Source(
        "tanks", "cascaded_tanks/dataBenchmark.mat", "see nonlinearbenchmark.org",
        "M. Schoukens et al.: cascaded tanks with overflow, nonlinearbenchmark.org",
        _NONLINEAR.format(call="Cascaded_Tanks"),
        "the benchmark's own: uEst and yEst are learned from, uVal and yVal are judged",
        forms.read_tanks,
    ),
    Source(
        "bouc-wen", "bouc_wen", "see nonlinearbenchmark.org",
        "J. P. Noel and M. Schoukens: hysteretic benchmark with a dynamic nonlinearity, nonlinearbenchmark.org",
        _NONLINEAR.format(call="not_splitted_benchmarks.BoucWen"),
        "the first half of the multisine is learned from, its second half and the sine sweep are judged",
        forms.read_bouc_wen,
    ),
    Source(
        "dimensions", "dimensions.csv", "as your table says",
        "a table of a part's dimensions, such as NIST's additive manufacturing test artifact (Moylan et al. 2014) or"
        " J. L. Messimer et al., J. Manuf. Mater. Process. 3 (2019) 6",
        "write a CSV of axis,nominal_mm,measured_mm, one line a measurement, from the published table",
        "of each axis every other line is learned from, beginning with the first; the others are judged",
        forms.read_dimensions,
    ),
    Source(
        "specimens", "specimens", "as the article's archive says",
        "F. W. Baumann, J. R. Eichhoff and D. Roller (University of Stuttgart): Scanned Image Data from 3D-Printed"
        " Specimens Using Fused Deposition Modeling, Data 2 (2017)",
        "get the archive that the article names, put its PNG scans into specimens/ beside a nominal.csv of"
        " file,dpi,length_mm,width_mm,neck_mm, one line a scan",
        "every other scan is learned from, beginning with the first; the others are judged",
        forms.read_specimens,
    ),
)  # fmt: skip


def source(name: str) -> Source:
    """Return the source of that name."""
    return next(item for item in SOURCES if item.name == name)
