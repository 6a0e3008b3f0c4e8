"""Synthetic photos: a rendered scan with the reference sheet around it, seen by a hand-held camera."""

from dataclasses import replace

import cv2
import numpy as np

from printmend.measure.fiducials import NODE_PX, TAG_MM, Lens, between_nodes, tag_cells, tag_centres_mm
from printmend.measure.plan import ProbePlan
from printmend.twin.scanner import DEFAULT, render_scan
from printmend.units import A4_MM, MM_PER_INCH

FLAT_DPI = 400.0  # of the page that is photographed
PHOTO_PX = (3000, 4000)  # width and height
MOST_TILT_DEG = 12.0  # of the camera
LENS_K1_SD, LENS_K2_SD = 0.04, 0.01  # of the lens' radial distortion
NOISE_SD = 3.0  # of a pixel, of 255


def render_photo(printed_mm: np.ndarray, plan: ProbePlan, *, rng: np.random.Generator) -> np.ndarray:
    """Return a photo [4000, 3000, 3] of the marks [M, 2] mm inside the sheet's frame."""
    still = replace(DEFAULT, stretch=0.0, wave_mm=0.0, noise=0.0, jpeg_quality=None)
    flat = render_scan(printed_mm, plan, dpi=FLAT_DPI, degradations=still, rng=rng, size_mm=A4_MM).image
    _lay_sheet(flat)
    lens = _camera(rng)
    height, width = PHOTO_PX[1], PHOTO_PX[0]
    photo = np.empty((height, width, 3), np.uint8)
    grid = np.stack(np.meshgrid(np.arange(width // NODE_PX + 2), np.arange(height // NODE_PX + 2)), axis=-1)
    nodes = lens.to_mm(grid.astype(float) * NODE_PX) * (FLAT_DPI / MM_PER_INCH) - 0.5
    strip = 16 * NODE_PX
    for first in range(0, height, strip):
        at = between_nodes(nodes[first // NODE_PX : (first + strip) // NODE_PX + 1])[: height - first, :width]
        photo[first : first + strip] = cv2.remap(
            flat, at, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=(90, 80, 70)
        )
    photo = cv2.GaussianBlur(photo, (0, 0), 0.7)
    noisy = photo + rng.standard_normal(photo.shape, np.float32) * np.float32(NOISE_SD)
    _, data = cv2.imencode(".jpg", np.clip(noisy, 0, 255).astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, 92])
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR))


def _lay_sheet(flat: np.ndarray) -> None:
    """Draw the tags and the paper around them onto a flat picture of an A4 page."""
    px_per_mm = FLAT_DPI / MM_PER_INCH
    for tag, centre in enumerate(tag_centres_mm()):
        side = round((TAG_MM + 4) * px_per_mm)
        low = np.rint((centre - TAG_MM / 2 - 2) * px_per_mm).astype(int)
        # the tag is drawn at the fraction of a pixel where it belongs
        cell = TAG_MM / 8 * px_per_mm
        shift = (centre - TAG_MM / 2) * px_per_mm - low
        to_cells = np.array([[1 / cell, 0, -shift[0] / cell], [0, 1 / cell, -shift[1] / cell]])
        cells = np.kron(tag_cells(tag), np.ones((32, 32))).astype(np.float32)
        to_cells = to_cells * 32
        to_cells[:, 2] += 16 / cell - 0.5
        black = cv2.warpAffine(cells, to_cells, (side, side), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
        flat[low[1] : low[1] + side, low[0] : low[0] + side] = (245 - 220 * black[:, :, None]).astype(np.uint8)


def _camera(rng: np.random.Generator) -> Lens:
    """Return a camera above the sheet, tilted and turned a little, whose lens bends straight lines."""
    centre = np.array([(PHOTO_PX[0] - 1) / 2, (PHOTO_PX[1] - 1) / 2])
    tilt = np.deg2rad(rng.normal(0, MOST_TILT_DEG / 2, 2).clip(-MOST_TILT_DEG, MOST_TILT_DEG))
    roll = np.deg2rad(rng.normal(0, 3))
    focal, distance = 1.1 * PHOTO_PX[1], 340.0 * 1.1 * rng.uniform(1.12, 1.25)
    rotation, _ = cv2.Rodrigues(np.array([tilt[0], tilt[1], roll]))
    middle = np.array([A4_MM[0] / 2, A4_MM[1] / 2, 0.0])
    # sheet (x, y) → camera: R·((x, y, 0) − middle) + (0, 0, distance)
    camera = np.column_stack([rotation[:, 0], rotation[:, 1], -rotation @ middle + [0, 0, distance]])
    intrinsic = np.array([[focal, 0, centre[0]], [0, focal, centre[1]], [0, 0, 1]])
    homography = np.linalg.inv(intrinsic @ camera)
    return Lens(
        centre,
        float(np.hypot(*centre)),
        rng.normal(0, LENS_K1_SD),
        rng.normal(0, LENS_K2_SD),
        homography / homography[2, 2],
    )
