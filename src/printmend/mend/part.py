"""Turn a scan of a printed part into a trace: match its walls to the commanded path, and learn the machine meanwhile.

A ray starts where the current model puts a wall, and looks for its edge in the image. The edges found improve the
model, so the next, shorter rays start nearer to the walls.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from threadpoolctl import threadpool_limits

from printmend.errors import ScanError
from printmend.fit.estimate import OUTER, Known, Layer, estimated, outline_of
from printmend.gcode.read import Program, read_gcode
from printmend.learn.walls import LEAST_WALLS, WallFit, fit_walls
from printmend.measure.distance import choose_widths, mapped, scaled_by_rulers, scaled_by_widths, widths_asked
from printmend.measure.image import with_legend, write_image
from printmend.measure.lie import Lie, find_lie
from printmend.measure.marks import Pose
from printmend.measure.measurement import instrument_on_bed
from printmend.measure.page import Page, check_sheet, photo_todo, read_page
from printmend.measure.ruler import Ruler, find_rulers
from printmend.measure.silhouette import Silhouette, find_edges, find_silhouette
from printmend.measure.walls import Walls, read_walls
from printmend.messages import Tell, say
from printmend.path import Instrument, Origin, Trace
from printmend.printer import Printer
from printmend.units import MM_PER_INCH

CAPTURES_MM = (3.0, 1.5, 1.0, 0.6, 0.6)  # how far a ray looks, round by round
LEAST_FOUND_SHARE = 0.6  # least share of the visible walls that must be found; otherwise it is another part
LARGEST_SIGMA_MM = 0.12  # walls that scatter more about the model are not this file's
EDGE_SIGMA_MM = 0.01  # standard deviation of an edge: no scan is read better
MOST_HEIGHT_SEEN_MM = (
    0.04  # leave out a wall whose side looks broader than this to the camera: its foot would look like its edge
)
SURE_SDS, LEAST_HOLES_MM = 3.0, 0.02  # holes and the outline get separate bead widths if they differ by more than this
OVERLAY_PX = 2000  # longer side of an overlay
ENLARGED = 10.0  # factor by which an overlay enlarges a wall's error
# Grey levels under an overlay become gain·level + grey, so that marks stand out from dark plastic, too.
PALE_GAIN, PALE_GREY = 0.35, 160.0
FOUND_COLOUR, MISSING_COLOUR, ERROR_COLOUR = (0, 110, 0), (30, 30, 220), (230, 80, 0)  # blue, green, red
FINE = 16.0  # OpenCV draws in sixteenths of a pixel with shift=4


@dataclass(frozen=True, eq=False)
class PartMeasurement:
    """The ``trace`` of a part, ``notes`` for its owner, and the number of wall places ``found``.

    ``stands_mm`` [S] is how far each place of ``walls`` is outside the file's wall, bead width included; NaN where none
    was seen. ``trace`` leaves out the offset that all walls share. ``onto`` [2, 2] mapped the places to the callipers'
    scale.
    """

    trace: Trace
    notes: tuple[str, ...]
    found: int
    walls: Walls
    stands_mm: np.ndarray
    onto: np.ndarray

    def also_mapped(self, onto: np.ndarray) -> "PartMeasurement":
        """Return the measurement at the scale that callipers gave another scan of the same part and scanner."""
        edge_mm = self.walls.commanded_mm[self.walls.row] + self.walls.half_mm[:, None] * self.walls.normal
        moved_mm = np.sum((mapped(edge_mm, onto) - edge_mm) * self.walls.normal, axis=1)
        return replace(self, stands_mm=self.stands_mm + moved_mm)


# Long, with many parameters: it is the whole way from an image to a trace.
def measure_part(
    path: str | Path,
    program: Program | str | Path,
    printer: Printer,
    *,
    layer: int = 1,
    dpi: float | None = None,
    overlay: Path | None = None,
    distances_mm: Sequence[float] = (),
    tell: Tell = str,
) -> PartMeasurement:
    """Measure a printed part, one layer of ``program``, from a scan of the side that shows this layer, or from a photo
    of it on the sheet of tags.

    ``dpi`` overrides the file's own. ``distances_mm`` are calliper readings of the widths that a measurement without
    them asks for, in its order. ``tell`` translates the words on the overlay.

    Raises `ScanError` for an image of another part, of an incomplete part, of several parts or of another side, and for
    a photo without tags; `GcodeError` for a layer without walls; `TraceError` for a reading that does not match its
    width.
    """
    if not isinstance(program, Program):
        program = read_gcode(program, printer=printer)
    walls = read_walls(program, printer, layer=layer)
    page = read_page(path, dpi=dpi, tall_mm=walls.tall_mm)
    rulers = find_rulers(page.image, page.px_per_mm, subject=str(path))
    silhouette, lie = _located(path, page, walls, rulers)
    with threadpool_limits(1, "blas"):
        match = _matched(silhouette, walls, lie, printer, page)
    edges, fit = match.edges, match.fit
    found, shown = int(np.isfinite(edges.offset_mm).sum()), int((~edges.hidden).sum())
    if found < LEAST_FOUND_SHARE * shown or fit.sigma_mm > LARGEST_SIGMA_MM:
        raise ScanError(
            path, wanted=say("walls-file-where-commands-them"),
            came=say("walls-that-scatter", found, shown, f"{fit.sigma_mm:.2f}"),
            todo=say("give-file-printed-printer-skipped-steps"),
        )  # fmt: skip
    if page.tagged:
        check_sheet(path, _scales(walls, edges))
    if overlay is not None:
        _draw(overlay, silhouette, walls, edges, tell)
    widths = choose_widths(walls)
    beads_mm, beads_said = _beads(walls, edges, fit, printer, page.instrument, layer)
    offset = edges.offset_mm - beads_mm
    instrument, asked = instrument_on_bed(page.instrument, [match.pose.matrix], settled=False), None
    if page.eye_mm is not None:
        rulers = tuple(ruler.in_photo(float(page.eye_mm[2]), walls.tall_mm) for ruler in rulers)
    seen = [(ruler, match.pose.matrix) for ruler in rulers]
    edge_mm, instrument, ruled = scaled_by_rulers(seen, edges.begin_mm, instrument)
    onto = np.eye(2)
    if distances_mm:
        onto, instrument, asked = scaled_by_widths(distances_mm, widths, edge_mm, instrument, page.scale)
        edge_mm = mapped(edge_mm, onto)
    elif widths:
        asked = widths_asked(widths, edge_mm, page.scale, ruled=bool(rulers))
    offset = offset + np.sum((edge_mm - edges.begin_mm) * walls.normal, axis=1)
    message = "part-seen-from-below" if lie.mirrored else "part-seen"
    notes = (
        say(message, path, found, len(walls.row), f"{lie.turned_deg:.1f}", page.scale),
        lie.unsure,
        beads_said,
        *(*ruled, asked),
    )
    sigma = np.full(len(walls.row), float(np.clip(fit.sigma_mm, EDGE_SIGMA_MM, 1.0)))
    trace = replace(walls.trace(offset, sigma), instrument=instrument, origin=Origin(printer.name, printer.kinematics))
    return PartMeasurement(trace, tuple(filter(None, notes)), found, walls, offset + beads_mm, onto)


def _located(path: str | Path, page: Page, walls: Walls, rulers: Sequence[Ruler]) -> tuple[Silhouette, Lie]:
    """Return the plastic in an image and the part's pose. An error about an image without a scale says how a photo gets
    one."""
    try:
        beside = [ruler.corners_mm for ruler in rulers]
        silhouette = find_silhouette(page.image, page.px_per_mm, subject=str(path), beside_mm=beside)
        with threadpool_limits(1, "blas"):
            return silhouette, find_lie(silhouette, walls, dpi=page.dpi, subject=str(path))
    except ScanError as error:
        if not page.unsure:
            raise
        todo = say("if-it-is-a-photo", error.todo, photo_todo())
        raise ScanError(path, wanted=error.wanted, came=error.came, todo=todo) from None


# Its many parameters describe one scanned layer.
def _beads(
    walls: Walls, edges: "_Edges", fit: WallFit, printer: Printer, instrument: Instrument, layer: int
) -> tuple[np.ndarray, str]:
    """Return by how much the bead of each wall [S] is too wide, and words about it. All walls share one value, unless
    holes and outline surely differ by more than the machine's errors. Beads in a bend are pulled inwards, which is not
    the machine's fault."""
    outline = outline_of(walls)
    seen = Layer(layer, walls, outline, edges.offset_mm, fit.printed_mm - walls.commanded_mm)
    side = estimated([seen], printer, instrument, Known()).sides[0]
    if side.hole_mm is not None and (outline.group == OUTER).any():
        more_mm = side.hole_mm - side.outline_mm
        if abs(more_mm) > max(SURE_SDS * side.extra_sd_mm, LEAST_HOLES_MM):
            words = say("outline-and-holes-stand", f"{side.outline_mm:+.2f}", f"{side.hole_mm:+.2f}")
            return np.where(outline.group > OUTER, side.hole_mm, side.outline_mm), words
    return np.full(len(walls.row), fit.swell_mm), say("all-walls-stand", f"{fit.swell_mm:+.2f}")


