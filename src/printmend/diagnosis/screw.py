"""What a trace says of the Z screw: how it lifts, where it pushes the layers, and what it cannot tell of either.

Heights are learned where some were measured; the push from what the planar machine leaves over at each height. A print
has one push a layer, however many marks, so a layer counts as one measurement.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from printmend.effects.words import NAMED_SIGMAS, amount
from printmend.errors import TraceError
from printmend.infer.screw import first_push_mm, fit_height
from printmend.measure.follows import LEAST_RANK_CORRELATION, POSSIBLE_GAINS
from printmend.messages import say, together
from printmend.model.series import HARMONICS, ScrewSeries, waves_of
from printmend.path import Trace, last_way
from printmend.printer import Printer

KINDS = ("lead", "periodic", "backlash", "wobble")
LEAST_WAVE_MM = 0.003  # a smaller wave is not named
_ROUNDS = 2  # how often belts and screw are fitted in turn
_LEAST_TURNS = 0.75  # turns of the screw that heights must span; on fewer a wave looks like a slope
_TREND_TURNS = 2.0  # turns of the screw from which a leaning tower is told from a wave
_MOST_LAYERS = 400  # different heights; with more, as in a spiral, the print is cut into slices
_SLICES_PER_TURN = 64
_LEAST_LAYERS = 3  # different heights; fewer say nothing of Z
_SPARE_LAYERS = 3  # by how many the layers must outnumber the unknowns
_HEALTHY_SD_MM = 0.03  # a trace that tells a wave less well than this does not call a screw healthy
_SAME_PHASE_TURNS = 0.02  # phases of the screw that differ by less are one
_BEYOND_MM = 20.0  # a height that lies farther beyond the axis' ends is a mistake
Residual = Callable[[Trace], np.ndarray]


@dataclass(frozen=True, eq=False)
class ScrewFound:
    """What was learned of Z.

    ``series`` is None for a screw without a fault; ``trace`` is what the planar machine is learned from, the push taken
    off. ``said`` has for each of `KINDS` that the trace shows its fault in plain words, empty for none; ``gaps`` says
    why it does not show the others. ``faults`` are the same numbers for programs. ``sds`` says how sure each kind is, a
    fault found or not: in % for the lead, else in mm.
    """

    series: ScrewSeries | None
    trace: Trace
    said: Mapping[str, str] = field(default_factory=dict)
    gaps: Mapping[str, str] = field(default_factory=dict)
    faults: tuple[dict[str, Any], ...] = ()
    sds: Mapping[str, float] = field(default_factory=dict)

    @property
    def is_silent(self) -> bool:
        """True where nothing is wrong, and no heights were measured to ask for it."""
        return not self.faults and "lead" not in {*self.said, *self.gaps}

    @property
    def sentence(self) -> str:
        """The faults in plain words, empty where there is nothing to say."""
        words = [line for line in self.said.values() if line]
        if words:
            return say("motor-has", "Z", together(", ", words))
        return say("motor-healthy", "Z") if "lead" in self.said else ""


@dataclass(frozen=True, eq=False)
class _Part:
    """What was found of a lift or a push: its ``terms``, and of a push by how much each may be off, ``doubt``."""

    terms: np.ndarray
    backlash_mm: float = 0.0
    said: Mapping[str, str] = field(default_factory=dict)
    gaps: Mapping[str, str] = field(default_factory=dict)
    faults: tuple[dict[str, Any], ...] = ()
    sds: Mapping[str, float] = field(default_factory=dict)
    doubt: np.ndarray = field(default_factory=lambda: np.zeros((2 * HARMONICS, 2)))


def find_screw(trace: Trace, printer: Printer, residual: Residual) -> ScrewFound | None:
    """Learn Z from a trace, None where it does not show any.

    ``residual`` learns a planar machine from a trace and returns what it leaves over [N, 2], on the bed. Raises
    `TraceError` for heights that are none of this printer.
    """
    z_mm = heights_mm(trace, printer)
    if z_mm is None:
        return None
    lift, push = _Part(np.zeros(1 + 2 * HARMONICS)), _Part(np.zeros((2 * HARMONICS, 2)))
    several = len(np.unique(np.round(z_mm[trace.measured_rows], 3))) >= _LEAST_LAYERS
    asked = trace.z_measured_mm is not None and np.isfinite(trace.z_measured_mm).sum() >= _LEAST_LAYERS
    if asked:
        assert trace.z_measured_mm is not None
        lift = _lift(z_mm, trace.z_measured_mm, printer)
    clean = trace
    if several:
        push = _push(z_mm, residual(trace), printer)
        if push.faults:
            push, clean = _push_and_planar(trace, z_mm, printer, residual)
            if not asked:
                lift = replace(lift, gaps={"lead": say("z-lead-backlash-no-heights-were")})
    if not asked and not push.faults:  # of an ordinary print of some layers nobody asks what it says of Z
        return ScrewFound(None, trace, {"wobble": ""}) if push.said else None
    faults, series = (*lift.faults, *push.faults), None
    if faults:
        series = ScrewSeries(
            printer.z.mm_per_turn, float(lift.terms[0]), lift.backlash_mm, lift.terms[1:], push.terms, push.doubt
        )
    return ScrewFound(
        series, clean, {**lift.said, **push.said}, {**lift.gaps, **push.gaps}, faults, {**lift.sds, **push.sds}
    )


def without_push(trace: Trace, push_mm: np.ndarray) -> Trace:
    """Return the trace as it would be if the screw pushed nothing."""
    return replace(trace, measured_mm=trace.measured_mm - push_mm)


def heights_mm(trace: Trace, printer: Printer) -> np.ndarray | None:
    """Return the commanded heights [N], an empty one being the last; None where there are none."""
    if trace.z_mm is None or not np.isfinite(trace.z_mm).any():
        return None
    low, high = printer.z.min_mm - _BEYOND_MM, printer.z.max_mm + _BEYOND_MM
    for name, values in (("z_mm", trace.z_mm), ("z_measured_mm", trace.z_measured_mm)):
        if values is not None and (off := (values < low) | (values > high)).any():
            raise TraceError(
                say("trace"), wanted=say("column-from-to-mm", name, f"{low:g}", f"{high:g}"),
                came=f"{values[off][0]:g}", todo=say("check-unit-printer"),
            )  # fmt: skip
    known = np.isfinite(trace.z_mm)
    last = np.maximum.accumulate(np.where(known, np.arange(len(known)), -1))
    return np.where(last >= 0, trace.z_mm[np.maximum(last, 0)], printer.z.home_mm)


def _push_and_planar(trace: Trace, z_mm: np.ndarray, printer: Printer, residual: Residual) -> tuple[_Part, Trace]:
    """Learn the planar machine and the push in turn, each from what the other leaves; return the push and its trace."""
    push_mm = first_push_mm(replace(trace, z_mm=z_mm), printer)
    for _ in range(_ROUNDS):
        clean = without_push(trace, push_mm)
        part = _push(z_mm, residual(clean) + push_mm, printer)
        # at home nothing is pushed: that is where the planar machine counts from
        home = waves_of(np.array([printer.z.home_mm]), printer.z.mm_per_turn, HARMONICS)
        push_mm = (waves_of(z_mm, printer.z.mm_per_turn, HARMONICS) - home) @ part.terms
    return part, without_push(trace, push_mm)


def _lift(z_mm: np.ndarray, measured_mm: np.ndarray, printer: Printer) -> _Part:
    """Learn how the screw lifts: first with all terms, then again with those alone that are surely there."""
    lead_mm = printer.z.mm_per_turn
    span_mm = float(np.ptp(z_mm[np.isfinite(measured_mm)]))
    gaps: dict[str, str] = {}
    active = np.ones(1 + 2 * HARMONICS, bool)
    if span_mm < _LEAST_TURNS * lead_mm:
        gaps["lead"] = _too_low_gap("lead-and-unevenness", span_mm, lead_mm)
        active[:] = False
    else:
        _check_follows(z_mm, measured_mm)
    height = fit_height(z_mm, measured_mm, printer, active=active)
    sizes = np.array([abs(height.terms[0]), *np.repeat(_sizes(height.terms[1:]), 2)])
    spreads = np.array([height.sds[0], *np.repeat(_sizes(height.sds[1:]) / np.sqrt(2), 2)])
    sure = (
        active
        & (sizes > NAMED_SIGMAS * spreads)
        & (sizes * np.array([span_mm] + [1.0] * 2 * HARMONICS) > LEAST_WAVE_MM)
    )
    if (sure != active).any():
        height = fit_height(z_mm, measured_mm, printer, active=sure)
    sds = {"lead": 100 * float(spreads[0]), "periodic": float(spreads[1]), "backlash": height.backlash_sd_mm}
    said, faults = {} if gaps else {"lead": "", "periodic": ""}, []
    if sure[0]:
        percent, sd = 100 * float(height.terms[0]), 100 * float(height.sds[0])
        said["lead"] = say("z-lead-too-long" if percent > 0 else "z-lead-too-short", amount(abs(percent), sd, "%"))
        faults.append(_fault("lead", percent, sd, "%"))
    uneven = [(k, size, float(height.sds[2 * k])) for k, size in enumerate(_sizes(height.terms[1:]), 1) if size > 0]
    if uneven:
        said["periodic"] = say("z-lifts-unevenly", _waves_words(uneven))
        faults += [_fault(f"periodic-{k}", size, sd, "mm") for k, size, sd in uneven]
    for kind, sd in (("lead", spreads[0] * span_mm), ("periodic", spreads[1])):
        if said.get(kind) == "" and sd > _HEALTHY_SD_MM:
            del said[kind]
            gaps[kind] = _unsure_gap(kind, float(sd))
    backlash_mm = 0.0
    if _comes_back(z_mm, measured_mm):
        backlash_mm = height.backlash_mm if height.backlash_mm > LEAST_WAVE_MM else 0.0
        said["backlash"] = say("z-has-backlash", amount(backlash_mm, height.backlash_sd_mm)) if backlash_mm else ""
        if backlash_mm:
            faults.append(_fault("backlash", backlash_mm, height.backlash_sd_mm, "mm"))
    else:
        gaps["backlash"] = say("z-backlash-no-height-measured-after")
    return _Part(np.where(sure, height.terms, 0.0), backlash_mm, said, gaps, tuple(faults), sds)


def _check_follows(z_mm: np.ndarray, measured_mm: np.ndarray) -> None:
    """Raise `TraceError` where measured heights [N], NaN for none, do not go with the commanded ones [N]."""
    seen = np.isfinite(measured_mm)
    wanted, came = (height[seen] - height[seen].mean() for height in (z_mm, measured_mm))
    followed = float(wanted @ came / (wanted @ wanted))
    likeness = float(wanted @ came / max(np.linalg.norm(wanted) * np.linalg.norm(came), 1e-9))
    if likeness < LEAST_RANK_CORRELATION or not POSSIBLE_GAINS[0] < followed < POSSIBLE_GAINS[1]:
        raise TraceError(
            say("trace"), wanted=say("heights-that-follow"),
            came=say("heights-follow", f"{followed:.2f}", f"{likeness:.2f}"), todo=say("check-heights"),
        )  # fmt: skip


def _push(z_mm: np.ndarray, left_over_mm: np.ndarray, printer: Printer) -> _Part:
    """Learn the push from what is left over [N, 2]: a wave a turn, and its double where there are layers enough."""
    lead_mm, none = printer.z.mm_per_turn, np.zeros((2 * HARMONICS, 2))
    seen = np.isfinite(left_over_mm).all(axis=1)
    layer_z, counts, means = _layers(z_mm[seen], left_over_mm[seen], lead_mm)
    span_mm = float(np.ptp(layer_z)) if len(layer_z) else 0.0
    if span_mm < _LEAST_TURNS * lead_mm:
        return _Part(none, gaps={"wobble": _too_low_gap("wobble", span_mm, lead_mm)})
    phases = len(np.unique(np.round(layer_z / lead_mm % 1.0 / _SAME_PHASE_TURNS) % round(1 / _SAME_PHASE_TURNS)))
    weight = np.sqrt(np.minimum(counts, np.median(counts)))[:, None]
    trend = [(layer_z - layer_z.mean())[:, None] / lead_mm] if span_mm >= _TREND_TURNS * lead_mm else []
    for harmonics in range(HARMONICS, 0, -1):
        unknown = 2 * harmonics + 1 + len(trend)
        spare = len(layer_z) - unknown
        if spare < _SPARE_LAYERS or phases < 2 * harmonics + 1:
            continue
        design = np.column_stack([waves_of(layer_z, lead_mm, harmonics), np.ones(len(layer_z)), *trend]) * weight
        solved = np.linalg.lstsq(design, means * weight, rcond=None)[0]
        noise = np.sqrt(np.square(means * weight - design @ solved).sum(axis=0) / spare) * (1 + 2 / spare)
        sds = np.sqrt(np.diag(np.linalg.pinv(design.T @ design)))[: 2 * harmonics, None] * noise
        terms = solved[: 2 * harmonics]
        sizes = np.sqrt(np.square(terms).sum(axis=1).reshape(-1, 2).sum(axis=1) / 2)
        spreads = np.sqrt(np.square(sds).sum(axis=1).reshape(-1, 2).sum(axis=1) / 4)
        sure = (sizes > NAMED_SIGMAS * spreads) & (sizes > LEAST_WAVE_MM)
        if harmonics > 1 and not sure[-1]:
            continue
        if not sure[0] and spreads[0] > _HEALTHY_SD_MM:
            return _Part(none, gaps={"wobble": _unsure_gap("wobble", float(spreads[0]))})
        if not sure[0]:
            return _Part(none, said={"wobble": ""}, sds={"wobble": float(spreads[0])})
        found, doubt = none.copy(), none.copy()
        found[: 2 * harmonics], doubt[: 2 * harmonics] = terms, sds
        waved = [(k, float(s), float(d)) for k, (s, d) in enumerate(zip(sizes, spreads, strict=True), 1)]
        faults = tuple(_fault(f"wobble-{k}", size, sd, "mm") for k, size, sd in waved)
        said = {"wobble": say("z-pushes-aside", _waves_words(waved))}
        return _Part(found, said=said, faults=faults, sds={"wobble": waved[0][2]}, doubt=doubt)
    if phases < 3 or len(layer_z) < 3 + _SPARE_LAYERS:
        return _Part(none, gaps={"wobble": say("wobble-heights-angles-screw-needs-six", len(layer_z), phases)})
    return _Part(none, said={"wobble": ""})


def _layers(z_mm: np.ndarray, values: np.ndarray, lead_mm: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the mean height [L] of each layer, its points and their mean [L, 2]; slices where all heights differ."""
    _, layer = np.unique(np.round(z_mm, 3), return_inverse=True)
    if layer.max(initial=0) >= _MOST_LAYERS:
        _, layer = np.unique(np.round(z_mm / lead_mm * _SLICES_PER_TURN), return_inverse=True)
    counts = np.bincount(layer).astype(float)
    mean = [np.bincount(layer, column) / counts for column in (z_mm, *values.T)]
    return mean[0], counts, np.stack(mean[1:], axis=1)


