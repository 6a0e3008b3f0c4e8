"""The studio's memory: printers, uploads and jobs in one SQLite file; large files lie in folders."""

import contextlib
import copy
import itertools
import json
import os
import re
import secrets
import threading
import time
from collections.abc import Container, Iterator
from pathlib import Path
from typing import Any

import sqlalchemy as sql

from printmend.errors import InputError, PrintmendError, reason
from printmend.messages import messages_of, say
from printmend.printer import read_printer
from printmend.studio.places import DATABASE, Places
from printmend.studio.shapes import KEY
from printmend.studio.work import PRINTER

DONE = ("done", "failed", "cancelled")
HALF = ".tmp"  # an incomplete upload's name begins with a dot and ends with this

_META = sql.MetaData()
PRINTERS = sql.Table(
    "printers", _META, sql.Column("owner", sql.String),
    sql.Column("id", sql.String, primary_key=True), sql.Column("name", sql.String, nullable=False),
    sql.Column("created_s", sql.Float, nullable=False),
)  # fmt: skip
UPLOADS = sql.Table(
    "uploads", _META, sql.Column("owner", sql.String),
    sql.Column("id", sql.String, primary_key=True), sql.Column("name", sql.String, nullable=False),
    sql.Column("bytes", sql.Integer, nullable=False), sql.Column("created_s", sql.Float, nullable=False),
)  # fmt: skip
JOBS = sql.Table(
    "jobs", _META, sql.Column("owner", sql.String),
    sql.Column("id", sql.String, primary_key=True), sql.Column("kind", sql.String, nullable=False),
    sql.Column("printer", sql.String, index=True), sql.Column("params", sql.Text, nullable=False),
    sql.Column("state", sql.String, nullable=False, index=True), sql.Column("error", sql.Text),
    sql.Column("result", sql.Text), sql.Column("created_s", sql.Float, nullable=False),
    sql.Column("ended_s", sql.Float),
)  # fmt: skip
Row = dict[str, Any]


