"""Filaments by name, and how much parts shrink in their polymers."""

import re
import tomllib
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
    table = tomllib.loads((Path(__file__).parent / "materials.toml").read_text(encoding="utf-8"))
    return {name: Material(name, row["mean"] / 100, row["sd"] / 100) for name, row in table.items()}


@cache
def _names() -> dict[str, Material]:
    """Return each name with which a filament's may begin, and its polymer."""
    table = _table()
    means, sds = np.array([(each.mean, each.sd) for each in table.values()]).T
    any_polymer = Material(UNNAMED, float(means.mean()), float(np.sqrt(means.var() + np.mean(sds**2))))
    return {**table, **{also: table[polymer] for also, polymer in _ALSO.items()}, UNNAMED: any_polymer}


def said_name(name: str) -> str:
    """Return a filament's name as a sentence has it."""
    return say("filament-unnamed") if name == UNNAMED else name


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
