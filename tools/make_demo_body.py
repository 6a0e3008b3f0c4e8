"""Build and slice the body that ships with printmend: `.venv/bin/python tools/make_demo_body.py`.

Needs PrusaSlicer. Writes src/printmend/demo/timing_pulley.gcode without the slicer's dump of its settings,
which are in lab/src/printmend_lab/body/profiles/ender5_abs.ini. The file that ships was made when this profile had
seams at the nearest corner and walls of varied width: made again, it differs.
"""

from pathlib import Path

from printmend.files import replacing
from printmend.printer import read_printer
from printmend_lab.body.generated import timing_pulley
from printmend_lab.body.slicer import slice_solid

TARGET = Path(__file__).resolve().parents[1] / "src" / "printmend" / "demo" / "timing_pulley.gcode"


def main() -> None:
    gcode = slice_solid(timing_pulley(), read_printer("ender5"))
    with replacing(TARGET, "wb") as file:
        file.write(gcode.partition(b"\n; prusaslicer_config = begin")[0])
    print(f"{TARGET}: {TARGET.stat().st_size} bytes")


if __name__ == "__main__":
    main()
