"""The provenance of a G-code file: which model mended it, and whether it has changed since.

`printmend mend` ends a text file with a *seal*, a keyed hash of all before it; the key is the model's whole digest.
The mark at the top shows only the digest's first 16 digits, so nobody without the model can write a seal. `printmend
probe` seals its test prints, too, with a key that everyone has: it tells that nothing was changed since. A host keeps
a *record* of each file that it had mended in a `Ledger`, by the hash of the result: renaming, copying and uploading
again change nothing. From both follows the *state* of a file that is about to be printed.

Hosts load this one file by itself: the standard library only, and Python 3.7.
"""

from __future__ import annotations

import hashlib
import hmac
import json
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

MENDED = b"; mended by printmend "
MARK = re.compile(rb"(?:^|\r)(?:\xef\xbb\xbf)?" + MENDED + rb"(\S+) model=(\S+)(?: e=([012])([01])\b)?", re.MULTILINE)
TEST_PRINT_MARK = re.compile(rb"^(?:\xef\xbb\xbf)?; printmend (probe|first layer): ", re.MULTILINE)
SEALED = b"; sealed by printmend "
SEAL = re.compile(rb"(?:^|(?<=[\r\n]))" + SEALED + rb"([0-9a-f]{32})(?=[\r\n]|$)")
COMMENTS = re.compile(rb"(?:[ \t]*(?:;[^\r\n]*)?(?:[\r\n]+|$))*")
HEAD_BYTES = 1 << 20  # in which the mark stands
TAIL_BYTES = 1 << 18  # in which the seal stands: some slicers add their settings as comments below it
CHUNK_BYTES = 1 << 20

CURRENT, STALE, FOREIGN, FORGED, UNMENDED = ("current", "stale", "foreign", "forged", "unmended")
TEST_PRINT_KEY = "printmend test print"  # of the seals of test prints, which belong to no model
TEST_PRINT = "test print"  # printed as it is: mended, it would measure the mended printer
CHOICES = {STALE: ("mend", "hold", "print"), FOREIGN: ("hold", "print"), FORGED: ("hold", "print"),
           UNMENDED: ("mend", "hold", "print")}  # fmt: skip
"""What the owner may choose to be done with a file of each state; the first is done where nothing was chosen."""

SENTENCES = {
    "current": ("This file was mended with the model in use.",
                "Diese Datei wurde mit dem aktuellen Modell korrigiert."),
    "unmended": ("This file was not mended for this printer.",
                 "Diese Datei wurde nicht für diesen Drucker korrigiert."),
    "earlier-file": ("This is the mended copy of an earlier file of that name.",
                     "Das ist die korrigierte Kopie einer früheren Datei dieses Namens."),
    "earlier-model": ("This file was mended with an earlier model; this printer was learned again since.",
                      "Diese Datei wurde mit einem früheren Modell korrigiert; der Drucker wurde seitdem neu gelernt."),
    "foreign": ("This file was mended with model {}, which is not this printer's.",
                "Diese Datei wurde mit dem Modell {} korrigiert, das nicht zu diesem Drucker gehört."),
    "forged": ("This file bears printmend's mark, but its contents are not what printmend wrote.",
               "Diese Datei trägt den Vermerk von printmend, aber ihr Inhalt stammt nicht von printmend."),
    "test-print": ("This test print shows the printer as it is, so it is not mended.",
                   "Dieser Testdruck zeigt den Drucker, wie er ist; er wird nicht korrigiert."),
    "no-test-print": (
        "This file says that it is a test print, but printmend did not write it so: write it again.",
        "Diese Datei gibt sich als Testdruck aus, aber printmend hat sie so nicht geschrieben: neu schreiben."),
    "no-original": ("The file that it was mended from is no longer kept; upload it again.",
                    "Die Originaldatei dazu ist nicht mehr vorhanden; bitte neu hochladen."),
    "not-printed": ("It is not printed ({}).", "Sie wird nicht gedruckt ({})."),
    "held": ("This file was not mended, so it is not printed: {}",
             "Diese Datei wurde nicht korrigiert und wird deshalb nicht gedruckt: {}"),
    "kept": ("kept as {}", "aufbewahrt als {}"),
    "stopped": ("The job was stopped.", "Der Auftrag wurde angehalten."),
    "again": ("Start it again when it is mended.", "Bitte neu starten, sobald sie korrigiert ist."),
    "interrupted": ("mending was interrupted; upload the file again",
                    "die Korrektur wurde unterbrochen; bitte die Datei neu hochladen"),
    "too-long": ("mending took longer than {} s", "die Korrektur dauerte länger als {} s"),
    "ended": ("printmend ended with {}", "printmend endete mit {}"),
    "no-mark": ("printmend wrote a file without its mark", "printmend hat eine Datei ohne seinen Vermerk geschrieben"),
    "cancelled": ("cancelled", "abgebrochen"),
    "deleted": ("the file was deleted", "die Datei wurde gelöscht"),
    "unreadable": ("The file could not be read.", "Die Datei konnte nicht gelesen werden."),
    "plugin": ("an error in the plugin: see {}", "ein Fehler im Plugin: siehe {}"),
    "square": ("a test square", "ein Testquadrat"),
}  # fmt: skip
"""What a host says of a file, in English and German, by id: not in the catalogue, as hosts load this one file."""


