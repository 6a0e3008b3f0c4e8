"""The reference sheet as a PDF of one page, for the owner to print: tags, a ruled line, and what to do with it."""

from pathlib import Path

import numpy as np

from printmend.files import replacing
from printmend.measure.sheet import BORDER_MM, PAGE_MM, TAG_MM, WINDOW_EDGE_MM, tag_cells, tag_centres_mm, window_mm
from printmend.pdf import PdfPage

INK = (0.0, 0.0, 0.0)
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


def write_sheet(path: str | Path) -> None:
    """Write the sheet as a one-page PDF of black rectangles."""
    page = PdfPage()
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
