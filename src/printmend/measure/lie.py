"""Find the pose of a part on the glass: turn, shift and mirror its outline in the image until it fits the file's."""

from dataclasses import dataclass

import cv2
import numpy as np

from printmend.errors import ScanError
from printmend.measure.image import COMMON_DPI
from printmend.measure.marks import Pose
from printmend.measure.silhouette import COARSE_MM, Silhouette
from printmend.measure.walls import RASTER_MM, Walls
from printmend.messages import say

CELL_MM = 0.4  # side of a pixel of the pictures that are compared
THIN_MM = 3.0  # a part narrower than this on average is only walls: a fault may move them by their own width
THICKEN_MM = 1.6  # such a part is thickened by this much all around before it is compared
LEAST_OVERLAP = 0.78  # least overlap (intersection over union) of even a badly printed part with its own outline
TURNS_DEG, FINE_DEG = 3.0, 0.5  # step of the first search over turns, and of the refined search
FINER_TURNS = 6  # number of turns that are refined
TURN_ROOM = 1.45  # side of a picture that can be turned, over that of its content: a little more than √2
LEAST_LEAD = 0.012  # two poses whose overlaps differ by less cannot be distinguished
SAME_TURN_DEG = 8.0  # turns that differ by less are the same pose
UPRIGHT_DEG = 20.0  # a careful person lays a part at least this straight
# A size ratio of part and file between these factors means a wrong resolution of the image. A smaller one may be the
# printer's error, and a larger one means another part.
LEAST_SCALE, MOST_SCALE = 1.15, 20.0


@dataclass(frozen=True, eq=False)
class Lie:
    """The ``pose`` that maps image positions (mm, y down) to the bed, whether the image is ``mirrored``, the angle
    ``turned_deg`` at which the part lay, and the share of its area that fits. ``unsure`` names other poses that fit as
    well; it is empty if there are none."""

    pose: Pose
    mirrored: bool
    turned_deg: float
    overlap: float
    unsure: str


def find_lie(silhouette: Silhouette, walls: Walls, *, dpi: float, subject: str) -> Lie:
    """Find the pose of the part of ``walls`` in an image.

    Raises `ScanError` for another part, another resolution, several parts, and one that lies upside down.
    """
    thicken_mm = THICKEN_MM if _is_thin(walls.plastic) else 0.0
    wanted, wanted_middle = _centred(walls.plastic, RASTER_MM, thicken_mm)
    shown, shown_middle = _centred(silhouette.mask, COARSE_MM, thicken_mm)
    side = max(*wanted.shape, *shown.shape)
    reach = _room(side)
    wanted, shown = _padded(wanted, reach), _padded(shown, reach)
    tried = _tried(shown, wanted[::-1])
    best = max(tried)
    pieces = _pieces(walls.plastic)
    if best[0] < LEAST_OVERLAP:
        if silhouette.pieces <= pieces:
            _check_resolution(silhouette.mask, walls.plastic, thicken_mm, dpi, subject)
        _refuse(tried, silhouette.pieces, pieces, subject)
    overlap, mirrored, turned = best
    _check_side(tried, best, walls, subject)
    unsure, (overlap, mirrored, turned) = _unsure(tried, best, walls, subject)
    c, s = np.cos(np.radians(turned)), np.sin(np.radians(turned))
    # from the image (y down): mirror it if seen from below, turn it back, and flip y up as on the bed
    matrix = np.diag([-1.0 if mirrored else 1.0, 1.0]) @ np.array([[c, s], [-s, c]]) @ np.diag([1.0, -1.0])
    bed_middle = walls.corner_mm + wanted_middle
    shift = bed_middle - shown_middle @ matrix
    return Lie(Pose(matrix, shift), mirrored, turned, overlap, unsure)


def _is_thin(plastic: np.ndarray) -> bool:
    """Return whether a part is only walls, so that a fault may move its lines by their own width."""
    edge = cv2.morphologyEx(plastic.astype(np.uint8), cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8))
    outline_mm = edge.sum() * RASTER_MM / 2  # the gradient marks both sides of an edge
    return bool(2 * plastic.sum() * RASTER_MM**2 < THIN_MM * outline_mm)


