"""Figures for documents: as SVG text for a page, or as the pages of a PDF."""

import io
import textwrap
from collections.abc import Sequence
from pathlib import Path

import matplotlib
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure

from printmend.draw.figure import INK
from printmend.files import replacing

A4_IN = (8.27, 11.69)
LINE_IN = 0.2
MARGIN_IN = 0.8
COLUMNS = 92  # characters a line of body text


def svg(figure: Figure, *, dpi: int = 100) -> str:
    """Return a figure as SVG, its rasters at ``dpi``; equal figures give equal text."""
    text = io.StringIO()
    with matplotlib.rc_context({"svg.hashsalt": "printmend"}):
        figure.savefig(text, format="svg", dpi=dpi, metadata={"Date": None, "Creator": None})
    return text.getvalue()


def text_pages(paragraphs: Sequence[tuple[str, str]]) -> list[Figure]:
    """Set paragraphs (style, text) on A4 pages; the styles are title, heading, text and small."""
    style = {"title": (18, "bold", 46, 2.2), "heading": (12, "bold", 70, 1.6), "text": (10, "normal", 92, 1.0),
             "small": (8, "normal", 112, 0.8)}  # fmt: skip
    pages: list[Figure] = []
    left = 0.0
    for kind, text in paragraphs:
        size, weight, columns, step = style[kind]
        rows = textwrap.wrap(text, columns) or [""]
        needed = (len(rows) * step + 0.5) * LINE_IN
        if not pages or left < needed + (3 * LINE_IN if kind == "heading" else 0):
            pages.append(Figure(figsize=A4_IN, facecolor="white"))
            left = A4_IN[1] - 2 * MARGIN_IN
        for row in rows:
            left -= step * LINE_IN
            at = (left + MARGIN_IN) / A4_IN[1]
            pages[-1].text(MARGIN_IN / A4_IN[0], at, row, fontsize=size, weight=weight, color=INK)
        left -= 0.5 * LINE_IN
    return pages


def save_pdf(figures: Sequence[Figure], path: Path) -> None:
    """Write figures as the pages of a PDF; the file appears when it is whole."""
    with replacing(path, "wb") as file, PdfPages(file, metadata={"Creator": None, "CreationDate": None}) as pages:
        for figure in figures:
            pages.savefig(figure)
