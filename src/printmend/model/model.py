"""printer.mend.json: a learned machine as readable, versioned JSON.

The document holds the printer, one section for each motor (its fault as a short series with uncertainties, or as
tables), the frame, the noise, a summary of the trace and a digest of all that. Reading checks everything and ends in
a `ModelError`; nothing in the file is ever executed.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from printmend import __version__
from printmend.errors import ConfigError, ModelError
from printmend.files import read_text, replacing
from printmend.machine import Frame, Mechanism, Transmission, healthy_transmission
from printmend.machine.kernels.bed import MOST_WAVES, WAVE_FIELDS
from printmend.messages import Said, messages_of, restored, say
from printmend.model.branches import (
    LARGEST,
    TODO,
    Branches,
    ScrewSeries,
    Wave,
    number,
    numbers,
    parse_screw,
    parse_series,
    refuse,
    rising_pair,
    rounded,
    screw_section,
    section_of,
)
from printmend.path import DOUBTS
from printmend.printer import Printer
from printmend.printer.toml import parse_printer, printer_section
from printmend.provenance import seal_key

# The notes of a saved model about its measurement, and its findings about what it does not fit.
#
# Each note and the values that it may have are in one table, checked in one place. The section ``misfit`` holds
# ``found``, a list of findings with their words and their weight.

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
    "promise": {"instrument": dict.fromkeys(DOUBTS, _SIZE), "parts": [{"effect!": str}]},
    "misfit": {"found!": [{"kind!": str, "severity!": str, "words!": str}]},
    "measurements": [str],
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
DIGESTS = "measurements"  # the document's key of what tells the measurements that a model was learned from
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
    return tuple(say(each["severity"], each["words"]) for each in found_in(document) if each["severity"] in SEVERITIES)


def found_in(document: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the findings of a model's document as plain values."""
    return list(document.get("misfit", {"found": []})["found"])


def said_of(document: Mapping[str, Any], kind: str) -> tuple[str, ...]:
    """Return the sentences about one kind of misfit in a model's document."""
    return tuple(each["words"] for each in found_in(document) if each["kind"] == kind)


