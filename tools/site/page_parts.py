"""What the page without a server is made of: the law in JavaScript, and the printer that one plays with, as JSON."""

import importlib
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from translate import HELPERS, file_of, module_text, whole_text

from printmend.gcode.container import open_gcode
from printmend.gcode.kernels import PIECE
from printmend.gcode.read import starting_state
from printmend.gcode.write import follow
from printmend.machine import healthy_transmission, z_grid_mm
from printmend.machine.kernels import bed, play, table
from printmend.studio import kernels
from printmend.studio import play as plate
from printmend.studio.offered import MOST_DENT_MM
from printmend.studio.play import _SCREW_PHASE_RAD, play_layer, play_printer
from printmend.studio.scene import NEAR, read_motion

_BED = ["mixed", "unmixed", "to_motors", "from_motors", "_polynomial", "_derivatives", "_waved",
        "_waved_derivatives", "onto_bed", "slopes", "off_bed"]  # fmt: skip


def law() -> str:
    """Return the kernels of the law as a module of JavaScript."""
    head = "// Made by tools/site/make_site.py of the program's own kernels.\n"
    texts = [module_text(play, ["clip"]), module_text(table, ["branch_at", "push_at"]), module_text(bed, _BED),
             module_text(kernels, ["distances"])]  # fmt: skip
    return head + "\n".join(texts)


_PLANNER = "printmend.plan.kernels.mend"
# What only adds up the promise of a file: the page prints the part instead.
_UNUSED = {"predict_raw", "note", "keep", "note_height", "layer_of", "_from_home", "samples_of"}
_COLUMNS = ["kind", "event", "axes", "x0", "y0", "z0", "x1", "y1", "z1", "advance", "feed", "words", "flags"]


def planner() -> dict[str, str]:
    """Return the planner's kernels as modules of JavaScript, by their files' names."""
    files, asked, known = {"helpers.js": HELPERS}, [_PLANNER], set()
    while asked:
        name = asked.pop()
        if name not in known:
            known.add(name)
            files[file_of(name)], more = whole_text(importlib.import_module(name), _UNUSED)
            asked += more
    return files


def part() -> dict[str, Any]:
    """Return the moves of the part as the planner reads them, by columns; and of those that move what they draw."""
    one, _ = play_printer()
    with tempfile.TemporaryDirectory() as folder:
        (path := Path(folder) / "part.gcode").write_bytes(plate.plate_gcode(one))
        kept: list = []

        def keep(records: Any, begin: int) -> Any:
            kept.append(records[begin:].copy())
            return len(records), np.zeros(len(records) + 1, np.int64), np.empty(0, PIECE)

        with open_gcode(path) as file:
            follow(file.parts[0].chunks(), starting_state(file.parts[0], printer=one), keep)
        motion = read_motion(path, one)
    records = np.concatenate(kept)
    rows = [np.nan_to_num(records[name]).tolist() for name in _COLUMNS]
    plain = {"layer": 0, "line": 0, "accel": 0, "next": 0, "end": 1, "turns": 0, "plane": 0}
    rows += [[value] * len(records) for value in plain.values()]
    return {"columns": [*_COLUMNS, *plain], "rows": rows, "drawn": motion.drawn.astype(int).tolist(),
            "layer": motion.layer.tolist()}  # fmt: skip


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
        "home_sides": [one.x.home_direction, one.y.home_direction],
        "screw": {"limits_mm": [one.z.min_mm, one.z.max_mm], "home_mm": one.z.home_mm,
                  "home_side": one.z.home_direction, "first_mm": first_mm, "pitch_mm": pitch_mm,
                  "count": len(heights), "phase_rad": _SCREW_PHASE_RAD, "mm_per_turn": one.z.mm_per_turn,
                  "heights_mm": [(n + 1) * plate.LAYER_MM for n in range(len(plate.layers()))]},
    }  # fmt: skip
