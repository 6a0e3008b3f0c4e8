"""The API for a user's own printers: describe, measure, learn, mend, verify."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

from fastapi import APIRouter
from fastapi import Path as Where
from fastapi.responses import FileResponse

from printmend.errors import InputError, PrintmendError
from printmend.filament import check_name as check_filament
from printmend.files import replacing
from printmend.messages import is_one_of, messages_of, say, together
from printmend.printer import Printer, read_printer
from printmend.printer.convert import convert, printer_text
from printmend.printer.toml import check_name, parse_printer
from printmend.studio.api import PROBLEMS, Here, Key, card, plain_name
from printmend.studio.guard import API
from printmend.studio.host import FILE, find_host, keep_host, read_host
from printmend.studio.jobs import StudioState
from printmend.studio.shapes import (
    Distance,
    FitIn,
    HostCard,
    HostIn,
    JobCard,
    Known,
    LearnIn,
    MendIn,
    NewPrinter,
    NextCard,
    PrinterCard,
    ProbeCard,
    ProbeIn,
    ReadingsIn,
    Renamed,
    ScansIn,
    SendIn,
    TowerCard,
    VerifyIn,
)
from printmend.studio.store import NotThereError
from printmend.studio.work import MODEL, PLAN, PRINTER, PROBE, TOWER, TOWER_TABLE

router = APIRouter(prefix=f"{API}/printers", responses=PROBLEMS, tags=["printers"])
_NOTES = "notes.json"
_OFFERED = (PRINTER, PROBE, PLAN, MODEL, TOWER, TOWER_TABLE)


def _folder(here: StudioState, key: str) -> Path:
    """Return a printer's folder; raise `NotThereError` if there is none."""
    here.store.printer(key)
    return here.store.path("printer", key)


def _card(here: StudioState, row: dict[str, Any]) -> PrinterCard:
    """Return a printer's card."""
    folder = here.store.path("printer", row["id"])
    printer = read_printer(folder / PRINTER)
    learned = [job for job in here.store.jobs(printer=row["id"]) if job["kind"] == "learn" and job["state"] == "done"][
        ::-1
    ]
    trend = [job["result"]["said"]["before_mm"] for job in learned]
    health, healthy, digest, measured_s, filaments = None, None, None, None, []
    messages: dict[str, Any] = {}
    parts: list[str] = []
    if (folder / MODEL).is_file():
        from printmend.diagnosis.advice import advised  # all of learning: not for a printer's bare card
        from printmend.effects.words import LEAST_SHOWN
        from printmend.model.model import NOTE, misfit_words

        document = json.loads((folder / MODEL).read_text(encoding="utf-8"))
        messages = document.get("messages", {})
        titles = [one.title for _, one in advised(document) if one.effect_mm >= LEAST_SHOWN]
        health = together("; ", titles) if titles else (document["findings"] or [""])[0]
        sound = document["frame"] is None and all(one["kind"] == "healthy" for one in document["motors"].values())
        healthy = not document["diagnosis"] if "diagnosis" in document else sound
        grave = [words.values["a"] for words in misfit_words(document) if not is_one_of(words, [NOTE])]
        if not titles and grave:  # no fault is known, but the measurement is not that of a sound printer
            health, healthy = grave[0], False
        messages = messages | messages_of(health)
        parts = sorted({fault["part"] for fault in document.get("diagnosis", [])})
        filaments = list(document.get("filaments", {}).get("known", {}))
        digest, measured_s = document["digest"], (folder / MODEL).stat().st_mtime
    notes = json.loads((folder / _NOTES).read_text(encoding="utf-8")) if (folder / _NOTES).is_file() else []
    return PrinterCard(
        id=row["id"], name=row["name"], kinematics=printer.kinematics, bed_mm=_bed(printer), notes=notes,
        health=health, healthy=healthy, measured_s=measured_s, trend=[value for value in trend if value is not None],
        parts=parts, has_probe=(folder / PLAN).is_file(), digest=digest, host=_host_card(folder), messages=messages,
        filaments=filaments,
    )  # fmt: skip


def _host_card(folder: Path) -> HostCard | None:
    """Return the card of a printer's own host."""
    host = read_host(folder)
    return None if host is None else HostCard(address=host.address, kind=host.kind)


