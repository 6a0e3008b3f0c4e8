"""The plan of a probe print, probe.json: every way-point and every mark, so that a scan of it can be read.

A *mark* is a round dot of plastic extruded while the nozzle stands still on one commanded way-point. A stroke
would be biased along its direction by the pressure in the nozzle, which looks like play; a dot has no direction.
"""

import hashlib
import json
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from printmend.errors import InputError
from printmend.files import read_text, replacing
from printmend.messages import say
from printmend.path import PAPER_SD, Instrument, Origin, Trace, frozen

FORMAT, VERSION = "printmend probe", 1
LEAST_SHARED = 25  # marks that two scans must share to be joined
_DIGITS = 8  # hexadecimal digits of a plan's identity


@dataclass(frozen=True, eq=False)
class ProbePlan:
    """The nozzle's path, and the marks that it left.

    ``mm_per_turn`` is how much belt each motor's pulley moves in a turn. ``waypoints_mm`` [N, 2] are all commanded
    way-points since homing, the first the home position. For each mark: ``rows`` [M] is its way-point; ``site`` [M, 2]
    is its place on the square lattice of marks; ``big`` [M] says whether it is one of the large dots, which form the
    code; ``direction`` [M, 2] is the sign of each bed axis' last move before it; ``reversal_mm`` [M, 2] is how far each
    axis had moved that way since its reversal. With a ``pen`` the large dots are drawn as small circles: they form the
    code, and are not measured. Marks on ``paper`` move as it grows. A bed larger than a sheet of paper is printed sheet
    after sheet: ``starts`` are the way-points at which each begins anew at home. If sheets overlap, the same ``site``
    has a mark on each. Before the dots, way-points 3 to ``net`` may draw a thin net that joins them: strokes, each from
    one way-point to the next. If ``moving`` is not 0, the way-points from it on are not dots but the corners of lines
    printed at the speed of parts. They show the error of a moving head. ``pitch_mm`` and ``angle_rad`` give the
    lattice: mark = origin + pitch·R(angle)·site.
    """

    printer: str
    kinematics: str
    mm_per_turn: tuple[float, float]
    pitch_mm: float
    angle_rad: float
    dot_mm: float
    big_dot_mm: float
    waypoints_mm: np.ndarray
    rows: np.ndarray
    site: np.ndarray
    big: np.ndarray
    direction: np.ndarray
    reversal_mm: np.ndarray
    pen: bool = False
    paper: bool = False
    starts: tuple[int, ...] = (0,)
    net: int = 0
    moving: int = 0

    def __post_init__(self) -> None:
        kinds = {"waypoints_mm": float, "reversal_mm": float, "big": bool}
        for name in ("waypoints_mm", "rows", "site", "big", "direction", "reversal_mm"):
            value = np.asarray(getattr(self, name), kinds.get(name, np.int64))
            object.__setattr__(self, name, frozen(value))

    def __len__(self) -> int:
        """The number of marks."""
        return len(self.rows)

    @property
    def marks_mm(self) -> np.ndarray:
        """Commanded positions of the marks [M, 2]."""
        return self.waypoints_mm[self.rows]

    def to_motor(self, xy_mm: np.ndarray) -> np.ndarray:
        """Map bed coordinates [..., 2] to those of the motors, as `Printer.to_motor` does."""
        xy_mm = np.asarray(xy_mm)
        return xy_mm @ np.array([[1.0, 1.0], [1.0, -1.0]]) if self.kinematics == "corexy" else xy_mm

    def from_motor(self, motor_mm: np.ndarray) -> np.ndarray:
        """Invert `to_motor`."""
        return self.to_motor(motor_mm) / 2.0 if self.kinematics == "corexy" else np.asarray(motor_mm)

    @cached_property
    def motor_approaches(self) -> tuple[np.ndarray, np.ndarray]:
        """The sign of each motor's last move before each mark [M, 2], and how far it had turned that way [M, 2] mm."""
        direction, run = approaches(self.to_motor(self.waypoints_mm))
        return direction[self.rows], run[self.rows]

    @cached_property
    def sheets(self) -> tuple["ProbePlan", ...]:
        """A plan for each sheet of paper; of one that needs no more than one, itself."""
        if len(self.starts) == 1:
            return (self,)
        return tuple(self._sheet(number) for number in range(len(self.starts)))

    @cached_property
    def sheet_of(self) -> np.ndarray:
        """The number of the sheet [M] that shows each mark, from 0."""
        return np.searchsorted(self.starts, self.rows, side="right") - 1

    def _sheet(self, number: int) -> "ProbePlan":
        begin = self.starts[number]
        end = self.starts[number + 1] if number + 1 < len(self.starts) else len(self.waypoints_mm)
        mine = self.sheet_of == number
        return replace(
            self, waypoints_mm=self.waypoints_mm[begin:end], rows=self.rows[mine] - begin, site=self.site[mine],
            big=self.big[mine], direction=self.direction[mine], reversal_mm=self.reversal_mm[mine], starts=(0,),
        )  # fmt: skip

    @cached_property
    def origin(self) -> Origin:
        """Whose print it is, and which; the printer's name with single blanks, as a table holds it."""
        digest = hashlib.sha256(plan_text(self).encode()).hexdigest()[:_DIGITS]
        return Origin(" ".join(self.printer.split()), self.kinematics, digest)

    @property
    def diameter_mm(self) -> np.ndarray:
        """Intended diameters of the marks [M]."""
        return np.where(self.big, self.big_dot_mm, self.dot_mm)

    def seen_by(self, instrument: Instrument) -> Instrument:
        """Return an instrument that measures the marks, with the doubt about what they lie on."""
        return replace(instrument, paper_sd=PAPER_SD) if self.paper else instrument

    def trace(self, measured_mm: np.ndarray, sigma_mm: np.ndarray | None = None) -> Trace:
        """Return the trace of the whole motion from the marks of a scan [M, 2], NaN where one was not found."""
        measured = np.full(self.waypoints_mm.shape, np.nan)
        measured[self.rows] = measured_mm
        sigma = None
        if sigma_mm is not None:
            sigma = np.full(len(self.waypoints_mm), np.nan)
            sigma[self.rows] = sigma_mm
        return Trace(self.waypoints_mm, measured, sigma_mm=sigma, homed=True, placed=False, origin=self.origin)


