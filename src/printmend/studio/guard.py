"""The access rules: who may use the studio, how much they may send, and what a browser may do with its pages.

The server has no accounts. It listens on this computer only, unless it knows devices by their tokens. Another site's
page in the same browser could still send requests here. Such a request names its site as Origin, or reaches us by a
name that is not ours (DNS rebinding); both are refused. Each connection must send a request in time, and the number of
connections from one address is limited.
"""

import asyncio
import contextlib
import ipaddress
import json
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable
from http.cookies import CookieError, SimpleCookie
from pathlib import Path
from typing import Any, ClassVar
from urllib.parse import parse_qs, urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol

from printmend.messages import messages_of, say

ASK_S = 10.0  # longest time from the start of a connection, or of a further request on it, to the end of its headers
MOST_AN_ADDRESS = 128  # most connections from an address; a browser has six, and a proxy has many users


class Door(H11Protocol):
    """A uvicorn connection that closes if no request comes in time. It extends uvicorn's own class, because the setting
    `http` accepts only a class."""

    _open: ClassVar[Counter[str]] = Counter()
    _silent: ClassVar[defaultdict[str, dict["Door", None]]] = defaultdict(dict)  # the longest silent first

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin to wait for a request. If an address has too many connections, close the one that is silent longest.

        Connections that arrive together are all made before the first is read, so silence alone proves nothing.
        """
        super().connection_made(transport)
        self._late: asyncio.TimerHandle | None = None
        self._address = self.client[0] if self.client else ""
        self._open[self._address] += 1
        self._wait()
        if self._open[self._address] > MOST_AN_ADDRESS:
            next(iter(self._silent[self._address])).end()

    def end(self) -> None:
        """Close the connection at once."""
        self._stop_waiting()
        self.transport.abort()

    def data_received(self, data: bytes) -> None:
        """Receive data; stop the timer once the headers are complete."""
        super().data_received(data)
        asked = self.cycle is not None and not self.cycle.response_complete
        if asked:
            self._stop_waiting()
        elif not self.transport.is_closing():
            self._wait()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget a connection."""
        self._stop_waiting()
        self._open[self._address] -= 1
        if not self._open[self._address]:
            del self._open[self._address]
        super().connection_lost(exc)

    def _wait(self) -> None:
        if self._late is None:
            self._silent[self._address][self] = None
            self._late = self.loop.call_later(ASK_S, self.end)

    def _stop_waiting(self) -> None:
        if self._late is not None:
            self._late.cancel()
            self._late = None
            del self._silent[self._address][self]
            if not self._silent[self._address]:
                del self._silent[self._address]


LOOPBACK = ("127.0.0.1", "localhost", "::1")
COOKIE = "printmend_token"
USER = "printmend.user"  # key in a request's scope: the device's user, empty if it sees everything
API, _BEFORE = "/api/v1", "/api/"  # hosts that were paired before the API had a version keep working
SIGN_IN = Path(__file__).parent / "sign_in.html"
_OPEN = (  # files of the sign-in page, and routes that hosts use with a code or their own token
    "/style.css", "/icon.svg", f"{API}/pair", f"{API}/pair/model",
)  # fmt: skip
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; connect-src 'self'; "
    "manifest-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_HEADERS = {
    "Content-Security-Policy": POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
}
LONGEST_UPLOAD_S = 900.0  # longest time for one file
_KEPT_S = 400 * 86_400  # how long a browser keeps its token; to end this, revoke the device
_BODY_S = 20.0  # longest time for the body of a request that is no upload
_SMALL_BYTES = 1_000_000  # most bytes of a request that is no upload


