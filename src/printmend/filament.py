"""Filaments: how much parts shrink in them, and what of a print's scale is the machine's.

Along each axis a print in the filament k shows the scale T = M − f_k, a print that cannot shrink (dots that stick to
plate or paper) and a rule along the machine's travel show M. All are linear, and M has a prior of several widths:
the posterior is a mixture of Gaussians, in closed form.
"""

import re
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from printmend.errors import ConfigError
from printmend.messages import say

UNNAMED = "unnamed"  # the filament of a part whose owner named none: any of the polymers
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9+._-]{0,39}")
# Other names of the polymers of the table, as they stand on spools.
_ALSO = {
    "nylon": "pa",
    "polycarbonate": "pc",
    "pet": "petg",
    "pctg": "petg",
    "cpe": "petg",
    "tpe": "tpu",
    "flex": "tpu",
}


@dataclass(frozen=True)
class Material:
    """A polymer: the mean by which parts shrink in it along X and Y, and its standard deviation, as shares."""

    polymer: str
    mean: float
    sd: float


@cache
def _table() -> dict[str, Material]:
    table = tomllib.loads((Path(__file__).parent / "materials.toml").read_text())
    return {name: Material(name, row["mean"] / 100, row["sd"] / 100) for name, row in table.items()}


@cache
def _names() -> dict[str, Material]:
    """Return each name with which a filament's may begin, and its polymer."""
    table = _table()
    means, sds = np.array([(each.mean, each.sd) for each in table.values()]).T
    any_polymer = Material(UNNAMED, float(means.mean()), float(np.sqrt(means.var() + np.mean(sds**2))))
    return {**table, **{also: table[polymer] for also, polymer in _ALSO.items()}, UNNAMED: any_polymer}


def polymers() -> tuple[str, ...]:
    """Return the names of the polymers that are known."""
    return tuple(_table())


def check_name(name: str) -> str:
    """Return a filament's name. Raises `ConfigError` for one that begins with no polymer that is known."""
    material_of(name)
    return name


def material_of(name: str) -> Material:
    """Return the polymer with whose name a filament's name begins: ``petg_blue``, ``pa6-cf`` and ``nylon`` have one.

    Raises `ConfigError` for a name that is none or begins with no polymer that is known.
    """
    known = _names()
    begins = [each for each in known if name.lower().startswith(each)]
    if not _NAME.fullmatch(name) or not begins:
        raise ConfigError(
            say("filament-option"), wanted=say("name-begins-polymer", ", ".join(_table())), came=repr(name),
            todo=say("call-like-pla-black-up-40"),
        )  # fmt: skip
    return known[max(begins, key=len)]


CLAIM_SD = 0.0005  # standard deviation of the machine's scale up to which it counts as told: 0.05 mm in 100
# Scale errors of machines: every one has 0.1 to 0.3 %, some have another pulley (physics.md §3; effects/priors.toml).
_WIDTHS = (0.002, 0.008, 0.024, 0.07, 0.2)
_CHANCES = (0.7, 0.075, 0.075, 0.075, 0.075)
_LEAST_SD = 1e-6  # no scale is known better


@dataclass(frozen=True)
class Entry:
    """One measured scale along X and Y: shares by which a print is too large, NaN where none was measured, and their
    standard deviations. Without a ``filament`` it is the machine's alone; ``kind`` is "print" or "rule"."""

    filament: str | None
    scale: tuple[float, float]
    sd: tuple[float, float]
    kind: str = "print"


@dataclass(frozen=True, eq=False)
class Split:
    """What entries say of the machine's scale along one axis, as shares: a mixture of Gaussians of the ``weight`` [C],
    ``mean`` [C] and ``sd`` [C]."""

    weights: np.ndarray
    means: np.ndarray
    sds: np.ndarray

    @property
    def mean(self) -> float:
        return float(self.weights @ self.means)

    @property
    def sd(self) -> float:
        return float(np.sqrt(self.weights @ (self.sds**2 + self.means**2) - self.mean**2))

    @property
    def is_told(self) -> bool:
        """Say whether machine and filaments are told apart."""
        return self.sd <= CLAIM_SD

    def draws(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """Return machines' scales [count]."""
        which = rng.choice(len(self.weights), count, p=self.weights)
        return self.means[which] + self.sds[which] * rng.standard_normal(count)


def split(entries: Sequence[Entry], axis: int) -> Split:
    """Return what entries say of the machine's scale along an axis; what was not measured there says nothing."""
    seen = [each for each in entries if np.isfinite(each.scale[axis])]
    names = sorted({each.filament for each in seen if each.filament is not None})
    shows, scale = np.zeros((len(seen), 1 + len(names))), np.array([each.scale[axis] for each in seen])
    for row, each in zip(shows, seen, strict=True):
        row[0] = 1.0
        if each.filament is not None:
            row[1 + names.index(each.filament)] = -1.0
    noise = np.diag([max(each.sd[axis], _LEAST_SD) ** 2 for each in seen])
    materials = [material_of(name) for name in names]
    before = np.array([0.0, *(each.mean for each in materials)])
    left = scale - shows @ before
    logs, means, sds = [], [], []
    for width, chance in zip(_WIDTHS, _CHANCES, strict=True):
        prior = np.diag([width**2, *(each.sd**2 for each in materials)])
        open_ = shows @ prior @ shows.T + noise
        gain = np.linalg.solve(open_, shows @ prior).T if seen else np.zeros((len(prior), 0))
        means.append(before[0] + float((gain @ left)[0]))
        sds.append(float(np.sqrt(max((prior - gain @ shows @ prior)[0, 0], _LEAST_SD**2))))
        evidence = -0.5 * (left @ np.linalg.solve(open_, left) + np.linalg.slogdet(open_)[1]) if seen else 0.0
        logs.append(np.log(chance) + evidence)
    weights = np.exp(np.array(logs) - max(logs))
    return Split(weights / weights.sum(), np.array(means), np.array(sds))
