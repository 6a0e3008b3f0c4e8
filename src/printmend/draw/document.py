"""Write a document's blocks as a PDF in A4 (`printmend.report.page` writes the same blocks as HTML).

Each function that draws or writes takes ``tell``, which translates a message into the reader's language.
"""

import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal
from xml.sax.saxutils import escape

import matplotlib
from matplotlib.figure import Figure

from printmend.files import replacing
from printmend.messages import Tell, say

_DPI = 200  # resolution of a picture in a PDF
_FONT, _BOLD = "DejaVuSans", "DejaVuSans-Bold"  # matplotlib includes them; they have all our characters
_INK, _SOFT, _LINE, _CARD = "#22303a", "#57534e", "#d6d3d1", "#fafaf9"
_MARGIN_MM, _GAP_MM = 16.0, 3.0
_FRAME_PT = 6.0  # what reportlab leaves free at the sides of a page's frame
_SMALL_PT, _CELL_GAP_PT = 8.0, 13.0  # a table's letters, and the room beside a cell's words
_HIGHEST_MM = 66.0  # largest height of a row of pictures: three rows and their captions fill a page
_HEADED_MM = 85.0  # a heading goes to the next page unless so much room follows it


def svg(figure: Figure, *, dpi: int = 100) -> str:
    """Return a figure as SVG, its rasters at ``dpi``; equal figures give equal text."""
    text = io.StringIO()
    with matplotlib.rc_context({"svg.hashsalt": "printmend"}):
        figure.savefig(text, format="svg", dpi=dpi, metadata={"Date": None, "Creator": None})
    return text.getvalue()


@dataclass(frozen=True)
class Words:
    """A paragraph: a title, the sentence below it (lead), a heading, text, or small print."""

    style: Literal["title", "lead", "heading", "text", "small"]
    text: str


@dataclass(frozen=True)
class Items:
    """A list of sentences; a missing initial capital or full stop is added."""

    texts: Sequence[str]


@dataclass(frozen=True)
class Numbers:
    """A table: its first row is the head, its first ``words`` columns are text. ``caption`` stands above it.

    A page in HTML shows a ``folded`` table only when its caption is clicked.
    """

    caption: str
    rows: Sequence[Sequence[str]]
    words: int = 1
    folded: bool = False


@dataclass(frozen=True)
class Strip:
    """The most important numbers, each with its words, side by side."""

    numbers: Sequence[tuple[str, str]]


@dataclass(frozen=True)
class Card:
    """A box with a stripe in ``colour``: a title, the text of a mark beside it, and lines (name, text)."""

    title: str
    mark: str
    colour: str
    lines: Sequence[tuple[str, str]]


@dataclass(frozen=True, eq=False)
class Pictures:
    """Figures side by side, with one height, together as wide as the page; their caption is below."""

    figures: Sequence[Figure]
    caption: str


Block = Words | Items | Numbers | Strip | Card | Pictures


def sentence(text: str) -> str:
    """Return words with a capital at the beginning and a full stop at the end."""
    return f"{text[:1].upper()}{text[1:].removesuffix('.')}." if text else text


