"""What the page without a server is made of: the law in JavaScript, and the printer that one plays with, as JSON."""

from typing import Any

from translate import module_text

from printmend.machine import healthy_transmission, z_grid_mm
from printmend.machine.kernels import bed, play, table
from printmend.studio import kernels, plate
from printmend.studio.play import _SCREW_PHASE_RAD, play_layer, play_printer
from printmend.studio.scene import NEAR
from printmend.studio.sliders import MOST_DENT_MM

_BED = ["mixed", "unmixed", "to_motors", "from_motors", "_polynomial", "_derivatives", "_waved",
        "_waved_derivatives", "onto_bed", "slopes", "off_bed"]  # fmt: skip


def law() -> str:
    """Return the kernels of the law as a module of JavaScript."""
    head = "// Made by tools/site/make_site.py of the program's own kernels.\n"
    texts = [module_text(play, ["clip"]), module_text(table, ["branch_at", "push_at"]), module_text(bed, _BED),
             module_text(kernels, ["distances"])]  # fmt: skip
    return head + "\n".join(texts)


def printer() -> dict[str, Any]:
    """Return the printer, its test print and a layer of its part, as faults.js takes them."""
    one, plan = play_printer()
    places, joined = play_layer()
    axes = []
    for motor in range(2):
        drive = healthy_transmission(one, motor)
        axes.append({"radius_mm": one.axes[motor].radius_mm, "mm_per_turn": one.axes[motor].mm_per_turn,
                     "first_mm": drive.first_mm, "pitch_mm": drive.pitch_mm, "count": len(drive.lower_mm),
                     "home_way": one.motor_home_direction(motor)})  # fmt: skip
    heights, first_mm, pitch_mm = z_grid_mm(one)
    return {
        "axes": axes, "home_mm": list(one.home_mm), "corexy": one.kinematics == "corexy", "near": NEAR,
        "most_dent_mm": MOST_DENT_MM, "bed_mm": [one.x.min_mm, one.y.min_mm, one.x.max_mm, one.y.max_mm],
        "waypoints_mm": plan.waypoints_mm.tolist(), "rows": plan.rows.tolist(), "marks_mm": plan.marks_mm.tolist(),
        "big": plan.big.tolist(), "part": {"places_mm": places.tolist(), "joined": joined.tolist()},
        "screw": {"first_mm": first_mm, "pitch_mm": pitch_mm, "count": len(heights), "phase_rad": _SCREW_PHASE_RAD,
                  "mm_per_turn": one.z.mm_per_turn,
                  "heights_mm": [(n + 1) * plate.LAYER_MM for n in range(len(plate.layers()))]},
    }  # fmt: skip
