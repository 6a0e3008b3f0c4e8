"""Is this measurement of this printer? A table, or a test print's plan, that says whose it is, held against a printer.

Two of the printers that come with the program are two printers, and so are two that their owner named. One that was
measured as a known model and has a name of its own by now may be the same, if it is built the same way.
"""

from pathlib import Path

from printmend.errors import TraceError
from printmend.messages import say
from printmend.path import Origin
from printmend.printer import Printer, preset_names, read_printer
from printmend.printer.known import bare_name


def check_origin(subject: str | Path, origin: Origin | None, printer: Printer) -> None:
    """Raise `TraceError` where a measurement says that it is of another printer; ``subject`` names it."""
    if origin is None or bare_name(origin.printer) == bare_name(printer.name):
        return
    known = {bare_name(read_printer(name).name) for name in preset_names()}
    is_other = origin.kinematics not in ("", printer.kinematics)
    if not is_other and (bare_name(origin.printer) in known) != (bare_name(printer.name) in known):
        return
    raise TraceError(
        subject, wanted=say("measurement", printer.name), came=say("one", origin.printer),
        todo=say("take-printer-if-one-under-another"),
    )  # fmt: skip
