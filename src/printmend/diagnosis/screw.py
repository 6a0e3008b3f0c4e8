"""What measured heights show of the Z screw's lift, and what they leave open.

How it pushes the layers aside is an effect like others (`effects.wobble`).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from printmend.effects.wobble import LEAST_TURNS
from printmend.effects.words import LEAST, NAMED_SIGMAS, Fault, amount, fault_of
from printmend.errors import TraceError
from printmend.infer.screw import fit_height
from printmend.measure.checks import LEAST_RANK_CORRELATION, POSSIBLE_GAINS
from printmend.messages import is_one_of, say, together
from printmend.model import SavedModel, screw_of
from printmend.model.screw import HARMONICS, ScrewSeries
from printmend.path import Trace, last_way
from printmend.printer import Printer

KINDS = ("lead", "periodic", "backlash")
_GAPS = (  # messages: gaps of Z
    "z-heights-span-mm-turn-screw", "z-told-mm-only-measure-more", "z-backlash-no-height-measured-after",
    "z-lead-backlash-no-heights-were",
)  # fmt: skip
Z_SAID = "z"  # the document's key of what was said of the lift, kind by kind
_LEAST_HEIGHTS = 3  # that were measured; fewer say nothing of Z
HEALTHY_SD_MM = 0.03  # a trace that tells a wave less well than this does not call a screw healthy


@dataclass(frozen=True, eq=False)
class Quantity:
    """One of `KINDS` as heights show it: its ``terms``, what is said of them, nothing of none, and how sure that is: in
    % for the lead, else in mm."""

    terms: np.ndarray
    said: str = ""
    faults: tuple[Fault, ...] = ()
    sd: float = 0.0


@dataclass(frozen=True, eq=False)
class Lift:
    """What is known of how the screw lifts, by kind; ``gaps`` says why the others are not."""

    known: Mapping[str, Quantity] = field(default_factory=dict)
    gaps: Mapping[str, str] = field(default_factory=dict)

    @property
    def faults(self) -> list[Fault]:
        return [fault for kind in KINDS if kind in self.known for fault in self.known[kind].faults]

    @property
    def words(self) -> list[str]:
        return [self.known[kind].said for kind in KINDS if kind in self.known and self.known[kind].said]

    @property
    def said(self) -> dict[str, str]:
        """What was said of each kind, as a model keeps it."""
        return {kind: self.known[kind].said for kind in KINDS if kind in self.known}

    def with_push(self, lead_mm: float, push_mm: np.ndarray) -> ScrewSeries | None:
        """Return the whole screw, None for one without a fault."""
        if not self.faults and not push_mm.any():
            return None
        of = {kind: each.terms for kind, each in self.known.items()}
        none = np.zeros(1)
        return ScrewSeries(
            lead_mm, float(of.get("lead", none)[0]), float(of.get("backlash", none)[0]),
            of.get("periodic", np.zeros(2 * HARMONICS)), push_mm,
        )  # fmt: skip


def lift_of(model: SavedModel) -> Lift:
    """Return what a model knows of how its screw lifts."""
    series = screw_of(model) or ScrewSeries.healthy(model.printer.z.mm_per_turn)
    terms = (np.array([series.lead_error]), series.height_mm, np.array([series.backlash_mm]))
    said = model.document.get(Z_SAID, {})
    rows = [row for row in model.document.get("diagnosis", []) if row["part"] == "z"]
    known = {}
    for kind, each in zip(KINDS, terms, strict=True):
        faults = tuple(fault_of(row) for row in rows if row["kind"].startswith(kind))
        if kind in said or each.any():
            known[kind] = Quantity(each, said.get(kind, ""), faults, faults[0].sd if faults else 0.0)
    return Lift(known)


def renewed_lift(old: Lift, new: Lift) -> Lift:
    """Return an old lift with what new heights show, but what was known more surely and is not contradicted."""
    known = dict(old.known)
    for kind, now in new.known.items():
        was = old.known.get(kind)
        if was is None or not was.faults or not was.sd < now.sd or _away(kind, was, now):
            known[kind] = now
    return Lift(known, {kind: gap for kind, gap in new.gaps.items() if kind not in known})


def _away(kind: str, was: Quantity, now: Quantity) -> bool:
    unit = 100.0 if kind == "lead" else 1.0
    away = unit * float(np.linalg.norm((now.terms - was.terms)[:2]))
    return away > NAMED_SIGMAS * float(np.hypot(now.sd, was.sd))


def find_lift(trace: Trace, printer: Printer) -> Lift | None:
    """Learn how Z lifts, None where too few heights were measured.

    Raises `TraceError` for heights that are none of this printer.
    """
    if trace.z_mm is None or trace.z_measured_mm is None or np.isfinite(trace.z_measured_mm).sum() < _LEAST_HEIGHTS:
        return None
    return _lift(trace.z_mm, trace.z_measured_mm, printer)


def _lift(z_mm: np.ndarray, measured_mm: np.ndarray, printer: Printer) -> Lift:
    """Learn how the screw lifts."""
    lead_mm = printer.z.mm_per_turn
    span_mm = float(np.ptp(z_mm[np.isfinite(measured_mm)]))
    gaps: dict[str, str] = {}
    if span_mm < LEAST_TURNS * lead_mm:
        gaps["lead"] = too_low("lead-and-unevenness", span_mm, lead_mm)
    else:
        _check_follows(z_mm, measured_mm)
    height = fit_height(z_mm, measured_mm, printer, turns="lead" not in gaps)
    spreads = np.array([height.sds[0], *np.repeat(_sizes(height.sds[1:]) / np.sqrt(2), 2)])
    terms, known = height.terms, {}
    for kind, sd_mm in (("lead", float(spreads[0] * span_mm)), ("periodic", float(spreads[1]))):
        if "lead" in gaps:
            continue
        own = terms[:1] if kind == "lead" else terms[1:]
        if not own.any() and sd_mm > HEALTHY_SD_MM:
            gaps[kind] = say("z-told-mm-only-measure-more", say(f"z-{kind}"), f"{sd_mm:.2f}")
        else:
            known[kind] = _of_lead(own, height.sds, spreads) if kind == "lead" else _of_waves(own, height.sds, spreads)
    if _comes_back(z_mm, measured_mm):
        backlash_mm = height.backlash_mm
        sd = height.backlash_sd_mm
        said = say("z-has-backlash", amount(backlash_mm, sd)) if backlash_mm else ""
        faults = (Fault("z", "backlash", backlash_mm, sd, "mm", said),) if backlash_mm else ()
        known["backlash"] = Quantity(np.array([backlash_mm]), said, faults, sd)
    else:
        gaps["backlash"] = say("z-backlash-no-height-measured-after")
    return Lift(known, gaps)


def _of_lead(terms: np.ndarray, sds: np.ndarray, spreads: np.ndarray) -> Quantity:
    percent, sd = 100 * float(terms[0]), 100 * float(sds[0])
    if not percent:
        return Quantity(terms, sd=100 * float(spreads[0]))
    said = say("z-lead-too-long" if percent > 0 else "z-lead-too-short", amount(abs(percent), sd, "%"))
    return Quantity(terms, said, (Fault("z", "lead", percent, sd, "%", said),), 100 * float(spreads[0]))


def _of_waves(terms: np.ndarray, sds: np.ndarray, spreads: np.ndarray) -> Quantity:
    each = ((k, size, float(sds[2 * k])) for k, size in enumerate(_sizes(terms), 1))
    waved = [(k, size, sd) for k, size, sd in each if size > max(NAMED_SIGMAS * sd, LEAST["mm"])]
    if not waved:
        return Quantity(terms, sd=float(spreads[1]))
    often = {1: "once-a-turn", 2: "twice-a-turn"}
    said = say("z-lifts-unevenly", together(" / ", [say(often[k], amount(size, sd)) for k, size, sd in waved]))
    faults = tuple(Fault("z", f"periodic-{k}", float(size), sd, "mm", said) for k, size, sd in waved)
    return Quantity(terms, said, faults, float(spreads[1]))


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


def is_gap_of_z(gap: str) -> bool:
    """Say whether a gap of a trace is one of Z, which a tower shows and no flat print."""
    return is_one_of(gap, _GAPS)


def too_low(what: str, span_mm: float, lead_mm: float) -> str:
    """Say that heights span too little to tell something of Z."""
    return say("z-heights-span-mm-turn-screw", say(f"z-{what}"), f"{span_mm:.1f}", f"{lead_mm:g}")


def _comes_back(z_mm: np.ndarray, measured_mm: np.ndarray) -> bool:
    """Tell whether a height was measured after the nozzle came down to it."""
    return bool((last_way(z_mm)[np.isfinite(measured_mm)] < 0).any())


def _sizes(terms: np.ndarray) -> np.ndarray:
    """Return the amplitude of each harmonic of (a_1, b_1, a_2, …)."""
    return np.hypot(terms[::2], terms[1::2])
