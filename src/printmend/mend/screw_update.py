"""The Z screw of a model that is brought up to date: what the new trace shows of it, and what only the old one knew."""

from dataclasses import replace
from typing import Any

import numpy as np

from printmend.diagnosis.screw import KINDS, ScrewFound, find_screw, heights_mm, without_push
from printmend.effects.words import NAMED_SIGMAS
from printmend.mend.learned import Z_SAID, with_screw_found
from printmend.model import SavedModel, ScrewSeries, screw_of, with_screw
from printmend.path import Trace
from printmend.twin import Twin


def seen_screw(old: SavedModel, trace: Trace) -> ScrewFound:
    """Return what a trace shows of Z, and the trace without the push: its own, or where it shows none the old one.

    The old model says where a machine without the push would have printed: a tower over a few places shows no pulleys.
    """
    printed_mm = Twin(replace(old.mechanism, screw=None)).follow(trace.commanded_mm)
    found = find_screw(trace, old.printer, lambda clean: clean.measured_mm - printed_mm)
    if found is not None and (series := screw_of(old)) is not None:
        found = _better_known(old, series, found)
    if found is not None and "wobble" in found.said:
        return found
    z_mm, screw = heights_mm(trace, old.printer), old.mechanism.screw
    clean = trace if z_mm is None or screw is None else without_push(trace, screw.wobble_at_mm(z_mm))
    return ScrewFound(None, clean) if found is None else replace(found, trace=clean)


def with_seen_screw(old: SavedModel, model: SavedModel, found: ScrewFound, trace: Trace) -> SavedModel:
    """Return an updated planar ``model`` with Z: what the trace shows as found, the rest as the old model has it."""
    said = {**old.document.get(Z_SAID, {}), **found.said}
    faults = [fault for fault in _faults(old) if not fault["kind"].startswith(tuple(found.said))]
    missing = {kind: gap for kind, gap in found.gaps.items() if kind not in said}
    planar = tuple(gap for gap in model.findings if not gap.startswith("Z "))
    merged = ScrewFound(
        _merged(screw_of(old), found), found.trace, {kind: said[kind] for kind in KINDS if kind in said}, missing,
        (*faults, *found.faults),
    )  # fmt: skip
    return with_screw_found(with_screw(model, None, findings=planar, details={}), merged, merged.series, trace)


def screw_changes(old: SavedModel, found: ScrewFound) -> list[dict[str, Any]]:
    """Return what changed of Z: kind, before, now, sd and unit of each quantity that moved for sure."""
    before = {fault["kind"]: fault for fault in _faults(old) if fault["kind"].startswith(tuple(found.said))}
    now = {fault["kind"]: fault for fault in found.faults}
    changes = []
    for kind in sorted(before.keys() | now.keys()):
        nothing = {"value": 0.0, "sd": 0.0, "unit": (before | now)[kind]["unit"]}
        was, new = before.get(kind, nothing), now.get(kind, nothing)
        sd = float(np.hypot(was["sd"], new["sd"]))
        if abs(new["value"] - was["value"]) > NAMED_SIGMAS * sd:
            changes.append({"kind": kind, "before": was["value"], "now": new["value"], "sd": sd, "unit": new["unit"]})
    return changes


def _better_known(old: SavedModel, known: ScrewSeries, found: ScrewFound) -> ScrewFound:
    """Leave out of ``found`` what the old model knows more surely and the new trace does not contradict."""
    new, said = found.series or ScrewSeries.healthy(known.lead_mm), dict(found.said)
    away = {
        "lead": 100 * abs(new.lead_error - known.lead_error),
        "periodic": float(np.linalg.norm((new.height_mm - known.height_mm)[:2])),
        "backlash": abs(new.backlash_mm - known.backlash_mm),
        "wobble": float(np.linalg.norm((new.push_mm - known.push_mm)[:2]) / np.sqrt(2)),
    }
    for fault in _faults(old):
        kind = fault["kind"].split("-")[0]
        sd = found.sds.get(kind, 0.0)
        if kind in said and fault["sd"] < sd and away[kind] <= NAMED_SIGMAS * np.hypot(sd, fault["sd"]):
            said.pop(kind)
    faults = tuple(fault for fault in found.faults if fault["kind"].split("-")[0] in said)
    return replace(found, said=said, faults=faults)


def _faults(model: SavedModel) -> list[dict[str, Any]]:
    return [fault for fault in model.document.get("diagnosis", []) if fault["part"] == "z"]


def _merged(old: ScrewSeries | None, found: ScrewFound) -> ScrewSeries | None:
    """Return each part of Z from where it was seen, None for a screw without a fault."""
    new = found.series
    if new is None and old is None:
        return None
    lead_mm = (new or old).lead_mm  # type: ignore[union-attr]
    nothing = ScrewSeries.healthy(lead_mm)
    lead, periodic, backlash, wobble = ((new if kind in found.said else old) or nothing for kind in KINDS)
    merged = ScrewSeries(
        lead_mm, lead.lead_error, backlash.backlash_mm, periodic.height_mm, wobble.push_mm, wobble.push_sd_mm
    )
    healthy = merged.lead_error == merged.backlash_mm == 0.0 and not merged.height_mm.any() and not merged.push_mm.any()
    return None if healthy else merged
