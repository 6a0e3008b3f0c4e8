"""Small pictures for lists: of a part its widest layer from above, as lines; of a scan or photo a smaller one."""

import contextlib
from pathlib import Path

import numpy as np

from printmend.files import replacing
from printmend.studio.scene import Scene

_MOST_POINTS = 1500
_PHOTO_PX = 320  # longer side of a small picture of a photo
_SVG = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="{box}" fill="none" stroke="#0f9d90" stroke-width="1.3" '
    'stroke-linejoin="round"><path vector-effect="non-scaling-stroke" d="{path}"/></svg>\n'
)


def write_thumb(path: Path, scene: Scene) -> None:
    """Write the layer of a part that has the longest way as a picture of lines; nothing is written of no part."""
    if not len(scene.layer):
        return
    length = np.append(np.hypot(*np.diff(scene.wanted_mm[:, :2], axis=0).T), 0.0) * scene.joined
    of_layer = np.bincount(scene.layer, weights=length)
    points, joined = _thinned(
        scene.wanted_mm[scene.layer == of_layer.argmax(), :2], scene.joined[scene.layer == of_layer.argmax()]
    )
    low, high = points.min(axis=0), points.max(axis=0)
    pad = 0.04 * max(*(high - low), 1.0)
    box = f"{low[0] - pad:.2f} {-high[1] - pad:.2f} {high[0] - low[0] + 2 * pad:.2f} {high[1] - low[1] + 2 * pad:.2f}"
    begun = np.append(True, ~joined[:-1])
    drawn = "".join(f"{'M' if begins else 'L'}{x:.1f} {-y:.1f}" for (x, y), begins in zip(points, begun, strict=True))
    with replacing(path) as file:
        file.write(_SVG.format(box=box, path=drawn))


def write_photo(path: Path, source: Path) -> bool:
    """Write a scan or photo smaller, upright; return False of what is no image, or is too large to be one."""
    from PIL import Image, ImageOps

    from printmend.measure.image import MOST_PIXELS

    with (
        contextlib.suppress(OSError, SyntaxError, ValueError, Image.DecompressionBombError),
        Image.open(source) as image,
    ):
        if image.width * image.height <= MOST_PIXELS:
            image.draft("RGB", (_PHOTO_PX, _PHOTO_PX))  # JPEG is then unpacked smaller
            small = ImageOps.exif_transpose(image).convert("RGB")
            small.thumbnail((_PHOTO_PX, _PHOTO_PX))
            with replacing(path, "wb") as file:
                small.save(file, "JPEG", quality=80)
            return True
    return False


def _thinned(points: np.ndarray, joined: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return about `_MOST_POINTS` of the points; the ends of each bead stay."""
    every = max(1, len(points) // _MOST_POINTS)
    ends = ~joined | np.append(True, ~joined[:-1])
    keep = ends | (np.arange(len(points)) % every == 0)
    return points[keep], joined[keep]
