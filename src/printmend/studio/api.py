"""The API's common part: uploads, jobs and their files, and the play screen."""

import asyncio
import contextlib
import os
import re
import secrets
import shutil
import time
from collections.abc import AsyncIterator
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Query, Request
from fastapi import Path as Where
from fastapi.responses import FileResponse
from fastapi.sse import EventSourceResponse, ServerSentEvent
from pydantic import Field
from starlette.concurrency import run_in_threadpool

from printmend import __version__
from printmend.errors import InputError
from printmend.messages import messages_of, say
from printmend.studio.guard import API, LONGEST_UPLOAD_S, USER
from printmend.studio.jobs import StudioState
from printmend.studio.shapes import KEY, EffectList, FaultsIn, Health, JobCard, Preset, Preview, Problem, Upload
from printmend.studio.store import DONE, HALF, NotThereError, check_bytes

LEAST_FREE_BYTES = 500_000_000  # uploads are refused if less of the disk is free
_LOOK_S, _ASK_S = 0.05, 1.0  # interval of looks at a job's folder, and longest interval of looks at the job itself
_MOST_FOLLOWED = 64  # most jobs in one stream
_ODD = re.compile(r"[^\w.+ ()\-]")

PROBLEMS: dict[int | str, dict[str, Any]] = {
    code: {"model": Problem} for code in (400, 401, 403, 404, 409, 413, 421, 422, 507)
}
router = APIRouter(prefix=API, responses=PROBLEMS)


def studio_of(request: Request) -> StudioState:
    """Return the studio as the user of a request sees it."""
    studio: StudioState = request.app.state.studio
    return replace(studio, store=studio.store.of(request.scope.get(USER) or None))


Here = Annotated[StudioState, Depends(studio_of)]
Key = Annotated[str, Where(pattern=KEY)]
Keys = Annotated[list[Annotated[str, Field(pattern=KEY)]], Query(alias="key", min_length=1, max_length=_MOST_FOLLOWED)]


def plain_name(name: str) -> str:
    """Return a file's name without its folder, without odd characters, and not too long."""
    last = re.split(r"[/\\]", name)[-1]
    shown = _ODD.sub("_", last).lstrip(". ") or "file"
    return shown if len(shown) <= 120 else shown[:60] + shown[-60:]


@router.get("/health", tags=["studio"])
def health(request: Request, here: Here) -> Health:
    """Say that the studio is there."""
    waiting = len(here.store.jobs(waiting=True))
    state = request.app.state
    shared = state.devices is not None and not request.scope.get(USER)
    return Health(version=__version__, waiting=waiting, most_bytes=state.most_bytes, shared=shared)


@router.get("/presets", tags=["printers"])
def presets() -> list[Preset]:
    """List the printers that the program knows."""
    from printmend.printer import preset_names, read_printer

    found = []
    for name in preset_names():
        printer = read_printer(name)
        bed = [printer.x.min_mm, printer.y.min_mm, printer.x.max_mm, printer.y.max_mm]
        found.append(Preset(id=name, name=printer.name, kinematics=printer.kinematics, bed_mm=bed))
    return found


@router.post(
    "/uploads", status_code=201, tags=["files"],
    openapi_extra={"requestBody": {"required": True, "content": {"application/octet-stream": {
        "schema": {"type": "string", "format": "binary"}}}}},
)  # fmt: skip
async def upload(request: Request, here: Here, name: Annotated[str, Query(min_length=1, max_length=300)]) -> Upload:
    """Send a file, as the body of the request; its key then stands for it."""
    key, shown, size = secrets.token_hex(8), plain_name(name), 0
    if shutil.disk_usage(here.store.places.data).free < LEAST_FREE_BYTES:
        raise InputError(
            say("disk"), wanted=say("some-free-space"), came=say("less-500-mb"), todo=say("remove-what-needed")
        )
    more_bytes = int(request.headers.get("content-length", 0))
    await run_in_threadpool(check_bytes, here.store, here.most_bytes, more_bytes)
    target = here.store.path("upload", key)
    beside = target.with_name(f".{key}{HALF}")
    try:
        with beside.open("wb") as file:
            async with asyncio.timeout(LONGEST_UPLOAD_S):
                async for chunk in request.stream():
                    size += len(chunk)
                    file.write(chunk)
            await run_in_threadpool(_settle, file, beside, target)
        if size == 0:
            raise InputError(shown, wanted=say("file"), came=say("nothing"), todo=say("choose-another-file"))
        here.store.add_upload(key, shown, size)
    except TimeoutError:
        raise InputError(shown, wanted=say("file-within", f"{LONGEST_UPLOAD_S:.0f}"), came=say("half"),
                         todo=say("send-again")) from None  # fmt: skip
    except BaseException:
        target.unlink(missing_ok=True)
        raise
    finally:
        beside.unlink(missing_ok=True)
    return Upload(id=key, name=shown, bytes=size)


def _settle(file: Any, beside: Path, target: Path) -> None:
    """Give a completely written file its final name."""
    file.flush()
    os.fsync(file.fileno())
    os.replace(beside, target)


@router.delete("/uploads/{key}", name="remove", status_code=204, tags=["files"])
def remove_upload(here: Here, key: Key) -> None:
    """Remove a file that was sent."""
    here.store.upload(key)
    here.store.remove_upload(key)


@router.get("/jobs", name="list", tags=["jobs"])
def jobs(here: Here, printer: Annotated[str | None, Query(pattern=KEY)] = None) -> list[JobCard]:
    """List jobs, the newest first."""
    waiting, cards = here.jobs.waiting(), []
    for row in here.store.jobs(printer=printer):
        with contextlib.suppress(NotThereError):  # removed meanwhile
            cards.append(card(here, row["id"], waiting))
    return cards


