# SPDX-License-Identifier: AGPL-3.0-or-later
"""OctoPrint plugin: every uploaded G-code file gets a mended copy, and only that is printed.

An upload is answered at once; one worker mends `x.gcode` to `x.mended.gcode` and keeps what it knows in both files'
metadata. Whatever is to be printed is judged before its first line is sent: by the record of how it was mended, or by
the seal that printmend puts under a file (provenance.py). A print of the original is held, and its copy is printed once
it is there. A test print that `printmend probe` wrote is printed as it is. printmend runs as a program of its own.
"""

import contextlib
import importlib.metadata
import json
import os
import queue
import re
import shutil
import tempfile
import threading
import time

import flask
import octoprint.plugin
from octoprint.access.permissions import Permissions
from octoprint.events import Events
from octoprint.filemanager.destinations import FileDestinations
from octoprint.filemanager.util import DiskFileWrapper

from octoprint_printmend import provenance
from octoprint_printmend.program import FOLLOW_S, Program

ENDING = ".mended.gcode"
LOCAL = FileDestinations.LOCAL
ENDED = (Events.PRINT_DONE, Events.PRINT_FAILED, Events.PRINT_CANCELLED)
LOOK_S = 0.2
LATER_S = 1.0  # between two looks whether the printer is free
MODEL_BYTES = 64 << 20  # the largest model that can be uploaded
TEST_PART_MM = 20.0


