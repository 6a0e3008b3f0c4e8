"""Talk to a `printmend studio`, on this computer or another: send a file, wait for the job, fetch what it made.

    studio = Studio("http://workshop:8765", token="...")
    done = studio.mend("part.gcode", printer="Ender in the cellar", output="part.mended.gcode")
    print(done["summary"])

Only the standard library and `errors` are used, so that a computer too small for the rest can mend on another one.
"""

import http.client
import json
import time
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any

from printmend import provenance
from printmend.errors import InputError, PrintmendError, RefusedError, reason
from printmend.files import replacing
from printmend.messages import restored, say

_PATIENCE_S = 60.0  # for one answer
_LOOK_S = 0.2  # between two looks at a job


class StudioError(PrintmendError):
    """The studio refused a request; its own line says why."""

    def __init__(self, words: str) -> None:
        super().__init__("studio", wanted="", came="", todo="")
        self.message, self.args = words, (words,)


class Studio:
    """A studio at an address; ``token`` is what it printed when it was started for other computers."""

    def __init__(self, address: str = "http://127.0.0.1:8765", *, token: str | None = None) -> None:
        if urllib.parse.urlsplit(address).scheme not in ("http", "https"):
            raise InputError(address, wanted=say("http-https-host"), came=say("another-address"), todo=say("check"))
        self._address, self._token = address.rstrip("/"), token

    def get(self, path: str) -> Any:
        """Return what the API says at ``path``, for example ``/printers``. Raises `StudioError`."""
        return self._ask("GET", path)

    def post(self, path: str, table: dict[str, Any] | None = None) -> Any:
        """Send a table to the API. Raises `StudioError`."""
        return self._ask("POST", path, json.dumps(table or {}).encode(), "application/json")

    def upload(self, path: str | Path) -> str:
        """Send a file; return the key that stands for it. Raises `StudioError`, `InputError` if it cannot be read."""
        path = Path(path)
        query = urllib.parse.urlencode({"name": path.name})
        try:
            with path.open("rb") as file:
                size = path.stat().st_size
                return str(self._ask("POST", f"/uploads?{query}", file, "application/octet-stream", size=size)["id"])
        except OSError as error:
            came = reason(error)
            raise InputError(path, wanted=say("file-can-read"), came=came, todo=say("check-path")) from None

    def wait(self, job: str, told: Callable[[dict[str, Any]], None] = lambda job: None) -> dict[str, Any]:
        """Wait for a job and return its result; ``told`` hears how far it is. Raises `StudioError` where it failed."""
        while True:
            now = self.get(f"/jobs/{job}")
            told(now)
            if now["state"] == "done":
                return dict(now["result"])
            if now["state"] in ("failed", "cancelled"):
                messages = (now["result"] or {}).get("messages", {})
                raise StudioError(restored(now["error"], messages) or say("job-was-stopped"))
            time.sleep(_LOOK_S)

    def fetch(self, job: str, name: str, output: str | Path) -> None:
        """Write a file that a job made to ``output``; nothing is there before it is whole. Raises `StudioError`."""
        place = f"/jobs/{job}/files/{urllib.parse.quote(name)}"
        with self._open("GET", place) as answer, replacing(Path(output), "wb") as file:
            while chunk := answer.read(1 << 20):
                file.write(chunk)

    def printer(self, name: str) -> str:
        """Return the key of the printer of that name, or with that key. Raises `InputError` where there is none."""
        printers = self.get("/printers")
        for one in printers:
            if name in (one["id"], one["name"]):
                return str(one["id"])
        came = ", ".join(one["name"] for one in printers) or "none"
        raise InputError(name, wanted=say("printer-studio"), came=came, todo=say("add-studio"))

    def mend(self, source: str | Path, *, printer: str, output: str | Path) -> dict[str, Any]:
        """Mend a G-code file for a printer of the studio into ``output``; return the prediction with its ``summary``.

        Raises `RefusedError` where mending would not help (nothing is written), `StudioError` where it failed.
        """
        key = self.printer(printer)
        job = self.post(f"/printers/{key}/mend", {"upload": self.upload(source), "scene": False})["id"]
        result = self.wait(job)
        if result["refused"]:
            raise RefusedError(source, wanted=say("file-mending-helps"), came=result["refused"],
                               todo=say("print-original"))  # fmt: skip
        self.fetch(job, result["output"], output)
        return result

    def fetch_model(self, output: str | Path, have: str = "") -> bool:
        """Write the model of a paired printer to ``output`` unless its digest is ``have``; return whether it was.

        A file is replaced only by a whole model. Raises `StudioError`.
        """
        with self._open("GET", f"/pair/model?have={have}") as answer:
            if answer.status == 204:
                return False
            with replacing(Path(output), "wb") as file:
                while chunk := answer.read(1 << 20):
                    file.write(chunk)
                file.flush()
                try:
                    provenance.read_model(file.name)
                except provenance.NoModelError:
                    raise StudioError(say("studio-no-whole-model")) from None
        return True

    def _ask(self, method: str, path: str, body: bytes | IO[bytes] | None = None, kind: str = "", *,
             size: int | None = None) -> Any:  # fmt: skip
        with self._open(method, path, body, kind, size=size) as answer:
            text = answer.read()
        return json.loads(text) if text else None

    def _open(self, method: str, path: str, body: bytes | IO[bytes] | None = None, kind: str = "", *,
              size: int | None = None) -> Any:  # fmt: skip
        headers = {"Content-Type": kind} if kind else {}
        if size is not None:
            headers["Content-Length"] = str(size)
        if self._token is not None:
            headers["Authorization"] = f"Bearer {self._token}"
        # an address of http or https: see __init__
        request = urllib.request.Request(f"{self._address}/api/v1{path}", data=body, method=method, headers=headers)  # noqa: S310
        try:
            return urllib.request.urlopen(request, timeout=_PATIENCE_S)  # noqa: S310
        except urllib.error.HTTPError as error:
            try:
                table = json.loads(error.read())
                words = restored(str(table["error"]), table.get("messages", {}))
            except (ValueError, KeyError, TypeError):
                words = f"{error.code} {error.reason}"
            raise StudioError(words) from None
        except (OSError, http.client.HTTPException) as error:
            why = getattr(error, "reason", error)
            came = reason(why) if isinstance(why, Exception) else str(why)
            raise StudioError(
                InputError(self._address, wanted=say("studio-2"), came=came, todo=say("running")).message
            ) from None