def approaches(waypoints_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return for each way-point [N, 2] the sign of each axis' last move, and its travel since the reversal [mm]."""
    moves = np.diff(waypoints_mm, axis=0)
    signs = np.sign(np.round(moves, 6)).astype(np.int64)
    direction = np.zeros(waypoints_mm.shape, np.int64)
    reversal = np.zeros(waypoints_mm.shape)
    for axis in range(waypoints_mm.shape[1]):  # plain numbers: arrays of two are ten times slower
        last, way_mm, rows = 0, 0.0, []
        for sign, far_mm in zip(signs[:, axis].tolist(), np.abs(moves[:, axis]).tolist(), strict=True):
            if sign not in (0, last):
                last, way_mm = sign, 0.0
            way_mm += far_mm
            rows.append((last, way_mm))
        if rows:
            direction[1:, axis], reversal[1:, axis] = zip(*rows, strict=True)
    return direction, reversal


def write_plan(path: str | Path, plan: ProbePlan) -> None:
    """Write probe.json."""
    with replacing(Path(path)) as file:
        file.write(plan_text(plan))


def plan_text(plan: ProbePlan) -> str:
    """Return probe.json's text: one line a mark, one line for all way-points."""
    head = {
        "format": FORMAT,
        "version": VERSION,
        "printer": plan.printer,
        "kinematics": plan.kinematics,
        "mm_per_turn": list(plan.mm_per_turn),
        "pitch_mm": plan.pitch_mm,
        "angle_rad": plan.angle_rad,
        "dot_mm": plan.dot_mm,
        "big_dot_mm": plan.big_dot_mm,
        **({"pen": True} if plan.pen else {}),
        **({"paper": True} if plan.paper else {}),
        **({"starts": list(plan.starts)} if len(plan.starts) > 1 else {}),
        **({"net": plan.net} if plan.net else {}),
        **({"moving": plan.moving} if plan.moving else {}),
    }
    marks = [
        {
            "id": i,
            "row": int(plan.rows[i]),
            "x_mm": float(plan.marks_mm[i, 0]),
            "y_mm": float(plan.marks_mm[i, 1]),
            "direction": plan.direction[i].tolist(),
            "reversal_mm": np.round(plan.reversal_mm[i], 5).tolist(),
            "site": plan.site[i].tolist(),
            "big": bool(plan.big[i]),
        }
        for i in range(len(plan))
    ]
    lines = [f" {json.dumps(key)}: {json.dumps(value)}" for key, value in head.items()]
    lines.append(' "waypoints_mm": ' + json.dumps(plan.waypoints_mm.tolist()))
    lines.append(' "marks": [\n  ' + ",\n  ".join(json.dumps(mark) for mark in marks) + "\n ]")
    return "{\n" + ",\n".join(lines) + "\n}\n"


def read_plan(path: str | Path) -> ProbePlan:
    """Read probe.json. Raises `InputError` when it is none."""
    try:
        table = json.loads(read_text(path, wanted=say("probe-json"), todo=say("write-again-printmend-probe")))
    except (ValueError, RecursionError):
        raise InputError(
            path, wanted=say("probe-json"), came=say("file-not-json"), todo=say("write-again-printmend-probe")
        ) from None
    if not isinstance(table, dict) or table.get("format") != FORMAT:
        raise InputError(
            path, wanted=say("probe-json"), came=say("another-json-file"), todo=say("write-again-printmend-probe")
        )
    if table.get("version") != VERSION:
        came = say("version", repr(table.get("version")))
        raise InputError(
            path, wanted=say("version-probe-json", VERSION), came=came, todo=say("write-again-printmend-probe")
        )
    try:
        return _plan(table)
    except (KeyError, TypeError, ValueError, IndexError, OverflowError) as error:
        raise InputError(
            path, wanted=say("whole-probe-json"), came=f"{error!r}", todo=say("write-again-printmend-probe")
        ) from None


def _plan(table: dict[str, Any]) -> ProbePlan:
    marks = table["marks"]
    plan = ProbePlan(
        printer=str(table["printer"]),
        kinematics=str(table["kinematics"]),
        mm_per_turn=(float(table["mm_per_turn"][0]), float(table["mm_per_turn"][1])),
        pitch_mm=float(table["pitch_mm"]),
        angle_rad=float(table["angle_rad"]),
        dot_mm=float(table["dot_mm"]),
        big_dot_mm=float(table["big_dot_mm"]),
        waypoints_mm=np.array(table["waypoints_mm"], float).reshape(-1, 2),
        rows=np.array([mark["row"] for mark in marks], np.int64),
        site=np.array([mark["site"] for mark in marks], np.int64).reshape(-1, 2),
        big=np.array([mark["big"] for mark in marks], bool),
        direction=np.array([mark["direction"] for mark in marks], np.int64).reshape(-1, 2),
        reversal_mm=np.array([mark["reversal_mm"] for mark in marks], float).reshape(-1, 2),
        pen=bool(table.get("pen")),
        paper=bool(table.get("paper")),
        starts=tuple(int(row) for row in table.get("starts", (0,))),
        net=int(table.get("net", 0)),
        moving=int(table.get("moving", 0)),
    )
    if not all(isinstance(table.get(name, False), bool) for name in ("pen", "paper")):
        raise ValueError("pen or paper that is neither true nor false")
    if not len(plan) or not np.isfinite(plan.waypoints_mm).all() or plan.rows.min() < 0:
        raise ValueError("no marks")
    if plan.moving and not plan.rows.max() < plan.moving < len(plan.waypoints_mm):
        raise ValueError("lines that do not follow the dots")
    if plan.starts[0] != 0 or sorted(set(plan.starts)) != list(plan.starts):
        raise ValueError("sheets that do not follow each other")
    if len(set(plan.sheet_of.tolist())) < len(plan.starts):
        raise ValueError("a sheet without marks")
    stated = np.array([(mark["x_mm"], mark["y_mm"]) for mark in marks], float)
    if np.abs(stated - plan.marks_mm).max() > 1e-3:
        raise ValueError("marks that are not on their way-points")
    return plan
