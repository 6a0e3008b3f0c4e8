"""The frame of a photo: the reference sheet of AprilTags, or the edges of a plain sheet of paper.

On a flatbed the sheet gives the scale; in a photo it gives the perspective and the lens. Its window is cut out.
`probe.tags` draws it. A photo shows a plane through a lens with radial distortion around the middle of the picture:

    u = c + (p − c)(1 + k₁ρ² + k₂ρ⁴),  ρ = |p − c| / half the diagonal;   mm = H·u, a homography.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.optimize import least_squares

from printmend.path import Instrument
from printmend.units import A4_MM, LETTER_MM

PAGE_MM = A4_MM
TAG_MM = 14.0  # the side of a tag
BORDER_MM = 14.0  # distance from the paper's edge to the centres of the tags
COLUMNS, ROWS = 4, 5  # tags along the short and along the long sides of the frame
WINDOW_EDGE_MM = 4.0  # distance from the tags to the window
DICTIONARY = cv2.aruco.DICT_APRILTAG_36H11


def tag_centres_mm() -> np.ndarray:
    """Return the centres of the tags [N, 2] mm, x to the right and y down from the sheet's upper left corner."""
    xs = np.linspace(BORDER_MM, PAGE_MM[0] - BORDER_MM, COLUMNS)
    ys = np.linspace(BORDER_MM, PAGE_MM[1] - BORDER_MM, ROWS)
    return np.array([(x, y) for y in ys for x in xs if x in (xs[0], xs[-1]) or y in (ys[0], ys[-1])])


def tag_corners_mm() -> np.ndarray:
    """Return the corners [N, 4, 2] of the tags' black squares, clockwise from the upper left."""
    half = TAG_MM / 2
    return tag_centres_mm()[:, None] + np.array([[-half, -half], [half, -half], [half, half], [-half, half]])


def tag_cells(tag: int) -> np.ndarray:
    """Return the cells of a tag [8, 8], True where black."""
    dictionary = cv2.aruco.getPredefinedDictionary(DICTIONARY)
    return cv2.aruco.generateImageMarker(dictionary, tag, 8) < 128


def window_mm() -> np.ndarray:
    """Return the width and height [2] mm of the window that is cut out for the print."""
    return np.array(PAGE_MM) - 2 * BORDER_MM - TAG_MM - 2 * WINDOW_EDGE_MM


SEARCH_PX = 2200  # longer side of the picture in which tags are looked for; their corners are refined at full size
LEAST_TAGS = 4  # tags of the sheet that must be seen
NODE_PX = 16  # the lens is computed at every 16th pixel and interpolated between
# In a flatbed's picture, an affine map's error at the tags is below this, or below this many times a lens model's.
FLAT_MM, FLAT_RATIO = 0.03, 1.5


@dataclass(frozen=True, eq=False)
class Tags:
    """``ids`` [N] and ``corners_px`` [N, 4, 2] of the tags seen."""

    ids: np.ndarray
    corners_px: np.ndarray

    def __len__(self) -> int:
        return len(self.ids)


@dataclass(frozen=True, eq=False)
class Lens:
    """A photo's way from the sheet to the picture: ``homography`` [3, 3] from undistorted px to mm, ``k1``, ``k2``."""

    centre_px: np.ndarray
    radius_px: float
    k1: float
    k2: float
    homography: np.ndarray

    def undistort(self, px: np.ndarray) -> np.ndarray:
        """Return where the points [..., 2] would be without the lens' distortion."""
        off = (px - self.centre_px) / self.radius_px
        square = (off**2).sum(axis=-1, keepdims=True)
        return self.centre_px + off * self.radius_px * (1 + self.k1 * square + self.k2 * square**2)

    def sheet_axes(self, focal_px: float) -> np.ndarray:
        """Return the columns r₁, r₂, t [3, 3] of the sheet's axes and origin before the camera, up to a factor.

        The homography from the sheet is K·[r₁ r₂ t] up to a factor, with unit columns r of a rotation.
        """
        camera = np.array([[focal_px, 0, self.centre_px[0]], [0, focal_px, self.centre_px[1]], [0, 0, 1]])
        return np.linalg.solve(camera, np.linalg.inv(self.homography))

    def to_mm(self, px: np.ndarray) -> np.ndarray:
        """Map pixels [..., 2] to the sheet."""
        return _projected(self.undistort(px), self.homography)

    def to_px(self, mm: np.ndarray) -> np.ndarray:
        """Map points of the sheet [..., 2] to pixels: the inverse, by fixed-point iteration."""
        wanted = _projected(mm, np.linalg.inv(self.homography))
        px = wanted
        for _ in range(12):
            px = px + (wanted - self.undistort(px))
        return px