@dataclass(frozen=True, eq=False)
class _Edges:
    """The edges that the rays of one round met. Rays began at ``at_px`` [S, 2] in the image, ``begin_mm`` [S, 2] on the
    bed, along ``out_px`` [S, 2]. Edges lie at ``offset_mm`` [S], NaN if none; the part itself hides ``hidden`` [S]."""

    at_px: np.ndarray
    out_px: np.ndarray
    begin_mm: np.ndarray
    offset_mm: np.ndarray
    hidden: np.ndarray


@dataclass(frozen=True, eq=False)
class _Match:
    """The walls in the image: the part's pose, the machine learned from them, and the edges that the last rays met."""

    pose: Pose
    fit: WallFit
    edges: _Edges


def _matched(silhouette: Silhouette, walls: Walls, lie: Lie, printer: Printer, page: Page) -> _Match:
    """Find the walls and learn the machine from them, in turn, with ever shorter rays."""
    pose, printed, swell, fit = lie.pose, walls.commanded_mm, 0.0, None
    eye = None if page.eye_mm is None else page.eye_mm - np.array([*silhouette.corner_mm, 0.0])
    for capture_mm in CAPTURES_MM:
        edges = _look(silhouette, walls, pose, printed, swell, capture_mm, eye)
        if np.isfinite(edges.offset_mm).sum() < LEAST_WALLS:
            raise ScanError(
                say("subject-scan"),
                wanted=say("edges-along-part-walls"),
                came=say("hardly-any"),
                todo=say("scan-again-600-dpi"),
            )
        trace = walls.trace(edges.offset_mm, np.full(len(walls.row), EDGE_SIGMA_MM))
        fit = fit_walls(trace, printer)
        swell = fit.swell_mm
        # turn and shift belong to the pose, not to the machine
        printed = _on_walls(trace, walls, fit.printed_mm)
        shift = np.median(printed[walls.row] - walls.commanded_mm[walls.row], axis=0)
        printed = printed - shift
        pose = _moved(pose, fit.turn, shift, np.array(printer.middle_mm))
    assert fit is not None
    return _Match(pose, fit, _look(silhouette, walls, pose, printed, swell, CAPTURES_MM[-1], eye))


