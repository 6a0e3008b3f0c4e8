"""The worker processes' jobs: one function for each kind of job, over the functions that the command line calls.

A job has its own folder. There it reports its progress (`progress.json`) and leaves its files. It returns a small
table: numbers, words and the names of the files that may be fetched. Each file is written under a temporary name and
renamed, so a killed job can simply run again.
"""

import contextlib
import ctypes
import json
import os
import signal
import tempfile
import time
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from printmend.errors import InputError, PrintmendError, RefusedError
from printmend.files import replacing
from printmend.messages import say

Params = dict[str, Any]
PROGRESS = "progress.json"
MODEL, PRINTER, PLAN, PROBE = "printer.mend.json", "printer.toml", "probe.json", "probe.gcode"
TOWER, TOWER_TABLE = "tower.gcode", "tower.csv"
COARSE, WANTED, MENDED = "coarse.bin", "printed.bin", "mended.bin"
THUMB, PHOTO, SEEN = "thumb.svg", "photo-{}.jpg", "seen.jpg"
_SMALL_PART = "G28\nG90\nM83\nG1 Z0.2 F3000\nG1 X60 Y60\nG1 X110 Y60 E2\nG2 X110 Y100 I0 J20 E3\nG1 X60 Y95 E2\n"
_NICENESS = 5  # gives a worker a lower priority than the server and the browser of the same computer
_PLAY_DPI = 300.0  # resolution of the play screen's scan
_SEEN_PX = 1800  # longer side of a scan as it is shown


class Job:
    """One job: its folders and parameters, and its progress reports."""

    def __init__(self, folder: Path, data: Path, params: Params, pictures: Path | None = None) -> None:
        self.folder, self.data, self.params, self._pictures = folder, data, params, pictures or folder
        self.files: list[str] = []
        self._begun_s, self._told_s = time.time(), 0.0
        for place in (self.folder, self._pictures):
            place.mkdir(parents=True, exist_ok=True)

    def tell(self, share: float, step: str, *, now: bool = True) -> None:
        """Report that ``share`` 0–1 is done and what comes next; if not ``now``, only if the last report is old."""
        if not now and time.time() - self._told_s < 0.2:
            return
        self._told_s = time.time()
        spent_s = self._told_s - self._begun_s
        left_s = spent_s * (1 - share) / share if share > 0.02 and spent_s > 0.5 else None
        told = {"share": round(share, 3), "step": step, "left_s": left_s, "files": self.files}
        beside = self.folder / f"{PROGRESS}.new"
        beside.write_text(json.dumps(told), encoding="utf-8")
        os.replace(beside, self.folder / PROGRESS)  # no fsync: it is worthless after a power cut

    def file(self, name: str) -> Path:
        """Return the path for a file that may be fetched as soon as it exists."""
        if name not in self.files:
            self.files.append(name)
        return self.folder / name

    def picture(self, name: str) -> Path:
        """Return the path for a picture, which may be fetched like a `file` but may be lost."""
        self.file(name)
        return self._pictures / name

    @property
    def given(self) -> Path:
        """The folder of uploads under their original names, apart from the job's own files."""
        return self.folder / "given"

    def said(self, error: PrintmendError) -> str:
        """Return an error's message without the folders of this studio."""
        words = error.message
        for place in (self.given, self.folder, self._pictures, self.data):
            words = words.replace(f"{place}{os.sep}", "")
        return words

    @property
    def printer_folder(self) -> Path:
        """The folder of the job's printer."""
        return self.data / "printers" / self.params["printer"]

    def upload(self, key: str) -> Path:
        """Return the path of an upload. Raises `InputError` if it is gone."""
        path = self.data / "uploads" / key
        if not path.is_file():
            raise InputError(key, wanted=say("upload-studio"), came=say("none"), todo=say("drop-file-again"))
        return path