def said(language: str, name: str, *values: object) -> str:
    """Return a sentence in a language, "de…" for German, anything else for English."""
    return SENTENCES[name][language.startswith("de")].format(*values)


def speaking(language: str, environment: Mapping[str, str] = os.environ) -> dict[str, str]:
    """Return the environment of a printmend that says in that language why it did not mend."""
    spoken = {"LC_MESSAGES": "de" if language.startswith("de") else "en", "PYTHONUTF8": "1"}
    return {**{name: value for name, value in environment.items() if name != "LC_ALL"}, **spoken}


class NoModelError(ValueError):
    """There is no whole model at a path; the text says why."""


class Model(NamedTuple):
    """What identifies a model: its digest, the key of its seals, and its printer's name and geometry (a hash).

    A printer stays the same whatever its firmware's limits and its way of homing are.
    """

    digest: str
    key: str
    name: str
    printer: str


class Record(NamedTuple):
    """How a file came about: the SHA-256 of source and result, the model, its printer, and printmend's version.

    ``original`` is where the host keeps the source, ``promise`` what printmend said (RMS before and after). Sources
    that differ below a file's precision have one result: ``others`` are the hashes of those that were mended before.
    """

    source: str
    result: str
    model: str
    printer: str
    program: str
    original: str
    promise: dict[str, Any]
    others: Sequence[str] = ()


class Verdict(NamedTuple):
    """The state of a file, one sentence about it, its SHA-256, and its record where the host has one."""

    state: str
    sentence: str
    sha256: str
    record: Record | None = None


def plain_text(document: Mapping[str, Any]) -> bytes:
    """Return the bytes over which a document's digest goes."""
    return json.dumps(document, sort_keys=True, separators=(",", ":"), ensure_ascii=True).encode()


def seal_key(document: Mapping[str, Any]) -> str:
    """Return the key of a model's seals: the whole SHA-256 of its document, whose first 16 digits are its digest."""
    return hashlib.sha256(plain_text(document)).hexdigest()


def read_model(path: str) -> Model:
    """Return what identifies the model in a file. Raises `NoModelError`."""
    try:
        with open(path, encoding="utf-8-sig") as file:
            document = json.load(file)
        digest, printer = document.pop("digest"), dict(document["printer"])
    except OSError as error:
        raise NoModelError(f"{path}: {error.strerror or error}") from None
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise NoModelError(f"{path} is not a printer.mend.json") from None
    key = seal_key(document)
    if digest != key[:16]:
        raise NoModelError(f"{path} was changed or damaged: copy it again")
    geometry = {part: printer[part] for part in printer if part not in ("name", "homing", "limits")}
    return Model(key[:16], key, str(printer.get("name", "")), hashlib.sha256(plain_text(geometry)).hexdigest()[:16])


def sealed(texts: Iterable[bytes | memoryview], key: str) -> Iterator[bytes | memoryview]:
    """Yield the pieces of a file and, as its last line, their seal."""
    code, last = hmac.new(key.encode(), None, "sha256"), b"\n"
    for text in texts:
        code.update(text)
        last = (last + bytes(text[-2:]))[-2:]
        yield text
    ending = b"\r\n" if last == b"\r\n" else b"\r" if last.endswith(b"\r") else b"\n"
    if not last.endswith((b"\n", b"\r")):
        code.update(ending)
        yield ending
    yield SEALED + code.hexdigest()[:32].encode() + ending


def find_seal(path: str) -> tuple[int, bytes] | None:
    """Return where the seal of a file begins and its digits; None where there is none, or more than comments below."""
    with open(path, "rb") as file:
        size = file.seek(0, os.SEEK_END)
        start = file.seek(max(size - TAIL_BYTES, 0))
        tail = file.read()
    seals = list(SEAL.finditer(tail))
    if not seals or COMMENTS.fullmatch(tail, seals[-1].end()) is None:
        return None
    return start + seals[-1].start(), seals[-1][1]