class Store:
    """The database and the folders of printers, uploads and jobs in ``places``, made if they are missing.

    Several threads may use it; a kill at any moment leaves it in the state before or after a call. Raises `InputError`
    for a database that cannot be read or written.
    """

    def __init__(self, places: Places) -> None:
        self.places = places
        places.make()
        for half in (places.data / "uploads").glob(f".*{HALF}"):  # was being sent when a server was killed
            half.unlink(missing_ok=True)
        self._naming = threading.Lock()  # between the look whether a name is free and taking it
        self._engine = sql.create_engine(f"sqlite:///{places.state / DATABASE}")
        sql.event.listen(self._engine, "connect", _settle)
        self.owner: str | None = None
        try:
            _META.create_all(self._engine)
            self._add_owners()
            self._find_again()
        except sql.exc.DatabaseError as error:
            self.close()
            raise InputError(
                places.state / DATABASE, wanted=say("studio-database"), came=reason(error.orig or error),
                todo=say("make-room-or-move-database"),
            ) from None  # fmt: skip

    def _add_owners(self) -> None:
        """Add the owners' column to the tables of a studio that knew no users."""
        for table in (PRINTERS, UPLOADS, JOBS):
            if all(column["name"] != "owner" for column in sql.inspect(self._engine).get_columns(table.name)):
                with self._engine.begin() as link:
                    link.execute(sql.text(f"ALTER TABLE {table.name} ADD COLUMN owner VARCHAR"))

    def _find_again(self) -> None:
        """Add printers that have a folder but are missing in the database: their data survive its loss."""
        known = {row["id"] for row in self.printers()}
        for place in sorted((self.places.data / "printers").iterdir()):
            if place.name not in known and re.fullmatch(KEY, place.name) and (place / PRINTER).is_file():
                with contextlib.suppress(PrintmendError):  # not ours
                    self.add_printer("", usually=read_printer(place / PRINTER).name, id=place.name)

    def of(self, owner: str | None) -> "Store":
        """Return the same store as a user sees it: with the user's own rows, and everybody's."""
        view = copy.copy(self)
        view.owner = owner
        return view

    def _mine(self, table: sql.Table) -> Any:
        return sql.true() if self.owner is None else table.c.owner.is_(None) | (table.c.owner == self.owner)

    def close(self) -> None:
        """Close the database's connections."""
        self._engine.dispose()

    def path(self, kind: str, key: str) -> Path:
        """Return the folder of a printer or a job, or the file of an upload; ``key`` must be one of ours."""
        return self.places.data / f"{kind}s" / key

    def pictures(self, job: str) -> Path:
        """Return the folder of a job's pictures, which may be the job's own folder."""
        return self.places.cache / "jobs" / job

    def made(self, job: str, name: str) -> Path:
        """Return the path of a job's file; before there was a cache, its pictures lay among its other files."""
        path = self.path("job", job) / name
        return path if path.is_file() else self.pictures(job) / name

    def held(self) -> tuple[int, int]:
        """Return the bytes on the disk, of everything and of the user's own files; each folder is read once."""
        own = self._own()
        mine = sizes_in(*own)
        everything = mine | sizes_in(*self.places.folders, but=own)
        return sum(everything.values()), sum((everything if self.owner is None else mine).values())

    def _own(self) -> set[Path]:
        """Return the files and folders that are a user's own."""
        if self.owner is None:
            return set()
        found = set()
        for kind, table in (("printer", PRINTERS), ("upload", UPLOADS), ("job", JOBS)):
            for row in self._rows(sql.select(table.c.id).where(table.c.owner == self.owner)):
                found |= {self.path(kind, row["id"])} | ({self.pictures(row["id"])} if kind == "job" else set())
        return found

    def add_printer(self, name: str, *, usually: str, **key: str) -> str:
        """Add a printer; return its key, a new one unless its ``id`` is given.

        Without a name it is called ``usually``, with a number if that is taken. Raises `InputError` for the name of
        another printer.
        """
        with self._naming:
            if name:
                self._refuse_taken(name)
            else:
                taken = self._names()
                name = next(one for one in _numbered(usually) if one.casefold() not in taken)
            return self._insert(PRINTERS, name=name, **key)

    def add_upload(self, key: str, name: str, size: int) -> None:
        """Add an upload, whose file is already in its place."""
        self._insert(UPLOADS, id=key, name=name, bytes=size)

    def add_job(self, kind: str, printer: str | None, params: Row, owner: str | None = None) -> str:
        """Add a waiting job; return its key."""
        return self._insert(JOBS, owner=owner, kind=kind, printer=printer, params=json.dumps(params), state="queued")

    def end_job(self, key: str, state: str, *, error: str | None = None, result: Row | None = None) -> bool:
        """Record how a job ended; return False if it had ended before. Its messages go into the ``result``."""
        if messages := messages_of([error, result]):
            result = {**(result or {}), "messages": messages}
        values = {
            "state": state, "error": error, "result": None if result is None else json.dumps(result),
            "ended_s": time.time(),
        }  # fmt: skip
        open_job = (JOBS.c.id == key) & JOBS.c.state.not_in(DONE)
        with self._engine.begin() as link:
            return link.execute(sql.update(JOBS).where(open_job).values(**values)).rowcount == 1

    def rename_printer(self, key: str, name: str) -> None:
        """Rename a printer. Raises `InputError` for an empty name, and for another printer's name."""
        if not name:
            raise InputError(say("the-printer"), wanted=say("name"), came=say("none"), todo=say("type-one"))
        with self._naming:
            self._refuse_taken(name, but=key)
            with self._engine.begin() as link:
                link.execute(sql.update(PRINTERS).where(PRINTERS.c.id == key).values(name=name))

    def _names(self, *, but: str | None = None) -> set[str]:
        return {row["name"].casefold() for row in self.printers() if row["id"] != but}

    def _refuse_taken(self, name: str, *, but: str | None = None) -> None:
        if name.casefold() in self._names(but=but):
            raise InputError(name, wanted=say("name-own"), came=say("another-printer"), todo=say("add-word-number"))

    def forget(self, kind: str, key: str) -> None:
        """Remove a printer with its jobs, an upload or a job from the database."""
        table = {"printer": PRINTERS, "upload": UPLOADS, "job": JOBS}[kind]
        with self._engine.begin() as link:
            if kind == "printer":
                link.execute(sql.delete(JOBS).where(JOBS.c.printer == key))
            link.execute(sql.delete(table).where(table.c.id == key))

    def remove_upload(self, key: str) -> None:
        """Remove an upload from the database, and its file."""
        self.forget("upload", key)
        self.path("upload", key).unlink(missing_ok=True)

    def printers(self) -> list[Row]:
        """Return all printers, the oldest first."""
        return self._rows(sql.select(PRINTERS).where(self._mine(PRINTERS)).order_by(PRINTERS.c.created_s))

    def printer(self, key: str) -> Row:
        """Return one printer. Raises `InputError` for one that is not there."""
        return self._one(PRINTERS, key, "printer")

    def upload(self, key: str) -> Row:
        """Return one upload. Raises `InputError` for one that is not there."""
        return self._one(UPLOADS, key, "upload")

    def job(self, key: str) -> Row:
        """Return one job. Raises `InputError` for one that is not there."""
        return _read(self._one(JOBS, key, "job"))

    def jobs(self, *, printer: str | None = None, waiting: bool = False, most: int = 200) -> list[Row]:
        """Return jobs, the newest first; of one printer, or only those that have not ended (the oldest first)."""
        query = (
            sql.select(JOBS).where(self._mine(JOBS)).order_by(JOBS.c.created_s if waiting else JOBS.c.created_s.desc())
        )
        if printer is not None:
            query = query.where(JOBS.c.printer == printer)
        query = query.where(JOBS.c.state.not_in(DONE)) if waiting else query.limit(most)
        return [_read(row) for row in self._rows(query)]

    def uploads(self) -> list[Row]:
        """Return all uploads, the oldest first."""
        return self._rows(sql.select(UPLOADS).where(self._mine(UPLOADS)).order_by(UPLOADS.c.created_s))

    def jobs_of(self, upload: str) -> list[str]:
        """Return the jobs that use an upload."""
        return [row["id"] for row in self._rows(sql.select(JOBS.c.id).where(JOBS.c.params.contains(f'"{upload}"')))]

    def forgotten(self, before_s: float, *, kept: tuple[str, ...]) -> tuple[list[str], list[str]]:
        """Return the jobs that ended before a time, except the kinds ``kept``, and the uploads from before it."""
        old = JOBS.c.state.in_(DONE) & JOBS.c.kind.not_in(kept) & (JOBS.c.ended_s < before_s)
        jobs, uploads = sql.select(JOBS.c.id).where(old), sql.select(UPLOADS.c.id).where(UPLOADS.c.created_s < before_s)
        return [row["id"] for row in self._rows(jobs)], [row["id"] for row in self._rows(uploads)]

    def _insert(self, table: sql.Table, **values: Any) -> str:
        key = values.setdefault("id", secrets.token_hex(8))
        values.setdefault("owner", self.owner)
        with self._engine.begin() as link:
            link.execute(sql.insert(table).values(created_s=time.time(), **values))
        return str(key)

    def _rows(self, query: Any) -> list[Row]:
        with self._engine.connect() as link:
            return [dict(row) for row in link.execute(query).mappings()]

    def _one(self, table: sql.Table, key: str, kind: str) -> Row:
        rows = self._rows(sql.select(table).where((table.c.id == key) & self._mine(table)))
        if not rows:
            raise NotThereError(
                f"{kind} {key}", wanted=say(f"{kind}-of-this-studio"), came=say("none"), todo=say("look-list")
            )
        return rows[0]


