# SPDX-License-Identifier: GPL-3.0-or-later
"""Moonraker component: every G-code file is mended for this printer before a job can start from it.

[printmend]
command: ~/printmend/bin/printmend
model: ~/printer_data/config/printer.mend.json

A file that arrives, by upload, scp or a slicer, is moved out of the way and mended into its place before Moonraker
reads its metadata and before `print=true` starts it. Until it is known how mending ends, a stub without any move stands
in its place. Whatever is to be printed is judged once more as its job starts: by the record of how it was mended, or by
the seal that printmend puts under a file (src/printmend/provenance.py). The uploaded files are kept in
~/printer_data/printmend/. Moonraker runs this file a second time, as a program of its own, to do the work.
"""

import asyncio
import importlib.util
import json
import logging
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

PLACE = Path(__file__).resolve().parents[2] / "src/printmend/provenance.py"
STUB = b"; held by printmend: "
STUB_ORIGINAL = b"; the file as it came: "
GCODE = (".gcode", ".g", ".gco", ".nc", ".ufp")
KEPT_DAYS = 30  # the original of a file that was deleted since
MARGIN_S = 5.0  # Moonraker's own limit must not strike first: it would retry
PRINTING = ("printing", "paused")
FOLLOW_S, PATIENCE_S = 600.0, 120.0  # between two looks for a newer model in the studio, and for one look
NICENESS = 10  # of mending: the printer's own work comes first


def load_provenance():
    """Return printmend's module of records and seals, from the folder that this file was linked from."""
    if not PLACE.is_file():
        raise ImportError(f"there is no {PLACE}: link {Path(__file__).name} out of printmend's folder, do not copy it")
    spec = importlib.util.spec_from_file_location("printmend_provenance", PLACE)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


provenance = load_provenance()


# The work, outside Moonraker.


def work(settings, path):
    """Mend one file in its place, where the owner chose so for a file like it; return the exit code.

    What came of it is left in last.json for the component.
    """
    os.nice(NICENESS)
    name, folder = os.path.relpath(path, settings["gcodes"]), Path(settings["folder"])
    folder.mkdir(parents=True, exist_ok=True)
    told = mend(settings, name, os.path.realpath(path))  # a link stays one
    (folder / "last.json").write_text(json.dumps({"name": name, **told}))
    print(told.get("reason", ""), file=sys.stderr)
    return 1 if "reason" in told else 0


def mend(settings, name, path):
    """Mend a file; return its result's SHA-256, why it could not be mended, or nothing where it is left alone."""
    folder = Path(settings["folder"])
    ledger, model = provenance.Ledger(str(folder)), model_at(settings["model"])
    start = provenance.head_of(path)
    interrupted = tuple(STUB + words.encode() for words in provenance.SENTENCES["interrupted"])
    if start.startswith(STUB) and not start.startswith(interrupted):
        return {"reason": stub_reason(start)}
    keep = stub_original(path)
    if keep is None:
        verdict = ledger.judge(path, model)
        if provenance.action(verdict.state, settings["chosen"]) != "mend":
            return {}
        keep = original_of(verdict, ledger)
        if verdict.state == provenance.STALE and keep is None:
            return {"reason": provenance.said(settings["language"], "no-original")}
    if keep is None:
        plain = folder / name
        keep = plain.with_name(f"{plain.stem}.{verdict.sha256[:8]}{plain.suffix}")
        keep.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, keep)
    report, fresh, stub = (keep.with_name(keep.name + end) for end in (".report.json", ".mended", ".stub"))
    for old in (report, fresh):
        old.unlink(missing_ok=True)
    write_stub(stub, path, keep, provenance.said(settings["language"], "interrupted"))
    reason = run(settings, keep, fresh, report)
    if not reason and not provenance.MARK.search(provenance.head_of(fresh)) and not same(fresh, keep):
        reason = provenance.said(settings["language"], "no-mark")
    if reason:
        if settings["if_not_mended"] == "print":
            shutil.copyfile(keep, fresh)
            move(fresh, path)
        else:
            write_stub(stub, path, keep, reason)
        return {"reason": reason}
    told = json.loads(report.read_text(encoding="utf-8")) if report.exists() else {}
    report.unlink(missing_ok=True)
    record = provenance.record_of(str(keep), str(fresh), model, original=str(keep), report=told)
    ledger.write(record)
    move(fresh, path)
    return {"result": record.result}


