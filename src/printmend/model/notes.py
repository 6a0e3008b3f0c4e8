"""The notes of a saved model about its measurement, and its findings about what it does not fit.

Each note and the values that it may have are in one table, checked in one place. The section ``misfit`` holds
``found``, a list of findings with their words and their weight.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from printmend.messages import Said, say
from printmend.model.values import LARGEST, refuse
from printmend.path import DOUBTS

MAX_FADING = 32  # the highest harmonic of a wave that fades along the axis; what is learned goes up to 5


@dataclass(frozen=True)
class Numbers:
    """A number from ``low`` to ``high``, a ``whole`` one, or a list of at most ``most`` of them."""

    low: float = -LARGEST
    high: float = LARGEST
    whole: bool = False
    most: int | None = None

    @property
    def words(self) -> str:
        """Return in words which values are allowed."""
        kind = "whole number" if self.whole else "number"
        span = f"from {self.low:g} to {self.high:g}"
        return f"a {kind} {span}" if self.most is None else f"a list of at most {self.most} {kind}s {span}"

    def holds(self, value: Any) -> bool:
        """Say whether a value is one of them."""
        if self.most is not None:
            is_list = isinstance(value, list) and len(value) <= self.most
            return is_list and all(map(Numbers(self.low, self.high, self.whole).holds, value))
        if isinstance(value, bool) or not isinstance(value, int | float) or not self.low <= value <= self.high:
            return False
        return not self.whole or value == int(value)


_SIZE, _COUNT = Numbers(low=0.0), Numbers(0, 1e9, whole=True)
_FADING = Numbers(1, MAX_FADING, whole=True, most=MAX_FADING)
# A dict gives the shape of each key; a key with "!" is required, "*" stands for every other one. Keys that are not
# named are for readers and may hold anything. A list gives the shape of its entries.
_NOTES: dict[str, Any] = {
    "diagnosis": [{"part!": str, "kind!": str, "unit!": str, "value!": Numbers(), "sd!": Numbers()}],
    "z": {"*": str},
    "trace": {"rows": _COUNT, "measured": _COUNT, "residual_before_mm": _SIZE, "residual_after_mm": _SIZE},
    "motors": {"*": {"elastic": {"harmonics": _FADING}}},
    "promise": {"instrument": dict.fromkeys(DOUBTS, _SIZE)},
}  # fmt: skip


def check_notes(document: Mapping[str, Any], subject: str) -> None:
    """Raise `ModelError` for notes that printmend never writes."""
    _check(document, _NOTES, "the model", subject)


def _check(value: Any, shape: Any, name: str, subject: str) -> None:
    """Raise `ModelError` unless ``value``, under the key ``name``, has the ``shape``."""
    if isinstance(shape, Numbers):
        if not shape.holds(value):
            refuse(subject, say("for", shape.words, name), repr(value)[:40])
        return
    kind: type[Any] = shape if isinstance(shape, type) else type(shape)
    if not isinstance(value, kind):
        refuse(subject, say("as-2", name, kind.__name__), say("none") if value is None else repr(value)[:40])
    if isinstance(shape, list):
        for each in value:
            _check(each, shape[0], f"an entry of {name}", subject)
    elif isinstance(shape, dict):
        value = dict(value)
        for key in (key for key in shape if key.endswith("!")):
            _check(value.get(key[:-1]), shape[key], key[:-1], subject)
        for key, held in value.items():
            if (wanted := shape.get(key, shape.get("*"))) is not None:
                _check(held, wanted, key, subject)


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
    return tuple(
        say(each["severity"], each["words"])
        for each in found_in(document)
        if each.get("severity") in SEVERITIES and "words" in each
    )


def found_in(document: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the findings of a model's document as plain values."""
    section = document.get("misfit")
    found = section.get("found", []) if isinstance(section, dict) else []
    return [each for each in found if isinstance(each, dict)]


def said_of(document: Mapping[str, Any], kind: str) -> tuple[str, ...]:
    """Return the sentences about one kind of misfit in a model's document."""
    return tuple(each["words"] for each in found_in(document) if each.get("kind") == kind)


def refusals(document: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the refusals in a model's document, a sentence each: reasons not to mend with it."""
    return tuple(each["words"] for each in found_in(document) if each.get("severity") == REFUSAL)