def refusals(document: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the refusals in a model's document, a sentence each: reasons not to mend with it."""
    return tuple(each["words"] for each in found_in(document) if each["severity"] == REFUSAL)


FORMAT = "printmend model"
VERSION = 1
LEAST_WAVE_MM = 2.0  # length of a frame's wave: a shorter one is no bend
MAX_ENTRIES = 1_000_000  # entries of one table that a file may have; 500 mm by sixteenths of a 0.2 mm step are 40 000
# Entries of one table that are written: of a printer with finer or more micro-steps every n-th, for four tables are a
# file of 17 MB then.
MOST_WRITTEN = 250_000
DIGITS = 16  # of a document's digest
MAX_HARMONICS, MAX_POWERS = 1024, 8  # harmonics and powers of a wave that a file may have


@dataclass(frozen=True, eq=False)
class SavedModel:
    """A learned machine and its document.

    ``mechanism`` is absolute: its tables give bed positions, so never anchor it again with `Mechanism.homed`.
    ``document`` is the JSON as written, without the digest, and ``seal_key`` the hexadecimal digits over it. With a
    ``filament``, the mechanism includes the shrinkage of parts in it; the document is the machine's alone. ``called``
    is how a command line names its file.
    """

    mechanism: Mechanism
    learner: str
    seal_key: str
    document: Mapping[str, Any] = field(repr=False)
    filament: str | None = None
    called: str = "MODEL"

    @property
    def digest(self) -> str:
        """The 16 digits by which a model is named."""
        return self.seal_key[:DIGITS]

    @property
    def printer(self) -> Printer:
        return self.mechanism.printer

    @property
    def is_healthy(self) -> bool:
        """True where the model changes nothing: both motors, the frame and Z are as designed."""
        motors, level = self.document["motors"].values(), self.mechanism.frame.is_identity
        return level and self.mechanism.screw is None and all(section["kind"] == "healthy" for section in motors)

    @property
    def noise_mm(self) -> float:
        """The standard deviation of the measured points about the model [mm]."""
        return float(self.document["noise_mm"])

    @property
    def summary(self) -> dict[str, Any]:
        """The document without the machine's numbers: learner, findings, noise, diagnosis, misfits and trace.

        ``healthy``: nothing is to mend, and nothing graver than a note was found.
        """
        keys = ("learner", "findings", "noise_mm", "diagnosis", "trace")
        misfit = found_in(self.document)
        is_healthy = self.is_healthy and all(each["severity"] == NOTE for each in misfit)
        told = {key: self.document[key] for key in keys if key in self.document}
        return {"healthy": is_healthy, **told, "misfit": misfit}

    @property
    def findings(self) -> tuple[str, ...]:
        """One sentence for each finding, and for each thing that the trace did not show."""
        return tuple(self.document["findings"])


def saved_model(
    mechanism: Mechanism,
    *,
    learner: str,
    branches: tuple[Branches | None, Branches | None] = (None, None),
    noise_mm: float = 0.0,
    findings: tuple[str, ...] = (),
    details: Mapping[str, Any] | None = None,
) -> SavedModel:
    """Make the document of a machine.

    A motor with ``branches`` is saved as its series, another as its tables. ``details`` are further keys for the
    reader (uncertainties, the trace, trees); they are kept and digested, not interpreted.
    """
    motors = {}
    for motor, name in enumerate(mechanism.printer.motors):
        series = branches[motor]
        motors[name] = _table_section(mechanism, motor) if series is None else _series_section(series)
    document: dict[str, Any] = {
        "format": FORMAT,
        "version": VERSION,
        "program": __version__,
        "learner": learner,
        "printer": printer_section(mechanism.printer),
        "motors": motors,
        "frame": None if mechanism.frame.is_identity else _frame_section(mechanism.frame),
        **({} if mechanism.screw is None else {"screw": screw_section(mechanism.screw)}),
        "noise_mm": rounded(noise_mm),
        "findings": list(findings),
        **(details or {}),
    }
    return _through_text(document)


def with_screw(
    model: SavedModel, screw: ScrewSeries | None, *, findings: tuple[str, ...], details: Mapping[str, Any]
) -> SavedModel:
    """Return the model with another Z, other ``findings``, and with ``details`` added or replaced."""
    document = {key: value for key, value in model.document.items() if key != "screw"}
    document |= {"findings": list(findings), **details}
    if screw is not None:
        document["screw"] = screw_section(screw)
    return _through_text(document)


def exact_model(mechanism: Mechanism) -> SavedModel:
    """Return the model of a machine that is known exactly, anchored by homing; for tests and benchmarks."""
    return saved_model(mechanism.homed(), learner="exact")


def write_model(path: str | Path, model: SavedModel) -> None:
    """Write ``printer.mend.json``; a kill leaves the old file or the new one."""
    with replacing(Path(path)) as file:
        file.write(model_text(model))


def model_text(model: SavedModel) -> str:
    """Return the file's text, which `parse_model` reads back to the same machine."""
    return _text(dict(model.document))


def read_model(path: str | Path) -> SavedModel:
    """Read a model. Raise `ModelError` for anything but a whole, unchanged model of printmend's."""
    text = read_text(path, wanted=say("printer-mend-json"), todo=TODO, error=ModelError)
    return parse_model(text, subject=str(path))


def parse_model(text: str, *, subject: str) -> SavedModel:
    """Build a model from JSON text; ``subject`` names the source in errors."""
    try:
        is_one = text.lstrip().startswith("{")
        document = is_one and json.loads(text, parse_constant=lambda name: refuse(subject, say("finite-numbers"), name))
    except (ValueError, RecursionError) as error:
        came = say("endless-nesting" if isinstance(error, RecursionError) else "broken-json")
        if isinstance(error, json.JSONDecodeError):
            came = say("broken-json-at", error.lineno, error.colno)
        raise ModelError(subject, wanted=say("printer-mend-json"), came=came, todo=TODO) from None
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise ModelError(
            subject, wanted=say("printer-mend-json"), came=say("another-kind-file"), todo=say("give-learned-model")
        )
    version = document.get("version")
    if not isinstance(version, int) or isinstance(version, bool) or version < 1:
        refuse(subject, say("version-2"), repr(version))
    if version > VERSION:
        raise ModelError(
            subject,
            wanted=say("model-version-older", VERSION),
            came=say("version-written-printmend", version, document.get("program", "unknown")),
            todo=say("update-printmend-learn-model-again"),
        )
    digest = document.pop("digest", None)
    key = seal_key(document)
    if digest != key[:DIGITS]:
        refuse(subject, say("digest-that-fits"), say("file-changed-or-damaged"))
    return _read(document, key, subject)


def _through_text(document: Mapping[str, Any]) -> SavedModel:
    """Return the model that a reader of the document's text will get."""
    document = {key: value for key, value in document.items() if key != "messages"}
    if messages := messages_of(document):
        document["messages"] = messages
    document = json.loads(json.dumps(document, allow_nan=False))
    return _read(document, seal_key(document), "the model")


def _read(document: Mapping[str, Any], key: str, subject: str) -> SavedModel:
    """Check a whole document, with its seals' ``key``, and build the model; raise `ModelError` for a bad value."""
    printer = _printer(section_of(document, "printer", dict, subject), subject)
    sections = section_of(document, "motors", dict, subject)
    if sorted(sections) != sorted(printer.motors):
        refuse(subject, say("motors", " and ".join(printer.motors)), ", ".join(map(str, sections)) or say("none"))
    tables = [_transmission(sections[name], printer, i, f"{subject} [{name}]") for i, name in enumerate(printer.motors)]
    frame = document.get("frame")
    screw = None if document.get("screw") is None else parse_screw(document["screw"], printer, f"{subject} [screw]")
    mechanism = Mechanism(printer, (tables[0], tables[1]), Frame() if frame is None else _frame(frame, subject), screw)
    learner = section_of(document, "learner", str, subject)
    noise_mm = number(document, "noise_mm", subject)
    findings = section_of(document, "findings", list, subject)
    if noise_mm < 0 or not all(isinstance(line, str) for line in findings):
        refuse(subject, say("noise-mm-0-findings-text"), say("something-else"))
    check_notes(document, subject)
    messages = document.get("messages")
    return SavedModel(mechanism, learner, key, restored(document, messages if isinstance(messages, dict) else {}))


def branches_of(model: SavedModel, motor: int) -> Branches | None:
    """Return a motor's series, None where the model keeps it as tables."""
    name = model.printer.motors[motor]
    section = model.document["motors"][name]
    if section["kind"] == "table":
        return None
    return _branches(section, model.printer, motor, f"the model [{name}]")


def screw_of(model: SavedModel) -> ScrewSeries | None:
    """Return the series of Z, None for a model without one."""
    section = model.document.get("screw")
    return None if section is None or section["kind"] != "series" else parse_series(section, "the model [screw]")


def _text(document: Mapping[str, Any]) -> str:
    return _laid_out({**document, "digest": seal_key(document)[:DIGITS]}, "\n") + "\n"


def _laid_out(value: Any, line: str) -> str:
    """Return JSON as `json.dumps` with an indent of 1 lays it out; ``line`` begins a line of the surroundings.

    With an indent the library takes its slow encoder, which needs four times as long for tables. Here a list of numbers
    takes the fast one, with line ends as separators.
    """
    inside = line + " "
    if isinstance(value, dict) and value:
        parts = [f"{json.dumps(key, ensure_ascii=False)}: {_laid_out(item, inside)}" for key, item in value.items()]
        return "{" + inside + ("," + inside).join(parts) + line + "}"
    if isinstance(value, list | tuple) and value:
        if set(map(type, value)) <= {int, float}:
            text = json.dumps(value, allow_nan=False, separators=("," + inside, ": "))[1:-1]
        else:
            text = ("," + inside).join(_laid_out(item, inside) for item in value)
        return "[" + inside + text + line + "]"
    return json.dumps(value, ensure_ascii=False, allow_nan=False)


def _table_section(mechanism: Mechanism, motor: int) -> dict[str, Any]:
    table = mechanism.transmissions[motor]
    healthy = healthy_transmission(mechanism.printer, motor)
    grid = table.motor_mm
    if np.array_equal(table.lower_mm, grid) and table.is_taut:
        return {"kind": "healthy"}
    every = -(-len(grid) // MOST_WRITTEN)
    pitch_mm = every * table.pitch_mm
    section: dict[str, Any] = {"kind": "table", "first_mm": table.first_mm, "pitch_mm": pitch_mm}
    if table.first_mm == healthy.first_mm and table.pitch_mm == healthy.pitch_mm:
        grid = healthy.motor_mm
    section["lower_error_mm"] = rounded((table.lower_mm - grid)[::every])
    if not table.is_taut:
        section["upper_error_mm"] = rounded((table.upper_mm - grid)[::every])
    return section


def _series_section(branches: Branches) -> dict[str, Any]:
    if branches.is_healthy:
        return {"kind": "healthy"}
    section: dict[str, Any] = {
        "kind": "series",
        "period_mm": branches.period_mm,
        "middle_mm": branches.middle_mm,
        "reach_mm": [rounded(value) for value in branches.reach_mm],
    }
    for name in ("mean", "play", "elastic"):
        wave: Wave = getattr(branches, name)
        if not wave.is_zero:
            section[name] = _wave_section(wave)
    if branches.warp_mm.any():
        section["warp"] = {
            "first_mm": branches.warp_span_mm[0],
            "last_mm": branches.warp_span_mm[1],
            "cos_mm": rounded(branches.warp_mm),
        }
    if not branches.second.is_zero:
        section["second"] = {"period_mm": branches.second_mm, **_wave_section(branches.second)}
    return section


def _wave_section(wave: Wave) -> dict[str, Any]:
    return {
        "powers_mm": rounded(wave.powers_mm),
        "harmonics": wave.harmonics.tolist(),
        "cos_mm": rounded(wave.cos_mm),
        "sin_mm": rounded(wave.sin_mm),
    }


def _frame_section(frame: Frame) -> dict[str, Any]:
    x_mm, y_mm = frame.coefficients_mm
    waves = {"waves": rounded(frame.waves)} if len(frame.waves) else {}
    return {"scale_mm": frame.scale_mm, "x_mm": rounded(x_mm), "y_mm": rounded(y_mm), **waves}


def _printer(table: dict[str, Any], subject: str) -> Printer:
    try:
        return parse_printer(tomli_w.dumps(table), subject=f"{subject} [printer]")
    except ConfigError as error:
        raise ModelError(error.subject, wanted=error.wanted, came=error.came, todo=TODO) from None
    except (TypeError, ValueError, RecursionError):
        refuse(f"{subject} [printer]", say("printer"), say("values-no-known-kind"))


def _transmission(section: Any, printer: Printer, motor: int, subject: str) -> Transmission:
    if not isinstance(section, dict):
        refuse(subject, say("section-3"), repr(section)[:40])
    if section.get("kind") != "table":
        return _branches(section, printer, motor, subject).lower(printer, motor)
    lower = numbers(section, "lower_error_mm", subject, MAX_ENTRIES)
    upper = lower if "upper_error_mm" not in section else numbers(section, "upper_error_mm", subject, MAX_ENTRIES)
    first_mm, pitch_mm = number(section, "first_mm", subject), number(section, "pitch_mm", subject)
    if pitch_mm <= 0 or len(lower) != len(upper) or len(lower) < 2:
        refuse(subject, say("positive-pitch-mm-tables-length"), say("something-else"))
    healthy = healthy_transmission(printer, motor)
    same = len(lower) == len(healthy.lower_mm) and (first_mm, pitch_mm) == (healthy.first_mm, healthy.pitch_mm)
    grid = healthy.motor_mm if same else first_mm + pitch_mm * np.arange(len(lower))
    table = Transmission(first_mm, pitch_mm, grid + lower, grid + upper)
    lower_mm, upper_mm = rising_pair(table.lower_mm, table.upper_mm, subject)
    return replace(table, lower_mm=lower_mm, upper_mm=upper_mm)


def _branches(section: dict[str, Any], printer: Printer, motor: int, subject: str) -> Branches:
    kind = section.get("kind")
    low_mm, high_mm = printer.motor_range_mm(motor)
    if kind == "healthy":
        return Branches(printer.axes[motor].mm_per_turn, (low_mm + high_mm) / 2, (low_mm, high_mm))
    if kind != "series":
        refuse(subject, say("kind-healthy-series-table"), repr(kind)[:40])
    reach = numbers(section, "reach_mm", subject, 2)
    period_mm = number(section, "period_mm", subject)
    if len(reach) != 2 or reach[0] > reach[1] or period_mm <= 0:
        refuse(subject, say("positive-period-mm-two-reach-mm"), say("something-else"))
    waves: dict[str, Any] = {
        name: _wave(section[name], f"{subject} {name}") for name in ("mean", "play", "elastic") if name in section
    }
    middle_mm, seen_mm = number(section, "middle_mm", subject), (float(reach[0]), float(reach[1]))
    plain = Branches(period_mm, middle_mm, seen_mm, **waves)
    if "second" in section:
        second, of_second = section_of(section, "second", dict, subject), f"{subject} second"
        second_mm = number(second, "period_mm", of_second)
        if second_mm <= 0:
            refuse(of_second, say("positive-period-mm"), f"{second_mm:g}")
        plain = replace(plain, second=_wave(second, of_second), second_mm=second_mm)
    if "warp" not in section:
        return plain
    warp = section_of(section, "warp", dict, subject)
    span_mm = (number(warp, "first_mm", subject), number(warp, "last_mm", subject))
    cos_mm = numbers(warp, "cos_mm", subject, MAX_HARMONICS)
    if span_mm[0] >= span_mm[1]:
        refuse(subject, say("warp-first-mm-below-last-mm"), say("and", f"{span_mm[0]:g}", f"{span_mm[1]:g}"))
    return replace(plain, warp_mm=cos_mm, warp_span_mm=span_mm)


def _wave(section: Any, subject: str) -> Wave:
    if not isinstance(section, dict):
        refuse(subject, say("section-3"), repr(section)[:40])
    harmonics = numbers(section, "harmonics", subject, MAX_HARMONICS)
    cos_mm, sin_mm = (numbers(section, name, subject, MAX_HARMONICS) for name in ("cos_mm", "sin_mm"))
    whole = (harmonics == np.rint(harmonics)).all() and (harmonics >= 1).all()
    if not len(harmonics) == len(cos_mm) == len(sin_mm) or not whole:
        refuse(subject, say("positive-whole-harmonics-many-cos-mm"), say("something-else"))
    return Wave(numbers(section, "powers_mm", subject, MAX_POWERS), harmonics.astype(np.int64), cos_mm, sin_mm)


def _frame(section: Any, subject: str) -> Frame:
    subject = f"{subject} [frame]"
    if not isinstance(section, dict):
        refuse(subject, say("section-3"), repr(section)[:40])
    terms = len(Frame.exponents)
    rows = [numbers(section, name, subject, terms) for name in ("x_mm", "y_mm")]
    scale_mm = number(section, "scale_mm", subject)
    if any(len(row) != terms for row in rows) or scale_mm <= 0:
        refuse(subject, say("ten-coefficients-row-positive-scale-mm"), say("something-else"))
    waves = section.get("waves", [])
    if not isinstance(waves, list) or len(waves) > MOST_WAVES:
        refuse(subject, say("most-waves", MOST_WAVES), say("something-else"))
    each = [numbers({"wave": wave}, "wave", subject, WAVE_FIELDS) for wave in waves]
    if any(len(wave) != WAVE_FIELDS or abs(wave[0]) > 1 or wave[1] < LEAST_WAVE_MM for wave in each):
        refuse(subject, say("waves-direction-least-mm-four-sizes", f"{LEAST_WAVE_MM:g}"), say("something-else"))
    return Frame(np.array(rows), scale_mm, np.array(each).reshape(-1, WAVE_FIELDS))