def _bed(printer: Printer) -> list[float]:
    """Return the corners of a bed, as a card shows them."""
    return [printer.x.min_mm, printer.y.min_mm, printer.x.max_mm, printer.y.max_mm]


@router.get("", name="list")
def printers(here: Here) -> list[PrinterCard]:
    """List one's own printers."""
    return [_card(here, row) for row in here.store.printers()]


@router.post("", status_code=201)
def add(here: Here, new: NewPrinter) -> PrinterCard:
    """Add a printer."""
    printer, left = _described(here, new)
    if new.bed_mm is not None:
        printer = _resized(printer, new.bed_mm)
    text = printer_text(replace(printer, name=new.name.strip() or printer.name))
    parse_printer(text, subject=say("the-printer"))
    key = here.store.add_printer(new.name.strip(), usually=printer.name)
    folder = here.store.path("printer", key)
    folder.mkdir()
    with replacing(folder / PRINTER) as file:
        file.write(text)
    with replacing(folder / _NOTES) as file:
        file.write(json.dumps(left))
    return _card(here, here.store.printer(key))


def _described(here: StudioState, new: NewPrinter) -> tuple[Printer, tuple[str, ...]]:
    """Return the printer that a request describes, and notes about it."""
    from printmend.printer import preset_names

    if new.preset is not None and new.preset not in preset_names():
        raise InputError(new.preset, wanted=say("preset"), came=say("none-name"), todo=say("choose-list"))
    if new.upload is not None:
        row = here.store.upload(new.upload)
        try:
            return convert(here.store.path("upload", new.upload), like=new.preset)
        except PrintmendError as error:
            place = str(here.store.path("upload", new.upload))
            raise InputError(
                row["name"], wanted=error.wanted, came=error.came.replace(place, row["name"]), todo=error.todo
            ) from None
    if new.preset is None:
        raise InputError(say("new-printer"), wanted=say("preset-upload"), came=say("neither"), todo=say("choose-one"))
    return read_printer(new.preset), ()


def _resized(printer: Printer, bed_mm: list[float]) -> Printer:
    """Return a printer with another bed; an end stop at the far edge moves with it."""
    axes = []
    for axis, size in zip((printer.x, printer.y), bed_mm, strict=True):
        high = axis.min_mm + size
        home = axis.home_mm + (high - axis.max_mm if axis.home_side == "max" else 0.0)
        axes.append(replace(axis, max_mm=high, home_mm=home))
    return replace(printer, x=axes[0], y=axes[1])


@router.get("/{key}", name="get")
def printer(here: Here, key: Key) -> PrinterCard:
    """Return a printer."""
    return _card(here, here.store.printer(key))


@router.patch("/{key}")
def rename(here: Here, key: Key, new: Renamed) -> PrinterCard:
    """Give a printer another name."""
    here.store.printer(key)
    here.store.rename_printer(key, check_name(new.name.strip(), subject=say("the-printer")))
    return _card(here, here.store.printer(key))


@router.delete("/{key}", status_code=204)
def remove(here: Here, key: Key) -> None:
    """Remove a printer, its model, its measurements and its jobs."""
    folder = _folder(here, key)
    for job in here.store.jobs(printer=key, most=100_000):
        here.jobs.remove(job["id"])
    here.store.forget("printer", key)
    shutil.rmtree(folder, ignore_errors=True)


@router.get("/{key}/files/{name}", name="get_file", response_class=FileResponse)
def file(here: Here, key: Key, name: Annotated[str, Where(max_length=100)]) -> FileResponse:
    """Fetch one of a printer's files: description, model, test print and plan, tower and table."""
    path = _folder(here, key) / name
    if name not in _OFFERED or not path.is_file():
        raise NotThereError(name, wanted=say("file-printer"), came=say("none"), todo=say("may", ", ".join(_OFFERED)))
    return FileResponse(path, filename=name, headers={"Cache-Control": "no-store"})


@router.post("/{key}/probe", name="make_probe", tags=["measure"])
def probe(here: Here, key: Key, wanted: ProbeIn) -> ProbeCard:
    """Write the printer's test print and its plan."""
    from printmend.probe import design_probe, write_probe
    from printmend.probe.layout import with_moving
    from printmend.probe.probe import keep_plan

    folder = _folder(here, key)
    printer = read_printer(folder / PRINTER)
    plan = with_moving(design_probe(printer, size_mm=wanted.size_mm), printer)
    if not wanted.overwrite:
        keep_plan(folder / PLAN, plan)
    write_probe(folder / PROBE, plan, extruder=printer.extruder, start_gcode=_start(printer))
    return _probe_card(printer, plan)


