"""The API by which a host gets a printer's model: a code on the page, a token for the host, each newer model."""

import json
import re
from typing import Annotated

from fastapi import APIRouter, Query, Request, Response
from fastapi import Path as Where
from fastapi.responses import FileResponse

from printmend.errors import InputError
from printmend.messages import say
from printmend.studio import pairing
from printmend.studio.api import PROBLEMS, Here, Key
from printmend.studio.shapes import KEY, PairCode, Paired, PairedHost, PairIn
from printmend.studio.work import MODEL

router = APIRouter(prefix="/api", responses=PROBLEMS, tags=["pair"])
_TOKEN = re.compile(rf"Bearer ({KEY[1:-1]})\.[\w-]{{10,80}}", re.ASCII)


@router.post("/printers/{key}/pair", name="code", status_code=201)
def code(request: Request, here: Here, key: Key) -> PairCode:
    """Make a code by which a host gets this printer's model."""
    here.store.printer(key)
    codes: pairing.Codes = request.app.state.codes
    return PairCode(code=codes.make(key), minutes=round(pairing.CODE_S / 60))


@router.get("/printers/{key}/pairs", name="list")
def hosts(here: Here, key: Key) -> list[PairedHost]:
    """List the hosts that get this printer's model."""
    here.store.printer(key)
    found = pairing.pairs(here.store.path("printer", key))
    return [PairedHost(name=one.name, created_s=one.created_s) for one in found]


@router.delete("/printers/{key}/pairs/{name}", name="part", status_code=204)
def part(here: Here, key: Key, name: Annotated[str, Where(min_length=1, max_length=60)]) -> None:
    """Let a host have the model no longer."""
    here.store.printer(key)
    pairing.part(here.store.path("printer", key), name)


@router.post("/pair", name="pair", status_code=201)
def pair(request: Request, here: Here, given: PairIn) -> Paired:
    """Take a code from a host, and return the token with which it fetches the model."""
    codes: pairing.Codes = request.app.state.codes
    key = codes.take(given.code)
    row = here.store.printer(key)
    return Paired(token=pairing.pair(here.store.path("printer", key), key, given.name), printer=row["name"])


@router.get("/pair/model", name="model", response_class=FileResponse, responses={204: {"description": "no newer one"}})
def model(request: Request, here: Here, have: Annotated[str, Query(pattern="^[0-9a-f]{0,64}$")] = "") -> Response:
    """Fetch the model of the printer that a host is paired with, unless it has that one."""
    found = _TOKEN.fullmatch(request.headers.get("authorization", ""))
    folder = here.store.path("printer", found[1]) if found else None
    if found is None or folder is None or not pairing.may_fetch(folder, found[0].removeprefix("Bearer ")):
        return Response(json.dumps({"error": "this host is not paired: ask the studio for a code"}), 401,
                        media_type="application/json")  # fmt: skip
    path = folder / MODEL
    if not path.is_file():
        raise InputError(
            say("this-printer"), wanted=say("model-2"), came=say("none-yet"), todo=say("measure-test-print-studio")
        )
    digest = json.loads(path.read_text(encoding="utf-8"))["digest"]
    return Response(status_code=204) if digest == have else FileResponse(path, filename=MODEL)