def is_sealed(path: str, key: str, *, breathe: Callable[[], object] = lambda: None) -> bool:
    """Say whether a file is what printmend wrote with the model of that key; ``breathe`` is called between pieces."""
    place = find_seal(path)
    if place is None:
        return False
    left, digits = place
    code = hmac.new(key.encode(), None, "sha256")
    with open(path, "rb") as file:
        while left:
            piece = file.read(min(left, CHUNK_BYTES))
            if not piece:
                return False
            code.update(piece)
            left -= len(piece)
            if left:
                breathe()
    return hmac.compare_digest(code.hexdigest()[:32].encode(), digits)


def sealed_test_print(text: bytes) -> bytes:
    """Return a test print with its seal."""
    return b"".join(sealed([text], TEST_PRINT_KEY))


def claimed_test_print(path: str, head: bytes | None = None, *, breathe: Callable[[], object] = lambda: None) -> str:
    """Return `TEST_PRINT` for an unmended and unchanged test print, `FORGED` for a file that only claims to be one.

    An empty text for any other file. ``head`` is what `head_of` returns for it.
    """
    head = head_of(path) if head is None else head
    if TEST_PRINT_MARK.search(head) is None or MARK.search(head) is not None:
        return ""
    return TEST_PRINT if is_sealed(path, TEST_PRINT_KEY, breathe=breathe) else FORGED


def sha256_of(path: str) -> str:
    """Return the SHA-256 of a file."""
    code = hashlib.sha256()
    with open(path, "rb") as file:
        for piece in iter(lambda: file.read(CHUNK_BYTES), b""):
            code.update(piece)
    return code.hexdigest()


def head_of(path: str) -> bytes:
    """Return the part of a file in which the marks stand; nothing where it cannot be read."""
    try:
        with open(path, "rb") as file:
            return file.read(HEAD_BYTES)
    except OSError:
        return b""


def action(state: str, chosen: Mapping[str, str]) -> str:
    """Return what to do with a file of a state, "print", "hold" or "mend", as the owner chose."""
    if state not in CHOICES:
        return "print"
    wanted = chosen.get(state, "")
    return wanted if wanted in CHOICES[state] else CHOICES[state][0]


