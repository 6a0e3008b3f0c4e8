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
WINDOW_EDGE_MM = 4.0  # from the tags to the window
RULER_MM = 100.0
RULER_Y_MM = PAGE_MM[1] - 23.4  # between the tags and the window
LINE_MM = 2.7
# Between the tags of the upper edge: where the words begin [mm], and their lines.
WORDS = (
    ((24.5, 9.6), ("A part: lay it inside the thin lines,", "the side that lay on the bed up.",
                   "Dots on a plate: cut the window out", "and lay the frame around them.")),
    ((85.2, 9.6), ("Take the photo from above, as far", "away as all 14 squares need, with",
                   "even light and no flash.")),
    ((145.9, 9.6), ("The line at the lower edge is 100 mm", "long: measure it with a ruler. If it is",
                    "not, print the sheet again at 100 %.")),
)  # fmt: skip
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
    return np.array(PAGE_MM) - 2 * BORDER_MM - TAG_MM - 2 * WINDOW_EDGE_MM


def write_sheet(path: str | Path) -> None:
    """Write the sheet as a one-page PDF of black rectangles."""
    drawing = ["0 g"]
    for tag, centre in enumerate(tag_centres_mm()):
        cell = TAG_MM / 8
        for row, column in np.argwhere(tag_cells(tag)):
            drawing.append(_rectangle(centre - TAG_MM / 2 + cell * np.array([column, row]), (cell, cell)))
    low, size = BORDER_MM + TAG_MM / 2 + WINDOW_EDGE_MM, window_mm()
    high = low + size
    for corner, side in (
        ((low, low), (size[0], 0.15)), ((low, high[1]), (size[0], 0.15)),
        ((low, low), (0.15, size[1])), ((high[0], low), (0.15, size[1])),
    ):  # fmt: skip
        drawing.append(_rectangle(np.array(corner), side))
    line = RULER_Y_MM
    drawing.append(_rectangle(np.array([(PAGE_MM[0] - RULER_MM) / 2, line]), (RULER_MM, 0.3)))
    for end in (-1, 1):
        drawing.append(_rectangle(np.array([PAGE_MM[0] / 2 + end * RULER_MM / 2 - 0.15, line - 0.9]), (0.3, 2.1)))
    for (x_mm, y_mm), lines in WORDS:
        for number, text in enumerate(lines):
            x, y = x_mm * _POINTS_PER_MM, (PAGE_MM[1] - y_mm - LINE_MM * number) * _POINTS_PER_MM
            drawing.append(f"BT /F 6 Tf {x:.2f} {y:.2f} Td ({text}) Tj ET")
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