def begin() -> None:
    """Initialise a worker: it ignores Ctrl-C, which the server handles, and lowers its priority below the page's."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(os, "nice"):
        os.nice(_NICENESS)
    with contextlib.suppress(Exception):  # an error here would break the pool; a job will report it
        rehearse()


def rehearsed() -> None:
    """Do nothing: a worker that has started is ready for a job."""


def rehearse() -> None:
    """Mend a small part, so that libraries and kernels are loaded before the first job."""
    from printmend.corruption import Corruption, Drive, EccentricBore, Play
    from printmend.model import exact_model, write_model
    from printmend.printer import read_printer
    from printmend.twin import Twin

    bent = Corruption((Drive(pulley=EccentricBore(0.4, 1.0), belt=Play(0.2)), Drive(belt=Play(0.2))))
    with tempfile.TemporaryDirectory(prefix="printmend-") as name:
        data = Path(name)
        for folder in ("printers/0", "uploads"):
            (data / folder).mkdir(parents=True)
        write_model(data / "printers/0" / MODEL, exact_model(Twin.of(bent, read_printer("ender3")).homed()))
        (data / "uploads/0").write_text(_SMALL_PART, encoding="utf-8")
        run("mend", str(data / "jobs"), name, {"printer": "0", "upload": "0", "name": "part.gcode"})


def run(kind: str, folder: str, data: str, params: Params, pictures: str | None = None) -> dict[str, Any]:
    """Run one job; return its result, or ``error`` in one line. ``pictures`` may be a separate folder."""
    job = Job(Path(folder), Path(data), params, None if pictures is None else Path(pictures))
    try:
        result = KINDS[kind](job)
    except PrintmendError as error:
        return {"error": job.said(error), "may_force": kind == "mend" and may_force(error)}
    finally:
        _give_back()
    return {**result, "files": job.files}


def _give_back() -> None:
    """Return free memory to the system, which glibc does only on request."""
    with contextlib.suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).malloc_trim(0)


def may_force(error: PrintmendError) -> bool:
    """Return whether the user may override this error and mend anyway."""
    return "--force" in error.todo


def read_progress(folder: Path) -> dict[str, Any]:
    """Return a job's last progress report."""
    try:
        return dict(json.loads((folder / PROGRESS).read_text(encoding="utf-8")))
    except (OSError, ValueError):
        return {}


def _mend(job: Job) -> dict[str, Any]:
    """Mend one file, show it in three dimensions, and predict its errors."""
    from printmend.mend import mend_gcode
    from printmend.mend.filament import printed_in
    from printmend.mend.mend import check_gcode
    from printmend.mend.prediction import doubt_mm
    from printmend.studio.scene import Tap, as_mended, write_mended

    model = printed_in(_model(job.printer_folder / MODEL), job.params.get("filament"))
    source, name = job.upload(job.params["upload"]), job.params["name"]
    named = _named(job, job.params["upload"], name)
    size = max(source.stat().st_size, 1)
    job.tell(0.05, "read")
    tap, drawing = Tap(), None
    if job.params.get("scene", True):
        drawing, scene = _draw(job, named, model)
        tap = Tap(drawing.motion.there)
        job.tell(0.3, "rewrite")
    seen = 0

    def tick(count: int) -> None:
        nonlocal seen
        seen += count
        job.tell(0.3 + 0.5 * min(seen / size, 1.0), "rewrite", now=False)

    refused, forced, output = None, False, mended_name(name)
    try:
        prediction = mend_gcode(
            named, model, job.folder / output, force=job.params.get("force", False), progress=tick, watch=tap.watch
        ).prediction
        job.file(output)
    except RefusedError as error:
        refused, forced, prediction = job.said(error), may_force(error), check_gcode(named, model)
    paces = None
    if drawing is not None and tap.seen:
        job.tell(0.8, "draw")
        scene = as_mended(scene, drawing, model.mechanism, tap, aligned=_is_of_shape(model))
        write_mended(job.picture(MENDED), scene)
        paces = _paces(named, scene, prediction.duration)
    table = prediction.json()
    table.pop("layers")
    return {"name": name, "output": None if refused else output, "refused": refused, "may_force": forced,
            "prediction": table, "doubt_mm": [doubt_mm(each) for each in (prediction.before, prediction.after)],
            "pace": paces, "untouched": refused is None and prediction.is_untouched,
            "layers": [[round(layer[key], 4) for key in ("z_mm", "before_rms_mm", "after_rms_mm")]
                       for layer in prediction.layers],
            "bytes": source.stat().st_size, "digest": model.digest,
            "summary": prediction.summary()}  # fmt: skip


