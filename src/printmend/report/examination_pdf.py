"""A printer's report as a PDF of two to four pages in A4."""

from pathlib import Path

import printmend
from printmend.draw.document import Block, Card, Numbers, Pictures, Strip, Words, write_pdf
from printmend.mend.mend import is_healthy
from printmend.report import budget
from printmend.report.examination import (
    NOTHING_KNOWN,
    STANDARD_SAID,
    URGENCY,
    Examination,
    closing,
    facts,
    numbers,
    standard_rows,
)
from printmend.report.part import part_rows
from printmend.report.pictures import Group, circle_picture, layers_picture, pictures

_COLOURS = {"repair": "#c2410c", "soon": "#a16207", "software": "#15803d"}


def write(path: Path, examination: Examination) -> None:
    """Write the document; it appears when it is whole."""
    foot = f"{examination.saved.printer.name}, model {examination.saved.digest}, printmend {printmend.__version__}"
    write_pdf(path, examination.title, _blocks(examination), foot=foot)


def _blocks(examination: Examination) -> list[Block]:
    found: list[Block] = [
        Words("title", examination.title), Words("text", examination.headline), Strip(numbers(examination)),
    ]  # fmt: skip
    found += [Card("Measure again", "", _COLOURS["repair"], (("", one),)) for one in examination.refused]
    for one in examination.advice:
        lines = (("", one.meaning), ("To do", one.repair), ("The software", one.software), ("How sure", one.sure))
        found.append(Card(one.title, URGENCY[one.urgency].lower(), _COLOURS[one.urgency], lines))
    found += [Card("What does not fit", "", _COLOURS["soon"], (("", one),)) for one in examination.doubted]
    if (prediction := examination.prediction) is not None:
        found += [Words("heading", f"Your part: {examination.part}"), Numbers("", part_rows(prediction))]
        if len(prediction.layers) > 1:
            found.append(_drawn(layers_picture(prediction.layers, examination.part or "")))
        found += [Words("text", f"Before you print: {each}") for each in prediction.advice]
    if gaps := closing(examination):
        found += [Words("heading", "What this print could not tell"), *(Words("text", gap) for gap in gaps)]
    found.append(Words("heading", "How it looks"))
    found += [_drawn(group) for group in pictures(examination)]
    found.append(Words("heading", "For metrologists"))
    if is_healthy(examination.saved):
        found.append(Words("text", NOTHING_KNOWN))
    else:
        found += [
            _drawn(circle_picture(examination.circle)),
            Numbers(STANDARD_SAID, standard_rows(examination), words=2),
        ]
    if examination.expected is not None:
        found.append(Numbers(budget.SAID, budget.budget_rows(examination.expected)))
    return found + [Words("small", fact) for fact in facts(examination)]


def _drawn(group: Group) -> Block:
    return Pictures(group.figures, group.caption)
