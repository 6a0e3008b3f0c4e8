"""The devices that may use a studio from other computers, each by its token, and the address that it opens."""

import contextlib
import hashlib
import hmac
import json
import secrets
import socket
import threading
import time
from dataclasses import asdict, dataclass
from pathlib import Path

from printmend.errors import InputError
from printmend.files import replacing
from printmend.messages import say
from printmend.studio.guard import LOOPBACK
from printmend.studio.places import ADDRESS, DEVICES

# Find out how others reach this computer, and the address that a device opens.

EVERYWHERE = ("0.0.0.0", "::")  # noqa: S104 - recognised, never a default
# Addresses reserved for documentation (RFC 5737, RFC 3849): nobody has them, so they take the default route.
_ELSEWHERE = ((socket.AF_INET, "198.51.100.1"), (socket.AF_INET6, "2001:db8::1"))
_USUAL = ("0.0.0.0", 8765)  # noqa: S104 - a studio for others that was not started yet


def device_address(folder: Path, token: str, given: tuple[str, int] | None = None) -> str:
    """Return the address that a device with a token opens. Host and port are ``given``, or those of the studio that was
    last started for others, whose notes are in ``folder``."""
    (host, port), names = given or _USUAL, []
    if given is None:
        with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
            noted = json.loads((folder / ADDRESS).read_text(encoding="utf-8"))
            host, port, names = noted["host"], noted["port"], noted["names"]
    if names and host in LOOPBACK:  # others can reach it only through a proxy
        return f"https://{names[0]}/" + (f"?token={token}" if token else "")
    return address_of(everywhere()[0] if host in (*EVERYWHERE, *LOOPBACK) else host, port, token)


def address_of(host: str, port: int, token: str | None) -> str:
    """Return the address of a studio."""
    shown = f"[{host}]" if ":" in host else host
    return f"http://{shown}:{port}/" + (f"?token={token}" if token else "")


def everywhere() -> list[str]:
    """Return the names by which others may reach this computer, the best first: Debian's bare host name is loopback."""
    name = socket.gethostname()
    named: set[str] = set()
    with contextlib.suppress(OSError):
        named = {str(info[4][0]) for info in socket.getaddrinfo(name, None)}
    return [*_routed(), name, f"{name}.local", *named]


def _routed() -> list[str]:
    """Return the addresses from which this computer reaches others, IPv4 first. This sends nothing."""
    found = []
    for family, elsewhere in _ELSEWHERE:
        with contextlib.suppress(OSError), socket.socket(family, socket.SOCK_DGRAM) as way:
            way.connect((elsewhere, 9))
            found.append(str(way.getsockname()[0]))
    return found


FIRST = "first device"  # name of the token that a studio makes if it has none
LONGEST_NAME = 60


@dataclass(frozen=True)
class Device:
    """A device that may use the studio, and the SHA-256 of its token: 24 random bytes need no slower hash."""

    name: str
    sha256: str
    created_s: float
    user: str = ""  # the user whose printers it sees; empty: all printers


class Devices:
    """The devices of a studio's folder; another program may add and revoke them while the studio runs."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / DEVICES
        self._lock = threading.Lock()
        self._seen: tuple[int, int] | None = None
        self._known: tuple[Device, ...] = ()

    def known(self) -> tuple[Device, ...]:
        """Return the devices, the oldest first. Raises `InputError` for a file that printmend did not write."""
        with self._lock:
            try:
                at = self._path.stat()
            except FileNotFoundError:
                self._seen, self._known = None, ()
                return ()
            if self._seen != (at.st_mtime_ns, at.st_size):
                self._known, self._seen = _read(self._path), (at.st_mtime_ns, at.st_size)
            return self._known

    def add(self, name: str, user: str = "") -> str:
        """Admit a device; return its token, which is not stored. Raises `InputError` for a name that is taken."""
        name = name.strip()
        user = user.strip()
        if max(len(name), len(user)) > LONGEST_NAME or not (name + user).isprintable() or not may_be_named(name):
            raise InputError(say("subject-device"), wanted=say("name-1-characters", LONGEST_NAME), came=repr(name),
                             todo=say("name-after-what-phone-laptop"))  # fmt: skip
        if any(one.name.casefold() == name.casefold() for one in self.known()):
            raise InputError(name, wanted=say("device-not-known-yet"), came=say("name-2"),
                             todo=say("terminal-take-another-name-revoke-first"))  # fmt: skip
        token = secrets.token_urlsafe(24)
        self._write((*self.known(), Device(name, hash_of(token), time.time(), user)))
        return token

    def revoke(self, name: str) -> None:
        """Revoke a device. Raises `InputError` if there is none with this name."""
        left = tuple(one for one in self.known() if one.name.casefold() != name.strip().casefold())
        if len(left) == len(self.known()):
            came = ", ".join(one.name for one in left) or "none"
            raise InputError(name, wanted=say("device-studio"), came=came, todo=say("terminal-see-devices"))
        self._write(left)

    def user_of(self, token: str) -> str | None:
        """Return the user of the device with this token: "" for one that sees everything, None for no device."""
        given, found = hash_of(token), None
        for one in self.known():  # always compare all, so that the time reveals nothing
            if hmac.compare_digest(one.sha256, given):
                found = one.user
        return found

    def _write(self, devices: tuple[Device, ...]) -> None:
        self._path.touch(mode=0o600)  # only the owner may read it; replacing the file keeps the mode
        with replacing(self._path) as file:
            json.dump([asdict(one) for one in devices], file, indent=1)


def _read(path: Path) -> tuple[Device, ...]:
    try:
        rows = json.loads(path.read_text(encoding="utf-8") or "[]")
        return tuple(
            Device(str(row["name"]), str(row["sha256"]), float(row["created_s"]), str(row.get("user", "")))
            for row in rows
        )
    except (OSError, ValueError, TypeError, KeyError):
        raise InputError(path, wanted=say("devices-studio"), came=say("another-file"),
                         todo=say("terminal-remove-let-devices-again-device")) from None  # fmt: skip


def may_be_named(name: str) -> bool:
    """Return whether a name can be part of an address, by which a device is revoked: not empty, and without a slash."""
    return bool(name.strip(".")) and not {*name} & {*"/\\"}


def hash_of(token: str) -> str:
    """Return the hash of a token that is stored."""
    return hashlib.sha256(token.encode()).hexdigest()
