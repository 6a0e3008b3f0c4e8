"""The layout that the paper's published evaluation reads (physics.md §8.1): read, and made from real bodies.

    DIR/dataset/BODY.csv                    one body: one row a transition, no header, commas
    DIR/simulation/add_dudw_data.mat        MATLAB variable all_data [corruptions, 1100]

`DIR` stands for the published code's folder ``data``. Entry p − 1 of a row of all_data is the gain of a step at nominal
position p. Corruption ids, layer ids and row numbers count from 1; integers are written as integers, printed positions
with all their digits, so that reading back is exact.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np

from printmend.errors import InputError, PrintmendError, TraceError
from printmend.files import replacing
from printmend.machine import GainMechanism
from printmend.path import frozen
from printmend.printer import Printer, read_printer
from printmend.twin import Twin
from printmend_lab.body import load_body
from printmend_lab.dataset.bodies import body_rng, digest, thinned
from printmend_lab.path import Body, Layer
from printmend_lab.sampling import Severity, sample

COLUMNS = (
    "index", "corr_x id", "corr_y id", "layer id",
    "x nominal", "x printed", "cx", "x nominal next", "x printed next",
    "y nominal", "y printed", "cy", "y nominal next", "y printed next",
)  # fmt: skip
POSITIONS = 1100  # full steps of the published gain tables
MAX_CORRUPTIONS = 5000  # the published simulator reads no further
_WHOLE = [0, 1, 2, 3, 4, 6, 7, 9, 11, 12]
_TODO = "export it again, or fetch the published data set afresh"


@dataclass(frozen=True, eq=False)
class ReferenceBody:
    """A body of the data set: its layers, its corruption's ids (x, y), and ``printed_steps`` [T + 1, 2] a layer."""

    body: Body
    corruption_ids: tuple[int, int]
    printed_steps: tuple[np.ndarray, ...]


@dataclass(frozen=True, eq=False)
class Reference:
    """An opened data set. Bodies are read on demand, because the published set has gigabytes."""

    root: Path
    gains: np.ndarray

    @property
    def printer(self) -> Printer:
        """The one machine of the published data: an Ender-5 with the lattice {0…1100}²."""
        return read_printer("ender5")

    @property
    def names(self) -> tuple[str, ...]:
        """The bodies' names, sorted."""
        return tuple(sorted(path.stem for path in (self.root / "dataset").glob("*.csv")))

    def path(self, name: str) -> Path:
        return self.root / "dataset" / f"{name}.csv"

    def body(self, name: str) -> ReferenceBody:
        """Read one body. Raise `TraceError` where a column, a number or an id is wrong."""
        return _body(name, _table(self.path(name)), self.path(name), len(self.gains))

    def mechanism(self, corruption_ids: tuple[int, int]) -> GainMechanism:
        """Return the published simulator with the corruptions of these ids."""
        x, y = (self.gains[i - 1] for i in corruption_ids)
        return GainMechanism(self.printer, (x, y))


def read_reference(root: Path) -> Reference:
    """Open an exported or published data set. Raise `TraceError` where the folder or its matrix is not one."""
    root = Path(root)
    matrix = root / "simulation" / "add_dudw_data.mat"
    if not (root / "dataset").is_dir() or not matrix.is_file():
        missing = "dataset/" if not (root / "dataset").is_dir() else "simulation/add_dudw_data.mat"
        came = f"a folder without {missing}" if root.is_dir() else "no such folder"
        raise TraceError(root, wanted="dataset/*.csv and simulation/add_dudw_data.mat", came=came, todo=_TODO)
    reference = Reference(root, frozen(_gains(matrix)))
    if not reference.names:
        raise TraceError(root / "dataset", wanted="at least one CSV", came="none", todo=_TODO)
    return reference


def write_reference(root: Path, bodies: Iterable[tuple[Body, tuple[int, int]]], gains: np.ndarray) -> int:
    """Write bodies, each with its corruption's ids (x, y), and the gains [K, 1100]; return the number of bodies.

    Each layer is printed on its own from its nominal start, by the published simulator's rule.
    """
    from scipy.io import savemat

    gains = np.asarray(gains, float)
    if gains.ndim != 2 or gains.shape[1] != POSITIONS or not 1 <= len(gains) <= MAX_CORRUPTIONS:
        raise TraceError(
            "gains",
            wanted=f"[1…{MAX_CORRUPTIONS}, {POSITIONS}]",
            came=f"{gains.shape}",
            todo="ask for fewer corruptions: the published simulator reads the first 5000",
        )
    root = Path(root)
    reference = Reference(root, gains)
    for folder in ("dataset", "simulation"):
        (root / folder).mkdir(parents=True, exist_ok=True)
    written = 0
    for body, ids in bodies:
        twin = Twin(reference.mechanism(ids))
        printed = [twin.run(layer.controls, layer.start_steps) for layer in body.layers]
        with replacing(reference.path(body.name)) as file:
            file.writelines(_rows(ReferenceBody(body, ids, tuple(printed))))
        written += 1
    with replacing(root / "simulation" / "add_dudw_data.mat", "wb") as file:
        matrix = BytesIO()  # savemat takes no wrapped file
        savemat(matrix, {"all_data": gains})
        file.write(matrix.getvalue())
    return written


