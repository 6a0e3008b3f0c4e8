"""What the worker processes do: one function for each kind of job, over the functions that the command line calls.

A job has a folder of its own. It says there how far it is (`progress.json`), leaves its files there, and returns a
small table: numbers, words and the names of the files that may be fetched. Everything is written beside and renamed, so
a job that was killed is simply run again.
"""

import json
import os
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from printmend.errors import InputError, PrintmendError, RefusedError
from printmend.files import replacing

Params = dict[str, Any]
PROGRESS = "progress.json"
MODEL, PRINTER, PLAN, PROBE = "printer.mend.json", "printer.toml", "probe.json", "probe.gcode"
_PLAY_DPI = 300.0
_SEEN_PX = 1800  # of a scan as it is shown


class Job:
    """One job: where it works, and whom it tells how far it is."""

    def __init__(self, folder: Path, data: Path, params: Params) -> None:
        self.folder, self.data, self.params = folder, data, params
        self.files: list[str] = []
        self._begun_s, self._told_s = time.time(), 0.0
        folder.mkdir(parents=True, exist_ok=True)

    def tell(self, share: float, step: str, *, now: bool = True) -> None:
        """Say that ``share`` 0–1 is done and what comes next; with ``now`` false only if that was a while ago."""
        if not now and time.time() - self._told_s < 0.2:
            return
        self._told_s = time.time()
        spent_s = self._told_s - self._begun_s
        left_s = spent_s * (1 - share) / share if share > 0.02 and spent_s > 0.5 else None
        told = {"share": round(share, 3), "step": step, "left_s": left_s, "files": self.files}
        beside = self.folder / f"{PROGRESS}.new"
        beside.write_text(json.dumps(told), encoding="utf-8")
        os.replace(beside, self.folder / PROGRESS)  # worth nothing after a power cut: no fsync

    def file(self, name: str) -> Path:
        """Return where a file goes that may be fetched, now that it is there or at the job's end."""
        if name not in self.files:
            self.files.append(name)
        return self.folder / name

    @property
    def printer_folder(self) -> Path:
        """The folder of the job's printer."""
        return self.data / "printers" / self.params["printer"]

    def upload(self, key: str) -> Path:
        """Return an uploaded file. Raises `InputError` where it is gone."""
        path = self.data / "uploads" / key
        if not path.is_file():
            raise InputError(key, wanted="an upload of this studio", came="none", todo="drop the file again")
        return path