def _comes_back(z_mm: np.ndarray, measured_mm: np.ndarray) -> bool:
    """Tell whether a height was measured after the nozzle came down to it."""
    return bool((last_way(z_mm)[np.isfinite(measured_mm)] < 0).any())


def _sizes(terms: np.ndarray) -> np.ndarray:
    """Return the amplitude of each harmonic of (a_1, b_1, a_2, …)."""
    return np.hypot(terms[::2], terms[1::2])


def _waves_words(found: list[tuple[int, float, float]]) -> str:
    """Say how large waves are and how often a turn they come; ``found`` are (harmonic, size, sd)."""
    often = {1: "once-a-turn", 2: "twice-a-turn"}
    return together(" / ", [say(often[k], amount(size, sd)) for k, size, sd in found])


def _unsure_gap(what: str, sd_mm: float) -> str:
    return say("z-told-mm-only-measure-more", say(f"z-{what}"), f"{sd_mm:.2f}")


def _too_low_gap(what: str, span_mm: float, lead_mm: float) -> str:
    return say("z-heights-span-mm-turn-screw", say(f"z-{what}"), f"{span_mm:.1f}", f"{lead_mm:g}")


def _fault(kind: str, value: float, sd: float, unit: str) -> dict[str, Any]:
    return {"part": "z", "kind": kind, "value": round(float(value), 6), "sd": round(float(sd), 6), "unit": unit}