class PrintmendPlugin(
    octoprint.plugin.StartupPlugin,
    octoprint.plugin.ShutdownPlugin,
    octoprint.plugin.EventHandlerPlugin,
    octoprint.plugin.SettingsPlugin,
    octoprint.plugin.TemplatePlugin,
    octoprint.plugin.AssetPlugin,
    octoprint.plugin.SimpleApiPlugin,
    octoprint.plugin.BlueprintPlugin,
):
    """What OctoPrint loads."""

    def __init__(self):
        self._queue = queue.Queue()  # functions with their arguments: what the worker does one after the other
        self._wanted = None  # what is to be printed as soon as it is mended
        self._mending = None
        self._allowed = None  # may the lines of the job that is running be sent?
        self._later = []  # what is to be mended when nothing is printed
        self._leftovers = set()  # copies whose original was deleted while they were printed
        self._program = Program()
        self._model_read = (None, None)
        self._ended = False
        self._stopped, self._pause_s = threading.Event(), 1.0

    def initialize(self):
        self._ledger = provenance.Ledger(self.get_plugin_data_folder(), self._language())

    def _language(self):
        return str(self._settings.global_get(["appearance", "defaultLanguage"]) or "")

    def _said(self, name, *values):
        return provenance.said(self._language(), name, *values)

    # Settings and pages.

    def get_settings_defaults(self):
        choices = {f"if_{state}": known[0] for state, known in provenance.CHOICES.items()}
        return {"command": "~/printmend/bin/printmend", "model": "~/printer.mend.json", "wait": True, **choices}

    def get_settings_version(self):
        return 1

    def on_settings_migrate(self, target, current):
        if current is None and self._settings.get_boolean(["print_unmended"]):
            self._settings.set(["if_unmended"], "print")

    def get_template_configs(self):
        return [{"type": "settings", "custom_bindings": True}]

    def is_template_autoescaped(self):
        return True

    def get_assets(self):
        return {"js": ["js/printmend.js"]}

    def get_api_commands(self):
        return {"cancel": [], "mend_all": [], "test": [], "update": [], "pair": ["address", "code"]}

    def is_api_protected(self):
        return True

    def is_blueprint_csrf_protected(self):
        return True

    def on_api_get(self, request):
        model = self._model()
        told = {"model": model.digest, "printer": model.name} if model is not None else {}
        return flask.jsonify(**told, models=self._models(), mending=self._mending,
                             waiting=[task[2] for task in self._later])  # fmt: skip

    def on_api_command(self, command, data):
        if not Permissions.FILES_UPLOAD.can():
            flask.abort(403)
        if command == "test":
            self._queue.put((self._test,))
            return flask.jsonify(queued=True)
        if command == "update":
            self._queue.put((self._update,))
            return flask.jsonify(queued=True)
        if command == "pair":
            if not Permissions.SETTINGS.can():
                flask.abort(403)
            return flask.jsonify(error=self._pair(str(data["address"]).strip(), re.sub(r"\s", "", str(data["code"]))))
        if command == "mend_all":
            return flask.jsonify(queued=self._mend_all())
        if self._mending is not None:
            self._program.stop()
        return flask.jsonify(cancelled=self._program.cancelled)

    @octoprint.plugin.BlueprintPlugin.route("/model", methods=["POST"])
    @Permissions.SETTINGS.require(403)
    def upload_model(self):
        """Keep a model that the page sends, and mend with it from now on."""
        folder = os.path.join(self.get_plugin_data_folder(), "models")
        os.makedirs(folder, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=folder, suffix=".tmp", delete=False) as file:
            file.write(flask.request.get_data())
        try:
            model = provenance.read_model(file.name)
        except provenance.NoModelError as error:
            os.unlink(file.name)
            return flask.jsonify(error=str(error).replace(file.name, "the file")), 400
        plain = re.sub(r"[^A-Za-z0-9]+", "-", model.name).strip("-") or "printer"
        place = os.path.join(folder, f"{plain}.{model.digest[:8]}.mend.json")
        os.replace(file.name, place)
        self._take(place)
        return flask.jsonify(path=place, model=model.digest, printer=model.name)

    def _take(self, model):
        """Mend with a model from now on."""
        self._settings.set(["model"], model)
        self._settings.save(trigger_event=True)

    def _pair(self, address, code):
        """Take the model of a studio's printer, and each newer one from then on; return why that was not possible."""
        model = os.path.join(self.get_plugin_data_folder(), "models", "studio.mend.json")
        os.makedirs(os.path.dirname(model), exist_ok=True)
        reason = self._program.pair(
            os.path.expanduser(self._settings.get(["command"])), model, address, code, self._language()
        )
        if not reason:
            self._take(model)
        return reason

    def _models(self):
        """Return the models that were uploaded, the latest first."""
        folder = os.path.join(self.get_plugin_data_folder(), "models")
        names = [name for name in os.listdir(folder) if name.endswith(".json")] if os.path.isdir(folder) else []
        paths = sorted((os.path.join(folder, name) for name in names), key=os.path.getmtime, reverse=True)
        return [{"path": path, "name": os.path.basename(path)[: -len(".mend.json")]} for path in paths]

    def _test(self):
        """Mend a small square in the middle of the bed, and say what came of it."""
        self._program.cancelled = False
        with tempfile.TemporaryDirectory(dir=self.get_plugin_data_folder()) as work:
            source, fresh, report = (os.path.join(work, end) for end in ("test.gcode", "out.gcode", "report.json"))
            with open(source, "w", encoding="utf-8") as file:
                file.write(square(self._printer_profile_manager.get_current_or_default()["volume"]))
            begun_s = time.monotonic()
            reason = self._run(source, fresh, report)
            told = {}
            if not reason and os.path.exists(report):
                with open(report, encoding="utf-8") as file:
                    told = {key: value for key, value in json.load(file).items() if key in ("before", "after")}
        model = self._model()
        self._say("tested", "", reason=reason.replace(source, self._said("square")), took_s=time.monotonic() - begun_s,
                  printer=model.name if model is not None else "", **told)  # fmt: skip

    def _run(self, source, fresh, report, told=lambda percent: None):
        command, model = (os.path.expanduser(self._settings.get([key])) for key in ("command", "model"))
        return self._program.mend(command, model, source, fresh, report, told, self._language())

    # What a file is.

    def _model(self):
        """Return what identifies the model; nothing where another computer holds it."""
        path = os.path.expanduser(self._settings.get(["model"]))
        try:
            at = os.stat(path)
            seen = (path, at.st_size, at.st_mtime_ns)
            if self._model_read[0] != seen:
                self._model_read = (seen, provenance.read_model(path))
        except (OSError, provenance.NoModelError):
            return None
        return self._model_read[1]

    def _judge(self, path):
        """Return a file's verdict and what the owner wants to be done with it."""
        source = self._source(path)
        original = self._disk(source) if source else None
        verdict = self._ledger.judge(self._disk(path), self._model(), original=original)
        chosen = {state: self._settings.get([f"if_{state}"]) for state in provenance.CHOICES}
        return verdict, provenance.action(verdict.state, chosen)

    def _disk(self, path):
        return self._file_manager.path_on_disk(LOCAL, path)

    def _report(self, path):
        return (self._file_manager.get_metadata(LOCAL, path) or {}).get("printmend", {})

    def _source(self, path):
        """Return the original beside a copy that still has the name it was given."""
        source = self._report(path).get("source", "")
        return source if source and copy_name(source) == path else ""

    def _original(self, verdict, path):
        """Return the file that a stale one was mended from, wherever it was moved to; nothing where it is gone."""
        if (source := self._source(path)) and self._file_manager.file_exists(LOCAL, source):
            return source
        if verdict.record is None:
            return ""
        for one in [verdict.record.original, *self._files()]:
            if self._report(one).get("sha256") == verdict.record.source or one == verdict.record.original:
                with contextlib.suppress(OSError):
                    if self._ledger.sha256(self._disk(one)) == verdict.record.source:
                        return one
        return ""

    def _mended(self, path, verdict):
        """Return (the file to mend, where to) so that what was to be printed can be; nothing where that cannot be."""
        if verdict.state == provenance.UNMENDED:
            return path, copy_name(path)
        source = self._original(verdict, path)
        return (source, copy_name(source) if source == path else path) if source else None

    def _note(self, path, told):
        self._file_manager.set_additional_metadata(LOCAL, path, "printmend", told, overwrite=True)

    def _note_verdict(self, path, verdict, **more):
        told = {"state": verdict.state, "reason": verdict.sentence, "sha256": verdict.sha256, **more}
        if verdict.record is not None:
            told.update(verdict.record.promise, model=verdict.record.model)
        self._note(path, told)

    def _files(self):
        """Return the paths of all G-code files here."""
        found, folders = [], [self._file_manager.list_files(LOCAL, recursive=True)[LOCAL]]
        while folders:
            for entry in folders.pop().values():
                if entry["type"] == "folder":
                    folders.append(entry["children"])
                elif entry["type"] == "machinecode":
                    found.append(entry["path"])
        return found

    # Files that come and go.

    def on_after_startup(self):
        threading.Thread(target=self._work, name="printmend", daemon=True).start()
        threading.Thread(target=self._follow, name="printmend-model", daemon=True).start()

    def _follow(self):
        """Look for a newer model in the studio, again and again, where the model is paired with one."""
        while not self._stopped.wait(self._pause_s):
            self._pause_s = FOLLOW_S
            self._queue.put((self._update,))

    def _update(self):
        command, model = (os.path.expanduser(self._settings.get([key])) for key in ("command", "model"))
        if reason := self._program.update(command, model, self._language()):
            self._logger.warning("no newer model: %s", reason)

    def on_shutdown(self):
        self._ended = True
        self._stopped.set()
        self._queue.put(None)
        self._program.stop()

    def on_event(self, event, payload):
        if event in (Events.FILE_ADDED, Events.FILE_REMOVED):
            path = payload["path"]
            if payload["storage"] == LOCAL and "gcode" in (payload["type"] or ()):
                self._drop_copy(path)  # of what was here under this name before
                if event == Events.FILE_ADDED:
                    self._queue.put((self._consider, path))
        elif event in ENDED:
            self._allowed = None
            leftovers, self._leftovers = self._leftovers, set()
            for copy in leftovers:
                self._remove(copy)

    def _drop_copy(self, path):
        """Remove the copy that was made of a file: its original is another one now, or gone."""
        copy = copy_name(path)
        if self._file_manager.file_exists(LOCAL, copy) and self._report(copy).get("source") == path:
            self._remove(copy)

    def _remove(self, copy):
        if not self._file_manager.file_exists(LOCAL, copy):
            return
        job = self._printer.get_current_job()["file"]
        if job.get("origin") == LOCAL and job.get("path") == copy:
            if self._is_busy():
                self._leftovers.add(copy)
                return
            self._printer.unselect_file()
        self._file_manager.remove_file(LOCAL, copy)

    def _is_busy(self):
        return self._printer.is_printing() or self._printer.is_paused()

    def _work(self):
        while True:
            try:
                task = self._queue.get(timeout=LATER_S if self._later else None)
            except queue.Empty:  # no event says when a job that ended has left the printer free
                if not self._is_busy():
                    later, self._later = self._later, []
                    for waited in later:
                        self._queue.put(waited)
                continue
            if task is None:
                return
            function, *arguments = task
            try:
                function(*arguments)
            except Exception:
                self._logger.exception("%s", arguments)
                if arguments:
                    self._fail(*arguments, reason=self._said("plugin", "octoprint.log"))
            self._mending = None

    def _consider(self, path):
        """Say what a new file is, and mend it where that is wanted."""
        if not self._file_manager.file_exists(LOCAL, path):
            return
        verdict, wanted = self._judge(path)
        told = {key: value for key in ("source", "copy") if (value := self._report(path).get(key))}
        if told.get("source") and not self._source(path):
            told.pop("source")  # it was renamed
        if told.get("copy") != copy_name(path) or not self._good(copy_name(path)):
            told.pop("copy", None)
        self._note_verdict(path, verdict, **told)
        if verdict.state in (provenance.FOREIGN, provenance.FORGED, provenance.TEST_PRINT):
            self._say(verdict.state, path, reason=verdict.sentence, held=wanted == "hold")
        mended = self._mended(path, verdict) if verdict.state in (provenance.UNMENDED, provenance.STALE) else None
        if wanted != "hold" and mended is not None and not told.get("copy"):
            self._mend(*mended)

    def _good(self, copy):
        """Say whether a copy is there and may be printed."""
        if not self._file_manager.file_exists(LOCAL, copy):
            return False
        return self._judge(copy)[0].state == provenance.CURRENT

    def _mend_all(self):
        """Queue all that is here and not mended, or was with an earlier model; return the names."""
        queued = []
        for path in self._files():
            verdict, wanted = self._judge(path)
            mended = self._mended(path, verdict) if wanted == "mend" else None
            if mended is not None and not self._good(mended[1]) and mended[1] not in queued:
                queued.append(mended[1])
                self._queue.put((self._mend, *mended))
        return queued

    def _mend(self, path, target):
        """Mend a file into another, with its record; say what happened."""
        if self._settings.get_boolean(["wait"]) and self._is_busy() and self._wanted != target:
            self._later.append((self._mend, path, target))
            return
        if not self._file_manager.file_exists(LOCAL, path):
            self._fail(path, target, reason=self._said("deleted"))
            return
        if self._good(target):  # another task made it meanwhile
            return
        self._program.cancelled = False
        self._mending = path
        self._say("start", path)
        with tempfile.TemporaryDirectory(dir=self.get_plugin_data_folder()) as work:
            source, fresh, report = (os.path.join(work, end) for end in ("in.gcode", "out.gcode", "report.json"))
            shutil.copyfile(self._disk(path), source)
            reason = self._run(source, fresh, report, lambda percent: self._tell("progress", path, percent=percent))
            if reason:
                self._fail(path, target, reason=reason)
                return
            told = {}
            if os.path.exists(report):
                with open(report, encoding="utf-8") as file:
                    told = json.load(file)
            record = provenance.record_of(source, fresh, self._model(), original=path, report=told)
            self._ledger.write(record)
            self._file_manager.add_file(LOCAL, target, DiskFileWrapper(os.path.basename(target), fresh, move=True),
                                        allow_overwrite=True)  # fmt: skip
        link = {"source": path} if copy_name(path) == target else {}
        self._note_verdict(target, self._ledger.judge(self._disk(target), self._model()), **link)
        if link:
            self._note_verdict(path, self._ledger.judge(self._disk(path), self._model()), copy=target)
        self._say("done", path, copy=target, before=told.get("before"), after=told.get("after"))

    def _fail(self, path, target=None, *, reason):
        if self._wanted is not None and self._wanted in (path, target):
            self._wanted = None
        if self._file_manager.file_exists(LOCAL, path):
            self._note(path, {"state": "failed", "reason": reason})
        self._say("failed", path, reason=reason)

    def _say(self, what, path, **more):
        self._logger.info("%s %s %s", what, path, more)
        self._tell(what, path, **more)

    def _tell(self, what, path, **more):
        """Tell the pages that are open."""
        self._plugin_manager.send_plugin_message(self._identifier, {"what": what, "path": path, **more})

    # Jobs.

    def hold(self, comm, phase, cmd, cmd_type, gcode, *args, **kwargs):
        """Hook before each line: no line of a file that may not be printed goes to the printer."""
        if "source:file" not in (kwargs.get("tags") or ()):
            return None
        if self._allowed is None:
            job = self._printer.get_current_job()["file"]
            self._allowed = job.get("origin") != LOCAL or self._may_print(job["path"])
        return None if self._allowed else (None,)

    def _may_print(self, path):
        """Say whether a file may be printed; where it may not, stop the job, and print what it is mended to."""
        try:
            verdict, wanted = self._judge(path)
            mended = self._mended(path, verdict) if wanted == "mend" else None
        except Exception:  # whatever happens here: the printer gets no line that nobody judged
            self._logger.exception("judging %s", path)
            verdict, wanted, mended = None, "hold", None
        if wanted == "print":
            return True
        if mended is not None:
            self._wanted = mended[1]
        threading.Thread(target=self._redirect, args=(path, verdict, mended), daemon=True).start()
        return False

    def _redirect(self, path, verdict, mended):
        """Stop the job, and print the mended copy as soon as it is there and the printer is free."""
        if mended is None:
            reason = verdict.sentence if verdict is not None else self._said("unreadable")
            if verdict is not None and verdict.state == provenance.STALE:
                reason += " " + self._said("no-original")
            self._say("refused", path, reason=reason)
            self._printer.cancel_print()
            return
        self._say("held", path)
        source, target = mended
        if not self._good(target):
            self._queue.put((self._mend, source, target))
        self._printer.cancel_print()
        while self._wanted == target and not self._ended:
            time.sleep(LOOK_S)
            if self._printer.is_ready() and self._good(target):
                self._wanted, self._allowed = None, None
                self._printer.select_file(target, False, printAfterSelect=True)