def _rows(item: ReferenceBody) -> Iterable[str]:
    row = 0
    for layer, printed in zip(item.body.layers, item.printed_steps, strict=True):
        nominal = layer.nominal_steps.tolist()
        controls, points = layer.controls.tolist(), printed.tolist()
        for t, control in enumerate(controls):
            row += 1
            cells = [row, *item.corruption_ids, layer.index + 1]
            for axis in (0, 1):
                cells += [nominal[t][axis], points[t][axis], control[axis], nominal[t + 1][axis], points[t + 1][axis]]
            yield ",".join(map(repr, cells)) + "\n"


def _gains(path: Path) -> np.ndarray:
    from scipy.io import loadmat

    try:
        variables = loadmat(path)
    except Exception as error:  # scipy documents no set of errors for a damaged file
        raise TraceError(path, wanted="a MATLAB 5 file", came=f"{error}", todo=_TODO) from None
    gains = variables.get("all_data")
    if gains is None:
        names = ", ".join(sorted(name for name in variables if not name.startswith("__"))) or "nothing"
        raise TraceError(path, wanted="the variable all_data", came=names, todo=_TODO)
    if gains.ndim != 2 or gains.shape[1] != POSITIONS or gains.dtype.kind not in "fiu":
        raise TraceError(path, wanted=f"all_data as numbers [K, {POSITIONS}]", came=f"{gains.shape}", todo=_TODO)
    if not np.isfinite(gains).all():
        raise TraceError(path, wanted="finite gains", came="NaN or infinity", todo=_TODO)
    return np.asarray(gains[:MAX_CORRUPTIONS], float)


def _table(path: Path) -> np.ndarray:
    """Read the 14 columns [rows, 14] of a body. Raise `TraceError` naming the first thing that is wrong."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise TraceError(path, wanted="a CSV of transitions", came=f"{error}", todo=_TODO) from None
    lines = text.splitlines()
    if not lines:
        raise TraceError(path, wanted="at least one transition", came="an empty file", todo=_TODO)
    width = lines[0].count(",") + 1
    if width != len(COLUMNS):
        came = f"{width} columns in row 1"
        if width < len(COLUMNS):
            came += f", {COLUMNS[width]!r} being the first that is missing if the others are in order"
        raise TraceError(path, wanted=f"{len(COLUMNS)} columns without a header", came=came, todo=_TODO)
    try:
        table = np.loadtxt(lines, delimiter=",", ndmin=2, comments=None)
    except ValueError as error:
        raise TraceError(
            path, wanted=f"{len(COLUMNS)} numbers a row and no header", came=str(error).split(";")[0], todo=_TODO
        ) from None
    bad = np.argwhere(~np.isfinite(table))
    if len(bad):
        row, column = bad[0]
        raise TraceError(
            path,
            wanted="finite numbers",
            came=f"{table[row, column]} in row {row + 1}, column {COLUMNS[column]!r}",
            todo=_TODO,
        )
    return table


def _body(name: str, table: np.ndarray, path: Path, corruptions: int) -> ReferenceBody:
    for column in _WHOLE:
        _check(table[:, column] == np.rint(table[:, column]), table, column, path, "a whole number")
    for column in (1, 2):
        good = (table[:, column] >= 1) & (table[:, column] <= corruptions)
        _check(good, table, column, path, f"an id of 1…{corruptions}, the rows of all_data")
        _check(
            table[:, column] == table[0, column], table, column, path, f"one corruption a body ({table[0, column]:.0f})"
        )
    _check(table[:, 3] >= 1, table, 3, path, "an id from 1")
    for first in (4, 9):
        for column in (first, first + 3):
            good = (table[:, column] >= 0) & (table[:, column] <= POSITIONS)
            _check(good, table, column, path, f"a position of 0…{POSITIONS}")
        _check(np.abs(table[:, first + 2]) <= 1, table, first + 2, path, "a control of −1, 0 or 1")
        moved = table[:, first] + table[:, first + 2] == table[:, first + 3]
        _check(moved, table, first + 3, path, "nominal plus control")
    layers, printed = [], []
    for layer_id in np.unique(table[:, 3]):
        at = np.flatnonzero(table[:, 3] == layer_id)
        rows = table[at]
        for column, following in ((4, 7), (9, 12), (5, 8), (10, 13)):
            joined = np.ones(len(table), bool)
            joined[at[1:]] = np.abs(rows[1:, column] - rows[:-1, following]) < 1e-6
            _check(joined, table, column, path, "where the row before it ended")
        layers.append(
            Layer(int(layer_id) - 1, float("nan"), rows[0, [4, 9]], rows[:, [6, 11]], np.ones(len(rows), bool))
        )
        printed.append(frozen(np.vstack([rows[:, [5, 10]], rows[-1:, [8, 13]]])))
    return ReferenceBody(Body(name, tuple(layers)), (int(table[0, 1]), int(table[0, 2])), tuple(printed))


def _check(good: np.ndarray, table: np.ndarray, column: int, path: Path, wanted: str) -> None:
    if not good.all():
        row = int(np.argmin(good))
        raise TraceError(
            path, wanted=f"{wanted} in {COLUMNS[column]!r}", came=f"{table[row, column]:g} in row {row + 1}", todo=_TODO
        )


# Make a data set for the published evaluation from real bodies.


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
