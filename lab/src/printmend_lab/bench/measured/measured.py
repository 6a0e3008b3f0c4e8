"""`printmend bench measured`: every learner on data that nobody here simulated.

A figure is the root mean square of what a learner did not foresee of the judged tracks, as a share of what the straight
line from input to output leaves (`naive`): 1 is no use, 0 is perfect.
"""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from printmend.errors import InputError
from printmend.learn.registry import ORACLE, check_model_name, fit
from printmend.path import Trace
from printmend.protocols import WorldModel
from printmend_lab.bench.case import Case, Result
from printmend_lab.bench.measured.axis import Bench, bench_of
from printmend_lab.bench.measured.sources import SOURCES, Source, source
from printmend_lab.bench.measured.tracks import MeasuredSet
from printmend_lab.bench.report import grouped
from printmend_lab.bench.run import run
from printmend_lab.executor import HERE, Executor

TABLE, NAIVE = "measured", "naive"
_PARTS, _OFF_ROUND = 1e6, 0.3717  # of a span, in a digest; away from round numbers, which fall on either side
ROWS = (
    NAIVE, "affine", "backlash", "bilateral", "prandtl-ishlinskii", "bouc-wen", "gaussian-process",
    "printmend_lab.peers.narx:NARX", "printmend_lab.peers.network:TCN", "printmend_lab.peers.network:ENSEMBLE",
    "linear-axis", "knn-axis", "lightgbm-axis", "forest-axis", "printmend", "greybox", "prior", "hybrid", "meta",
)  # fmt: skip


@dataclass(frozen=True)
class MeasuredRow:
    """A learner, by name."""

    name: str

    @property
    def lesson(self) -> str:
        return self.name


def read_row(name: str) -> MeasuredRow:
    """Return the row of that name. Raise `ConfigError` for a learner that does not exist, or that needs the truth."""
    if name == ORACLE:
        raise InputError("--models", wanted="learners", came=ORACLE, todo="leave it out: nobody knows the truth here")
    check_model_name(name)
    return MeasuredRow(name)


@dataclass(frozen=True, eq=False)
class MeasuredStand:
    """A set laid along an axis."""

    item: MeasuredSet
    bench: Bench

    def measure(self, row: MeasuredRow) -> Trace:
        return self.bench.trace(self.item.learned)

    def fit(self, measured: Trace, row: MeasuredRow) -> WorldModel:
        return fit(row.name, measured, self.bench.printer, rng=np.random.default_rng(0))

    def judge(self, model: WorldModel, row: MeasuredRow) -> dict[str, Any]:
        missed = self.bench.missed(model, self.item.judged, self.item.free)
        plain = self.bench.missed(fit(NAIVE, self.bench.trace(self.item.learned), self.bench.printer,
                                      rng=np.random.default_rng(0)), self.item.judged, self.item.free)  # fmt: skip
        rms = [float(np.sqrt((values**2).mean())) for values in (missed, plain)]
        learned = sum(int(np.isfinite(track.measured).sum()) for track in self.item.learned)
        units, line = (value / abs(self.bench.output_scale) for value in rms)
        share = {"missed": units, "line": line, "share": rms[0] / rms[1]}
        return {**share, "learned": learned, "judged": len(missed)}


def set_up(case: Case) -> MeasuredStand:
    """Read the case's set."""
    (item,) = (one for one in source(case.family).read(Path(case.source)) if one.name == case.body)
    return MeasuredStand(item, bench_of(item))


def measured_cases(folder: Path, names: Sequence[str] = ()) -> tuple[list[Case], list[Source]]:
    """Return a case for every set that lies below ``folder``, and the sources that do not.

    ``names`` chooses among the sources. Raise `InputError` for a name that does not exist.
    """
    known = [item.name for item in SOURCES]
    if wrong := [name for name in names if name not in known]:
        raise InputError("--sets", wanted=f"names out of {', '.join(known)}", came=repr(wrong[0]), todo="correct it")
    cases, absent = [], []
    for item in SOURCES:
        if names and item.name not in names:
            continue
        path = folder / item.place
        if not path.exists():
            absent.append(item)
            continue
        place = str(path.absolute())
        cases += [
            Case(TABLE, one.name, content_digest(one), item.name, "", item.split, 0, "", source=place)
            for one in item.read(path)
        ]
    return cases, absent


def content_digest(item: MeasuredSet) -> str:
    """Return a SHA-256 of what is learned from and judged, to a millionth of each signal's span: the same on every
    machine, and for every form that the data come in."""
    total = hashlib.sha256(f"{item.name} {item.free} {item.mm_per_unit} {item.joined}".encode())
    for track in (*item.learned, *item.judged):
        for values in (track.commanded, track.measured):
            low, high = np.nanmin(values), np.nanmax(values)
            parts = np.nan_to_num((values - low) / ((high - low) or 1.0), nan=-1.0)
            total.update(np.floor(parts * _PARTS + _OFF_ROUND).astype(np.int64).tobytes())
    return total.hexdigest()


def measured_table(
    cases: Sequence[Case],
    rows: Sequence[str],
    out: Path,
    *,
    executor: Executor = HERE,
    tick: Callable[[str], None] = lambda name: None,
) -> list[Result]:
    """Judge every row on every set; keep results in ``out``/measured.jsonl."""
    for row in rows:
        read_row(row)
    return run(cases, list(dict.fromkeys(rows)), out, executor, tick=tick)


def measured_lines(results: Sequence[Result]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return the header and a line for each learner: its share on each set, their geometric mean, and seconds a set."""
    sets = list(dict.fromkeys(item.case.body for item in results))
    header = ("learner", *sets, "all", "seconds")
    lines = []
    for name, items in grouped(results, lambda item: item.row).items():
        shares = {item.case.body: item.value("share") for item in items}
        cells = ["–" if (share := shares.get(body)) is None else f"{share:.3f}" for body in sets]
        good = [share for share in shares.values() if share is not None]
        mean = f"{np.exp(np.mean(np.log(good))):.3f}" if len(good) == len(sets) else "–"
        seconds = [value for item in items if (value := item.value("learn_s")) is not None]
        lines.append((name.rpartition(":")[2], *cells, mean, f"{np.mean(seconds):.1f}" if seconds else "–"))
    return header, lines
