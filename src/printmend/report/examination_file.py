"""Write an examination as a file: one self-contained HTML page, or a PDF with two to four pages in A4."""

from collections.abc import Iterator
from pathlib import Path

import printmend
from printmend.diagnosis.advice import URGENCY
from printmend.draw.document import Block, Card, Items, Numbers, Strip, Words
from printmend.files import replacing
from printmend.mend.mend import is_healthy
from printmend.messages import ENGLISH, Tell, say, tell_in
from printmend.report.examination import (
    Examination,
    check_name,
    closing,
    facts,
    numbers,
    standard_rows,
)
from printmend.report.part import budget_rows, part_rows
from printmend.report.pictures import circle_picture, layers_picture, pictures

_COLOURS = {"repair": "#c2410c", "soon": "#a16207", "left": "#57534e", "software": "#15803d"}


def write_examination(path: Path, examination: Examination, *, language: str = ENGLISH) -> None:
    """Write the report in a language; the suffix of ``path`` chooses the format."""
    check_name(path)
    tell = tell_in(language)
    blocks = [Words("title", examination.title), *_blocks(examination, tell)]
    if path.suffix.lower() == ".pdf":
        from printmend.draw.document import write_pdf  # reportlab is slow to import, and an HTML page does not need it

        saved = examination.saved
        model = tell(say("model-digest", saved.digest))
        foot = f"{saved.printer.name}, {model}, printmend {printmend.__version__}"
        write_pdf(path, examination.title, blocks, foot=foot, tell=tell)
        return
    from printmend.report.page import page

    with replacing(path) as file:
        file.write(page(examination.title, blocks, tell=tell, language=language))


def _blocks(examination: Examination, tell: Tell) -> Iterator[Block]:
    yield Words("lead", examination.headline)
    yield Strip(numbers(examination))
    yield Words("heading", say("report-nothing-to-do" if examination.is_healthy else "report-to-do"))
    for one in examination.refused:
        yield Card(say("card-measure-again"), "", _COLOURS["repair"], (("", one),))
    for advice in examination.advice:
        lines = (
            ("", advice.meaning), (say("card-to-do"), advice.repair), (say("card-software"), advice.software),
            (say("card-how-sure"), advice.sure),
        )  # fmt: skip
        yield Card(advice.title, URGENCY[advice.urgency], _COLOURS[advice.urgency], lines)
    for one in examination.doubted:
        yield Card(say("card-still-open"), "", _COLOURS["soon"], (("", one),))
    if (prediction := examination.prediction) is not None:
        yield Words("heading", say("report-your-part", examination.part or ""))
        yield Numbers("", part_rows(prediction))
        if len(prediction.layers) > 1:
            yield layers_picture(prediction.layers, examination.part or "", tell)
        if prediction.advice:
            yield Words("text", say("report-before-printing"))
            yield Items(prediction.advice)
    if gaps := closing(examination):
        yield Words("heading", say("report-not-shown"))
        yield Items(gaps)
    yield Words("heading", say("report-pictures"))
    yield from pictures(examination, tell)
    yield from _metrology(examination, tell)
    yield Words("heading", say("report-about"))
    yield from (Words("small", fact) for fact in facts(examination))


def _metrology(examination: Examination, tell: Tell) -> Iterator[Block]:
    yield Words("heading", say("report-metrology"))
    if is_healthy(examination.saved):
        yield Words("text", say("standard-nothing-known"))
    else:
        yield circle_picture(examination.circle, tell)
        yield Numbers(say("standard-said"), standard_rows(examination), words=2)
    if examination.expected is not None:
        of = examination.part or say("budget-measured-print")
        yield Numbers(say("budget-said", of), budget_rows(examination.expected))