def _centred(mask: np.ndarray, pixel_mm: float, thicken_mm: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the mask, thickened by ``thicken_mm``, as a picture of `CELL_MM` cells with its centroid in the middle;
    also the centroid [2] mm."""
    around = round(thicken_mm / pixel_mm)
    y, x = np.nonzero(mask)
    middle = np.array([x.mean(), y.mean()])
    mask = cv2.copyMakeBorder(mask.astype(np.uint8), around, around, around, around, cv2.BORDER_CONSTANT)
    mask = cv2.dilate(mask, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * around + 1, 2 * around + 1)))
    reach = int(np.ceil(np.hypot(*mask.shape) * pixel_mm / CELL_MM)) // 2 + 2
    factor = pixel_mm / CELL_MM
    size = 2 * reach + 1
    move = np.array(
        [[factor, 0, reach - factor * (middle[0] + around)], [0, factor, reach - factor * (middle[1] + around)]]
    )
    soft = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), 0.4 / factor)
    return cv2.warpAffine(soft, move, (size, size), flags=cv2.INTER_LINEAR), middle * pixel_mm


def _room(side: int) -> int:
    """Return the odd side of a picture in which a picture with this side can be turned."""
    return int(np.ceil(side * TURN_ROOM)) | 1


def _padded(picture: np.ndarray, side: int) -> np.ndarray:
    """Pad or crop a square picture to another side, keeping its middle."""
    have = len(picture)
    if have >= side:
        cut = (have - side) // 2
        return picture[cut : cut + side, cut : cut + side]
    return cv2.copyMakeBorder(picture, *((side - have) // 2, side - have - (side - have) // 2) * 2, cv2.BORDER_CONSTANT)


Try = tuple[float, bool, float]  # overlap, mirrored, turn [°]


def _tried(shown: np.ndarray, wanted: np.ndarray) -> list[Try]:
    """Return (overlap, mirrored, turn [°]) of every pose that was tried, in finer steps around the likely ones."""
    found: list[Try] = []
    room = np.empty_like(shown), np.empty_like(shown)
    wanted = np.ascontiguousarray(wanted)
    for mirrored in (False, True):
        picture = np.ascontiguousarray(shown[:, ::-1] if mirrored else shown)
        rough = [(_overlap(picture, wanted, turn, room), turn) for turn in np.arange(0.0, 360.0, TURNS_DEG)]
        for _, turn in sorted(rough, reverse=True)[:FINER_TURNS]:
            for near in np.arange(turn - TURNS_DEG / 2, turn + TURNS_DEG / 2 + 0.01, FINE_DEG):
                rough.append((_overlap(picture, wanted, float(near), room), float(near)))
        found += [(overlap, mirrored, (turn + 180) % 360 - 180) for overlap, turn in rough]
    return found


def _overlap(shown: np.ndarray, wanted: np.ndarray, turn_deg: float, room: tuple[np.ndarray, np.ndarray]) -> float:
    """Return the intersection over the union of two soft masks, the shown one turned; pictures like them have ``room``
    for what is between."""
    middle = (len(shown) - 1) / 2
    turned, each = room
    turn = cv2.getRotationMatrix2D((middle, middle), -turn_deg, 1.0)
    cv2.warpAffine(shown, turn, shown.shape[::-1], dst=turned, flags=cv2.INTER_LINEAR)
    both = np.minimum(turned, wanted, out=each).sum()
    return float(both / max(np.maximum(turned, wanted, out=each).sum(), 1e-6))


def _pieces(plastic: np.ndarray) -> int:
    """Return the number of connected pieces of a mask."""
    return cv2.connectedComponents(plastic.astype(np.uint8), connectivity=8)[0] - 1


def _check_resolution(shown: np.ndarray, plastic: np.ndarray, thicken_mm: float, dpi: float, subject: str) -> None:
    """Raise `ScanError` if the part fits at another size: the image's resolution is wrong."""
    scale = _across_mm(plastic, RASTER_MM) / max(_across_mm(shown, COARSE_MM), COARSE_MM)
    if not 1 / MOST_SCALE < scale < MOST_SCALE or 1 / LEAST_SCALE < scale < LEAST_SCALE:
        return
    wanted = _centred(plastic, RASTER_MM, thicken_mm)[0]
    scaled = _centred(shown, COARSE_MM * scale, thicken_mm)[0]
    reach = _room(max(len(wanted), len(scaled)))
    if max(_tried(_padded(scaled, reach), _padded(wanted, reach)[::-1]))[0] > LEAST_OVERLAP:
        likely = min(COMMON_DPI, key=lambda value: abs(np.log(value * scale / dpi)))
        raise ScanError(
            subject, wanted=say("part-own-size"), came=say("part-of-other-size", f"{1 / scale:.2f}", f"{dpi:g}"),
            todo=say("scan-seems-have-dpi-say-dpi", f"{likely:g}", f"{likely:g}"),
        )  # fmt: skip


def _across_mm(mask: np.ndarray, pixel_mm: float) -> float:
    """Return the side of a square with the area of the plastic's convex hull, which hardly depends on line widths."""
    points = cv2.findNonZero(mask.astype(np.uint8))
    return 0.0 if points is None else float(np.sqrt(cv2.contourArea(cv2.convexHull(points)))) * pixel_mm


def _refuse(tried: list[Try], shown_pieces: int, wanted_pieces: int, subject: str) -> None:
    """Raise a `ScanError` with the likeliest reason why nothing fits."""
    if shown_pieces > wanted_pieces:
        raise ScanError(
            subject, wanted=say("part-alone") if wanted_pieces == 1 else say("pieces-alone", wanted_pieces),
            came=say("pieces", shown_pieces),
            todo=say("scan-one-part"),
        )  # fmt: skip
    raise ScanError(
        subject,
        wanted=say("part-file"),
        came=say("outline-overlaps-best", f"{max(tried)[0]:.0%}"),
        todo=say("give-file-printed-layer-whose-side"),
    )


def _check_side(tried: list[Try], best: Try, walls: Walls, subject: str) -> None:
    """Raise `ScanError` if the image shows the upper side although the underside was asked for."""
    other = max(overlap for overlap, mirrored, _ in tried if mirrored != best[1])
    if walls.layers == 1 or best[0] - other < LEAST_LEAD:
        return
    if walls.layer == 1 and not best[1]:
        raise ScanError(
            subject, wanted=say("underside-part-scan-shows-mirror-image"),
            came=say("upper-side-upside-down-glass"),
            todo=say("lay-side-glass-lay-bed-first"),
        )  # fmt: skip


def _unsure(tried: list[Try], best: Try, walls: Walls, subject: str) -> tuple[str, Try]:
    """Return words for other poses that fit as well, and the chosen pose: of several, the upright one. Raises
    `ScanError` if none of these is upright, or if upright ones differ in their turn."""
    alike = [
        one for one in tried if one[0] > best[0] - LEAST_LEAD
        and (one[1] != best[1] or abs((one[2] - best[2] + 180) % 360 - 180) > SAME_TURN_DEG)
    ]  # fmt: skip
    # of a part with more layers, a scan of layer 1 must show the underside: the image is mirrored
    if walls.layers > 1 and walls.layer == 1:
        alike = [one for one in alike if one[1]]
        best = max((one for one in tried if one[1]), default=best)
        alike = [one for one in alike if abs((one[2] - best[2] + 180) % 360 - 180) > SAME_TURN_DEG]
    if not alike:
        return "", best
    upright = [one for one in (best, *alike) if abs(one[2]) < UPRIGHT_DEG]
    if not upright or max(abs(one[2]) for one in upright) - min(abs(one[2]) for one in upright) > SAME_TURN_DEG:
        raise ScanError(
            subject, wanted=say("part-looks-different-every-side"),
            came=say("looks-same-turned-mirrored"),
            todo=say("lay-as-on-bed"),
        )  # fmt: skip
    taken = max(upright)
    mirrored = all(one[1] != taken[1] for one in alike)
    return say("looks-same-mirrored" if mirrored else "looks-same-turned"), taken
