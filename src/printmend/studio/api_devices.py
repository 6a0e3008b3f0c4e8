"""The API of the devices that may enter from other computers: let one in by a QR code, and shut one out."""

from typing import Annotated

from fastapi import APIRouter, Request
from fastapi import Path as Where

from printmend.errors import RefusedError
from printmend.messages import say
from printmend.studio.api import PROBLEMS
from printmend.studio.devices import LONGEST_NAME, Devices
from printmend.studio.guard import USER
from printmend.studio.shapes import DeviceCard, NewDevice, Welcome

router = APIRouter(prefix="/api/devices", responses=PROBLEMS, tags=["devices"])


def _devices(request: Request) -> Devices:
    """Return who may enter. Raises `RefusedError` where nobody needs to, and for a user who sees a part only."""
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


@router.get("", name="list")
def devices(request: Request) -> list[DeviceCard]:
    """List the devices that may enter."""
    return [DeviceCard(name=one.name, user=one.user, created_s=one.created_s) for one in _devices(request).known()]


@router.post("", name="add", status_code=201)
def add(request: Request, new: NewDevice) -> Welcome:
    """Let a device in; its address and the address's QR code are shown this once."""
    import segno

    token = _devices(request).add(new.name, new.user)
    address = f"{request.url.scheme}://{request.headers['host']}/?token={token}"
    return Welcome(name=new.name, address=address, qr=segno.make(address).svg_data_uri(scale=4, border=3, light="#fff"))


@router.delete("/{name}", name="remove", status_code=204)
def remove(request: Request, name: Annotated[str, Where(min_length=1, max_length=LONGEST_NAME)]) -> None:
    """Let a device in no longer."""
    _devices(request).revoke(name)
