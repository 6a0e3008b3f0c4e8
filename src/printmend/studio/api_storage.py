"""The API of a studio's disk space: how much it uses, and how to free it."""

import contextlib
import shutil
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from fastapi import APIRouter
from fastapi import Path as Where

from printmend.studio.api import PROBLEMS, Here, card
from printmend.studio.guard import API
from printmend.studio.jobs import StudioState
from printmend.studio.shapes import Storage, StoragePart
from printmend.studio.store import DONE, NotThereError, bytes_in, most_of
from printmend.studio.work import PHOTO, THUMB

Part = Literal["mended", "play", "measured", "unused"]
_KINDS: dict[str, Part] = {
    "mend": "mended",
    "play": "play",
    "measure": "measured",
    "check": "measured",
    "fit": "measured",
    "send": "measured",
}
_PICTURES = (THUMB, PHOTO.format(1))
_MOST_SHOWN = 8  # most small pictures of a part
router = APIRouter(prefix=f"{API}/storage", responses=PROBLEMS, tags=["storage"])


@router.get("", name="list")
def storage(here: Here) -> Storage:
    """Say what the studio keeps and how much of the disk is free."""
    found = {part: StoragePart(part=part, count=0, bytes=0) for part in get_args(Part)}
    for name, path in _freed(here):
        part = found[name]
        part.count += 1
        part.bytes += bytes_in(path, here.store.pictures(path.name))
        made = (one for one in _PICTURES if here.store.made(path.name, one).is_file())
        if len(part.shown) < _MOST_SHOWN and (picture := next(made, None)):
            with contextlib.suppress(
                NotThereError
            ):  # a failed job offers no picture, and a job may be removed meanwhile
                if picture in card(here, path.name).files:
                    part.shown.append(f"{API}/jobs/{path.name}/files/{picture}")
    parts = list(found.values())
    kept = here.store.held()[1] - sum(part.bytes for part in parts)
    free = shutil.disk_usage(here.store.places.data).free
    return Storage(
        parts=parts, kept_bytes=max(kept, 0), free_bytes=free, most_bytes=most_of(here.store, here.most_bytes)
    )


@router.delete("/{part}", name="free")
def free(here: Here, part: Annotated[Part, Where()]) -> Storage:
    """Remove one part of what is kept. Printers, their models and their history always stay."""
    for mine, path in _freed(here):
        if mine == part:
            with contextlib.suppress(NotThereError):  # removed meanwhile
                _remove(here, part, path)
    return storage(here)


def _freed(here: StudioState) -> list[tuple[Part, Path]]:
    """Return everything that may be removed: folders of ended jobs, and uploads that no job uses."""
    store, found = here.store, []
    held: set[str] = set()
    for job in store.jobs(most=1_000_000):
        keys = _uploads(job["params"])
        if job["state"] in DONE and job["kind"] in _KINDS:
            found.append((_KINDS[job["kind"]], store.path("job", job["id"])))
        held.update(keys)
    unused = [store.path("upload", row["id"]) for row in store.uploads() if row["id"] not in held]
    return [*found, *(("unused", path) for path in unused)]


def _uploads(params: dict[str, Any]) -> list[str]:
    """Return the uploads that a job uses."""
    return [*([params["upload"]] if "upload" in params else []), *(one["upload"] for one in params.get("scans", ()))]


def _remove(here: StudioState, part: Part, path: Path) -> None:
    if part == "unused":
        here.store.remove_upload(path.name)
        return
    given = _uploads(here.store.job(path.name)["params"])
    here.jobs.remove(path.name)
    for upload in given:
        if not here.store.jobs_of(upload):
            here.store.remove_upload(upload)
