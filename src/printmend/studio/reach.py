"""How others reach this computer, and the address that a device opens."""

import contextlib
import json
import socket
from pathlib import Path

from printmend.studio.guard import LOOPBACK
from printmend.studio.places import ADDRESS

EVERYWHERE = ("0.0.0.0", "::")  # noqa: S104 - recognised, never a default
# Addresses kept for documents (RFC 5737, RFC 3849): nobody has them, so the way to them begins as that to anybody.
_ELSEWHERE = ((socket.AF_INET, "198.51.100.1"), (socket.AF_INET6, "2001:db8::1"))
_USUAL = ("0.0.0.0", 8765)  # noqa: S104 - a studio for others that was not started yet


def device_address(folder: Path, token: str, given: tuple[str, int] | None = None) -> str:
    """Return the address that a device with a token opens: of the studio that was last started for others, whose
    notes are in ``folder``, unless its host and port are ``given``."""
    (host, port), names = given or _USUAL, []
    if given is None:
        with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
            noted = json.loads((folder / ADDRESS).read_text(encoding="utf-8"))
            host, port, names = noted["host"], noted["port"], noted["names"]
    if names and host in LOOPBACK:  # nobody else comes to it but through a proxy
        return f"https://{names[0]}/" + (f"?token={token}" if token else "")
    return address_of(everywhere()[0] if host in (*EVERYWHERE, *LOOPBACK) else host, port, token)


def address_of(host: str, port: int, token: str | None) -> str:
    """Return the address of a studio."""
    shown = f"[{host}]" if ":" in host else host
    return f"http://{shown}:{port}/" + (f"?token={token}" if token else "")


def everywhere() -> list[str]:
    """Return what others may call this computer, the best first: its name alone means the loopback on Debian."""
    name = socket.gethostname()
    named: set[str] = set()
    with contextlib.suppress(OSError):
        named = {str(info[4][0]) for info in socket.getaddrinfo(name, None)}
    return [*_routed(), name, f"{name}.local", *named]


def _routed() -> list[str]:
    """Return the addresses, IPv4 first, from which this computer reaches others. Nothing is sent for it."""
    found = []
    for family, elsewhere in _ELSEWHERE:
        with contextlib.suppress(OSError), socket.socket(family, socket.SOCK_DGRAM) as way:
            way.connect((elsewhere, 9))
            found.append(str(way.getsockname()[0]))
    return found
