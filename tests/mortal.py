"""Work that kills its worker; a module of its own, so that the workers of the test start quickly."""

import os
import signal
from pathlib import Path

from printmend_lab.bench.case import Case, Result


def dies_on_two(item: int) -> int:
    if item == 2:
        os._exit(1)
    return item * int(os.environ["OMP_NUM_THREADS"])


def dies_once(place: str) -> str:
    """Write that it ran; kill the worker where a file asks for it, which is then gone."""
    asked = Path(place).with_suffix(".die")
    if asked.exists():
        asked.unlink()
        os._exit(1)
    with Path(place).open("a") as file:
        file.write("ran\n")
    return place


def judged_once(case: Case, rows: tuple[str, ...]) -> list[Result]:
    """Judge a case for a bench; the worker dies at the first where `dies_once` says so."""
    dies_once(case.source)
    return [Result(case, row) for row in rows]


def heed_ctrl_c() -> None:
    """Let a program that is about to start heed Ctrl-C, also where the tests themselves run in the background."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
