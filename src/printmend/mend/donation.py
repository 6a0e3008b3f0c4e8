"""Pack an owner's measurements, models and checks into one zip file, for the people who improve printmend.

Each file is read, checked and written anew, with only the numbers and words that printmend itself writes. So the names
of files and folders, dates, notes and the metadata of pictures are left out. Names and times in the zip are fixed: the
same files make the same donation. Nothing is sent.
"""

import csv
import hashlib
import io
import json
import math
import re
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from printmend import __version__
from printmend.errors import InputError, TraceError
from printmend.files import read_text, replacing
from printmend.measure.plan import plan_text, read_plan
from printmend.measure.table import KNOWN, ORIGIN, REQUIRED
from printmend.mend.history import MEASUREMENT, history_of, read_history
from printmend.messages import say, say_count
from printmend.model.model import model_text, parse_model, read_model
from printmend.printer import preset_names, read_printer
from printmend.printer.printer import printers_named

FORMAT, VERSION = "printmend donation", 1
MOST_BYTES = 400_000_000  # most bytes of a donation's files together; a scan of A4 at 600 dpi has some 50 million
MOST_PICTURES = 12
DAY_S = 86400.0
_NOBODY = "a printer"
_TIME = (1980, 1, 1, 0, 0, 0)  # time of every file in the zip: the earliest that the format allows
_TOKEN = re.compile(r"[\w.+%°-]{1,40}|printmend model")
_KEY = re.compile(r"[a-z0-9_-]{1,40}")
# Keys whose values are words of printmend's own; under all other keys only numbers are kept.
_WORDS = {"effect", "event", "format", "home_side", "kind", "kinematics", "learner", "part", "program", "pulley",
          "result", "severity", "state", "switch", "unit"}  # fmt: skip
_MODEL = ("format", "version", "program", "learner", "printer", "motors", "frame", "screw", "noise_mm", "diagnosis",
          "trace", "promise", "misfit")  # fmt: skip


@dataclass(frozen=True)
class Part:
    """One file of a donation: its ``name`` there, ``what`` it is, its bytes, and what was ``left_out`` of it."""

    name: str
    what: str
    data: bytes
    left_out: tuple[str, ...] = ()


def donation(
    *, plan: Path | None = None, scans: Sequence[Path] = (), trace: Path | None = None, model: Path | None = None,
    checks: Sequence[Path] = (),
) -> tuple[Part, ...]:  # fmt: skip
    """Return the files of a donation, each read and written anew. A model brings its history, if it has one.

    Raises `InputError` or a subclass for a file of the wrong kind, and for more than `MOST_BYTES`.
    """
    for path in filter(None, (plan, *scans, trace, model, *checks)):
        if not path.is_file():
            raise InputError(path, wanted=say("file"), came=say("none-no-plain"), todo=say("check-path"))
    pictures = [path for path in (*scans, *checks) if path.suffix.lower() != ".csv"]
    if len(pictures) > MOST_PICTURES:
        todo = say("choose-those-measure-takes")
        raise InputError(
            say("subject-donation"), wanted=say("most-pictures", MOST_PICTURES), came=str(len(pictures)), todo=todo
        )
    parts: list[Part] = []
    for part in _parts(plan, scans, trace, model, checks):
        parts.append(part)
        if (size := sum(len(part.data) for part in parts)) > MOST_BYTES:
            came, todo = say("mb-more", f"{size / 1000000.0:.0f}"), say("crop-scans-give-fewer")
            raise InputError(
                say("subject-donation"), wanted=say("most-mb", f"{MOST_BYTES / 1e6:.0f}"), came=came, todo=todo
            )
    return tuple(parts)


def _parts(
    plan: Path | None, scans: Sequence[Path], trace: Path | None, model: Path | None, checks: Sequence[Path]
) -> Iterator[Part]:
    """Yield the files of a donation, one after the other."""
    if plan is not None:
        yield _plan(plan)
    for i, path in enumerate(scans, 1):
        yield _scan(path, f"scan-{i}.png", say("donated-scan"))
    if trace is not None:
        yield _table(trace, "trace.csv", say("donated-trace"))
    if model is not None:
        yield _model(model)
        if history_of(model).is_file():
            yield _history(model)
    for i, path in enumerate(checks, 1):
        if path.suffix.lower() == ".csv":
            yield _table(path, f"check-{i}.csv", say("donated-check-table"))
        else:
            yield _scan(path, f"check-{i}.png", say("donated-check"))


def write_donation(path: Path, parts: Sequence[Part]) -> None:
    """Write the parts, and manifest.json that describes them, as one zip; a kill leaves the old file or the new."""
    with replacing(path, "wb") as file, zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as packed:
        for name, data in [("manifest.json", _manifest(parts)), *((part.name, part.data) for part in parts)]:
            entry = zipfile.ZipInfo(name, _TIME)
            entry.external_attr = 0o644 << 16
            packed.writestr(entry, data, zipfile.ZIP_STORED if name.endswith(".png") else zipfile.ZIP_DEFLATED)


def _manifest(parts: Sequence[Part]) -> bytes:
    """Return a donation's list of contents, as readable JSON."""
    files = [
        {"name": part.name, "what": part.what, "bytes": len(part.data), "sha256": hashlib.sha256(part.data).hexdigest(),
         "left_out": list(part.left_out)}
        for part in parts
    ]  # fmt: skip
    return _json({"format": FORMAT, "version": VERSION, "program": __version__, "files": files})


