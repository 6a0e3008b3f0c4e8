"""The one exception tree of printmend.

PrintmendError                   exit code 2: the input or the machine's set-up is at fault
├── InputError                   a file or value from outside is not what was wanted
│   ├── ConfigError              printer or corruption TOML
│   ├── MeshError                STL, OBJ, 3MF
│   ├── GcodeError               G-code and its containers
│   ├── TraceError               measured traces and reference data sets
│   ├── ModelError               saved models
│   ├── ScanError                images of printed plates
│   └── UnwritableError          a place for results: no room, or no right to write
├── MissingToolError             an external program, or an extra of printmend, is not installed
└── RefusedError                 exit code 3: the work is possible, but would not help
"""

import errno
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

from printmend.messages import is_one_of, said, say

# An error as a message: its id, and its English with the subject, what was expected, what was found, what to do.
WHY = "why", "{}: expected {}, found {}; {}"
REFUSED = "refused", "{}: {} ({}); {}"
_REASONS = {
    errno.ENOENT: "no-such-file-or-directory", errno.EISDIR: "folder", errno.EACCES: "permission-denied",
    errno.ENOSPC: "no-space-left",
    errno.ECONNREFUSED: "nobody-answers", errno.EHOSTUNREACH: "no-way-to-host", errno.ENETUNREACH: "no-way-to-host",
    socket.EAI_NONAME: "nobody-knows-name", socket.EAI_AGAIN: "nobody-knows-name",
}  # fmt: skip
_LONGEST = 600  # characters of each part of a message


class PrintmendError(Exception):
    """Say in one line what was expected, what was found and what to do.

    ``subject`` names the file or value at fault. The command line prints ``str(error)`` on stderr
    and exits with ``exit_code``; nothing has been written by then.
    """

    exit_code = 2
    frame = WHY

    def __init__(self, subject: object, *, wanted: str, came: str, todo: str) -> None:
        self.subject = subject if isinstance(subject, str) else str(subject)
        self.wanted, self.came, self.todo = wanted, came, todo
        parts = (self.subject, wanted, came, todo)
        a, b, c, d = map(_line, parts)
        name, english = self.frame
        self.message: str = said(name, {"a": a, "b": b, "c": c, "d": d}, english.format(a, b, c, d))
        super().__init__(str(self.message))

    def __reduce__(self) -> tuple[Any, ...]:
        """Let the error cross from a worker's process as it is."""
        words = {"wanted": self.wanted, "came": self.came, "todo": self.todo}
        return partial(type(self), self.subject, **words), ()


def _line(text: str) -> str:
    """Return one line that a terminal can show: came may quote a foreign file, with anything in it."""
    plain = " ".join("".join(c if c.isprintable() or c.isspace() else "�" for c in text).split())
    plain = plain if len(plain) <= _LONGEST else plain[: _LONGEST - 1] + "…"
    return text if plain == text else plain  # a message stays one


def reason(error: Exception) -> str:
    """Return the reason given by the system or a library, as a part of a sentence: "no such file or directory"."""
    if (number := getattr(error, "errno", None)) in _REASONS:
        return say(_REASONS[number])
    if isinstance(error, TimeoutError):
        return say("no-answer-time")
    words = getattr(error, "strerror", None) or str(error)
    return words[:1].lower() + words[1:]


def own_fault(error: Exception) -> str:
    """Return the kind and the words of an error of the program's own, in one line."""
    return " ".join(f"{type(error).__name__}: {error}".split())[:300]


class InputError(PrintmendError):
    """A file or value from outside is not as expected."""


class ConfigError(InputError):
    """A printer or corruption TOML file is wrong."""


class MeshError(InputError):
    """A mesh cannot be printed."""


class GcodeError(InputError):
    """G-code, or a container of it, cannot be read."""


class TraceError(InputError):
    """A measured trace, or a data set of traces, cannot be used."""


class ModelError(InputError):
    """A saved model cannot be used."""


class ScanError(InputError):
    """An image of a printed plate cannot be used."""


class UnwritableError(InputError):
    """A file cannot be written: the disk is full, or the folder is not writable."""


class MissingToolError(PrintmendError):
    """An external program, or an extra of printmend, is not installed."""


class RefusedError(PrintmendError):
    """The work is possible, but would not help: ``wanted`` says so in a clause, ``came`` why."""

    exit_code = 3
    frame = REFUSED


@contextmanager
def of_file(path: object) -> Iterator[None]:
    """Let what is wrong with a trace name the file that it was read from."""
    try:
        yield
    except TraceError as error:
        if not is_one_of(error.subject, ("trace", "measurement-2")):
            raise
        raise TraceError(path, wanted=error.wanted, came=error.came, todo=error.todo) from error