def run(settings, source, target, report):
    """Run printmend; return the reason where there is no mended file."""
    command = [settings["command"], "mend", source, "-m", settings["model"], "-o", target, "--report", report]
    try:
        done = subprocess.run(  # noqa: S603 — the owner's own program, from moonraker.conf
            list(map(str, command)), capture_output=True, encoding="utf-8", errors="replace", check=False,
            timeout=settings["timeout_s"], stdin=subprocess.DEVNULL, env=provenance.speaking(settings["language"]),
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        words = provenance.said(settings["language"], "too-long", f"{settings['timeout_s']:.0f}")
        return f"{words} (timeout in [printmend])"
    except OSError as error:
        return f"{settings['command']}: {error.strerror or error}"
    ended = provenance.said(settings["language"], "ended", done.returncode)
    return "" if done.returncode == 0 else last_line(done.stderr) or ended


def follow(settings):
    """Fetch a newer model where this one is paired with a studio (`printmend pair`)."""
    if not os.path.isfile(settings["model"] + ".studio"):
        return
    command = [settings["command"], "pair", "--update", "-m", settings["model"]]
    try:
        done = subprocess.run(  # noqa: S603 — the owner's own program, from moonraker.conf
            command, capture_output=True, text=True, errors="replace", check=False, timeout=PATIENCE_S,
            stdin=subprocess.DEVNULL,
        )  # fmt: skip
    except (subprocess.TimeoutExpired, OSError) as error:
        logging.warning("printmend: no newer model: %s", error)
        return
    if done.returncode:
        logging.warning("printmend: no newer model: %s", last_line(done.stderr))


def model_at(path):
    """Return what identifies the model; nothing where another computer holds it."""
    try:
        return provenance.read_model(path)
    except provenance.NoModelError:
        return None


def original_of(verdict, ledger):
    """Return the kept file that one was mended from, whole and unchanged, or nothing."""
    record = verdict.record
    if record is None or not os.path.isfile(record.original) or ledger.sha256(record.original) != record.source:
        return None
    return Path(record.original)


def write_stub(beside, path, keep, reason):
    """Put a file without any move in a file's place."""
    words = STUB + " ".join(reason.split()).encode() + b"\n" + STUB_ORIGINAL + os.fsencode(str(keep)) + b"\n"
    beside.write_bytes(words)
    move(beside, path)


def stub_reason(start):
    """Return why a stub stands where a file was."""
    return start.splitlines()[0][len(STUB) :].decode("utf-8", "replace").strip()


def stub_original(path):
    """Return the kept original that a stub stands for, or nothing."""
    lines = provenance.head_of(path).splitlines()
    if len(lines) != 2 or not lines[0].startswith(STUB) or not lines[1].startswith(STUB_ORIGINAL):
        return None
    keep = Path(os.fsdecode(lines[1][len(STUB_ORIGINAL) :]))
    return keep if keep.is_file() else None


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


# The part inside Moonraker.


class Printmend:
    """Says how to mend, tells the owner, and lets no job start from a file that the owner would not have printed."""

    def __init__(self, config):
        self.server = config.get_server()
        self.files = self.server.lookup_component("file_manager")
        self.storage = self.files.get_metadata_storage()
        timeout_s = config.getfloat("timeout", 600.0, above=2 * MARGIN_S)
        choices = {
            state: config.getchoice("if_" + state, {one: one for one in known}, known[0])
            for state, known in provenance.CHOICES.items()
        }
        self.settings = {
            "command": os.path.expanduser(config.get("command")), "model": os.path.expanduser(config.get("model")),
            "if_not_mended": config.getchoice("if_not_mended", {"hold": "hold", "print": "print"}, "hold"),
            "chosen": choices, "folder": os.path.join(self.server.get_app_args()["data_path"], "printmend"),
            "gcodes": self.files.get_directory("gcodes"), "timeout_s": timeout_s - MARGIN_S,
            "language": config.get("language", "en"),
        }  # fmt: skip
        self.waits = config.getchoice("while_printing", {"wait": True, "mend": False}, "wait")
        self.ledger = provenance.Ledger(self.settings["folder"], self.settings["language"])
        self.lock, self.ready = asyncio.Lock(), asyncio.Event()  # one file at a time; the printer is free
        self.ready.set()
        self.queue, self.failed = [], {}  # names to be mended; why the latest mending of a name failed
        self.left = set()  # SHA-256 of what could not be mended and is printed all the same
        for key in ("command", "model"):
            if not os.path.isfile(self.settings[key]):
                self.server.add_warning(f"[printmend] {key}: there is no {self.settings[key]}; no file will be mended")
        self._register(timeout_s)

    def _register(self, timeout_s):
        self.server.register_notification("printmend:result", "printmend_result")
        events = {"file_manager:metadata_processed": self._processed, "file_manager:filelist_changed": self._changed,
                  "job_state:started": self._started, "server:klippy_started": self._begun}  # fmt: skip
        for end in ("complete", "cancelled", "error", "standby"):
            events["job_state:" + end] = self._ended
        for event, handler in events.items():
            self.server.register_event_handler(event, handler)
        from ..common import RequestType  # here: the same file also runs by itself

        self.server.register_endpoint("/server/printmend/status", RequestType.GET, self._status)
        self.server.register_endpoint("/server/printmend/mend", RequestType.POST, self._mend_all)
        self.server.register_remote_method("printmend_mend", self._mend_all)
        self.follower = self.server.get_event_loop().register_timer(self._follow)
        self.follower.start(delay=1.0)
        self.processor = {
            "name": "printmend", "version": "1", "timeout": timeout_s, "enabled": True,
            "command": [sys.executable, os.path.abspath(__file__), json.dumps(self.settings), "{gcode_file_path}"],
        }  # fmt: skip
        self.storage.register_gcode_processor("printmend", self.processor)
        prints = self.server.lookup_component("klippy_apis")
        self.start_print, prints.start_print = prints.start_print, self._start_print

    async def _follow(self, now):
        await self._in_thread(follow, self.settings)
        return now + FOLLOW_S

    def close(self):
        self.follower.stop()

    # Files.

    def _path(self, name):
        """Return where a file lies; Klipper finds it by another spelling, too."""
        path = os.path.join(self.settings["gcodes"], name.lstrip("/"))
        folder, last = os.path.split(path)
        if not os.path.exists(path) and os.path.isdir(folder):
            path = next((os.path.join(folder, one) for one in os.listdir(folder) if one.lower() == last.lower()), path)
        return path

    def _judge(self, name):
        """Return a file's verdict, and what to do with it; nothing where there is no file."""
        try:
            verdict = self.ledger.judge(os.path.realpath(self._path(name)), model_at(self.settings["model"]))
        except OSError:
            return None, "print"
        if verdict.sha256 in self.left:
            return verdict, "print"
        return verdict, provenance.action(verdict.state, self.settings["chosen"])

    async def _in_thread(self, function, *arguments):
        return await self.server.get_event_loop().run_in_thread(function, *arguments)

    async def _processed(self, name):
        """A file's metadata are read; Moonraker waits for this before it starts a print."""
        known = self.storage.get(name) or {}
        await self._in_thread(self._look_back, name, known.get("file_processors", ()))
        start = provenance.head_of(self._path(name))
        if start.startswith(STUB):
            self._hold(name, stub_reason(start))
            return
        verdict, wanted = await self._in_thread(self._judge, name)
        if verdict is None:
            return
        if wanted == "mend" and not self.processor["enabled"]:
            self._enqueue(name)
        elif wanted == "mend" and self.settings["if_not_mended"] == "print":
            self.left.add(verdict.sha256)
        state = self._told(verdict)
        self.storage.insert(name, {**known, "printmend": state})
        self.server.send_event("printmend:result", {"filename": name, **state})
        await self._in_thread(self._prune)

    def _said(self, name, *values):
        return provenance.said(self.settings["language"], name, *values)

    def _hold(self, name, reason):
        """Take a stub off the list, and say where the file itself lies."""
        keep = stub_original(self._path(name))
        os.unlink(self._path(name))
        where = f" ({self._said('kept', keep)})" if keep else ""
        self._announce(name, self._said("held", reason) + where)
        self.server.send_event("printmend:result", {"filename": name, "state": "held", "reason": reason})

    def _look_back(self, name, processors):
        """Read what came of mending. Where Moonraker changed the file after it (cancelling of objects), say so."""
        last = Path(self.settings["folder"], "last.json")
        try:
            told = json.loads(last.read_text())
            last.unlink()
        except (OSError, ValueError):
            return
        if told["name"] == name and "reason" in told:
            self.failed[name] = told["reason"]
        record = self.ledger.find(told["result"]) if told["name"] == name and "result" in told else None
        if record is not None and set(processors) - {"printmend"}:
            self.ledger.write(record._replace(result=self.ledger.sha256(os.path.realpath(self._path(name)))))

    async def _changed(self, told):
        """Mend a file that Moonraker itself does not take for G-code: its ending is written in capitals."""
        item = told.get("item", {})
        _, ending = os.path.splitext(item.get("path", ""))
        if item.get("root") == "gcodes" and ending not in GCODE and ending.lower() in GCODE:
            self._enqueue(item["path"])

    @staticmethod
    def _told(verdict):
        """Return what metadata and status say of a file."""
        told = {"state": verdict.state, "reason": verdict.sentence, "sha256": verdict.sha256}
        if verdict.record is not None:
            told.update(verdict.record.promise, original=verdict.record.original, model=verdict.record.model,
                        version=verdict.record.program)  # fmt: skip
        return told

    def _prune(self):
        """Drop the originals of files that were deleted long ago."""
        told = [one.get("printmend") for one in list(self.storage.metadata.values())]
        if not all(told):  # what is not known yet may need any of them
            return
        there = {one["sha256"] for one in told}
        needed = {record.original for record in self.ledger.records() if record.result in there}
        folder, gcodes = Path(self.settings["folder"]), Path(self.settings["gcodes"])
        for path in folder.rglob("*.*"):
            place = path.relative_to(folder)
            plain = place.with_name(Path(place.stem).stem + place.suffix)  # without the digits of its content
            if place.parts[0] == "records" or place.name == "models.json" or not path.is_file():
                continue
            days = (time.time() - path.stat().st_mtime) / 86400
            if str(path) in needed or (gcodes / plain).exists():
                if days > 1:
                    os.utime(path)  # the days are counted from when it was here last
            elif days > KEPT_DAYS:
                path.unlink(missing_ok=True)
        for record in self.ledger.records():
            if record.result not in there and not os.path.exists(record.original):
                self.ledger.forget(record)

    # Jobs.

    async def _start_print(self, filename, *arguments, **options):
        """Start a print, in place of Moonraker's own function, from a file that may be printed."""
        refused = await self._refusal(filename)
        if refused:
            self._announce(filename, refused)
            raise self.server.error(f"printmend: {refused}", 403)
        return await self.start_print(filename, *arguments, **options)

    async def _refusal(self, filename):
        """Return why a file may not be printed, or nothing; one that is to be mended first is."""
        verdict, wanted = await self._in_thread(self._judge, filename)
        if wanted == "mend":
            reason = await self._mend(filename)
            verdict, wanted = await self._in_thread(self._judge, filename)
            if wanted != "print" or verdict is None:
                return self._said("held", reason or "moonraker.log")
        if wanted == "print":
            return ""
        return f"{verdict.sentence} {self._said('not-printed', f'if_{verdict.state} in [printmend]')}"

    async def _started(self, _before, stats):
        """Stop a job that another program started from a file that may not be printed."""
        name = stats.get("filename", "")
        if self.waits:
            self.processor["enabled"] = False
            self.ready.clear()
        verdict, wanted = await self._in_thread(self._judge, name) if name else (None, "print")
        if wanted == "print" or verdict is None:
            return
        todo = self._said("again") if wanted == "mend" else f"(if_{verdict.state} in [printmend])"
        self._announce(name, f"{self._said('stopped')} {verdict.sentence} {todo}")
        await self.server.lookup_component("klippy_apis").cancel_print(None)
        if wanted == "mend":
            self._enqueue(name)

    async def _begun(self, _state):
        """Wait with mending where Moonraker was started while the printer prints."""
        if self.waits and self.server.lookup_component("job_state").get_last_stats().get("state") in PRINTING:
            self.processor["enabled"] = False
            self.ready.clear()

    async def _ended(self, _before, _stats):
        self.processor["enabled"] = True
        self.ready.set()

    # Mending what is here already.

    def _enqueue(self, *names):
        idle = not self.queue
        self.queue += [name for name in names if name not in self.queue]
        if idle and self.queue:
            self.server.get_event_loop().register_callback(self._work)

    async def _work(self):
        while self.queue:
            await self.ready.wait()
            try:
                await self._mend(self.queue[0])
            except Exception:
                logging.exception("mending %s", self.queue[0])
            self.queue.pop(0)

    async def _mend(self, name):
        """Mend a file in its place; return the reason where that failed."""
        async with self.lock:
            path = self._path(name)
            name = os.path.relpath(path, self.settings["gcodes"])
            self.failed.pop(name, None)
            if os.path.splitext(name)[1] in GCODE:
                removed = self.storage.remove_file_metadata(name)
                if removed is not None:
                    await removed
                await self.storage.parse_metadata(name, self.files.get_path_info(path, "gcodes")).wait()
            else:  # Moonraker takes it for no G-code
                await self._in_thread(self._mend_beside, path)
                await self._in_thread(self._look_back, name, ())
                start = provenance.head_of(path)
                if start.startswith(STUB):
                    self._hold(name, stub_reason(start))
            return self.failed.pop(name, "")

    def _mend_beside(self, path):
        """Run the other half of this file."""
        command = [*self.processor["command"][:-1], path]
        subprocess.run(command, check=False, capture_output=True)  # noqa: S603 — this file

    async def _mend_all(self, _request=None, **_unused):
        """Mend all that is here and is not mended, or was with an earlier model, as the owner chose for each state."""
        names = [one["path"] if isinstance(one, dict) else one for one in self.files.get_file_list("gcodes", True)]
        queued = [name for name in names if (await self._in_thread(self._judge, name))[1] == "mend"]
        self._enqueue(*queued)
        return {"queued": queued}

    async def _status(self, request):
        name = request.get_str("filename", None)
        if name is None:
            model = await self._in_thread(model_at, self.settings["model"])
            named = {"model": model.digest, "printer": model.name} if model is not None else {}
            return {**named, "queued": list(self.queue), "waiting": not self.ready.is_set()}
        verdict, wanted = await self._in_thread(self._judge, name)
        if verdict is None:
            raise self.server.error(f"There is no {name}", 404)
        return {"filename": name, **self._told(verdict), "wanted": wanted}

    def _announce(self, name, words):
        """Tell the owner where Mainsail and Fluidd show it."""
        known = self.server.lookup_component("announcements", None)
        if known is not None:
            known.add_internal_announcement(f"printmend: {name}", words, "", "high", "printmend")


def load_component(config):
    return Printmend(config)


if __name__ == "__main__":
    sys.exit(work(json.loads(sys.argv[1]), sys.argv[2]))
