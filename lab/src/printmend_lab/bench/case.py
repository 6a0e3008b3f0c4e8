"""What every table is made of: a case, and a row's result on it."""

import hashlib
import json
import re
import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from printmend.path import Trace
from printmend.plugins import CONTROLLERS, CORRUPTIONS, LEARNERS, imported, is_plugin, place_of
from printmend_lab.dataset.bodies import body_rng

PRINTER = "ender5"
RULES = 4  # part of every key: raise it when the way a case is evaluated changes
# Where a case's files lie and what they are called: they may be moved, so this is no part of what a case is.
_PLACES = ("body", "source", "reference", "sliced")


@dataclass(frozen=True)
class Case:
    """What is broken, what is printed and what of it is learned from and judged, drawn from a seed.

    ``table`` names the table that asks (`trial.TABLES`), ``body`` is what a reader calls the body and ``identity``
    what decides it: the digest of a file's content; nothing where the body is drawn from the seed, ``coverage`` turns
    of a motor across. ``family`` and ``severity`` say what is broken; the fault itself follows from the seed and from
    the identity or the ``sample``. ``protocol`` says which layers are learned from and judged, at most ``layers`` of
    them. ``source`` is the body's file, ``reference`` the folder of a data set in the published layout that holds it,
    ``sliced`` a folder that keeps the G-code of meshes, so that each is sliced once.
    """

    table: str
    body: str = field(compare=False)
    identity: str
    family: str
    severity: str
    protocol: str
    seed: int
    printer: str = PRINTER
    coverage: float | None = None
    sample: int = 0
    layers: int = 3
    source: str = field(default="", compare=False)
    reference: str | None = field(default=None, compare=False)
    sliced: str | None = field(default=None, compare=False)

    def key(self, row: str) -> str:
        """Return the key of this case's result for a row: 16 hex digits over everything that decides it."""
        content = {name: value for name, value in asdict(self).items() if name not in _PLACES}
        names = (*re.split("[+@]", row), *self.family.split("+"))
        if code := code_digest(
            (LEARNERS, CONTROLLERS, CORRUPTIONS), names, ours="printmend_lab"
        ):  # of what is not ours
            content["code"] = code
        text = json.dumps({**content, "row": row, "rules": RULES}, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def rng(self, purpose: int, *more: object) -> np.random.Generator:
        """Return a generator for one purpose: what else is drawn, and for which other cases, does not change it."""
        if self.identity:
            return body_rng(self.seed, self.identity, purpose)
        words = json.dumps([self.seed, self.sample, purpose, *more])
        return np.random.default_rng(int.from_bytes(hashlib.sha256(words.encode()).digest()[:8], "big"))

    def noisy(self, trace: Trace, purpose: int, noise_mm: float) -> np.ndarray:
        """Return a trace's measured positions [N, 2] with normal noise of ``noise_mm`` a coordinate."""
        noise = self.rng(purpose, noise_mm).normal(0.0, 1.0, trace.measured_mm.shape)
        return np.asarray(trace.measured_mm + noise * noise_mm)

    def __str__(self) -> str:
        """What a progress bar shows."""
        what = self.body if self.coverage is None else f"{self.coverage:g} #{self.sample}"
        return " ".join(word for word in (self.family, self.severity, self.printer, what) if word)


_CASE = tuple(item.name for item in fields(Case))


@dataclass(frozen=True)
class Result:
    """A row's result on a case: its ``values``, or why it failed; ``code`` is the version that made it.

    ``kept`` is the key under which a results file has it: of the rules and the plug-in of that time, not of now.
    """

    case: Case
    row: str
    values: Mapping[str, Any] = field(default_factory=dict)
    error: str | None = None
    code: str = ""
    kept: str = ""

    @property
    def key(self) -> str:
        return self.kept or self.case.key(self.row)

    def value(self, name: str) -> float | None:
        """Return one of the numbers, None where it is not there."""
        return self.values.get(name)

    def flat(self) -> dict[str, Any]:
        """Return everything as one record, as it stands in a results file."""
        head = {"key": self.key, "code": self.code, **asdict(self.case), "row": self.row}
        return {**head, **self.values, "error": self.error}

    @classmethod
    def of(cls, record: dict[str, Any]) -> "Result":
        """Read what `flat` wrote. Raise TypeError or KeyError for a record that is something else."""
        rest = dict(record)
        kept = rest.pop("key")
        case = Case(**{name: rest.pop(name) for name in _CASE})
        row, error, code = rest.pop("row"), rest.pop("error"), rest.pop("code")
        return cls(case, row, rest, error, code, kept)


def code_digest(groups: tuple[str, ...], names: tuple[str, ...], *, ours: str) -> str | None:
    """Return a digest of the code behind the plug-ins among ``names``, None where there are none.

    Results that are kept are those of this code. It is all of a plug-in's package, or its module where it is in none.
    The package ``ours`` counts as none: its results say its version.
    """
    digest, found = hashlib.sha256(), False
    for name in names:
        for group in groups:
            if not is_plugin(group, name):
                continue
            place = place_of(group, name)
            if place.startswith(f"{ours}."):
                break
            module = imported(place.partition(":")[0], name)
            top = sys.modules[module.__name__.partition(".")[0]]
            folders = [Path(folder) for folder in getattr(top, "__path__", ())]
            files = sorted(file for folder in folders for file in folder.rglob("*.py")) or [Path(str(module.__file__))]
            for file in files:
                digest.update(file.read_bytes())
            found = True
            break
    return digest.hexdigest()[:16] if found else None