class NotThereError(InputError):
    """The requested item is not in the studio."""


def bytes_in(*paths: Path) -> int:
    """Return the disk space of files and of folders' contents; a file with two names counts once."""
    return sum(sizes_in(*paths).values())


def sizes_in(*paths: Path, but: Container[Path] = ()) -> dict[tuple[int, int], int]:
    """Return the sizes of files and of folders' contents, by each file's identity; ``but`` is left out."""
    seen: dict[tuple[int, int], int] = {}
    for path in paths:
        for place in [path] if path.is_file() else _files_in(path, but):
            with contextlib.suppress(OSError):  # removed meanwhile
                stat = place.stat()
                seen[stat.st_dev, stat.st_ino] = stat.st_size
    return seen


def _files_in(folder: Path, but: Container[Path]) -> Iterator[Path]:
    for base, folders, names in os.walk(folder):
        folders[:] = [name for name in folders if Path(base, name) not in but]
        yield from (path for name in names if (path := Path(base, name)) not in but)


def _numbered(name: str) -> Iterator[str]:
    """Yield a name, then it with 2, 3 and so on behind it."""
    yield name
    for count in itertools.count(2):
        yield f"{name} {count}"


def _read(row: Row) -> Row:
    row["params"] = json.loads(row["params"])
    row["result"] = None if row["result"] is None else json.loads(row["result"])
    return row


def _settle(link: Any, _: Any) -> None:
    """Let readers and a writer work side by side; only a power cut may lose the last writes."""
    for line in ("PRAGMA journal_mode=WAL", "PRAGMA synchronous=NORMAL", "PRAGMA busy_timeout=10000"):
        link.execute(line)


# Limits of one user in a studio that several use: bytes on its disk, and waiting jobs.
#
# Only users have these limits. A device that sees everything has the studio's own.

SHARE = 0.5  # share of the studio's bytes for one user
MOST_WAITING = 100  # most waiting jobs of one user


def check_bytes(store: Store, most_bytes: int, more_bytes: int = 0) -> None:
    """Raise `InputError` if ``more_bytes`` would exceed the store's ``most_bytes``, or its user's share."""
    held, own = store.held()
    if held + more_bytes > most_bytes:
        raise InputError(
            say("subject-studio"), wanted=say("most-gb-folder", f"{most_bytes / 1e9:g}"),
            came=say("gb", f"{held / 1e9:.1f}"), todo=say("free-some-under-storage"),
        )  # fmt: skip
    if store.owner is not None and own + more_bytes > most_of(store, most_bytes):
        raise InputError(
            store.owner, wanted=say("most-gb-user", f"{most_of(store, most_bytes) / 1e9:g}"),
            came=say("gb", f"{own / 1e9:.1f}"), todo=say("free-some-under-storage"),
        )  # fmt: skip


def check_jobs(store: Store) -> None:
    """Raise `InputError` if a user has too many waiting jobs."""
    if store.owner is None:
        return
    mine = sum(job["owner"] == store.owner for job in store.jobs(waiting=True))
    if mine >= MOST_WAITING:
        raise InputError(store.owner, wanted=say("fewer-jobs-user", MOST_WAITING), came=f"{mine}",
                         todo=say("wait-or-stop-some"))  # fmt: skip


def most_of(store: Store, most_bytes: int) -> int:
    """Return how many of the studio's bytes this store's user may take."""
    return most_bytes if store.owner is None else int(SHARE * most_bytes)