def _plan(path: Path) -> Part:
    plan = read_plan(path)
    plan = replace(plan, printer=_public_name(plan.printer), kinematics=_word("kinematics", plan.kinematics))
    return Part("probe.json", say("donated-plan"), plan_text(plan).encode())


def _scan(path: Path, name: str, what: str) -> Part:
    """Return the pixels of a picture and its resolution, as PNG."""
    from PIL import Image

    from printmend.measure.image import read_image

    pixels, dpi = read_image(path)
    with Image.open(path) as image:
        texts = [key for key in image.info if key not in ("dpi", "gamma", "srgb", "interlace", "jfif", "jfif_density")]
    data = io.BytesIO()
    options = {} if dpi is None else {"dpi": (dpi, dpi)}
    Image.fromarray(pixels[:, :, ::-1]).save(data, "PNG", **options)
    left_out = (say_count("donated-less-metadata", len(texts)),) if texts else ()
    return Part(name, what, data.getvalue(), left_out)


def _table(path: Path, name: str, what: str) -> Part:
    """Return the known columns of a trace, without rows that hold anything but numbers."""
    text = read_text(path, wanted=say("trace-csv"), todo=say("save-csv-utf-8"), error=TraceError)
    try:
        rows = list(csv.reader(io.StringIO(text, newline=""), strict=True))
    except csv.Error as error:
        raise TraceError(path, wanted=say("trace-csv"), came=str(error), todo=say("save-csv-utf-8")) from None
    names = [cell.strip() for cell in rows[0]] if rows else []
    if not set(REQUIRED) <= set(names):
        raise TraceError(path, wanted=say("columns", ", ".join(REQUIRED)), came=say("others"), todo=say("check-path"))
    places = {key: names.index(key) for key in (*KNOWN, *ORIGIN) if key in names}
    given, whose = [list(places)], None
    for row in rows[1:]:
        cells = {key: row[place].strip() if place < len(row) else "" for key, place in places.items()}
        if any(cells.values()) and all(key in ORIGIN or _is_number(cell) for key, cell in cells.items()):
            whose = whose or {key: _origin(key, cells.get(key, "")) for key in ORIGIN}  # readers take the first, too
            given.append([whose.get(key, cell) for key, cell in cells.items()])
    data = io.StringIO(newline="")
    csv.writer(data, lineterminator="\n").writerows(given)
    lost_rows, lost_columns = sum(map(any, rows)) - len(given), len(set(names) - set(places))
    left_out = [say_count("donated-less-lines", lost_rows)] if lost_rows else []
    left_out += [say_count("donated-less-columns", lost_columns)] if lost_columns else []
    return Part(name, what, data.getvalue().encode(), tuple(left_out))


def _model(path: Path) -> Part:
    model = read_model(path)
    document = {key: _plain(key, value) for key, value in model.document.items() if key in _MODEL}
    document["printer"]["name"] = _public_name(model.printer.name)
    document["findings"] = []
    text = model_text(replace(model, document=document))
    parse_model(text, subject=str(path))  # check that it is still a whole model
    what = say("donated-model")
    return Part("printer.mend.json", what, text.encode(), (say("donated-less-findings"), say("donated-less-digests")))


def _history(model_path: Path) -> Part:
    """Return the history of learning and verifying, dated in days since the first event."""
    events = read_history(model_path)
    lines = []
    for event in events:
        given = {
            key: value for key, value in event.items() if key not in ("seconds", "time", "model", "source", MEASUREMENT)
        }
        days = int((event["seconds"] - events[0]["seconds"]) // DAY_S)
        lines.append(json.dumps({"day": days, **_plain("", given)}))
    what = say("donated-history")
    return Part("history.jsonl", what, ("\n".join(lines) + "\n").encode(), (say("donated-less-dates"),))


def _plain(key: str, value: Any) -> Any:
    """Return a value with only its numbers and printmend's own words."""
    if isinstance(value, Mapping):
        return {name: _plain(name, item) for name, item in value.items() if _KEY.fullmatch(name)}
    if isinstance(value, list | tuple):
        return [_plain(key, item) for item in value]
    return _word(key, value) if isinstance(value, str) else value


def _word(key: str, value: str) -> str:
    """Return a word that printmend wrote itself; empty for any other text."""
    return value if key in _WORDS and _TOKEN.fullmatch(value) else ""


def _origin(key: str, cell: str) -> str:
    """Return a cell of a row's origin without the owner's words."""
    if key == "printer":
        return _public_name(cell) if cell else ""
    return cell if key == "kinematics" and cell in ("cartesian", "corexy") else ""


def _public_name(name: str) -> str:
    """Return the make and model that a printer's name refers to, without the owner's own name for it."""
    if any(name == read_printer(preset).name for preset in preset_names()):
        return name
    return " or ".join(sorted(printers_named(name))[:3]) or _NOBODY


def _is_number(cell: str) -> bool:
    """Return whether a cell is empty or holds a finite number."""
    try:
        return not cell or math.isfinite(float(cell))
    except ValueError:
        return False


def _json(value: Any) -> bytes:
    return (json.dumps(value, indent=1, ensure_ascii=False) + "\n").encode()
