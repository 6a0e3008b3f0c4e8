"""The one table of priors, and how a share of printers becomes the odds of each alternative."""

import math
import tomllib
from collections.abc import Iterable, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from printmend.effects.effect import SCALE_MM, Fate, Scene, Term, periods_mm

NEAR_SHARE = 0.02  # a turn that differs less from the printer's is its pulley's


@cache
def _table() -> dict[str, Any]:
    return tomllib.loads((Path(__file__).parent / "priors.toml").read_text(encoding="utf-8"))


def number_of(name: str, key: str) -> float:
    """Return a number of an effect's own row, or of another one of the table."""
    return float(_table()[name][key])


def size_mm(name: str) -> float:
    """Return the standard deviation of an effect's size on a damaged machine."""
    return number_of(name, "sd")


def mild_shares(name: str = "") -> tuple[float, ...]:
    """Return the shares of an effect's usual size that are tried, milder ones last: those of all unless it has own."""
    return tuple(_table().get(name, {}).get("mild", _table()["mild"]))


def numbers_of(name: str, key: str) -> tuple[float, ...]:
    """Return some numbers of an effect's own row, such as the ``lengths`` over which a smooth process changes."""
    return tuple(map(float, _table()[name][key]))


def harmonics_of(name: str) -> np.ndarray:
    """Return the orders [K] of the harmonics of an effect's waves: without any of its own it has one for each size."""
    row = _table()[name]
    own = row.get("harmonics", len(profile_of(name)))
    return np.array(own, float) if isinstance(own, list) else np.arange(1.0, own + 1)


def apart_of(name: str, key: str, number: float) -> float:
    """Return how far the next one of an effect's own numbers, which are a factor apart, is from one."""
    first, second, *_ = numbers_of(name, key)
    return number * math.log(second / first)


def share_of(name: str) -> float:
    """Return the share of printers that have an effect at one place."""
    return number_of(name, "share")


def fate_of(name: str) -> Fate:
    """Return the fate of an effect that may begin anew in the next print, or go on."""
    return Fate(**_table()[name]["fate"])


def profile_of(name: str) -> tuple[float, ...]:
    """Return the standard deviations [P] of an effect's sizes over the usual one; it has one size unless the table says
    otherwise."""
    return tuple(_table().get(name, {}).get("profile", (1.0,)))


def wear_share(name: str) -> float:
    """Return the share of its size by which an effect changes in a month."""
    return float(_table()["since"]["wear"].get(name, 0.0))


def belt_effects() -> tuple[str, ...]:
    """Return the effects that come anew with another belt."""
    return tuple(_table()["since"]["anew"])


def homing_priors() -> Iterator[tuple[str, float, float, float, float]]:
    """Yield each kind of end stop: name, share, scatter [mm], deviation of its logarithm, electrical turns."""
    for name, row in _table()["homing"].items():
        yield name, float(row["share"]), float(row["sd"]), float(row["log_sd"]), float(row["turn"])


def machine_scales() -> list[tuple[float, float]]:
    """Return the standard deviations of a machine's scale error, as shares, and the chance of each: every one has a
    small error, some have another pulley."""
    row = _table()["scale"]
    damaged = [(factor * row["sd"] / SCALE_MM, row["share"] / len(row["mild"])) for factor in row["mild"]]
    return [(damaged[-1][0], 1.0 - row["share"]), *reversed(damaged)]


def lift_rests() -> tuple[tuple[float, float], ...]:
    """Return where in its play a nut may rest at first, 0 to 1, and the logarithm of how often it does."""
    on_flank = share_of("rest")
    return (0.5, math.log(1 - on_flank)), (0.0, math.log(on_flank / 2)), (1.0, math.log(on_flank / 2))


def periods_of(name: str, span_mm: tuple[float, float]) -> list[float]:
    """Return the periods of an effect's waves that a span from one end to the other shows."""
    low, high = span_mm
    longest_mm = min(number_of(name, "longest"), number_of(name, "longest_share") * (high - low))
    return periods_mm(number_of(name, "shortest"), longest_mm, high - low)


def turning_share(name: str, scene: Scene, motor: int) -> float:
    """Return the share of printers with an effect of a motor's turn, where that turn may have a wrong length."""
    off = abs(scene.turns_mm[motor] / scene.printer.axes[motor].mm_per_turn - 1)
    return share_of(name) * (1.0 if off < NEAR_SHARE else share_of("other_turn"))


def each_share(share: float, count: int) -> float:
    """Return the share of each of ``count`` alternatives, whose odds add up to those of a ``share``."""
    return share / (share + count * (1.0 - share))


def alternatives(
    name: str,
    where: int,
    shapes: Sequence[tuple[float, ...]] = ((),),
    *profiles: Iterable[float],
    share: float | None = None,
    sd_mm: float | None = None,
    row: str = "",
    sign: int = 0,
) -> Iterator[Term]:
    """Yield a term for each shape, profile and share of the usual size, as alternatives of one another.

    A profile [P] holds the sizes' standard deviations relative to the usual one. ``profiles``, ``share`` and ``sd_mm``
    are those of a ``row`` of the table, by default the effect's, unless given; an effect of another package gives
    ``share`` and ``sd_mm``.
    """
    row = row or name
    sd, profiles = size_mm(row) if sd_mm is None else sd_mm, profiles or (profile_of(row),)
    sizes = [tuple(mild * sd * each for each in profile) for profile in profiles for mild in mild_shares(row)]
    chance = share_of(row) if share is None else share
    log_odds = math.log(chance / max(1.0 - chance, 1e-6)) - math.log(max(len(shapes), 1) * len(sizes))
    yield from (Term(name, where, shape, size, log_odds, sign) for shape in shapes for size in sizes)
