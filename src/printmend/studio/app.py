"""The server: a FastAPI application over the user's folders, with its page and its API."""

from collections.abc import AsyncIterator, Callable, Iterable
from concurrent.futures import Executor
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from fastapi import APIRouter, FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from fastapi.routing import APIRoute
from starlette.exceptions import HTTPException
from starlette.middleware.gzip import GZipMiddleware
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp

from printmend import __version__
from printmend.errors import InputError, PrintmendError, RefusedError
from printmend.messages import messages_of, page_messages, say
from printmend.studio import api, api_devices, api_printers, api_storage
from printmend.studio.devices import Devices
from printmend.studio.guard import API, LOOPBACK, Guard, TooLargeError
from printmend.studio.jobs import Jobs, StudioState
from printmend.studio.pairing import Codes
from printmend.studio.places import Places
from printmend.studio.store import NotThereError, Store

PAGE = Path(__file__).parent / "page"
MOST_BYTES = 400_000_000  # limit of an upload: a sliced part of this size takes a day to print
MOST_HELD_BYTES = 20_000_000_000  # limit of all that the studio keeps
WORKERS = 2  # processes that jobs run in
_ABOUT = (
    "Everything that the page does, for other programs: send files, start jobs, follow them, fetch what they made. "
    "Lengths are mm. Errors are a table with one line, `error`."
)


def create_app(
    places: Places,
    *,
    hosts: Iterable[str] = LOOPBACK,
    devices: Devices | None = None,
    workers: int = WORKERS,
    cluster: Executor | None = None,
    most_bytes: int = MOST_BYTES,
    most_held_bytes: int = MOST_HELD_BYTES,
    stopping: Callable[[], bool] = lambda: False,
) -> ASGIApp:
    """Return the server over ``places``, where everything is kept: printers, uploads, jobs and their files.

    ``hosts`` are the names that it answers to, ``devices`` those that may enter from other computers. Jobs run in
    ``workers`` processes, or on a ``cluster`` that also sees the folders. ``stopping`` says when streams of events
    should end.
    """

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        store = Store(places)
        jobs = Jobs(store, workers=workers, cluster=cluster)
        app.state.studio = StudioState(store, jobs, most_held_bytes)
        yield
        jobs.close()
        store.close()

    app = FastAPI(
        title="printmend studio", version=__version__, description=_ABOUT, lifespan=lifespan, docs_url=None,
        redoc_url=None, openapi_url=None, generate_unique_id_function=_operation_id,
    )  # fmt: skip
    app.add_api_route(
        f"{API}/openapi.json", lambda: _description(app), include_in_schema=False, response_class=JSONResponse
    )
    app.state.most_bytes, app.state.stopping, app.state.devices = most_bytes, stopping, devices
    app.state.notes = places.state
    app.state.codes = Codes()
    app.add_exception_handler(PrintmendError, _refused)
    app.add_exception_handler(RequestValidationError, _misfit)
    app.add_exception_handler(HTTPException, _http)
    app.add_exception_handler(TooLargeError, _too_large)
    for router in (api.router, api_printers.router, api_storage.router, api_devices.router, api_devices.pairs_router):
        _name_operations(router)
        app.include_router(router)
    app.add_api_route("/messages.json", page_messages, include_in_schema=False, response_class=JSONResponse)
    app.mount("/", StaticFiles(directory=PAGE, html=True))
    return Guard(
        GZipMiddleware(app, minimum_size=2000, compresslevel=5),
        hosts=hosts,
        user_of=None if devices is None else devices.user_of,
        most_bytes=most_bytes,
    )


def _operation_id(route: APIRoute) -> str:
    """Return an operation's name: its subject and its action."""
    return "_".join(str(word) for word in (*route.tags[:1], route.name))