def _draw(job: Job, path: Path, model: Any) -> tuple[Any, Any]:
    """Draw a part as printed, a large one coarsely first; return its `Drawing` and its `Scene`."""
    from printmend.studio.scene import as_printed, coarse, lay_points, read_motion, write_thumb, write_wanted

    motion, aligned = read_motion(path, model.printer), _is_of_shape(model)
    if (few := coarse(motion)) is not None:
        write_wanted(job.picture(COARSE), as_printed(lay_points(few), model.mechanism, aligned=aligned))
        job.tell(0.15, "read")
    drawing = lay_points(motion)
    scene = as_printed(drawing, model.mechanism, aligned=aligned)
    write_wanted(job.picture(WANTED), scene)
    write_thumb(job.picture(THUMB), scene)
    return drawing, scene


def _is_of_shape(model: Any) -> bool:
    """Return whether to draw a part at its best fit, as the prediction judges it."""
    from printmend.promise.belief import parse_belief

    return parse_belief(model) is not None


def _paces(path: Path, scene: Any, duration: Any) -> dict[str, Any]:
    """Return the times before and after mending, by the slicer's time if stated, and the busiest seconds' moves."""
    from printmend.gcode.container import open_gcode
    from printmend.studio.scene import slicer_s

    with open_gcode(path) as file:
        told_s = slicer_s(*file.parts[0].hints())
    before_s = duration.before_s if told_s is None else told_s
    return {"before_s": before_s, "told": told_s is not None, "after_s": before_s * (1.0 + duration.share),
            "busiest": [scene.raw_busiest, scene.mended_busiest]}  # fmt: skip


def _model(path: Path) -> Any:
    """Return a printer's model; it is cached until its file changes."""
    stat = path.stat()
    return _read_model(path, stat.st_mtime_ns, stat.st_size, stat.st_ino)


@lru_cache(maxsize=4)
def _read_model(path: Path, *version: int) -> Any:
    from printmend.model import read_model

    return read_model(path)


def _named(job: Job, upload: str, name: str) -> Path:
    """Return an upload under its original name, which messages use and which shows the kind of file."""
    place = job.given / name
    place.parent.mkdir(exist_ok=True)
    if not place.exists():
        os.link(job.upload(upload), place)
    return place


def _scans(job: Job) -> list[Path]:
    """Return the uploaded scans or photos under their own names, equal ones numbered; also write smaller copies."""
    from printmend.studio.scene import write_photo

    names = [one["name"] for one in job.params["scans"]]
    several = len({*names}) < len(names)
    shown = [f"{i + 1}-{name}" if several else name for i, name in enumerate(names)]
    paths = [_named(job, one["upload"], name) for one, name in zip(job.params["scans"], shown, strict=True)]
    for i, path in enumerate(paths):
        write_photo(job.picture(PHOTO.format(i + 1)), path)
    return paths


