"""An examination as a file: a page in HTML or a PDF."""

from pathlib import Path

from printmend.report import examination_page
from printmend.report.examination import Examination, check_name


def write_examination(path: Path, examination: Examination) -> None:
    """Write the report as one self-contained HTML page or as a PDF, as the name of ``path`` asks."""
    check_name(path)
    if path.suffix.lower() != ".pdf":
        examination_page.write(path, examination)
        return
    from printmend.report import examination_pdf  # reportlab is heavy, and a page needs none of it

    examination_pdf.write(path, examination)