def _description(app: FastAPI) -> dict[str, Any]:
    """Return the API's description as OpenAPI 3.1, which cannot describe the events of a stream yet."""
    document = app.openapi()
    for operations in document["paths"].values():
        for operation in operations.values():
            for answer in operation["responses"].values():
                for content in answer.get("content", {}).values():
                    if content.pop("itemSchema", None) is not None:
                        content["schema"] = {"type": "string", "description": "Server-sent events, one JSON table each"}
    document["components"]["securitySchemes"] = {"token": {"type": "http", "scheme": "bearer"}}
    document["servers"] = [{"url": "/", "description": "the studio that this came from"}]
    document["security"] = [{}, {"token": []}]  # on the studio's own computer none is needed
    return document


def _name_operations(router: APIRouter) -> None:
    """Name each operation of the API by its action: the first words of its documentation."""
    for route in router.routes:
        if isinstance(route, APIRoute):
            route.summary = (route.endpoint.__doc__ or "").partition(".")[0].partition(";")[0].partition(",")[0]


def _refused(request: Request, error: Exception) -> JSONResponse:
    """Answer a request that is refused."""
    status = 404 if isinstance(error, NotThereError) else 409 if isinstance(error, RefusedError) else 400
    told = {"messages": messages_of(error.message)} if isinstance(error, PrintmendError) else {}
    return JSONResponse({"error": str(error), **told}, status)


_WANTED = {  # by the checking library's names of what does not fit: a message, with its limit
    "json_invalid": "valid-json", "string_pattern_mismatch": "key-of-this-studio", "missing": "value",
    "string_type": "some-text", "string_too_long": "most-characters", "string_too_short": "least-characters",
    "bool_type": "true-false", "bool_parsing": "true-false", "int_type": "whole-number",
    "int_parsing": "whole-number", "int_from_float": "whole-number", "float_type": "a-number",
    "float_parsing": "a-number", "finite_number": "a-number", "list_type": "list", "too_long": "most-entries",
    "too_short": "least-entries", "dict_type": "table", "model_attributes_type": "table", "model_type": "table",
    "greater_than_equal": "least-2", "greater_than": "more-2", "less_than_equal": "most", "less_than": "less-than",
    "literal_error": "any", "enum": "any", "extra_forbidden": "nothing-name",
}  # fmt: skip
_LIMITS = ("max_length", "min_length", "ge", "gt", "le", "lt", "expected")
_LONGEST_CAME = 40  # characters of a bad value that are repeated


def _misfit(request: Request, error: Exception) -> JSONResponse:
    """Answer a request that does not fit the API's description, with a message of printmend's."""
    assert isinstance(error, RequestValidationError)
    first = error.errors()[0]
    place = ".".join(str(part) for part in first["loc"][1:] if isinstance(part, str)) or "the request"
    limits = {name: limit for name, limit in first.get("ctx", {}).items() if name in _LIMITS}
    wanted = say(_WANTED.get(first["type"], "what-api-describes"), *limits.values())
    given = first.get("input")
    came: str = say("none") if first["type"] == "missing" else say("something-else")
    if isinstance(given, str | int | float) and len(str(given)) <= _LONGEST_CAME and first["type"] != "json_invalid":
        came = repr(given)
    message = InputError(place, wanted=wanted, came=came, todo=say("see-api-openapi-json")).message
    return JSONResponse({"error": message, "messages": messages_of(message)}, 422)


def _http(request: Request, error: Exception) -> JSONResponse:
    """Answer a request that the framework refuses."""
    assert isinstance(error, HTTPException)
    if isinstance(error.__cause__, TooLargeError):  # while it was read
        return _too_large(request, error.__cause__)
    return JSONResponse({"error": str(error.detail)}, error.status_code, headers=error.headers)


def _too_large(request: Request, error: Exception) -> JSONResponse:
    """Answer an upload that is too large."""
    message = say("upload-too-large", f"{error.args[0] / 1e6:g}")
    return JSONResponse({"error": message, "messages": messages_of(message)}, 413)