def _measure(job: Job) -> dict[str, Any]:
    """Find the marks of a printed test print in scans or photos."""
    from printmend.measure import read_plan, write_trace
    from printmend.measure.measurement import image_px, measure_scans

    plan = read_plan(job.printer_folder / PLAN)
    paths = _scans(job)
    job.tell(0.1, "measure")
    seen: dict[str, Any] = {}

    def look(reading: Any) -> None:
        factor = _write_seen(job.picture(SEEN), reading.image)
        px = np.full((len(plan), 2), np.nan)
        found = reading.marks.found
        px[found] = (reading.dots.centre_px[reading.marks.match.dot[found]] + 0.5) * factor
        lost = image_px(reading, reading.marks.expected_mm[~found])
        seen.update(marks_px=_plain(px, 1), missing_px=_plain((lost + 0.5) * factor, 1),
                    size_px=[round(side * factor) for side in reading.image.shape[1::-1]],
                    radius_px=_plain(plan.diameter_mm / 2 / reading.mm_per_px * factor, 1))  # fmt: skip
        job.tell(0.5, "measure")

    measurement = measure_scans(
        paths, plan, dpi=job.params.get("dpi"), distance_mm=job.params.get("distance_mm"), look=look
    )
    write_trace(job.file("trace.csv"), measurement.trace)
    off = measurement.measured_mm - plan.marks_mm
    return {
        **seen, "marks": len(plan), "missing": measurement.missing.tolist(), "odd": _odd(plan.marks_mm, off),
        "notes": [note.replace(f"{job.given}{os.sep}", "") for note in measurement.notes],
        "asked": None if measurement.asked is None else list(measurement.asked), "asked_mm": measurement.asked_mm,
        "errors_mm": _plain(off, 4), "marks_mm": _plain(plan.marks_mm, 2), "big": plan.big.tolist(),
        "rms_mm": float(np.sqrt(np.nanmean(np.nansum(off**2, axis=1)))),
    }  # fmt: skip


_NEIGHBOURS = 12  # neighbours of a mark, whose median error it should have
_ODD_RATIO = 8.0  # a mark is odd if it differs from this median by more than this multiple of the usual


def _odd(marks_mm: np.ndarray, off_mm: np.ndarray) -> list[int]:
    """Return the marks that lie far from where their neighbours would put them: dirt, or a dot that moved."""
    from scipy.spatial import KDTree

    found = np.flatnonzero(np.isfinite(off_mm).all(axis=1))
    if len(found) <= _NEIGHBOURS:
        return []
    _, near = KDTree(marks_mm[found]).query(marks_mm[found], _NEIGHBOURS)
    apart = np.hypot(*(off_mm[found] - np.median(off_mm[found][near], axis=1)).T)
    usual = max(float(np.median(apart)), 0.005)
    return [int(mark) for mark in found[apart > _ODD_RATIO * usual]]


def _plain(values: np.ndarray, digits: int) -> list[Any]:
    """Return rounded numbers, with None for NaN."""
    rounded = np.round(values, digits)
    return np.where(np.isfinite(rounded), rounded.astype(object), np.array(None)).tolist()


def _learn(job: Job) -> dict[str, Any]:
    """Learn a machine from a measurement, or from the user's own table; store it as the printer's model."""
    from dataclasses import replace

    from printmend.measure import read_plan, read_trace
    from printmend.mend.filament import learn_in, update_in
    from printmend.model import read_model, write_model
    from printmend.printer import read_printer
    from printmend.studio.said import said

    printer = read_printer(job.printer_folder / PRINTER)
    job.tell(0.1, "learn")
    if "upload" in job.params:
        trace = read_trace(_named(job, job.params["upload"], "trace.csv"), printer)
    elif "part" in job.params:
        trace = read_trace(job.data / "jobs" / job.params["part"] / "trace.csv", printer)
    else:
        trace = read_trace(job.data / "jobs" / job.params["measurement"] / "trace.csv", printer)
        plan = read_plan(job.printer_folder / PLAN)
        if trace.origin is not None and trace.origin != plan.origin:  # its marks had other numbers
            raise InputError(
                say("measurement-3"), wanted=say("present-test-print"), came=say("test-print-before"),
                todo=say("measure-present"),
            )  # fmt: skip
        rows = plan.rows
        measured = trace.measured_mm.copy()
        measured[rows[[mark for mark in job.params["exclude"] if mark < len(rows)]]] = np.nan
        trace = replace(trace, measured_mm=measured)
    filament, is_known = job.params.get("filament"), (job.printer_folder / MODEL).is_file()
    if is_known and (trace.z_measured_mm is not None or "part" in job.params):  # keep the earlier knowledge
        old = read_model(job.printer_folder / MODEL)
        model = update_in(old, trace, filament, rng=np.random.default_rng(0)).model
    else:
        model = learn_in(trace, printer, filament)
    job.tell(0.95, "learn")
    write_model(job.file(MODEL), model)
    write_model(job.printer_folder / MODEL, model)
    return {"said": said(model)}


