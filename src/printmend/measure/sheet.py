"""The reference sheet: an A4 frame of AprilTags to lay around or beside a print, as a PDF.

On a flatbed it gives the scale; on a photo it gives the perspective and the lens. The window is cut out.
"""

from pathlib import Path

import cv2
import numpy as np

from printmend.files import replacing
from printmend.pdf import Page
from printmend.units import A4_MM

PAGE_MM = A4_MM
INK = (0.0, 0.0, 0.0)
TAG_MM = 14.0  # the side of a tag
BORDER_MM = 14.0  # from the paper's edge to the centres of the tags
COLUMNS, ROWS = 4, 5
WINDOW_EDGE_MM = 4.0  # from the tags to the window
RULER_MM = 100.0  # the printed line that an owner measures
RULER_Y_MM = PAGE_MM[1] - 23.4  # between the tags and the window
LINE_MM = 2.7  # from one line of text to the next
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
    page = Page()
    for tag, centre in enumerate(tag_centres_mm()):
        cell = TAG_MM / 8
        for row, column in np.argwhere(tag_cells(tag)):
            page.rectangle(centre - TAG_MM / 2 + cell * np.array([column, row]), (cell, cell), INK)
    edge = BORDER_MM + TAG_MM / 2 + WINDOW_EDGE_MM
    page.frame((edge, edge), window_mm().tolist(), INK, 0.15)
    line, left = RULER_Y_MM, (PAGE_MM[0] - RULER_MM) / 2
    page.rectangle((left, line), (RULER_MM, 0.3), INK)
    for end in (left, left + RULER_MM):
        page.rectangle((end - 0.15, line - 0.9), (0.3, 2.1), INK)
    for (x_mm, y_mm), lines in WORDS:
        for number, text in enumerate(lines):
            page.words((x_mm, y_mm + LINE_MM * number), text, 6.0)
    with replacing(Path(path), "wb") as file:
        file.write(page.bytes())
