"""Write the reference sheet as a one-page PDF for the owner to print: tags, a ruled line, and instructions."""

from pathlib import Path

import numpy as np

from printmend.files import replacing
from printmend.measure.fiducials import BORDER_MM, PAGE_MM, TAG_MM, WINDOW_EDGE_MM, tag_cells, tag_centres_mm, window_mm
from printmend.messages import ENGLISH, say, tell_in
from printmend.pdf import PdfPage

INK = (0.0, 0.0, 0.0)
RULER_MM = 100.0  # the printed line that an owner measures
RULER_Y_MM = PAGE_MM[1] - 23.4  # between the tags and the window
# Words between the tags of the upper edge: where they begin [mm], and the message; then the letters that fit in a line.
WORDS = (((24.5, 9.6), "tags-lay"), ((85.2, 9.6), "tags-photo"), ((145.9, 9.6), "tags-ruler"))
LETTERS = 40


def write_sheet(path: str | Path, *, language: str = ENGLISH) -> None:
    """Write the sheet as a one-page PDF of black rectangles, its words in a language."""
    page = PdfPage(tell=tell_in(language))
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
    for at_mm, message in WORDS:
        page.paragraph(at_mm, say(message), 6.0, letters=LETTERS)
    with replacing(Path(path), "wb") as file:
        file.write(page.bytes())