def _check_print(job: Job) -> dict[str, Any]:
    """Mend the test print itself: printed and measured, it shows whether the promise is kept."""
    from printmend.mend import mend_gcode
    from printmend.model import read_model

    model = read_model(job.printer_folder / MODEL)
    mend_gcode(job.printer_folder / PROBE, model, job.file("check.mended.gcode"), force=True)
    return {"digest": model.digest}  # its dots are printed at rest, so a prediction of lines does not matter


def _verify(job: Job) -> dict[str, Any]:
    """Measure a mended check print, or a mended part, and compare it with the promise."""
    from printmend.measure import read_plan, read_trace
    from printmend.measure.distance import is_asking
    from printmend.measure.measurement import measure_scans
    from printmend.mend.filament import updated_in, verify_in
    from printmend.mend.part import measure_part
    from printmend.mend.verify import remember_verdict, update_words
    from printmend.model import read_model, write_model

    model, filament = read_model(job.printer_folder / MODEL), job.params.get("filament")
    paths = _scans(job)
    job.tell(0.1, "measure")
    asked: list[str] = []
    if len(paths) == 1 and paths[0].suffix.lower() == ".csv":
        trace = read_trace(paths[0], model.printer)
    elif "part" in job.params:
        part, distance_mm = _named(job, job.params["part"], job.params["name"]), job.params.get("distance_mm")
        trace = measure_part(
            paths[0], part, model.printer, dpi=job.params.get("dpi"), distances_mm=[distance_mm] if distance_mm else [],
        ).trace  # fmt: skip
    else:
        plan = read_plan(job.printer_folder / PLAN)
        measurement = measure_scans(
            paths, plan, dpi=job.params.get("dpi"), distance_mm=job.params.get("distance_mm"),
            look=lambda reading: job.tell(0.5, "measure"),
        )  # fmt: skip
        trace, asked = measurement.trace, [note for note in measurement.notes if is_asking(note)]
    job.tell(0.8, "compare")
    verdict = verify_in(model, trace, filament)
    remember_verdict(job.printer_folder / MODEL, model, verdict)
    newer = updated_in(model, trace, filament)
    write_model(job.file(MODEL), newer.model)
    return {"verdict": verdict.json(), "words": verdict.words, "newer": update_words(verdict, newer),
            "asked": asked}  # fmt: skip


def _send(job: Job) -> dict[str, Any]:
    """Send the test print or a file that another job made to the printer's OctoPrint or Moonraker."""
    from printmend.studio.host import NAMES, read_host, send_file

    host, name = read_host(job.printer_folder), job.params["name"]
    if host is None:
        raise InputError(
            say("this-printer"), wanted=say("address"), came=say("none-any-more"), todo=say("connect-again")
        )
    folder = job.data / "jobs" / job.params["job"] if "job" in job.params else job.printer_folder
    job.tell(0.0, "send")
    send_file(host, folder / name, name, lambda share: job.tell(0.95 * share, "send", now=False))
    return {"name": name, "host": NAMES[host.kind], "address": host.address}


def mended_name(name: str) -> str:
    """Return the name of a mended file: part.gcode.3mf becomes part.mended.gcode.3mf."""
    from printmend.mend.many import mended_path

    return mended_path(Path(name)).name


