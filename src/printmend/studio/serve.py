"""Start the studio: a socket on this computer, a token where others may come, the browser."""

import contextlib
import json
import socket
import sqlite3
import threading
import webbrowser
from collections.abc import Callable
from pathlib import Path
from typing import Any

import uvicorn

from printmend.cluster import Cluster
from printmend.errors import InputError, reason
from printmend.files import replacing
from printmend.messages import say
from printmend.studio.app import MOST_HELD_BYTES, WORKERS, create_app
from printmend.studio.devices import FIRST, Devices
from printmend.studio.guard import LOOPBACK, Door
from printmend.studio.places import ADDRESS, LOCK, Places
from printmend.studio.reach import EVERYWHERE, address_of, device_address, everywhere


def serve(
    places: Places, *, host: str, port: int, names: tuple[str, ...] = (), browser: bool, told: Callable[[str], None],
    workers: int = WORKERS, cluster: str | None = None, most_gb: float = MOST_HELD_BYTES / 1e9,
) -> None:  # fmt: skip
    """Serve until Ctrl-C. From another ``host`` than this computer only known devices come in, see `Devices`.

    ``names`` are further names by which browsers reach it, as through a proxy: then, too. ``cluster`` runs the jobs
    elsewhere (see `Cluster`). Raises `InputError` where the port is not free, another studio has the folder, or
    nobody answers at the cluster's address.
    """
    remote = None if cluster is None else Cluster.at(cluster)
    devices = None if host in LOOPBACK and not names else Devices(places.state)
    known = () if devices is None else devices.known()
    reached = everywhere() if host in EVERYWHERE else [host]
    hosts = {*LOOPBACK, *names, *reached}
    listener = _listener(host, port)
    alone = _alone(places.state)
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
    """Let a device in; return the address that it opens: of the studio that was last started for others from
    ``folder``, unless ``host`` or ``port`` was ``given``. Raises `InputError` for a name that is taken."""
    token = Devices(folder).add(name, user)
    return device_address(folder, token, None if not given else (host, port))


def _note(path: Path, table: dict[str, Any] | None) -> None:
    """Write a table for the other commands; None where there is nothing to tell them."""
    path.unlink(missing_ok=True)
    if table is not None:
        path.touch(mode=0o600)
        with replacing(path) as file:
            json.dump(table, file)


def _alone(folder: Path) -> sqlite3.Connection:
    """Return what keeps ``folder`` for this studio alone until it is closed, or the program ends in whatever way.

    Raises `InputError` where another studio has it, as two would take each other's jobs, and where nothing can be
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
    """Return a socket that listens. Raise `InputError` where the address cannot be had."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((host, port))
        listener.listen(128)  # whoever reads the address may come at once
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
    """Draw what the first screen shows, while the browser still asks for the page."""
    from printmend.studio.play import Faults, preview

    preview(Faults())


def _show(server: uvicorn.Server, address: str) -> None:
    """Open the page once the server has started."""
    waited = threading.Event()
    while not server.started and not server.should_exit:
        waited.wait(0.05)
    if server.started:
        webbrowser.open(address)