def copy_name(path):
    """Return the name of a file's mended copy."""
    folder, name = os.path.split(path)
    return os.path.join(folder, name.rsplit(".", 1)[0] + ENDING)


def square(volume):
    """Return G-code of one square in the middle of a bed."""
    x, y = (0.0, 0.0) if volume["origin"] == "center" else (volume["width"] / 2, volume["depth"] / 2)
    half = TEST_PART_MM / 2
    corners = [(x + a * half, y + b * half) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1))]
    lines = ["G21", "G90", "M83", "G28", "G1 Z0.2 F600", "G1 X{:.3f} Y{:.3f} F6000".format(*corners[0])]
    lines += ["G1 X{:.3f} Y{:.3f} E0.66 F1800".format(*corner) for corner in corners[1:]]
    return "\n".join(lines) + "\n"


def body_sizes(current_max_body_sizes, *args, **kwargs):
    """Let a model be larger than OctoPrint's usual requests."""
    return [("POST", r"/model", MODEL_BYTES)]


def update_information():
    """Say where newer versions are: where this one was installed from, which pip notes (PEP 610)."""
    try:
        installed = importlib.metadata.distribution("octoprint-printmend")
        came = json.loads(installed.read_text("direct_url.json") or "{}")
    except (importlib.metadata.PackageNotFoundError, ValueError):
        return {}
    home = re.match(r"(?:git\+)?https://github\.com/([^/\s]+)/([^/\s@#]+)", came.get("url", ""))
    if home is None:  # a file, or a host that OctoPrint does not ask
        return {}
    user, repository = home[1], home[2].removesuffix(".git")
    folder = f"#subdirectory={came['subdirectory']}" if came.get("subdirectory") else ""
    return {"printmend": {
        "displayName": "printmend", "displayVersion": installed.version, "current": installed.version,
        "type": "github_release", "user": user, "repo": repository,
        "pip": f"https://github.com/{user}/{repository}/archive/{{target_version}}.zip{folder}",
    }}  # fmt: skip


__plugin_name__ = "printmend"
__plugin_author__ = "printmend's authors"
__plugin_license__ = "AGPL-3.0-or-later"
__plugin_description__ = "Mends uploaded G-code for this printer's broken pulleys, belts and frame."
__plugin_pythoncompat__ = ">=3.9,<4"
__plugin_implementation__ = PrintmendPlugin()
__plugin_hooks__ = {
    "octoprint.comm.protocol.gcode.queuing": __plugin_implementation__.hold,
    "octoprint.server.http.bodysize": body_sizes,
    "octoprint.plugin.softwareupdate.check_config": update_information,
}
