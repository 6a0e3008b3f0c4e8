"""Make a data set for the published evaluation from real bodies."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from printmend.errors import InputError, PrintmendError
from printmend.printer import read_printer
from printmend_lab.body import load_body
from printmend_lab.dataset.bodies import body_rng, digest, thinned
from printmend_lab.dataset.reference import MAX_CORRUPTIONS, write_reference
from printmend_lab.path import Body
from printmend_lab.sampling import Severity, sample


@dataclass(frozen=True)
class Exported:
    """What was written: the number of bodies, and the files left out with their reasons."""

    bodies: int
    refused: tuple[tuple[str, str], ...]


# Long because bodies are read while they are written: the inner generator shares the names and refusals so far.
def export_reference(
    root: Path,
    files: list[Path],
    *,
    corruptions: int,
    seed: int,
    layers: int | None = None,
    severity: Severity = "damaged",
    tick: Callable[[str], None] = lambda name: None,
) -> Exported:
    """Write the bodies in ``files``, each with two of ``corruptions`` random gain tables, in the published layout.

    ``layers`` keeps that many evenly spaced layers of a body. With 3 the published evaluation draws all of them, and
    its result no longer depends on its random draw. Files that cannot become bodies are left out and named in the
    result. If none can, the first one's error is raised; `InputError` if ``root`` already holds something.
    """
    root = Path(root)
    if root.exists() and (not root.is_dir() or any(root.iterdir())):
        raise InputError(root, wanted="a new or empty folder", came="one that holds something", todo="name another")
    if not 1 <= corruptions <= MAX_CORRUPTIONS:
        raise InputError(
            "--corruptions",
            wanted=f"1 to {MAX_CORRUPTIONS}",
            came=f"{corruptions}",
            todo="the published code reads no more",
        )
    rng = np.random.default_rng(seed)
    drives = [drive for _ in range((corruptions + 1) // 2) for drive in sample("gain-table", rng, severity).drives]
    gains = np.array([drive.gain_table.gains for drive in drives[:corruptions] if drive.gain_table is not None])
    printer = read_printer("ender5")
    refused: list[tuple[str, str]] = []
    names: set[str] = set()
    first_error: list[PrintmendError] = []

    def bodies() -> Iterator[tuple[Body, tuple[int, int]]]:
        for path in files:
            try:
                body = load_body(path, printer)
            except PrintmendError as error:
                first_error.append(error)
                refused.append((str(path), str(error)))
                continue
            finally:
                tick(path.name)
            identity = digest(path)
            name = path.stem if path.stem not in names else f"{path.stem}-{identity}"
            names.add(name)
            x, y = body_rng(seed, identity, 0).integers(1, corruptions + 1, 2)
            yield Body(name, thinned(body, layers).layers), (int(x), int(y))

    # Nothing is written before one body is known to be good.
    stream = bodies()
    first = next(stream, None)
    if first is None:
        raise first_error[0]

    def all_bodies() -> Iterator[tuple[Body, tuple[int, int]]]:
        yield first
        yield from stream

    return Exported(write_reference(root, all_bodies(), gains), tuple(refused))
