"""A printer's report as one page in HTML."""

from pathlib import Path

from printmend.files import replacing
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
from printmend.report.page import page, picture, say, strip, table
from printmend.report.part import part_rows
from printmend.report.pictures import circle_picture, layers_picture, pictures


def write(path: Path, examination: Examination) -> None:
    """Write the page; it appears when it is whole."""
    with replacing(path) as file:
        file.write(page(examination.title, _body(examination)))


def _body(examination: Examination) -> str:
    faults = "".join(f'<div class="fault repair"><p>{say(one)}</p></div>' for one in examination.refused)
    faults += "".join(
        f'<div class="fault {one.urgency}"><h3>{say(one.title)} <span class="tag">{URGENCY[one.urgency]}</span></h3>'
        f"<p>{say(one.meaning)}</p><dl><dt>To do</dt><dd>{say(one.repair)}</dd>"
        f"<dt>The software</dt><dd>{say(one.software)}</dd>"
        f"<dt>How sure</dt><dd>{say(one.sure)}</dd></dl></div>"
        for one in examination.advice
    )
    faults += "".join(f'<div class="fault soon"><p>{say(one)}</p></div>' for one in examination.doubted)
    part = ""
    if examination.prediction is not None:
        part = f"<h2>Your part: {say(examination.part or '')}</h2>{table(part_rows(examination.prediction))}"
        if len(examination.prediction.layers) > 1:
            part += picture(layers_picture(examination.prediction.layers, examination.part or ""))
        part += "".join(f"<p>Before you print: {say(each)}</p>" for each in examination.prediction.advice)
    gaps = ""
    if closing(examination):
        listed = "".join(f"<li>{say(gap)}</li>" for gap in closing(examination))
        gaps = f"<h2>What this print could not tell</h2><ul>{listed}</ul>"
    drawn = "".join(picture(group) for group in pictures(examination))
    metrology = "<h2>For metrologists</h2>"
    if is_healthy(examination.saved):
        metrology += f"<p>{say(NOTHING_KNOWN)}</p>"
    else:
        metrology += (
            f"{picture(circle_picture(examination.circle))}<p>{say(STANDARD_SAID)}</p>"
            f"{table(standard_rows(examination), words=True)}"
        )
    if examination.expected is not None:
        metrology += f"<p>{say(budget.SAID)}</p>{table(budget.budget_rows(examination.expected))}"
    small = "".join(f"<p><small>{say(fact)}</small></p>" for fact in facts(examination))
    return (
        f'<p class="big">{say(examination.headline)}</p>{strip(numbers(examination))}'
        f"<h2>{'Nothing to do' if examination.is_healthy else 'What to do'}</h2>{faults}{part}{gaps}"
        f"<h2>How it looks</h2>{drawn}{metrology}<h2>Small print</h2>{small}"
    )
