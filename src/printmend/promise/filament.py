"""Split measured scales into the machine's and each filament's; keep both as sections of a model file.

Along each axis a print in the filament k shows the scale T = M − f_k; a print that cannot shrink (dots that stick to
plate or paper) and a rule along the machine's travel show M. All are linear, and M has a prior of several widths:
the posterior is a mixture of Gaussians, in closed form.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from printmend.effects.effect import SCALE_MM
from printmend.effects.prior import machine_scales
from printmend.filament import material_of
from printmend.infer.machine import DRAWS, Part
from printmend.messages import say
from printmend.model import SavedModel
from printmend.model.branches import number, numbers, refuse, section_of
from printmend.units import SELDOM_SDS

LEAST_DOUBT = 0.001  # share: 0.1 mm in 100; a smaller doubt about a scale is said in the expected error alone
CLAIM_SD = LEAST_DOUBT / SELDOM_SDS  # of the machine's scale: up to this it counts as told
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
    """Return what entries say about the machine's scale along an axis; entries without a measurement there say
    nothing."""
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
    for width, chance in machine_scales():
        prior = np.diag([width**2, *(each.sd**2 for each in materials)])
        open_ = shows @ prior @ shows.T + noise
        gain = np.linalg.solve(open_, shows @ prior).T if seen else np.zeros((len(prior), 0))
        means.append(before[0] + float((gain @ left)[0]))
        sds.append(float(np.sqrt(max((prior - gain @ shows @ prior)[0, 0], _LEAST_SD**2))))
        evidence = -0.5 * (left @ np.linalg.solve(open_, left) + np.linalg.slogdet(open_)[1]) if seen else 0.0
        logs.append(np.log(chance) + evidence)
    weights = np.exp(np.array(logs) - max(logs))
    return Split(weights / weights.sum(), np.array(means), np.array(sds))


def are_told(entries: Sequence[Entry]) -> bool:
    """Say whether entries tell the machine's scale along both axes."""
    return all(split(entries, axis).is_told for axis in range(2))


FILAMENTS = "filaments"  # the model file's key
UNTOLD = ("whose-scale-not-settled", "whose-scale-untold")  # findings: the scale is the machine's or the filament's
MOST = 1000  # entries that any list of a file may have
_SUBJECT = "the model [filaments]"


def parse_entries(model: SavedModel) -> tuple[Entry, ...] | None:
    """Return the scales that a model was told of, None for one that knows no filament. Raises `ModelError` for a
    section that is none of ours."""
    section = model.document.get(FILAMENTS)
    if section is None:
        return None
    if not isinstance(section, dict):
        refuse(_SUBJECT, say("section-3"), say("something-else"))
    rows = section_of(section, "measured", list, _SUBJECT)
    if len(rows) > MOST:
        refuse(_SUBJECT, say("most-measured-scales", MOST), str(len(rows)))
    return tuple(_entry(row) for row in rows)


def entry_section(entry: Entry) -> dict[str, Any]:
    """Return a measured scale as plain values."""
    axes = {
        name: {"scale": round(scale, 8), "sd": round(sd, 8)}
        for name, scale, sd in zip("xy", entry.scale, entry.sd, strict=True)
        if np.isfinite(scale)
    }
    return {"kind": entry.kind, **({} if entry.filament is None else {"filament": entry.filament}), **axes}


def _entry(row: Any) -> Entry:
    if not isinstance(row, dict) or row.get("kind") not in ("print", "rule"):
        refuse(_SUBJECT, say("measured-scales-print-rule"), say("something-else"))
    filament = row.get("filament")
    if filament is not None:
        _check_name(filament)
    scale, sd = [np.nan, np.nan], [1.0, 1.0]
    for axis, name in enumerate("xy"):
        if name in row:
            one = section_of(row, name, dict, _SUBJECT)
            scale[axis], sd[axis] = number(one, "scale", _SUBJECT, 10.0), abs(number(one, "sd", _SUBJECT, 10.0))
    return Entry(filament, (scale[0], scale[1]), (sd[0], sd[1]), row["kind"])


def _check_name(name: Any) -> None:
    try:
        material_of(name if isinstance(name, str) else "")
    except Exception:
        refuse(_SUBJECT, say("names-filaments"), repr(name)[:40])


def scale_cause(model: SavedModel) -> str:
    """Return the cause that leaves the scale of a model's prints most open: the filament, where its shrinkage would
    narrow it more than an exact picture, else the instrument."""
    entries = parse_entries(model) or ()
    if model.filament is not None or all(each.filament is None for each in entries):
        return "instrument"
    grown, exact = (
        sum(split([replace(each, **known) for each in entries], axis).sd for axis in range(2))
        for known in ({"filament": None}, {"sd": (0.0, 0.0)})
    )
    return "filament" if grown < exact else "instrument"


def known_filaments(model: SavedModel) -> dict[str, tuple[Part, Part]]:
    """Return by how much parts shrink along X and Y in each filament that a model knows."""
    section = model.document.get(FILAMENTS)
    if section is None:
        return {}
    known = section_of(section if isinstance(section, dict) else {}, "known", dict, _SUBJECT)
    if len(known) > MOST:
        refuse(_SUBJECT, say("most-filaments", MOST), str(len(known)))
    return {str(name): _parts(name, each) for name, each in known.items()}


def _parts(name: Any, section: Any) -> tuple[Part, Part]:
    _check_name(name)
    found = []
    for axis in "xy":
        one = section_of(section if isinstance(section, dict) else {}, axis, dict, _SUBJECT)
        draws = numbers(one, "draws", _SUBJECT, DRAWS)
        acts = number(one, "acts", _SUBJECT, SCALE_MM)
        if len(draws) != DRAWS:
            refuse(_SUBJECT, say("draws", DRAWS), str(len(draws)))
        found.append(Part("shrinkage", "xy".index(axis), (), np.array([acts]), draws[None]))
    return found[0], found[1]


def filament_section(parts: tuple[Part, Part]) -> dict[str, Any]:
    """Return the shrinkage in one filament as plain values, in mm per 100 mm."""
    return {
        axis: {"acts": float(f"{part.acts_mm[0]:.6g}"), "draws": [float(f"{each:.5g}") for each in part.draws_mm[0]]}
        for axis, part in zip("xy", parts, strict=True)
    }
