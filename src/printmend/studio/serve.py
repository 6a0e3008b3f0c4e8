"""Start the studio on a socket of this computer, with a token if others may enter; or install it as a service."""

import contextlib
import getpass
import json
import plistlib
import socket
import sqlite3
import subprocess
import sys
import threading
import webbrowser
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

import uvicorn

from printmend.cluster import Cluster
from printmend.errors import InputError, reason
from printmend.files import replacing
from printmend.messages import say
from printmend.studio.app import MOST_HELD_BYTES, WORKERS, create_app
from printmend.studio.devices import EVERYWHERE, FIRST, Devices, address_of, device_address, everywhere
from printmend.studio.guard import LOOPBACK, Door
from printmend.studio.places import ADDRESS, LOCK, Places
from printmend.studio.store import Store

# A studio that starts with the computer: files for systemd, launchd and the task scheduler of Windows.
#
# Each belongs to the user: nothing needs an administrator.

NAME = "printmend-studio"
_LABEL = "org.printmend.studio"
_UNIT = """\
[Unit]
Description=printmend studio

[Service]
ExecStart={command}
Restart=on-failure
RestartSec=5
Nice=5
KillSignal=SIGINT
NoNewPrivileges=yes

[Install]
WantedBy=default.target
"""
# Without these settings a task ends after three days, and does not begin on a battery. [MS-TSCH] 2.5
_TASK = """\
<Task version="1.2" xmlns="http://schemas.microsoft.com/windows/2004/02/mit/task">
  <RegistrationInfo><Description>printmend studio</Description></RegistrationInfo>
  <Triggers><LogonTrigger><UserId>{user}</UserId></LogonTrigger></Triggers>
  <Principals>
    <Principal id="Owner"><UserId>{user}</UserId><LogonType>InteractiveToken</LogonType></Principal>
  </Principals>
  <Settings>
    <DisallowStartIfOnBatteries>false</DisallowStartIfOnBatteries>
    <StopIfGoingOnBatteries>false</StopIfGoingOnBatteries>
    <ExecutionTimeLimit>PT0S</ExecutionTimeLimit>
    <RestartOnFailure><Interval>PT1M</Interval><Count>100</Count></RestartOnFailure>
  </Settings>
  <Actions Context="Owner"><Exec><Command>{program}</Command><Arguments>{words}</Arguments></Exec></Actions>
</Task>
"""


@dataclass(frozen=True)
class Service:
    """A file that describes the service, its path, and the commands that start and undo the service."""

    path: Path
    text: str
    begin: tuple[str, ...]
    undo: tuple[str, ...]


def service(options: Sequence[str], *, platform: str = sys.platform, home: Path | None = None) -> Service:
    """Return a service that starts ``printmend studio`` so. Raises `InputError` for options that no file can hold."""
    home = home or Path.home()
    command = [sys.executable, "-m", "printmend", "studio", "--no-browser", *options]
    if any(character in word for word in command for character in '\n\r"'):
        raise InputError(say("subject-service"), wanted=say("options-without-quotes-line-ends"), came=say("them"),
                         todo=say("choose-other-names"))  # fmt: skip
    if platform == "darwin":
        path = home / "Library/LaunchAgents" / f"{_LABEL}.plist"
        text = plistlib.dumps({"Label": _LABEL, "ProgramArguments": command, "RunAtLoad": True, "Nice": 5,
                               "KeepAlive": {"SuccessfulExit": False}}).decode()  # fmt: skip
        return Service(path, text, (f"launchctl load -w '{path}'",), (f"launchctl unload -w '{path}'", f"rm '{path}'"))
    if platform == "win32":
        path = home / f"{NAME}.xml"
        given = {"user": getpass.getuser(), "program": command[0], "words": subprocess.list2cmdline(command[1:])}
        text = _TASK.format(**{name: escape(value) for name, value in given.items()})
        text = text.encode("ascii", "xmlcharrefreplace").decode()  # valid in any encoding
        made = (f'schtasks /Create /F /TN {NAME} /XML "{path}"', f"schtasks /Run /TN {NAME}")
        return Service(path, text, made, (f"schtasks /Delete /F /TN {NAME}", f'del "{path}"'))
    path = home / ".config/systemd/user" / f"{NAME}.service"
    quoted = " ".join(f'"{word}"'.replace("%", "%%").replace("$", "$$").replace("\\", "\\\\") for word in command)
    begin = ("systemctl --user daemon-reload", f"systemctl --user enable --now {NAME}", "loginctl enable-linger")
    undo = (f"systemctl --user disable --now {NAME}", f"rm '{path}'")
    return Service(path, _UNIT.format(command=quoted), begin, undo)


def write_service(made: Service) -> None:
    """Write the file that describes a service; nothing is started."""
    made.path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(made.path) as file:
        file.write(made.text)


