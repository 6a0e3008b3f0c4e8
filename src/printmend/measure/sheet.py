"""The reference sheet: an A4 frame of AprilTags to lay around or beside a print, as a PDF.

On a flatbed it gives the scale; on a photo it gives the perspective and the lens. The window is cut out.
"""

from pathlib import Path

import cv2
import numpy as np

from printmend.files import replacing

PAGE_MM = (210.0, 297.0)
TAG_MM = 14.0
BORDER_MM = 14.0  # from the paper's edge to the centres of the tags
COLUMNS, ROWS = 4, 5
RULER_MM = 100.0
DICTIONARY = cv2.aruco.DICT_APRILTAG_36H11
_POINTS_PER_MM = 72.0 / 25.4


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
    return np.array(PAGE_MM) - 2 * BORDER_MM - TAG_MM - 8


def write_sheet(path: str | Path) -> None:
    """Write the sheet as a one-page PDF of black rectangles."""
    drawing = ["0 g"]
    for tag, centre in enumerate(tag_centres_mm()):
        cell = TAG_MM / 8
        for row, column in np.argwhere(tag_cells(tag)):
            drawing.append(_rectangle(centre - TAG_MM / 2 + cell * np.array([column, row]), (cell, cell)))
    low, size = BORDER_MM + TAG_MM / 2 + 4, window_mm()
    high = low + size
    for corner, side in (
        ((low, low), (size[0], 0.15)), ((low, high[1]), (size[0], 0.15)),
        ((low, low), (0.15, size[1])), ((high[0], low), (0.15, size[1])),
    ):  # fmt: skip
        drawing.append(_rectangle(np.array(corner), side))
    middle = PAGE_MM[1] / 2
    drawing.append(_rectangle(np.array([(PAGE_MM[0] - RULER_MM) / 2, middle]), (RULER_MM, 0.3)))
    for end in (-1, 1):
        drawing.append(_rectangle(np.array([PAGE_MM[0] / 2 + end * RULER_MM / 2 - 0.15, middle - 3]), (0.3, 6)))
    words = (
        f"This line is {RULER_MM:.0f} mm long: measure it, and print the sheet again at 100 % if it is not.",
        "Cut the window out along the thin lines and lay the frame around the print.",
    )
    for line, text in enumerate(words):
        x, y = 40 * _POINTS_PER_MM, (PAGE_MM[1] - middle - 12 - 6 * line) * _POINTS_PER_MM
        drawing.append(f"BT /F 9 Tf {x:.2f} {y:.2f} Td ({text}) Tj ET")
    with replacing(Path(path), "wb") as file:
        file.write(_pdf("\n".join(drawing)))


def _rectangle(corner_mm: np.ndarray, size_mm: tuple[float, float]) -> str:
    """Return the PDF operators of a filled rectangle; PDF counts y upwards."""
    x, y = corner_mm[0], PAGE_MM[1] - corner_mm[1] - size_mm[1]
    return " ".join(f"{value * _POINTS_PER_MM:.4f}" for value in (x, y, *size_mm)) + " re f"


def _pdf(drawing: str) -> bytes:
    stream = drawing.encode("latin-1")
    width, height = (side * _POINTS_PER_MM for side in PAGE_MM)
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {width:.3f} {height:.3f}] /Contents 4 0 R "
        "/Resources << /Font << /F << /Type /Font /Subtype /Type1 /BaseFont /Helvetica >> >> >> >>".encode(),
        b"<< /Length %d >>\nstream\n%s\nendstream" % (len(stream), stream),
    ]
    out, places = b"%PDF-1.4\n", []
    for number, body in enumerate(objects, start=1):
        places.append(len(out))
        out += b"%d 0 obj\n%s\nendobj\n" % (number, body)
    start = len(out)
    out += b"xref\n0 %d\n0000000000 65535 f \n" % (len(objects) + 1)
    out += b"".join(b"%010d 00000 n \n" % place for place in places)
    return out + b"trailer\n<< /Size %d /Root 1 0 R >>\nstartxref\n%d\n%%%%EOF\n" % (len(objects) + 1, start)