# Long: all steps from a broken printer to a mended part.
def _play(job: Job) -> dict[str, Any]:
    """Break a virtual printer, scan its test print, learn from it, and mend a part that was not learned from."""
    from dataclasses import replace

    from printmend.learn.learned import learn_model
    from printmend.measure.image import write_image
    from printmend.measure.measurement import measure_scans
    from printmend.mend import mend_gcode
    from printmend.mend.update import update
    from printmend.model import write_model
    from printmend.path import Trace
    from printmend.studio.play import faults_of, plate_gcode, play_printer, tower_trace
    from printmend.studio.said import said
    from printmend.studio.scene import Tap, as_mended, as_printed, read_drawing, write_mended, write_thumb, write_wanted
    from printmend.twin import Twin
    from printmend.twin.scanner import DEFAULT, scan_trace

    faults = faults_of(job.params["faults"])
    job.tell(0.03, "print")
    printer, plan = play_printer()
    broken = faults.corruption(printer)
    twin, truth = (
        Twin.of(replace(broken, screw=None), printer),
        Twin.of(broken, printer).homed(),
    )  # without the screw, which a flat print does not show
    part = job.folder / "part.gcode"
    with replacing(part, "wb") as file:
        file.write(plate_gcode(printer))
    drawing, tap = read_drawing(part, printer), Tap()
    along = twin.printed_along
    scene = as_printed(drawing, truth, aligned=True, along=along)
    write_thumb(job.picture(THUMB), scene)
    write_wanted(job.picture(WANTED), scene)
    printed = twin.seen(plan.waypoints_mm)
    job.tell(0.1, "scan")
    seed, scans = job.params.get("seed", 0), [job.folder / f"scan-{turns}.png" for turns in range(2)]
    for turns, path in enumerate(scans):  # the plate turned by a quarter: one scan cannot tell the scanner's axes apart
        scan = scan_trace(Trace(plan.waypoints_mm, printed), plan, dpi=_PLAY_DPI, degradations=DEFAULT,
                          rng=np.random.default_rng(seed), quarter_turns=turns)  # fmt: skip
        write_image(path, scan.image, dpi=_PLAY_DPI)
        if not turns:
            _write_seen(job.picture(SEEN), scan.image)
    job.tell(0.3, "measure")
    measurement = measure_scans(scans, plan)
    job.tell(0.5, "learn")
    model = learn_model(measurement.trace, printer)
    if broken.screw is not None:  # no flat print shows the screw
        job.tell(0.75, "tower")
        rng = np.random.default_rng(seed)
        model = update(model, tower_trace(broken, printer, rng), rng=rng).model
    write_model(job.file(MODEL), model)
    job.tell(0.85, "mend")
    refused = None
    try:
        mend_gcode(part, model, job.folder / mended_name(part.name), watch=tap.watch)
        job.file(mended_name(part.name))
    except RefusedError as error:
        refused = str(error)
    if refused is None and tap.seen:  # nothing was planned if the printer was found healthy
        scene = as_mended(scene, drawing, truth, tap, aligned=True, along=along)
        write_mended(job.picture(MENDED), scene)
    after = scene.raw_error_mm if scene.mended_error_mm is None else scene.mended_error_mm
    numbers = {name: {"rms_mm": scene.rms_mm(error), "p95_mm": float(np.quantile(error, 0.95))}
               for name, error in (("before", scene.raw_error_mm), ("after", after))}  # fmt: skip
    return {
        "marks": len(plan), "missing": len(measurement.missing), "refused": refused,
        "said": said(model), **numbers, "true": _true(truth),
    }  # fmt: skip


def _true(truth: Any) -> dict[str, Any]:
    from printmend.studio.said import drawn

    return drawn(truth)


def _write_seen(path: Path, image: np.ndarray) -> float:
    """Write a smaller copy of an image for the page; return its scale."""
    import cv2

    factor = min(1.0, _SEEN_PX / max(image.shape[:2]))
    small = cv2.resize(image, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
    done, data = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, 82])
    if done:
        with replacing(path, "wb") as file:
            file.write(data.tobytes())
    return factor


def _fit(job: Job) -> dict[str, Any]:
    """Check whether a part fits."""
    from printmend.studio.fits import fit

    return fit(job, _named(job, job.params["upload"], job.params["name"]), _scans(job))


KINDS: dict[str, Callable[[Job], dict[str, Any]]] = {
    "mend": _mend, "play": _play, "measure": _measure, "learn": _learn, "check": _check_print, "verify": _verify,
    "send": _send, "fit": _fit,
}  # fmt: skip