def serve(
    places: Places, *, host: str, port: int, names: tuple[str, ...] = (), browser: bool, told: Callable[[str], None],
    workers: int = WORKERS, cluster: str | None = None, most_gb: float = MOST_HELD_BYTES / 1e9,
) -> None:  # fmt: skip
    """Serve until Ctrl-C. If ``host`` is not this computer alone, only known devices may enter, see `Devices`.

    The same holds with ``names``, further names by which browsers reach it, say through a proxy. ``cluster`` runs the
    jobs elsewhere (see `Cluster`). Raises `InputError` if the port is not free, another studio uses the folder, its
    database cannot be used, or nothing answers at the cluster's address.
    """
    remote = None if cluster is None else Cluster.at(cluster)
    devices = None if host in LOOPBACK and not names else Devices(places.state)
    known = () if devices is None else devices.known()
    reached = everywhere() if host in EVERYWHERE else [host]
    hosts = {*LOOPBACK, *names, *reached}
    listener = _listener(host, port)
    alone = _alone(places.state)
    Store(places.resolved()).close()  # what is wrong with it is said here, not by the server
    threading.Thread(target=_draw_beforehand, daemon=True).start()
    port = listener.getsockname()[1]
    token = devices.add(FIRST) if devices is not None and not known else None
    address = address_of(reached[0], port, token)
    told(say("terminal-studio-runs", address, places.data))
    if token:
        told(say("terminal-studio-token"))
    elif known:
        told(say("terminal-studio-lets-in", ", ".join(one.name for one in known)))
    if devices is not None:
        told(say("terminal-studio-not-encrypted"))
    _note(places.state / ADDRESS, None if devices is None else {"host": host, "port": port, "names": list(names)})
    with contextlib.ExitStack() as stack:
        stack.callback(alone.close)
        pool = None if remote is None else stack.enter_context(remote.client()).get_executor(pure=False)
        config = uvicorn.Config(
            create_app(places.resolved(), hosts=hosts, devices=devices, workers=workers,
                       cluster=pool, most_held_bytes=int(most_gb * 1e9), stopping=lambda: server.should_exit),
            log_level="warning",
            server_header=False, timeout_keep_alive=30, timeout_graceful_shutdown=2, limit_concurrency=400, ws="none",
            lifespan="on", http=Door,
        )  # fmt: skip
        server = uvicorn.Server(config)
        if browser:
            threading.Thread(target=_show, args=(server, address), daemon=True).start()
        server.run(sockets=[listener])


def let_in(folder: Path, name: str, user: str = "", *, host: str, port: int, given: bool) -> str:
    """Admit a device; return the address that it opens: with ``host`` and ``port`` if ``given``, otherwise that of the
    studio last started for others from ``folder``. Raises `InputError` for a name that is taken."""
    token = Devices(folder).add(name, user)
    return device_address(folder, token, None if not given else (host, port))


def _note(path: Path, table: dict[str, Any] | None) -> None:
    """Write a table for the other commands; None if there is nothing to tell them."""
    path.unlink(missing_ok=True)
    if table is not None:
        path.touch(mode=0o600)
        with replacing(path) as file:
            json.dump(table, file)


def _alone(folder: Path) -> sqlite3.Connection:
    """Lock ``folder`` for this studio; the lock ends when the returned connection is closed or the program ends.

    Raises `InputError` if another studio has the lock, because two would take each other's jobs, and if nothing can be
    written there.
    """
    path, held = folder / LOCK, None
    try:
        held = sqlite3.connect(path, timeout=0, isolation_level=None, check_same_thread=False)
        held.execute("BEGIN EXCLUSIVE")
    except sqlite3.Error as error:
        if held is not None:
            held.close()
        if getattr(error, "sqlite_errorcode", None) == sqlite3.SQLITE_BUSY:
            raise InputError(
                folder, wanted=say("folder-own-each-studio"), came=say("running-studio-has"),
                todo=say("terminal-use-end-name-another-folder"),
            ) from None  # fmt: skip
        todo = say("terminal-see-folder-can-written-remove-file")
        raise InputError(path, wanted=say("lock-studio-makes"), came=reason(error), todo=todo) from None
    return held


def _listener(host: str, port: int) -> socket.socket:
    """Return a listening socket. Raise `InputError` if the address is not available."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((host, port))
        listener.listen(128)  # clients that read the address may connect at once
    except (OSError, OverflowError) as error:
        listener.close()
        raise InputError(
            f"{host}:{port}",
            wanted=say("free-port-computer"),
            came=reason(error),
            todo=say("terminal-name-another-port-host"),
        ) from None
    return listener


def _draw_beforehand() -> None:
    """Compute the first screen's drawing while the browser still requests the page."""
    from printmend.studio.play import Faults, preview

    preview(Faults())


def _show(server: uvicorn.Server, address: str) -> None:
    """Open the page once the server has started."""
    waited = threading.Event()
    while not server.started and not server.should_exit:
        waited.wait(0.05)
    if server.started:
        webbrowser.open(address)
