# SPDX-License-Identifier: AGPL-3.0-or-later
"""OctoPrint plugin: every uploaded G-code file gets a mended copy, and only that is printed.

An upload is answered at once; one worker mends `x.gcode` to `x.mended.gcode` and keeps the promise in the copy's
metadata. A test print that `printmend probe` wrote is printed as it is: measured mended, it would say nothing of the
printer. A print of the original, also by "upload and print", is held before its first line is sent, and the copy is
printed once it is there. printmend runs as a program of its own.
"""

import contextlib
import json
import os
import queue
import re
import shutil
import signal
import subprocess
import tempfile
import threading
import time

import flask
import octoprint.plugin
from octoprint.events import Events
from octoprint.filemanager.destinations import FileDestinations
from octoprint.filemanager.util import DiskFileWrapper

MARK = re.compile(rb"^; mended by printmend (\S+)", re.MULTILINE)
TEST_PRINT = re.compile(rb"^; printmend (probe|first layer): ", re.MULTILINE)  # as printmend.gcode.mark has it
ENDING = ".mended.gcode"
LOCAL = FileDestinations.LOCAL
PERCENT = re.compile(r"(\d+) %")  # how far printmend is, on its standard error
LIMIT_S = 3600


class PrintmendPlugin(
    octoprint.plugin.StartupPlugin,
    octoprint.plugin.ShutdownPlugin,
    octoprint.plugin.EventHandlerPlugin,
    octoprint.plugin.SettingsPlugin,
    octoprint.plugin.TemplatePlugin,
    octoprint.plugin.AssetPlugin,
    octoprint.plugin.SimpleApiPlugin,
):
    """What OctoPrint loads."""

    def __init__(self):
        self._queue = queue.Queue()
        self._wanted = None  # the original whose copy is to be printed as soon as it is there
        self._mending = None
        self._verdict = None  # of the job that is running: may its lines be sent?
        self._process = None
        self._cancelled = False

    # Settings and pages.

    def get_settings_defaults(self):
        return {"command": "~/printmend/bin/printmend", "model": "~/printer.mend.json", "print_unmended": False}

    def get_template_configs(self):
        return [{"type": "settings", "custom_bindings": False}]

    def is_template_autoescaped(self):
        return True

    def get_assets(self):
        return {"js": ["js/printmend.js"]}

    def get_api_commands(self):
        return {"cancel": []}

    def is_api_protected(self):
        return True

    def on_api_command(self, command, data):
        if self._mending is not None:
            self._cancelled = True
            self._stop()
        return flask.jsonify(cancelled=self._cancelled)

    # Files.

    def on_after_startup(self):
        threading.Thread(target=self._work, name="printmend", daemon=True).start()

    def on_shutdown(self):
        self._queue.put(None)
        self._stop()

    def _stop(self):
        """End printmend, and whatever it started: a script of the owner's may not be the program itself."""
        process = self._process
        if process is not None:
            with contextlib.suppress(OSError):  # ended by itself
                if hasattr(os, "killpg"):
                    os.killpg(process.pid, signal.SIGKILL)
                else:  # Windows
                    process.kill()

    def on_event(self, event, payload):
        if event == Events.FILE_ADDED:
            path = payload["path"]
            if payload["storage"] != LOCAL or "gcode" not in (payload["type"] or ()) or self._is_mended(path):
                return
            self._file_manager.remove_additional_metadata(LOCAL, path, "printmend")  # of a file of this name before
            if self._is_test_print(path):
                self._file_manager.set_additional_metadata(LOCAL, path, "printmend", {"state": "test print"},
                                                           overwrite=True)  # fmt: skip
                self._say("test print", path)
            else:
                self._queue.put(path)
        elif event in (Events.PRINT_DONE, Events.PRINT_FAILED, Events.PRINT_CANCELLED):
            self._verdict = None

    def _is_mended(self, path):
        """Say whether a file is a mended one: by its metadata, its name or its mark."""
        if path.endswith(ENDING) or self._report(path).get("state") == "mended":
            return True
        return MARK.search(self._head(path)) is not None

    def _is_test_print(self, path):
        """Say whether a file is a test print of printmend's, which is printed as it is."""
        return TEST_PRINT.search(self._head(path)) is not None

    def _head(self, path):
        """Return the part of a file in which the marks stand."""
        try:
            with open(self._file_manager.path_on_disk(LOCAL, path), "rb") as file:
                return file.read(1 << 20)
        except OSError:
            return b""

    def _report(self, path):
        return (self._file_manager.get_metadata(LOCAL, path) or {}).get("printmend", {})

    def _work(self):
        while (path := self._queue.get()) is not None:
            self._mending, self._cancelled = path, False
            try:
                self._mend(path)
            except Exception:
                self._logger.exception("mending %s", path)
                self._fail(path, "an error in the plugin: see octoprint.log")
            self._mending = None

    def _mend(self, path):
        """Write the mended copy of a file beside it, with its report; say what happened."""
        if not self._file_manager.file_exists(LOCAL, path):
            return
        folder, name = os.path.split(path)
        target = os.path.join(folder, name.rsplit(".", 1)[0] + ENDING)
        self._say("start", path)
        with tempfile.TemporaryDirectory(dir=self.get_plugin_data_folder()) as work:
            source, fresh, report = (os.path.join(work, end) for end in ("in.gcode", "out.gcode", "report.json"))
            shutil.copyfile(self._file_manager.path_on_disk(LOCAL, path), source)
            reason = self._run(source, fresh, report)
            if reason:
                self._fail(path, reason)
                return
            with open(report, encoding="utf-8") as file:
                words = json.load(file)
            told = {"state": "mended", "source": path, **{k: words[k] for k in ("before", "after") if k in words}}
            self._file_manager.add_file(LOCAL, target, DiskFileWrapper(os.path.basename(target), fresh, move=True),
                                        allow_overwrite=True)  # fmt: skip
        self._file_manager.set_additional_metadata(LOCAL, target, "printmend", told, overwrite=True)
        self._file_manager.set_additional_metadata(LOCAL, path, "printmend", {"state": "original", "copy": target},
                                                   overwrite=True)  # fmt: skip
        self._say("done", path, copy=target, before=told.get("before"), after=told.get("after"))

    def _run(self, source, fresh, report):
        """Run printmend; return the reason where there is no mended file."""
        command, model = (os.path.expanduser(self._settings.get([key])) for key in ("command", "model"))
        arguments = [command, "mend", source, "-m", model, "-o", fresh, "--report", report]
        environment = {k: v for k, v in os.environ.items() if k not in ("PYTHONHOME", "VIRTUAL_ENV")}
        environment["PRINTMEND_PROGRESS"] = "1"
        try:
            self._process = subprocess.Popen(  # noqa: S603 — the owner's own program, from the settings
                arguments, env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
                start_new_session=True,
            )  # fmt: skip
        except OSError as error:
            return f"{command}: {error.strerror or error}"
        if self._cancelled:  # before there was a program to stop
            self._stop()
        late = threading.Event()
        limit = threading.Timer(LIMIT_S, lambda: (late.set(), self._stop()))
        limit.start()
        lines = []
        for line in self._process.stderr:
            words = line.decode("utf-8", "replace").strip()
            if percent := PERCENT.fullmatch(words):
                self._tell("progress", self._mending, percent=int(percent[1]))
            elif words:
                lines.append(words)
        code = self._process.wait()
        limit.cancel()
        self._process = None
        if late.is_set():
            return f"mending took longer than {LIMIT_S} s"
        if self._cancelled:
            return "cancelled"
        if code == 0 and os.path.exists(fresh):
            return ""
        return lines[-1].removeprefix("printmend: ") if lines else f"printmend ended with {code}"

    def _fail(self, path, reason):
        self._process = None
        if self._wanted == path:
            self._wanted = None
        told = {"state": "failed", "reason": reason}
        self._file_manager.set_additional_metadata(LOCAL, path, "printmend", told, overwrite=True)
        self._say("failed", path, reason=reason)

    def _say(self, what, path, **more):
        self._logger.info("%s %s %s", what, path, more)
        self._tell(what, path, **more)

    def _tell(self, what, path, **more):
        """Tell the pages that are open."""
        self._plugin_manager.send_plugin_message(self._identifier, {"what": what, "path": path, **more})

    # Jobs.

    def hold(self, comm, phase, cmd, cmd_type, gcode, *args, **kwargs):
        """Hook before each line: no line of an unmended file goes to the printer."""
        if "source:file" not in (kwargs.get("tags") or ()):
            return None
        if self._verdict is None:
            job = self._printer.get_current_job()["file"]
            local = job.get("origin") == LOCAL and not self._settings.get_boolean(["print_unmended"])
            self._verdict = not local or self._is_mended(job["path"]) or self._is_test_print(job["path"])
            if not self._verdict:
                self._wanted = job["path"]
                threading.Thread(target=self._redirect, args=(job["path"],), daemon=True).start()
        return None if self._verdict else (None,)

    def _redirect(self, path):
        """Stop the job, and print the mended copy as soon as it is there and the printer is free."""
        self._say("held", path)
        if not self._copy(path) and path != self._mending and path not in list(self._queue.queue):
            self._queue.put(path)
        self._printer.cancel_print()
        while self._wanted == path:
            time.sleep(0.2)
            copy = self._copy(path)
            if copy and self._printer.is_ready():
                self._wanted, self._verdict = None, None
                self._printer.select_file(copy, False, printAfterSelect=True)

    def _copy(self, path):
        """Return the mended copy of a file, or nothing where there is none."""
        copy = self._report(path).get("copy")
        return copy if copy and self._file_manager.file_exists(LOCAL, copy) else None


__plugin_name__ = "printmend"
__plugin_pythoncompat__ = ">=3.9,<4"
__plugin_implementation__ = PrintmendPlugin()
__plugin_hooks__ = {"octoprint.comm.protocol.gcode.queuing": __plugin_implementation__.hold}