def write_pdf(path: Path, title: str, blocks: Sequence[Block], *, foot: str, tell: Tell = str) -> None:
    """Write blocks as a PDF in A4, ``foot`` and the page's number at the bottom; equal blocks give equal bytes.

    A picture and its caption, and a heading and its next block, stay on one page.
    """
    from reportlab.lib.pagesizes import A4
    from reportlab.lib.units import mm
    from reportlab.platypus import CondPageBreak, SimpleDocTemplate

    _take_fonts()

    def margins(canvas: Any, document: Any) -> None:
        canvas.setFont(_FONT, 7)
        canvas.setFillColor(_SOFT)
        canvas.drawString(_MARGIN_MM * mm, 9 * mm, foot)
        canvas.drawRightString(A4[0] - _MARGIN_MM * mm, 9 * mm, tell(say("pdf-page", document.page)))

    width, side = A4[0] - 2 * _MARGIN_MM * mm, _MARGIN_MM * mm - _FRAME_PT
    with replacing(path, "wb") as file:
        document = SimpleDocTemplate(
            file, pagesize=A4, leftMargin=side, rightMargin=side, topMargin=_MARGIN_MM * mm,
            bottomMargin=_MARGIN_MM * mm, title=tell(title), author="printmend", invariant=1,
        )  # fmt: skip
        flowables: list[Any] = []
        for block in blocks:
            if isinstance(block, Words) and block.style == "heading":
                flowables.append(CondPageBreak(_HEADED_MM * mm))
            flowables += _flowables(block, width, tell)
        document.build(flowables, onFirstPage=margins, onLaterPages=margins)


def _take_fonts() -> None:
    from reportlab.lib.fonts import addMapping
    from reportlab.pdfbase import pdfmetrics
    from reportlab.pdfbase.ttfonts import TTFont

    folder = Path(matplotlib.get_data_path()) / "fonts" / "ttf"
    for bold, name in enumerate((_FONT, _BOLD)):
        pdfmetrics.registerFont(TTFont(name, folder / f"{name}.ttf"))
        addMapping(_FONT, bold, 0, name)
        addMapping(_FONT, bold, 1, name)


def _flowables(block: Block, width: float, tell: Tell) -> list[Any]:
    if isinstance(block, Words):
        return [_paragraph(tell(block.text), "text" if block.style == "lead" else block.style)]
    if isinstance(block, Items):
        return [_paragraph(f"• {sentence(tell(text))}", "text") for text in block.texts]
    if isinstance(block, Numbers):
        return [_table(block, width, tell)]
    if isinstance(block, Strip):
        return [_strip(block, width, tell)]
    return [_card(block, width, tell) if isinstance(block, Card) else _pictures(block, width, tell)]


def _paragraph(text: str, style: str, *, colour: str = _INK, right: bool = False) -> Any:
    from reportlab.lib.styles import ParagraphStyle
    from reportlab.platypus import Paragraph

    size, bold, before, after = {
        "title": (18, True, 0, 6), "heading": (12, True, 12, 4), "text": (9.5, False, 0, 4),
        "small": (7.5, False, 0, 3), "number": (13, True, 0, 2), "card": (10, True, 0, 2),
        "cell": (8.5, False, 0, 0), "caption": (8, False, 3, 8), "head": (_SMALL_PT, True, 0, 0),
        "row": (_SMALL_PT, False, 0, 0),
    }[style]  # fmt: skip
    return Paragraph(
        escape(text.replace("`", "")),
        ParagraphStyle(
            style, fontName=_BOLD if bold else _FONT, fontSize=size, leading=1.35 * size, spaceBefore=before,
            spaceAfter=after, textColor=colour, alignment=2 if right else 0,
        ),
    )  # fmt: skip


def _table(block: Numbers, width: float, tell: Tell) -> Any:
    from reportlab.pdfbase.pdfmetrics import stringWidth
    from reportlab.platypus import KeepTogether, Table

    style: list[tuple[Any, ...]] = [
        ("LINEBELOW", (0, 0), (-1, -1), 0.4, _LINE), ("LEFTPADDING", (0, 0), (0, -1), 0),
        ("VALIGN", (0, 0), (-1, -1), "TOP"), ("TOPPADDING", (0, 0), (-1, -1), 2),
        ("BOTTOMPADDING", (0, 0), (-1, -1), 2),
    ]  # fmt: skip
    rows = [[tell(cell) for cell in row] for row in block.rows]
    widths = [
        max(stringWidth(cell, _FONT if i else _BOLD, _SMALL_PT) for i, cell in enumerate(column)) + _CELL_GAP_PT
        for column in zip(*rows, strict=True)
    ]
    words = slice(block.words)  # these columns share what the numbers leave of the page
    share = min(1.0, (width - sum(widths[block.words :])) / sum(widths[words]))
    widths[words] = [share * each for each in widths[words]]
    cells = [
        [_paragraph(cell, "row" if i else "head", right=j >= block.words) for j, cell in enumerate(row)]
        for i, row in enumerate(rows)
    ]
    table = Table(cells, colWidths=widths, style=style, hAlign="LEFT", spaceAfter=8)
    caption = [_paragraph(tell(block.caption), "text")] if block.caption else []
    return KeepTogether([*caption, table])


