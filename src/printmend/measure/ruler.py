"""Find rulers in a picture: their millimetre lines settle the picture's scale along the ruler.

A ruler's lines are thin, straight and parallel; one end of each lies on the ruler's edge. A row of evenly spaced lines,
every fifth longer, is a scale; the spacing of its lines is the picture's millimetre.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from printmend.errors import ScanError
from printmend.messages import say

FINE_PX_PER_MM = 12.0  # resolution of the picture in which rulers are looked for
THICKEST_MM, SHORTEST_MM, LONGEST_MM = 0.45, 1.2, 14.0  # width and lengths of a line
SLENDER_RATIO = 3.0  # least length of a line over its width
LEAST_CONTRAST = 14.0  # grey levels between a line and the ruler
SAME_WAY_RAD = 0.035  # how far the directions of the lines of one row may scatter
EDGE_MM = 0.5  # how far the ends of its lines may lie from the ruler's edge
LEAST_LINES = 30  # fewest lines of a row
LEAST_LINES_SHARE = 0.7  # share of the lines between its first and last that must be seen
MOST_UNEVEN_SHARE = 0.06  # largest RMS error of evenly spaced lines, as a share of their spacing
LONGER_RATIO = 1.15  # every fifth or fourth line is longer than its neighbours by at least this factor
MILLIMETRES, INCHES = (1.0, 0.5), (25.4 / 8, 2.54, 25.4 / 16, 1.27, 25.4 / 32)  # distances of lines on rulers [mm]
SCALE_SHARE = 0.02  # share by which a picture may be off its stated scale
SAME_WAY_COSINE = 0.8  # two rows measure the same direction if |cos| of the angle between them is larger
OWN_SD = 0.0004  # standard deviation (share) of a ruler's own length: 0.1 mm over its reach
MOST_LINES = 6000  # a picture with more lines shows something else
THICK_MM, THICK_SD_MM = 0.4, 0.4  # thickness of rulers, printed or of steel, and its standard deviation


@dataclass(frozen=True, eq=False)
class Ruler:
    """A ruler in a picture: its direction [2] there, and the share ``excess`` by which the picture's millimetre is too
    large. It has a number of ``lines`` over ``length_mm``, with the ``corners_mm`` [4, 2] (image mm, y down). ``sd`` is
    the standard deviation of its length, as a share."""

    along: np.ndarray
    excess: float
    lines: int
    length_mm: float
    corners_mm: np.ndarray
    sd: float = OWN_SD

    def on_bed(self, matrix: np.ndarray) -> "Ruler":
        """Return the ruler turned by a matrix [2, 2]; its corners stay the picture's."""
        return replace(self, along=self.along @ matrix)

    def in_photo(self, away_mm: float, tall_mm: float) -> "Ruler":
        """Correct the ruler for a camera ``away_mm`` above the sheet, in a picture that is to scale at ``tall_mm``.

        Its lines lie above the sheet by its thickness, nearer to the camera, and the thickness is uncertain.
        """
        nearer = (THICK_MM - tall_mm) / away_mm
        sd = float(np.hypot(self.sd, THICK_SD_MM / away_mm))
        return replace(self, excess=(1 + self.excess) / (1 + nearer) - 1, sd=sd)

    def stretched(self, stretch: np.ndarray) -> "Ruler":
        """Return the ruler in the picture after a stretch [2, 2] is removed from it."""
        along = self.along @ np.linalg.inv(stretch).T
        longer = float(np.hypot(*along))
        return replace(self, along=along / longer, excess=(1 + self.excess) * longer - 1)


def find_rulers(image: np.ndarray, px_per_mm: float, *, subject: str) -> tuple[Ruler, ...]:
    """Find millimetre rulers in a flat picture [H, W, 3] that is to scale within two percent, one for each direction.

    Raises `ScanError` for a ruler in inches alone.
    """
    factor = min(1.0, FINE_PX_PER_MM / px_per_mm)
    size = (round(image.shape[1] * factor), round(image.shape[0] * factor))
    grey = cv2.cvtColor(cv2.resize(image, size, interpolation=cv2.INTER_AREA), cv2.COLOR_BGR2GRAY)
    scale = px_per_mm * size[0] / image.shape[1]
    inches, found = False, list[Ruler]()
    for kind in (cv2.MORPH_BLACKHAT, cv2.MORPH_TOPHAT):
        for row in _rows(*_lines(grey, scale, kind)):
            if any(abs(row.along @ one.along) > SAME_WAY_COSINE for one in found):  # its other edge
                continue
            for unit_mm in MILLIMETRES:
                if abs(row.excess + 1 - unit_mm) < SCALE_SHARE * unit_mm:
                    length = row.length_mm * unit_mm / (row.excess + 1)
                    excess = (row.excess + 1) / unit_mm - 1
                    found.append(Ruler(row.along, excess, row.lines, length, row.corners_mm))
            inches |= any(abs(row.excess + 1 - unit_mm) < SCALE_SHARE * unit_mm for unit_mm in INCHES)
    if inches and not found:
        raise ScanError(
            subject, wanted=say("ruler-line-every-millimetre"), came=say("one-inches"),
            todo=say("turn-millimetre-side-print-leave-out"),
        )  # fmt: skip
    return tuple(found)