@router.get("/{key}/probe", name="get_probe", tags=["measure"])
def written_probe(here: Here, key: Key) -> ProbeCard | None:
    """Return the test print that was written; null where there is none."""
    from printmend.measure import read_plan

    folder = _folder(here, key)
    if not (folder / PLAN).is_file():
        return None
    return _probe_card(read_printer(folder / PRINTER), read_plan(folder / PLAN))


def _probe_card(printer: Printer, plan: Any) -> ProbeCard:
    """Return a test print's card."""
    from printmend.probe import cost, expected_error_mm

    minutes, grams = cost(plan)
    return ProbeCard(
        marks=len(plan), minutes=minutes, grams=grams, expected_mm=expected_error_mm(printer, plan),
        marks_mm=plan.marks_mm.round(2).tolist(), big=plan.big.tolist(), bed_mm=_bed(printer),
    )  # fmt: skip


def _start(printer: Printer) -> str:
    """Return a printer's start code with its homing."""
    from printmend.probe.gcode import homed_start

    return printer.start_gcode and homed_start(printer.start_gcode, subject="the start code")


@router.post("/{key}/tower", name="make_tower", tags=["measure"])
def tower(here: Here, key: Key) -> TowerCard:
    """Write a small tower that shows the Z screw, tower.gcode, and the table to be filled in, tower.csv."""
    from printmend.probe.tower import design_tower, write_tower

    folder = _folder(here, key)
    printer = read_printer(folder / PRINTER)
    made = design_tower(printer)
    write_tower(folder / TOWER, made, printer, start_gcode=_start(printer))
    return _tower_card(made)


@router.get("/{key}/tower", name="get_tower", tags=["measure"])
def written_tower(here: Here, key: Key) -> TowerCard | None:
    """Return the tower that was written; null where there is none."""
    from printmend.probe.tower import design_tower

    folder = _folder(here, key)
    return _tower_card(design_tower(read_printer(folder / PRINTER))) if (folder / TOWER).is_file() else None


def _tower_card(made: Any) -> TowerCard:
    """Return a tower's card."""
    height_mm = float(made.waypoints_mm[made.printed, 2].max())
    return TowerCard(minutes=made.minutes, grams=made.grams, height_mm=height_mm)


_FILES = {
    MODEL: "a-model-file",
    PLAN: "a-test-print",
    PROBE: "a-test-print",
    TOWER: "a-test-print",
    FILE: "an-address",
}  # messages


def _need(folder: Path, name: str, todo: str) -> None:
    """Raise `InputError` if a file of a printer is missing."""
    if not (folder / name).is_file():
        raise InputError(say("this-printer"), wanted=say(_FILES[name]), came=say("none-yet"), todo=todo)


def _scans(here: StudioState, scans: ScansIn) -> dict[str, Any]:
    """Return a job's parameters for uploaded scans."""
    rows = [here.store.upload(key) for key in scans.uploads]
    given = {"dpi": scans.dpi, "distance_mm": scans.distance_mm}
    return {"scans": [{"upload": row["id"], "name": plain_name(row["name"])} for row in rows], **given}


@router.post("/{key}/measure", status_code=202, tags=["measure"])
def measure(here: Here, key: Key, scans: ScansIn) -> JobCard:
    """Find the marks of the printed test print in scans or photos: a job."""
    _need(_folder(here, key), PLAN, say("write-test-print-first"))
    return card(here, here.submit("measure", key, {"printer": key, **_scans(here, scans)}))