@dataclass(frozen=True, eq=False)
class PictureFrame:
    """A picture's middle and half its diagonal, the units in which a lens is fitted: all numbers are then near 1."""

    centre_px: np.ndarray
    radius_px: float

    @classmethod
    def of(cls, image_shape: tuple[int, ...]) -> "PictureFrame":
        """Return the frame of a picture of shape [H, W, …]."""
        centre = np.array([(image_shape[1] - 1) / 2, (image_shape[0] - 1) / 2])
        return cls(centre, float(np.hypot(*centre)))

    def first_homography(self, px: np.ndarray, mm: np.ndarray) -> np.ndarray:
        """Return the first eight numbers of the homography that maps pixels [N, 2] to mm [N, 2], the ninth being 1."""
        found, _ = cv2.findHomography((px - self.centre_px) / self.radius_px, mm)
        return np.asarray((found / found[2, 2]).ravel()[:8])

    def lens(self, homography: np.ndarray, k1: float, k2: float) -> Lens:
        """Return the lens with the first eight numbers of such a homography."""
        (x, y), radius = self.centre_px, self.radius_px
        to_unit = np.array([[1 / radius, 0, -x / radius], [0, 1 / radius, -y / radius], [0, 0, 1]])
        return Lens(self.centre_px, radius, k1, k2, np.append(homography, 1.0).reshape(3, 3) @ to_unit)


def is_flat(tags: Tags, lens_error_mm: float) -> bool:
    """Return whether a flatbed took the picture: an affine map fits the tags as well as a homography and a lens do."""
    _, error_mm = fit_affine(tags)
    return error_mm < max(FLAT_MM, FLAT_RATIO * lens_error_mm)


def fit_affine(tags: Tags) -> tuple[np.ndarray, float]:
    """Fit the affine map [3, 2] from pixels (x, y, 1) to the sheet; return it and the RMS error of the corners [mm]."""
    px = tags.corners_px.reshape(-1, 2)
    mm = tag_corners_mm()[tags.ids].reshape(-1, 2)
    design = np.hstack([px, np.ones((len(px), 1))])
    fit, *_ = np.linalg.lstsq(design, mm, rcond=None)
    return fit, float(np.sqrt(((design @ fit - mm) ** 2).sum(axis=1).mean()))


def find_tags(image: np.ndarray) -> Tags:
    """Find the reference sheet's tags in an image [H, W, 3]; corners to a fraction of a pixel."""
    factor = min(1.0, SEARCH_PX / max(image.shape[:2]))
    size = (round(image.shape[1] * factor), round(image.shape[0] * factor))
    small = cv2.cvtColor(cv2.resize(image, size, interpolation=cv2.INTER_AREA), cv2.COLOR_BGR2GRAY)
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(DICTIONARY))
    corners, ids, _ = detector.detectMarkers(small)
    if ids is None or not len(corners):
        return Tags(np.empty(0, int), np.empty((0, 4, 2)))
    ids = np.ravel(ids)
    known = ids < len(tag_corners_mm())
    places = np.array([np.reshape(corner, (4, 2)) for corner in corners])[known]
    places = (places + 0.5) / factor - 0.5
    refined = [_refined(image, place) for place in places]
    return Tags(ids[known], np.array(refined).reshape(-1, 4, 2))