def pair_file(model: Path) -> Path:
    """Return where it is kept with which studio a model is paired."""
    return model.with_name(f"{model.name}.studio")


def pair(model: Path, address: str, code: str, name: str) -> str:
    """Pair a model's file with a studio by a code, and fetch the model; return the printer's name there.

    Raises `StudioError` where the code is no good, or the printer has no model yet.
    """
    done = Studio(address).post("/pair", {"code": code, "name": name})
    kept = pair_file(model)
    kept.touch(mode=0o600)
    with replacing(kept) as file:
        json.dump({"address": address, "token": done["token"]}, file)
    update(model)
    return str(done["printer"])


def update(model: Path) -> bool:
    """Fetch a newer model from the studio that it is paired with; return whether there was one.

    Raises `InputError` where it is not paired, `StudioError` where the studio does not give it.
    """
    try:
        kept = json.loads(pair_file(model).read_text(encoding="utf-8"))
        address, token = str(kept["address"]), str(kept["token"])
    except (OSError, ValueError, KeyError, TypeError):
        raise InputError(pair_file(model), wanted=say("model-paired-studio"), came=say("none"),
                         todo=say("terminal-pair-first-printmend-pair-address-code")) from None  # fmt: skip
    try:
        have = provenance.read_model(str(model)).digest
    except provenance.NoModelError:
        have = ""
    return Studio(address, token=token).fetch_model(model, have)
