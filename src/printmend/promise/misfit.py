"""What does not fit: a finding in an owner's words, how much it matters, and its place in the saved model.

The section ``misfit`` of a model holds ``found``, a list of these findings, and ``unexplained``: cause → what it may
add to the error of a new print, which `promise.budget` reads.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

NOTE, WARNING, REFUSAL = "note", "warning", "refusal"
SEVERITIES = (NOTE, WARNING, REFUSAL)


@dataclass(frozen=True)
class Misfit:
    """One thing that does not fit.

    ``kind`` names it for programs; ``size_mm`` is what it does to a print, root mean square; ``evidence`` how sure it
    is, in nats over chance; ``words`` say it to an owner; ``left_mm`` is what of it no model takes out, so that it
    stays in every new print, with its standard deviation ``left_sd_mm``.
    """

    kind: str
    severity: str
    size_mm: float
    evidence: float
    words: str
    left_mm: float = 0.0
    left_sd_mm: float = 0.0


def misfit_section(found: Sequence[Misfit]) -> dict[str, Any]:
    """Return findings as the plain values of a saved model's section ``misfit``."""
    ordered = sorted(found, key=lambda each: -SEVERITIES.index(each.severity))
    rounded = [
        {key: round(value, 4) if isinstance(value, float) else value for key, value in asdict(each).items()}
        for each in ordered
    ]
    for each in rounded:
        del each["left_mm"], each["left_sd_mm"]
    left = {
        each.kind: {"rms_mm": round(each.left_mm, 5), "sd_mm": round(each.left_sd_mm, 5)}
        for each in ordered
        if each.left_mm > 0
    }
    return {"found": rounded, "unexplained": left}


def misfit_words(document: Mapping[str, Any]) -> tuple[str, ...]:
    """Return what a model's document says of misfits, a sentence each, the gravest first."""
    section = document.get("misfit")
    found = section.get("found", []) if isinstance(section, dict) else []
    return tuple(
        f"{each['severity']}: {each['words']}"
        for each in found
        if isinstance(each, dict) and {"severity", "words"} <= set(each)
    )