def _scales(walls: Walls, edges: _Edges) -> tuple[float, float]:
    """Return the part's size over its commanded size in x and y, by least squares over its walls."""
    seen = np.isfinite(edges.offset_mm)
    normal, at = walls.normal[seen], walls.commanded_mm[walls.row[seen]]
    at = at - at.mean(axis=0)
    turn = normal[:, 1] * at[:, 0] - normal[:, 0] * at[:, 1]
    columns = np.column_stack([normal * at, normal, turn, np.ones(len(at))])
    grown = np.linalg.lstsq(columns, edges.offset_mm[seen], rcond=None)[0]
    return 1 + float(grown[0]), 1 + float(grown[1])


def _moved(pose: Pose, turn: float, shift_mm: np.ndarray, middle_mm: np.ndarray) -> Pose:
    """Return the pose that undoes the part's turn and shift about the bed's middle."""
    c, s = np.cos(turn), np.sin(turn)
    back = np.array([[c, -s], [s, c]])  # row vectors turned clockwise by ``turn``
    return Pose(pose.matrix @ back, (pose.shift_mm - middle_mm) @ back + middle_mm - shift_mm)


def _on_walls(trace: Trace, walls: Walls, printed_mm: np.ndarray) -> np.ndarray:
    """Return the places [N, 2] of the way-points, without the rows added for the second side of a bead."""
    if len(printed_mm) == len(walls.commanded_mm):
        return printed_mm
    twice = walls.row[1:][walls.row[1:] == walls.row[:-1]]
    return np.delete(printed_mm, twice + np.arange(len(twice)) + 1, axis=0)


