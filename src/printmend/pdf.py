"""One page of PDF from filled rectangles, lines, dots and words: places in mm, y down from the upper left corner.

Written from ISO 32000-1: a catalogue, a page, one stream of drawing operators, and three fonts that every reader has.
"""

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from printmend.messages import Tell
from printmend.units import A4_MM, MM_PER_INCH

POINTS_PER_MM = 72.0 / MM_PER_INCH
BLACK, GREY, PALE, BLUE, RED = (
    (0.1, 0.1, 0.1),
    (0.45, 0.45, 0.45),
    (0.93, 0.93, 0.93),
    (0.1, 0.35, 0.7),
    (0.8, 0.2, 0.1),
)
FONTS = {"plain": "Helvetica", "bold": "Helvetica-Bold", "typed": "Courier"}
Colour = tuple[float, float, float]
Place = Sequence[float] | np.ndarray  # x and y, or width and height [2] mm


@dataclass(frozen=True, eq=False)
class PdfPage:
    """A page that is drawn on, one operator after the other; ``tell`` puts its words into a language."""

    size_mm: tuple[float, float] = A4_MM
    tell: Tell = str
    drawn: list[str] = field(default_factory=list)

    def rectangle(self, corner_mm: Place, size_mm: Place, colour: Colour = BLACK) -> None:
        """Fill a rectangle, its upper left corner first."""
        self.drawn.append(f"{_said(colour)} rg {self._rectangle(corner_mm, size_mm)} f")

    def frame(self, corner_mm: Place, size_mm: Place, colour: Colour = BLACK, width_mm: float = 0.3) -> None:
        """Draw the outline of a rectangle."""
        drawn = self._rectangle(corner_mm, size_mm)
        self.drawn.append(f"{_said(colour)} RG {width_mm * POINTS_PER_MM:.3f} w 0 J {drawn} S")

    def line(self, points_mm: np.ndarray, colour: Colour = BLACK, width_mm: float = 0.3) -> None:
        """Draw a line through points [N, 2]."""
        steps = " ".join(f"{self._at(point)} {'l' if k else 'm'}" for k, point in enumerate(points_mm))
        self.drawn.append(f"{_said(colour)} RG {width_mm * POINTS_PER_MM:.3f} w 1 J {steps} S")

    def dots(self, points_mm: np.ndarray, diameter_mm: float, colour: Colour = BLACK) -> None:
        """Draw dots at points [N, 2]: a line of no length with round ends."""
        for point in points_mm:
            self.line(np.array([point, point]), colour, diameter_mm)

    def words(
        self, at_mm: Place, text: str, size_pt: float = 10.0, *, font: str = "plain", colour: Colour = BLACK
    ) -> None:
        """Write one line of words, its left end on the base line at a place."""
        plain = self.tell(text).encode("cp1252", "replace").decode("cp1252")
        for mark in "\\()":
            plain = plain.replace(mark, f"\\{mark}")
        self.drawn.append(f"{_said(colour)} rg BT /{font} {size_pt:g} Tf {self._at(at_mm)} Td ({plain}) Tj ET")

    def paragraph(
        self, at_mm: Place, text: str, size_pt: float = 10.0, *, letters: int = 96, font: str = "plain"
    ) -> float:
        """Write words in lines of at most so many letters; return where the next line would be [mm]."""
        x, y = at_mm
        for row in textwrap.wrap(self.tell(text).replace(" %", "\xa0%"), letters):
            self.words((x, y), row, size_pt, font=font)
            y += 1.3 * size_pt / POINTS_PER_MM
        return y

    def bytes(self) -> bytes:
        """Return the page as a file."""
        stream = "\n".join(self.drawn).encode("cp1252")
        width, height = (side * POINTS_PER_MM for side in self.size_mm)
        fonts = " ".join(
            f"/{name} << /Type /Font /Subtype /Type1 /BaseFont /{family} /Encoding /WinAnsiEncoding >>"
            for name, family in FONTS.items()
        )
        objects = [
            b"<< /Type /Catalog /Pages 2 0 R >>",
            b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
            f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {width:.3f} {height:.3f}] /Contents 4 0 R "
            f"/Resources << /Font << {fonts} >> >> >>".encode(),
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

    def _at(self, place_mm: Place) -> str:
        return f"{place_mm[0] * POINTS_PER_MM:.4f} {(self.size_mm[1] - place_mm[1]) * POINTS_PER_MM:.4f}"

    def _rectangle(self, corner_mm: Place, size_mm: Place) -> str:
        low = self._at((corner_mm[0], corner_mm[1] + size_mm[1]))
        return f"{low} {size_mm[0] * POINTS_PER_MM:.4f} {size_mm[1] * POINTS_PER_MM:.4f} re"


def _said(colour: Colour) -> str:
    return " ".join(f"{part:.3g}" for part in colour)