def _refined(image: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return the corners [4, 2] px of one tag, refined in the image at full size."""
    side = float(np.hypot(*(corners[1] - corners[0])))
    reach = int(side) + 8
    x, y = np.maximum(corners.min(axis=0).astype(int) - reach, 0)
    patch = cv2.cvtColor(
        image[y : int(corners[:, 1].max()) + reach, x : int(corners[:, 0].max()) + reach], cv2.COLOR_BGR2GRAY
    )
    window = int(np.clip(side / 20, 2, 12))
    start = (corners - [x, y]).astype(np.float32).reshape(-1, 1, 2)
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 40, 1e-3)
    return cv2.cornerSubPix(patch, start, (window, window), (-1, -1), stop).reshape(4, 2) + np.array([x, y])


def fit_lens(tags: Tags, image_shape: tuple[int, ...]) -> tuple[Lens, float]:
    """Fit perspective and distortion to at least four tags; return the lens and the RMS error of the corners [mm]."""
    px = tags.corners_px.reshape(-1, 2)
    mm = tag_corners_mm()[tags.ids].reshape(-1, 2)
    frame = PictureFrame.of(image_shape)
    start = frame.first_homography(px, mm)

    def lens(values: np.ndarray) -> Lens:
        return frame.lens(values[:8], values[8], values[9])

    def errors(values: np.ndarray) -> np.ndarray:
        # regularise both coefficients, the second more: corners alone hardly separate the two
        return np.append((lens(values).to_mm(px) - mm).ravel(), [0.05 * values[8], 0.2 * values[9]])

    fit = least_squares(errors, np.append(start, [0.0, 0.0]), loss="huber", f_scale=0.1, x_scale="jac")
    rest = errors(fit.x)[:-2].reshape(-1, 2)
    return lens(fit.x), float(np.sqrt((rest**2).sum(axis=1).mean()))


def tagged_mm() -> tuple[np.ndarray, np.ndarray]:
    """Return the lower and upper corner [2] mm of the area that the tags surround, the tags included."""
    corners = tag_corners_mm().reshape(-1, 2)
    return corners.min(axis=0) - 2, corners.max(axis=0) + 2


def rectify(image: np.ndarray, lens: Lens, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Return the picture between two corners [2] mm of the sheet, as a scanner on the sheet would have taken it.

    Also return the sheet position [2] mm of its upper left corner, and its pixels per mm: those of the photo where it
    is sharpest.
    """
    ends = lens.to_px(np.array([[low, (high[0], low[1])], [(low[0], high[1]), high], [low, (low[0], high[1])]]))
    px_per_mm = float(
        (np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1) / [*(high - low)[[0, 0]], (high - low)[1]]).max()
    )
    size = np.ceil((high - low) * px_per_mm).astype(int)
    nodes_x, nodes_y = np.arange(size[0] // NODE_PX + 2), np.arange(size[1] // NODE_PX + 2)
    grid = np.stack(np.meshgrid(nodes_x, nodes_y), axis=-1) * NODE_PX
    nodes = lens.to_px(low + (grid + 0.5) / px_per_mm)
    out = np.empty((size[1], size[0], 3), np.uint8)
    strip = 16 * NODE_PX
    for first in range(0, int(size[1]), strip):
        rows = slice(first // NODE_PX, (first + strip) // NODE_PX + 1)
        px = between_nodes(nodes[rows])[: size[1] - first, : size[0]]
        out[first : first + strip] = cv2.remap(image, px, None, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    return out, low, px_per_mm


def between_nodes(nodes: np.ndarray) -> np.ndarray:
    """Interpolate a smooth map known at every NODE_PX-th pixel [h, w, 2] to all pixels between, float32."""
    share = (np.arange(NODE_PX) / NODE_PX)[:, None, None]
    rows = nodes[:-1, None] * (1 - share[None]) + nodes[1:, None] * share[None]
    rows = rows.reshape(-1, *nodes.shape[1:])
    share = share[:, 0][None, None]
    columns = rows[:, :-1, None] * (1 - share) + rows[:, 1:, None] * share
    return columns.reshape(len(rows), -1, 2).astype(np.float32)


def _projected(points: np.ndarray, homography: np.ndarray) -> np.ndarray:
    lifted = points @ homography[:, :2].T + homography[:, 2]
    return lifted[..., :2] / lifted[..., 2:]


# A sheet of paper as the frame of a photo: its four edges give perspective and lens, its size the scale.
#
# Paper is cut to a few tenths of a millimetre, so its scale is known to one or two parts in a thousand, like a
# flatbed's. `ruler` or callipers settle it. On a flatbed the edges add nothing to the stated resolution.

SHEETS_MM = {"A4": A4_MM, "letter": LETTER_MM}
PAPER = Instrument(scale_sd=0.0015, axes_sd=0.0012, lean_sd=0.0008, wave_mm=0.008)
SHEET_SEARCH_PX = 1000  # longer side of the picture in which the sheet is looked for
LEAST_SHEET_SHARE = 0.15  # least share of the picture that a sheet fills; a smaller one is not the subject
FULL_SHARE = 0.93  # least share of its four-cornered outline that is bright
PLACES = 80  # places on each edge
REACH_SHARE = 0.012  # half the width of the search around an edge, as a share of the picture
MOST_OFF_MM = 0.4  # largest RMS distance of a sheet's edges from straight lines
KEPT_MM, LEAST_KEPT_SHARE = 0.1, 0.7  # places nearer than this always count; least share of places that must count
MOST_UNEVEN_SHARE = 0.035  # largest error of the ratio between a sheet's sides
FILM_DIAGONAL_MM = 43.27  # diagonal of 36 × 24 mm film, for which focal lengths are stated
USUAL_FOCAL_MM = 27.0  # a telephone's focal length, in terms of such film


@dataclass(frozen=True, eq=False)
class Sheet:
    """A sheet in a photo: the ``lens`` that maps the picture to it, ``size_mm`` [2] as it lies, its name, and the RMS
    error of its edges [mm]."""

    lens: Lens
    size_mm: np.ndarray
    name: str
    error_mm: float


def find_sheet(image: np.ndarray) -> Sheet | None:
    """Find a bright sheet of A4 or letter paper on a darker ground in an image [H, W, 3]; None without one."""
    corners = _corners(image)
    if corners is None:
        return None
    edges = _edges(image, corners)
    if edges is None:
        return None
    found = []
    for name, size in SHEETS_MM.items():
        for lies in (size, size[::-1]):
            sheet = _fitted(edges, corners, np.array(lies), name, image.shape)
            uneven = _uneven(sheet.lens)
            if sheet.error_mm < MOST_OFF_MM and uneven < MOST_UNEVEN_SHARE:
                found.append((uneven, sheet))
    return min(found, key=lambda one: one[0])[1] if found else None


def _corners(image: np.ndarray) -> np.ndarray | None:
    """Return the corners [4, 2] px of the largest bright four-cornered area, clockwise from the upper left."""
    factor = min(1.0, SHEET_SEARCH_PX / max(image.shape[:2]))
    size = (round(image.shape[1] * factor), round(image.shape[0] * factor))
    small = cv2.GaussianBlur(cv2.resize(image, size, interpolation=cv2.INTER_AREA), (0, 0), 1.5)
    darkest = small.min(axis=2)  # white is bright in all colours
    level, _ = cv2.threshold(darkest, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    bright = cv2.morphologyEx((darkest > level).astype(np.uint8), cv2.MORPH_CLOSE, np.ones((9, 9), np.uint8))
    outlines, _ = cv2.findContours(bright, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    if not outlines:
        return None
    outline = max(outlines, key=cv2.contourArea)
    hull = cv2.convexHull(outline)
    square = cv2.approxPolyDP(hull, 0.03 * cv2.arcLength(hull, True), True)[:, 0].astype(float)
    if len(square) != 4 or cv2.contourArea(outline) < LEAST_SHEET_SHARE * bright.size:
        return None
    low, high = square.min(axis=0), square.max(axis=0)
    if cv2.contourArea(outline) < FULL_SHARE * cv2.contourArea(square.astype(np.float32)):
        return None
    if low.min() < 2 or (high > np.array(size) - 3).any():  # cut off by the picture
        return None
    around = square - square.mean(axis=0)
    square = square[np.argsort(np.arctan2(around[:, 1], around[:, 0]))]  # y points down: clockwise
    first = int(np.argmin(square.sum(axis=1)))
    return (np.roll(square, -first, axis=0) + 0.5) / factor - 0.5


def _edges(image: np.ndarray, corners: np.ndarray) -> list[np.ndarray] | None:
    """Return places [N, 2] px on each of the four edges, where the brightness is halfway between paper and ground."""
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    reach = max(8, round(REACH_SHARE * max(grey.shape)))
    along = np.linspace(0.04, 0.96, PLACES)[:, None]
    across = np.arange(-reach, reach + 1)
    middle, edges = corners.mean(axis=0), []
    for begin, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        places = begin + along * (end - begin)
        unit = (end - begin) / np.hypot(*(end - begin))
        out = np.array([unit[1], -unit[0]])
        out *= np.sign(out @ ((begin + end) / 2 - middle))
        at = (places[:, None] + across[None, :, None] * out).astype(np.float32)
        seen = cv2.remap(grey, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(float)
        paper, ground = np.median(seen[:, : reach // 2], axis=1), np.median(seen[:, -(reach // 2) :], axis=1)
        share = np.clip((seen - ground[:, None]) / np.maximum(paper - ground, 1.0)[:, None], 0.0, 1.0)
        edge = share.sum(axis=1) - 0.5 + across[0]
        kept = paper - ground > 25
        if kept.sum() < PLACES // 2:
            return None
        edges.append(places[kept] + edge[kept, None] * out)
    return edges


def _fitted(
    edges: list[np.ndarray], corners: np.ndarray, size_mm: np.ndarray, name: str, shape: tuple[int, ...]
) -> Sheet:
    """Fit perspective and one coefficient of distortion that bring the edges onto those of a sheet."""
    frame = PictureFrame.of(shape)
    wanted = np.array([(0, 0), (size_mm[0], 0), size_mm, (0, size_mm[1])], float)
    start = frame.first_homography(corners, wanted)

    def lens(values: np.ndarray) -> Lens:
        return frame.lens(values[:8], float(values[8]), 0.0)

    def errors(values: np.ndarray) -> np.ndarray:
        upper, right, lower, left = (lens(values).to_mm(edge) for edge in edges)
        off = (upper[:, 1], right[:, 0] - size_mm[0], lower[:, 1] - size_mm[1], left[:, 0])
        return np.concatenate([*off, [0.5 * values[8]]])

    # Levenberg–Marquardt: the default method stops early in this narrow valley
    rough = least_squares(errors, np.append(start, 0.0), method="lm", x_scale="jac").x
    off = np.abs(errors(rough))
    kept = off < np.maximum(4 * np.median(off[:-1]), KEPT_MM)  # not what lies across an edge
    kept[-1] = True
    fit = least_squares(lambda values: errors(values) * kept, rough, method="lm", x_scale="jac").x
    rest = errors(fit)[:-1][kept[:-1]]
    error_mm = float(np.sqrt(np.square(rest).mean())) if kept.mean() > LEAST_KEPT_SHARE else np.inf
    return Sheet(lens(fit), size_mm, name, error_mm)


def _uneven(lens: Lens) -> float:
    """Return by which share a millimetre along the two sides differs, under the assumed paper size."""
    columns = lens.sheet_axes(2 * lens.radius_px * (USUAL_FOCAL_MM / FILM_DIAGONAL_MM))
    return abs(float(np.log(np.linalg.norm(columns[:, 0]) / np.linalg.norm(columns[:, 1]))))