def card(here: StudioState, key: str, waiting: list[str] | None = None) -> JobCard:
    """Return a job as the API shows it; ``waiting`` is the queue, if it is known already."""
    here.store.job(key)
    job = here.jobs.look(key)
    named = job.get("files") or (job["result"] or {}).get("files", [])
    files = [name for name in named if here.store.made(key, name).is_file()]  # a cache may be emptied at any time
    queue = [] if job["state"] != "queued" else here.jobs.waiting() if waiting is None else waiting
    ahead, may_force = queue.index(key) if key in queue else 0, (job["result"] or {}).get("may_force", False)
    return JobCard(**{**job, "files": files, "ahead": ahead, "may_force": may_force})


def _there(here: Here, key: Key) -> None:
    """Refuse an unknown job's key before the stream begins: afterwards the stream can only end."""
    here.store.job(key)


def _any_there(here: Here, keys: Keys) -> None:
    """Refuse keys if none of them is a job's."""
    for key in keys:
        with contextlib.suppress(NotThereError):
            here.store.job(key)
            return
    here.store.job(keys[0])


@router.get("/jobs/events", name="follow_many", response_class=EventSourceResponse, tags=["jobs"],
            dependencies=[Depends(_any_there)])  # fmt: skip
async def events_of(request: Request, here: Here, keys: Keys) -> AsyncIterator[ServerSentEvent]:
    """Follow several jobs in one stream, as `/jobs/{key}/events` follows one; it ends when all of them have."""
    async for event in _changes(request, here, keys):
        yield event


@router.get(
    "/jobs/{key}/events",
    name="follow",
    response_class=EventSourceResponse,
    tags=["jobs"],
    dependencies=[Depends(_there)],
)
async def events(request: Request, here: Here, key: Key) -> AsyncIterator[ServerSentEvent]:
    """Follow a job: an event with the job's table whenever it changes, the last one when it has ended."""
    async for event in _changes(request, here, [key]):
        yield event


async def _changes(request: Request, here: StudioState, keys: list[str]) -> AsyncIterator[ServerSentEvent]:
    """Yield an event for each change of jobs, until all have ended or the server does."""
    left: dict[str, tuple[Any, float, JobCard | None]] = dict.fromkeys(keys, (None, 0.0, None))
    while left:
        for key, (stamp, asked_s, last) in list(left.items()):
            if (fresh := here.jobs.stamp(key)) == stamp and time.monotonic() - asked_s < _ASK_S:
                continue
            try:
                now = await run_in_threadpool(card, here, key)
            except NotThereError:  # removed while somebody followed it
                del left[key]
                continue
            left[key] = fresh, time.monotonic(), now
            if now != last:
                yield ServerSentEvent(data=now, event="job")
            if now.state in DONE:
                del left[key]
        if request.app.state.stopping():  # a page asks again when the server is back
            return
        await asyncio.sleep(_LOOK_S)


@router.get("/jobs/{key}", name="get", tags=["jobs"])
def job(here: Here, key: Key) -> JobCard:
    """Return a job."""
    return card(here, key)


@router.post("/jobs/{key}/cancel", tags=["jobs"])
def cancel(here: Here, key: Key) -> JobCard:
    """Stop a job; one that has ended stays as it is."""
    here.store.job(key)
    here.jobs.cancel(key)
    return card(here, key)


@router.delete("/jobs/{key}", name="remove", status_code=204, tags=["jobs"])
def remove_job(here: Here, key: Key) -> None:
    """Remove a job and all that it made, and the file that it was given where no other job has it."""
    upload = here.store.job(key)["params"].get("upload")
    here.jobs.remove(key)
    if upload is not None and not here.store.jobs_of(upload):
        here.store.remove_upload(upload)


@router.get(
    "/jobs/{key}/files/{name}", response_class=FileResponse, tags=["jobs"],
    responses={200: {"content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}}}},
)  # fmt: skip
def file(here: Here, key: Key, name: Annotated[str, Where(max_length=200)]) -> FileResponse:
    """Fetch a file that a job made."""
    offered = card(here, key).files
    path = here.store.made(key, name)
    if name not in offered or not path.is_file():
        raise NotThereError(name, wanted=say("file-job"), came=say("none-name"), todo=say("see-job-files"))
    # only the page's own documents may show it; content-encoding: local files are not worth compressing
    return FileResponse(
        path, filename=name, headers={"Content-Encoding": "identity", "Cache-Control": "private, max-age=3600"}
    )


@router.get("/play/effects", name="effects", tags=["play"])
def play_effects() -> EffectList:
    """Return every effect that the printer may be broken by."""
    from printmend.studio.offered import offered_effects
    from printmend.studio.play import play_printer

    told = {"effects": offered_effects(play_printer()[0])}
    return EffectList.model_validate({**told, "messages": messages_of(told)})


@router.post("/play/preview", name="preview", tags=["play"])
def play_preview(here: Here, faults: FaultsIn) -> Preview:
    """Return the pulleys and the test print of a printer that is broken like this."""
    from printmend.studio.play import faults_of, preview

    shown = Preview(**preview(faults_of(faults.model_dump())))
    here.jobs.warm_soon()
    return shown


@router.post("/play", name="start", status_code=202, tags=["play"])
def play(here: Here, faults: FaultsIn) -> JobCard:
    """Print the test print on such a printer, scan it, learn, and mend a part: a job."""
    return card(here, here.submit("play", None, {"faults": faults.model_dump()}))