def begin() -> None:
    """Begin a worker: Ctrl-C in the terminal is the server's to handle."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    imports()


def imports() -> None:
    """Import what every job needs, so that the first one does not wait for it."""
    import printmend.repair.mend
    import printmend.studio.scene  # noqa: F401


def run(kind: str, folder: str, data: str, params: Params) -> dict[str, Any]:
    """Run one job; return its result, or ``error`` in one line."""
    job = Job(Path(folder), Path(data), params)
    try:
        result = KINDS[kind](job)
    except PrintmendError as error:
        return {"error": str(error)}
    return {**result, "files": job.files}


def read_progress(folder: Path) -> dict[str, Any]:
    """Return what a job last said of itself."""
    try:
        return dict(json.loads((folder / PROGRESS).read_text(encoding="utf-8")))
    except (OSError, ValueError):
        return {}


def _mend(job: Job) -> dict[str, Any]:
    """Mend one file, show it in three dimensions, and predict what it comes to."""
    from printmend.repair import mend_gcode
    from printmend.repair.mend import check_gcode, is_healthy
    from printmend.saved.model import read_model
    from printmend.studio.scene import build_scene, write_scene

    model = read_model(job.printer_folder / MODEL)
    source, name = job.upload(job.params["upload"]), job.params["name"]
    named = job.folder / name
    if not named.exists():
        os.link(source, named)  # what kind of file it is, its name says
    size = max(source.stat().st_size, 1)
    job.tell(0.05, "read")
    if job.params.get("scene", True):
        write_scene(job.file("wanted.bin"), build_scene(named, model.mechanism, plan=None))
        job.tell(0.3, "mend")
    seen = 0

    def tick(count: int) -> None:
        nonlocal seen
        seen += count
        job.tell(0.3 + 0.4 * min(seen / size, 1.0), "mend", now=False)

    refused, output = None, mended_name(name)
    try:
        prediction = mend_gcode(named, model, job.folder / output, progress=tick).prediction
        job.file(output)
    except RefusedError as error:
        refused, prediction = str(error), check_gcode(named, model)
    job.tell(0.7, "draw")
    if job.params.get("scene", True) and not is_healthy(model):
        write_scene(job.file("scene.bin"), build_scene(named, model.mechanism, plan=model.mechanism))
    table = prediction.json()
    table.pop("layers")
    return {"name": name, "output": None if refused else output, "refused": refused, "prediction": table,
            "layers": [[round(layer[key], 4) for key in ("z_mm", "before_rms_mm", "after_rms_mm")]
                       for layer in prediction.layers],
            "bytes": source.stat().st_size, "digest": model.digest,
            "summary": prediction.summary()}  # fmt: skip


def mended_name(name: str) -> str:
    """Return the name of a mended file: part.gcode.3mf becomes part.mended.gcode.3mf."""
    from printmend.repair.many import mended_path

    return mended_path(Path(name)).name


def _play(job: Job) -> dict[str, Any]:
    """Break a printer that exists only here, scan its test print, learn, and mend a part that nobody learned from."""
    from printmend.body import demo_body_gcode
    from printmend.measure.image import write_image
    from printmend.measure.measurement import measure_scans
    from printmend.path import Trace
    from printmend.repair import mend_gcode
    from printmend.repair.learned import learn_model
    from printmend.saved.model import write_model
    from printmend.studio.play import faults_of, play_printer
    from printmend.studio.said import said
    from printmend.studio.scene import build_scene, write_scene
    from printmend.twin import Twin
    from printmend.twin.scanner import DEFAULT, scan_trace

    faults = faults_of(job.params["faults"])
    job.tell(0.03, "print")
    printer, plan = play_printer()
    twin = Twin.of(faults.corruption(printer), printer)
    truth = twin.homed()
    part = job.folder / "part.gcode"
    with replacing(part, "wb") as file:
        file.write(demo_body_gcode())
    write_scene(job.file("wanted.bin"), build_scene(part, truth, plan=None, aligned=True))
    printed = twin.follow(plan.waypoints_mm)
    job.tell(0.1, "scan")
    rng = np.random.default_rng(job.params.get("seed", 0))
    scan = scan_trace(Trace(plan.waypoints_mm, printed), plan, dpi=_PLAY_DPI, degradations=DEFAULT, rng=rng)
    write_image(job.folder / "scan.png", scan.image, dpi=_PLAY_DPI)
    _write_seen(job.file("seen.jpg"), scan.image)
    job.tell(0.3, "measure")
    measurement = measure_scans([job.folder / "scan.png"], plan)
    job.tell(0.5, "learn")
    model = learn_model(measurement.trace, printer)
    write_model(job.file(MODEL), model)
    job.tell(0.85, "mend")
    refused = None
    try:
        mend_gcode(part, model, job.folder / mended_name(part.name))
        job.file(mended_name(part.name))
    except RefusedError as error:
        refused = str(error)
    scene = build_scene(part, truth, plan=model.mechanism if refused is None else None, aligned=True)
    write_scene(job.file("scene.bin"), scene)
    after = scene.raw_error_mm if scene.mended_error_mm is None else scene.mended_error_mm
    numbers = {name: {"rms_mm": scene.rms_mm(error), "p95_mm": float(np.quantile(error, 0.95))}
               for name, error in (("before", scene.raw_error_mm), ("after", after))}  # fmt: skip
    return {
        "marks": len(plan), "missing": len(measurement.missing), "notes": list(measurement.notes), "refused": refused,
        "said": said(model), **numbers, "true": _true(truth),
    }  # fmt: skip


def _true(truth: Any) -> dict[str, Any]:
    from printmend.studio.said import drawn

    return drawn(truth)


def _write_seen(path: Path, image: np.ndarray) -> float:
    """Write an image small enough to be shown; return by how much it was made smaller."""
    import cv2

    factor = min(1.0, _SEEN_PX / max(image.shape[:2]))
    small = cv2.resize(image, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
    done, data = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, 82])
    if done:
        with replacing(path, "wb") as file:
            file.write(data.tobytes())
    return factor


KINDS: dict[str, Callable[[Job], dict[str, Any]]] = {"mend": _mend, "play": _play}