def _look(
    silhouette: Silhouette, walls: Walls, pose: Pose, printed_mm: np.ndarray, swell_mm: float, capture_mm: float,
    eye_mm: np.ndarray | None,
) -> _Edges:  # fmt: skip
    """Look for the walls near their expected places; ``eye_mm`` [3] is the camera's place in mm of the image."""
    back = np.linalg.inv(pose.matrix)
    scale = silhouette.px_per_mm
    begin = printed_mm[walls.row] + (walls.half_mm + swell_mm)[:, None] * walls.normal
    at_px = (begin - pose.shift_mm) @ back * scale - 0.5
    out_px = walls.normal @ back
    above = walls.layer > 1 and eye_mm is None
    met = find_edges(silhouette, at_px, out_px, capture_mm, foot=above)
    hidden = np.zeros(len(begin), bool)
    if eye_mm is not None:  # a wall that faces the camera shows its whole height beside the edge
        facing = np.sum((pose.apply(eye_mm[:2]) - begin) * walls.normal, axis=1)
        hidden = walls.tall_mm * facing / eye_mm[2] > MOST_HEIGHT_SEEN_MM
    lies = np.sum((begin - walls.commanded_mm[walls.row]) * walls.normal, axis=1)
    offset = np.where(hidden, np.nan, lies + met - walls.half_mm)
    return _Edges(at_px, out_px, begin, offset, hidden)


def _draw(path: Path, silhouette: Silhouette, walls: Walls, edges: _Edges, tell: Tell) -> None:
    """Draw every wall place that was found or missed, and the walls' errors, enlarged."""
    factor = min(1.0, OVERLAY_PX / max(silhouette.image.shape[:2]))
    picture = cv2.resize(silhouette.image, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
    picture = (picture.astype(np.float32) * PALE_GAIN + PALE_GREY).astype(np.uint8)
    shown = ~edges.hidden
    off = np.nan_to_num(edges.offset_mm[shown])[:, None] * ENLARGED * silhouette.px_per_mm * edges.out_px[shown]
    ends = (edges.at_px[shown] + off) * factor
    # add margins for lines that reach beyond the image
    height, width = picture.shape[:2]
    beyond = np.concatenate([-ends.min(axis=0), ends.max(axis=0) - [width, height]])
    left, top, right, bottom = (int(np.clip(np.ceil(side) + 8, 0, OVERLAY_PX // 4)) for side in beyond)
    picture = cv2.copyMakeBorder(picture, top, bottom, left, right, cv2.BORDER_REPLICATE)
    corner = np.array([left, top])
    places, tips = edges.at_px[shown] * factor + corner, ends + corner
    thin = max(1, round(max(picture.shape[:2]) / 1000))
    for at, end, offset in zip(places * FINE, tips * FINE, edges.offset_mm[shown], strict=True):
        place, tip = (tuple(int(v) for v in point) for point in (at, end))
        if not np.isfinite(offset):
            cv2.circle(picture, place, int(4 * thin * FINE), MISSING_COLOUR, thin, cv2.LINE_AA, 4)
            continue
        cv2.line(picture, place, tip, ERROR_COLOUR, thin, cv2.LINE_AA, 4)
        cv2.circle(picture, place, int(1.7 * thin * FINE), FOUND_COLOUR, -1, cv2.LINE_AA, 4)
    lost = int((np.isnan(edges.offset_mm) & ~edges.hidden).sum())
    items = [
        (say("overlay-wall-places"), FOUND_COLOUR),
        (say("overlay-walls-off", f"{ENLARGED:.0f}"), ERROR_COLOUR),
        *([(say("overlay-missing", lost), MISSING_COLOUR)] if lost else []),
    ]
    picture = with_legend(picture, items, tell)
    write_image(path, picture, dpi=MM_PER_INCH * silhouette.px_per_mm * factor)