@router.post("/{key}/learn", status_code=202, tags=["measure"])
def learn(here: Here, key: Key, given: LearnIn) -> JobCard:
    """Learn what is wrong from a measurement: a job; what it learns is the printer's model from then on."""
    folder = _folder(here, key)
    if (given.measurement is None) == (given.upload is None):
        raise InputError(
            say("learn"), wanted=say("measurement-upload"), came=say("not-one-of-them"), todo=say("give-one")
        )
    if given.upload is not None:
        here.store.upload(given.upload)
        table = {"printer": key, "upload": given.upload, "filament": _filament(given.filament)}
        return card(here, here.submit("learn", key, table))
    job = here.store.job(str(given.measurement))
    if job["printer"] == key and job["kind"] == "fit" and job["state"] == "done":
        part = {"printer": key, "part": job["id"], "filament": job["params"]["filament"]}
        return card(here, here.submit("learn", key, part))
    if job["printer"] != key or job["kind"] != "measure" or job["state"] != "done":
        raise InputError(
            job["id"], wanted=say("measurement-printer"), came=say("another-job"), todo=say("measure-test-print")
        )
    _need(folder, PLAN, say("write-test-print-first"))
    params = {"printer": key, "measurement": job["id"], "exclude": given.exclude}
    return card(here, here.submit("learn", key, params))


@router.post("/{key}/fit", status_code=202, tags=["measure"])
def fit(here: Here, key: Key, given: FitIn) -> JobCard:
    """Start the job that says whether a printed part fits, and which slicer settings correct it."""
    _folder(here, key)
    rows = [here.store.upload(one) for one in given.uploads]
    params = {
        "printer": key, "upload": given.upload, "name": plain_name(here.store.upload(given.upload)["name"]),
        "scans": [{"upload": row["id"], "name": plain_name(row["name"])} for row in rows], "dpi": given.dpi,
        "distances_mm": given.distances_mm, "filament": _filament(given.filament),
    }  # fmt: skip
    return card(here, here.submit("fit", key, params))


def _filament(name: str | None) -> str | None:
    """Return a filament's name unchanged. Raises `ConfigError` for a filament of an unknown polymer."""
    return None if name is None or not name.strip() else check_filament(name.strip())


def _distances(here: StudioState, key: str) -> Any:
    """Return the distances of a test print to measure by hand."""
    from printmend.infer.distances import choose_distances
    from printmend.measure import read_plan

    folder = _folder(here, key)
    _need(folder, PLAN, say("write-test-print-first"))
    return choose_distances(read_plan(folder / PLAN))


@router.get("/{key}/callipers", name="ask_callipers", tags=["measure"])
def distances(here: Here, key: Key) -> list[Distance]:
    """List the distances to take with callipers, where there is no scanner."""
    chosen = _distances(here, key)
    marks = chosen.plan.marks_mm.round(2)
    return [
        Distance(first_mm=marks[one].tolist(), second_mm=marks[two].tolist(), about_mm=round(float(about), 2))
        for (one, two), about in zip(chosen.pairs, chosen.across_mm, strict=True)
    ]


@router.post("/{key}/callipers", name="learn_callipers", tags=["measure"])
def callipers(here: Here, key: Key, given: ReadingsIn) -> Known:
    """Learn from distances that were taken with callipers: scale, play, pulleys off their centre, skew."""
    from printmend.learn.by_hand import model_by_hand
    from printmend.measure.callipers import parse_readings
    from printmend.model import write_model

    chosen, folder = _distances(here, key), _folder(here, key)
    text = "\n".join("" if value is None else f"{value:.6f}" for value in given.readings_mm) + "\n"
    readings_mm = parse_readings(text, chosen, subject=say("distances"))
    write_model(folder / MODEL, model_by_hand(chosen, readings_mm, read_printer(folder / PRINTER)))
    return known(here, key)


@router.get("/{key}/known", name="get_known")
def known(here: Here, key: Key) -> Known:
    """Return what is known of a printer."""
    from printmend.model import read_model
    from printmend.studio.said import said

    folder = _folder(here, key)
    history: list[dict[str, Any]] = []
    for job in here.store.jobs(printer=key)[::-1]:
        result = job["result"] or {}
        if job["state"] == "done" and job["kind"] == "learn":
            history.append({"event": "learned", "at_s": job["ended_s"], "now_mm": result["said"]["before_mm"],
                            "digest": result["said"]["digest"]})  # fmt: skip
        if job["state"] == "done" and job["kind"] == "verify":
            history.append({"event": "verified", "at_s": job["ended_s"], **result["verdict"]})
    model = said(read_model(folder / MODEL)) if (folder / MODEL).is_file() else None
    return Known(said=model, history=history, messages=messages_of(model))


