"""Draw a probe with a pen in a clip on the tool head: no heat, no plastic, a sheet of paper on the bed.

The pen comes down for a dot, which is as large as the pen's tip. A large dot is a small circle around a dot. It is part
of the code, but is not measured, because its middle depends on the play.
"""

from dataclasses import replace

import numpy as np

from printmend.measure.plan import ProbePlan
from printmend.path import frozen
from printmend.printer.printer import PAUSE
from printmend.probe.gcode import xy_words
from printmend.probe.paper import Paper, first_touch_mm, sheet_after_sheet

TIP_MM, BIG_MM = 0.8, 1.8  # diameters of a felt pen's dot, and of a circle that it draws
CORNERS = 8  # corners of the polygon that draws this circle
TOUCH_MM, LIFT_MM, PRESS_MM = 5.0, 2.5, 0.1  # tool head's height when the pen is fastened; lift and press from there
DABS, DABS_AGAIN, DAB_MS = 20, 3, 1000  # dabs of the guided dot: a minute to set its height, and a few to check it
LAY_S = 120  # time to lay the paper, if a pause would drive the tool head away
TRAVEL_MM_S, APPROACH_MM_S, CIRCLE_MM_S, DOWN_MM_S, REST_MS = 80.0, 20.0, 5.0, 10.0, 150


def with_pen(plan: ProbePlan) -> ProbePlan:
    """Return the plan for a pen: a circle of way-points after every large mark, back to its middle."""
    if len(plan.sheets) > 1:
        return sheet_after_sheet([with_pen(sheet) for sheet in plan.sheets])
    radius = (BIG_MM - TIP_MM) / 2
    turns = 2 * np.pi * np.arange(CORNERS + 1) / CORNERS
    circle = np.vstack([radius * np.stack([np.cos(turns), np.sin(turns)], axis=1), [[0.0, 0.0]]])
    points, rows, done = [], np.array(plan.rows), 0
    order = np.argsort(plan.rows, kind="stable")
    for mark in order:
        row = int(plan.rows[mark])
        points += [plan.waypoints_mm[done : row + 1]]
        done = row + 1
        if plan.big[mark]:
            points.append(np.round(plan.waypoints_mm[row] + circle, 5))
    points.append(plan.waypoints_mm[done:])
    shift = np.cumsum(np.where(plan.big[order], len(circle), 0)) - np.where(plan.big[order], len(circle), 0)
    rows[order] = plan.rows[order] + shift
    return replace(plan, waypoints_mm=frozen(np.vstack(points)), rows=rows, dot_mm=TIP_MM, big_dot_mm=BIG_MM, pen=True)


def pen_gcode(plan: ProbePlan, paper: Paper | None = None, *, sheet: str = "", pause_gcode: str = PAUSE) -> str:
    """Return the file that draws ``plan``: every way-point is the end of one G0 or G1, in order.

    It waits at the first touch point, so that the owner can lay ``paper`` under the pen, whose offset from the nozzle
    is unknown. There it draws a guided dot: the pen dabs while the owner sets the height in baby-steps. Firmwares
    accept baby-steps during moves; Klipper would undo them at the end of a pause. ``sheet`` says which of several
    sheets it is; ``pause_gcode`` is the printer's command.
    """
    name, place = "a sheet", "Shift the paper until all dots will lie on it; tape it"
    if paper is not None:
        name, (left, front) = f"{sheet or 'a sheet'} of paper ({paper.name})", first_touch_mm(plan, paper)
        place = f"Shift the paper: tip {left:.0f} mm from its left edge, {front:.0f} mm from its front edge; tape it"
    points, dots = plan.waypoints_mm, dict(zip(plan.rows.tolist(), plan.big.tolist(), strict=True))
    up, down = (f"G1 Z{z:g} F{DOWN_MM_S * 60:g}\n" for z in (TOUCH_MM + LIFT_MM, TOUCH_MM - PRESS_MM))
    laying = "Put the paper under the pen, lower the pen until it touches, and fasten it"
    stays = pause_gcode == PAUSE  # other pauses may park the tool head, so they cannot wait for the paper
    dab = f"{down}G4 P{DAB_MS}\n{up}G4 P{DAB_MS}\n"
    lines = [
        f"; printmend probe: {len(plan)} dots with a pen on paper. Printed for: {plan.printer}\n",
        f"; Lay {name} onto the cold bed.\n",
        f"; It waits for you by {pause_gcode}; for another firmware give the printer's TOML its pause_gcode.\n",
        "G21\nG90\nG28\nG1 Z40 F600\n", _waits(pause_gcode, "Put the pen into its clip, loosely, with the tip up"),
        f"G0 {xy_words(points[1])} F{TRAVEL_MM_S * 60:g}\n", f"G0 {xy_words(points[2])}\n",
        f"G1 Z{TOUCH_MM:g} F600\n", f"; {place}.\n",
        _waits(pause_gcode, laying) if stays else f"M117 {LAY_S // 60} min: {laying}\nG4 P{LAY_S * 1000}\n", up,
        "; The guided dot: while the pen dabs, lower it by baby-steps of Z until it leaves a clear dot.\n",
        "M117 Guided dot: lower Z by baby-steps until it marks\n", dab * DABS,
        _waits(pause_gcode, "A clear dot? If none, lower the pen by a hair in its clip"), dab * DABS_AGAIN,
    ]  # fmt: skip
    row = 3
    while row < len(points):
        feed = APPROACH_MM_S if row in dots else TRAVEL_MM_S
        lines.append(f"G0 {xy_words(points[row])} F{feed * 60:g}\n")
        if row in dots:
            lines += [down, f"G4 P{REST_MS}\n"]
            if dots[row]:
                for _ in range(CORNERS + 2):
                    row += 1
                    lines.append(f"G1 {xy_words(points[row])} F{CIRCLE_MM_S * 60:g}\n")
            lines.append(up)
        row += 1
    lines += ["G1 Z40 F600\n", "M84\n"]
    return "".join(lines)


def _waits(pause_gcode: str, words: str) -> str:
    """Return the lines that show ``words`` and wait for the owner."""
    return f"{PAUSE} {words}\n" if pause_gcode == PAUSE else f"M117 {words}\n{pause_gcode}\n"