class Guard:
    """The access check before the ASGI application ``app``: it answers to the names ``hosts``; ``user_of`` returns a
    token's user, None for an unknown token."""

    def __init__(
        self, app: ASGIApp, *, hosts: Iterable[str], user_of: Callable[[str], str | None] | None, most_bytes: int
    ) -> None:
        self._app, self._hosts, self._user_of, self._most_bytes = app, frozenset(hosts), user_of, most_bytes

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let a request pass, or answer it with the reason for the refusal."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        if scope["type"] != "http":
            return
        if scope["path"].startswith(_BEFORE) and not scope["path"].startswith(f"{API}/"):
            path = f"{API}/" + scope["path"].removeprefix(_BEFORE)
            scope = {**scope, "path": path, "raw_path": path.encode()}
        headers = Headers(scope=scope)
        limit = self._most_bytes if scope["path"] == f"{API}/uploads" else _SMALL_BYTES
        refusal = self._refusal(scope, headers, limit)
        if refusal is not None:
            await _answer(send, *refusal)
            return
        if self._user_of is not None:
            users = [user for token in _given(scope, headers) if (user := self._user_of(token)) is not None]
            if not users and scope["path"] not in _OPEN:
                await _ask(send, scope, headers)
                return
            scope = {**scope, USER: users[0] if users else ""}
        cookie = self._fresh_cookie(scope)
        await self._app(
            scope,
            _bounded(receive, limit, LONGEST_UPLOAD_S + _BODY_S if limit != _SMALL_BYTES else _BODY_S),
            _with_headers(send, cookie),
        )

    def _refusal(self, scope: Scope, headers: Headers, limit: int) -> tuple[int, str] | None:
        host = headers.get("host", "")
        if name_of(host) not in self._hosts and name_of(host) != _reached(scope):
            return 421, say("studio-answers-to", ", ".join(sorted(self._hosts)))
        origin = headers.get("origin")
        if origin is not None and urlsplit(origin).netloc != host:
            return 403, say("page-another-site-may-talk-studio")
        if headers.get("sec-fetch-site", "none") not in ("same-origin", "none") and scope["method"] != "GET":
            return 403, say("page-another-site-may-talk-studio")
        length = headers.get("content-length", "0")
        if not length.isascii() or not length.isdigit():
            return 400, say("request-length-no-number")
        if int(length) > limit:
            return 413, say("upload-too-large", f"{limit / 1e6:g}")
        return None

    def _fresh_cookie(self, scope: Scope) -> str | None:
        """Return the cookie for a browser whose address contains a token."""
        token = _query_token(scope)
        if self._user_of is None or not token or self._user_of(token) is None:
            return None
        secure = "; Secure" if scope["scheme"] == "https" else ""  # behind a proxy that speaks TLS
        return f"{COOKIE}={token}; Path=/; Max-Age={_KEPT_S}; HttpOnly; SameSite=Strict{secure}"


def _given(scope: Scope, headers: Headers) -> list[str]:
    """Return the tokens in a request."""
    given = [headers.get("authorization", "").removeprefix("Bearer "), _query_token(scope)]
    with contextlib.suppress(CookieError):
        given += [morsel.value for name, morsel in SimpleCookie(headers.get("cookie", "")).items() if name == COOKIE]
    return [one for one in given if one]


def _query_token(scope: Scope) -> str:
    """Return the token in a request's address."""
    return parse_qs(scope.get("query_string", b"").decode("latin-1")).get("token", [""])[0]


def _reached(scope: Scope) -> str | None:
    """Return the IP address of this computer at which a request arrived, None if it has none. The computer may have got
    it after the start. It is safe to accept: DNS rebinding needs a name."""
    with contextlib.suppress(ValueError, TypeError, KeyError):
        address = ipaddress.ip_address(scope["server"][0])
        return str(getattr(address, "ipv4_mapped", None) or address)
    return None


def name_of(host: str) -> str:
    """Return the host of a Host header without its port: ``[::1]:8765`` is ``::1``."""
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""


def _bounded(receive: Receive, limit: int, longest_s: float) -> Receive:
    """Return a ``receive`` that ends a body beyond ``limit`` bytes, or one that takes longer than ``longest_s``."""
    seen, end_s, whole = 0, 0.0, False

    async def bounded() -> Message:
        nonlocal seen, end_s, whole
        if whole:  # wait for the client to disconnect
            return await receive()
        end_s = end_s or time.monotonic() + longest_s
        try:
            async with asyncio.timeout(max(0.0, end_s - time.monotonic())):
                message = await receive()
        except TimeoutError:
            return {"type": "http.disconnect"}
        seen += len(message.get("body", b""))
        whole = not message.get("more_body", False)
        if seen > limit:
            raise TooLargeError(limit)
        return message

    return bounded


class TooLargeError(Exception):
    """A body was larger than allowed."""


def _with_headers(send: Send, cookie: str | None) -> Send:
    """Return a ``send`` that adds our headers to every answer."""

    async def sending(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            for name, value in _HEADERS.items():
                headers[name] = value
            if cookie is not None:
                headers.append("set-cookie", cookie)
        await send(message)

    return sending


async def _ask(send: Send, scope: Scope, headers: Headers) -> None:
    """Answer a request without a token; a browser that wants a page gets the sign-in page."""
    if scope["method"] != "GET" or "text/html" not in headers.get("accept", ""):
        await _answer(send, 401, say("studio-needs-token-open-address-printed"))
        return
    again = b"hidden" if not _query_token(scope) else b""
    body = SIGN_IN.read_bytes().replace(b"data-wrong", again)
    given = {**_HEADERS, "Content-Security-Policy": POLICY.replace("form-action 'none'", "form-action 'self'")}
    given |= {"Content-Type": "text/html; charset=utf-8", "Cache-Control": "no-store"}
    raw = [(name.lower().encode(), value.encode()) for name, value in given.items()]
    await send({"type": "http.response.start", "status": 401, "headers": raw})
    await send({"type": "http.response.body", "body": body})


async def _answer(send: Send, status: int, words: str) -> None:
    body = json.dumps({"error": words, "messages": messages_of(words)}).encode()
    headers: list[Any] = [(b"content-type", b"application/json"), (b"connection", b"close")]
    headers += [(name.lower().encode(), value.encode()) for name, value in _HEADERS.items()]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": body})
