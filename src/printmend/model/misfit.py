"""Findings about what the model does not fit: their words, their weight, and their place in the saved model.

The section ``misfit`` of a model holds ``found``, a list of these findings.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from printmend.messages import Said, say

NOTE, WARNING, REFUSAL = "note", "warning", "refusal"
SEVERITIES = (NOTE, WARNING, REFUSAL)
REFITTED = "refitted"  # the kind of the refusal in a model whose belts were worked on
PHASE_TODO = say("print-printmend-probe-phase-measure-run")


@dataclass(frozen=True)
class Misfit:
    """One finding about a measurement that the model does not fit.

    ``kind`` names it for programs, ``words`` for the owner. ``size_mm`` is its RMS effect on a print; ``evidence`` is
    its weight in nats over chance.
    """

    kind: str
    severity: str
    size_mm: float
    evidence: float
    words: str


def misfit_section(found: Sequence[Misfit]) -> dict[str, Any]:
    """Return findings as the plain values of a saved model's section ``misfit``."""
    ordered = sorted(found, key=lambda each: -SEVERITIES.index(each.severity))
    rounded = [
        {key: round(value, 4) if isinstance(value, float) else value for key, value in asdict(each).items()}
        for each in ordered
    ]
    return {"found": rounded}


def misfit_words(document: Mapping[str, Any]) -> tuple[Said, ...]:
    """Return the sentences about misfits in a model's document, the gravest first; the id of each is its severity."""
    section = document.get("misfit")
    found = section.get("found", []) if isinstance(section, dict) else []
    return tuple(
        say(each["severity"], each["words"])
        for each in found
        if isinstance(each, dict) and each.get("severity") in SEVERITIES and "words" in each
    )


def said_of(document: Mapping[str, Any], kind: str) -> tuple[str, ...]:
    """Return the sentences about one kind of misfit in a model's document."""
    section = document.get("misfit")
    found = section.get("found", []) if isinstance(section, dict) else []
    return tuple(each["words"] for each in found if isinstance(each, dict) and each.get("kind") == kind)


def refusals(document: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the refusals in a model's document, a sentence each: reasons not to mend with it."""
    section = document.get("misfit")
    found = section.get("found", []) if isinstance(section, dict) else []
    return tuple(each["words"] for each in found if isinstance(each, dict) and each.get("severity") == REFUSAL)