def _strip(block: Strip, width: float, tell: Tell) -> Any:
    from reportlab.platypus import Table

    cells = [
        [_paragraph(tell(value), "number"), _paragraph(tell(about), "cell", colour=_SOFT)]
        for value, about in block.numbers
    ]
    style = [
        ("BOX", (0, 0), (-1, -1), 0.4, _LINE), ("INNERGRID", (0, 0), (-1, -1), 0.4, _LINE),
        ("BACKGROUND", (0, 0), (-1, -1), _CARD), ("VALIGN", (0, 0), (-1, -1), "TOP"),
        ("TOPPADDING", (0, 0), (-1, -1), 5), ("BOTTOMPADDING", (0, 0), (-1, -1), 6),
    ]  # fmt: skip
    return Table([cells], colWidths=[width / len(cells)] * len(cells), style=style, spaceBefore=4, spaceAfter=8)


def _card(block: Card, width: float, tell: Tell) -> Any:
    from reportlab.lib.units import mm
    from reportlab.platypus import KeepTogether, Table

    name = 26 * mm
    title = " – ".join(map(tell, filter(None, (block.title, block.mark))))
    rows = [[_paragraph(title, "card", colour=block.colour), ""]]
    for key, text in block.lines:
        words = _paragraph(tell(text), "cell")
        rows.append([_paragraph(tell(key), "cell", colour=_SOFT), words] if key else [words, ""])
    style = [
        *(("SPAN", (0, row), (1, row)) for row in range(len(rows)) if rows[row][1] == ""),
        ("LINEBEFORE", (0, 0), (0, -1), 3, block.colour), ("VALIGN", (0, 0), (-1, -1), "TOP"),
        ("BACKGROUND", (0, 0), (-1, -1), _CARD), ("TOPPADDING", (0, 0), (-1, -1), 2),
        ("BOTTOMPADDING", (0, 0), (-1, -1), 2),
    ]  # fmt: skip
    return KeepTogether([Table(rows, colWidths=[name, width - name], style=style, spaceAfter=6)])


def _pictures(block: Pictures, width: float, tell: Tell) -> Any:
    from reportlab.lib.units import mm
    from reportlab.platypus import Image, KeepTogether, Table

    shapes = [figure.get_size_inches() for figure in block.figures]
    room = width - (len(shapes) - 1) * _GAP_MM * mm
    height = min(room / sum(wide / high for wide, high in shapes), _HIGHEST_MM * mm)
    images = []
    for figure, (wide, high) in zip(block.figures, shapes, strict=True):
        data = io.BytesIO()
        figure.savefig(data, format="png", dpi=_DPI, metadata={"Software": None})
        data.seek(0)
        images.append(Image(data, width=height * wide / high, height=height))
    style = [
        ("LEFTPADDING", (0, 0), (-1, -1), 0),
        ("RIGHTPADDING", (0, 0), (-1, -1), 0),
        ("VALIGN", (0, 0), (-1, -1), "TOP"),
    ]
    columns = [image.drawWidth + (_GAP_MM * mm if i < len(images) - 1 else 0) for i, image in enumerate(images)]
    return KeepTogether(
        [
            Table([images], colWidths=columns, style=style, hAlign="CENTER"),
            _paragraph(tell(block.caption), "caption", colour=_SOFT),
        ]
    )
