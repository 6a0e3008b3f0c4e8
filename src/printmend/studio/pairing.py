"""Pair hosts with printers by a code of six digits; a paired host fetches its printer's model from the studio.

A code is valid for ten minutes and one host. After a few wrong attempts all codes are deleted, so that none is guessed.
A paired host's token gives access only to its printer's model; only its hash is stored, in the printer's folder.
"""

import hmac
import json
import secrets
import threading
import time
from dataclasses import asdict, dataclass
from pathlib import Path

from printmend.errors import InputError
from printmend.files import replacing
from printmend.messages import say
from printmend.studio.devices import hash_of

CODE_S, MOST_WRONG, MOST_CODES = 600.0, 5, 20
FILE = "pairs.json"


@dataclass(frozen=True)
class Pair:
    """A host that may fetch a printer's model, and the SHA-256 of its token."""

    name: str
    sha256: str
    created_s: float


class Codes:
    """The codes that wait for a host; they are only in memory."""

    def __init__(self) -> None:
        self._lock, self._wrong = threading.Lock(), 0
        self._waiting: dict[str, tuple[str, float]] = {}

    def make(self, printer: str) -> str:
        """Return a new code for a printer, which replaces the previous one."""
        with self._lock:
            now = time.monotonic()
            self._waiting = {code: (key, end_s) for code, (key, end_s) in self._waiting.items()
                             if end_s > now and key != printer}  # fmt: skip
            while len(self._waiting) >= MOST_CODES:
                del self._waiting[next(iter(self._waiting))]
            code = next(
                one for one in iter(lambda: f"{secrets.randbelow(10**6):06d}", None) if one not in self._waiting
            )
            self._waiting[code], self._wrong = (printer, now + CODE_S), 0
            return code

    def take(self, code: str) -> str:
        """Return a code's printer, and delete the code. Raises `InputError` for any other code."""
        with self._lock:
            printer, end_s = self._waiting.pop(code, ("", 0.0))
            if end_s > time.monotonic():
                return printer
            self._wrong += 1
            if self._wrong >= MOST_WRONG:
                self._waiting = {}
        raise InputError(say("subject-code"), wanted=say("six-digits-studio-shows"), came=say("others-old-ones"),
                         todo=say("ask-studio-new-code"))  # fmt: skip


def pairs(folder: Path) -> tuple[Pair, ...]:
    """Return the hosts that are paired with the printer of a folder."""
    try:
        return tuple(Pair(**row) for row in json.loads((folder / FILE).read_text(encoding="utf-8")))
    except (FileNotFoundError, ValueError, TypeError):
        return ()


def pair(folder: Path, key: str, name: str) -> str:
    """Allow a host to fetch a printer's model; return its token. A host with the same name is replaced."""
    token = f"{key}.{secrets.token_urlsafe(24)}"
    others = [one for one in pairs(folder) if one.name != name]
    _write(folder, [*others, Pair(name, hash_of(token), time.time())])
    return token


def part(folder: Path, name: str) -> None:
    """Unpair a host from the model. Raises `InputError` if none has this name."""
    left = [one for one in pairs(folder) if one.name != name]
    if len(left) == len(pairs(folder)):
        came = ", ".join(one.name for one in left) or "none"
        raise InputError(name, wanted=say("host-paired"), came=came, todo=say("look-list"))
    _write(folder, left)


def may_fetch(folder: Path, token: str) -> bool:
    """Return whether a token belongs to a host that is paired with this folder's printer."""
    given = hash_of(token)
    return any([hmac.compare_digest(one.sha256, given) for one in pairs(folder)])  # noqa: C419 — each time all of them


def _write(folder: Path, hosts: list[Pair]) -> None:
    (folder / FILE).touch(mode=0o600)
    with replacing(folder / FILE) as file:
        json.dump([asdict(one) for one in hosts], file, indent=1)