def _lines(grey: np.ndarray, scale: float, kind: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return middles [N, 2] mm, directions [N, 2] and lengths [N] mm of everything thin, straight and short."""
    width = round(2 * THICKEST_MM * scale) | 1
    thin = cv2.morphologyEx(grey, kind, np.ones((width, width), np.uint8))
    level = max(LEAST_CONTRAST, 0.45 * float(np.quantile(thin[::3, ::3], 0.998)))
    count, labels, stats, _middles = cv2.connectedComponentsWithStats((thin > level).astype(np.uint8), connectivity=8)
    longest = stats[:, [cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]].max(axis=1) / scale
    fitting = np.flatnonzero((longest > 0.7 * SHORTEST_MM) & (longest < LONGEST_MM))
    fitting = fitting[fitting > 0]
    nothing = np.empty((0, 2)), np.empty((0, 2)), np.empty(0)
    if not LEAST_LINES <= len(fitting) <= MOST_LINES:
        return nothing
    y, x = np.nonzero(labels)
    of, weight = labels[y, x], thin[y, x].astype(float)
    mass = np.maximum(np.bincount(of, weight, count), 1e-9)
    mean = np.stack([np.bincount(of, weight * v, count) / mass for v in (x, y)], axis=1)
    dx, dy = x - mean[of, 0], y - mean[of, 1]
    xx, yy, xy = (np.bincount(of, weight * v, count) / mass for v in (dx * dx, dy * dy, dx * dy))
    angle = 0.5 * np.arctan2(2 * xy, xx - yy)
    spread = np.hypot((xx - yy) / 2, xy)
    length, wide = (np.sqrt(12 * np.maximum((xx + yy) / 2 + sign * spread, 0.05)) / scale for sign in (1, -1))
    good = (length > SHORTEST_MM) & (length < LONGEST_MM) & (wide < THICKEST_MM) & (length > SLENDER_RATIO * wide)
    chosen = fitting[good[fitting]]
    way = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return (mean[chosen] + 0.5) / scale, way[chosen], length[chosen]


def _rows(middle: np.ndarray, way: np.ndarray, length: np.ndarray) -> list[Ruler]:
    """Return the rows of evenly spaced lines; ``excess`` is their spacing less one millimetre."""
    found: list[Ruler] = []
    left = np.ones(len(middle), bool)
    for _ in range(4):  # up to four rows: both edges of two rulers
        if left.sum() < LEAST_LINES:
            break
        double = np.arctan2(2 * way[left, 0] * way[left, 1], way[left, 0] ** 2 - way[left, 1] ** 2)
        counts, bins = np.histogram(double, np.linspace(-np.pi, np.pi, 91))
        peak = (bins[np.argmax(counts)] + bins[np.argmax(counts) + 1]) / 2
        near = left & (np.abs(np.angle(np.exp(1j * (2 * np.arctan2(way[:, 1], way[:, 0]) - peak)))) < 4 * SAME_WAY_RAD)
        if near.sum() < LEAST_LINES:
            break
        members = _one_row(middle, way, length, np.flatnonzero(near))
        if len(members) < LEAST_LINES:
            left &= ~near
            continue
        left[members] = False
        if (row := _even(middle[members], way[members], length[members])) is not None:
            found.append(row)
    return found


def _one_row(middle: np.ndarray, way: np.ndarray, length: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Return the numbers of the lines that have one end on the straight edge that most lines share."""
    tick = _mean_way(way[near])
    best = np.empty(0, np.int64)
    for end in (-0.5, 0.5):
        at = middle[near] @ tick + end * length[near]
        order = np.argsort(at)
        window = np.searchsorted(at[order], at[order] + EDGE_MM) - np.arange(len(order))
        first = int(np.argmax(window))
        if window[first] > len(best):
            best = near[order[first : first + window[first]]]
    return best


def _mean_way(way: np.ndarray) -> np.ndarray:
    """Return the mean direction [2] of lines [N, 2], whichever way along itself each is given."""
    _, vectors = np.linalg.eigh(way.T @ way)
    return np.asarray(vectors[:, -1])


def _even(middle: np.ndarray, way: np.ndarray, length: np.ndarray) -> Ruler | None:
    """Return the row if its lines are evenly spaced and every fifth (or fourth) is longer, or None."""
    tick = _mean_way(way)
    along = np.array([-tick[1], tick[0]])
    place = middle @ along
    order = np.argsort(place)
    place, middle, length = place[order], middle[order], length[order]
    step = float(np.median(np.diff(place)))
    if step <= 0.2:
        return None
    number = np.concatenate([[0.0], np.cumsum(np.rint(np.diff(place) / step))])
    for _ in range(3):
        (step, start), *_ = np.linalg.lstsq(np.stack([number, np.ones_like(number)], axis=1), place, rcond=None)
        number = np.rint((place - start) / step)
        off = np.abs(place - start - step * number)
        kept = off < 0.2 * step
        place, number, middle, length = place[kept], number[kept], middle[kept], length[kept]
        if len(place) < LEAST_LINES:
            return None
    uneven = float(np.sqrt(np.square(place - start - step * number).mean())) / step
    different = len(np.unique(number))
    if different < LEAST_LINES or different < LEAST_LINES_SHARE * (np.ptp(number) + 1) or uneven > MOST_UNEVEN_SHARE:
        return None
    if not any(_longer(length, number, every) for every in (5, 4)):
        return None
    reach = float(np.ptp(number)) * step
    span = middle @ tick
    corners = np.array([
        place[side] * along + depth * tick
        for side, depth in ((0, span.min() - 4), (-1, span.min() - 4), (-1, span.max() + 4), (0, span.max() + 4))
    ])  # fmt: skip
    return Ruler(along, step - 1.0, different, reach, corners)


def _longer(length: np.ndarray, number: np.ndarray, every: int) -> bool:
    """Return whether one line in ``every`` is longer than the others."""
    usual = [float(np.median(length[number % every == k])) for k in range(every) if (number % every == k).any()]
    return len(usual) == every and sorted(usual)[-1] > LONGER_RATIO * sorted(usual)[-2]
