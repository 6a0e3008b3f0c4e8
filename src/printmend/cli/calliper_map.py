"""A map of the plate that shows which dots to measure across with callipers."""

from pathlib import Path

import cv2
import numpy as np

from printmend.measure.callipers import Distances
from printmend.measure.image import write_image, write_words
from printmend.messages import Tell, say

PX_PER_MM = 8.0
MARGIN_MM = 12.0  # around the outermost dots
INK, CHOSEN = (70, 70, 70), (30, 90, 220)  # colours of dots and of distances: blue, green, red


def draw_map(path: Path, distances: Distances, tell: Tell = str) -> None:
    """Draw every dot of the plate as seen from above, and a numbered line for each distance."""
    marks = distances.plan.marks_mm
    low, high = marks.min(axis=0) - MARGIN_MM, marks.max(axis=0) + MARGIN_MM
    width, height = np.ceil((high - low) * PX_PER_MM).astype(int)
    picture = np.full((height, width, 3), 250, np.uint8)

    def pixel(mm: np.ndarray) -> tuple[int, int]:
        return round((mm[0] - low[0]) * PX_PER_MM), round((high[1] - mm[1]) * PX_PER_MM)

    for mark, diameter in zip(marks, distances.plan.diameter_mm, strict=True):
        cv2.circle(picture, pixel(mark), round(diameter / 2 * PX_PER_MM), INK, -1, cv2.LINE_AA)
    for number, (first, second) in enumerate(distances.pairs, start=1):
        cv2.line(picture, pixel(marks[first]), pixel(marks[second]), CHOSEN, 2, cv2.LINE_AA)
        # not in the middle, where lines cross
        at = marks[first] + (0.12 + 0.03 * (number % 4)) * (marks[second] - marks[first])
        cv2.putText(picture, str(number), pixel(at), cv2.FONT_HERSHEY_SIMPLEX, 1.1, CHOSEN, 3, cv2.LINE_AA)
    write_words(picture, tell(say("overlay-bed-front")), (20, height - 20), 32, INK)
    write_image(path, picture, dpi=PX_PER_MM * 25.4)
