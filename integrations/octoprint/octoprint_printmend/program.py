# SPDX-License-Identifier: AGPL-3.0-or-later
"""printmend as a program of its own: how it is started, how far it is, and how it is stopped."""

import contextlib
import os
import re
import signal
import subprocess
import threading

from octoprint_printmend import provenance

LIMIT_S = 3600
FOLLOW_S, PATIENCE_S = 600.0, 120.0  # between two looks for a newer model in the studio, and for one look
NICENESS = 10  # the printer's own work comes first
PERCENT = re.compile(r"(\d+) %")  # how far printmend is, on its standard error


class Program:
    """One run of printmend at a time."""

    def __init__(self):
        self._process = None
        self.cancelled = False

    def mend(self, command, model, source, fresh, report, told, language):
        """Mend a file into ``fresh``; return the reason where there is none. ``told`` hears the percentage."""
        return self._run([command, "mend", source, "-m", model, "-o", fresh, "--report", report], fresh, told, language)

    @classmethod
    def update(cls, command, model, language):
        """Fetch a newer model where this one is paired with a studio; return why that was not possible."""
        if not os.path.isfile(model + ".studio"):
            return ""
        return cls._pair([command, "pair", "--update", "-m", model], language)

    @classmethod
    def pair(cls, command, model, address, code, language):
        """Pair with a printer of a studio, whose model goes to ``model``; return why that was not possible."""
        return cls._pair([command, "pair", "-m", model, "--", address, code], language)

    @staticmethod
    def _pair(arguments, language):
        try:
            done = subprocess.run(  # noqa: S603 — the owner's own program, from the settings
                arguments, stdin=subprocess.DEVNULL, capture_output=True, encoding="utf-8", errors="replace",
                check=False, timeout=PATIENCE_S, env=provenance.speaking(language),
            )  # fmt: skip
        except (subprocess.TimeoutExpired, OSError) as error:
            return str(error)
        return last_line(done.stderr) or provenance.said(language, "ended", done.returncode) if done.returncode else ""

    def stop(self):
        """End printmend, and whatever it started: a script of the owner's may not be the program itself."""
        self.cancelled = True
        self._kill()

    def _kill(self):
        process = self._process
        if process is not None:
            with contextlib.suppress(OSError):  # ended by itself
                if hasattr(os, "killpg"):
                    os.killpg(process.pid, signal.SIGKILL)
                else:  # Windows
                    process.kill()

    def _run(self, arguments, fresh, told, language):
        environment = provenance.speaking(
            language, {k: v for k, v in os.environ.items() if k not in ("PYTHONHOME", "VIRTUAL_ENV")}
        )
        environment["PRINTMEND_PROGRESS"] = "1"
        try:
            self._process = subprocess.Popen(  # noqa: S603 — the owner's own program, from the settings
                arguments, env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
                start_new_session=True, creationflags=getattr(subprocess, "BELOW_NORMAL_PRIORITY_CLASS", 0),
            )  # fmt: skip
        except OSError as error:
            return f"{arguments[0]}: {error.strerror or error}"
        if hasattr(os, "setpriority"):
            with contextlib.suppress(OSError):  # ended already
                os.setpriority(os.PRIO_PGRP, self._process.pid, NICENESS)
        if self.cancelled:  # before there was a program to stop
            self._kill()
        late = threading.Event()
        limit = threading.Timer(LIMIT_S, lambda: (late.set(), self._kill()))
        limit.start()
        lines = []
        for line in self._process.stderr:
            words = line.decode("utf-8", "replace").strip()
            if percent := PERCENT.fullmatch(words):
                told(int(percent[1]))
            elif words:
                lines.append(words)
        code = self._process.wait()
        limit.cancel()
        self._process = None
        if late.is_set():
            return provenance.said(language, "too-long", LIMIT_S)
        if self.cancelled:
            return provenance.said(language, "cancelled")
        if code == 0 and os.path.exists(fresh):
            return ""
        return last_line("\n".join(lines)) or provenance.said(language, "ended", code)


def last_line(text):
    """Return what a program said last, without its name."""
    lines = text.strip().splitlines()
    return lines[-1].removeprefix("printmend: ") if lines else ""
