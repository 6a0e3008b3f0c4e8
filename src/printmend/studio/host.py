"""Find a printer's host, OctoPrint or Moonraker (Mainsail, Fluidd), and send files to it.

The studio contacts only the address that the printer's owner gave, only over http or https, and follows no redirect. It
reads answers up to a limit. The key lies beside the printer's description, readable only by its owner, and the API
never shows it.
"""

import itertools
import json
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import IO, Any, Literal, cast
from urllib.parse import urlsplit

import httpx2 as httpx

from printmend.errors import InputError, RefusedError, reason
from printmend.files import replacing
from printmend.messages import say

Kind = Literal["octoprint", "moonraker"]
NAMES: dict[str, str] = {"octoprint": "OctoPrint", "moonraker": "Moonraker"}
FILE = "host.json"
_PATIENCE_S = 10.0  # longest wait for an answer to a request
_DIGEST_S = 300.0  # longest wait for the answer to a file: a host may mend and read it first
_MOST_BYTES = 200_000  # limit of an answer
_QUESTIONS: tuple[tuple[Kind, str], ...] = (("moonraker", "/server/info"), ("octoprint", "/api/version"))
_FILES = {"octoprint": "/api/files/local", "moonraker": "/server/files/upload"}


@dataclass(frozen=True)
class Host:
    """A printer's host: its address, such as ``http://octopi.local``, its API key, and which of the two it is."""

    address: str
    key: str
    kind: Kind


def read_host(folder: Path) -> Host | None:
    """Return the host stored in a printer's folder, None if there is none."""
    try:
        return Host(**json.loads((folder / FILE).read_text(encoding="utf-8")))
    except (FileNotFoundError, ValueError, TypeError):
        return None


def keep_host(folder: Path, host: Host | None) -> None:
    """Store a host in a printer's folder, or remove it (None)."""
    if host is None:
        (folder / FILE).unlink(missing_ok=True)
        return
    (folder / FILE).touch(mode=0o600)  # only the owner may read it; replacing the file keeps the mode
    with replacing(folder / FILE) as file:
        file.write(json.dumps(asdict(host)))


def find_host(address: str, key: str) -> Host:
    """Return the host at an address, after it has said which program it is.

    Raises `InputError` for an invalid address, if neither program answers, and if the key is not accepted.
    """
    address = checked_address(address)
    # Mainsail's pages have paths such as http://mainsail.local/console, but its API is at the root.
    root = address[: address.index("/", address.index("://") + 3)] if address.count("/") > 2 else address
    with _client(key, _PATIENCE_S) as client:
        for at, (kind, path) in itertools.product(dict.fromkeys((address, root)), _QUESTIONS):
            status, said = _ask(client, client.build_request("GET", at + path), _PATIENCE_S)
            if status in (401, 403) and said is not None:
                came = say("no-answer-key") if key else say("no-answer-without-key")
                raise InputError(at, wanted=say("key-accepts"), came=came,
                                 todo=say("copy-api-key-from-settings"))  # fmt: skip
            if status == 200 and _is_of_kind(kind, said):
                return Host(at, key, kind)
    raise InputError(address, wanted=say("octoprint-moonraker-mainsail-fluidd"), came=say("something-else"),
                     todo=say("give-address-browser-shows-when-you"))  # fmt: skip


def checked_address(text: str) -> str:
    """Return an address as it is stored: with http:// if it has no scheme, without a slash at its end.

    Its fragment, such as the end of http://fluidd.local/#/, is left out.
    """
    text = text.strip().partition("#")[0].partition("?")[0]
    text = text if "://" in text else f"http://{text}"
    try:
        parts = urlsplit(text)
        good = parts.scheme in ("http", "https") and bool(parts.hostname) and parts.port != 0
        good &= not (parts.username or parts.password)
        httpx.URL(text).raw_host.decode("ascii").encode("idna")  # sockets do the same: "a..b" is no name
    except (ValueError, httpx.InvalidURL):
        good = False
    if not good or not text.isprintable() or " " in text:
        raise InputError(
            say("printer-address"), wanted=say("http-https-host"), came=repr(text[:100]),
            todo=say("give-browser-shows-example", "http://octopi.local"),
        )  # fmt: skip
    return text.rstrip("/")


