"""The API for access from other computers: devices enter by a QR code, and hosts get a printer's model.

A device is admitted or revoked here. A host is paired by a code on the page, gets a token, and fetches newer models.
"""

import json
import re
from typing import Annotated

from fastapi import APIRouter, Query, Request, Response
from fastapi import Path as Where
from fastapi.responses import FileResponse, JSONResponse

from printmend.errors import InputError, RefusedError
from printmend.messages import messages_of, say
from printmend.studio import pairing
from printmend.studio.api import PROBLEMS, Here, Key
from printmend.studio.devices import LONGEST_NAME, Devices, device_address
from printmend.studio.guard import API, LOOPBACK, USER, name_of
from printmend.studio.shapes import KEY, DeviceCard, NewDevice, PairCode, Paired, PairedHost, PairIn, Welcome
from printmend.studio.work import MODEL

router = APIRouter(prefix=f"{API}/devices", responses=PROBLEMS, tags=["devices"])


def _devices(request: Request) -> Devices:
    """Return the devices. Raises `RefusedError` if the studio needs none, and for a user who sees only a part of it."""
    devices: Devices | None = request.app.state.devices
    if devices is None:
        raise RefusedError(
            say("this-studio"), wanted=say("studio-for-others"), came=say("studio-for-this-computer"),
            todo=say("start-for-others"),
        )  # fmt: skip
    if request.scope.get(USER):
        raise RefusedError(
            say("this-device"), wanted=say("device-of-no-user"), came=say("device-of-user"),
            todo=say("ask-who-runs-studio"),
        )  # fmt: skip
    return devices


def _address(request: Request, token: str = "") -> str:
    """Return the address by which another computer reaches this studio: the request's own, unless that is local.

    Over https all requests come through the proxy, so its address is right.
    """
    at_it = request.url.scheme == "http" and name_of(request.headers["host"]) in LOOPBACK
    if at_it and request.app.state.devices is not None:
        return device_address(request.app.state.notes, token)
    return f"{request.url.scheme}://{request.headers['host']}/" + (f"?token={token}" if token else "")


@router.get("", name="list")
def devices(request: Request) -> list[DeviceCard]:
    """List the devices that may enter."""
    return [DeviceCard(name=one.name, user=one.user, created_s=one.created_s) for one in _devices(request).known()]


@router.post("", name="add", status_code=201)
def add(request: Request, new: NewDevice) -> Welcome:
    """Let a device in; its address and the address's QR code are shown this once."""
    import segno

    token = _devices(request).add(new.name, new.user)
    address = _address(request, token)
    return Welcome(name=new.name, address=address, qr=segno.make(address).svg_data_uri(scale=4, border=3, light="#fff"))


@router.delete("/{name}", name="remove", status_code=204)
def remove(request: Request, name: Annotated[str, Where(min_length=1, max_length=LONGEST_NAME)]) -> None:
    """Let a device in no longer."""
    _devices(request).revoke(name)


pairs_router = APIRouter(prefix=API, responses=PROBLEMS, tags=["pair"])
_TOKEN = re.compile(rf"Bearer ({KEY[1:-1]})\.[\w-]{{10,80}}", re.ASCII)


@pairs_router.post("/printers/{key}/pair", name="make_code", status_code=201)
def code(request: Request, here: Here, key: Key) -> PairCode:
    """Make a code by which a host gets this printer's model."""
    here.store.printer(key)
    codes: pairing.Codes = request.app.state.codes
    return PairCode(code=codes.make(key), minutes=round(pairing.CODE_S / 60), address=_address(request).rstrip("/"))


@pairs_router.get("/printers/{key}/pairs", name="list")
def hosts(here: Here, key: Key) -> list[PairedHost]:
    """List the hosts that get this printer's model."""
    here.store.printer(key)
    found = pairing.pairs(here.store.path("printer", key))
    return [PairedHost(name=one.name, created_s=one.created_s) for one in found]


@pairs_router.delete("/printers/{key}/pairs/{name}", name="unpair", status_code=204)
def part(here: Here, key: Key, name: Annotated[str, Where(min_length=1, max_length=60)]) -> None:
    """Let a host have the model no longer."""
    here.store.printer(key)
    pairing.part(here.store.path("printer", key), name)


@pairs_router.post("/pair", name="enter_code", status_code=201)
def pair(request: Request, here: Here, given: PairIn) -> Paired:
    """Take a code from a host, and return the token with which it fetches the model."""
    codes: pairing.Codes = request.app.state.codes
    key = codes.take(given.code)
    row = here.store.printer(key)
    return Paired(token=pairing.pair(here.store.path("printer", key), key, given.name), printer=row["name"])


@pairs_router.get(
    "/pair/model", name="fetch_model", response_class=FileResponse, responses={204: {"description": "no newer one"}}
)
def model(request: Request, here: Here, have: Annotated[str, Query(pattern="^[0-9a-f]{0,64}$")] = "") -> Response:
    """Fetch the model of the printer that a host is paired with, unless it has that one."""
    found = _TOKEN.fullmatch(request.headers.get("authorization", ""))
    folder = here.store.path("printer", found[1]) if found else None
    if found is None or folder is None or not pairing.may_fetch(folder, found[0].removeprefix("Bearer ")):
        words = say("host-not-paired")
        return JSONResponse({"error": words, "messages": messages_of(words)}, 401)
    path = folder / MODEL
    if not path.is_file():
        raise InputError(
            say("this-printer"), wanted=say("model-2"), came=say("none-yet"), todo=say("measure-test-print-studio")
        )
    digest = json.loads(path.read_text(encoding="utf-8"))["digest"]
    return Response(status_code=204) if digest == have else FileResponse(path, filename=MODEL)
