"""The reference sheet: an A4 frame of AprilTags to lay around or beside a print; `probe.tags` draws it.

On a flatbed it gives the scale; on a photo it gives the perspective and the lens. The window is cut out.
"""

import cv2
import numpy as np

from printmend.units import A4_MM

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