@router.get("/{key}/next", name="get_next_print", tags=["measure"])
def next_one(here: Here, key: Key) -> NextCard | None:
    """Return the cheapest print that would show what the measurement could not tell; null where nothing is missing."""
    from printmend.model import read_model
    from printmend.studio.next_print import next_print

    folder = _folder(here, key)
    if not (folder / MODEL).is_file():
        return None
    model = read_model(folder / MODEL)
    found = next_print(model.printer, model.findings[1:])
    return None if found is None else NextCard(**vars(found))


@router.post("/{key}/mend", status_code=202, tags=["mend"])
def mend(here: Here, key: Key, given: MendIn) -> JobCard:
    """Mend an uploaded G-code file for this printer: a job."""
    _need(_folder(here, key), MODEL, say("measure-test-print-first"))
    name = plain_name(here.store.upload(given.upload)["name"])
    params = {"printer": key, "upload": given.upload, "name": name, "scene": given.scene, "force": given.force,
              "filament": _filament(given.filament)}  # fmt: skip
    return card(here, here.submit("mend", key, params))


@router.post("/{key}/host", tags=["send"])
def connect(here: Here, key: Key, given: HostIn) -> PrinterCard:
    """Keep where this printer's OctoPrint or Moonraker is, once it has answered; its key is never shown again."""
    folder = _folder(here, key)
    keep_host(folder, find_host(given.address, given.key.strip()))
    return _card(here, here.store.printer(key))


@router.delete("/{key}/host", status_code=204, tags=["send"])
def disconnect(here: Here, key: Key) -> None:
    """Forget the address and its key."""
    keep_host(_folder(here, key), None)


@router.post("/{key}/send", status_code=202, tags=["send"])
def send(here: Here, key: Key, given: SendIn) -> JobCard:
    """Send the test print, or a file that a job made, to the printer's OctoPrint or Moonraker; nothing is started."""
    folder = _folder(here, key)
    _need(folder, FILE, say("connect-first"))
    if given.job is None:
        name = given.name if given.name == TOWER else PROBE
        _need(folder, name, say("write-test-print-first"))
        return card(here, here.submit("send", key, {"printer": key, "name": name}))
    row = card(here, given.job)
    if row.printer != key or given.name not in row.files:
        raise NotThereError(given.name, wanted=say("file-job-printer"), came=say("none-name"),
                            todo=say("see-job-files"))  # fmt: skip
    return card(here, here.submit("send", key, {"printer": key, "job": given.job, "name": given.name}))


@router.post("/{key}/check", name="make_check_print", status_code=202, tags=["prove"])
def check_print(here: Here, key: Key) -> JobCard:
    """Mend the test print itself, to be printed and measured as the proof: a job."""
    folder = _folder(here, key)
    _need(folder, PROBE, say("write-test-print-first"))
    _need(folder, MODEL, say("measure-test-print-first"))
    return card(here, here.submit("check", key, {"printer": key}))


@router.post("/{key}/verify", status_code=202, tags=["prove"])
def verify(here: Here, key: Key, given: VerifyIn) -> JobCard:
    """Measure the printed check print, or a mended part, and compare it with the promise: a job."""
    _need(_folder(here, key), MODEL, say("measure-test-print-first"))
    params = {"printer": key, **_scans(here, given), "filament": _filament(given.filament)}
    if given.part is not None:
        if len(given.uploads) > 1:
            raise InputError(
                say("check-print"), wanted=say("one-scan-underside"), came=str(len(given.uploads)),
                todo=say("leave-others-out"),
            )  # fmt: skip
        params |= {"part": given.part, "name": plain_name(here.store.upload(given.part)["name"])}
    return card(here, here.submit("verify", key, params))


@router.post("/{key}/update/{job}", tags=["prove"])
def update(here: Here, key: Key, job: Key) -> Known:
    """Take over the model that a check print brought up to date."""
    folder = _folder(here, key)
    row = here.store.job(job)
    if row["printer"] != key or row["kind"] != "verify" or row["state"] != "done":
        raise InputError(job, wanted=say("check-print-printer"), came=say("another-job"), todo=say("verify-first"))
    with replacing(folder / MODEL) as file:
        file.write((here.store.path("job", job) / MODEL).read_text(encoding="utf-8"))
    return known(here, key)