class Ledger:
    """The records of a host, in a folder: one file a result, and the models that it has had."""

    def __init__(self, folder: str, language: str = "en") -> None:
        """``language`` is that of the sentences, "de…" for German, anything else for English."""
        self._language = language
        self._records = os.path.join(folder, "records")
        self._models = os.path.join(folder, "models.json")
        self._hashes: dict[str, tuple[tuple[int, ...], str]] = {}

    def remember(self, model: Model) -> None:
        """Note that a model is this printer's."""
        known = self.known()
        if known.get(model.digest) != model:
            known[model.digest] = model
            _write(self._models, {digest: list(one) for digest, one in known.items()})

    def write(self, record: Record) -> None:
        """Keep a record, in place of one of the same result, whose sources it keeps."""
        before = self.find(record.result)
        others = () if before is None else {before.source, *before.others} - {record.source}
        record = record._replace(others=sorted(others))
        _write(self._place(record.result), {"format": "printmend record", "version": 1, **record._asdict()})

    def find(self, result: str) -> Record | None:
        """Return the record of a file by its SHA-256."""
        table = _read(self._place(result))
        try:
            record = Record(**{name: table[name] for name in Record._fields if name in table})
        except TypeError:
            return None
        return record if record.result == result and isinstance(record.promise, dict) else None

    def records(self) -> list[Record]:
        """Return all records."""
        names = os.listdir(self._records) if os.path.isdir(self._records) else []
        found = (self.find(name[: -len(".json")]) for name in sorted(names) if name.endswith(".json"))
        return [record for record in found if record is not None]

    def forget(self, record: Record) -> None:
        """Drop a record."""
        if os.path.exists(self._place(record.result)):
            os.unlink(self._place(record.result))

    def sha256(self, path: str) -> str:
        """Return the SHA-256 of a file; one that was not touched since is not read again."""
        at = os.stat(path)
        seen = (at.st_dev, at.st_ino, at.st_size, at.st_mtime_ns, at.st_ctime_ns)
        known = self._hashes.get(path)
        if known is None or known[0] != seen:
            known = self._hashes[path] = (seen, sha256_of(path))
        return known[1]

    def judge(self, path: str, model: Model | None, *, original: str | None = None) -> Verdict:
        """Return the state of a file for the printer of ``model``.

        ``original`` is what now stands where its source was; a copy of another one is stale. Without a model, as where
        another computer holds it, records are compared with the model of the last one. Raises `OSError`.
        """
        sha256 = self.sha256(path)
        if model is not None:
            self.remember(model)
        record = self.find(sha256)
        if record is not None:
            return self._by_record(record, model, original)
        head = head_of(path)
        mark = MARK.search(head)
        claim = claimed_test_print(path, head)
        if claim == TEST_PRINT:
            return Verdict(TEST_PRINT, self._say("test-print"), sha256)
        if claim == FORGED:
            return Verdict(FORGED, self._say("no-test-print"), sha256)
        if mark is None:
            return Verdict(UNMENDED, self._say("unmended"), sha256)
        return self._by_mark(path, mark[2].decode("ascii", "replace"), model, sha256)

    def _by_record(self, record: Record, model: Model | None, original: str | None) -> Verdict:
        in_use = self._last_model() if model is None else model.digest
        sources = (record.source, *record.others)
        if original is not None and os.path.isfile(original) and self.sha256(original) not in sources:
            return Verdict(STALE, self._say("earlier-file"), record.result, record)
        if record.model == in_use:
            return Verdict(CURRENT, self._say("current"), record.result, record)
        return Verdict(*self._other(record.model, record.printer, model), record.result, record)

    def _by_mark(self, path: str, digest: str, model: Model | None, sha256: str) -> Verdict:
        known = model if model is not None and model.digest == digest else self.known().get(digest)
        if known is None:
            return Verdict(*self._other(digest, None, model), sha256)
        if not is_sealed(path, known.key):
            return Verdict(FORGED, self._say("forged"), sha256)
        if model is not None and known.digest == model.digest:
            return Verdict(CURRENT, self._say("current"), sha256)
        return Verdict(*self._other(digest, known.printer, model), sha256)

    def _say(self, name: str, *values: str) -> str:
        return said(self._language, name, *values)

    def _other(self, digest: str, printer: str | None, model: Model | None) -> tuple[str, str]:
        """Return state and sentence of a file of another model than the one in use."""
        if printer is not None and (model is None or printer == model.printer):
            return STALE, self._say("earlier-model")
        return FOREIGN, self._say("foreign", digest)

    def known(self) -> dict[str, Model]:
        """Return the models that the printer has had, by their digests."""
        return {digest: Model(*one) for digest, one in _read(self._models).items()
                if isinstance(one, list) and len(one) == len(Model._fields)}  # fmt: skip

    def _last_model(self) -> str:
        """Return the digest of the model that the latest record names."""
        try:
            names = [os.path.join(self._records, name) for name in os.listdir(self._records)]
        except OSError:
            return ""
        latest = max(names, key=os.path.getmtime, default=None)
        return "" if latest is None else str(_read(latest).get("model", ""))

    def _place(self, result: str) -> str:
        return os.path.join(self._records, os.path.basename(result) + ".json")


def record_of(source: str, result: str, model: Model | None, *, original: str, report: Mapping[str, Any]) -> Record:
    """Return the record of a file that was just mended from ``source`` into ``result``; ``report`` is printmend's.

    The model is the one that the result's mark names: another computer may have mended it with a newer one.
    """
    mark = MARK.search(head_of(result))
    digest = mark[2].decode("ascii", "replace") if mark is not None else model.digest if model is not None else ""
    program = mark[1].decode("ascii", "replace") if mark is not None else ""
    promise = {key: report[key] for key in ("before", "after", "warnings") if key in report}
    printer = "" if model is None else model.printer
    return Record(sha256_of(source), sha256_of(result), digest, printer, program, original, promise)


def _read(path: str) -> dict[str, Any]:
    """Return a table of JSON; an empty one where there is none, or a kill left half of it."""
    try:
        with open(path, encoding="utf-8") as file:
            table = json.load(file)
    except (OSError, ValueError):
        return {}
    return table if isinstance(table, dict) else {}


def _write(path: str, table: Mapping[str, Any]) -> None:
    """Write a table in one step, for its owner only."""
    os.makedirs(os.path.dirname(path), exist_ok=True)
    beside = f"{path}.{os.getpid()}.tmp"
    with open(os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "w", encoding="utf-8") as file:
        json.dump(table, file, indent=1)
    os.replace(beside, path)
