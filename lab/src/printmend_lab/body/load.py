"""A body from any file: a mesh is sliced first, G-code is taken as it is."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from printmend.errors import GcodeError
from printmend.gcode.read import read_gcode
from printmend.printer import Printer
from printmend_lab.body.layers import Stroke, layers_of, strokes_of, to_steps
from printmend_lab.body.slicer import slice_solid, slice_to
from printmend_lab.body.solid import MESH_SUFFIXES
from printmend_lab.path import Body

MIN_POINTS = 1000  # the paper, §V-C: a body with fewer is an erroneous translation


def load_body(
    path: str | Path,
    printer: Printer,
    *,
    unit: str | None = None,
    cache: Path | None = None,
    note: Callable[[str], None] = lambda text: None,
) -> Body:
    """Return the body in a mesh file (sliced with PrusaSlicer) or a G-code file as layers of lattice controls.

    ``unit`` (mm, cm, m, inch, foot, micron) is for meshes that name none. ``cache`` is a folder that keeps sliced
    G-code, so that a mesh is sliced once. ``note`` is called with one line about each change: a repair, a unit, a shift
    onto the bed. Raises MeshError, GcodeError or MissingToolError for anything that cannot become a body of
    `MIN_POINTS` points on this printer.
    """
    path = Path(path)
    source: str | bytes = str(path)
    if is_mesh(path):
        source = _sliced(path, printer, unit, cache, note)
    return body_of(source, printer, name=path.stem, note=note)


def is_mesh(path: Path) -> bool:
    """Tell a mesh from G-code by its name; a `.gcode.3mf` is a project that holds G-code."""
    return path.suffix.lower() in MESH_SUFFIXES and not path.name.lower().endswith(".gcode.3mf")


def body_of(
    gcode: str | bytes, printer: Printer, *, name: str, note: Callable[[str], None] = lambda text: None
) -> Body:
    """Return the body in a G-code file or its bytes; see `load_body`."""
    strokes = strokes_of(read_gcode(gcode, printer=printer))
    shift = place(strokes, printer, subject=name, note=note)
    body = Body(name, layers_of(strokes, printer, shift_steps=shift, subject=name))
    if body.transitions < MIN_POINTS:
        raise GcodeError(
            name, wanted=f"a body of at least {MIN_POINTS} points (steps of motion)", came=f"{body.transitions}",
            todo="check its size and unit: a circle 1 cm across has as many in three or four layers",
        )  # fmt: skip
    return body


def place(
    strokes: tuple[Stroke, ...], printer: Printer, *, subject: object, note: Callable[[str], None] = lambda text: None
) -> tuple[int, int]:
    """Return the shift [full steps] that brings the strokes onto the bed; zero if they are on it already.

    A file for another printer is moved to the middle of the bed by whole steps, along the axes on which it lies off the
    bed. Raises GcodeError if it is larger than the bed.
    """
    low = np.min([to_steps(stroke.points_mm, printer).min(axis=0) for stroke in strokes], axis=0)
    high = np.max([to_steps(stroke.points_mm, printer).max(axis=0) for stroke in strokes], axis=0)
    bed = np.array(printer.bed_steps)
    if not (high - low <= bed).all():
        size = (high - low) * printer.mm_per_step
        raise GcodeError(
            subject, wanted=f"motion within {printer.x.length_mm:g} × {printer.y.length_mm:g} mm ({printer.name})",
            came=f"{size[0]:.1f} × {size[1]:.1f} mm", todo="give a larger printer, or slice the body for this one",
        )  # fmt: skip
    # A place is on the bed if it rounds to a node of it.
    off = (low < -0.5) | (high >= bed + 0.5)
    shift = np.where(off, np.rint((bed - low - high) / 2), 0).astype(np.int64)
    if off.any():
        by = shift * printer.mm_per_step
        corners = [np.round(corner * printer.mm_per_step, 1).tolist() for corner in (low, high)]
        note(f"moved by {by[0]:+g}, {by[1]:+g} mm onto the bed: the file spans {corners[0]} to {corners[1]} mm")
    return int(shift[0]), int(shift[1])


def _sliced(
    path: Path, printer: Printer, unit: str | None, cache: Path | None, note: Callable[[str], None]
) -> str | bytes:
    from printmend_lab.body.mesh import read_solid  # meshes need a large library, G-code does not

    solid = read_solid(path, unit=unit)
    for text in solid.notes:
        note(text)
    return str(slice_to(solid, printer, cache)) if cache else slice_solid(solid, printer)