def send_file(host: Host, path: Path, name: str, told: Callable[[float], None]) -> None:
    """Upload a file to the host without starting a print; ``told`` is called with the share that was sent.

    Raises `InputError` if the host does not answer, `RefusedError` if it rejects the file.
    """
    with path.open("rb") as file, _client(host.key, _DIGEST_S) as client:
        told_file = _Told(file, max(path.stat().st_size, 1), told)
        request = client.build_request(
            "POST", host.address + _FILES[host.kind], files={"file": (name, cast(IO[bytes], told_file))},
            data={"root": "gcodes"} if host.kind == "moonraker" else {},
        )  # fmt: skip
        status, said = _ask(client, request, _DIGEST_S)
    if status not in (200, 201):
        why = _reason(said)
        raise RefusedError(
            name, wanted=say("takes", NAMES[host.kind]), came=say("answer", status, why),
            todo=say("see-log-download-file-put-there"),
        )  # fmt: skip


class _Told:
    """A file that reports how far it has been read."""

    def __init__(self, file: IO[bytes], size: int, told: Callable[[float], None]) -> None:
        self._file, self._size, self._told = file, size, told

    def read(self, count: int = -1) -> bytes:
        data = self._file.read(count)
        self._told(min(self._file.tell() / self._size, 1.0))
        return data

    def seek(self, place: int, whence: int = 0) -> int:
        return self._file.seek(place, whence)

    def fileno(self) -> int:
        return self._file.fileno()


def _client(key: str, patience_s: float) -> httpx.Client:
    """Return a client for a host in the owner's network."""
    timeout = httpx.Timeout(patience_s, connect=_PATIENCE_S)
    headers = {"Accept-Encoding": "identity"} | ({"X-Api-Key": key} if key else {})  # answers are read as they come
    # ignore the environment's proxy: the host is in the owner's network
    return httpx.Client(timeout=timeout, headers=headers, follow_redirects=False, trust_env=False)


def _ask(client: httpx.Client, request: httpx.Request, patience_s: float) -> tuple[int, Any]:
    """Return an answer's status and its JSON, None if it is not JSON or too long."""
    try:
        answer = client.send(request, stream=True)
        end_s = time.monotonic() + patience_s
        try:
            data = b""
            for chunk in answer.iter_raw():
                data += chunk
                if len(data) > _MOST_BYTES or time.monotonic() > end_s:
                    return answer.status_code, None
        finally:
            answer.close()
    except httpx.HTTPError as error:
        cause = next((each for each in _causes(error) if isinstance(each, OSError)), error)
        came = say("no-answer-time") if isinstance(error, httpx.TimeoutException) else reason(cause)
        raise InputError(
            str(request.url), wanted=say("answer-2"), came=came, todo=say("running-address-right")
        ) from None
    try:
        return answer.status_code, json.loads(data)
    except ValueError:
        return answer.status_code, None


def _causes(error: BaseException) -> Iterator[BaseException]:
    """Yield an error and its causes."""
    cause: BaseException | None = error
    while cause is not None:
        yield cause
        cause = cause.__cause__ or cause.__context__


def _is_of_kind(kind: str, said: Any) -> bool:
    """Return whether an answer comes from a host of this kind."""
    if not isinstance(said, dict):
        return False
    if kind == "moonraker":
        return isinstance(said.get("result"), dict) and "klippy_state" in said["result"]
    return str(said.get("text", "")).startswith("OctoPrint")


def _reason(said: Any) -> str:
    """Return a host's own reason, if it gives one, as the end of a sentence."""
    words = said.get("error") if isinstance(said, dict) else None
    words = words.get("message") if isinstance(words, dict) else words
    return say("in-brackets", " ".join(words.split())[:200]) if isinstance(words, str) else ""
