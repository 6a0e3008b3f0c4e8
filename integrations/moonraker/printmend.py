# SPDX-License-Identifier: GPL-3.0-or-later
"""Moonraker component: every G-code file is mended for this printer before a job can start from it.

[printmend]
command: ~/printmend/bin/printmend
model: ~/printer_data/config/printer.mend.json
#if_not_mended: hold     (or: print)
#timeout: 600

A file that arrives, by upload, scp or a slicer, is moved out of the way and mended into its place before Moonraker
reads its metadata and before `print=true` starts it. What could not be mended is not there to be printed: until it is
known how mending ends, a stub without any move stands in its place. A test print that `printmend probe` wrote is left
as it is: measured mended, it would say nothing of the printer. The uploaded file is kept in
~/printer_data/printmend/. Moonraker runs this file a second time, as a program of its own, to do the work.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

MARK = re.compile(rb"^; mended by printmend (\S+) model=(\S+)", re.MULTILINE)
TEST_PRINT = re.compile(rb"^; printmend (probe|first layer): ", re.MULTILINE)  # as printmend.gcode.mark has it
STUB = b"; held by printmend: "
WORDS = "This file was not mended, so it is not printed: "
KEPT_DAYS = 30  # the original of a file that was deleted since
MARGIN_S = 5.0  # Moonraker's own limit must not strike first: it would retry


def head(path):
    """Return the part of a file in which the mark stands."""
    try:
        with open(path, "rb") as file:
            return file.read(1 << 20)
    except OSError:
        return b""


def work(command, model, policy, folder, timeout_s, gcodes, path):
    """Mend one file in its place; return the exit code that Moonraker sees."""
    name = os.path.relpath(path, gcodes)
    path = os.path.realpath(path)  # a link stays one
    keep = Path(folder, name)
    keep.parent.mkdir(parents=True, exist_ok=True)
    report, fresh, stub = (keep.with_name(keep.name + end) for end in (".report.json", ".mended", ".stub"))
    for old in (report, fresh):
        old.unlink(missing_ok=True)
    if not head(path).startswith(STUB):
        stub.write_bytes(STUB + b"mending was interrupted; upload the file again\n")
        shutil.copyfile(path, keep)
        move(stub, path)
    prune(Path(folder), Path(gcodes))
    try:
        done = subprocess.run(  # noqa: S603 — the owner's own program, from moonraker.conf
            [command, "mend", str(keep), "-m", model, "-o", str(fresh), "--report", str(report)],
            capture_output=True, text=True, errors="replace", check=False, timeout=timeout_s, stdin=subprocess.DEVNULL,
        )  # fmt: skip
        reason = "" if done.returncode == 0 else last_line(done.stderr) or f"printmend ended with {done.returncode}"
    except subprocess.TimeoutExpired:
        reason = f"mending took longer than {timeout_s:.0f} s (timeout in [printmend])"
    except OSError as error:
        reason = f"{command}: {error.strerror or error}"
    if not reason and not MARK.search(head(fresh)) and not same(fresh, keep):
        reason = "printmend wrote a file without its mark"
    if not reason:
        move(fresh, path)
        return 0
    if policy == "print":
        shutil.copyfile(keep, fresh)
        move(fresh, path)
    else:
        fresh.write_bytes(STUB + " ".join(reason.split()).encode() + b"\n")
        move(fresh, path)
    print(reason, file=sys.stderr)
    return 1


def move(source, target):
    """Put a file in its place in one step, also from another disk."""
    beside = str(target) + ".part"
    shutil.copyfile(source, beside)
    os.replace(beside, target)
    os.unlink(source)


def same(one, other):
    """Say whether two files are equal: the model of a healthy printer changes nothing, and leaves no mark."""
    return one.read_bytes() == other.read_bytes() if one.exists() else False


def last_line(text):
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return lines[-1].removeprefix("printmend: ") if lines else ""


def prune(folder, gcodes):
    """Drop the originals of files that are no longer there."""
    for path in folder.rglob("*"):
        name = str(path.relative_to(folder)).removesuffix(".report.json")
        if path.is_file() and not (gcodes / name).exists() and time.time() - path.stat().st_mtime > 86400 * KEPT_DAYS:
            path.unlink(missing_ok=True)


class Printmend:
    """The part inside Moonraker: says how to mend, tells the owner, and stops jobs from files that were not mended."""

    def __init__(self, config):
        self.server = config.get_server()
        self.command = os.path.expanduser(config.get("command"))
        self.model = os.path.expanduser(config.get("model"))
        self.policy = config.getchoice("if_not_mended", {"hold": "hold", "print": "print"}, "hold")
        timeout_s = config.getfloat("timeout", 600.0, above=2 * MARGIN_S)
        self.folder = os.path.join(self.server.get_app_args()["data_path"], "printmend")
        self.files = self.server.lookup_component("file_manager")
        self.storage = self.files.get_metadata_storage()
        for path, what in ((self.command, "command"), (self.model, "model")):
            if not os.path.isfile(path):
                self.server.add_warning(f"[printmend] {what}: there is no {path}; no file will be mended")
        self.server.register_notification("printmend:result", "printmend_result")
        self.server.register_event_handler("file_manager:metadata_processed", self._processed)
        self.server.register_event_handler("job_state:started", self._started)
        from ..common import RequestType  # here: the same file also runs by itself

        self.server.register_endpoint("/server/printmend/status", RequestType.GET, self._status)
        gcodes = self.files.get_directory("gcodes")
        self.storage.register_gcode_processor("printmend", {
            "name": "printmend", "version": "1", "timeout": timeout_s,
            "ident": {"regex": r"; (?:mended by printmend (?P<version>\S+)|printmend (?:probe|first layer): )",
                      "location": "header"},
            "command": [sys.executable, os.path.abspath(__file__), self.command, self.model, self.policy, self.folder,
                        str(timeout_s - MARGIN_S), gcodes, "{gcode_file_path}"],
        })  # fmt: skip

    def _path(self, name):
        return os.path.join(self.files.get_directory("gcodes"), name)

    async def _processed(self, name):
        """A file's metadata are read; Moonraker waits for this before it starts a print."""
        path = self._path(name)
        state = self._state(name)
        if state["state"] == "held":
            os.unlink(path)
            self._announce(name, WORDS + state["reason"])
        else:
            self.storage.insert(name, {**(self.storage.get(name) or {}), "printmend": state})
        self.server.send_event("printmend:result", {"filename": name, **state})

    def _state(self, name):
        """Say what a file is: mended with its promise, healthy, unmended, a test print, or held with the reason."""
        start = head(self._path(name))
        if start.startswith(STUB):
            return {"state": "held", "reason": start[len(STUB) :].decode("utf-8", "replace").strip()}
        state = {"state": "unmended", "original": os.path.join(self.folder, name)}
        mark = MARK.search(start)
        if mark is None and TEST_PRINT.search(start):
            return {"state": "test print", "reason": "it must show the printer as it is, so it was not mended"}
        try:
            report = json.loads(Path(self.folder, name + ".report.json").read_text())
            state.update({key: report[key] for key in ("before", "after", "warnings") if key in report})
        except (OSError, ValueError):
            report = None
        if mark is not None:
            state.update(state="mended", version=mark[1].decode(), model=mark[2].decode())
        elif report is not None:
            state["state"] = "healthy"  # mended without a change
        return state

    async def _started(self, _before, stats):
        """Stop a job from an unmended file: it was there before the component, or is still being mended."""
        name = stats.get("filename", "")
        if self.policy == "print" or not name:
            return
        known = self.storage.get(name) or {}
        state = known.get("printmend", {}).get("state")
        start = head(self._path(name))
        left_alone = MARK.search(start) or TEST_PRINT.search(start) or state == "healthy"
        if self.storage.is_file_processing(name) or not left_alone:
            self._announce(name, "The job was stopped: this file was not mended. Upload it again to have it mended.")
            await self.server.lookup_component("klippy_apis").cancel_print(None)

    async def _status(self, request):
        name = request.get_str("filename")
        if not os.path.exists(self._path(name)):
            raise self.server.error(f"There is no {name}", 404)
        return {"filename": name, **self._state(name)}

    def _announce(self, name, words):
        """Tell the owner where Mainsail and Fluidd show it."""
        known = self.server.lookup_component("announcements", None)
        if known is not None:
            known.add_internal_announcement(f"printmend: {name}", words, "", "high", "printmend")


def load_component(config):
    return Printmend(config)


if __name__ == "__main__":
    arguments = sys.argv[1:]
    sys.exit(work(*arguments[:4], float(arguments[4]), *arguments[5:7]))
